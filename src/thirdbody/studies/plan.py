"""From the definition of a sweep to its points, every scene resolved and checked before anything runs; what they would cost."""

from __future__ import annotations

import math
import os
import re
import statistics
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from thirdbody.errors import SETTINGS, Fault, InputError, ThirdbodyError
from thirdbody.scene.model import Scene
from thirdbody.schema.fields import plain
from thirdbody.schema.write import toml_text, toml_value_text
from thirdbody.studies.axes import Settings, number_in_si
from thirdbody.studies.point import DONE, Point, code_version, point_name, read_result
from thirdbody.studies.results import unknown, with_states
from thirdbody.studies.sweep_file import Definition
from thirdbody.system.processes import cores
from thirdbody.system.terminal import print_line
from thirdbody.units import DIMENSIONS, duration, file_size

POINTS = "points"
"""Folder of the points within that of a sweep."""

MAX_FAULTS = 1000
"""Number of different faults after which no more points are checked."""

TRIALS = 5
"""Largest number of points of which the cost is estimated, spread evenly over the sweep."""


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
    given = {key: definition.setting(key, plain(value)) for key, value in _paths(definition.tables.settings)}
    try:
        base = base.with_settings(given) if given else base
    except InputError as error:
        for fault in error.faults:
            faults[fault.key, fault.message] = definition.fault(("settings", fault.key), fault.message)
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


def _paths(table: Mapping[str, Any], above: str = "") -> Iterator[tuple[str, Any]]:
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
        location = _words(fault.key)
        for column in (column for axis in self.definition.axes for column in axis):
            key = _words(column.key)
            if location[: len(key)] == key:
                return self.definition.fault(column.location, fault.message)._replace(key=fault.key)
        values = ", ".join(f"{key} = {value}" for key, value in settings.items())
        message = f"{fault.message} (at point {number}: {values})"
        return fault._replace(message=message, file=None if fault.file == SETTINGS else fault.file)


def _words(path: str) -> tuple[str, ...]:
    """Return the parts of a key: `pairs[0].friction` and `pairs.0.friction` have the same."""
    return tuple(word for word in re.split(r"[.\[\]]+", path) if word)


def _column(axis: int, key: str, documents: Sequence[Any]) -> AxisColumn:
    """Return the values of a key in the resolved scenes, as numbers in SI where all are of one kind."""
    raw = [_value_at(document, _words(key)) for document in documents]
    try:
        pairs = [number_in_si(value) for value in raw]
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


def estimate(plan: Plan, workers: int | None) -> dict[str, Any]:
    """Return what the missing points of a plan cost, from points that are done or from trials of a few; writes nothing.

    `core_seconds` of one core, `wall_time` [s] on `workers`, `disk` and `memory_per_worker` [bytes]; `measured`: number of points
    whose time is known, else that of `trials` is estimated; `failures`: trials that cannot start.
    """
    from thirdbody.runner.outlook import memory_of, outlook
    from thirdbody.runner.simulate import prepare, set_threads

    saved = {point.number: result for point in plan.points if (result := read_result(point)) is not None}
    missing = [point for point in plan.points if point.number not in saved]
    seconds = [result.seconds for result in saved.values() if result.status == DONE]
    sizes = [size for number in saved if (size := _bytes(plan.points[number].folder))]
    set_threads(1)
    trials, memory, failures = list[dict[str, Any]](), [0], list[str]()
    for point in missing[:: max(1, math.ceil(len(missing) / TRIALS))]:
        try:
            built = prepare(point.parsed(), point.plugins)
        except ThirdbodyError as error:
            failures.append(f"point {point.number}: {error.message}")
        else:
            memory.append(memory_of(built))
            trials.append(outlook(built))

    def mean(name: str) -> float:
        known = [float(trial[name]) for trial in trials if math.isfinite(trial[name])]
        return statistics.fmean(known) if known else math.nan

    each = statistics.fmean(seconds) if seconds else mean("estimated_wall_time")
    disk = statistics.fmean(sizes) if sizes else mean("disk") if plan.points[0].keep == "all" else 0.0
    count = max(1, min(workers or cores(), len(missing)))
    total = each * len(missing) if missing else 0.0
    return {
        "points": len(plan.points),
        "done": len(saved),
        "workers": count,
        "core_seconds": total,
        "wall_time": total / count,
        "disk": int(disk * len(missing)) if missing and math.isfinite(disk) else 0,
        "memory_per_worker": max(memory),
        "measured": len(seconds),
        "trials": len(trials),
        "failures": failures,
    }


def _bytes(folder: Path) -> int:
    try:
        return sum(entry.stat().st_size for entry in os.scandir(folder) if entry.is_file())
    except OSError:
        return 0


def print_estimate(plan: Plan, cost: Mapping[str, Any], json: bool) -> None:
    """Print the axes and the cost of a sweep."""
    from thirdbody.report.tables import print_json, table

    values = {column.key: list(dict.fromkeys(column.values)) for column in plan.columns}
    if json:
        axes = [{"key": column.key, "unit": column.unit, "values": values[column.key]} for column in plan.columns]
        print_json({"title": plan.title, "design": plan.design, "axes": axes, "results": plan.results} | dict(cost))
        return
    rows = []
    for column in plan.columns:
        texts = [f"{value:g}" if isinstance(value, int | float) else value for value in values[column.key]]
        shown = ", ".join(texts) if len(texts) <= 8 else f"{', '.join(texts[:3])} ... {texts[-1]} ({len(texts)})"
        rows.append([column.key, column.unit, shown])
    table(plan.title, ["axis", "unit", "values"], rows)
    origin = f"{cost['measured']} points that are done" if cost["measured"] else f"trials of {cost['trials']} points"
    hours = f"{duration(cost['core_seconds'])} of one core, {duration(cost['wall_time'])} on {cost['workers']} workers"
    print_line(f"points: {cost['points']}, {cost['done']} of them done already")
    print_line(f"time: {hours} (from {origin})")
    print_line(
        f"disk: {file_size(cost['disk'])}; memory of a worker: about 0.3 GB, and {file_size(cost['memory_per_worker'])} for a run"
    )
    for failure in cost["failures"]:
        print_line(f"warning: {failure}", err=True)
