"""Reference of what is installed: keys of a scene, options, series and arrays of a run, exit codes; laws and their code."""

from __future__ import annotations

import math
import re
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, astuple
from pathlib import Path
from typing import Any

from thirdbody.errors import UsageError, nearest
from thirdbody.laws.contract import Option
from thirdbody.laws.measures import layout_of
from thirdbody.laws.registry import Registry, discover, load_file
from thirdbody.report.tables import print_json, table
from thirdbody.scene.keys import Key, allowed, merged, scene_keys, toml
from thirdbody.scene.model import Scene
from thirdbody.schema.fields import quantity_schema
from thirdbody.system.terminal import print_line
from thirdbody.trajectory.names import COUNT, FRACTION, SERIES, SURFACE_WEAR, TABLES, Name


def all_keys(registry: Registry) -> list[Key]:
    """Return every key of a scene file, those of the installed laws and effects after the others of their table."""
    keys, own = scene_keys(Scene.model_json_schema()), Scene.model_fields["effects"].annotation.model_fields  # type: ignore[union-attr]
    laws = [(level, law) for family in registry.families.values() for level, laws in family.levels.items() for law in laws]
    options = [
        *merged(_option_key(f"contact.{option.name}", option, (level,)) for level, law in laws for option in law.options),
        *merged(_named_options("effects", {name: part for name, part in registry.effects.items() if name not in own})),
        *merged(_named_options("measures", registry.measures)),
    ]
    last = {key.path.split(".")[0]: position for position, key in enumerate(keys)}
    return sorted([*keys, *options], key=lambda key: last[key.path.split(".")[0]])


def _named_options(kind: str, known: Mapping[str, Any]) -> Iterator[Key]:
    for name, part in known.items():
        for option in part.options:
            yield _option_key(f"{kind}.{name}.{option.name}", option, ())


def _option_key(path: str, option: Option, tables: tuple[str, ...]) -> Key:
    limits = {word: limit for word, limit in (("minimum", option.low), ("maximum", option.high)) if math.isfinite(limit)}
    number = quantity_schema(option.dimension, limits, option.words if option.or_number else ())
    entry = {"enum": option.words} if option.words and not option.or_number else number
    value, unit = allowed(entry if option.size == 1 else {"type": "array", "prefixItems": [entry] * option.size})
    default = "required" if option.default is None else toml(option.default)
    meaning, _, example = option.doc.partition(", such as ")
    return Key(path, tables, value, unit, default, _sentence(meaning), example or toml(option.default))


def _sentence(text: str) -> str:
    return f"{text[:1].upper()}{text[1:].rstrip('.')}." if text else ""


def all_names(registry: Registry) -> dict[str, dict[str, Name]]:
    """Return the series and arrays of a run by table, those of the installed labellers with them."""
    tables = {table: dict(names) for table, names in TABLES.items()}
    for labeller in {id(one): one for family in registry.families.values() if (one := family.labeller)}.values():
        tables["series"] |= {f"fraction_{state}": FRACTION for state in labeller.states}
        tables["series"] |= {f"count_{reason}": COUNT for reason in labeller.reasons}
        outputs = {column.name: column for column in labeller.outputs}
        for name in (*labeller.margins, *labeller.extras):
            column, key = outputs.get(name), f"margin_{name}" if name in labeller.margins else name
            unit, meaning = (column.unit, column.meaning) if column else ("", "")
            tables["bodies"][key] = Name(unit or "1", _sentence(meaning))
    layouts = [layout_of([measure]) for measure in registry.measures.values()]
    tables["measures"] = {c.name: Name(c.unit, _sentence(c.doc)) for layout in layouts for c in layout.bodies}
    tables["maps"] = {
        m.name: Name(m.unit, f"{_sentence(m.doc).replace('the body', 'all bodies')} Given per area of a cell.")
        for layout in layouts
        for m in layout.maps
    }
    tables["maps"][SURFACE_WEAR] = Name("m", "Depth taken from the surface of the plate so far; only with `plates.wear`.")
    return tables


def keys_report(word: str | None, plugins: Sequence[Path], json: bool) -> None:
    """Print the keys and names that a word finds, or all of them. Raises UsageError, with the nearest name, for none."""
    registry = discover(plugins)
    keys, names = _matches(word, all_keys(registry), all_names(registry))
    if json:
        run = {kind: {name: entry._asdict() for name, entry in entries.items()} for kind, entries in names.items()}
        print_json({"scene": [asdict(key) for key in keys], "run": run})
        return
    if keys:
        rows = [(key.path, ", ".join(key.tables), *astuple(key)[2:]) for key in keys]
        table("keys of a scene file", ("key", "for", "value", "unit", "default", "meaning", "example"), rows)
        print()
    for kind, entries in names.items():
        if entries:
            title = "series of a run: run.series[name]" if entries.keys() <= SERIES.keys() else f"{kind} of a run"
            table(title, ("name", "unit", "meaning"), [(name, *entry) for name, entry in entries.items()])
            print()


