"""The tangent of the level `exact` off an axis, with dashpots and rolling: against differences of its own step, and closed forms.

Lengths in units of the radius, E* = 1.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import closed_forms
import numpy as np
import pytest
from numba import njit
from thirdbody_three_spot import theory
from thirdbody_three_spot.exact import NODES, ExactParameters, exact, exact_tangent

from thirdbody.laws.kernel_data import Contact, Load

E_STAR, G_STAR, RADIUS, MU = 1.0, 0.8, 1.0, 0.3
OVERLAP = 0.01
WIDTH = 3 * int(NODES.default)
CRITICAL = MU * E_STAR / G_STAR * OVERLAP
STEPS = (1e-5, 1e-6, 1e-7)
"""Of the differences, over the overlap and the critical displacement: nodes come and go, so the best of some counts."""


@njit(error_model="numpy")
def law(c, load, p, h, w, w_new):
    return exact(c, load, p, h, w, w_new)


@njit(error_model="numpy")
def law_tangent(c, load, p, h, w):
    return exact_tangent(c, load, p, h, w)


class Step(NamedTuple):
    """What moves a contact: overlap at its end, slip, way of the patch, and the dashpot (a share of the spring, and newtons)."""

    overlap: float
    x: float = 0.0
    y: float = 0.0
    roll: float = 0.0
    share: float = 0.0
    viscous: float = 0.0


class Spot:
    """One contact and its memory."""

    def __init__(self, mu: float = MU):
        self.p = ExactParameters(G_STAR, mu, mu * E_STAR / G_STAR, 2.0)
        self.h, self.w = (0.0,) * 8, np.zeros(WIDTH)

    def evaluate(self, step: Step):
        """Arguments of the law and of its tangent."""
        elastic = theory.hertz_force(E_STAR, RADIUS, step.overlap)
        stiffness = (1.0 + step.share) * closed_forms.hertz_stiffness(E_STAR, RADIUS, step.overlap)
        a, force = theory.contact_radius(RADIUS, step.overlap), (1.0 + step.share) * elastic + step.viscous
        contact = Contact(step.overlap, RADIUS, 1.0, 0.0, step.x, step.y, 0.0, 0.0, step.roll, 0.0)
        return contact, Load(force, elastic, a, stiffness, 0.0), self.p, self.h, self.w

    def move(self, *steps: Step):
        for step in steps:
            w_new = np.empty(WIDTH)
            _, self.h = law(*self.evaluate(step), w_new)
            self.w = w_new

    def force(self, step: Step) -> np.ndarray:
        answer, _ = law(*self.evaluate(step), np.empty(WIDTH))
        return np.array([answer.x, answer.y])

    def tangent(self, step: Step) -> np.ndarray:
        """Columns: over slip x, slip y, overlap."""
        xx, xy, yx, yy, xd, yd = law_tangent(*self.evaluate(step))
        return np.array([[xx, xy, xd], [yx, yy, yd]])


def miss(spot: Spot, step: Step) -> float:
    """Largest miss of the tangent in parts of 2 G* a, against the best of the differences."""
    got, found = spot.tangent(step), []
    for size in STEPS:
        columns = []
        for name, unit in (("x", CRITICAL), ("y", CRITICAL), ("overlap", OVERLAP)):
            e = size * unit
            ahead, behind = (spot.force(step._replace(**{name: getattr(step, name) + s * e})) for s in (1.0, -1.0))
            columns.append((ahead - behind) / (2.0 * e))
        found.append(float(np.abs(np.column_stack(columns) - got).max()))
    return min(found) / (2.0 * G_STAR * theory.contact_radius(RADIUS, step.overlap))


def somewhere(rng, size: float, **more: float) -> Step:
    """A random step in the plane; slip of this size over the critical displacement."""
    return Step(rng.uniform(0.3, 1.2) * OVERLAP, *(rng.normal(size=2) * size * CRITICAL), **more)


def corner_path(rng, size: float, **more: float) -> tuple[Spot, Step]:
    """Some long steps in all directions, and the one to look at."""
    spot = Spot()
    spot.move(*(somewhere(rng, 0.3) for _ in range(4)))
    return spot, somewhere(rng, size, **more)


def curved_path(rng, size: float, **more: float) -> tuple[Spot, Step]:
    """Forty small steps along a curve in the plane, with an overlap that varies, and the next one."""
    spot, phase, places = Spot(), rng.uniform(0.0, 6.0, 3), []
    for i in range(41):
        t = 0.05 * i
        place = size * CRITICAL * np.array([math.sin(t + phase[0]), math.sin(1.3 * t + phase[1])])
        places.append((OVERLAP * (0.7 + 0.3 * math.sin(0.7 * t + phase[2])), place))
    steps = [Step(d, *(there - before)) for (_, before), (d, there) in zip(places[:-1], places[1:], strict=True)]
    spot.move(Step(places[0][0]), *steps[:-1])
    return spot, steps[-1]._replace(**more)


DAMPED = [{}, {"share": 0.3}, {"viscous": 2e-4}, {"share": -0.2, "viscous": 1e-4}, {"roll": 0.01, "share": 0.3}]
"""`share` scales the elastic force, so that the bound of a spring is constant; `viscous` does not, so that it moves."""


@pytest.mark.parametrize("more", DAMPED)
@pytest.mark.parametrize("size", [0.02, 0.3, 5.0])
@pytest.mark.parametrize("path", [corner_path, curved_path])
def test_agrees_with_differences_off_an_axis(path, size, more):
    rng = np.random.default_rng(5)
    misses = [miss(*path(rng, size, **more)) for _ in range(40)]
    # both are differences, which keep 1e-10; where nodes come and go the force jumps by 1e-6, and rare ones differ by anything
    assert np.median(misses) < 1e-8
    assert np.quantile(misses, 0.9) < 1e-4


@pytest.mark.parametrize("share", [0.2, 0.5, 0.9])
def test_the_virgin_patch(share):
    """Along the slip 2 G* c with the stick radius c (Cattaneo), across it the secant of the force; here at an angle."""
    spot, e, across = Spot(), np.array([0.6, 0.8]), np.array([-0.8, 0.6])
    spot.move(Step(OVERLAP))
    slip, limit = share * CRITICAL, MU * theory.hertz_force(E_STAR, RADIUS, OVERLAP)
    tangent = spot.tangent(Step(OVERLAP, *(slip * e)))[:, :2]
    full = 2.0 * G_STAR * theory.contact_radius(RADIUS, OVERLAP)
    assert e @ tangent @ e == pytest.approx(-full * math.sqrt(1.0 - share), rel=1e-6)  # of the differences
    secant = closed_forms.mindlin_loading(slip, limit, CRITICAL) / slip
    assert across @ tangent @ across == pytest.approx(-secant, rel=1e-6)
    assert abs(e @ tangent @ across) < 1e-6 * full


@pytest.mark.parametrize("damped", [0.0, 0.3])
def test_full_sliding(damped):
    """T = -mu N e: nothing along the slip, mu N/|s| across it, and mu dN/dd with the overlap; N with the dashpot."""
    spot, e, across, path = Spot(), np.array([0.6, 0.8]), np.array([-0.8, 0.6]), 50.0 * CRITICAL
    spot.move(Step(OVERLAP))
    tangent = spot.tangent(Step(OVERLAP, *(path * e), share=damped))
    slope = (1.0 + damped) * MU * closed_forms.hertz_stiffness(E_STAR, RADIUS, OVERLAP)
    limit = (1.0 + damped) * MU * theory.hertz_force(E_STAR, RADIUS, OVERLAP)
    assert tangent[:, 2] == pytest.approx(-slope * e, rel=1e-6)  # of the differences
    assert across @ tangent[:, :2] @ across == pytest.approx(-limit / path, rel=1e-6)
    assert np.abs(tangent[:, :2] @ e).max() < 1e-6 * limit / CRITICAL


def test_first_touch_and_after_a_gap():
    """The slip is shared over the overlap; of a step that began apart the part before touch is lost."""
    rng, misses = np.random.default_rng(4), []
    for overlap in (0.0, -0.5 * OVERLAP):
        for size in (0.02, 0.3, 5.0):
            for _ in range(10):
                spot = Spot()
                spot.h = (overlap,) + (0.0,) * 7
                misses.append(miss(spot, somewhere(rng, size, share=0.3)))
    assert max(misses) < 1e-7  # rounding of the differences


def test_without_friction_and_without_touch():
    """No friction, a dashpot that takes all load, or no touch: no stiffness, and no division by zero."""
    for step in (Step(OVERLAP), Step(1.3 * OVERLAP, CRITICAL, -CRITICAL, 0.01)):
        spot = Spot(0.0)
        spot.move(Step(OVERLAP, CRITICAL))
        assert np.all(spot.tangent(step) == 0.0)
        spot = Spot()
        spot.move(Step(OVERLAP, 0.3 * CRITICAL, 0.2 * CRITICAL))
        contact, load, p, h, w = spot.evaluate(step)
        assert law_tangent(contact, load._replace(force=0.0, stiffness=0.0), p, h, w) == (0.0,) * 6
        assert law_tangent(contact._replace(overlap=-OVERLAP), Load(0.0, 0.0, 0.0, 0.0, 0.0), p, h, w) == (0.0,) * 6
