"""The law `exact` against memory diagrams, closed forms, and its own invariances. Lengths in units of R, E* = 1."""

import math

import closed_forms
import numpy as np
import pytest
from theory.exact_spot import D0, D1, KAPPA, MU, E, G, R, Spot, cell_places, circle, corners
from theory.memory_diagrams import MemoryDiagram
from thirdbody_three_spot import theory
from thirdbody_three_spot.exact import NODES


@pytest.mark.parametrize("mu", [0.05, 0.3, 3.0])
def test_random_histories_agree_with_memory_diagrams(mu):
    rng = np.random.default_rng(1)
    for _ in range(100):
        spot, verify = Spot(mu), MemoryDiagram(4.0 / 3.0 * E * math.sqrt(R), mu, mu * E / G)
        for overlap, slip in corners(rng, int(rng.integers(1, 40))):
            if rng.random() < 0.2 and spot.h[0] > 0.0:
                overlap = spot.h[0]
            if rng.random() < 0.05:
                overlap = -0.1 * overlap
            spot.move(overlap, slip * mu / MU)
            verify.move(overlap, slip * mu / MU)
            # 40 steps of a few roundings each; measured 5e-15
            assert -spot.force[0] == pytest.approx(verify.force, abs=1e-12 * verify.limit)


def smooth_history(spot, steps):
    """Largest miss of a curved history in (d, s), over mu N: a piece of the field for every step."""
    verify, last, miss = MemoryDiagram(4.0 / 3.0 * E, MU, KAPPA), 0.0, 0.0
    for i in range(1, steps + 1):
        slip = 0.8 * KAPPA * D1 * math.sin(2.0 * i / steps) * i / steps
        spot.move(D1 * i / steps, slip - last)
        verify.move(D1 * i / steps, slip - last)
        last, miss = slip, max(miss, abs(-spot.force[0] - verify.force))
    return miss / (MU * theory.hertz_force(E, R, D1))


def test_a_field_keeps_every_bend_that_it_has_space_for():
    for nodes, steps in ((64, 50), (256, 240)):
        spot = Spot(nodes=nodes)
        assert smooth_history(spot, steps) < 1e-12  # some roundings a step
        assert spot.h[7] == 0.0
    # without space it reports that, and keeps the force
    misses, steps = [], 500
    for nodes in (32, 64, 128):
        spot = Spot(nodes=nodes)
        misses.append(smooth_history(spot, steps))
        # a bend more than it keeps is dropped in every step from then on, or not even that where others merged
        assert 0.0 < spot.h[7] <= steps
    # chords of a smooth curve: second order in their number; measured below
    assert misses[0] < 3e-4 and misses[1] < 0.4 * misses[0] and misses[2] < 0.4 * misses[1]


def test_first_loading_is_cattaneo_and_mindlin():
    limit, s_c = MU * theory.hertz_force(E, R, D0), KAPPA * D0
    for s in np.linspace(0.0, 1.5, 16) * s_c:
        spot = Spot()
        spot.move(D0, 0.0)
        answer = spot.move(D0, s)
        assert -answer.x == pytest.approx(closed_forms.mindlin_loading(s, limit, s_c), abs=1e-14 * limit)  # rounding
        assert answer.critical == pytest.approx(s_c, rel=1e-15)
        assert answer.slip == pytest.approx(max(s - s_c, 0.0), abs=1e-15 * s_c)


@pytest.mark.parametrize("tau", [0.5, 1.0])
def test_loop_of_mindlin_and_deresiewicz(tau):
    limit, s_c = MU * theory.hertz_force(E, R, D0), KAPPA * D0
    top = s_c * (1.0 - (1.0 - tau) ** (2.0 / 3.0))
    spot = Spot()
    spot.move(D0, 0.0)
    spot.move(D0, top)
    for s in np.linspace(1.0, -1.0, 9)[1:] * top:
        spot.move(D0, -0.25 * top)
        assert -spot.force[0] == pytest.approx(closed_forms.mindlin_reversal(s, top, limit, s_c), abs=1e-14 * limit)
    lost = sum(spot.move(D0, path).dissipated for path in (2.0 * top, -2.0 * top))
    # at constant load the dissipation of a straight step of any length is exact
    assert lost == pytest.approx(closed_forms.mindlin_loop_work(tau) * limit * s_c, rel=1e-12)


def test_load_that_varies():
    """Numbers from the closed forms of `theory`: T of Cattaneo and Mindlin, unchanged by more load, forgotten down to less."""
    n_0, n_1 = (theory.hertz_force(E, R, d) for d in (D0, D1))
    at_half = closed_forms.mindlin_loading(0.5 * KAPPA * D0, MU * n_0, KAPPA * D0)
    for path, expected in (
        (((D0, 0.0), (D0, 0.5 * KAPPA * D0), (D1, 0.0)), at_half),
        # .3 s_c1 is .5 s_c0, and the annulus lost is all that a virgin contact at d0 lacks
        (((D1, 0.0), (D1, 0.3 * KAPPA * D1), (D0, 0.0)), at_half),
        (((D0, 0.0), (D1, 0.6 * KAPPA * (D1 - D0))), theory.oblique_loading(MU, 0.6, n_0, n_1)),
    ):
        spot = Spot()
        for overlap, slip in path:
            spot.move(overlap, slip)
        assert -spot.force[0] == pytest.approx(expected, rel=1e-14)


