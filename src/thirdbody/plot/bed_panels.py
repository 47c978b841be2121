"""Panels of the bed: states by group, velocity accommodation, how slowly it is sheared, profiles, contacts at one frame."""

from functools import partial
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator

from thirdbody.granular_flow import SLOW
from thirdbody.palette import LINE_COLORS as LINES
from thirdbody.palette import SPARE_COLORS
from thirdbody.plot.run_data import BETWEEN, PERCENT, Panel, RunData, draw_lines, label_axis, no_labels
from thirdbody.trajectory.bed import WORDS, accommodation_fractions, short_accommodation_text
from thirdbody.trajectory.states import POPULATION, fractions_text, informative_groups, states_by_group
from thirdbody.units import percent, quantity_text, unit_for

# -- states by group --

# Largest number of rows; letters of a name; fraction of a row that a text in it needs.
MAX_ROWS, LETTERS, MIN_TEXT_FRACTION = 12, 26, 0.14


def _rows(data: RunData) -> list[tuple[str, dict[str, Any]]]:
    rows = [(kind, row) for kind, rows in informative_groups(states_by_group(data.run)) for row in rows]
    return rows[:MAX_ROWS]


def _short(name: str) -> str:
    return name if len(name) <= LETTERS else f"{name[: LETTERS - 1]}\N{HORIZONTAL ELLIPSIS}"


def _no_groups(data: RunData) -> str:
    return no_labels(data) or ("" if _rows(data) else "its bodies are of one population and size")


@partial(Panel, "groups", 1.9, _no_groups,
    note="Groups: states of the bodies at the last frame by population, by material where populations share one, and in size "
         "classes of equal number (volume-equivalent diameter); on the right the number of bodies and their share of the "
         "normal force.")  # fmt: skip
def _draw_groups(axes: Axes, data: RunData) -> str:
    rows = [row for _, row in _rows(data)]
    for y, row in enumerate(rows):
        left = 0.0
        for name, fraction in row["fractions"].items():
            axes.barh(y, fraction, left=left, height=0.82, color=data.colors[name], linewidth=0.0)
            if fraction >= MIN_TEXT_FRACTION:
                text = f"{name} {percent(fraction)}"
                axes.text(left + 0.5 * fraction, y, text, ha="center", va="center", fontsize=6.5, color="white", clip_on=True)
            left += fraction
    axes.set_ylim(len(rows) - 0.5, -0.5)
    axes.yaxis.tick_right()
    loads = [f", {percent(row['load_share'])} of load" if "load_share" in row else "" for row in rows]
    labels = [f"{_short(row['name'])}: {row['bodies']}{load}" for row, load in zip(rows, loads, strict=True)]
    axes.set_yticks(range(len(rows)), labels)
    axes.tick_params(axis="y", length=0)
    axes.set(xlim=(0.0, 1.0), xlabel="bodies of the group (%)")
    axes.set_xticks(**PERCENT)
    populations = [row for kind, row in _rows(data) if kind == POPULATION][:3]
    if not populations:
        return "States by size at the last frame"
    words = (f"{_short(row['name'])} {fractions_text(row['fractions'], 1)}" for row in populations)
    return f"At the last frame: {'; '.join(words)}"


# -- velocity accommodation --

COLORS = {
    "upper_slip": LINES["orange"], "lower_slip": LINES["vermilion"], "rolling": LINES["green"], "shear": LINES["sky"],
}  # fmt: skip
VISIBLE = 1e-3  # a part is drawn if it exceeds this fraction of the plate's largest speed at some output


def _no_accommodation(data: RunData) -> str:
    if not data.dragged:
        return "no drag"
    if "accommodation_rolling" not in data.series:
        return "no two plates"
    passed = np.isfinite(data.interval_means("accommodation_rolling")[1:]).any()
    return "" if passed else "no load passed between the plates"


@partial(Panel, "accommodation", 1.7, _no_accommodation,
    note="Velocity accommodation: the speed of the upper plate as the sum of slip at the contacts of both plates, of what the "
         "rotation of the bodies adds between them, and of shear inside the bed; weighted by the load that passes from plate "
         "to plate.")  # fmt: skip
def _draw_accommodation(axes: Axes, data: RunData) -> str:
    x = data.x
    parts = {name: np.nan_to_num(data.interval_means(f"accommodation_{name}")) for name in WORDS}
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
    label_axis(axes, data, f"speed ({speed_unit})")
    fractions = accommodation_fractions(data.run.drag)
    return "Velocity accommodation" + (f": {short_accommodation_text(fractions)}" if fractions else "")


# -- how slowly it is sheared, and how close to equilibrium it is --

