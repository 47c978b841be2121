"""The tangent of the level `mdr`: against differences of its own step on random histories, and against Cattaneo and Mindlin."""

from __future__ import annotations

import math
from typing import NamedTuple

import closed_forms
import numpy as np
import pytest
from thirdbody_three_spot import mdr, theory

from thirdbody.laws.kernel_data import Contact, Load

E_STAR, G_STAR, RADIUS, MU = 1.0, 0.8, 1.0, 0.3
OVERLAP = 0.01
CRITICAL = MU * E_STAR / G_STAR * OVERLAP
STEPS = (1e-6, 1e-7)
"""Of the differences, over the overlap and the critical displacement: 1e-10 (1e-9) of rounding, 1e-12 of smooth curvature. The
smaller one serves where a weak corner, of a spring with a small share of the force, lies within the other."""


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

    def __init__(self, springs: int = 32, mu: float = MU):
        self.p = mdr.SpringParameters(G_STAR, mu, mu * E_STAR / G_STAR, 2.0)
        self.h, self.w = (0.0,) * 7, np.zeros(2 * springs)

    def evaluate(self, step: Step):
        """Arguments of the law and of its tangent."""
        elastic = theory.hertz_force(E_STAR, RADIUS, step.overlap)
        stiffness = (1.0 + step.share) * closed_forms.hertz_stiffness(E_STAR, RADIUS, step.overlap)
        a, force = theory.contact_radius(RADIUS, step.overlap), (1.0 + step.share) * elastic + step.viscous
        contact = Contact(step.overlap, RADIUS, 1.0, 0.0, step.x, step.y, 0.0, 0.0, step.roll, 0.0)
        return contact, Load(force, elastic, a, stiffness, 0.0), self.p, self.h, self.w

    def move(self, *steps: Step):
        for step in steps:
            w_new = np.empty_like(self.w)
            answer, self.h = mdr.springs(*self.evaluate(step), w_new)
            self.w = w_new
        return answer

    def force(self, step: Step) -> np.ndarray:
        answer, _ = mdr.springs(*self.evaluate(step), np.empty_like(self.w))
        return np.array([answer.x, answer.y])

    def tangent(self, step: Step) -> np.ndarray:
        """Columns: over slip x, slip y, overlap."""
        xx, xy, yx, yy, xd, yd = mdr.springs_tangent(*self.evaluate(step))
        return np.array([[xx, xy, xd], [yx, yy, yd]])

    def scales(self, step: Step) -> np.ndarray:
        """Sizes of the columns: 2 G* a, and that times kappa (the rate of the limit), or times the slip over the overlap."""
        patch = 2.0 * G_STAR * theory.contact_radius(RADIUS, step.overlap)
        return patch * np.array([1.0, 1.0, min(self.p.kappa, math.hypot(step.x, step.y) / step.overlap + 0.1)])


def differences(spot: Spot, step: Step, size: float) -> tuple[np.ndarray, np.ndarray]:
    """Central differences of the force over steps of this size, and how far the one-sided ones lie apart: at corners they do."""
    central, apart, here = [], [], spot.force(step)
    for name, unit in (("x", min(spot.p.kappa, 1.0)), ("y", min(spot.p.kappa, 1.0)), ("overlap", 1.0)):
        e = size * max(unit, 1e-3) * step.overlap
        ahead = spot.force(step._replace(**{name: getattr(step, name) + e}))
        behind = spot.force(step._replace(**{name: getattr(step, name) - e}))
        central.append((ahead - behind) / (2.0 * e))
        apart.append((ahead - 2.0 * here + behind) / e)
    return np.column_stack(central), np.abs(np.column_stack(apart))


def compare(spot: Spot, step: Step) -> float:
    """Largest miss over the size of its column; NaN at a corner."""
    misses = []
    for size in STEPS:
        expected, apart = differences(spot, step, size)
        corner = np.any(apart > 1e-4 * spot.scales(step))
        misses.append(math.nan if corner else float((np.abs(expected - spot.tangent(step)) / spot.scales(step)).max()))
    return misses[0] if math.isnan(misses[0]) else float(np.nanmin(misses))


def somewhere(rng, size: float, low: float, high: float, **more: float) -> Step:
    """A random step: slip of this size over the critical displacement, overlap within these bounds over the usual."""
    return Step(rng.uniform(low, high) * OVERLAP, *(rng.normal(size=2) * size * CRITICAL), **more)


KINDS = {
    "stick": (0.01, 0.95, 1.05),
    "partial slip": (0.3, 0.8, 1.2),
    "full slip": (5.0, 0.5, 2.0),
    "growing, with merges": (0.3, 1.2, 40.0),
    "growing and turning in full slip": (60.0, 2.0, 40.0),
    "shrinking": (0.3, 0.05, 0.7),
}


def misses_of(kind: str, springs: int, mu: float, **more: float) -> np.ndarray:
    """What `compare` finds, (40,): of 40 random steps after random histories in the plane."""
    rng, found = np.random.default_rng(11), []
    for _ in range(40):
        spot = Spot(springs, mu)
        spot.move(*(somewhere(rng, 0.3, 0.7, 1.3) for _ in range(3)))
        found.append(compare(spot, somewhere(rng, *KINDS[kind], **more)))
    return np.array(found)


EXACT = 3e-9
"""Rounding of the differences is 1e-10 of a column's size for one step, some springs that are short of a corner add to that."""


def agree(misses) -> None:
    assert np.nanmax(misses) < EXACT
    assert np.isnan(misses).sum() <= 2, "corners are rare"