@pytest.mark.parametrize("overlaps", [(0.01, 0.01, 0.004, 0.004, 0.01), (0.004, 0.004, 0.01, 0.01, 0.004)])
def test_closed_cycle_loses_what_the_annulus_carried(overlaps):
    shear = 1e-4
    slips = (0.0, shear, 0.0, -shear, 0.0)
    spot, work = Spot(mu=1e9), 0.0
    for overlap, slip in zip(overlaps, slips, strict=True):
        start, _ = spot.force[0], spot.move(overlap, slip)
        work -= 0.5 * (start + spot.force[0]) * slip  # no slip: T is linear along a segment
    scale = G * theory.contact_radius(R, 0.01) * shear**2
    # 1 - sqrt(.4) = .36754; friction 1e9 slips in a margin of 1e-9 shares
    assert work / scale == pytest.approx(closed_forms.closed_cycle_work(0.004, 0.01), rel=1e-6)


@pytest.mark.parametrize("mu", [0.3, 1e9])
def test_one_step_is_a_hundred(mu):
    rng = np.random.default_rng(2)
    for _ in range(6):
        one, many = Spot(mu), Spot(mu)
        for overlap, slip in corners(rng, 12):
            answer = one.move(overlap, slip)
            many.path(overlap, slip, 100)
            scale = min(answer.limit, 2.0 * G * theory.contact_radius(R, overlap) * KAPPA * D1)
            # roundings of 1200 steps; measured 2e-14
            assert many.force[0] == pytest.approx(one.force[0], abs=1e-12 * scale)


def test_mirror_and_rotation():
    rng = np.random.default_rng(3)
    turn = np.array([[math.cos(0.7), -math.sin(0.7)], [math.sin(0.7), math.cos(0.7)]])
    mirror = np.diag([1.0, -1.0])
    for _ in range(20):
        plain, turned, mirrored = Spot(), Spot(), Spot()
        for overlap, slip in corners(rng, 15, line=False):
            for _ in range(3):
                limit = plain.move(overlap, slip).limit
                turned.move(overlap, turn @ slip)
                mirrored.move(overlap, mirror @ slip)
            assert mirrored.force == pytest.approx(mirror @ plain.force, abs=1e-14 * limit)
            # thinning may choose another of two equal nodes: rounding else
            assert turned.force == pytest.approx(turn @ plain.force, abs=1e-11 * limit)


def test_force_dies_with_the_overlap_and_is_not_kept():
    spot = Spot()
    spot.move(D1, 0.0)
    spot.move(D1, 0.4 * KAPPA * D1)
    for overlap in (1e-3, 1e-6, 1e-12, 1e-18):
        answer = spot.move(overlap, 0.0)
        assert abs(answer.x) <= answer.limit * (1.0 + 4e-16)  # one rounding
    assert spot.stored < 1e-30
    spot.move(-1e-3, 1.0)
    spot.move(D0, 0.0)
    assert spot.force == pytest.approx([0.0, 0.0], abs=0.0)
    # slip before touch does not count
    apart, touching = Spot(), Spot()
    apart.move(-D0, 0.0)
    apart.move(D0, 0.4 * KAPPA * D0)
    touching.move(D0, 0.2 * KAPPA * D0)
    assert apart.force == pytest.approx(touching.force, rel=1e-15)


def test_full_sliding_is_the_limit_exactly_and_no_friction_is_none():
    spot = Spot()
    spot.move(D0, 0.0)
    for damped in (1.0, 1.7, 0.2, 1.0):
        answer = spot.move(D0, np.array([0.6, 0.8]) * 3.0 * KAPPA * D0, damped=damped)
        assert math.hypot(answer.x, answer.y) == pytest.approx(answer.limit, rel=2e-16)
    smooth = Spot(mu=0.0)
    for overlap, slip in corners(np.random.default_rng(4), 20, line=False):
        answer = smooth.move(overlap, slip)
        assert (answer.x, answer.y, answer.stored, answer.dissipated) == (0.0, 0.0, 0.0, 0.0)
        assert answer.slip == pytest.approx(np.linalg.norm(slip), rel=1e-15)


def test_curves():
    """Once around a circle of .5 s_c the springs of test_curved_slip carry `witness`, to 1e-6. Where all slide, they lag by
    angles of up to s_c/radius, one another by less."""

    def around(share, steps, nodes):
        spot = Spot(renewal=0.0, nodes=nodes)
        for overlap, slip in zip(*circle(share, steps), strict=True):
            spot.move(overlap, slip)
        return spot.force / (MU * theory.hertz_force(E, R, D0))

    witness = (-0.61076249, -0.0730638)
    misses = [np.abs(around(0.5, *how) - witness).max() for how in ((64, 256), (256, 256), (1024, NODES.default))]
    assert misses[1] < misses[0] / 9.0 and misses[2] < 2e-4  # order two, then what 48 nodes cost
    assert 1.0 - 0.1 / 9.0 < np.linalg.norm(around(3.0, 256, 64)) <= 1.0


