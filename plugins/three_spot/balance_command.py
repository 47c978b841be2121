"""Command `thirdbody balance FILE.toml`: one particle, pressed and dragged, as a table, as JSON, as a picture.

The picture has normal forces, utilisation of friction, tilt and states over the drag.
"""

import sys
from itertools import groupby
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from thirdbody.plugin import OutputError, UsageError, pretty

from .balance import Result, balance

ROWS = 12  # points in the table in addition to every change of a label or of a spot

FORMATS = (".png", ".pdf", ".svg")

LABELS = {"free": "#8E939A", "sticking": "#4C78A8", "sliding": "#F58518", "rolling": "#54A24B"}  # as in every picture
SPOTS = {"open": "#FFFFFF", "stick": "#4C78A8", "partial": "#9ECAE9", "slide": "#F58518"}
# Okabe and Ito: distinguishable with every kind of colour vision
LINES = ("#000000", "#D55E00", "#0072B2", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#F0E442")
PREFIXES = ((1.0, ""), (1e-3, "m"), (1e-6, "\N{MICRO SIGN}"), (1e-9, "n"), (1e-12, "p"))


def balance_command(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="balance file (TOML)")],
    json: Annotated[bool, typer.Option("--json", help="print JSON")] = False,
    out: Annotated[Path | None, typer.Option("--out", "-o", help="picture file: forces, tilt and states over the drag")] = None,
    level: Annotated[str | None, typer.Option("--level", help="exact | mdr | mindlin | coulomb [exact]")] = None,
) -> None:
    """Balance of a single particle between two bodies: forces, tilt, partial slip and label along a drag."""
    if out is not None:
        check_format(out)  # before the work
    result = balance(file, level)
    if json:
        print(result.to_json())
    else:
        for line in result.warnings:
            print(f"warning: {line}", file=sys.stderr)
        print("\n".join(table(result)))
    if out is not None:
        plot(result, out, file.stem)
        print(out, file=sys.stderr if json else sys.stdout)


def table(result: Result) -> list[str]:
    """Return lines of text: the forecast, then the points where something changes and some in between."""
    f = result.forecast
    interval = "never slides" if f.t_min is None else f"slides for mu from {max(f.t_min, 0.0):.4g} to {f.t_max:.4g}"
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


# -- picture


def plot(result: Result, path: Path, title: str = "") -> None:
    """Write the picture in the format of the suffix.

    Raises UsageError for an unknown one, or without any point; OutputError if the file cannot be written.
    """
    from matplotlib.figure import Figure

    if not result.points:
        raise UsageError(f"nothing to draw: {result.stopped.message if result.stopped else 'no point'}")
    check_format(path)
    figure = Figure(figsize=(8.0, 9.0), layout="constrained")
    top, middle, tilt, bar = figure.subplots(4, 1, sharex=True, height_ratios=(3.0, 3.0, 2.0, 1.6))
    drag, unit = scaled(np.array([p.drag for p in result.points]))
    style: dict[str, Any] = {"linewidth": 1.6} if len(drag) > 1 else {"marker": "o"}
    _forces(top, result, drag, style)
    _friction(middle, result, drag, style)
    _tilt(tilt, result, drag, style)
    _states(bar, result, drag)
    bar.set_xlabel(f"drag of the upper body ({unit}m)")
    for axes in (top, middle, tilt):
        axes.grid(alpha=0.25, linewidth=0.6)
        axes.margins(x=0.0)
        axes.spines[["top", "right"]].set_visible(False)
    figure.suptitle(f"{title}, level {result.level}" if title else f"level {result.level}")
    try:
        figure.savefig(path, dpi=150)
    except OSError as problem:
        raise OutputError(f"{path}: cannot be written ({problem.strerror})") from problem


def check_format(path: Path) -> None:
    """Raise UsageError for a picture whose suffix is not in FORMATS."""
    if path.suffix.lower() not in FORMATS:
        raise UsageError(f"{path}: a picture ends in {', '.join(FORMATS)}")


