"""Command `thirdbody balance FILE.toml`: one particle, pressed and dragged, as a table, as JSON, as a plot."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from thirdbody.plugin import pretty

if TYPE_CHECKING:
    from .balance import Result

ROWS = 12
"""Points in the table in addition to every change of a label or of a spot."""


def balance_command(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="balance file (TOML)")],
    json: Annotated[bool, typer.Option("--json", help="print JSON")] = False,
    out: Annotated[Path | None, typer.Option("--out", "-o", help="picture file: forces, tilt and states over the drag")] = None,
    level: Annotated[str | None, typer.Option("--level", help="exact | mdr | mindlin | coulomb [exact]")] = None,
) -> None:
    """Balance of a single particle between two bodies: forces, tilt, partial slip and label along a drag."""
    from .balance import balance

    if out is not None:
        from .balance_plot import check_format

        check_format(out)  # before the work
    result = balance(file, level)
    if json:
        print(result.to_json())
    else:
        for line in result.warnings:
            print(f"warning: {line}", file=sys.stderr)
        print("\n".join(table(result)))
    if out is not None:
        from .balance_plot import plot

        plot(result, out, file.stem)
        print(out, file=sys.stderr if json else sys.stdout)


def table(result: Result) -> list[str]:
    """Return lines of text: the forecast, then the points where something changes and some in between."""
    f = result.forecast
    interval = "never slides" if f.t_min is None else f"slides for mu from {f.t_min:.4g} to {f.t_max:.4g}"
    required = "-" if f.mu_required is None else f"{f.mu_required:.4g}"
    lines = [f"forecast: sticks for mu from {required}, {interval}; possible: {', '.join(f.possible) or 'none'}"]
    count = len(result.points[0].N) if result.points else 0
    heads = ["drag", "indentation", *(f"N{k + 1}" for k in range(count)), "w", "spots", "label", "reason"]
    rows = [heads]
    for k in chosen(result):
        p = result.points[k]
        forces = [pretty(n, "force") for n in p.N]
        lengths = [pretty(x, "length") for x in (p.drag, p.indentation)]
        rows.append([*lengths, *forces, pretty(p.w, "length"), " ".join(p.spots), p.label, p.reason])
    widths = [max(len(row[c]) for row in rows) for c in range(len(heads))]
    lines += ["  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in rows]
    return lines + ([result.stopped.message] if result.stopped else [])


def chosen(result: Result) -> list[int]:
    """Return the indices of the points in the table."""
    points, last = result.points, len(result.points) - 1
    saved = {round(k * last / ROWS) for k in range(ROWS + 1)} if points else set()
    for k in range(1, len(points)):
        if (points[k].label, points[k].spots) != (points[k - 1].label, points[k - 1].spots):
            saved.add(k)
    return sorted(saved)
