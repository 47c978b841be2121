"""The level `mdr`: its springs against Cattaneo-Mindlin theory, straight and curved paths, and its tangent."""

import itertools
import math

import closed_forms
import numpy as np
import pytest
import three_spot_theory as theory
from each import each
from theory.plain import plain
from theory.spots import Spot
from thirdbody_three_spot.mdr import MDR, SpringParameters
from thirdbody.laws.data import Load

E_STAR, G_STAR, RADIUS, MU = 1.0, 0.8, 1.0, 0.3
KAPPA = MU * E_STAR / G_STAR


OVERLAP = 0.01
LIMIT, CRITICAL = MU * theory.hertz_force(E_STAR, RADIUS, OVERLAP), KAPPA * OVERLAP


def driver_of(springs, mu=MU):
    return Spot(MDR, SpringParameters(G_STAR, mu, mu * E_STAR / G_STAR, 2.0), 2 * springs)


def test_the_virgin_curve_reversal_and_loop():
    # all springs lie under the patch, those inside up to twice as wide; its edge falls somewhere in the last cell
    for springs, error in ((16, 1.5e-3), (64, 1e-4), (256, 6e-6)):
        driver = driver_of(springs)
        driver.move(0.01)
        for k in range(1, 13):
            force = -driver.move(0.01, 0.1 * CRITICAL).x
            expected = closed_forms.mindlin_loading(min(0.1 * k, 1.0) * CRITICAL, LIMIT, CRITICAL)
            assert force == pytest.approx(expected, abs=error * LIMIT), springs
        assert force <= LIMIT * (1.0 + 1e-12), "never beyond Coulomb's limit"
    # mindlin and Deresiewicz: the branches after a turn, and the work of the closed loop
    driver, turn, work = driver_of(128), 0.7 * CRITICAL, 0.0
    driver.move(0.01)
    top = -driver.move(0.01, turn).x
    for sign in (-1.0, 1.0):
        for k in range(1, 41):
            answer = driver.move(0.01, sign * 0.05 * turn)
            work += answer.dissipated
            branch = closed_forms.mindlin_reversal(turn - 0.05 * k * turn, turn, LIMIT, CRITICAL)
            # 64 to 128 springs carry the patch
            assert -answer.x == pytest.approx(-sign * branch, abs=6e-5 * LIMIT)
    assert -answer.x == pytest.approx(top, abs=6e-5 * LIMIT)
    assert work == pytest.approx(closed_forms.mindlin_loop_work(top / LIMIT) * LIMIT * CRITICAL, rel=1e-3)


MUCH = [0.3, 1e3]
"""Coefficients of friction. With a large one springs slide only where the edge of the patch reaches them, at a limit that falls
to nothing within a part of a step."""


@each(MUCH)
def test_a_straight_step_is_fifty(mu):
    """Along a line, with springs that touch, merge, turn round, slide and leave: neither force nor heat depends on the step."""
    rng, (one, fifty) = np.random.default_rng(5), (driver_of(32, mu), driver_of(32, mu))
    for _ in range(15):
        overlap, slip, start, heat = rng.uniform(1e-4, 0.02), rng.normal() * 3e-3, one.h[0], 0.0
        a = one.move(overlap, slip)
        for k in range(1, 51):
            b = fifty.move(start + (overlap - start) * k / 50, slip / 50)
            heat += b.dissipated
        # fifty roundings of energies of the size of E* sqrt(R) d^2.5, which is 6e-5
        assert a.dissipated == pytest.approx(heat, rel=1e-8, abs=1e-18)
        assert a.x == pytest.approx(b.x, abs=1e-13 * max(mu, MU) * theory.hertz_force(E_STAR, RADIUS, 0.02))
    assert one.w == pytest.approx(fifty.w, abs=1e-15 * max(mu, 1.0))