def _matches(
    word: str | None, keys: list[Key], names: dict[str, dict[str, Name]]
) -> tuple[list[Key], dict[str, dict[str, Name]]]:
    if word is None:
        return keys, names
    wanted = re.sub(r"\[\d+\]|\.\d+(?=\.|$)", "", word).lower()
    for text_of in (lambda name, meaning: name, lambda name, meaning: meaning):
        result = [key for key in keys if wanted in text_of(key.path, key.meaning).lower()]
        tables = {
            kind: {name: entry for name, entry in entries.items() if wanted in text_of(name, entry.meaning).lower()}
            for kind, entries in names.items()
        }
        if result or any(tables.values()):
            return result, tables
    parts = {part for key in keys for part in (key.path, key.path.rpartition(".")[2])}
    known = parts | {name for entries in names.values() for name in entries}
    raise UsageError(f"keys {word}: nothing has this name, {nearest(wanted, known)}")


def print_code(scene: Scene, registry: Registry, json: bool) -> None:
    """Print the text of each generated module of a scene, one after the other or as one JSON object. Raises InputError.

    `law`: the contact laws, with the stiffness that bounds an explicit step and the tangents of an implicit one. `effects` and
    `labeller`: absent from a scene without any.
    """
    from thirdbody.assembly.physics import compile_physics

    choice = compile_physics(scene, registry)
    compiled: dict[str, Callable | None] = {
        "law": choice.chain.law,
        "effects": choice.physics.effects if choice.effects else None,
        "labeller": choice.physics.observe if choice.labeller else None,
    }
    files = {name: str(sys.modules[part.__module__].__file__) for name, part in compiled.items() if part is not None}
    modules = {name: Path(file).read_text(encoding="utf-8") for name, file in files.items()}
    if json:
        print_json(modules)
        return
    for name, text in modules.items():
        print(f"# {'=' * 60} {name}\n{text.rstrip()}\n")


def laws_report(registry: Registry, json: bool) -> None:
    """Print every law family with its levels, every effect, and what failed to load."""
    owners = {family.name: plugin.name for plugin in registry.plugins for family in plugin.families}
    families = [
        {
            "law": family.name,
            "plugin": owners[family.name],
            "level": level + (" (default)" if level == family.default_level else ""),
            "chain": " > ".join(law.name for law in laws),
        }
        for family in registry.families.values()
        for level, laws in family.levels.items()
    ]
    laws = [{"law": law.name, "stage": law.stage, "source": law.source} for law in registry.laws.values()]
    effects, measures = (
        [
            {kind: name, "options": ", ".join(f"{o.name} ({o.dimension})" for o in part.options), "source": part.source}
            for name, part in known.items()
        ]
        for kind, known in (("effect", registry.effects), ("measure", registry.measures))
    )
    if json:
        failures = dict(registry.failures)
        print_json({"families": families, "laws": laws, "effects": effects, "measures": measures, "failures": failures})
        return
    named = (("effects (named in [effects], else absent)", effects), ("measures (named in [measures], else absent)", measures))
    for title, rows in (("law families", families), ("laws", laws), *named):
        if rows:
            table(title, tuple(rows[0]), [[str(value) for value in row.values()] for row in rows])
            print()
    for name, why in registry.failures.items():
        print_line(f"plug-in {name} did not load: {why}")


def conformance_report(files: Sequence[Path], json: bool) -> None:
    """Run the conformance suite on all that plug-in files bring. Raises UsageError if a test fails."""
    from thirdbody.laws.conformance.suite import check, report

    findings = []
    for file in files:
        plugin = load_file(file)
        laws = {law.name: law for family in plugin.families for level in family.levels.values() for law in level}
        others = {effect.name: effect for effect in plugin.effects}
        labellers = {family.labeller.name: family.labeller for family in plugin.families if family.labeller}
        findings += check([*(laws | others).values(), *plugin.measures, *labellers.values()])
    if json:
        print_json([finding.__dict__ for finding in findings])
    else:
        print(report(findings) if findings else "nothing to test: no law, effect, measure or labeller; see `thirdbody shapes`")
    failed = [finding for finding in findings if not finding.passed]
    if failed:
        raise UsageError(f"{len(failed)} of {len(findings)} conformance tests failed")
