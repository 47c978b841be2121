"""Panels of profiles between the plates: velocity, solid fraction, stress and states, means over part of the drag."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes

from thirdbody.palette import LINE_COLORS as LINES
from thirdbody.plot.run_data import RunData
from thirdbody.quantity import quantity_text, unit_for
from thirdbody.trajectory.bed_verdict import steady

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
    speed = np.array([0.0, _mean(data, data.drag.steps / np.where(data.drag.durations > 0.0, data.drag.durations, np.nan), True)])
    values = _mean(data, data.run.profiles["velocity"] @ _direction(data), True)
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
    return f"Stress: {quantity_text(float(np.mean(_stress(data, k, False))), 'Pa')} across the slabs"


def draw_stress(axes: Axes, data: RunData) -> None:
    """Draw normal and shear stress across the slabs, and the forces of the plates over their area."""
    k, e = "xyz".index(_axis(data)), _direction(data)
    lines = [("normal", _stress(data, k, False), LINES["blue"])]
    if abs(e[k]) < ALONG:
        lines.append(("shear", _stress(data, e, True), LINES["vermilion"]))
    factor, unit = unit_for(np.concatenate([values for _, values, _ in lines]), "Pa")
    for name, values, color in lines:
        _draw(axes, data, values / factor, color, name)
    if _axis(data) == "z":
        z, area = _scaled(data, _extent(data))[0], float(np.prod(data.run.header["domain"]["size"]))
        forces = np.stack([-data.series["lower_force"], data.series["upper_force"]]) / (area * factor)
        normal = [_mean(data, force[:, 2]) for force in forces]
        shear = [-_mean(data, force @ e, True) for force in forces]
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


def _direction(data: RunData) -> np.ndarray:
    """Return the unit vector of the first motion of the upper plate, (3,)."""
    corners = [data.run.plates(k)["position"][4] for k in (data.start, min(data.start + 1, data.frames - 1))]
    moved = (corners[1] - corners[0]) * [1.0, 1.0, 0.0]
    size = float(np.linalg.norm(moved))
    return moved / size if size > 0.0 else np.array([1.0, 0.0, 0.0])


def _stress(data: RunData, component: int | np.ndarray, signed: bool) -> np.ndarray:
    """Return the mean stress on faces across the slabs [Pa], of a component or along a direction; friction is positive."""
    profiles = data.run.profiles
    face = (profiles["contact_stress"] + profiles["kinetic_stress"])[..., "xyz".index(_axis(data))]
    return _mean(data, face[..., component]) if isinstance(component, int) else -_mean(data, face @ component, signed)


def _mean(data: RunData, values: np.ndarray, signed: bool = False) -> np.ndarray:
    """Return the mean over the intervals that count, by time; `signed`: along the motion of the plate in each of them."""
    chosen = steady(data.run)
    weights = data.drag.durations[chosen]
    along = weights * (np.sign(data.drag.steps[chosen]) if signed else 1.0)
    return np.tensordot(along, values[chosen], 1) / weights.sum()
