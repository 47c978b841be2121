"""Picture of forecast against observation: margin of each body's friction to the limit of sliding, and its motion."""

from __future__ import annotations

import textwrap
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from thirdbody.errors import InputError
from thirdbody.palette import INK, STATE_COLORS, rgb
from thirdbody.plot.figures import check_format, save

if TYPE_CHECKING:
    from matplotlib.axes import Axes

BAND = 0.02  # relative distance of mu from t_min and t_max within which the answer is open
# Margins beyond +-FARTHEST are drawn there; NEVER: position of bodies that no friction lets slide (t_min > t_max).
FARTHEST, NEVER = 10.0, -28.0
MARKERS = {"rolling": ("o", 17.0), "sliding": ("D", 13.0), "sticking": ("s", 14.0)}  # sign of each motion and its size
FACTS = {"rolling": "was rolling", "sliding": "never rolled: slid", "sticking": "never rolled: stuck"}
# Of the figure [inch]: width, least height of one row, height of everything except the rows.
WIDTH, ROW, MARGIN_HEIGHT = 5.4, 0.4, 2.1
TALLEST = 3.2  # height of all rows [inch] up to which crowded rows grow so that their points stay distinguishable
LETTERS = 52  # largest number of letters in a line of the title, by its width
MIN_ROWS = 3  # number of rows that the axes have room for at least
HALF_WIDTH = 0.4  # largest distance of a point from the middle of its row, whose height is 1
EDGES = (1.8 * NEVER, 1.35 * FARTHEST)
STEP = 0.0125  # width of a stack of points over that of the axes: a little less than a point, so that neighbours just overlap
PITCH = 0.055  # distance between points of a stack [inch]: they just touch
NAMED = 12  # largest number of ringed and named disagreements; of more, those farthest from the band, half of them on each side
NUMBER = (0.09, 0.16)  # room of a number next to its ring: fraction of the width of the axes, and height [inch]


class Forecasts(NamedTuple):
    """Bodies of one run or of several, one entry each."""

    body: np.ndarray
    """Number of the body in its run (n,), int."""
    friction: np.ndarray
    """Friction coefficient (n,)."""
    t_min: np.ndarray
    """Least friction coefficient with which it can slide along the drag (n,)."""
    t_max: np.ndarray
    """Largest one (n,)."""
    slides: np.ndarray
    """Forecast (n,), bool: it can slide; else it can only roll."""
    fact: np.ndarray
    """Observed motion (n,), str: a key of FACTS."""

    @property
    def margin(self) -> np.ndarray:
        """min(mu - t_min, t_max - mu)/mu (n,): positive inside the interval; without friction +-inf, or 0 at an end."""
        inside = np.minimum(self.friction - self.t_min, self.t_max - self.friction)
        outside = np.where(inside == 0.0, 0.0, np.copysign(np.inf, inside))
        return np.divide(inside, self.friction, out=outside, where=self.friction > 0.0)

    @property
    def never(self) -> np.ndarray:
        """No friction lets it slide (n,), bool."""
        return self.t_min > self.t_max

    @property
    def clear(self) -> np.ndarray:
        """Outside the band (n,), bool."""
        return np.abs(self.margin) > BAND

    @property
    def correct(self) -> np.ndarray:
        """Forecast and observation agree (n,), bool."""
        return self.slides == (self.fact != "rolling")


def draw_forecasts(forecasts: Forecasts, path: Path, title: str = "") -> None:
    """Write the picture, one row per friction coefficient; the suffix selects the format.

    Raises UsageError for another suffix, InputError without any body, OutputError if the file cannot be written.
    """
    from matplotlib.figure import Figure

    check_format(path)
    if not len(forecasts.body):
        raise InputError("nothing to draw: no body has a forecast")
    figure = Figure(figsize=(WIDTH, MARGIN_HEIGHT + _rows_height(forecasts.friction)), layout="constrained")
    draw_into(figure.subplots(), forecasts, title)
    save(figure, path)