def scaled(values: np.ndarray) -> tuple[np.ndarray, str]:
    """Return the values in a unit for which the largest is 1 to 1000, and the prefix of that unit."""
    size = float(np.abs(values).max(initial=0.0))
    factor, prefix = next(((f, p) for f, p in PREFIXES if size >= f), PREFIXES[0] if size == 0.0 else PREFIXES[-1])
    return values / factor, prefix


def _loaded(result: Result) -> list[int]:
    """Return the spots that are loaded at some point; the others would be lines at zero."""
    return [k for k in range(len(result.points[0].N)) if any(p.N[k] > 0.0 for p in result.points)]


def _forces(axes: Any, result: Result, drag: np.ndarray, style: dict[str, Any]) -> None:
    forces, unit = scaled(np.array([p.N for p in result.points]))
    for number, k in enumerate(_loaded(result)):
        axes.plot(drag, forces[:, k], color=LINES[number % len(LINES)], label=f"spot {k + 1}", **style)
    axes.set_ylabel(f"normal force $N$ ({unit}N)")
    axes.set_ylim(bottom=0.0)
    axes.legend(frameon=False, ncols=4, loc="lower right", bbox_to_anchor=(1.0, 1.0), borderaxespad=0.0)


def _friction(axes: Any, result: Result, drag: np.ndarray, style: dict[str, Any]) -> None:
    """Plot T over the friction limit of the spot, signed in the plane, its magnitude in space; eta is in the margins."""
    eta = 1.0 - np.array([p.margins["friction_spots"] for p in result.points])
    eta[np.array([p.N for p in result.points]) <= 0.0] = np.nan
    if result.planar:
        eta = eta * np.sign(np.array([p.T for p in result.points]))
    for number, k in enumerate(_loaded(result)):
        axes.plot(drag, eta[:, k], color=LINES[number % len(LINES)], **style)
    for limit in (1.0, -1.0) if np.nanmin(eta) < 0.0 else (1.0,):
        axes.axhline(limit, color="#555555", linewidth=0.8, linestyle="--")
    axes.set_ylabel(r"utilisation  $T/(\mu\,N)$")


def _tilt(axes: Any, result: Result, drag: np.ndarray, style: dict[str, Any]) -> None:
    rotation = np.array([p.phi for p in result.points]).reshape(len(drag), -1)
    values, unit = scaled(rotation)
    names = [r"$\varphi$"] if result.planar else [rf"$\varphi_{axis}$" for axis in "xyz"]
    for k, name in enumerate(names):
        axes.plot(drag, values[:, k], color=LINES[k], label=name, **style)
    axes.set_ylabel(rf"tilt $\varphi$ ({unit}rad)" if result.planar else f"tilt ({unit}rad)")
    if len(names) > 1:
        axes.legend(frameon=False, ncols=3, loc="best")


def _states(axes: Any, result: Result, drag: np.ndarray) -> None:
    """Draw one colour bar for the label and one per loaded spot."""
    from matplotlib.patches import Patch

    spots = _loaded(result)
    rows = [[LABELS[p.label] for p in result.points], *([SPOTS[p.spots[k]] for p in result.points] for k in spots)]
    width = drag[1] - drag[0] if len(drag) > 1 else 1.0
    for y, colors in enumerate(rows):
        start = 0
        for color, equal in groupby(colors):
            count = len(list(equal))
            axes.barh(y, count * width, left=drag[start] - 0.5 * width, color=color, height=0.8)
            start += count
    axes.set_yticks(range(len(rows)), ["particle", *(f"spot {k + 1}" for k in spots)])
    axes.invert_yaxis()
    axes.spines[["top", "right", "left"]].set_visible(False)
    axes.tick_params(left=False)
    if len(drag) > 1:
        axes.set_xlim(drag[0], drag[-1])
    present = {p.label for p in result.points}, {s for p in result.points for s in p.spots}
    patches = [Patch(color=c, label=f"particle {n}") for n, c in LABELS.items() if n in present[0]]
    patches += [Patch(facecolor=c, edgecolor="#999999", label=f"spot: {n}") for n, c in SPOTS.items() if n in present[1]]
    axes.legend(handles=patches, frameon=False, ncols=4, loc="upper center", bbox_to_anchor=(0.5, -0.45), columnspacing=1.2)
