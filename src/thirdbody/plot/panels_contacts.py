"""Panels of the contacts at one frame: utilisation of friction, and normal forces."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator

from thirdbody.palette import LINE_COLORS as LINES
from thirdbody.palette import SPARE_COLORS
from thirdbody.plot.run_data import BETWEEN, RunData
from thirdbody.quantity import percent, quantity_text, scale_values

LIMIT = 0.999
"""Utilisation from which a contact counts as slipping."""

BINS = 25
UTILISATION_NOTE = (
    "Utilisation: tangential force of a contact over the most that friction lets it carry; at 1 it slips. Colours: state of the"
    " body."
)


def why_no(name: str, sheet: RunData) -> str:
    """Return why there is no histogram of that array, empty if there is one."""
    if not len(sheet.contacts["position"]):
        return f"no contact at frame {sheet.frame}"
    if name not in sheet.contacts:
        return f"its contacts have no {name}"
    return "" if np.isfinite(sheet.contacts[name]).all() else f"{name} of its contacts is not a number"


def utilisation_title(sheet: RunData) -> str:
    """Return the fraction of slipping contacts in words."""
    values = sheet.contacts["utilisation"]
    fraction = float(np.mean(values >= LIMIT))
    words = {0.0: "none slips", 1.0: "all slip"}.get(fraction, f"{percent(fraction)} slip")
    return f"Contacts, {when(sheet)}: {words}"


def normal_force_title(sheet: RunData) -> str:
    """Return the mean in words."""
    values = sheet.contacts["normal_force"]
    return f"{len(values)} contact{'s' if len(values) > 1 else ''}: mean {quantity_text(float(values.mean()), 'N')}"


def when(sheet: RunData) -> str:
    """Return the frame in words."""
    return "at the end" if sheet.frame == sheet.frames - 1 else f"frame {sheet.frame}"


def draw_utilisation(axes: Axes, sheet: RunData) -> None:
    """Draw the histogram of utilisation from 0 to 1, stacked by the state of the body."""
    # rounding can put a slipping contact just above 1
    values = np.clip(sheet.contacts["utilisation"], 0.0, 1.0)
    _draw_stacked(axes, sheet, values, np.linspace(0.0, 1.0, BINS + 1))
    axes.set_xlabel("utilisation of friction")


def draw_normal_force(axes: Axes, sheet: RunData) -> None:
    """Draw the histogram of normal forces, stacked by the state of the body."""
    values, unit = scale_values(sheet.contacts["normal_force"], "N")
    ends = min(float(values.min()), 0.0), max(float(values.max()), 0.0) or 1.0
    _draw_stacked(axes, sheet, values, np.linspace(*ends, BINS + 1))
    axes.set_xlabel(f"normal force ({unit})")


def _draw_stacked(axes: Axes, sheet: RunData, values: np.ndarray, edges: np.ndarray) -> None:
    groups = sheet.contact_groups
    extra = {BETWEEN: SPARE_COLORS[0], "all": LINES["grey"]}
    colors = [sheet.colors.get(name) or extra[name] for name in groups]
    parts = [values[members] for members in groups.values()]
    axes.hist(parts, edges.tolist(), stacked=True, color=colors, label=list(groups), edgecolor="white", linewidth=0.3)
    axes.set_ylabel("contacts")
    axes.set_xlim(edges[0], edges[-1])
    axes.yaxis.set_major_locator(MaxNLocator("auto", integer=True))