@each(MUCH)
def test_heat_and_springs_take_the_work_of_an_impact(mu):
    """An undamped oblique impact of 100 straight steps. The work is that of the mean force over the 32nd part of each."""
    coarse, fine, heat, work = driver_of(32, mu), driver_of(32, mu), 0.0, 0.0
    overlap, place, force = 0.0, 0.0, 0.0
    for k in range(1, 100):
        to, there = 0.01 * math.sin(math.pi * k / 100), 0.005 * math.sin(2.2 * math.pi * k / 100)
        answer = coarse.move(to, there - place)
        heat += answer.dissipated
        for part in range(1, 33):
            now = fine.move(overlap + (to - overlap) * part / 32, (there - place) / 32).x
            work -= 0.5 * (force + now) * (there - place) / 32
            force = now
        overlap, place = to, there
    energy = 8.0 / 15.0 * E_STAR * 0.01**2.5
    # the work is short of the jumps of springs that leave the patch within a part of a step
    assert heat + answer.stored == pytest.approx(work, abs=1e-5 * energy)
    assert mu == 0.0 or heat > 0.1 * energy


def test_curved_paths_are_of_first_order():
    """A quarter turn of slip after partial slip, in 8, 16, 32 steps, against 512."""

    def end(steps):
        driver = driver_of(32)
        driver.move(0.01, 0.0)
        driver.move(0.01, 0.8 * CRITICAL)
        for k in range(steps):
            angle = 0.5 * math.pi * (k + 0.5) / steps
            chord = 2.0 * CRITICAL * math.sin(0.25 * math.pi / steps)
            answer = driver.move(0.01, chord * math.cos(angle), chord * math.sin(angle))
        return np.array([answer.x, answer.y])

    fine = end(512)
    errors = [np.linalg.norm(end(steps) - fine) / LIMIT for steps in (8, 16, 32)]
    orders = np.diff(np.log2(errors)) * -1.0
    assert errors[0] < 0.06 and np.all((orders > 0.8) & (orders < 1.3))


def test_no_friction_a_great_deal_and_a_step_to_an_absurd_overlap():
    assert driver_of(32, mu=0.0).move(0.01, 1.0).x == 0.0
    driver = driver_of(256, mu=1e9)
    driver.move(0.01)
    # all stick: T = 2 G* a s; the grid carries the edge of the patch to half a spring of 128 at least
    assert -driver.move(0.01, 1e-5).x == pytest.approx(2.0 * G_STAR * 0.1 * 1e-5, rel=0.5 / 128)
    # a run whose step is too large gets there before a guard stops it: the grid cannot follow without bound
    load = Load(1.0, 1.0, 1.0, 1.0, 0.0)
    for start, overlap in itertools.product((0.0, 0.01), (1e6, 1e40, 1e300)):
        driver = driver_of(16)
        driver.move(start)
        touch, _, *rest = driver.evaluate(0.01, 1e-3)
        touch = touch._replace(overlap=overlap)
        answer, _ = plain(MDR.kernel)(touch, load, *rest, np.empty_like(driver.w))
        plain(MDR.tangent)(touch, load, *rest)
        assert not abs(answer.x) > 2.0 * G_STAR * 2.0**32 * 1e-3  # the grid ends at 2^30 or 2^31 radii


STEPS = (1e-6, 1e-7)
"""Of the differences, over the overlap and the critical displacement: 1e-10 (1e-9) of rounding, 1e-12 of smooth curvature. The
smaller one serves where a weak corner, of a spring with a small share of the force, lies within the other."""


def scales(spot, step):
    """Sizes of the columns: 2 G* a, and that times kappa (the rate of the limit), or times the slip over the overlap."""
    patch, slip = 2.0 * G_STAR * theory.contact_radius(RADIUS, step["overlap"]), math.hypot(step["x"], step["y"])
    return patch * np.array([1.0, 1.0, min(spot.p.kappa, slip / step["overlap"] + 0.1)])


def compare(spot, step):
    """Largest miss of central differences over the size of its column; NaN at a corner, where one-sided ones lie apart."""
    misses, size, (xx, xy, yx, yy, xd, yd) = [], scales(spot, step), spot.tangent(**step)
    tangent = np.array([[xx, xy, xd], [yx, yy, yd]])
    force = lambda **change: np.array(spot.answer(**(step | change))[0][:2])  # noqa: E731
    for length in STEPS:
        central, apart, here = [], [], force()
        for name, unit in (("x", min(spot.p.kappa, 1.0)), ("y", min(spot.p.kappa, 1.0)), ("overlap", 1.0)):
            e = length * max(unit, 1e-3) * step["overlap"]
            ahead, behind = force(**{name: step[name] + e}), force(**{name: step[name] - e})
            central.append((ahead - behind) / (2.0 * e))
            apart.append(np.abs(ahead - 2.0 * here + behind) / e)
        corner = np.any(np.column_stack(apart) > 1e-4 * size)
        misses.append(math.nan if corner else float((np.abs(np.column_stack(central) - tangent) / size).max()))
    return misses[0] if math.isnan(misses[0]) else float(np.nanmin(misses))


