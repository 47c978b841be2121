"""What cycles of load and shear do to the tangential memory, against the exact field without slip at the limit.

The exact field is that of the method of dimensionality reduction: springs side by side, each in contact while its place lies
within the contact radius, each forgetting when it leaves. It is written here anew, with numpy alone.
"""

import itertools
import math

import numpy as np
from each import each
from theory.spots import Spot
from thirdbody_three_spot import theory

from thirdbody.laws.coulomb import COULOMB, CoulombParameters
from thirdbody.laws.mindlin import MINDLIN, MindlinParameters

G_STAR = 0.5  # so that the stiffness 2 G* a is the contact radius
ENDLESS = 1e9  # a friction coefficient that never lets a spot slip


def exact(path, count=4000):
    """Tangential force over a path of (contact radius, displacement): `count` springs, G* = 1/2."""
    largest = max(a for a, _ in path)
    place, cell = (np.arange(count) + 0.5) * largest / count, largest / count
    stretched, forces = np.zeros(count), []
    for (_, before), (a, s) in itertools.pairwise(path):
        stretched = np.where(place < a, stretched + s - before, 0.0)
        forces.append(stretched.sum() * cell)
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


@each(PATHS)
def test_two_numbers_follow_the_exact_field(name):
    """The bounds are those of the trial in physics, section 18, rounded up; the rescaled force shows that the path is hard."""
    path, bound, without = PATHS[name]
    right = exact(path)
    errors = []
    for keeps in (1.0, 0.0):
        spot = Spot(MINDLIN, MindlinParameters(G_STAR, ENDLESS, 1.0, keeps))
        found = np.array([-spot.move(a * a, s - before).x for (_, before), (a, s) in itertools.pairwise(path)])
        errors.append(np.abs(found - right).max() / np.abs(right).max())
    assert errors[0] < bound and errors[1] > 0.9 * without


MU, E_STAR, RADIUS, OVERLAP = 0.3, 1.0, 1.0, 0.01


KAPPA = MU * E_STAR / 0.8
LEVELS = {
    "mindlin": (MINDLIN, MindlinParameters(0.8, MU, KAPPA, 1.0), 2.0 / 3.0 * KAPPA * OVERLAP),
    "coulomb": (COULOMB, CoulombParameters(MU, 1e-3, 0.8, 1.0), 1e-3 * RADIUS),
}


@each(list(itertools.product(LEVELS, (0.1, 0.5), (0.38, 0.7))))
def test_cycles_of_load_take_nothing_after_the_first(case):
    """Of a spot sheared to about a share of mu N and held there: forces at the mean load, once per cycle of the load."""
    (law, p, critical), swing, share = LEVELS[case[0]], *case[1:]
    spot, forces = Spot(law, p), []
    for _ in range(50):
        spot.move(OVERLAP, share * critical / 50.0)
    for k in range(1, 1001):
        answer = spot.move(OVERLAP * (1.0 + swing * math.sin(2.0 * math.pi * k / 100.0)) ** (2.0 / 3.0))
        if k % 100 == 0:
            forces.append(-answer.x / (MU * theory.hertz_force(E_STAR, RADIUS, OVERLAP)))
    assert forces[0] > 0.25 * share  # the first cycle may cut it at the least mu N, and takes the area that is lost
    assert np.abs(np.array(forces) / forces[0] - 1.0).max() < 1e-9  # rounding of 1000 steps
