"""Table of a study of cost, for the terminal."""

import math
from collections.abc import Mapping

from thirdbody.report.tables import table
from thirdbody.studies.cost import Row, Study, efficient, is_chaotic, merit_in_words, percent, recommended, speed_error
from thirdbody.studies.machine_info import described
from thirdbody.studies.variant_runs import LEFT_OUT
from thirdbody.system.terminal import print_line

COLUMNS = {"friction": "friction_error", "load|gap": "load_error", "position": "position_error", "turn, rad": "rotation_error",
           "labels": "label_difference", "dissipated": "dissipation_error"}  # fmt: skip
COLUMNS_OF_MEETING = {"friction": "friction_error", "its mean": "mean_friction_error", "load|gap": "load_error",
                      "mean place": "mean_position_error", "labels": "label_difference", "shares": "state_fraction_error",
                      "dissipated": "dissipation_error"}  # fmt: skip
"""Headings of the errors, and the same where bodies meet: means can be compared even where runs part."""


def print_study(built: Study) -> None:
    """Print a study: its conditions, all variants, and the recommended one."""
    report = built.machine
    print_line(f"{built.title or built.scene}: errors against {built.reference.variant.name}")
    print_line(f"reduced: {'; '.join(built.reduction) or 'nothing'}")
    print(f"budget {built.budget:.3g} s, took {built.elapsed:.3g} s")
    print(f"on {described(report)}, {report['cores']} cores, one used; load before: {report['load']}")
    default = built.default
    base = default.seconds if default is not None and default.stable else math.nan
    front = efficient(built)
    rows = [(row, _mark(built, row, front)) for row in built.rows]
    columns = COLUMNS_OF_MEETING if built.scatter else COLUMNS
    cells = [_cells(row, mark, base, columns) for row, mark in rows]
    if built.scatter:
        scatter = (_percent(built.scatter[name]) for name in columns.values())
        cells.append(("", "starts 1e-9 apart", *[""] * 4, *scatter, ""))
    table("", ("", "variant", "step", "seconds", "runs", "ratio", *columns, "residual"), cells)
    print("* on the front: no variant is closer in friction in the same or less time; d: as in the scene; r: reference, the end "
          "of the front; ~: how far the median may be off, below which times are ties; runs: how many are timed")  # fmt: skip
    print("seconds: of one core, for the integration from output to output; without start, compiling, building and outputs")
    if any(row.beside for row in built.rows):
        print("variants alternated with the scene's own, which refers their seconds to one speed of the machine")
    for words in filter(None, (scatter_words(built), speed_words(built))):
        print_line(words)
    for message, names in stopped(built).items():
        print_line(f"{'; '.join(names)}: {message}")
    print_line(f"recommended: {recommended(built)[1]}")


def scatter_words(built: Study) -> str:
    """Return in words how far runs from almost equal starts part, empty where bodies do not meet."""
    if not built.scatter:
        return ""
    names = {"friction_error": "of the friction curve", "mean_friction_error": "of its mean", "label_difference": "of the labels"}
    listed = ", ".join(f"{percent(built.scatter[name])} {words}" for name, words in names.items() if name in built.scatter)
    means = (
        "; these runs part, so mean friction and the shares of the states decide what is recommended, not curves and labels"
        if is_chaotic(built)
        else ""
    )
    return f"bodies meet: runs from starts 1e-9 apart differ by up to {listed}; smaller differences mean nothing{means}"


def speed_words(built: Study) -> str:
    """Return in words what the scene's own speed costs in accuracy, empty where it is not known."""
    speed, error = speed_error(built)
    if math.isnan(error):
        return ""
    return (
        f"speed: that of the scene costs {percent(error)} in {merit_in_words(built)}, against the same law and step at "
        f"1/{1.0 / speed:g} of it; the error of the slower variant is that difference, so it is never recommended"
    )


def stopped(built: Study) -> dict[str, list[str]]:
    """Return the names of the variants that did not finish, by their messages."""
    result: dict[str, list[str]] = {}
    for row in built.rows:
        if not row.stable:
            result.setdefault(row.message, []).append(row.variant.name)
    return result


def _mark(built: Study, row: Row, front: list[Row]) -> str:
    letters = {"*": any(row is other for other in front), "d": row is built.default, "r": row is built.reference}
    return "".join(letter for letter, applies in letters.items() if applies)


def _cells(row: Row, mark: str, base: float, columns: Mapping[str, str]) -> tuple[str, ...]:
    step = "" if row.step is None else f"{row.step:.2g}{' s' if row.integrator == 'explicit' else ''}"
    if not row.stable:  # its partial result is not compared
        what = "left out" if row.message == LEFT_OUT else "stopped" if row.cpu else "failed"
        return (mark, row.variant.name, step, what, *[""] * (len(columns) + 3))
    residual = row.outcome.residual if row.outcome is not None else None
    return (
        mark, row.variant.name, step, _time(row), str(len(row.cpu)), f"{row.seconds / base:.3g}",
        *((_plain if name == "rotation_error" else _percent)(row.errors.get(name)) for name in columns.values()),
        _plain(residual),
    )  # fmt: skip


def _time(row: Row) -> str:
    return f"{row.seconds:.3g} ~{100.0 * row.timing.relative:.0f} %"


def _percent(value: float | None) -> str:
    return "" if value is None or math.isnan(value) else "0" if value == 0.0 else f"{100.0 * value:.2g} %"


def _plain(value: float | None) -> str:
    return "" if value is None or math.isnan(value) else "0" if value == 0.0 else f"{value:.1e}"
