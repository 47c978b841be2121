"""Friction and solid fraction of a bed over its inertial number: `python tests/bed_rheology.py SWEEP -o PICTURE`.

SWEEP is a finished sweep of scenes/sweeps/mu_of_inertia.toml. The bed of each point is sheared ever slower, and each speed
gives one state of shear. All is measured in the middle of the bed, more than 3.5 diameters from both plates, after the first
40 % of the distance at that speed."""

import argparse
from collections import namedtuple
from pathlib import Path

import numpy as np
import thirdbody
from thirdbody.palette import INK, LINE_COLORS

MARGIN, SKIPPED, SLOW = 3.5, 0.4, 0.05
"""Diameters that are left out at each plate; part of the distance at each speed that is left out; inertial number below which
friction and solid fraction are fitted by straight lines."""
REFERENCE = {0.0: (0.105, 0.636), 0.1: (0.268, 0.613), 0.3: (0.357, 0.596), 0.5: (0.382, 0.587), 1.0: (0.405, 0.581)}
"""Quasi-static friction and critical solid fraction by contact friction: homogeneous shear of spheres of one size, no plates
(Chialvo, Sun and Sundaresan 2012, Phys. Rev. E 85, 021305). Pressure is a third of the trace of the stress tensor."""
Shear = namedtuple(
    "Shear",
    "inertial_number plate_friction plate_friction_error bed_friction bed_friction_error solid_fraction solid_fraction_error "
    "pressure_ratio coordination overlap",
)
"""One state of shear. Friction of the plate is shear over normal force, of the bed shear stress over pressure; normal stress on
the plates over pressure; mean overlap over mean radius."""


def volume_below(height: float, z: np.ndarray, radius: np.ndarray) -> float:
    """Volume [m3] of spheres at heights z (n,) that is below a height."""
    depth = np.clip(height - z, -radius, radius)
    return float(np.sum(np.pi * (radius**2 * depth - depth**3 / 3.0 + 2.0 * radius**3 / 3.0)))


def core(run: thirdbody.Run, frame: int, area: float) -> tuple[np.ndarray, float, float, float, float]:
    """Return stress (3, 3) [Pa], shear rate [1/s], solid fraction, coordination and mean overlap [m] in the middle of a bed. The
    stress is the sum of force times branch over volume (Love and Weber)."""
    spheres, contacts = run.spheres(frame), run.contacts(frame)
    z, radius, diameter = spheres["position"][:, 2], spheres["radius"], 2.0 * np.median(spheres["radius"])
    low, high = MARGIN * diameter, run.series["gap"][frame] - MARGIN * diameter
    inside = (z > low) & (z < high)
    rate = np.polyfit(z[inside], spheres["velocity"][inside, 0], 1)[0]
    fraction = (volume_below(high, z, radius) - volume_below(low, z, radius)) / (area * (high - low))
    of_body = np.zeros(spheres["clump"].max() + 1)
    of_body[spheres["clump"]] = radius
    height = contacts["position"][:, 2]
    met = (contacts["side"] == 2) & (height > low) & (height < high)
    length = of_body[contacts["body"][met]] + of_body[contacts["partner"][met]] - contacts["overlap"][met]
    stress = contacts["force"][met].T @ (length[:, None] * contacts["normal"][met]) / (area * (high - low))
    return stress, rate, fraction, 2.0 * met.sum() / inside.sum(), contacts["overlap"][met].mean()


def error_of_mean(values: np.ndarray, blocks: int = 6) -> float:
    return float(np.std([block.mean() for block in np.array_split(values, blocks)], ddof=1) / np.sqrt(blocks))


def speeds(run: thirdbody.Run) -> list[np.ndarray]:
    """Return the frames at each speed of the upper plate, without those of the first part of the distance."""
    speed = np.diff(run.series["distance"]) / np.diff(run.times)
    steady = [k for k in range(2, run.frames - 1) if abs(speed[k - 1] / speed[k] - 1.0) < 1e-6]
    groups = np.split(np.array(steady), np.flatnonzero(np.abs(np.diff(speed[steady]) / speed[steady][:-1]) > 1e-3) + 1)
    return [group[round(SKIPPED * len(group)) :] for group in groups if len(group) > 8]


