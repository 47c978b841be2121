"""Flat tables of a run for CSV files and data frames: one-dimensional columns with name and unit.

Vectors become one column per component (`force_x`, quaternions `quaternion_w` first), and codes get a column of names (`state`,
`state_name`). Columns without a unit are pure numbers, codes or names.
"""

from collections.abc import Iterator, Mapping
from typing import NamedTuple

import numpy as np

from thirdbody.kernels.tables import DEBRIS, LOWER, UPPER
from thirdbody.trajectory.names import ARRAY_UNITS, POSITION
from thirdbody.trajectory.names import CYCLES as CYCLE_NAMES
from thirdbody.trajectory.run_file import RunFile
from thirdbody.trajectory.states import code_name

SERIES, PROFILES, BODIES, CONTACTS, CYCLES, TRANSITIONS, MAP_STATISTICS = TABLES = (
    "series", "profiles", "bodies", "contacts", "cycles", "transitions", "map_statistics",
)  # fmt: skip
BY_FRAME = PROFILES, BODIES, CONTACTS
"""Tables with many rows for each frame."""

_COMPONENTS = {2: "xy", 3: "xyz", 4: "wxyz", 9: [f"{a}{b}" for a in "xyz" for b in "xyz"]}
_UNITS = {"time": "s", "distance": "m"} | ARRAY_UNITS
_SIDES = {LOWER: "lower", UPPER: "upper", DEBRIS: "debris"}


class Column(NamedTuple):
    """Column of a table: `values` (rows,) numbers or texts; `unit` is empty for pure numbers, codes and names."""

    name: str
    unit: str
    values: np.ndarray


def table(run: RunFile, name: str, frame: int | None = None) -> list[Column]:
    """Return one of TABLES; profiles, bodies and contacts of one frame, or of all frames concatenated.

    Raises ValueError for another name, IndexError for a frame outside the run, AttributeError when the run has no states or
    profiles.
    """
    if name == PROFILES and not run.profiles:
        raise AttributeError(f"{run.path}: this run has no profiles; output.profiles = 20 in its scene records some")
    if name in BY_FRAME:
        same = zip(*tables_by_frame(run, name, frame), strict=True)
        return [Column(parts[0].name, parts[0].unit, np.concatenate([part.values for part in parts])) for parts in same]
    if name not in TABLES:
        raise ValueError(f"no table '{name}'; there are {', '.join(TABLES)}")
    if frame is not None:
        raise ValueError(f"the table of {name} is over all frames; leave `frame` out")
    if name == CYCLES:
        return [Column(key, CYCLE_NAMES[key].unit.replace("1", ""), values) for key, values in run.cycles.items()]
    if name == MAP_STATISTICS:
        return _map_statistics(run)
    return _series(run) if name == SERIES else _transitions(run)


def tables_by_frame(run: RunFile, name: str, frame: int | None = None) -> Iterator[list[Column]]:
    """Yield the table of profiles, bodies or contacts frame by frame, or of one frame. Raises IndexError outside the run."""
    numbers = [run.frame_number(frame)] if frame is not None else range(run.frame_number(-1) + 1)
    table_of = {PROFILES: _profiles, BODIES: _bodies, CONTACTS: _contacts}[name]
    for number in numbers:
        yield table_of(run, number)


def _series(run: RunFile) -> list[Column]:
    first = [name for name in ("time", "distance") if name in run.series]
    names = first + [name for name in run.series if name not in first]
    return [column for name in names for column in _as_columns(name, run.series[name], run.units[name])]


def _map_statistics(run: RunFile) -> list[Column]:
    """Return the statistics of the run, then those of one cycle, where it has two."""
    parts = {"run": run.map_statistics()} | ({"cycle": run.map_statistics(1.0)} if len(run.cycles["cycle"]) > 1 else {})
    over = np.repeat(np.array(list(parts), object), len(parts["run"]["map"]))
    same = {name: np.concatenate([part[name] for part in parts.values()]) for name in parts["run"]}
    return [Column("over", "", over), *(Column(name, "", values) for name, values in same.items())]


def _transitions(run: RunFile) -> list[Column]:
    result = run.transitions()
    columns = []
    for name, values in result.items():
        columns += _as_columns(name, values)
        if name in ("from", "to", "reason"):
            columns += _named(name, values, run.reason_names if name == "reason" else run.state_names)
    return columns


def _profiles(run: RunFile, number: int) -> list[Column]:
    arrays = {name: values[number] for name, values in run.profiles.items()}
    slabs = len(arrays[POSITION])
    columns = [Column("slab", "", np.arange(slabs))]
    for name, values in arrays.items():
        columns += _as_columns(name, values.reshape(slabs, -1) if values.ndim > 1 else values, run.units[name])
    return _stamped(run, number, columns)


def _bodies(run: RunFile, number: int) -> list[Column]:
    arrays = run.bodies(number)
    body = arrays.pop("id", np.arange(len(arrays[POSITION])))
    first = {"body": body, POSITION: arrays.pop(POSITION)}
    for name in ("state", "state_reason"):
        if name in arrays:
            first[name] = arrays.pop(name)
    names = {"state": run.state_names, "state_reason": run.reason_names}
    names |= {"population": run.population_names, "material": run.material_names}
    return _stamped(run, number, _columns(first | arrays, names, run.header["units"]))


def _contacts(run: RunFile, number: int) -> list[Column]:
    arrays = run.contacts(number)
    first = {name: arrays.pop(name) for name in ("body", "side", "partner", POSITION) if name in arrays}
    return _stamped(run, number, _columns(first | arrays, {"side": _SIDES}, run.header["units"]))


def _stamped(run: RunFile, number: int, columns: list[Column]) -> list[Column]:
    rows = len(columns[0].values)
    return [Column("frame", "", np.full(rows, number)), Column("time", "s", np.full(rows, run.times[number])), *columns]


def _columns(
    arrays: Mapping[str, np.ndarray], names: Mapping[str, Mapping[int, str] | list[str]], units: Mapping[str, str]
) -> list[Column]:
    """Return arrays of bodies or contacts as columns; `units`: of a run, with those of its measures."""
    columns = []
    for name, values in arrays.items():
        columns += _as_columns(name, values, _UNITS.get(name) or units.get(name, ""))
        if name in names:
            columns += _named(name, values, names[name])
    return columns


def _as_columns(name: str, values: np.ndarray, unit: str | None = None) -> list[Column]:
    """Return an array as columns: itself, or its components."""
    unit = _UNITS.get(name, "") if unit is None else unit
    unit = "" if unit == "1" else unit
    if values.ndim == 1:
        return [Column(name, unit, values)]
    letters = _COMPONENTS.get(values.shape[1], range(values.shape[1]))
    return [Column(f"{name}_{letter}", unit, values[:, i]) for i, letter in enumerate(letters)]


def _named(name: str, codes: np.ndarray, names: Mapping[int, str] | list[str]) -> list[Column]:
    texts = [names[int(code)] if isinstance(names, Mapping) else code_name(names, int(code)) for code in codes]
    return [Column(f"{name}_name", "", np.array(texts, dtype=object))]
