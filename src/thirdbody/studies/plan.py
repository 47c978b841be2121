"""From the definition of a sweep to its points, every scene resolved and checked before anything runs; what they would cost."""

from __future__ import annotations

import math
import statistics
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from thirdbody.errors import SETTINGS, Fault, InputError, ThirdbodyError
from thirdbody.scene.model import Scene
from thirdbody.scene.settings import words_of
from thirdbody.schema.fields import plain
from thirdbody.schema.write import toml_text, toml_value_text
from thirdbody.studies.axes import Settings, number_in_si
from thirdbody.studies.point import DONE, Point, code_version, point_name, read_result
from thirdbody.studies.results import unknown, with_states
from thirdbody.studies.sweep_file import Definition
from thirdbody.system.processes import cores
from thirdbody.system.terminal import print_line
from thirdbody.units import DIMENSIONS, duration, file_size

POINTS = "points"  # folder of the points within that of a sweep
MAX_FAULTS = 1000  # number of different faults after which no more points are checked
TRIALS = 5  # largest number of points of which the cost is estimated, spread evenly over the sweep


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
    checker = _Checker(definition, files)
    given, *listed = (
        {key: toml_value_text(plain(value), key) if definition.from_file else plain(value) for key, value in settings}
        for settings in (_paths(definition.tables.settings), *(point.items() for point in definition.points))
    )
    try:
        base = base.with_settings(given)
    except InputError as error:
        for fault in error.faults:
            checker.faults[fault.key, fault.message] = definition.source.fault(("settings", fault.key), fault.message)
    scenes = [scene for number, settings in enumerate(listed) if (scene := checker.scene(base, settings, number)) is not None]
    names = checker.results()
    if checker.faults:
        raise InputError(checker.faults.values())
    version, scene_folder = code_version(files), Path(base.beside("")).absolute()
    points, documents = [], [scene.document() for scene in scenes]
    for number, (scene, document) in enumerate(zip(scenes, documents, strict=True)):
        text = toml_text(document)
        point_folder = folder.absolute() / POINTS / point_name(text, document, scene, version)
        points.append(Point(number, point_folder, text, scene_folder, names, files, definition.tables.keep))
    columns = tuple(_column(axis, key.key, documents) for axis, keys in enumerate(definition.axes) for key in keys)
    lengths = tuple(axis[0].count or 0 for axis in definition.axes) if definition.design == "grid" else ()
    changed = ", ".join(f"{key} = {value}" for key, value in given.items())
    title = f"{base.title} ({changed})" if base.title and changed else base.title
    return Plan(title, base.to_toml(), definition.design, lengths, columns, tuple(points), tuple(listed))


def _paths(table: Mapping[str, Any], above: str = "") -> Iterator[tuple[str, Any]]:
    for name, value in table.items():
        path = f"{above}.{name}" if above else str(name)
        if isinstance(value, Mapping):
            yield from _paths(value, path)
        else:
            yield path, value


class _Checker:
    """Resolves the scene of each point and collects the faults, each once."""

    def __init__(self, definition: Definition, plugins: tuple[Path, ...]) -> None:
        from thirdbody.laws.registry import discover

        self.definition, self.registry = definition, discover(plugins)
        self.faults: dict[tuple[str, str], Fault] = {}
        self.laws: set[str] = set()
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
            wrong = {words_of(fault.key) for fault in error.faults}
            left = {key: value for key, value in settings.items() if words_of(key) not in wrong}
            if len(left) < len(settings):  # keys that lead nowhere hide the faults of the others
                self.scene(base, left, number)
            return None
        code = f"{scene.contact!r} {scene.effects!r}"
        if code not in self.laws:
            self.laws.add(code)
            self.states |= dict.fromkeys(states_of(scene, self.registry))
            self._collect(law_faults(scene, self.registry), settings, number)
        return scene

    def results(self) -> tuple[str, ...]:
        """Return the names of all results; unknown ones are faults."""
        for number, name in enumerate(self.definition.tables.results):
            if text := unknown(name, self.states):
                self.faults["results", name] = self.definition.source.fault(("results", number), text)
        return with_states(self.definition.tables.results, list(self.states))

    def _collect(self, faults: Sequence[Fault], settings: Settings, number: int) -> None:
        """Keep faults at the place in the sweep file that they come from, or with the values of the point."""
        columns = [column for axis in self.definition.axes for column in axis]
        for fault in faults:
            at = next((one for one in columns if words_of(fault.key)[: len(words_of(one.key))] == words_of(one.key)), None)
            if (fault.key, fault.message) in self.faults:
                continue
            if at is not None:
                placed = self.definition.source.fault(at.location, fault.message)._replace(key=fault.key)
            else:
                values = ", ".join(f"{key} = {value}" for key, value in settings.items())
                file = None if fault.file == SETTINGS else fault.file
                placed = fault._replace(message=f"{fault.message} (at point {number}: {values})", file=file)
            self.faults[fault.key, fault.message] = placed


def _column(axis: int, key: str, documents: Sequence[Any]) -> AxisColumn:
    """Return the values of a key in the resolved scenes, as numbers in SI where all are of one kind."""
    raw = [_value_at(document, words_of(key)) for document in documents]
    try:
        values, kinds = zip(*map(number_in_si, raw), strict=True)
    except ValueError:
        values, kinds = tuple(value if isinstance(value, str) else toml_value_text(value, key) for value in raw), ()
    if len(set(kinds)) > 1:
        values, kinds = tuple(map(str, raw)), ()
    return AxisColumn(key, DIMENSIONS[kinds[0]].si_unit or "1" if kinds else "1", values, axis)


def _value_at(document: Any, words: Sequence[str]) -> Any:
    """Return the value of a key in a document; "absent" where the scene does not write it out."""
    try:
        for word in words:
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
    folders = [plan.points[number].folder for number in saved]
    sizes = [size for folder in folders if (size := sum(file.stat().st_size for file in folder.iterdir() if file.is_file()))]
    set_threads(1)
    trials, memory, failures = list[dict[str, Any]](), [0], list[str]()
    for point in missing[:: max(1, math.ceil(len(missing) / TRIALS))]:
        try:
            built = prepare(point.parsed(), point.plugins)
            memory.append(memory_of(built))
            trials.append(outlook(built))
        except ThirdbodyError as error:
            failures.append(f"point {point.number}: {error.message}")

    def mean(name: str) -> float:
        known = [float(trial[name]) for trial in trials if math.isfinite(trial[name])]
        return statistics.fmean(known) if known else math.nan

    each = statistics.fmean(seconds) if seconds else mean("estimated_wall_time")
    disk = statistics.fmean(sizes) if sizes else mean("disk") if plan.points[0].keep == "all" else 0.0
    count, total = max(1, min(workers or cores(), len(missing))), each * len(missing) if missing else 0.0
    return {
        "points": len(plan.points), "done": len(saved), "workers": count, "core_seconds": total, "wall_time": total / count,
        "disk": int(disk * len(missing)) if missing and math.isfinite(disk) else 0, "memory_per_worker": max(memory),
        "measured": len(seconds), "trials": len(trials), "failures": failures,
    }  # fmt: skip


def print_estimate(plan: Plan, cost: Mapping[str, Any], json: bool) -> None:
    """Print the axes and the cost of a sweep."""
    from thirdbody.report.tables import print_json, print_warnings, table

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
    print_warnings(cost["failures"])
