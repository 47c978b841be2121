"""Registry of plug-ins: the built-in one, installed entry points, and files from the command line.

A scene names no plug-in.
"""

import hashlib
import os
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from importlib.metadata import entry_points
from pathlib import Path
from types import MappingProxyType, ModuleType

from thirdbody.errors import Fault, InputError, OutputError, UsageError
from thirdbody.laws.contract import BodyEffect, Law, LawFamily, Plugin, SpotInteraction
from thirdbody.laws.damping import HERTZ_DAMPING, TANGENTIAL_DAMPING
from thirdbody.laws.effects import DAMPING, GRAVITY, LOCAL_DAMPING
from thirdbody.laws.friction import COULOMB, MINDLIN
from thirdbody.laws.hertz import HERTZ
from thirdbody.laws.measures import Measure
from thirdbody.laws.rolling import ROLLING_RESISTANCE
from thirdbody.system.processes import import_file, import_lock

GROUP = "thirdbody.plugins"

DEBRIS_KINDS = "DEBRIS_KINDS"  # name of the tuple of kinds of debris in a plug-in file (`debris.registry`)

CATALOGUE = Plugin(
    name="catalogue",
    families=(
        LawFamily(
            name="hertz_mindlin",
            levels={
                "frictionless": (HERTZ, HERTZ_DAMPING),
                "coulomb": (HERTZ, HERTZ_DAMPING, COULOMB, TANGENTIAL_DAMPING),
                "mindlin": (HERTZ, HERTZ_DAMPING, MINDLIN, TANGENTIAL_DAMPING),
            },
            default_level="mindlin",
            source="Hertz 1882; Mindlin 1949",
        ),
    ),
    effects=(GRAVITY, DAMPING, LOCAL_DAMPING, ROLLING_RESISTANCE),
    source="thirdbody's catalogue",
)
"""The built-in laws and effects, an ordinary plug-in."""


@dataclass(frozen=True)
class Registry:
    """All plug-ins that were loaded. `failures` maps the others to the reason."""

    plugins: tuple[Plugin, ...]
    failures: Mapping[str, str] = field(default_factory=lambda: MappingProxyType({}))

    @property
    def families(self) -> dict[str, LawFamily]:
        return {family.name: family for plugin in self.plugins for family in plugin.families}

    @property
    def effects(self) -> dict[str, Law | BodyEffect | SpotInteraction]:
        return {effect.name: effect for plugin in self.plugins for effect in plugin.effects}

    @property
    def measures(self) -> dict[str, Measure]:
        return {measure.name: measure for plugin in self.plugins for measure in plugin.measures}

    @property
    def laws(self) -> dict[str, Law]:
        result = [law for family in self.families.values() for laws in family.levels.values() for law in laws]
        result += [effect for effect in self.effects.values() if isinstance(effect, Law)]
        return {law.name: law for law in result}


def discover(files: Sequence[str | Path] = ()) -> Registry:
    """Load the built-in plug-in, entry points of the group `thirdbody.plugins`, and the given files. A broken installed plug-in
    is listed in `failures`; a broken file raises UsageError, as do two plug-ins that define the same name."""
    plugins, failures = [CATALOGUE], {}
    for point in sorted(entry_points(group=GROUP), key=lambda point: point.name):
        try:
            plugin = point.load()
            if not isinstance(plugin, Plugin):
                raise TypeError(f"the entry point is a {type(plugin).__name__}, not a Plugin(...)")
            plugins.append(plugin)
        except OutputError:  # compiled code cannot be written: no fault of the plug-in
            raise
        except Exception as problem:  # whatever a plug-in raises on import, the others must still load
            failures[point.name] = f"{type(problem).__name__}: {problem}"
    plugins += [load_file(Path(file)) for file in files]
    owners: dict[str, str] = {}
    for plugin in plugins:
        for name in [part.name for part in (*plugin.families, *plugin.effects, *plugin.measures)]:
            if name in owners:
                raise UsageError(f"plug-ins '{owners[name]}' and '{plugin.name}' both bring '{name}'")
            owners[name] = plugin.name
    return Registry(tuple(plugins), MappingProxyType(failures))


def installed_interaction(name: str) -> SpotInteraction:
    """Return the interaction of spots of this name. Raises InputError where no plug-in has it."""
    effect = discover().effects.get(name)
    if not isinstance(effect, SpotInteraction):
        raise InputError([Fault(f"effects.{name}", "no interaction of spots of this name is installed")])
    return effect


def load_module(path: Path) -> ModuleType:
    if not os.path.isfile(path):  # unlike Path.is_file, False for a name that is too long
        raise UsageError(f"plug-in {path}: no such file")
    digest = hashlib.sha256(str(path.resolve()).encode()).hexdigest()[:8]
    name = f"thirdbody_file_{path.stem}_{digest}"
    with import_lock:
        try:
            return sys.modules.get(name) or import_file(name, path)
        except Exception as problem:
            raise UsageError(f"plug-in {path}: {type(problem).__name__}: {problem}") from problem


def load_file(path: Path) -> Plugin:
    """Return the `PLUGIN` of a Python file; an empty one if it has only kinds of debris. Raises UsageError."""
    module = load_module(path)
    if not hasattr(module, "PLUGIN") and hasattr(module, DEBRIS_KINDS):
        return Plugin(path.stem)
    plugin = getattr(module, "PLUGIN", None)
    if not isinstance(plugin, Plugin):
        raise UsageError(f"plug-in {path}: the file has no PLUGIN = Plugin(...)")
    return plugin
