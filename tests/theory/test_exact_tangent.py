"""The tangent of the level `exact`, with dashpots and rolling: against differences of its own step, and closed forms.

It compiles for long; in the default command the conformance suite compares this tangent with differences.
"""

import math

import closed_forms
import numpy as np
import pytest
from theory.exact_spot import D1, KAPPA, MU, E, G, R, Spot, corners, run_exact_tangent
from thirdbody_three_spot import theory

from thirdbody.laws.kernel_data import Load

pytestmark = pytest.mark.full(kind="slow")


def miss(spot, overlap, slip, rows=2, **more):
    """Largest miss of the tangent in parts of 2 G* a, against the best of the differences: nodes come and go."""
    got, found = spot.tangent(overlap, slip, **more), []
    for size in (1e-5, 1e-6, 1e-7):
        columns = []
        for step in size * np.diag([KAPPA * D1, KAPPA * D1, D1]):
            ahead, behind = (spot.answer(overlap + s * step[2], slip + s * step[:2], **more) for s in (1.0, -1.0))
            columns.append((ahead - behind) / (2.0 * step.sum()))
        found.append(float(np.abs(np.column_stack(columns) - got)[:rows].max()))
    return min(found) / (2.0 * G * theory.contact_radius(R, overlap))


def somewhere(rng, size):
    return rng.uniform(0.3, 1.2) * D1, rng.normal(size=2) * size * KAPPA * D1


def corner_path(rng, size):
    """Some long steps in all directions, and the one to look at."""
    spot = Spot()
    for _ in range(4):
        spot.move(*somewhere(rng, 0.3))
    return spot, *somewhere(rng, size)


def curved_path(rng, size):
    """Forty small steps along a curve in the plane, with an overlap that varies, and the next one."""
    spot, phase, before = Spot(), rng.uniform(0.0, 6.0, 3), None
    for t in 0.05 * np.arange(41):
        place = size * KAPPA * D1 * np.array([math.sin(t + phase[0]), math.sin(1.3 * t + phase[1])])
        step = D1 * (0.7 + 0.3 * math.sin(0.7 * t + phase[2])), place - (place if before is None else before)
        before = place
        if t < 1.99:
            spot.move(*step)
    return spot, *step


@pytest.mark.parametrize(
    "more", [{}, {"damped": 1.3}, {"viscous": 2e-4}, {"damped": 0.8, "viscous": 1e-4}, {"roll": 0.01, "damped": 1.3}]
)
@pytest.mark.parametrize("size", [0.02, 0.3, 5.0])
@pytest.mark.parametrize("path", [corner_path, curved_path])
def test_tangent_agrees_with_differences_off_an_axis(path, size, more):
    """The load of `damped` keeps the bound of a spring constant, that of `viscous` moves it."""
    rng = np.random.default_rng(5)
    misses = [miss(*path(rng, size), **more) for _ in range(40)]
    # both are differences, which keep 1e-10; where nodes come and go the force jumps by 1e-6, and rare ones differ by anything
    assert np.median(misses) < 1e-8
    assert np.quantile(misses, 0.9) < 1e-4


def test_tangent_agrees_with_differences_on_a_line():
    rng, misses = np.random.default_rng(8), []
    for _ in range(60):
        spot = Spot()
        for overlap, slip in corners(rng, 4):
            spot.move(overlap, slip)
        (overlap, slip), roll = next(corners(rng, 1)), rng.uniform(0.0, 0.01)
        misses.append(miss(spot, overlap, np.array([0.3 * slip, 0.0]), rows=1, roll=roll, damped=rng.choice([1.0, 1.3])))
    assert max(misses) < 1e-5 and np.median(misses) < 1e-8  # differences over fields with kinks


@pytest.mark.parametrize("share", [0.1, 0.2, 0.5, 0.9])
def test_tangent_of_the_virgin_patch(share):
    """Along the slip 2 G* c with the stick radius c (Cattaneo), across it the secant of the force; also at an angle."""
    spot, e, across = Spot(), np.array([0.6, 0.8]), np.array([-0.8, 0.6])
    spot.move(D1, 0.0)
    slip, full = share * KAPPA * D1, 2.0 * G * theory.contact_radius(R, D1)
    assert spot.tangent(D1, slip)[0, 0] == pytest.approx(-full * math.sqrt(1.0 - share), rel=1e-14)
    tangent = spot.tangent(D1, slip * e)[:, :2]
    assert e @ tangent @ e == pytest.approx(-full * math.sqrt(1.0 - share), rel=1e-6)  # of the differences
    secant = closed_forms.mindlin_loading(slip, MU * theory.hertz_force(E, R, D1), KAPPA * D1) / slip
    assert across @ tangent @ across == pytest.approx(-secant, rel=1e-6)
    assert abs(e @ tangent @ across) < 1e-6 * full


@pytest.mark.parametrize("damped", [1.0, 1.3])
def test_tangent_of_full_sliding(damped):
    """T = -mu N e: nothing along the slip, mu N/|s| across it, and mu dN/dd with the overlap; N with the dashpot."""
    spot, e, across, path = Spot(), np.array([0.6, 0.8]), np.array([-0.8, 0.6]), 50.0 * KAPPA * D1
    spot.move(D1, 0.0)
    tangent = spot.tangent(D1, path * e, damped=damped)
    limit = damped * MU * theory.hertz_force(E, R, D1)
    assert tangent[:, 2] == pytest.approx(
        -damped * MU * closed_forms.hertz_stiffness(E, R, D1) * e, rel=1e-6
    )  # of the differences
    assert across @ tangent[:, :2] @ across == pytest.approx(-limit / path, rel=1e-6)
    assert np.abs(tangent[:, :2] @ e).max() < 1e-6 * limit / (KAPPA * D1)


def test_tangent_at_first_touch_and_after_a_gap():
    """The slip is shared over the overlap; of a step that began apart the part before touch is lost."""
    rng, misses = np.random.default_rng(4), []
    for overlap in (0.0, -0.5 * D1):
        for size in 10 * (0.02, 0.3, 5.0):
            spot = Spot()
            spot.reset(overlap)
            misses.append(miss(spot, *somewhere(rng, size), damped=1.3))
    assert max(misses) < 1e-7  # rounding of the differences
    # no friction, a dashpot that takes all load, or no touch: no stiffness, and no division by zero
    for step in ((D1, 0.0), (1.3 * D1, KAPPA * D1 * np.array([1.0, -1.0]), 0.01)):
        spot = Spot(0.0)
        spot.move(D1, KAPPA * D1)
        assert np.all(spot.tangent(step[0], step[1]) == 0.0)
        spot = Spot()
        spot.move(D1, KAPPA * D1 * np.array([0.3, 0.2]))
        (contact, load), memory = spot.evaluate(*step), (spot.p, spot.h, spot.w)
        assert run_exact_tangent(contact, load._replace(force=0.0, stiffness=0.0), *memory) == (0.0,) * 6
        assert run_exact_tangent(contact._replace(overlap=-D1), Load(0.0, 0.0, 0.0, 0.0, 0.0), *memory) == (0.0,) * 6
