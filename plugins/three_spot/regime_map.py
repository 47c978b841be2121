"""The paper's Fig. 2 and a map of the regimes of a three-spot particle, over friction and geometry: numbers and picture.

Weightless, equal friction on both sides, spots 2 and 3 at -+L around the middle, drag toward -x. Three regimes (E. Willert's Eqs.
19 and 20 with free tilt):

    sliding   t_min <= mu <= t_max: it sticks until T = mu N, then slides on both sides
    sticking  mu > t_max but mu >= mu_required: it sticks at rest; dragged on, a spot lifts off at T = t_max N and it tips
    rolling   mu < mu_required = max(t_min, -t_max, 0): friction cannot hold it at all
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .balance import Result, balance
from .balance_command import LABELS as COLORS

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Array = NDArray[np.float64]

REGIMES = ("rolling", "sticking", "sliding")
WORDS = {"rolling": "rolls", "sticking": "sticks at rest, tips when dragged", "sliding": "sticks, then slides"}
LINES = ((r"$t_\mathrm{max} = (x_1 - x_2)/h$", "-"), (r"$t_\mathrm{min} = (x_1 - x_3)/h$", "--"), (r"$-t_\mathrm{max}$", ":"))
DOTS = 160  # per inch
HATCHES = {"rolling": "", "sticking": "....", "sliding": "////"}  # the regimes remain distinguishable in black and white print
MARKERS = {"rolling": "o", "sticking": "s", "sliding": "D"}

LEVELS = (-4.0, -2.0, -1.0, -0.5, 0.0, 0.25, 0.5, 1.0, 2.0, 4.0, 8.0)  # of zeta_3
N_2_RANGE = (0.02, 0.98)  # n_2: zeta_3 is infinite at 1
ZETA_2 = (0.0, 4.0)
MU = 1.0  # largest on the map, or the half width if that is more
GRID, STATIONS = 401, 9  # points of curves and areas along an axis; values along an axis in JSON
INK, PALE = "#222222", 0.55  # fraction of white in the areas, so that lines and text on them are legible


HEIGHT, RADIUS = 4.0, 2.0  # of a computed particle [um]
POSITIONS = (-1.0, -0.75, -0.4, -0.1, 0.15, 0.4, 0.7, 0.95, 1.25)
FRICTIONS = (0.12, 0.35, 0.6, 0.85)
STEPS = 60


class MapPoint(NamedTuple):
    """A computed particle on the panel of regimes: x_1/h, friction, state."""

    x: float
    y: float
    state: str


def computed_points(half_width: float) -> tuple[MapPoint, ...]:
    """Return particles with lower spots at -+ `half_width` (over h), solved with partial slip; undecided ones are omitted."""
    result = [(x, mu, _regime(_dragged(x, half_width, mu))) for x in POSITIONS for mu in FRICTIONS]
    return tuple(MapPoint(x, mu, state) for x, mu, state in result if state is not None)


def _dragged(x_1: float, half_width: float, mu: float) -> Result:
    """Return the particle of the map under a load, dragged well beyond the critical displacement of its spots."""
    solid, size = {"shear_modulus": "80 GPa", "poisson_ratio": 0.3}, f"{RADIUS} um"
    spots = [
        {"side": side, "x": f"{x * HEIGHT} um", "z": f"{z * HEIGHT} um", "radius": size}
        for side, x, z in (("upper", x_1, 0.5), ("lower", -half_width, -0.5), ("lower", half_width, -0.5))
    ]
    return balance({
        "balance": 1, "materials": {"upper": solid, "lower": solid, "particle": solid}, "friction": {"upper": mu, "lower": mu},
        "particle": {"weight": "0 N", "spots": spots}, "path": {"load": "0.1 mN", "drag": f"{60.0 * mu} nm", "steps": STEPS},
    })  # fmt: skip


def _regime(result: Result) -> str | None:
    """Rolling if it is not held even at rest, sliding if it ends so, sticking if it tips during the drag; None if undecided. It
    tips when a spot lifts off: from then on two spots carry it."""
    if result.stopped is not None and result.stopped.label != "rolling":
        return None
    if not result.points or result.points[0].label == "rolling":
        return "rolling"
    last = result.points[-1]
    if result.stopped is None and last.label == "sliding":
        return "sliding"
    return "sticking" if result.stopped is not None or last.label == "rolling" or "open" in last.spots else None


def map_numbers(big_h: float, half_width: float) -> dict[str, Any]:
    """Return the values of the map at `STATIONS` per axis, for JSON. zeta_3[zeta_2][n_2], and the limits of mu over
    x_1/h."""
    n_2, zeta_2 = np.linspace(0.1, 0.9, STATIONS), np.linspace(*ZETA_2, STATIONS)
    positions = np.linspace(*_position_range(half_width), STATIONS)
    zeta_3 = third_spot_position(n_2, zeta_2[:, None], big_h)
    limits = zip(("t_min", "t_max", "mu_required"), _limits(positions, half_width).tolist(), strict=True)
    return {
        "fig2": {"H": big_h, "n_2": n_2.tolist(), "zeta_2": zeta_2.tolist(), "zeta_3": zeta_3.tolist()},
        "regimes": {"half_width": half_width, "x_1": positions.tolist(), **dict(limits)},
    }


def draw_map(path: Path, big_h: float = 1.0, half_width: float = 0.5, points: Sequence[MapPoint] = ()) -> None:
    """Write both panels to `path`, in the format of its suffix. Raises OSError, and ValueError for an unknown format."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10.4, 5.4), layout="constrained")
    left, right = figure.subplots(1, 2)
    _draw_fig2(left, big_h)
    _draw_regimes(right, half_width)
    for x, mu, state in points:
        right.plot(x, mu, MARKERS[state], color=COLORS[state], markeredgecolor=INK, markersize=8, zorder=5)
    entries = _legend_entries({point.state for point in points})
    figure.legend(handles=entries, loc="outside lower center", ncols=3, frameon=False, fontsize=9.5, handlelength=2.4,
                  columnspacing=2.5)  # fmt: skip
    figure.savefig(path, dpi=DOTS)


