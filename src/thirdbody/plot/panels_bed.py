"""Panel of a bed: how slowly it is sheared and how close to equilibrium it is."""

import numpy as np
from matplotlib.axes import Axes

from thirdbody.granular_flow import SLOW
from thirdbody.palette import LINE_COLORS as LINES
from thirdbody.plot.run_data import RunData
from thirdbody.units import scale_values

MEASURES = {
    "inertial_number": ("inertial number", LINES["black"], "-"),
    "unbalanced_force": ("unbalanced force", LINES["blue"], "--"),
    "kinetic_energy_ratio": ("kinetic over elastic energy", LINES["orange"], "-."),
}
"""Series drawn: label, colour, style of the line."""

BED_NOTE = (
    "Bed: shear is slow where the inertial number, shear rate * diameter * sqrt(density / pressure), is below 0.001, the dotted"
    " line; unbalanced force: mean total force on a body over the mean contact force."
)


def why_no_bed(data: RunData) -> str:
    """Return why there is no panel, empty when the run has a bed that is sheared."""
    if "inertial_number" not in data.series:
        return "its debris is no bed between two plates"
    number = data.name("inertial_number")
    drawn = len(data.axis[0]) > 1 and data.axis[0][-1] > data.axis[0][0] and bool((number > 0.0).any())
    return "" if drawn else "its bed is not sheared, or is thinner than three diameters"


def bed_title(data: RunData) -> str:
    """Return the verdict on the bed."""
    bed = data.run.bed
    verdict = bed.verdict if bed is not None else ""
    return f"Bed: {verdict or 'inertial number not known'}"


def draw_bed(axes: Axes, data: RunData) -> None:
    """Draw the measures that are small in a bed sheared slowly."""
    x, unit = scale_values(data.axis[0], data.axis[1])
    for name, (label, color, style) in MEASURES.items():
        values = data.interval_means(name)
        axes.plot(x, np.where(values > 0.0, values, np.nan), color=color, linestyle=style, linewidth=1.4, label=label)
    axes.axhline(SLOW, color=LINES["grey"], linestyle=":", linewidth=1.0)
    axes.set_yscale("log")
    axes.set_ylabel("ratio")
    axes.set_xlabel(f"{data.axis[2]} ({unit})")
