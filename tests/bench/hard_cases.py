"""Table of the hard cases: what must hold in each of them, and how far the time step can be raised above its bound.

    python tests/bench/hard_cases.py [CASE ...] [--quick] [-o scenes/hard_cases.png]

`--quick` runs one level with automatic steps only. A case that fails ends with exit code 1; `tests/hard` has the cases."""

import argparse
import math
import sys
from collections.abc import Sequence
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from thirdbody.engine.units import EXPLICIT, warm_up
from thirdbody.palette import INK, LINE_COLORS, SOFT_INK
from thirdbody.plot.figures import save
from thirdbody.report.tables import table

sys.path.insert(0, str(Path(__file__).parents[1]))
from hard.cases import CASES, MAX_FACTOR, MIN_FACTOR, Row, run_case  # noqa: E402

LEVELS = {  # colour and marker, distinguishable without colours too
    "coulomb": (LINE_COLORS["orange"], "s"),
    "mindlin": (LINE_COLORS["blue"], "o"),
    "mdr": (LINE_COLORS["green"], "^"),
    "exact": (LINE_COLORS["purple"], "D"),
}
BROKEN = LINE_COLORS["vermilion"]
NOTHING = 1e-16  # smaller residuals are drawn at this value: free rotation has none
TICKS = (1, 1.5, 2, 3, 5, 7, 10, 15)


def print_rows(rows: Sequence[Row]) -> None:
    cells = [
        [
            row.case, row.integrator, row.level, "" if row.factor is None else f"{row.factor:g} x",
            "" if math.isnan(row.residual) else f"{row.residual:.1e}", f"{row.seconds:.1f} s",
            f"FAILS: {row.faults[0]}" if row.faults else "holds",
        ]
        for row in rows
    ]  # fmt: skip
    table("", ("case", "integrator", "level", "largest step", "residual", "time", "verdict"), cells)
    sound = sum(not row.faults for row in rows)
    print(f"{sound} of {len(rows)} hold; largest step: over the automatic one, up to which every invariant holds")


def picture(rows: Sequence[Row]) -> Figure:
    cases = list(dict.fromkeys(row.case for row in rows))
    figure = Figure(figsize=(7.2, 1.45 + 0.25 * max(len(cases), 3)), layout="constrained")
    energy, step = figure.subplots(1, 2, sharey=True, gridspec_kw={"width_ratios": (1.15, 1.0)})
    energy.set_yticks(range(len(cases)), [case.replace("_", " ") for case in cases], fontsize=8, color=INK)
    energy.set_ylim(len(cases) - 0.4, -0.6)
    for axes in (energy, step):
        axes.set_xscale("log")
        axes.tick_params(labelsize=8, length=0, axis="y")
        axes.tick_params(labelsize=8, axis="x")
        axes.spines[["top", "right", "left"]].set_visible(False)
        axes.grid(True, axis="x", which="major", color="#D5D9DE", linewidth=0.6)
        for k in range(0, len(cases), 2):
            axes.axhspan(k - 0.5, k + 0.5, color="#F3F4F6", zorder=0, linewidth=0)
        axes.set_axisbelow(True)
    _draw_energies(energy, rows, cases)
    _draw_steps(step, rows, cases)
    levels = [(level, *style) for level, style in LEVELS.items() if level in {row.level for row in rows}]
    marks = [Line2D([], [], color=c, marker=m, linestyle="", markersize=5, label=level) for level, c, m in levels]
    for label, face in (("explicit", SOFT_INK), ("implicit", "white")):
        marks.append(Line2D([], [], color=SOFT_INK, marker="o", markerfacecolor=face, linestyle="", markersize=5, label=label))
    if any(row.faults for row in rows):
        marks.append(Line2D([], [], color=BROKEN, marker="x", linestyle="", markersize=7, markeredgewidth=1.6, label="fails"))
    figure.legend(handles=marks, loc="outside upper center", ncols=len(marks), fontsize=8, frameon=False, handletextpad=0.2,
                  columnspacing=1.2)  # fmt: skip
    return figure


def _height_of(row: Row, cases: list[str]) -> float:
    return cases.index(row.case) + 0.17 * (list(LEVELS).index(row.level) - 1.5)


def _draw_energies(axes: Axes, rows: Sequence[Row], cases: list[str]) -> None:
    for row in rows:
        color, marker = LEVELS[row.level]
        filled = color if row.integrator == "explicit" else "white"
        known = math.isfinite(row.residual)  # cases that are only refused, or with prescribed motion, have none
        residual = max(row.residual, NOTHING) if known else NOTHING
        axes.plot(residual, _height_of(row, cases), marker if known else "", color=color, markerfacecolor=filled, markersize=4.5,
                  markeredgewidth=1.0, clip_on=False, zorder=3)  # fmt: skip
        if row.faults:
            axes.plot(residual, _height_of(row, cases), "x", color=BROKEN, markersize=9, markeredgewidth=1.6, zorder=4)
    axes.set_xlim(0.5 * NOTHING, 1.0)
    axes.set_xlabel("energy residual with the automatic step", fontsize=8.5)
    axes.axvline(0.1, color=INK, linewidth=1.0, linestyle="--")
    axes.annotate("guard", (0.1, -0.6), xytext=(0, 2), textcoords="offset points", fontsize=7.5, color=INK, ha="center")


def _draw_steps(axes: Axes, rows: Sequence[Row], cases: list[str]) -> None:
    axes.axvspan(MIN_FACTOR, MAX_FACTOR, color=LINE_COLORS["sky"], alpha=0.18, linewidth=0, zorder=1)
    for row in rows:
        if row.factor is None:
            continue
        color, marker = LEVELS[row.level]
        y = _height_of(row, cases)
        if row.factor > 1.0:
            axes.plot([1.0, row.factor], [y, y], color=color, linewidth=1.0, zorder=2)
        axes.plot(max(row.factor, 1.0), y, marker, color=color, markersize=4.5, zorder=3)
    for k, case in enumerate(cases):
        if all(row.factor is None for row in rows if row.case == case):
            axes.annotate("no limit sought", (1.03, k), fontsize=7.5, color=SOFT_INK, va="center")
    axes.set_xlim(0.95, 17.0)
    axes.set_xlabel("largest stable step over the automatic one", fontsize=8.5)
    axes.set_xticks(TICKS, [f"{tick:g}" for tick in TICKS])
    axes.minorticks_off()


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("cases", nargs="*", metavar="CASE", choices=[[], *CASES], help="cases [all]")
    parser.add_argument("--out", "-o", type=Path, help="picture of the table: .png, .pdf or .svg")
    parser.add_argument("--quick", action="store_true", help="one law level, automatic time steps only")
    options = parser.parse_args()
    warm_up(EXPLICIT)
    rows = []
    for name in options.cases or CASES:
        for setting in CASES[name].settings(options.quick):
            print(f"{name}, {setting.integrator}, {setting.level}", file=sys.stderr, flush=True)
            rows.append(run_case(CASES[name], setting, sweep=not options.quick))
    print_rows(rows)
    if options.out is not None:
        save(picture(rows), options.out)
    return int(any(row.faults for row in rows))


if __name__ == "__main__":
    sys.exit(main())
