"""Panels of profiles between the plates: velocity, solid fraction, stress and states, means over part of the drag."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes

from thirdbody.palette import LINE_COLORS as LINES
from thirdbody.plot.run_data import RunData
from thirdbody.trajectory.bed_verdict import steady
from thirdbody.units import quantity_text, unit_for

PROFILES_NOTE = (
    "Profiles: means in slabs between the plates, over the second half of the sliding or of the cycles (there along the motion of"
    " the plate). Stress: of contact forces and of velocities together; of the plates: their forces over the area."
)
PLATE: dict[str, Any] = {
    "color": LINES["black"], "linestyle": "none", "marker": "s", "markersize": 4.0, "label": "plates", "clip_on": False,
}  # fmt: skip

ALONG = 0.5
"""Cosine of the angle between the drag and the axis across the slabs from which on there is no shear stress to draw."""


def why_no_profiles(data: RunData) -> str:
    """Return why there is no panel, empty when the run has profiles and was dragged."""
    if not data.run.profiles:
        return "no profiles: output.profiles was not given"
    return "" if data.dragged else "no drag"


def why_no_state_profile(data: RunData) -> str:
    """Return why there is no panel of states, empty when the run has labels besides."""
    return why_no_profiles(data) or ("" if data.fractions else "its bodies were not labelled")


def velocity_title(data: RunData) -> str:
    """Return the title."""
    return "Velocity along the drag"


def draw_velocity(axes: Axes, data: RunData) -> None:
    """Draw the velocity along the drag, and those of the plates."""
    durations = np.where(data.drag.durations > 0.0, data.drag.durations, np.nan)
    speed = np.array([0.0, _mean(data, np.abs(data.drag.steps) / durations)])
    values = _along(data, data.run.profiles["velocity"])
    factor, unit = unit_for(np.append(values, speed), "m/s")
    _draw(axes, data, values / factor, LINES["blue"], "debris")
    if _axis(data) == "z":
        axes.plot(speed / factor, _scaled(data, _extent(data))[0], **PLATE, zorder=3)
    axes.set_xlabel(f"velocity ({unit})")


def solid_title(data: RunData) -> str:
    """Return the mean in words."""
    return f"Solid fraction: {float(np.mean(_mean(data, data.run.profiles['solid_fraction']))):.3f}"


def draw_solid(axes: Axes, data: RunData) -> None:
    """Draw the solid fraction."""
    _draw(axes, data, _mean(data, data.run.profiles["solid_fraction"]), LINES["blue"], "debris")
    axes.set_xlim(0.0, None)
    axes.set_xlabel("solid fraction")


def stress_title(data: RunData) -> str:
    """Return the mean pressure across the slabs in words."""
    k = "xyz".index(_axis(data))
    return f"Stress: {quantity_text(float(np.mean(_mean(data, _stress(data)[..., k]))), 'Pa')} across the slabs"


def draw_stress(axes: Axes, data: RunData) -> None:
    """Draw normal and shear stress across the slabs, and the forces of the plates over their area."""
    k = "xyz".index(_axis(data))
    lines = [("normal", _mean(data, _stress(data)[..., k]), LINES["blue"])]
    if np.abs(data.drag.headings[steady(data.run), k]).max() < ALONG:
        lines.append(("shear", -_along(data, _stress(data)), LINES["vermilion"]))
    factor, unit = unit_for(np.concatenate([values for _, values, _ in lines]), "Pa")
    for name, values, color in lines:
        _draw(axes, data, values / factor, color, name)
    if _axis(data) == "z":
        z, area = _scaled(data, _extent(data))[0], float(np.prod(data.run.header["domain"]["size"]))
        forces = np.stack([-data.series["lower_force"], data.series["upper_force"]]) / (area * factor)
        normal = [_mean(data, force[:, 2]) for force in forces]
        shear = [-_along(data, force) for force in forces]
        axes.plot(normal, z, **PLATE, zorder=3)
        axes.plot(shear, z, **{**PLATE, "label": None}, zorder=3)
    axes.set_xlim(min(0.0, axes.get_xlim()[0]), None)
    axes.set_xlabel(f"stress ({unit})")


def states_profile_title(data: RunData) -> str:
    """Return the title."""
    return "States, by volume"


def draw_states_profile(axes: Axes, data: RunData) -> None:
    """Draw the fractions of the states beside each other in every slab."""
    position, unit = _scaled(data, _mean(data, data.run.profiles["position"]))
    left = np.zeros(len(position))
    height = float(_scaled(data, _extent(data))[0][1]) / len(position)
    for name in data.fractions:
        width = np.nan_to_num(_mean(data, data.run.profiles[f"fraction_{name}"]))
        if width.any():
            axes.barh(position, width, height, left=left, color=data.colors[name], linewidth=0.0, label=name)
        left += width
    axes.set_xlim(0.0, 1.0)
    axes.set_xticks([0.0, 0.25, 0.5, 0.75, 1.0], ["0", "25", "50", "75", "100"])
    axes.set_xlabel("debris (%)")
    axes.set_ylabel(f"{_axis(data)} ({unit})")


def _draw(axes: Axes, data: RunData, values: np.ndarray, color: str, label: str) -> None:
    """Draw a profile over the axis across its slabs, between the plates."""
    position, unit = _scaled(data, _mean(data, data.run.profiles["position"]))
    axes.plot(values, position, color=color, linewidth=1.4, marker=".", markersize=4.0, label=label)
    axes.set_ylim(0.0, float(_scaled(data, _extent(data))[0][1]))
    axes.set_ylabel(f"{_axis(data)} ({unit})")


def _scaled(data: RunData, position: np.ndarray) -> tuple[np.ndarray, str]:
    """Return positions in the unit of the whole extent, and that unit."""
    factor, unit = unit_for(_extent(data), "m")
    return position / factor, unit


def _extent(data: RunData) -> np.ndarray:
    """Return the ends of the slabs, (2,) [m]."""
    position = _mean(data, data.run.profiles["position"])
    return np.array([0.0, 2.0 * position[0] * len(position)])


def _axis(data: RunData) -> str:
    return str(data.run.header["profiles"]["axis"])


def _stress(data: RunData) -> np.ndarray:
    """Return the stress on faces across the slabs [Pa], (F, bins, 3)."""
    profiles = data.run.profiles
    return (profiles["contact_stress"] + profiles["kinetic_stress"])[..., "xyz".index(_axis(data))]


def _along(data: RunData, vectors: np.ndarray) -> np.ndarray:
    """Return the mean of vectors (F, ..., 3) along the motion of the plate in each interval."""
    return _mean(data, np.einsum("f...k,fk->f...", vectors, data.drag.headings))


def _mean(data: RunData, values: np.ndarray) -> np.ndarray:
    """Return the mean over the intervals that count, by time."""
    chosen = steady(data.run)
    weights = data.drag.durations[chosen]
    return np.tensordot(weights, values[chosen], 1) / weights.sum()
