"""From the definition of a sweep to its points: every scene resolved and checked before anything runs."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from thirdbody import units
from thirdbody.errors import SETTINGS, Fault, InputError
from thirdbody.scene.model import Scene
from thirdbody.schema.fields import plain
from thirdbody.schema.write import toml_text, toml_value_text
from thirdbody.studies.sweep.axes import fault_of_axis
from thirdbody.studies.sweep.code_version import code_version, point_name
from thirdbody.studies.sweep.design import Settings
from thirdbody.studies.sweep.point import Point
from thirdbody.studies.sweep.results import unknown, with_states
from thirdbody.studies.sweep.sweep_file import Definition
from thirdbody.units import DIMENSIONS

POINTS = "points"
"""Folder of the points within that of a sweep."""

MAX_FAULTS = 1000
"""Number of different faults after which no more points are checked."""


@dataclass(frozen=True)
class AxisColumn:
    """Values of one key at all points: numbers in SI with their unit, or texts where they are no numbers of one kind.

    Keys that move together have the same `axis`.
    """

    key: str
    unit: str
    values: tuple[float | str, ...]
    axis: int


@dataclass(frozen=True)
class Plan:
    """All points of a sweep, and what its table and its readers need; `lengths` of the axes of a grid."""

    title: str
    scene: str
    design: str
    lengths: tuple[int, ...]
    columns: tuple[AxisColumn, ...]
    points: tuple[Point, ...]
    settings: tuple[Settings, ...]

    @property
    def results(self) -> tuple[str, ...]:
        """Names of the results, the same for all points."""
        return self.points[0].results


def make_plan(base: Scene, definition: Definition, folder: Path, plugins: Iterable[str | Path] = ()) -> Plan:
    """Return the points of a sweep in a folder. Raises InputError with all faults of all points."""
    files = tuple(Path(file).absolute() for file in plugins)
    faults: dict[tuple[str, str], Fault] = {}
    base = _with_settings(base, definition, faults)
    checker = _Checker(definition, files, faults)
    listed = [
        {key: definition.setting(key, plain(value)) for key, value in point.items()} for point in definition.points
    ]  # fmt: skip
    scenes = [scene for number, settings in enumerate(listed) if (scene := checker.scene(base, settings, number)) is not None]
    names = checker.results()
    if faults:
        raise InputError(faults.values())
    version, scene_folder = code_version(files), Path(base.beside("")).absolute()
    points, documents = [], []
    for number, scene in enumerate(scenes):
        document = scene.document()
        text = toml_text(document)
        name = point_name(text, document, scene, version)
        points.append(
            Point(number, folder.absolute() / POINTS / name, text, scene_folder, names, files, definition.tables.keep)
        )  # fmt: skip
        documents.append(document)
    columns = tuple(_column(axis, key.key, documents) for axis, keys in enumerate(definition.axes) for key in keys)
    design = definition.design
    lengths = tuple(axis[0].count or 0 for axis in definition.axes) if design == "grid" else ()
    return Plan(base.title, base.to_toml(), design, lengths, columns, tuple(points), tuple(listed))


def _with_settings(base: Scene, definition: Definition, faults: dict[tuple[str, str], Fault]) -> Scene:
    """Return the scene with the settings of all points; their faults are collected."""
    given = {key: definition.setting(key, plain(value)) for key, value in _paths(definition.tables.settings)}
    if not given:
        return base
    try:
        return base.with_settings(given)
    except InputError as error:
        for fault in error.faults:
            faults[fault.key, fault.message] = definition.fault(("settings", fault.key), fault.message)
        return base


def _paths(table: Mapping[str, Any], above: str = "") -> Iterator[tuple[str, Any]]:
    """Yield path and value of a table with tables inside."""
    for name, value in table.items():
        path = f"{above}.{name}" if above else str(name)
        if isinstance(value, Mapping):
            yield from _paths(value, path)
        else:
            yield path, value


class _Checker:
    """Resolves the scene of each point and collects the faults, each once."""

    def __init__(self, definition: Definition, plugins: tuple[Path, ...], faults: dict[tuple[str, str], Fault]) -> None:
        from thirdbody.laws.registry import discover

        self.definition, self.faults = definition, faults
        self.registry = discover(plugins)
        self.laws: dict[str, list[Fault]] = {}
        self.states: dict[str, None] = {}

    def scene(self, base: Scene, settings: Settings, number: int) -> Scene | None:
        """Return the scene of a point, or None after its faults are collected."""
        from thirdbody.assembly.physics import law_faults, states_of

        if len(self.faults) > MAX_FAULTS:
            return None
        try:
            scene = base.with_settings(settings)
        except InputError as error:
            self._collect(error.faults, settings, number)
            wrong = {_words(fault.key) for fault in error.faults}
            left = {key: value for key, value in settings.items() if _words(key) not in wrong}
            if len(left) < len(settings):  # keys that lead nowhere hide the faults of the others
                self.scene(base, left, number)
            return None
        code = f"{scene.contact!r} {scene.effects!r}"
        if code not in self.laws:
            self.laws[code] = law_faults(scene, self.registry)
            self.states |= dict.fromkeys(states_of(scene, self.registry))
            self._collect(self.laws[code], settings, number)
        return scene

    def results(self) -> tuple[str, ...]:
        """Return the names of all results; unknown ones are faults."""
        for number, name in enumerate(self.definition.tables.results):
            if text := unknown(name, self.states):
                self.faults["results", name] = self.definition.fault(("results", number), text)
        return with_states(self.definition.tables.results, list(self.states))

    def _collect(self, faults: Sequence[Fault], settings: Settings, number: int) -> None:
        for fault in faults:
            if (fault.key, fault.message) not in self.faults:
                self.faults[fault.key, fault.message] = self._placed(fault, settings, number)

    def _placed(self, fault: Fault, settings: Settings, number: int) -> Fault:
        """Return the fault at the place in the sweep file that it comes from, or with the values of the point."""
        column = fault_of_axis(self.definition.axes, fault, _words)
        if column is not None:
            placed = self.definition.fault(column.location, fault.message)
            return replace(placed, key=fault.key)
        values = ", ".join(f"{key} = {value}" for key, value in settings.items())
        message = f"{fault.message} (at point {number}: {values})"
        return replace(fault, message=message, file=None if fault.file == SETTINGS else fault.file)


def _words(path: str) -> tuple[str, ...]:
    """Return the parts of a key: `pairs[0].friction` and `pairs.0.friction` have the same."""
    return tuple(word for word in re.split(r"[.\[\]]+", path) if word)


def _column(axis: int, key: str, documents: Sequence[Any]) -> AxisColumn:
    """Return the values of a key in the resolved scenes, as numbers in SI where all are of one kind."""
    raw = [_value_at(document, _words(key)) for document in documents]
    try:
        pairs = [_number(value) for value in raw]
    except ValueError:
        return AxisColumn(
            key, "1", tuple(value if isinstance(value, str) else toml_value_text(value, key) for value in raw), axis
        )
    kinds = {dimension for _, dimension in pairs}
    if len(kinds) > 1:
        return AxisColumn(key, "1", tuple(str(value) for value in raw), axis)
    return AxisColumn(key, DIMENSIONS[kinds.pop()].si_unit or "1", tuple(value for value, _ in pairs), axis)


def _value_at(document: Any, words: Sequence[str]) -> Any:
    """Return the value of a key in a document; "absent" where the scene does not write it out."""
    for word in words:
        try:
            document = document[int(word)] if isinstance(document, list) else document[word]
        except (KeyError, IndexError, ValueError, TypeError):
            return "absent"
    return document


def _number(value: Any) -> tuple[float, str]:
    """Return a number in SI and its dimension. Raises ValueError for anything else."""
    if isinstance(value, str):
        return units.parse_any(value, tuple(DIMENSIONS))
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ValueError("no number")
    return value, "dimensionless"