def shear(run: thirdbody.Run, frames: np.ndarray, area: float) -> Shear:
    stresses, rates, *rest = (np.array(values) for values in zip(*(core(run, k, area) for k in frames), strict=True))
    fractions, coordination, overlap = rest
    diameter = 2.0 * np.median(run.spheres(int(frames[0]))["radius"])
    body = run.bodies(int(frames[0]))
    density = np.median(body["mass"] / (np.pi / 6.0 * body["diameter"] ** 3))
    force = run.series["upper_force"][frames]
    pressure = force[:, 2].mean() / area
    stress, shares = stresses.mean(axis=0), (stresses[:, 2, 0] + stresses[:, 0, 2]) / 2.0
    mean = np.trace(stress) / 3.0
    inertia, friction = rates.mean() * diameter * np.sqrt(density / pressure), -force[:, 0].mean() / force[:, 2].mean()
    return Shear(*map(float, (
        inertia, friction, error_of_mean(-force[:, 0] / force[:, 2].mean()), abs(shares.mean()) / mean,
        error_of_mean(shares / mean), fractions.mean(), error_of_mean(fractions), stress[2, 2] / mean, coordination.mean(),
        overlap.mean() / (0.5 * diameter),
    )))  # fmt: skip


def measure(run: thirdbody.Run) -> list[Shear]:
    size = thirdbody.Scene.load(Path(run.path).parent / "scene.toml").domain.size
    return [shear(run, frames, size[0] * size[1]) for frames in speeds(run)]


Limit = namedtuple("Limit", "bed_friction plate_friction solid_fraction")  # values at vanishing inertial number and their errors


def limit(states: list[Shear]) -> Limit:
    """Straight lines over the inertial number at 0, weighted by the errors of the slow states."""
    slow = [state for state in states if state.inertial_number < SLOW]
    inertia = np.array([state.inertial_number for state in slow])

    def at_zero(name: str) -> tuple[float, float]:
        values = np.array([getattr(state, name) for state in slow])
        weights = 1.0 / np.array([getattr(state, f"{name}_error") for state in slow])
        line, covariance = np.polyfit(inertia, values, 1, w=weights, cov="unscaled")
        return float(line[1]), float(np.sqrt(covariance[1, 1]))

    return Limit(at_zero("bed_friction"), at_zero("plate_friction"), at_zero("solid_fraction"))


def read_sweep(folder: Path) -> dict[float, list[Shear]]:
    points = thirdbody.Sweep(folder).points
    return {float(point.values["pairs.0.friction"]): measure(point.run) for point in points}


def draw(found: dict[float, list[Shear]], path: Path) -> None:
    import matplotlib.pyplot as plt

    figure, (upper, lower) = plt.subplots(2, 1, figsize=(8.0, 7.0), sharex=True, layout="constrained")
    colors = [LINE_COLORS[name] for name in ("blue", "green", "orange", "vermilion", "purple")]
    for (friction, states), color in zip(sorted(found.items()), colors, strict=False):
        inertia = [state.inertial_number for state in states]
        for axes, name in ((upper, "bed_friction"), (lower, "solid_fraction")):
            values = [getattr(state, name) for state in states]
            errors = [getattr(state, f"{name}_error") for state in states]
            axes.errorbar(inertia, values, errors, fmt="o-", color=color, ms=5, lw=1, capsize=3, label=f"{friction:g}")
            axes.plot(2.5e-4, REFERENCE[friction][name == "solid_fraction"], "<", color=color, ms=9, mec=INK)
    upper.plot([], [], "<", color="white", ms=9, mec=INK, label="Chialvo et al. 2012, $I \\to 0$")
    upper.set(xscale="log", ylabel="friction: shear stress over pressure", xlim=(2e-4, 0.2))
    lower.set(xlabel="inertial number $I$", ylabel="solid fraction")
    handles, labels = upper.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=6, frameon=False, title="contact friction")
    figure.savefig(path, dpi=100)
    plt.close(figure)


def texts(found: dict[float, list[Shear]]) -> dict[str, str]:
    words = {}
    for friction, states in sorted(found.items()):
        zero, (theirs, fraction) = limit(states), REFERENCE[friction]
        bed, plate = (f"{value:.3f} ± {error:.3f}" for value, error in (zero.bed_friction, zero.plate_friction))
        solid = "{:.4f} ± {:.4f}".format(*zero.solid_fraction)
        both = f"friction of the bed {bed} (reference {theirs}), of the plate {plate}"
        words[f"contact friction {friction:g}"] = f"{both}; solid fraction {solid} (reference {fraction})"
    return words


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("sweep", type=Path)
    parser.add_argument("-o", dest="picture", type=Path, required=True)
    requested = parser.parse_args()
    measured = read_sweep(requested.sweep)
    print("\n".join(f"{name}: {words}" for name, words in texts(measured).items()))
    draw(measured, requested.picture)