def somewhere(rng, size, low, high, **more):
    """A random step: slip of this size over the critical displacement, overlap within these bounds over the usual."""
    overlap, (x, y) = rng.uniform(low, high) * OVERLAP, rng.normal(size=2) * size * CRITICAL
    return {"overlap": overlap, "x": x, "y": y} | more


ROUNDING = 3e-9
"""Rounding of the differences is 1e-10 of a column's size for one step, some springs that are short of a corner add to that."""


def agree(misses, name=""):
    assert np.nanmax(misses) < ROUNDING, name
    assert np.isnan(misses).sum() <= 2, f"{name}: corners are rare"


@each([(4, MU, {}), (16, MU, {}), (8, 1e-6, {}), (8, 1e9, {}), (8, MU, {"share": 0.4}), (8, MU, {"viscous": -1e-4}),
       (8, MU, {"roll": 0.1, "share": -0.2, "viscous": 1e-4})])  # fmt: skip
def test_tangents_agree_with_differences(case):
    """`share` scales the elastic force, so that the bound of a spring is constant; `viscous` does not, so that it moves."""
    springs, mu, more = case
    for kind, bounds in {
        "stick": (0.01, 0.95, 1.05),
        "partial slip": (0.3, 0.8, 1.2),
        "full slip": (5.0, 0.5, 2.0),
        "growing, with merges": (0.3, 1.2, 40.0),
        "growing and turning in full slip": (60.0, 2.0, 40.0),
        "shrinking": (0.3, 0.05, 0.7),
    }.items():
        rng, misses = np.random.default_rng(11), []
        for _ in range(8):
            spot = driver_of(springs, mu)
            for _ in range(3):
                spot.move(**somewhere(rng, 0.3, 0.7, 1.3))
            misses.append(compare(spot, somewhere(rng, *bounds, **more)))
        agree(misses, kind)


def test_first_touch_and_after_a_gap():
    """A virgin contact takes the grid of the overlap at once; the slip is shared over the overlap."""
    rng, misses = np.random.default_rng(4), []
    for size in (0.01, 0.3, 5.0):
        misses += [compare(driver_of(springs), somewhere(rng, size, 0.1, 3.0)) for springs in (4, 16, 32) for _ in range(3)]
    agree(misses)
    # a negative overlap before the step: the part of the slip before touch is lost
    rng, misses = np.random.default_rng(6), []
    for _ in range(8):
        spot = driver_of(16)
        spot.h = (-0.5 * OVERLAP, 200.0, 0.0, 0.0, 0.0, 0.0, 0.0)
        misses.append(compare(spot, somewhere(rng, 0.5, 0.1, 2.0)))
    agree(misses)


def test_an_open_contact_and_a_dashpot_that_pulls_have_no_stiffness():
    """No touch, no stiffness, and no division by the overlap. The load on friction is cut at zero, and with it its stiffness."""
    spot = driver_of(16)
    spot.move(OVERLAP, 0.5 * CRITICAL)
    contact, load, *rest = spot.evaluate(OVERLAP, 0.1 * CRITICAL, 0.2 * CRITICAL, 0.01)
    for overlap in (0.0, -0.5 * OVERLAP):
        assert plain(MDR.tangent)(contact._replace(overlap=overlap), Load(0.0, 0.0, 0.0, 0.0, 0.0), *rest) == (0.0,) * 6
    contact, load, *rest = spot.evaluate(0.9 * OVERLAP, 0.1 * CRITICAL, 0.2 * CRITICAL)
    assert plain(MDR.tangent)(contact, load._replace(force=0.0, stiffness=0.0), *rest) == (0.0,) * 6
