"""Table of a study of cost, for the terminal."""

import math

from thirdbody.report.tables import table
from thirdbody.studies.cost import Row, Study, efficient, figure_of_merit, percent, possible, recommended, speed_error
from thirdbody.studies.variant_runs import LEFT_OUT
from thirdbody.system.terminal import print_line

HEADINGS = ("", "variant", "step", "seconds", "runs", "ratio", "friction", "load|gap", "position", "turn, rad", "labels",
            "dissipated", "residual")  # fmt: skip


def print_study(built: Study) -> None:
    """Print a study: its conditions, all variants, and the recommended one."""
    report = built.machine
    print_line(f"{built.title or built.scene}: errors against {built.reference.variant.name}")
    print_line(f"reduced: {'; '.join(built.reduction) or 'nothing'}")
    if built.alone:
        print("no two bodies of this copy meet: contact between bodies costs and changes nothing here; variants marked i compute "
              'the whole scene as fast only with contact.debris_contact = "none"')  # fmt: skip
    print(f"budget {built.budget:.3g} s, took {built.elapsed:.3g} s")
    print(f"on {report['cpu']}, {report['cores']} cores, one used; load before: {report['load']}")
    default = built.default
    base = default.seconds if default is not None and default.stable else math.nan
    front = efficient(built)
    rows = [(row, _mark(built, row, front)) for row in built.rows if row.variant.axis != "verify"]
    table("", HEADINGS, [_cells(row, mark, base) for row, mark in rows])
    print("* on the front: no variant is closer in friction in the same or less time; d: as in the scene; r: reference, the end "
          "of the front; ~: how far the median may be off, below which times are ties; runs: how many are timed")  # fmt: skip
    print("seconds: of one core, for the integration from output to output; without start, compiling, building and outputs")
    if any(row.beside for row in built.rows):
        print("variants alternated with the scene's own, which refers their seconds to one speed of the machine")
    if words := speed_words(built):
        print(words)
    for message, names in stopped(built).items():
        print_line(f"{'; '.join(names)}: {message}")
    print_line(f"recommended: {recommended(built)[1]}")


def speed_words(built: Study) -> str:
    """Return in words what the scene's own speed costs in accuracy, empty where it is not known."""
    speed, error = speed_error(built)
    if math.isnan(error):
        return ""
    what = "friction" if figure_of_merit(built) == "friction_error" else "load or gap"
    return (
        f"speed: that of the scene costs {percent(error)} in {what}, against the same law and step at 1/{1.0 / speed:g} of it; "
        "the error of the slower variant is that difference, so it is never recommended"
    )


def stopped(built: Study) -> dict[str, list[str]]:
    """Return the names of the variants that did not finish, by their messages."""
    result: dict[str, list[str]] = {}
    for row in built.rows:
        if not row.stable:
            result.setdefault(row.message, []).append(row.variant.name)
    return result


def _mark(built: Study, row: Row, front: list[Row]) -> str:
    letters = {"*": any(row is other for other in front), "d": row is built.default, "r": row is built.reference,
               "i": not possible(built, row)}  # fmt: skip
    return "".join(letter for letter, applies in letters.items() if applies)


def _cells(row: Row, mark: str, base: float) -> tuple[str, ...]:
    step = "" if row.step is None else f"{row.step:.2g}{' s' if row.integrator == 'explicit' else ''}"
    if not row.stable:  # its partial result is not compared
        what = "left out" if row.message == LEFT_OUT else "stopped" if row.cpu else "failed"
        return (mark, row.variant.name, step, what, *[""] * 9)
    result = row.errors
    residual = row.outcome.residual if row.outcome is not None else None
    return (
        mark, row.variant.name, step, _time(row), str(len(row.cpu)), f"{row.seconds / base:.3g}",
        *(_percent(result.get(name)) for name in ("friction_error", "load_error", "position_error")),
        _plain(result.get("rotation_error")), _percent(result.get("label_difference")), _percent(result.get("dissipation_error")),
        _plain(residual),
    )  # fmt: skip


def _time(row: Row) -> str:
    return f"{row.seconds:.3g} ~{100.0 * row.timing.relative:.0f} %"


def _percent(value: float | None) -> str:
    return "" if value is None or math.isnan(value) else "0" if value == 0.0 else f"{100.0 * value:.2g} %"


def _plain(value: float | None) -> str:
    return "" if value is None or math.isnan(value) else "0" if value == 0.0 else f"{value:.1e}"