def _position_range(half_width: float) -> tuple[float, float]:
    """Range of x_1/h that contains both ends of every regime."""
    top = max(MU, half_width)
    return -half_width - 0.6 * top, half_width + 1.1 * top


def _limits(positions: Array, half_width: float) -> Array:
    """Return t_min, t_max, mu_required (3, n) of upper spots at x_1/h (n,)."""
    low, high = positions - half_width, positions + half_width
    return np.array([low, high, np.maximum(np.maximum(low, -high), 0.0)])


def third_spot_position(n_2: Any, zeta_2: Any, big_h: float) -> Any:
    """zeta_3 = x_3/x_1 at which the particle can slide (Fig. 2): (1 + n_2 zeta_2 - H)/(1 - n_2), of numbers or arrays. n_2 =
    N_2/N_1, zeta_2 = -x_2/x_1, H = mu h/x_1; weightless, equal friction."""
    return (1.0 + n_2 * zeta_2 - big_h) / (1.0 - n_2)


def _draw_fig2(axes: Axes, big_h: float) -> None:
    n_2, zeta_2 = np.linspace(*N_2_RANGE, GRID), np.linspace(*ZETA_2, GRID)
    values = third_spot_position(n_2, zeta_2[:, None], big_h)
    for level in LEVELS:
        if values.min() < level < values.max():
            line = axes.contour(n_2, zeta_2, values, [level], colors=INK, linewidths=2.0 if level == 0.0 else 1.1)
            axes.clabel(line, fmt="%g", fontsize=9, manual=_label_positions(level, big_h))
    if not any(values.min() < level < values.max() for level in LEVELS):
        note = f"$\\zeta_3$ is nowhere in this panel\nbetween {LEVELS[0]:g} and {LEVELS[-1]:g}"
        axes.text(0.5, 0.5, note, transform=axes.transAxes, ha="center", va="center", color=INK)
    axes.set_xlabel("share of the load on spot 2,  $n_2 = N_2/N_1$")
    axes.set_ylabel(r"place of spot 2,  $\zeta_2 = -x_2/x_1$")
    axes.set_title(rf"place of spot 3, $\zeta_3 = x_3/x_1$, that lets it slide at $H = \mu h/x_1 = {big_h:g}$", fontsize=10)
    axes.set_xlim(0.0, 1.0)
    axes.set_ylim(*ZETA_2)