# Series drawn, label, colour, style of the line.
MEASURES = (
    ("inertial_number", "inertial number", "black", "-"), ("unbalanced_force", "unbalanced force", "blue", "--"),
    ("kinetic_energy_ratio", "kinetic over elastic energy", "orange", "-."),
)  # fmt: skip


def _no_bed(data: RunData) -> str:
    if "inertial_number" not in data.series:
        return "its debris is no bed between two plates"
    drawn = data.extended and (data.name("inertial_number") > 0.0).any()
    return "" if drawn else "its bed is not sheared, or is thinner than three diameters"


@partial(Panel, "bed", 1.5, _no_bed,
    note="Bed: shear is slow where the inertial number, shear rate * diameter * sqrt(density / pressure), is below 0.001, the "
         "dotted line; unbalanced force: mean total force on a body over the mean contact force.")  # fmt: skip
def _draw_bed(axes: Axes, data: RunData) -> str:
    means = ((data.interval_means(name), label, color, style) for name, label, color, style in MEASURES)
    lines = [(label, np.where(mean > 0.0, mean, np.nan), color, style) for mean, label, color, style in means]
    draw_lines(axes, data, lines, "ratio")
    axes.axhline(SLOW, color=LINES["grey"], linestyle=":", linewidth=1.0)
    axes.set_yscale("log")
    bed = data.run.bed
    return f"Bed: {(bed.verdict if bed is not None else '') or 'inertial number not known'}"


# -- profiles between the plates, means over part of the drag --

PLATE: dict[str, Any] = {
    "color": LINES["black"], "linestyle": "none", "marker": "s", "markersize": 4.0, "clip_on": False, "zorder": 3,
}  # fmt: skip

ALONG = 0.5  # cosine of the angle between the drag and the axis across the slabs from which on there is no shear stress to draw


def _no_profiles(data: RunData) -> str:
    if not data.run.profiles:
        return "no profiles: output.profiles was not given"
    return "" if data.dragged else "no drag"


def _mean(data: RunData, values: np.ndarray) -> np.ndarray:
    """Return the mean over the intervals that count, by time."""
    chosen = data.drag.steady
    weights = data.drag.durations[chosen]
    return np.tensordot(weights, values[chosen], 1) / weights.sum()


def _along(data: RunData, vectors: np.ndarray) -> np.ndarray:
    """Return the mean of vectors (F, ..., 3) along the motion of the plate in each interval."""
    return _mean(data, np.einsum("f...k,fk->f...", vectors, data.drag.headings))


def _slabs(axes: Axes, data: RunData) -> tuple[np.ndarray, np.ndarray]:
    """Label the axis across the slabs; return their middles and the ends of their extent (2,), in its unit."""
    position = _mean(data, data.run.profiles["position"])
    extent = np.array([0.0, 2.0 * position[0] * len(position)])
    factor, unit = unit_for(extent, "m")
    axes.set_ylabel(f"{data.run.header['profiles']['axis']} ({unit})")
    return position / factor, extent / factor


def _draw_profile(axes: Axes, data: RunData, values: np.ndarray, color: str, label: str) -> None:
    position, ends = _slabs(axes, data)
    axes.plot(values, position, color=LINES[color], linewidth=1.4, marker=".", markersize=4.0, label=label)
    axes.set_ylim(0.0, float(ends[1]))


@partial(Panel, "velocity_profile", 2.1, _no_profiles, half=True,
    note="Profiles: means in slabs between the plates, over the second half of the sliding or of the cycles (there along the "
         "motion of the plate). Stress: of contact forces and of velocities together; of the plates: their forces over the "
         "area.")  # fmt: skip
def _draw_velocity(axes: Axes, data: RunData) -> str:
    durations = np.where(data.drag.durations > 0.0, data.drag.durations, np.nan)
    speed = np.array([0.0, _mean(data, np.abs(data.drag.steps) / durations)])
    values = _along(data, data.run.profiles["velocity"])
    factor, unit = unit_for(np.append(values, speed), "m/s")
    _draw_profile(axes, data, values / factor, "blue", "debris")
    if data.run.header["profiles"]["axis"] == "z":
        axes.plot(speed / factor, _slabs(axes, data)[1], label="plates", **PLATE)
    axes.set_xlabel(f"velocity ({unit})")
    return "Velocity along the drag"


@partial(Panel, "solid_profile", 2.1, _no_profiles, half=True)
def _draw_solid(axes: Axes, data: RunData) -> str:
    solid = _mean(data, data.run.profiles["solid_fraction"])
    _draw_profile(axes, data, solid, "blue", "debris")
    axes.set_xlim(0.0, None)
    axes.set_xlabel("solid fraction")
    return f"Solid fraction: {float(np.mean(solid)):.3f}"


