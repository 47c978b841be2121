"""Command `thirdbody hard`: runs the robustness cases, prints their table, draws it."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from thirdbody.errors import GuardStop
from thirdbody.report.tables import print_json, table
from thirdbody.studies.robustness.time_steps import MAX_FACTOR, MIN_FACTOR, Row, chosen, rows
from thirdbody.system.terminal import print_line


def hard_command(names: Sequence[str], out: Path | None, json: bool, quick: bool, log: Any) -> None:
    """Run `thirdbody hard`. Raises UsageError for an unknown name or picture format, GuardStop if a case fails, OutputError."""
    cases = chosen(names)
    if out is not None:
        from thirdbody.studies.robustness.plot import check_format

        check_format(out)  # before the work
    from thirdbody.engine.precompile import EXPLICIT, warm_up

    warm_up(EXPLICIT)
    result = list(rows(cases, quick, sweep=not quick, log=log))
    if json:
        print_json([as_json(row) for row in result])
    else:
        print_rows(result)
    if out is not None:
        from thirdbody.studies.robustness.plot import draw_stability

        draw_stability([as_json(row) for row in result], out, (MIN_FACTOR, MAX_FACTOR))
        log(f"{out}")
    failed = [row for row in result if not row.passed]
    if failed:
        for row in failed:
            print_line(f"{row.case}, {row.integrator}, {row.level}: {'; '.join(_why(row))}", err=True)
        raise GuardStop(f"{len(failed)} of {len(result)} hard cases fail")


def print_rows(result: Sequence[Row]) -> None:
    """Print the table, one row per case and integrator with its levels in one line, and the verdicts."""
    cells = [
        [row.case, row.integrator, row.level, _factor(row), _residual(row), f"{row.seconds:.1f} s", _verdict(row)]
        for row in result
    ]
    table("", ("case", "integrator", "level", "largest step", "residual", "time", "verdict"), cells)
    plate_table = sum(row.passed for row in result)
    print(f"{plate_table} of {len(result)} hold; largest step: over the automatic one, up to which every invariant holds")


def as_json(row: Row) -> dict[str, Any]:
    """Return a row for `--json` and the picture."""
    return vars(row) | {"holds": row.passed}


def _factor(row: Row) -> str:
    return "" if row.factor is None else f"{row.factor:g} x"


def _residual(row: Row) -> str:
    return "" if math.isnan(row.residual) else f"{row.residual:.1e}"


def _verdict(row: Row) -> str:
    return "holds" if row.passed else f"FAILS: {_why(row)[0]}"


def _why(row: Row) -> list[str]:
    if row.broken or row.factor is None:
        return list(row.broken)
    return [
        f"the largest stable step is {row.factor:g} times the automatic one, not {MIN_FACTOR:g} to {MAX_FACTOR:g}; {row.beyond}"
    ]