def _label_positions(level: float, big_h: float) -> list[tuple[float, float]]:
    """Intersections of a contour with the panel's rising diagonal, or else the falling one, for labels inside."""
    n_2 = np.linspace(0.05, 0.95, GRID)
    for zeta_2 in (ZETA_2[1] * n_2, ZETA_2[1] * (1.0 - n_2)):
        values = third_spot_position(n_2, zeta_2, big_h)
        crossed = np.flatnonzero((values[:-1] - level) * (values[1:] - level) < 0.0)
        if len(crossed):
            return [(float(n_2[k]), float(zeta_2[k])) for k in crossed]
    return []


def _draw_regimes(axes: Axes, half_width: float) -> None:
    ends, highest = _position_range(half_width), max(MU, half_width)
    kinks = [side * half_width + reach for side in (-1.0, 1.0) for reach in (-highest, 0.0, highest)]  # areas with sharp corners
    positions = np.union1d(np.linspace(*ends, GRID), [x for x in kinks if ends[0] < x < ends[1]])
    low, high, need = _limits(positions, half_width)
    areas = {
        "rolling": (np.zeros(len(positions)), need),
        "sliding": (np.maximum(low, 0.0), np.maximum(high, 0.0)),
        "sticking": (np.maximum(need, high), np.full(len(positions), highest)),
    }
    for name, (bottom, top) in areas.items():
        top = np.minimum(top, highest)
        axes.fill_between(
            positions, bottom, top, where=top >= bottom, facecolor=_pale(COLORS[name]), edgecolor=COLORS[name],
            hatch=HATCHES[name], linewidth=0.0,
        )  # fmt: skip
    for values, (_, style) in zip((high, low, -high), LINES, strict=True):
        axes.plot(positions, values, color=INK, linewidth=1.8, linestyle=style)
    # labelled above the panel: inside it a computed particle could cover the text
    for number, x in ((2, -half_width), (3, half_width)):
        axes.axvline(x, color=INK, linewidth=0.7, linestyle=(0, (1, 3)))
        axes.annotate(f"spot {number}", (x, 1.0), (0.0, 3.0), xycoords=axes.get_xaxis_transform(), textcoords="offset points",
                      ha="center", fontsize=8.5, color=INK)  # fmt: skip
    axes.set_xlim(*ends)
    axes.set_ylim(0.0, highest)
    axes.set_xlabel("place of the upper spot,  $x_1/h$")
    axes.set_ylabel(r"coefficient of friction,  $\mu$")
    axes.set_title(f"lower spots at $x/h = \\pm{half_width:g}$, drag to the left, no weight", fontsize=10, pad=18.0)


def _legend_entries(computed: set[str]) -> list[Any]:
    """Return one column each of the regimes by theory, their limits, and the computed particles, if any."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    areas = [Patch(facecolor=_pale(COLORS[name]), edgecolor=COLORS[name], hatch=HATCHES[name], linewidth=0.0,
                   label=f"theory: {WORDS[name]}") for name in REGIMES]  # fmt: skip
    lines: list[Any] = []
    for name, style in LINES:
        lines.append(Line2D([], [], color=INK, linewidth=1.8, label=name))
        lines[-1].set_linestyle(style)
    marks = [Line2D([], [], linestyle="", marker=MARKERS[name], color=COLORS[name], markeredgecolor=INK, markersize=8,
                    label=f"computed: {WORDS[name]}") for name in REGIMES if name in computed]  # fmt: skip
    return [*areas, *lines, *marks]


def _pale(color: str) -> tuple[float, float, float]:
    """Return the colour `#RRGGBB` mixed with a fraction `PALE` of white."""
    red, green, blue = (int(color[k : k + 2], 16) / 255.0 for k in (1, 3, 5))
    return red + (1.0 - red) * PALE, green + (1.0 - green) * PALE, blue + (1.0 - blue) * PALE
