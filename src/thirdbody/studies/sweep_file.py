"""The definition of a sweep: its file (TOML) with its CSV file of points, the options of `--vary`, or Python arguments."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import ValidationError

from thirdbody.errors import Fault, InputError
from thirdbody.scene.settings import toml_value
from thirdbody.schema.fields import Count, Seed, Text, Whole, listing
from thirdbody.schema.parts import Location, Part, Wrong, wrongs_of
from thirdbody.schema.read import Source, read_text, read_toml, with_version
from thirdbody.studies.axes import SAMPLED, Axis, Column, Settings, design_faults, read_column, settings_of_points
from thirdbody.studies.results import DEFAULT

VERSION = 1
SET_BY = ("vary", "together", "points")  # keys that give the points: at least one of the first two, or the third

_HEADING = re.compile(r"(?P<key>[^\[]+?)\s*(?:\[(?P<unit>[^\]]*)\])?")
_INDEX = re.compile(r"\[(\d+)\]")


class SweepFile(Part):
    """All keys of a sweep file."""

    sweep: Annotated[int, Whole(ge=VERSION, le=VERSION)] = VERSION
    """Version of the format; required in a file. Example: 1."""
    scene: Text
    """Scene file, relative to the sweep file. Example: "three_spot.toml"."""
    settings: dict[str, Any] = {}
    """Values replaced in the scene for all points, by key. Example: {"solver.distance" = "2 um"}."""
    vary: dict[str, Any] = {}
    """Values by key: a list, or {from, to, count, scale}; keys joined by a comma get the same values. Scales: linear, log, or
    whole (whole numbers only). Example: {"pairs.0.friction" = {from = 0.1, to = 0.5, count = 5}}."""
    together: Annotated[tuple[dict[str, Any], ...], listing("a list of tables [[together]]")] = ()
    """Tables like `vary` whose keys form one axis.
    Example: [{"debris.0.seed" = [1, 2], "plates.upper.load" = ["1 mN", "2 mN"]}]."""
    points: Text | None = None
    """CSV file of points instead of axes: keys in its header, a row per point. Example: "points.csv"."""
    design: Literal["grid", "zip", "sobol", "latin_hypercube"] = "grid"
    """All combinations, values side by side, or samples. Example: "sobol"."""
    samples: Count | None = None
    """Number of points of a sampled design. Example: 64."""
    seed: Seed = 1
    """Seed of a sampled design. Example: 1."""
    results: Annotated[tuple[Text, ...], listing("a list of names")] = DEFAULT
    """Columns of the table. Example: ["friction_coefficient", "peak_pressure"]."""
    keep: Literal["all", "summary"] = "all"
    """What is kept of each run: all of it, or its results only. Example: "summary"."""

    @classmethod
    def rules(cls, raw: dict[str, Any], context: Any) -> list[Wrong]:
        """Return faults that follow from which keys are given."""
        axes = [key for key in SET_BY[:2] if raw.get(key)]
        if raw.get("points") is not None:
            return [((key,), "points of a CSV file are given too: give one or the other") for key in axes]
        return [] if axes else [((), "give the points: [vary], [[together]] or points")]


@dataclass(frozen=True)
class Definition:
    """A checked sweep file: its tables, its axes, the settings of all points as given, and where they come from."""

    tables: SweepFile
    axes: tuple[Axis, ...]
    points: tuple[Settings, ...]
    source: Source
    folder: Path
    from_file: bool
    design: str


def read_sweep(path: Path) -> Definition:
    """Return the sweep in a TOML file. Raises InputError with all faults of its own; the scene is not read."""
    document, source = read_toml(read_text(path), str(path))
    return _definition(document, source, path.parent, with_version(document, "sweep", VERSION), from_file=True)


def is_sweep(path: Path) -> bool:
    """Return whether a TOML file is that of a sweep: a scene gives its version as `scene`. Raises InputError."""
    document, _ = read_toml(read_text(path), str(path))
    return "sweep" in document or not isinstance(document.get("scene"), int)


def sweep_of_options(scene: str, vary: Sequence[str], options: Mapping[str, Any]) -> Definition:
    """Return the sweep of `--vary KEY=VALUES` options. Raises InputError."""
    tables: dict[str, Any] = {}
    wrongs: list[Wrong] = []
    for text in vary:
        key, sign, values = text.partition("=")
        if not sign or not key.strip() or not values.strip():
            wrongs.append((("--vary",), f"{text}: write KEY=FROM:TO:COUNT or KEY=A,B,C"))
        elif key.strip() in tables:
            wrongs.append((("--vary",), f"{text}: {key.strip()} is varied twice"))
        else:
            tables[key.strip()] = _option_values(values.strip())
    document = {"scene": scene, "vary": tables} | dict(options)
    return _definition(document, Source(), Path(), wrongs, from_file=True)


def _option_values(text: str) -> Any:
    """Return the values in `0.05:0.6:12`, `1 mN:10 mN:5:log`, `0.1:10:log` or `1,2,3` as a file would give them."""
    parts = [part.strip() for part in text.split(":")]
    if 1 < len(parts) <= 4 and not text.startswith(("[", "{", '"', "'")):
        names = ("from", "to", "scale") if parts[2:] in (["log"], ["linear"], ["whole"]) else ("from", "to", "count", "scale")
        return {name: toml_value(part) for name, part in zip(names, parts, strict=False)}
    whole = toml_value(f"[{text}]")
    return whole if isinstance(whole, list) else [toml_value(part.strip()) for part in text.split(",")]


def sweep_of_python(vary: Any, options: Mapping[str, Any]) -> Definition:
    """Return the sweep of Python arguments: axes by key or by tuple of keys, or a list of points. Raises InputError."""
    document: dict[str, Any] = {"scene": "the scene"} | dict(options)
    if not isinstance(vary, Mapping):
        points = tuple(dict(point) for point in vary)
        return _definition(document | {"points": "the points"}, Source(), Path(), [], False, points)
    document["vary"] = {key: values for key, values in vary.items() if isinstance(key, str)}
    groups = {key: list(values) for key, values in vary.items() if not isinstance(key, str)}
    document["together"] = [{key: [row[k] for row in rows] for k, key in enumerate(keys)} for keys, rows in groups.items()]
    return _definition(document, Source(), Path(), [], from_file=False)


def saved_definition(document: Mapping[str, Any]) -> Definition:
    """Return the sweep whose plan `folder.save_plan` has saved: its points with the axes that they came from."""
    keys = {"results": list(document["results"]), "keep": document["keep"]}
    points = tuple(dict(point["settings"]) for point in document["points"])
    design, lengths = document["design"], document["lengths"]
    saved = _definition({"scene": "scene.toml", "points": "points.csv"} | keys, Source(), Path(), [], False, points)
    axes: dict[int, list[Column]] = {}
    for entry in document["columns"]:
        count = lengths[entry["axis"]] if lengths else 0
        axes.setdefault(entry["axis"], []).append(Column(entry["key"], (None,) * count))
    return replace(saved, axes=tuple(map(tuple, axes.values())), design=design)


def _definition(
    document: dict[str, Any], source: Source, folder: Path, wrongs: list[Wrong], from_file: bool,
    points: tuple[Settings, ...] = (),
) -> Definition:  # fmt: skip
    try:
        tables = SweepFile.model_validate(document, context={"file": from_file})
    except ValidationError as error:
        raise InputError(source.in_order([*wrongs, *wrongs_of(error)])) from None

    def report(location: Location, text: str) -> None:
        wrongs.append((location, text))

    axes = tuple(_axes(tables, report))
    if not wrongs and not tables.points:
        wrongs += design_faults(tables.design, axes, tables.samples)
    if wrongs:
        raise InputError(source.in_order(wrongs))
    if tables.points and not points and from_file:
        points = tuple(read_points(folder / tables.points))
    elif not tables.points:
        points = tuple(settings_of_points(tables.design, axes, tables.samples, tables.seed))
    if not points:
        raise InputError(source.fault(("points",), "no points"))
    design = "points" if tables.points else tables.design
    keys = dict.fromkeys(key for point in points for key in point)  # of a list of points: axes without values
    axes = axes or tuple((Column(key, (), ("points",)),) for key in keys)
    return Definition(tables, axes, points, source, folder, from_file, design)


def _axes(tables: SweepFile, report: Any) -> Iterator[Axis]:
    sampled, used = tables.design in SAMPLED, set[str]()
    groups: list[tuple[Location, Any]] = [(("vary",), [leaf]) for leaf in _leaves(tables.vary, ("vary",))]
    groups += [(("together", k), _leaves(table, ("together", k))) for k, table in enumerate(tables.together)]
    for group, leaves in groups:
        columns = [
            read_column(name.strip(), given, location, report, sampled)
            for location, key, given in leaves
            for name in key.split(",")
        ]
        for column in columns:
            if column.key in used:
                report(column.location, f"{column.key} is varied twice")
            used.add(column.key)
        counts = {column.key: column.count for column in columns if column.values != ()}
        if not columns:
            report(group, "expected keys that move together")
        elif len(set(counts.values())) > 1:
            listed = ", ".join(f"{count or 'sampled'} values of {key}" for key, count in counts.items())
            report(group, f"moved together, but with {listed}")
        else:
            yield tuple(columns)


def _leaves(table: Mapping[str, Any], location: Location, path: str = "") -> Iterator[tuple[Location, str, Any]]:
    """Yield place, key and values: tables within tables are paths, as `pairs.0.friction = [0.1, 0.2]` gives them."""
    for name, value in table.items():
        key, inner = (f"{path}.{name}" if path else str(name)), (*location, name)
        # an interval has an end, or no lists and tables inside
        interval = isinstance(value, Mapping) and (
            bool({"from", "to"} & set(value)) or not any(isinstance(entry, list | Mapping) for entry in value.values())
        )
        if isinstance(value, Mapping) and value and not interval:
            yield from _leaves(value, inner, key)
        else:
            yield inner, key, value


def read_points(path: Path) -> list[Settings]:
    """Return the settings of each row of a CSV file, keys of the scene in its header, values as a sweep file gives them.

    A unit stands in the header, or units in the cells. Raises InputError with all faults.
    """
    rows = list(csv.reader(io.StringIO(read_text(path))))
    if len(rows) < 2:
        raise InputError(Fault("", "expected a header with keys of the scene, and a row for each point", str(path)))
    headings = []
    for text in rows[0]:  # `plates.upper.load [mN]`; `pairs[0].friction` is a key as well
        match = _HEADING.fullmatch(_INDEX.sub(r".\1", text.strip()))
        headings.append((match["key"].strip(), (match["unit"] or "").strip()) if match else ("", ""))
    faults = [Fault(f"column {k}", "has no key in the header", str(path), 1) for k, (key, _) in enumerate(headings, 1) if not key]
    twice = {key for key, _ in headings if [other for other, _ in headings].count(key) > 1 and key}
    faults += [Fault(key, "has two columns", str(path), 1) for key in sorted(twice)]
    points = []
    for line, row in enumerate(rows[1:], 2):
        cells = [cell.strip() for cell in row]
        if not any(cells):
            continue
        if len(row) != len(headings):
            faults.append(Fault("", f"{len(row)} cells, the header has {len(headings)}", str(path), line))
            continue
        pairs = list(zip(headings, cells, strict=True))
        faults += [Fault(key, "the cell is empty", str(path), line) for (key, _), cell in pairs if not cell]
        points.append({key: f"{cell} {unit}" if unit else toml_value(cell) for (key, unit), cell in pairs if cell})
    if faults:
        raise InputError(faults)
    return points
