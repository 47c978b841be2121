"""A sweep of scenes/sweeps/shape_against_friction.toml over the closed form: `python tests/shape_map.py SWEEP -o PICTURE`.

A rigid ellipse of axial ratio r < 1 between parallel plates turns until the line through its two contacts leans by the friction
coefficient mu. Its largest lean is (1/r - r)/2, at tan(tilt) = r; so it slides where mu is at most that, and rolls above."""

import argparse
import math
from collections import namedtuple
from pathlib import Path

import numpy as np
import thirdbody
from thirdbody.debris.spheroid import corrugation
from thirdbody.palette import INK, STATE_COLORS

ROLLING, FRICTION, RATIO = "fraction_rolling", "pairs.0.friction", "debris.0.axial_ratio"
SPHERES = 40  # of each particle


def closed_form(friction: np.ndarray) -> np.ndarray:
    """Return the axial ratio up to which a rigid ellipse slides."""
    return np.sqrt(1.0 + friction**2) - friction


Map = namedtuple("Map", "friction ratio rolls")
"""States over two axes: frictions (m,) and axial ratios (n,), rising, and whether a particle rolls (m, n)."""


def read_map(folder: Path) -> Map:
    table = thirdbody.Sweep(folder).to_pandas()
    assert (table["status"] == "done").all()
    rolling = table.pivot(index=FRICTION, columns=RATIO, values=ROLLING)
    assert rolling.isin((0.0, 1.0)).all(axis=None)
    return Map(rolling.index.to_numpy(float), rolling.columns.to_numpy(float), rolling.to_numpy() == 1.0)


def boundary(found: Map) -> np.ndarray:
    """Return the axial ratio (m,) between the last particle that slides and the first that rolls; each row changes once."""
    assert np.all((found.rolls[:, :1] == 0) & found.rolls[:, -1:]) and np.all(np.diff(found.rolls.astype(int), axis=1) >= 0)
    first = found.rolls.argmax(axis=1)
    return np.sqrt(found.ratio[first - 1] * found.ratio[first])


def corrugation_text(found: Map) -> str:
    height, angle = np.max([corrugation("prolate", ratio, SPHERES) for ratio in found.ratio if ratio < 1.0], axis=0)
    size, normals = f"{100.0 * height:.2g} % of its size", f"{math.degrees(angle):.2g} deg of its normals"
    return f"{SPHERES} spheres follow the spheroid to {size} and {normals}"


def draw(found: Map, path: Path) -> None:
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(figsize=(8.0, 5.0), layout="constrained")
    friction, ratio = np.meshgrid(found.friction, found.ratio, indexing="ij")
    for state, name, label in ((~found.rolls, "sliding", "slides"), (found.rolls, "rolling", "rolls")):
        axes.scatter(friction[state], ratio[state], s=14, color=STATE_COLORS[name], label=label, linewidths=0)
    curve = np.geomspace(0.045, 1.1, 200)
    axes.plot(curve, closed_form(curve), color=INK, label="rigid ellipse: $r = \\sqrt{1 + \\mu^2} - \\mu$")
    axes.set(xscale="log", yscale="log", xlim=(0.045, 1.1), ylim=(0.34, 1.03))
    axes.set(xlabel="friction coefficient", ylabel="axial ratio")
    axes.set_xticks(ticks := [0.05, 0.1, 0.2, 0.5, 1.0], [f"{tick:g}" for tick in ticks], minor=False)
    axes.set_yticks(ticks := [0.35, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0], [f"{tick:g}" for tick in ticks], minor=False)
    axes.minorticks_off()
    figure.legend(loc="outside upper center", ncols=3, frameon=False)
    figure.savefig(path, dpi=100)
    plt.close(figure)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("sweep", type=Path)
    parser.add_argument("-o", dest="picture", type=Path, required=True)
    requested = parser.parse_args()
    draw(read_map(requested.sweep), requested.picture)