@pytest.mark.parametrize("springs", [4, 6, 32])
@pytest.mark.parametrize("kind", KINDS)
def test_agrees_with_differences(kind, springs):
    agree(misses_of(kind, springs, MU))


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(
    "more", [{"roll": 0.03}, {"share": 0.4}, {"viscous": 2e-4}, {"viscous": -1e-4}, {"roll": 0.1, "share": -0.2, "viscous": 1e-4}]
)
def test_rolling_and_dashpots(kind, more):
    """`share` scales the elastic force, so that the bound of a spring is constant; `viscous` does not, so that it moves."""
    agree(misses_of(kind, 16, MU, **more))


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("mu", [1e-6, 1e9])
def test_with_little_friction_and_a_great_deal(kind, mu):
    agree(misses_of(kind, 32, mu))


@pytest.mark.parametrize("step", [Step(OVERLAP), Step(1.3 * OVERLAP, CRITICAL, -CRITICAL, 0.01), Step(30.0 * OVERLAP, CRITICAL)])
def test_without_friction(step):
    spot = Spot(32, 0.0)
    spot.move(Step(OVERLAP, CRITICAL))
    assert np.all(spot.tangent(step) == 0.0)


def test_first_touch():
    """A virgin contact takes the grid of the overlap at once; the slip is shared over the overlap."""
    rng, misses = np.random.default_rng(4), []
    for size in (0.01, 0.3, 5.0):
        misses += [compare(Spot(springs), somewhere(rng, size, 0.1, 3.0)) for springs in (4, 16, 32) for _ in range(10)]
    agree(misses)


def test_after_a_gap():
    """A negative overlap before the step: the part of the slip before touch is lost."""
    rng, misses = np.random.default_rng(6), []
    for _ in range(30):
        spot = Spot(16)
        spot.h = (-0.5 * OVERLAP, 200.0, 0.0, 0.0, 0.0, 0.0, 0.0)
        misses.append(compare(spot, somewhere(rng, 0.5, 0.1, 2.0)))
    agree(misses)


@pytest.mark.parametrize("share", [0.2, 0.5, 0.9])
def test_the_virgin_patch(share):
    """Along the slip 2 G* c with the stick radius c (Cattaneo), across it the secant of the force."""
    spot = Spot(512)
    spot.move(Step(OVERLAP))
    a = theory.contact_radius(RADIUS, OVERLAP)
    tangent = spot.tangent(Step(OVERLAP, share * CRITICAL))
    # 256 to 512 springs carry the patch; the edge of the stick area falls somewhere in one of them
    assert tangent[0, 0] == pytest.approx(-2.0 * G_STAR * a * math.sqrt(1.0 - share), abs=2.0 * G_STAR * a / 256)
    # across it the springs turn, and the force with them: T_y = T_x s_y/s_x
    limit, slip = MU * theory.hertz_force(E_STAR, RADIUS, OVERLAP), share * CRITICAL
    secant = closed_forms.mindlin_loading(slip, limit, CRITICAL) / slip
    assert tangent[1, 1] == pytest.approx(-secant, rel=1e-4)  # the force of 256 springs, 6e-6, and the edge of the patch
    assert tangent[0, 1] == tangent[1, 0] == 0.0


def test_full_sliding():
    """T = -mu N e: nothing along the slip, mu N/|s| across it, and mu dN/dd with the overlap."""
    spot, angle = Spot(256), 0.7
    spot.move(Step(OVERLAP))
    e, across = np.array([math.cos(angle), math.sin(angle)]), np.array([-math.sin(angle), math.cos(angle)])
    path = 50.0 * CRITICAL
    tangent = spot.tangent(Step(OVERLAP, *(path * e)))
    slope, limit = MU * closed_forms.hertz_stiffness(E_STAR, RADIUS, OVERLAP), MU * theory.hertz_force(E_STAR, RADIUS, OVERLAP)
    # every spring under the patch adds 2 G* kappa spacing: 128 springs and more, of which the last is in or out
    assert tangent[:, 2] @ e == pytest.approx(-slope, rel=0.5 / 128)
    # their sum falls short of mu N by 1.5 (spacing/2a)^2 < 3e-5
    assert across @ tangent[:, :2] @ across == pytest.approx(-limit / path, rel=1e-4)
    # along the slip: roundings of a stiffness 2 G* a
    assert np.abs(tangent[:, :2] @ e).max() < 1e-12 * limit / CRITICAL


@pytest.mark.parametrize("overlap", [0.0, -0.5 * OVERLAP])
def test_open(overlap):
    """No touch, no stiffness, and no division by the overlap."""
    spot = Spot(16)
    spot.move(Step(OVERLAP, 0.5 * CRITICAL))
    contact, load, p, h, w = spot.evaluate(Step(OVERLAP, 0.1 * CRITICAL, 0.2 * CRITICAL, 0.01))
    given = mdr.springs_tangent(contact._replace(overlap=overlap), Load(0.0, 0.0, 0.0, 0.0, 0.0), p, h, w)
    assert given == (0.0,) * 6


def test_a_dashpot_that_pulls_leaves_no_friction():
    """The load on friction is cut at zero, and with it its stiffness."""
    spot = Spot(16)
    spot.move(Step(OVERLAP, 0.5 * CRITICAL))
    contact, load, p, h, w = spot.evaluate(Step(0.9 * OVERLAP, 0.1 * CRITICAL, 0.2 * CRITICAL))
    assert mdr.springs_tangent(contact, load._replace(force=0.0, stiffness=0.0), p, h, w) == (0.0,) * 6
