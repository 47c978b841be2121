"""Report of the maps of the plates in `thirdbody states`: depth, area and volume of wear, since the start and per cycle."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from thirdbody.errors import InputError
from thirdbody.report.tables import table
from thirdbody.trajectory.map_statistics import NO_MAPS
from thirdbody.units import percent, quantity_text

if TYPE_CHECKING:
    from thirdbody.trajectory.reader import Run


def map_report(run: Run, cycles: float | None) -> dict[str, list[dict[str, Any]]]:
    """Return the rows of `Run.map_statistics` by what they are of: the run, and so many cycles; one where there is a rate.

    Raises InputError for cycles without a rate, or without maps.
    """
    if cycles is not None and not run.map_units:
        raise InputError(f"{run.path}: cycles: {NO_MAPS}")
    if cycles is None and len(run.cycles["cycle"]) > 1:
        cycles = 1.0
    wanted = {"run": None} if cycles is None else {"run": None, f"{cycles:g} cycle{'s' * (cycles != 1.0)}": cycles}
    tables = {name: run.map_statistics(number) for name, number in wanted.items()} if run.map_units else {}
    return {name: [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]
            for name, columns in tables.items()}  # fmt: skip


def print_maps(report: dict[str, list[dict[str, Any]]]) -> None:
    """Print the result of `map_report`."""
    for name, rows in report.items():
        print()
        table(
            f"maps of the plates: {name}" + ("" if name == "run" else ", by the mean rate of whole cycles, without the first"),
            ["plate", "map", "mean where any", "95 % below", "largest", "area", "total"],
            [[row["plate"], row["map"], *(quantity_text(row[key], row["unit"]) for key in ("mean", "percentile_95", "largest")),
              percent(row["area_fraction"]), _total(row["total"], row["total_unit"])] for row in rows],
        )  # fmt: skip
    if report:
        print()


def _total(value: float, unit: str) -> str:
    return f"{1e18 * value:.3g} um3" if unit == "m3" else quantity_text(value, unit)
