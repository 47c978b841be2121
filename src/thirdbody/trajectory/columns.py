"""Flat tables of a run for CSV files and data frames: one-dimensional columns with name and unit.

Vectors become one column per component (`force_x`, quaternions `quaternion_w` first), and codes get a column of names (`state`,
`state_name`). Columns without a unit are pure numbers, codes or names.
"""

from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from thirdbody.trajectory.names import ARRAY_UNITS, POSITION, SIDES
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
    if name not in TABLES:
        raise ValueError(f"no table '{name}'; there are {', '.join(TABLES)}")
    if frame is not None and name not in BY_FRAME:
        raise ValueError(f"the table of {name} is over all frames; leave `frame` out")
    same = zip(*table_parts(run, name, frame), strict=True)
    return [Column(parts[0].name, parts[0].unit, np.concatenate([part.values for part in parts])) for parts in same]


def tables_of(run: RunFile) -> list[str]:
    """Return the names of the tables for which the run has data."""
    missing = {TRANSITIONS: not run.has_states, CYCLES: not run.drag.stroke, PROFILES: not run.profiles}
    missing |= {CONTACTS: not run.has_contacts, MAP_STATISTICS: not run.map_units}
    return [name for name in TABLES if not missing.get(name)]


def table_parts(run: RunFile, name: str, frame: int | None = None) -> Iterator[list[Column]]:
    """Yield a table in parts: profiles, bodies and contacts frame by frame, or of one. Raises IndexError outside the run."""
    if name in BY_FRAME:
        for number in [run.frame_number(frame)] if frame is not None else range(run.frame_number(-1) + 1):
            columns = _of_frame(run, name, number)
            rows = len(columns[0].values)
            yield [Column("frame", "", np.full(rows, number)), Column("time", "s", np.full(rows, run.times[number])), *columns]
    elif name == CYCLES:
        yield [Column(key, CYCLE_NAMES[key].unit.replace("1", ""), values) for key, values in run.cycles.items()]
    elif name == MAP_STATISTICS:  # of the run, then of one cycle, where it has two
        for over, cycles in (("run", None), ("cycle", 1.0))[: 1 + (len(run.cycles["cycle"]) > 1)]:
            part = run.map_statistics(cycles)
            what = np.full(len(part["map"]), over, object)
            yield [Column("over", "", what), *(Column(key, "", values) for key, values in part.items())]
    elif name == SERIES:
        first = {key: run.series[key] for key in ("time", "distance") if key in run.series}
        yield _columns(first | run.series, {}, run.units)
    else:
        states = run.state_names
        yield _columns(run.transitions(), {"from": states, "to": states, "reason": run.reason_names}, {})


def _of_frame(run: RunFile, name: str, number: int) -> list[Column]:
    if name == PROFILES:
        profiles = {key: values[number] for key, values in run.profiles.items()}
        slabs = len(profiles[POSITION])
        tall = {key: values.reshape(slabs, -1) if values.ndim > 1 else values for key, values in profiles.items()}
        return _columns({"slab": np.arange(slabs)} | tall, {}, run.units)
    names: dict[str, Sequence[str]] = {"side": SIDES}
    if name == CONTACTS:
        arrays, first = run.contacts(number), ["body", "side", "partner", POSITION]
    else:
        arrays, first = run.bodies(number), ["body", POSITION, "state", "state_reason"]
        arrays["body"] = arrays.pop("id", np.arange(len(arrays[POSITION])))
        names = {"state": run.state_names, "state_reason": run.reason_names}
        names |= {"population": run.population_names, "material": run.material_names}
    return _columns({key: arrays[key] for key in first if key in arrays} | arrays, names, run.header["units"])


def _columns(arrays: Mapping[str, np.ndarray], names: Mapping[str, Sequence[str]], units: Mapping[str, str]) -> list[Column]:
    """Return arrays as columns: themselves or their components, codes also by name; `units`: of the run, with its measures."""
    columns = []
    for name, values in arrays.items():
        unit = _UNITS.get(name) or units.get(name, "")
        unit = "" if unit == "1" else unit
        if values.ndim == 1:
            columns.append(Column(name, unit, values))
        else:
            letters = _COMPONENTS.get(values.shape[1], range(values.shape[1]))
            columns += [Column(f"{name}_{letter}", unit, values[:, i]) for i, letter in enumerate(letters)]
        if name in names:
            texts = [code_name(names[name], int(code)) for code in values]
            columns.append(Column(f"{name}_name", "", np.array(texts, dtype=object)))
    return columns
