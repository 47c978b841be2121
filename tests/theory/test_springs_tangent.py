"""The tangent of the level `mdr`: against differences of its own step on random histories, and against Cattaneo and Mindlin."""

import math

import closed_forms
import numpy as np
import pytest
from each import each
from theory.spots import Spot
from thirdbody_three_spot import theory
from thirdbody_three_spot.mdr import MDR, SpringParameters

from thirdbody.laws.kernel_data import Load

E_STAR, G_STAR, RADIUS, MU = 1.0, 0.8, 1.0, 0.3
OVERLAP = 0.01
CRITICAL = MU * E_STAR / G_STAR * OVERLAP
STEPS = (1e-6, 1e-7)
"""Of the differences, over the overlap and the critical displacement: 1e-10 (1e-9) of rounding, 1e-12 of smooth curvature. The
smaller one serves where a weak corner, of a spring with a small share of the force, lies within the other."""


def spring_spot(springs=32, mu=MU):
    return Spot(MDR, SpringParameters(G_STAR, mu, mu * E_STAR / G_STAR, 2.0), 2 * springs)


def tangent_of(spot, step):
    """Columns: over slip x, slip y, overlap."""
    xx, xy, yx, yy, xd, yd = spot.tangent(**step)
    return np.array([[xx, xy, xd], [yx, yy, yd]])


def scales(spot, step):
    """Sizes of the columns: 2 G* a, and that times kappa (the rate of the limit), or times the slip over the overlap."""
    patch, slip = 2.0 * G_STAR * theory.contact_radius(RADIUS, step["overlap"]), math.hypot(step["x"], step["y"])
    return patch * np.array([1.0, 1.0, min(spot.p.kappa, slip / step["overlap"] + 0.1)])


def compare(spot, step):
    """Largest miss of central differences over the size of its column; NaN at a corner, where one-sided ones lie apart."""
    misses, size = [], scales(spot, step)
    force = lambda **change: np.array(spot.answer(**(step | change))[0][:2])  # noqa: E731
    for length in STEPS:
        central, apart, here = [], [], force()
        for name, unit in (("x", min(spot.p.kappa, 1.0)), ("y", min(spot.p.kappa, 1.0)), ("overlap", 1.0)):
            e = length * max(unit, 1e-3) * step["overlap"]
            ahead, behind = force(**{name: step[name] + e}), force(**{name: step[name] - e})
            central.append((ahead - behind) / (2.0 * e))
            apart.append(np.abs(ahead - 2.0 * here + behind) / e)
        corner = np.any(np.column_stack(apart) > 1e-4 * size)
        misses.append(math.nan if corner else float((np.abs(np.column_stack(central) - tangent_of(spot, step)) / size).max()))
    return misses[0] if math.isnan(misses[0]) else float(np.nanmin(misses))


def somewhere(rng, size, low, high, **more):
    """A random step: slip of this size over the critical displacement, overlap within these bounds over the usual."""
    overlap, (x, y) = rng.uniform(low, high) * OVERLAP, rng.normal(size=2) * size * CRITICAL
    return {"overlap": overlap, "x": x, "y": y} | more


KINDS = {
    "stick": (0.01, 0.95, 1.05),
    "partial slip": (0.3, 0.8, 1.2),
    "full slip": (5.0, 0.5, 2.0),
    "growing, with merges": (0.3, 1.2, 40.0),
    "growing and turning in full slip": (60.0, 2.0, 40.0),
    "shrinking": (0.3, 0.05, 0.7),
}
EXACT = 3e-9
"""Rounding of the differences is 1e-10 of a column's size for one step, some springs that are short of a corner add to that."""


def agree(misses, name=""):
    assert np.nanmax(misses) < EXACT, name
    assert np.isnan(misses).sum() <= 2, f"{name}: corners are rare"


def agree_in_all_kinds(springs, mu, **more):
    """On 40 random steps of every kind after random histories in the plane."""
    for kind, bounds in KINDS.items():
        rng, misses = np.random.default_rng(11), []
        for _ in range(40):
            spot = spring_spot(springs, mu)
            for _ in range(3):
                spot.move(**somewhere(rng, 0.3, 0.7, 1.3))
            misses.append(compare(spot, somewhere(rng, *bounds, **more)))
        agree(misses, kind)


@each([4, 6, 32])
def test_agrees_with_differences(springs):
    agree_in_all_kinds(springs, MU)


@each([{"roll": 0.03}, {"share": 0.4}, {"viscous": 2e-4}, {"viscous": -1e-4}, {"roll": 0.1, "share": -0.2, "viscous": 1e-4}])
def test_rolling_and_dashpots(more):
    """`share` scales the elastic force, so that the bound of a spring is constant; `viscous` does not, so that it moves."""
    agree_in_all_kinds(16, MU, **more)