@partial(Panel, "stress_profile", 2.1, _no_profiles, half=True)
def _draw_stress(axes: Axes, data: RunData) -> str:
    profiles, k = data.run.profiles, "xyz".index(data.run.header["profiles"]["axis"])
    stress = (profiles["contact_stress"] + profiles["kinetic_stress"])[..., k]  # on faces across the slabs, (F, bins, 3)
    lines = [("normal", _mean(data, stress[..., k]), "blue")]
    if np.abs(data.drag.headings[data.drag.steady, k]).max() < ALONG:
        lines.append(("shear", -_along(data, stress), "vermilion"))
    factor, unit = unit_for(np.concatenate([values for _, values, _ in lines]), "Pa")
    for name, values, color in lines:
        _draw_profile(axes, data, values / factor, color, name)
    if k == 2:
        z, area = _slabs(axes, data)[1], float(np.prod(data.run.header["domain"]["size"]))
        forces = np.stack([-data.series["lower_force"], data.series["upper_force"]]) / (area * factor)
        axes.plot([_mean(data, force[:, 2]) for force in forces], z, label="plates", **PLATE)
        axes.plot([-_along(data, force) for force in forces], z, **PLATE)
    axes.set_xlim(min(0.0, axes.get_xlim()[0]), None)
    axes.set_xlabel(f"stress ({unit})")
    return f"Stress: {quantity_text(float(np.mean(lines[0][1])), 'Pa')} across the slabs"


@partial(Panel, "states_profile", 2.1, lambda data: _no_profiles(data) or no_labels(data), half=True)
def _draw_states_profile(axes: Axes, data: RunData) -> str:
    position, ends = _slabs(axes, data)
    left, height = np.zeros(len(position)), float(ends[1]) / len(position)
    for name in data.fractions:
        width = np.nan_to_num(_mean(data, data.run.profiles[f"fraction_{name}"]))
        if width.any():
            axes.barh(position, width, height, left=left, color=data.colors[name], linewidth=0.0, label=name)
        left += width
    axes.set(xlim=(0.0, 1.0), xlabel="debris (%)")
    axes.set_xticks(**PERCENT)
    return "States, by volume"


# -- contacts at one frame: histograms stacked by the state of the body --

LIMIT = 0.999  # utilisation from which a contact counts as slipping
BINS = 25


def _no_contacts(name: str, data: RunData) -> str:
    if not len(data.contacts["position"]):
        return f"no contact at frame {data.frame}"
    if name not in data.contacts:
        return f"its contacts have no {name}"
    return "" if np.isfinite(data.contacts[name]).all() else f"{name} of its contacts is not a number"


def _draw_stacked(axes: Axes, data: RunData, values: np.ndarray, low: float, high: float) -> None:
    groups, edges = data.contact_groups, np.linspace(low, high, BINS + 1)
    colors = [(data.colors | {BETWEEN: SPARE_COLORS[0], "all": LINES["grey"]})[name] for name in groups]
    parts = [values[members] for members in groups.values()]
    axes.hist(parts, edges.tolist(), stacked=True, color=colors, label=list(groups), edgecolor="white", linewidth=0.3)
    axes.set(ylabel="contacts", xlim=(low, high))
    axes.yaxis.set_major_locator(MaxNLocator("auto", integer=True))


@partial(Panel, "utilisation", 2.0, partial(_no_contacts, "utilisation"), half=True,
    note="Utilisation: tangential force of a contact over the most that friction lets it carry; at 1 it slips. Colours: state "
         "of the body.")  # fmt: skip
def _draw_utilisation(axes: Axes, data: RunData) -> str:
    # rounding can put a slipping contact just above 1
    _draw_stacked(axes, data, np.clip(data.contacts["utilisation"], 0.0, 1.0), 0.0, 1.0)
    axes.set_xlabel("utilisation of friction")
    fraction = float(np.mean(data.contacts["utilisation"] >= LIMIT))
    words = {0.0: "none slips", 1.0: "all slip"}.get(fraction, f"{percent(fraction)} slip")
    return f"Contacts, {'at the end' if data.frame == data.frames - 1 else f'frame {data.frame}'}: {words}"


@partial(Panel, "normal_force", 2.0, partial(_no_contacts, "normal_force"), half=True)
def _draw_normal_force(axes: Axes, data: RunData) -> str:
    forces = data.contacts["normal_force"]
    factor, unit = unit_for(forces, "N")
    values = forces / factor
    _draw_stacked(axes, data, values, min(float(values.min()), 0.0), max(float(values.max()), 0.0) or 1.0)
    axes.set_xlabel(f"normal force ({unit})")
    return f"{len(forces)} contact{'s' if len(forces) > 1 else ''}: mean {quantity_text(float(forces.mean()), 'N')}"
