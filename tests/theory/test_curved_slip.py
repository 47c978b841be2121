"""Slip on curved paths: the laws of partial slip against 800 springs that return radially in very small steps.

The springs share nothing with the laws; two runs of them, extrapolated, give a path followed to 1e-6 of mu N."""

import functools
import math

import closed_forms
import numpy as np
import pytest
import three_spot_theory as theory
from numba import njit
from theory.exact_spot import D0, KAPPA, MU, E, G, R, circle
from thirdbody_three_spot.exact import NODES, exact
from thirdbody_three_spot.mdr import SpringParameters, springs
from thirdbody.laws.data import Contact, Load

pytestmark = pytest.mark.full(kind="slow")

COUNT, FINE, SEEN = 800, 32768, 32
"""Springs of the witness, its smaller number of steps, and the points of a path at which forces are compared."""


run_exact = njit(lambda c, load, p, h, w, w_new: exact(c, load, p, h, w, w_new), error_model="numpy")
run_springs = njit(lambda c, load, p, h, w, w_new: springs(c, load, p, h, w, w_new), error_model="numpy")


def wandering(seed, steps):
    """A smooth random path of overlap and slip, the slip on a curve of some critical displacements."""
    rng = np.random.default_rng(seed)
    size, phase, rate = rng.normal(size=(3, 2)) * np.array([[0.6], [0.36], [0.24]]), *rng.uniform(0.5, 2.5, (2, 3, 2))
    vary, start = rng.uniform(0.1, 0.5), rng.uniform(0.0, 6.0)
    t = np.linspace(0.0, 8.0, steps + 1)
    place = KAPPA * D0 * sum(a * (np.sin(f * t[:, None] + p) - np.sin(p)) for a, f, p in zip(size, rate, phase, strict=True))
    return D0 * (1.0 - vary * np.sin(0.7 * t + start) ** 2), np.diff(place, axis=0, prepend=place[:1])


PATHS = {f"circle of {share} s_c": (circle, share) for share in (0.5, 0.9, 1.5)}
PATHS |= {f"random path {seed}": (wandering, seed) for seed in range(4)}


@njit(error_model="numpy")
def returned(overlaps, slips, count, seen):
    """Forces at every `seen`-th point of a path; springs displaced, then put back onto their bounds."""
    width = math.sqrt(np.max(overlaps) * R) / count
    w, forces = np.zeros((count, 2)), np.zeros((len(overlaps) // seen, 2))
    for k in range(1, len(overlaps)):
        total = np.zeros(2)
        for i in range(count):
            gap = width * width * ((i + 0.5) ** 2 + 1.0 / 12.0) / R
            bound = max(KAPPA * (overlaps[k] - gap), 0.0)
            x, y = w[i, 0] + slips[k, 0], w[i, 1] + slips[k, 1]
            size = math.sqrt(x * x + y * y)
            back = bound / size if size > bound else 1.0
            w[i, 0], w[i, 1] = back * x, back * y
            total += w[i]
        if k % seen == 0:
            forces[k // seen - 1] = -2.0 * G * width * total
    return forces


@functools.cache
def witness(name):
    """Forces (SEEN, 2) of a path; the error of the method is of first order in the step, so it is extrapolated."""
    make, which = PATHS[name]
    coarse, fine = (returned(*make(which, n), COUNT, n // SEEN) for n in (FINE, 2 * FINE))
    return 2.0 * fine - coarse


def error(name, steps, nodes=0, count=0, scale=1.0):
    """Largest miss along a path of so many steps, over mu N, of `exact` with nodes or of `mdr` with a count of springs. `scale`
    of overlaps and slips changes nothing in theory; it moves the edge of the patch over the springs of `mdr`."""
    make, which = PATHS[name]
    law, h = (run_exact, (0.0,) * 8) if nodes else (run_springs, (0.0,) * 7)
    w, found = np.zeros(3 * nodes + 2 * count), []
    for d, slip in zip(*(scale * one for one in make(which, steps)), strict=True):
        n, w_new = theory.hertz_force(E, R, d), np.zeros(len(w))
        load = Load(n, n, theory.contact_radius(R, d), closed_forms.hertz_stiffness(E, R, d), 0.0)
        contact = Contact(d, R, 1.0, 0.0, slip[0], slip[1], 0.0, 0.0, 0.0, 0.0)
        answer, h = law(contact, load, SpringParameters(G, MU, KAPPA, 0.0), h, w, w_new)
        w = w_new
        found.append((answer.x, answer.y))
    miss = np.array(found)[steps // SEEN :: steps // SEEN] / scale**1.5 - witness(name)
    return float(np.linalg.norm(miss, axis=1).max()) / (MU * theory.hertz_force(E, R, D0))


@pytest.mark.parametrize("name", PATHS)
def test_orders_in_the_step(name):
    errors = [error(name, steps, nodes=256) for steps in (64, 256, 1024)]
    # 16 times less at order 2; where a spring begins to slide within a step, some of that is lost; cells add 5e-6
    assert errors[1] < errors[0] / 9.0 and errors[2] < errors[1] / 9.0 + 5e-6
    assert errors[2] < 1e-4
    # what its cells add falls with the square of their number
    few, default, many = (error(name, 4096, nodes=nodes) for nodes in (24, int(NODES.default), 192))
    assert default < 2e-4  # as the law says
    assert few < 8e-4 and many < 2e-5  # four times as much, and a sixteenth with what 4096 steps leave
    # `mdr` is of first order in the step, down to what its springs cost
    coarse, fine = (error(name, steps, count=256) for steps in (512, 2048))
    assert fine < coarse / 3.0 + 5e-5  # 4 times less at order 1; 256 springs carry the patch


OVERLAPS = [*np.geomspace(1e-3, 1e-2, 60), 0.00233]
"""Over R: the edge of the patch lies anywhere between springs twice (the grid repeats at four times the overlap), and the worst
of 300 places."""


@pytest.mark.parametrize("name", PATHS)
def test_springs_at_any_overlap(name):
    for steps, worst in ((1024, 7e-3), (4096, 2.2e-3), (8192, 2.2e-3)):  # measured 6.2e-3, of the steps; 2.0e-3; 2.0e-3
        errors = [error(name, steps, count=32, scale=d / D0) for d in OVERLAPS]
        assert max(errors) < worst and (steps < 8192 or np.median(errors) < 8e-4)  # measured 6.8e-4; of all paths 3.5e-4
