"""Panel of velocity accommodation: the plate's speed as the sum of slip, rolling and shear."""

import numpy as np
from matplotlib.axes import Axes

from thirdbody.palette import LINE_COLORS as LINES
from thirdbody.plot.run_data import RunData
from thirdbody.trajectory.accommodation_fractions import WORDS, accommodation_fractions, short_accommodation_text
from thirdbody.units import scale_values, unit_for

ACCOMMODATION_NOTE = (
    "Velocity accommodation: the speed of the upper plate as the sum of slip at the contacts of both plates, of what the rotation"
    " of the bodies adds between them, and of shear inside the bed; weighted by the load that passes from plate to plate."
)
COLORS = {
    "upper_slip": LINES["orange"], "lower_slip": LINES["vermilion"], "rolling": LINES["green"], "shear": LINES["sky"],
}  # fmt: skip
VISIBLE = 1e-3
"""A part is drawn if it exceeds this fraction of the plate's largest speed at some output."""


def why_no_accommodation(data: RunData) -> str:
    """Return why there is no panel, empty when load passed between two plates of which one moved."""
    if not data.dragged:
        return "no drag"
    parts = _parts(data)
    if not parts:
        return "no two plates"
    return "" if np.isfinite(parts["rolling"][1:]).any() else "no load passed between the plates"


def accommodation_title(data: RunData) -> str:
    """Return the fractions in words."""
    fractions = accommodation_fractions(data.run)
    return "Velocity accommodation" + (f": {short_accommodation_text(fractions)}" if fractions else "")


def draw_accommodation(axes: Axes, data: RunData) -> None:
    """Draw the parts stacked upon each other, each over its output interval; parts against the drag downwards."""
    x, unit = scale_values(data.axis[0], data.axis[1])
    parts = {name: np.nan_to_num(values) for name, values in _parts(data).items()}
    speed = np.sum(list(parts.values()), axis=0)
    factor, speed_unit = unit_for(speed, "m/s")
    up, down = np.zeros(len(x)), np.zeros(len(x))
    for name, values in parts.items():
        if np.abs(values).max() > VISIBLE * np.abs(speed).max():
            tops = [up + np.maximum(values, 0.0), down + np.minimum(values, 0.0)]
            for base, top, label in ((up, tops[0], WORDS[name]), (down, tops[1], None)):
                axes.fill_between(x, base / factor, top / factor, step="pre", color=COLORS[name], linewidth=0.0, label=label)
            up, down = tops
    axes.step(x, speed / factor, where="pre", color=LINES["black"], linewidth=1.2, label="the plate")
    axes.set_ylabel(f"speed ({speed_unit})")
    axes.set_xlabel(f"{data.axis[2]} ({unit})")


def _parts(data: RunData) -> dict[str, np.ndarray]:
    """Return the parts from the start of the drag [m/s], empty without two plates."""
    if "accommodation_rolling" not in data.series:
        return {}
    return {name: data.interval_means(f"accommodation_{name}") for name in WORDS}
