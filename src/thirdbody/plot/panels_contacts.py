"""Panels of the contacts at one frame: utilisation of friction, and normal forces."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator

from thirdbody.palette import LINE_COLORS as LINES
from thirdbody.palette import SPARE_COLORS
from thirdbody.plot.run_data import BETWEEN, RunData
from thirdbody.units import percent, quantity_text, scale_values

LIMIT = 0.999
"""Utilisation from which a contact counts as slipping."""

BINS = 25
UTILISATION_NOTE = (
    "Utilisation: tangential force of a contact over the most that friction lets it carry; at 1 it slips. Colours: state of the"
    " body."
)


def why_no(name: str, data: RunData) -> str:
    """Return why there is no histogram of that array, empty if there is one."""
    if not len(data.contacts["position"]):
        return f"no contact at frame {data.frame}"
    if name not in data.contacts:
        return f"its contacts have no {name}"
    return "" if np.isfinite(data.contacts[name]).all() else f"{name} of its contacts is not a number"


def utilisation_title(data: RunData) -> str:
    """Return the fraction of slipping contacts in words."""
    values = data.contacts["utilisation"]
    fraction = float(np.mean(values >= LIMIT))
    words = {0.0: "none slips", 1.0: "all slip"}.get(fraction, f"{percent(fraction)} slip")
    return f"Contacts, {when(data)}: {words}"


def normal_force_title(data: RunData) -> str:
    """Return the mean in words."""
    values = data.contacts["normal_force"]
    return f"{len(values)} contact{'s' if len(values) > 1 else ''}: mean {quantity_text(float(values.mean()), 'N')}"


def when(data: RunData) -> str:
    """Return the frame in words."""
    return "at the end" if data.frame == data.frames - 1 else f"frame {data.frame}"


def draw_utilisation(axes: Axes, data: RunData) -> None:
    """Draw the histogram of utilisation from 0 to 1, stacked by the state of the body."""
    # rounding can put a slipping contact just above 1
    values = np.clip(data.contacts["utilisation"], 0.0, 1.0)
    _draw_stacked(axes, data, values, np.linspace(0.0, 1.0, BINS + 1))
    axes.set_xlabel("utilisation of friction")


def draw_normal_force(axes: Axes, data: RunData) -> None:
    """Draw the histogram of normal forces, stacked by the state of the body."""
    values, unit = scale_values(data.contacts["normal_force"], "N")
    ends = min(float(values.min()), 0.0), max(float(values.max()), 0.0) or 1.0
    _draw_stacked(axes, data, values, np.linspace(*ends, BINS + 1))
    axes.set_xlabel(f"normal force ({unit})")


def _draw_stacked(axes: Axes, data: RunData, values: np.ndarray, edges: np.ndarray) -> None:
    groups = data.contact_groups
    extra = {BETWEEN: SPARE_COLORS[0], "all": LINES["grey"]}
    colors = [data.colors.get(name) or extra[name] for name in groups]
    parts = [values[members] for members in groups.values()]
    axes.hist(parts, edges.tolist(), stacked=True, color=colors, label=list(groups), edgecolor="white", linewidth=0.3)
    axes.set_ylabel("contacts")
    axes.set_xlim(edges[0], edges[-1])
    axes.yaxis.set_major_locator(MaxNLocator("auto", integer=True))