def _rows_height(friction: np.ndarray) -> float:
    """Return the height of all rows [inch]: a row of n bodies needs a quarter of their stack, up to TALLEST in all."""
    counts = np.unique(friction, return_counts=True)[1]
    return max(ROW * max(len(counts), MIN_ROWS), min(0.25 * PITCH * float(counts.max()) * len(counts), TALLEST))


def draw_into(axes: Axes, forecasts: Forecasts, title: str = "") -> None:
    """Draw everything into the axes: the two answers and the band, points by observed motion, rings around disagreements."""
    frictions, row = np.unique(forecasts.friction, return_inverse=True)
    _draw_ground(axes, frictions)
    x = np.where(forecasts.never, NEVER, np.clip(forecasts.margin, -FARTHEST, FARTHEST))
    height = _rows_height(forecasts.friction) / len(frictions)
    # along the axis as fractions of its width, independent of the size of the figure
    fraction = axes.transData.transform(np.column_stack([x, np.zeros(len(x))]))[:, 0] / axes.bbox.width
    y = row + _swarm(fraction, row, PITCH / height)
    for name, (marker, size) in MARKERS.items():
        here = forecasts.fact == name
        if here.any():
            axes.scatter(x[here], y[here], s=size, marker=marker, color=STATE_COLORS[name], edgecolors="white", linewidths=0.35,
                         label=FACTS[name], zorder=3)  # fmt: skip
    _mark_disagreements(axes, forecasts, np.column_stack([x, y]), np.column_stack([fraction, y * height]))
    axes.set_title("\n".join([*textwrap.wrap(title, LETTERS), agreement(forecasts)]), fontsize=10.0, pad=20.0)
    axes.figure.legend(loc="outside lower center", ncols=2, frameon=False, fontsize=9.0, handletextpad=0.3, columnspacing=1.2)


def agreement(forecasts: Forecasts) -> str:
    """Return the agreement in words."""
    clear = forecasts.clear
    report, agree = int(clear.sum()), int((clear & forecasts.correct).sum())
    fraction = f" ({100.0 * agree / report:.1f} %)" if report else ""
    left = len(clear) - report
    return f"as forecast: {agree} of {report}{fraction}" + (f"; {left} more in the {100.0 * BAND:g} % band" if left else "")


def _swarm(x: np.ndarray, row: np.ndarray, pitch: float) -> np.ndarray:
    """Return positions across a row (n,), within +-HALF_WIDTH, of points at `x` (fraction of the width): near ones stacked.

    `pitch`: distance between the points of a stack.
    """
    across = np.zeros(len(x))
    cell = np.floor(x / STEP + 0.5).astype(int)
    for key in np.unique(np.column_stack([row, cell]), axis=0):
        members = np.flatnonzero((row == key[0]) & (cell == key[1]))
        near = min(pitch, 2.0 * HALF_WIDTH / max(len(members) - 1, 1))
        across[members] = near * (np.arange(len(members)) - 0.5 * (len(members) - 1))
    return across


