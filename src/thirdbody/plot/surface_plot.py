"""Picture of a surface: its height map with a scale bar, and its spectrum with the power law."""

from pathlib import Path

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter

from thirdbody.palette import INK, LINE_COLORS, SOFT_INK
from thirdbody.plot.figures import save
from thirdbody.surfaces.statistics import Statistics
from thirdbody.units import quantity_text, round_length, unit_for, with_unit

WIDTH, HEIGHT, DOTS = 10.0, 4.6, 160  # of the picture [inch], and its dots per inch
MAX_PIXELS = 2000  # points along the longer side of a drawn map; finer ones are thinned
COLORS = "cividis"  # colour map of heights, the same for every kind of colour vision (Nunez, Anderton and Renslow 2018)


def draw_surface(out: Path, name: str, heights: np.ndarray, spacing: tuple[float, float], statistics: Statistics) -> None:
    """Draw heights (n_y, n_x) [m] and their spectrum into a file. Raises OutputError."""
    with rc_context({"font.size": 10}):
        figure = Figure(figsize=(WIDTH, HEIGHT), layout="constrained")
        left, right = figure.subplots(1, 2, width_ratios=[1.25, 1.0])
        figure.suptitle(name, x=0.02, ha="left", fontweight="bold", color=INK)
        _draw_map(figure, left, heights, spacing)
        _draw_spectrum(right, statistics)
        save(figure, out, DOTS)


def _draw_map(figure: Figure, axes: Axes, heights: np.ndarray, spacing: tuple[float, float]) -> None:
    n_y, n_x = heights.shape
    width, depth = n_x * spacing[0], n_y * spacing[1]
    factor, unit = unit_for(np.array([np.abs(heights).max()]), "m")
    step = max(1, -(-max(n_x, n_y) // MAX_PIXELS))
    image = axes.imshow(heights[::step, ::step] / factor, origin="lower", extent=(0.0, width, 0.0, depth), cmap=COLORS)
    axes.set_axis_off()
    axes.set_title(f"{with_unit(width, 'm')} by {with_unit(depth, 'm')}", loc="left", fontsize=10, color=SOFT_INK)
    bar = figure.colorbar(image, ax=axes, shrink=0.85, pad=0.02)
    bar.set_label(f"height [{unit}]")
    bar.outline.set_visible(False)  # type: ignore[operator]
    length = round_length(0.3 * width)
    y = -0.035 * depth
    axes.plot([0.0, length], [y, y], color=INK, lw=3.0, solid_capstyle="butt", clip_on=False)
    axes.text(0.5 * length, y - 0.015 * depth, with_unit(length, "m"), ha="center", va="top", color=INK)
    axes.set_ylim(-0.1 * depth, depth)


def _draw_spectrum(axes: Axes, statistics: Statistics) -> None:
    spectrum, law = statistics.spectrum, statistics.law
    shown = np.zeros(0, bool) if spectrum is None else spectrum.power > 1e-12 * spectrum.power.max(initial=0.0)
    if spectrum is None or not shown.any():
        axes.text(0.5, 0.5, "flat", transform=axes.transAxes, ha="center")
        axes.set_axis_off()
        return
    factor, unit = unit_for(2.0 * np.pi / spectrum.wavenumber[shown], "m")
    wavelength = 2.0 * np.pi / spectrum.wavenumber[shown] / factor
    axes.loglog(wavelength, spectrum.power[shown], "o", ms=4, color=LINE_COLORS["blue"], label="mean over all directions")
    if law is not None:
        inside = (wavelength * factor >= 0.999 * law.short) & (wavelength * factor <= 1.001 * law.long)
        x, power = wavelength[inside], spectrum.power[shown][inside]
        slope = 2.0 + 2.0 * law.hurst
        line = np.exp(np.mean(np.log(power) - slope * np.log(x))) * x**slope
        doubt = "" if law.is_certain else ", uncertain"
        axes.loglog(x, line, color=LINE_COLORS["vermilion"], lw=1.5, label=f"Hurst exponent {law.hurst:.2f}{doubt}")
    axes.invert_xaxis()
    axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axes.xaxis.set_major_formatter("{x:g}")
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.set_xlabel(f"wavelength [{unit}]")
    axes.set_ylabel("power spectrum [m$^4$]")
    axes.set_title(
        f"rms height {quantity_text(statistics.rms_height, 'm')}, rms slope {statistics.rms_slope:.2g}",
        loc="left", fontsize=10, color=SOFT_INK,
    )  # fmt: skip
    axes.legend(frameon=False, fontsize=9)
    axes.spines[["top", "right"]].set_visible(False)