@pytest.mark.parametrize("share", [0.9, 3.0])
def test_a_polygon_needs_no_more_steps_than_corners(share):
    """At constant overlap a straight step of any length is exact, in whatever direction the springs stand."""
    rng, few, many = np.random.default_rng(3), Spot(renewal=0.0, nodes=64), Spot(renewal=0.0, nodes=64)
    for slip in (np.zeros(2), *(rng.normal(size=(20, 2)) * share * KAPPA * D0)):
        limit = few.move(D0, slip).limit
        for _ in range(100):
            many.move(D0, slip / 100.0)
    assert many.force == pytest.approx(few.force, abs=1e-12 * limit)  # roundings of 2000 steps


def test_damped_load_bounds_every_spring():
    rng = np.random.default_rng(5)
    for _ in range(20):
        spot = Spot()
        for overlap, slip in corners(rng, 20, line=False):
            damped = rng.choice([0.0, 0.3, 1.0, 2.0])
            spot.move(overlap, slip, damped=damped)
            if spot.h[1] < 0.0:
                place = cell_places(spot.w, int(-spot.h[1]) - 1)
                n = len(place)
                sizes = np.hypot(spot.w[1 : n + 1], spot.w[n + 1 : 2 * n + 1])
            else:
                nodes = spot.w[: 3 * int(spot.h[1])].reshape(-1, 3)
                place, sizes = nodes[:, 0], np.hypot(nodes[:, 1], nodes[:, 2])
            bound = KAPPA * damped * np.maximum(overlap - place, 0.0)
            assert (sizes <= bound * (1.0 + 1e-12) + 1e-18).all()


def test_rolling_releases_the_field():
    spot, kept = Spot(1e6), Spot(1e6, renewal=0.0)  # all springs stick: a uniform field decays and stays uniform
    for one in (spot, kept):
        one.move(D0, 0.0)
        one.move(D0, 0.5 * KAPPA * D0)
    before, stored = spot.force[0], spot.stored
    roll = 0.1 * theory.contact_radius(R, D0)
    lost = sum(spot.move(D0, 0.0, roll=roll).dissipated for _ in range(20))
    assert spot.force[0] == pytest.approx(before * math.exp(-4.0), rel=1e-12)
    assert lost == pytest.approx(stored * (1.0 - math.exp(-8.0)), rel=1e-12)
    kept.move(D0, 0.0, roll=roll)
    assert kept.force[0] == pytest.approx(before, rel=1e-15)


@pytest.mark.parametrize("paths", [40, pytest.param(300, marks=pytest.mark.full(kind="slow"))])
def test_no_path_makes_energy(paths):
    rng = np.random.default_rng(6)
    for line, mu in ((True, 0.3), (False, 0.3), (False, 0.05), (False, 3.0), (False, 1e9)):
        for _ in range(paths):
            spot, work = Spot(mu), 0.0
            for overlap, slip in corners(rng, 12, line):
                work += spot.path(overlap, slip, int(rng.integers(1, 12)))[0]
                assert work >= spot.stored * (1.0 - 1e-12), (line, mu)  # rounding of a sum of some 100 steps


def test_curved_paths_of_small_steps_make_no_energy():
    rng = np.random.default_rng(7)
    for _ in range(10):
        spot, work = Spot(), 0.0
        radius, vary, phase = rng.uniform(0.1, 1.5) * KAPPA * D1, rng.uniform(0.0, 0.6), rng.uniform(0.0, 6.0)
        place = np.zeros(2)
        for i in range(400):
            t = 0.05 * i
            there = radius * np.array([math.sin(t), math.sin(1.3 * t + phase)])
            spot.move(D1 * (1.0 - vary * math.sin(0.7 * t + phase) ** 2), there - place)
            work, place = work - float(spot.force @ (there - place)), there
            assert work >= spot.stored * (1.0 - 1e-12)


def test_energy_balance_closes_to_second_order():
    """Trapezoidal work less stored less dissipated, for a corner path with all of slip, stick, loss and gain of area."""
    residuals = []
    for steps in (20, 40, 80):
        spot, balance = Spot(), 0.0
        for overlap, slip in ((D0, 1e-3), (D1, -2e-3), (0.003, 1e-3), (0.008, 2e-3), (0.005, -1e-3)):
            first = max(spot.h[0], 0.0)
            for i in range(1, steps + 1):
                start = spot.force[0]
                lost = spot.move(first + (overlap - first) * i / steps, slip / steps).dissipated
                balance += -0.5 * (start + spot.force[0]) * slip / steps - lost
        residuals.append(abs(balance - spot.stored))
    assert residuals[2] < residuals[1] / 2.5 < residuals[0] / 6.0  # order between 1.3 (unsmooth at onsets) and 2