def _draw_ground(axes: Axes, frictions: np.ndarray) -> None:
    """Draw the axes, linear within the band and logarithmic outside, in the pale colour of the forecast."""
    axes.set_xscale("symlog", linthresh=BAND, linscale=0.35)
    axes.set_xlim(*EDGES)
    axes.set_ylim(-0.55, len(frictions) - 0.45)
    sides = ((EDGES[0], -BAND, "rolling", "forecast: can only roll"), (BAND, EDGES[1], "sliding", "forecast: can slide"))
    for start, end, state, text in sides:
        pale = tuple(1.0 - 0.25 * (1.0 - part / 255.0) for part in rgb(STATE_COLORS[state]))  # a quarter of the colour on white
        axes.axvspan(start, end, color=pale, zorder=0, linewidth=0.0)
        middle = -np.sqrt(start * end) if start < 0.0 else np.sqrt(start * end)
        axes.annotate(text, (middle, 1.0), (0.0, 4.0), xycoords=axes.get_xaxis_transform(), textcoords="offset points",
                      ha="center", fontsize=9.5, fontweight="bold", color=INK)  # fmt: skip
    axes.axvspan(-BAND, BAND, color="#C9CCD1", zorder=0, linewidth=0.0, label=f"within {100.0 * BAND:g} %: open")
    axes.axvline(0.0, color=INK, linewidth=0.8, zorder=1)
    for y in np.arange(len(frictions) - 1) + 0.5:
        axes.axhline(y, color="white", linewidth=1.2, zorder=1)
    points = [-1.0, -0.1, -BAND, 0.0, BAND, 0.1, 1.0, FARTHEST]
    names = [f"{100.0 * t:+g}".replace("-", "\N{MINUS SIGN}") if t else "0" for t in points]
    axes.set_xticks([NEVER, *points], ["never", *names])
    axes.xaxis.minorticks_off()
    axes.set_yticks(range(len(frictions)), [f"{mu:g}" for mu in frictions])
    axes.tick_params(axis="y", length=0.0)
    axes.set_ylabel(r"friction coefficient $\mu$")
    axes.set_xlabel(r"distance of $\mu$ from the nearer end of $[t_{\min}, t_{\max}]$, in % of $\mu$")
    axes.spines[["top", "right", "left"]].set_visible(False)


def _mark_disagreements(axes: Axes, forecasts: Forecasts, points: np.ndarray, positions: np.ndarray) -> None:
    """Draw rings and numbers for wrongly forecast bodies outside the band; of many, dark edges, and numbers for the farthest.

    Of all bodies `points` (n, 2) in the axes and `positions` (n, 2): fraction of the width, and height [inch].
    """
    from matplotlib.patheffects import withStroke

    wrong = np.flatnonzero(forecasts.clear & ~forecasts.correct)
    if not len(wrong):
        return
    ringed, label = wrong, "other than forecast"
    if len(wrong) > NAMED:
        dark: str | None = f"other than forecast ({len(wrong)})"
        for name in sorted(set(forecasts.fact[wrong])):
            here = wrong[forecasts.fact[wrong] == name]
            axes.scatter(points[here, 0], points[here, 1], s=20.0, marker=MARKERS[name][0], color=STATE_COLORS[name],
                         edgecolors=INK, linewidths=0.9, zorder=4, label=dark)  # fmt: skip
            dark = None
        ringed = _farthest(forecasts, wrong, positions)
        label = f"the {len(ringed)} of these farthest from the band"
    x, y = points[ringed].T
    axes.scatter(x, y, s=75.0, facecolors="none", edgecolors=INK, linewidths=1.1, zorder=5, label=label)
    for k in ringed:  # the number to the right of its ring, or to the left where another ring is
        ahead, above = (positions[ringed] - positions[k]).T
        occupied = ((ahead > 0.0) & (ahead < NUMBER[0]) & (np.abs(above) < NUMBER[1])).any()
        side, align = (-5.5, "right") if occupied else (5.5, "left")
        axes.annotate(str(forecasts.body[k]), points[k], (side, 0.0), textcoords="offset points", fontsize=8.5, va="center",
                      ha=align, zorder=6, path_effects=[withStroke(linewidth=2.0, foreground="white")])  # fmt: skip


def _farthest(forecasts: Forecasts, wrong: np.ndarray, positions: np.ndarray) -> np.ndarray:
    distance = np.where(forecasts.never, np.inf, np.abs(forecasts.margin))
    chosen: list[int] = []
    for slides in (False, True):
        side = wrong[forecasts.slides[wrong] == slides]
        space = len(chosen) + NAMED // 2
        for k in side[np.argsort(-distance[side], kind="stable")]:
            near = (np.abs(positions[chosen] - positions[k]) < NUMBER).all(axis=1)
            if len(chosen) < space and not near.any():
                chosen.append(int(k))
    return np.array(chosen)
