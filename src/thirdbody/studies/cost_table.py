"""The table of a study of cost, for the terminal."""

from __future__ import annotations

import math

from thirdbody.report.tables import table
from thirdbody.studies.cost import Row, Study, efficient, possible, recommended
from thirdbody.studies.variant_runs import LEFT_OUT
from thirdbody.system.terminal import say

HEADINGS = ("", "rung", "step", "seconds", "runs", "ratio", "friction", "load|gap", "position", "turn, rad", "labels",
            "dissipated", "residual")  # fmt: skip


def print_study(made: Study) -> None:
    """Print a study: what it was made of, all rungs, and the one to take."""
    told = made.machine
    say(f"{made.title or made.scene}: errors against {made.reference.rung.name}")
    say(f"reduced: {'; '.join(made.reduction) or 'nothing'}")
    if made.alone:
        print("no two bodies of this copy meet: contact between bodies costs and changes nothing here; rungs marked i compute "
              'the whole scene only with contact.debris_contact = "none"')  # fmt: skip
    print(f"budget {made.budget:.3g} s, took {made.took:.3g} s")
    print(f"on {told['cpu']}, {told['cores']} cores, one used; load before: {told['load']}")
    default = made.default
    base = default.seconds if default is not None and default.stable else math.nan
    front = efficient(made)
    rows = [(row, _mark(made, row, front)) for row in made.rows if row.rung.axis != "verify"]
    table("", HEADINGS, [_cells(row, mark, base) for row, mark in rows])
    print("* on the front: no rung is closer in friction in the same or less time; d: as the scene asks; r: reference, the end "
          "of the front; ~: how far the median may be off, below which times are ties; runs: how many are timed")  # fmt: skip
    print("seconds: of one core, for the integration from output to output; without start, compiling, building and outputs")
    if any(row.beside for row in made.rows):
        print("rungs took turns with the scene's own, by which their seconds are put to one pace of the machine")
    for message, names in stopped(made).items():
        say(f"{'; '.join(names)}: {message}")
    say(f"recommended: {recommended(made)[1]}")


def stopped(made: Study) -> dict[str, list[str]]:
    """Names of the rungs that did not come to their end, by what they said."""
    found: dict[str, list[str]] = {}
    for row in made.rows:
        if not row.stable:
            found.setdefault(row.message, []).append(row.rung.name)
    return found


def _mark(made: Study, row: Row, front: list[Row]) -> str:
    letters = {"*": any(row is other for other in front), "d": row is made.default, "r": row is made.reference,
               "i": not possible(made, row)}  # fmt: skip
    return "".join(letter for letter, holds in letters.items() if holds)


def _cells(row: Row, mark: str, base: float) -> tuple[str, ...]:
    step = "" if row.step is None else f"{row.step:.2g}{' s' if row.integrator == 'explicit' else ''}"
    if not row.stable:  # what it computed until then is compared with nothing
        what = "left out" if row.message == LEFT_OUT else "stopped" if row.cpu else "failed"
        return (mark, row.rung.name, step, what, *[""] * 9)
    found = row.errors
    residual = row.outcome.residual if row.outcome is not None else None
    return (
        mark, row.rung.name, step, _time(row), str(len(row.cpu)), f"{row.seconds / base:.3g}",
        *(_share(found.get(name)) for name in ("friction_error", "load_error", "position_error")),
        _plain(found.get("rotation_error")), _share(found.get("label_difference")), _share(found.get("dissipation_error")),
        _plain(residual),
    )  # fmt: skip


def _time(row: Row) -> str:
    return f"{row.seconds:.3g} ~{100.0 * row.timing.relative:.0f} %"


def _share(value: float | None) -> str:
    return "" if value is None or math.isnan(value) else "0" if value == 0.0 else f"{100.0 * value:.2g} %"


def _plain(value: float | None) -> str:
    return "" if value is None or math.isnan(value) else "0" if value == 0.0 else f"{value:.1e}"
