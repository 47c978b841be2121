"""What cycles of load and shear do to the tangential memory, against the exact field without slip at the limit.

The exact field is that of the method of dimensionality reduction: springs side by side, each in contact while its place lies
within the contact radius, each forgetting when it leaves. It is written here anew, with numpy alone.
"""

from __future__ import annotations

import math

import numpy as np
import pytest
from thirdbody_three_spot import theory

from thirdbody.laws.coulomb import COULOMB, CoulombParameters
from thirdbody.laws.kernel_data import Contact, Load
from thirdbody.laws.mindlin import MINDLIN, MindlinParameters

G_STAR = 0.5  # so that the stiffness 2 G* a is the contact radius
ENDLESS = 1e9
"""A friction coefficient that never lets a spot slip."""


def exact(path, count=4000):
    """Tangential force over a path of (contact radius, displacement): `count` springs, G* = 1/2."""
    largest = max(a for a, _ in path)
    place, cell = (np.arange(count) + 0.5) * largest / count, largest / count
    stretched, forces, before = np.zeros(count), [], path[0][1]
    for a, s in path[1:]:
        inside = place < a
        stretched[inside] += s - before
        stretched[~inside] = 0.0
        forces.append(stretched.sum() * cell)
        before = s
    return np.array(forces)


def answered(path, keeps):
    """The force that `mindlin` gives on the same path."""
    p, memory, forces = MindlinParameters(G_STAR, ENDLESS, 1.0, keeps), (0.0, 0.0, 0.0), []
    before = path[0][1]
    for a, s in path[1:]:
        touch = Contact(1.0, 1.0, 1.0, 0.0, s - before, 0.0, 0.0, 0.0, 0.0, 0.0)
        t, memory = MINDLIN.kernel(touch, Load(1.0, 1.0, a, 0.0, 0.0), p, memory)
        forces.append(-t.x)
        before = s
    return np.array(forces)


def cycles(swing, count, shear, pieces=200):
    """Contact radius about 1 and displacement, `shear` of the number of cycles done, after loading to 1 at fixed load."""
    loading = [(1.0, s) for s in np.linspace(0.0, 1.0, pieces)]
    done = np.linspace(0.0, count, pieces * count)
    return loading + [(1.0 + swing * math.sin(2.0 * math.pi * u), shear(u)) for u in done]


PATHS = {
    # path, largest error of two numbers and of the rescaled force, of the largest force (physics: tangential memory)
    "40 cycles of load, shear held": (cycles(0.05, 40, lambda u: 1.0), 1e-3, 0.93),
    "10 large cycles of load, shear held": (cycles(0.25, 10, lambda u: 1.0), 1e-3, 0.74),
    "slow shear": (cycles(0.1, 10, lambda u: 1.0 + u / 10.0), 0.06, 0.69),
    "shear that turns round": (cycles(0.1, 20, lambda u: 1.0 + math.sin(0.26 * math.pi * u)), 0.15, 0.60),
    "shear in phase": ([(1.0 + 0.3 * math.sin(u), math.sin(u)) for u in np.linspace(0.0, 10.0 * math.pi, 2000)], 0.03, 0.16),
    "out of phase": ([(1.0 + 0.3 * math.sin(u), math.cos(u) - 1.0) for u in np.linspace(0.0, 10.0 * math.pi, 2000)], 0.06, 0.07),
}


@pytest.mark.parametrize("name", PATHS)
def test_two_numbers_follow_the_exact_field(name):
    """The bounds are those of the trial in physics, section 18, rounded up; the rescaled force shows that the path is hard."""
    path, bound, without = PATHS[name]
    right = exact(path)
    errors = [np.abs(answered(path, keeps) - right).max() / np.abs(right).max() for keeps in (1.0, 0.0)]
    assert errors[0] < bound
    assert errors[1] > 0.9 * without


MU, E_STAR, RADIUS, OVERLAP = 0.3, 1.0, 1.0, 0.01


def driven(level, swing, count, share):
    """Forces at the mean load, once per cycle of the load, of a spot sheared to about `share` of mu N and held there."""
    law, p = {
        "mindlin": (MINDLIN, MindlinParameters(0.8, MU, MU * E_STAR / 0.8, 1.0)),
        "coulomb": (COULOMB, CoulombParameters(MU, 1e-3, 0.8, 1.0)),
    }[level]
    critical = {"mindlin": 0.5 * MU * E_STAR / 0.8 * OVERLAP * 4.0 / 3.0, "coulomb": 1e-3 * RADIUS}[level]
    memory, forces = (0.0, 0.0, 0.0), []
    slips = [share * critical / 50.0] * 50 + [0.0] * (100 * count)
    phases = [0.0] * 50 + [2.0 * math.pi * (k + 1) / 100.0 for k in range(100 * count)]
    for k, (slip, phase) in enumerate(zip(slips, phases, strict=True)):
        force = theory.hertz_force(E_STAR, RADIUS, OVERLAP) * (1.0 + swing * math.sin(phase))
        overlap = (force / (4.0 / 3.0 * E_STAR * math.sqrt(RADIUS))) ** (2.0 / 3.0)
        touch = Contact(overlap, RADIUS, 1.0, 0.0, slip, 0.0, 0.0, 0.0, 0.0, 0.0)
        t, memory = law.kernel(touch, Load(force, force, theory.contact_radius(RADIUS, overlap), 0.0, 0.0), p, memory)
        if k >= 50 and (k - 49) % 100 == 0:
            forces.append(-t.x / (MU * force))
    return np.array(forces)


@pytest.mark.parametrize("level", ["mindlin", "coulomb"])
@pytest.mark.parametrize("swing, share", [(0.1, 0.38), (0.1, 0.7), (0.5, 0.38), (0.5, 0.7)])
def test_cycles_of_load_take_nothing_after_the_first(level, swing, share):
    forces = driven(level, swing, 40, share)
    assert forces[0] > 0.25 * share  # the first cycle may cut it at the least mu N, and takes the area that is lost
    assert np.abs(forces / forces[0] - 1.0).max() < 1e-9  # rounding of 4000 steps
