"""The label that `balance` gives a random particle at the end of its path is that of a slow run at the same drag.

A run has inertia: a particle that snaps over may land in another seat than the one that it turns into without, so 5 % may differ.
One that `balance` stops has no static state on its way: no label is left to compare there, and the run must roll. Level
`mindlin`, whose patches renew in neither.
"""

from __future__ import annotations

import numpy as np
import pytest
from random_particles import clump, planar
from thirdbody_three_spot.balance import balance

import thirdbody

pytestmark = pytest.mark.full(kind="hard")

LOAD, DRAG, EVERY = 1e-4, 1.6e-6, 20e-9  # the drag is two to three windows of a clump, and more of a planar particle
ALIKE = 0.95
SOLID = {"shear_modulus": 80e9, "poisson_ratio": 0.3}
SCENE = {
    "scene": 1,
    "materials": {"solid": SOLID | {"density": 4000.0}},
    "domain": {"size": ["60 um", "60 um"]},
    "plates": {
        "lower": {"material": "solid"},
        "upper": {
            "material": "solid",
            "support": "load_per_particle",
            "load": LOAD,
            "motion": {"x": {"velocity": "-0.01 m/s"}},  # an inertial number of some 1e-3
        },
    },
    "contact": {"level": "mindlin", "debris_contact": "none"},
    "solver": {"integrator": "implicit", "distance": DRAG},
    "output": {"every": EVERY, "every_kind": "distance"},
}


def labels_of_balance(particle, mu):
    """Label at every multiple of `EVERY`, as far as the path goes; and whether it goes to the end."""
    path = {"load": LOAD, "drag": DRAG, "steps": 4 * round(DRAG / EVERY), "direction": (-1.0, 0.0)}
    tables = {"materials": {side: SOLID for side in ("upper", "lower", "particle")}, "friction": {"upper": mu, "lower": mu}}
    result = balance(tables | {"particle": particle, "path": path}, "mindlin")
    assert result.stopped is None or result.stopped.label == "rolling"
    return [point.label for point in result.points[::4]], result.stopped is None


def labels_of_run(debris, mu, folder):
    """Label by the number of intervals `EVERY` of drag."""
    pairs = [{"between": ["solid", "solid"], "friction": mu, "restitution": 0.6}]
    scene = thirdbody.Scene(**SCENE, pairs=pairs, debris=[{"material": "solid"} | debris])
    with thirdbody.run(scene, out=folder / "run", overwrite=True, threads=1, progress=False) as run:
        steps = np.rint(run.series["distance"] / EVERY).astype(int)
        return {int(k): run.state_names[state] for k, state in zip(steps, run.states[:, 0], strict=True)}


def alike(particle, debris, mu, folder):
    here, whole = labels_of_balance(particle, mu)
    there = labels_of_run(debris, mu, folder)
    if not whole:
        return "rolling" in [there[k] for k in there if k >= len(here) - 1]
    return here[-1] == there[len(here) - 1]


def test_planar_particles(tmp_path):
    different = []
    for seed in range(40):
        spots, mu = planar(seed)
        debris = {"kind": "spots", "planar": True, "spots": spots, "mass": 1e-13, "inertia": 2e-25}
        if not alike({"spots": spots}, debris, mu, tmp_path):
            different.append(seed)
    assert len(different) <= (1.0 - ALIKE) * 40, different


def test_clumps(tmp_path):
    different = []
    for seed in range(80):
        centers, radii, mu = clump(seed)
        balls = [{"center": tuple(map(float, c)), "radius": float(r)} for c, r in zip(centers, radii, strict=True)]
        placed = centers - [-30e-6, -30e-6, (centers[:, 2] - radii).min()]
        file = tmp_path / "clump.npz"
        np.savez(file, center=placed, radius=radii, clump=np.zeros(len(radii), int))
        if not alike({"clump": balls}, {"kind": "file", "file": str(file)}, mu, tmp_path):
            different.append(seed)
    assert len(different) <= (1.0 - ALIKE) * 80, different