@each([1e-6, 1e9])
def test_with_little_friction_and_a_great_deal(mu):
    agree_in_all_kinds(32, mu)


def test_without_friction():
    for step in ((OVERLAP,), (1.3 * OVERLAP, CRITICAL, -CRITICAL, 0.01), (30.0 * OVERLAP, CRITICAL)):
        spot = spring_spot(32, 0.0)
        spot.move(OVERLAP, CRITICAL)
        assert spot.tangent(*step) == (0.0,) * 6


def test_first_touch():
    """A virgin contact takes the grid of the overlap at once; the slip is shared over the overlap."""
    rng, misses = np.random.default_rng(4), []
    for size in (0.01, 0.3, 5.0):
        misses += [compare(spring_spot(springs), somewhere(rng, size, 0.1, 3.0)) for springs in (4, 16, 32) for _ in range(10)]
    agree(misses)


def test_after_a_gap():
    """A negative overlap before the step: the part of the slip before touch is lost."""
    rng, misses = np.random.default_rng(6), []
    for _ in range(30):
        spot = spring_spot(16)
        spot.h = (-0.5 * OVERLAP, 200.0, 0.0, 0.0, 0.0, 0.0, 0.0)
        misses.append(compare(spot, somewhere(rng, 0.5, 0.1, 2.0)))
    agree(misses)


@each([0.2, 0.5, 0.9])
def test_the_virgin_patch(share):
    """Along the slip 2 G* c with the stick radius c (Cattaneo), across it the secant of the force."""
    spot, a = spring_spot(512), theory.contact_radius(RADIUS, OVERLAP)
    spot.move(OVERLAP)
    tangent = tangent_of(spot, {"overlap": OVERLAP, "x": share * CRITICAL})
    # 256 to 512 springs carry the patch; the edge of the stick area falls somewhere in one of them
    assert tangent[0, 0] == pytest.approx(-2.0 * G_STAR * a * math.sqrt(1.0 - share), abs=2.0 * G_STAR * a / 256)
    # across it the springs turn, and the force with them: T_y = T_x s_y/s_x
    limit, slip = MU * theory.hertz_force(E_STAR, RADIUS, OVERLAP), share * CRITICAL
    secant = closed_forms.mindlin_loading(slip, limit, CRITICAL) / slip
    assert tangent[1, 1] == pytest.approx(-secant, rel=1e-4)  # the force of 256 springs, 6e-6, and the edge of the patch
    assert tangent[0, 1] == tangent[1, 0] == 0.0


def test_full_sliding():
    """T = -mu N e: nothing along the slip, mu N/|s| across it, and mu dN/dd with the overlap."""
    spot, angle, path = spring_spot(256), 0.7, 50.0 * CRITICAL
    spot.move(OVERLAP)
    e, across = np.array([math.cos(angle), math.sin(angle)]), np.array([-math.sin(angle), math.cos(angle)])
    tangent = tangent_of(spot, {"overlap": OVERLAP, "x": path * e[0], "y": path * e[1]})
    slope, limit = MU * closed_forms.hertz_stiffness(E_STAR, RADIUS, OVERLAP), MU * theory.hertz_force(E_STAR, RADIUS, OVERLAP)
    # every spring under the patch adds 2 G* kappa spacing: 128 springs and more, of which the last is in or out
    assert tangent[:, 2] @ e == pytest.approx(-slope, rel=0.5 / 128)
    # their sum falls short of mu N by 1.5 (spacing/2a)^2 < 3e-5
    assert across @ tangent[:, :2] @ across == pytest.approx(-limit / path, rel=1e-4)
    # along the slip: roundings of a stiffness 2 G* a
    assert np.abs(tangent[:, :2] @ e).max() < 1e-12 * limit / CRITICAL


def test_an_open_contact_and_a_dashpot_that_pulls_have_no_stiffness():
    """No touch, no stiffness, and no division by the overlap. The load on friction is cut at zero, and with it its stiffness."""
    spot = spring_spot(16)
    spot.move(OVERLAP, 0.5 * CRITICAL)
    contact, load, *rest = spot.evaluate(OVERLAP, 0.1 * CRITICAL, 0.2 * CRITICAL, 0.01)
    for overlap in (0.0, -0.5 * OVERLAP):
        assert MDR.tangent(contact._replace(overlap=overlap), Load(0.0, 0.0, 0.0, 0.0, 0.0), *rest) == (0.0,) * 6
    contact, load, *rest = spot.evaluate(0.9 * OVERLAP, 0.1 * CRITICAL, 0.2 * CRITICAL)
    assert MDR.tangent(contact, load._replace(force=0.0, stiffness=0.0), *rest) == (0.0,) * 6
