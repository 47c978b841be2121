"""Numbers of the maps of the plates: depth, area and volume of wear and the like, of a run and of cycles by its rate."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from thirdbody.errors import InputError
from thirdbody.trajectory.names import MAP_STATISTICS
from thirdbody.trajectory.plate_maps import PLATES

if TYPE_CHECKING:
    from thirdbody.trajectory.reader import Run

NO_MAPS = "this run has no maps; [measures] with cell and a measure such as wear makes some"

TOTALS = {"m": "m3", "J/m2": "J"}
"""Units of the integral of a map over the plate by the unit of the map; of others with `m2`."""

PERCENTILE, MAX_CYCLES = 95.0, 1e12


def maps_of_cycles(run: Run, plate: str, cycles: float) -> dict[str, np.ndarray]:
    """Return the maps (n_y, n_x) of so many cycles by name, at the mean rate of the whole cycles without the first one.

    Raises InputError with fewer than two whole cycles, or for a number that cannot be.
    """
    if not 0.0 < cycles < MAX_CYCLES:
        raise InputError(f"cycles: {cycles:g} must be greater than 0 and below {MAX_CYCLES:g}")
    ends = run.cycles["end_time"]
    if len(ends) < 2:
        raise InputError(f"cycles: the run has {len(ends)} whole cycles; a rate needs two, of which the first does not count")
    before, after = (run.maps(plate, int(np.argmin(np.abs(run.times - end)))) for end in (ends[0], ends[-1]))
    return {name: cycles / (len(ends) - 1) * (after[name] - before[name]) for name in after}


def map_statistics(run: Run, cycles: float | None, frame: int) -> dict[str, np.ndarray]:
    """Return the statistics of the maps by the names of MAP_STATISTICS, one row per plate and map (`Run.map_statistics`)."""
    size, rows = run.header["domain"]["size"] if run.map_units else (0.0, 0.0), list[tuple[Any, ...]]()
    for plate in PLATES if run.map_units else ():
        maps = run.maps(plate, frame) if cycles is None else maps_of_cycles(run, plate, cycles)
        for name, values in maps.items():
            unit, covered = run.map_units[name], values[values > 0.0]
            numbers = (covered.mean(), np.percentile(covered, PERCENTILE), covered.max()) if len(covered) else (0.0, 0.0, 0.0)
            total = float(values.mean()) * size[0] * size[1]
            rows.append((plate, name, *numbers, unit, len(covered) / values.size, total, TOTALS.get(unit, f"{unit} m2")))
    columns = zip(*rows, strict=True) if rows else ((),) * len(MAP_STATISTICS)
    return {name: np.array(values, object if isinstance((*values, 0)[0], str) else float)
            for name, values in zip(MAP_STATISTICS, columns, strict=True)}  # fmt: skip
