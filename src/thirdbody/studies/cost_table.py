"""The table of a study of cost, for the terminal."""

from __future__ import annotations

import math

from thirdbody.report import table

from .cost import Row, Study, efficient, recommended

HEADINGS = ("", "rung", "step", "seconds", "ratio", "friction", "load|gap", "position", "turn, rad", "labels", "dissipated",
            "residual")  # fmt: skip


def print_study(made: Study) -> None:
    """Print a study: what it was made of, all rungs, and the one to take."""
    told = made.machine
    print(f"{made.title or made.scene}: errors against {made.reference.rung.name}")
    print(f"reduced: {'; '.join(made.reduction) or 'nothing'}")
    print(f"on {told['cpu']}, {told['cores']} cores, one used; load before: {told['load']}")
    default = made.default
    base = default.seconds if default is not None and default.stable else math.nan
    front = efficient(made)
    marks = {id(row): "*" for row in front} | ({id(default): "*d" if default in front else " d"} if default else {})
    marks[id(made.reference)] = " r"
    table("", HEADINGS, [_cells(row, marks.get(id(row), ""), base) for row in made.rows if row.rung.axis != "verify"])
    print("* on the front: no rung is both faster and closer in friction; d: as the scene asks; r: reference; "
          "~: half the range of the repeats")
    print("seconds: of one core, for the integration from output to output; without start, compiling, building and outputs")
    if any(row.beside for row in made.rows):
        print("short rungs took turns with the scene's own, by which their seconds are put to one pace of the machine")
    for row in made.rows:
        if not row.stable:
            print(f"{row.rung.name}: {row.message}")
    print(f"recommended: {recommended(made)[1]}")


def _cells(row: Row, mark: str, base: float) -> tuple[str, ...]:
    step = "" if row.step is None else f"{row.step:.2g}{' s' if row.integrator == 'explicit' else ''}"
    if not row.cpu:
        return (mark, row.rung.name, step, "failed", *[""] * 8)
    found = row.errors
    residual = row.outcome.residual if row.outcome is not None else None
    return (
        mark, row.rung.name, step, _time(row) + ("" if row.stable else " stopped"), f"{row.seconds / base:.2f}",
        *(_share(found.get(name)) for name in ("friction_error", "load_error", "position_error")),
        _plain(found.get("rotation_error")), _share(found.get("label_difference")), _share(found.get("dissipation_error")),
        _plain(residual),
    )  # fmt: skip


def _time(row: Row) -> str:
    spread = 50.0 * (max(row.cpu) - min(row.cpu)) / row.seconds
    return f"{row.seconds:.3g} ~{spread:.0f} %"


def _share(value: float | None) -> str:
    return "" if value is None or math.isnan(value) else "0" if value == 0.0 else f"{100.0 * value:.2g} %"


def _plain(value: float | None) -> str:
    return "" if value is None or math.isnan(value) else "0" if value == 0.0 else f"{value:.1e}"
