"""The law `exact` and its tangent against memory diagrams, closed forms and differences; R = E* = 1."""

import math

import closed_forms
import numpy as np
import pytest
import three_spot_theory as theory
from theory.exact_spot import D0, D1, KAPPA, MU, E, G, R, Spot, circle, corners, run_exact_tangent
from theory.memory_diagrams import MemoryDiagram
from thirdbody_three_spot.exact import NODES
from thirdbody.laws.data import Load

SLOW = pytest.mark.full(kind="slow")
OBLIQUE, ACROSS = np.array([0.6, 0.8]), np.array([-0.8, 0.6])


@pytest.mark.parametrize("histories", [12, pytest.param(100, marks=SLOW)])
def test_random_histories_agree_with_memory_diagrams(histories):
    for mu in (0.05, 0.3, 3.0):
        rng = np.random.default_rng(1)
        for _ in range(histories):
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
    spot = Spot(nodes=64)
    assert smooth_history(spot, 50) < 1e-12 and spot.h[7] == 0.0  # some roundings a step
    # without space it reports that, and keeps the force
    misses, steps = [], 300
    for nodes in (32, 64):
        spot = Spot(nodes=nodes)
        misses.append(smooth_history(spot, steps))
        # a bend more than it keeps is dropped in every step from then on, or not even that where others merged
        assert 0.0 < spot.h[7] <= steps
    # chords of a smooth curve: second order in their number; measured below
    assert misses[0] < 3e-4 and misses[1] < 0.4 * misses[0]


def test_first_loading_is_cattaneo_and_mindlin():
    limit, s_c = MU * theory.hertz_force(E, R, D0), KAPPA * D0
    for s in np.linspace(0.0, 1.5, 16) * s_c:
        spot = Spot()
        spot.move(D0, 0.0)
        answer = spot.move(D0, s)
        assert -answer.x == pytest.approx(closed_forms.mindlin_loading(s, limit, s_c), abs=1e-14 * limit)  # rounding
        assert answer.critical == pytest.approx(s_c, rel=1e-15)
        assert answer.slip == pytest.approx(max(s - s_c, 0.0), abs=1e-15 * s_c)
    # at constant load the dissipation of a straight step of any length is exact
    top = s_c * (1.0 - 0.5 ** (2.0 / 3.0))
    spot = Spot()
    for path in (0.0, top):
        spot.move(D0, path)
    lost = sum(spot.move(D0, path).dissipated for path in (-2.0 * top, 2.0 * top))
    assert lost == pytest.approx(closed_forms.mindlin_loop_work(0.5) * limit * s_c, rel=1e-12)


def test_force_dies_with_the_overlap_and_full_sliding_is_the_limit_exactly():
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
    spot = Spot()
    spot.move(D0, 0.0)
    for damped in (1.0, 1.7, 0.2, 1.0):
        answer = spot.move(D0, OBLIQUE * 3.0 * KAPPA * D0, damped=damped)
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
    misses = [np.abs(around(0.5, *how) - witness).max() for how in ((64, 128), (256, 128), (256, NODES.default))]
    assert misses[1] < misses[0] / 9.0 and misses[2] < 2e-4  # order two, then what 48 nodes cost
    assert 1.0 - 0.1 / 9.0 < np.linalg.norm(around(3.0, 64, 64)) <= 1.0


def test_a_polygon_needs_no_more_steps_than_corners():
    """At constant overlap a straight step of any length is exact, in whatever direction the springs stand."""
    for share in (0.9, 3.0):
        rng, few, many = np.random.default_rng(3), Spot(renewal=0.0, nodes=64), Spot(renewal=0.0, nodes=64)
        for slip in (np.zeros(2), *(rng.normal(size=(8, 2)) * share * KAPPA * D0)):
            limit = few.move(D0, slip).limit
            many.path(D0, slip, 20)
        assert many.force == pytest.approx(few.force, abs=1e-12 * limit)  # roundings of 160 steps


def test_rolling_releases_the_field():
    spot, kept = Spot(1e6), Spot(1e6, renewal=0.0)  # all springs stick: a uniform field decays and stays uniform
    for one in (spot, kept):
        one.move(D0, 0.0)
        one.move(D0, 0.5 * KAPPA * D0)
    before, stored = spot.force[0], spot.stored
    roll = 0.1 * theory.contact_radius(R, D0)
    lost = sum(spot.move(D0, 0.0, roll=roll).dissipated for _ in range(20))
    # 4e-8 measured: the field is kept at its nodes, and twenty carries round each of them
    assert spot.force[0] == pytest.approx(before * math.exp(-4.0), rel=1e-7)
    assert lost == pytest.approx(stored * (1.0 - math.exp(-8.0)), rel=1e-7)
    kept.move(D0, 0.0, roll=roll)
    assert kept.force[0] == pytest.approx(before, rel=1e-7)  # 5e-8 measured: a carry rounds the nodes


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


def test_tangents_of_the_virgin_patch_of_full_sliding_at_first_touch_and_after_a_gap():
    """Along the slip 2 G* c with the stick radius c (Cattaneo), across it the secant of the force; also at an angle."""
    spot, full, limit = Spot(), 2.0 * G * theory.contact_radius(R, D1), MU * theory.hertz_force(E, R, D1)
    spot.move(D1, 0.0)
    for share in (0.1, 0.5, 0.9):
        slip = share * KAPPA * D1
        assert spot.tangent(D1, slip)[0, 0] == pytest.approx(-full * math.sqrt(1.0 - share), rel=1e-14)
        tangent = spot.tangent(D1, slip * OBLIQUE)[:, :2]
        assert OBLIQUE @ tangent @ OBLIQUE == pytest.approx(-full * math.sqrt(1.0 - share), rel=1e-6)  # of the differences
        assert ACROSS @ tangent @ ACROSS == pytest.approx(-closed_forms.mindlin_loading(slip, limit, KAPPA * D1) / slip, rel=1e-6)
        assert abs(OBLIQUE @ tangent @ ACROSS) < 1e-6 * full
    # T = -mu N e: nothing along the slip, mu N/|s| across it, and mu dN/dd with the overlap; N with the dashpot
    path, damped = 50.0 * KAPPA * D1, 1.3
    tangent, limit = spot.tangent(D1, path * OBLIQUE, damped=damped), damped * limit
    assert tangent[:, 2] == pytest.approx(-damped * MU * closed_forms.hertz_stiffness(E, R, D1) * OBLIQUE, rel=1e-6)
    assert ACROSS @ tangent[:, :2] @ ACROSS == pytest.approx(-limit / path, rel=1e-6)
    assert np.abs(tangent[:, :2] @ OBLIQUE).max() < 1e-6 * limit / (KAPPA * D1)
    # the slip is shared over the overlap; of a step that began apart the part before touch is lost
    rng, misses = np.random.default_rng(4), []
    for overlap in (0.0, -0.5 * D1):
        for size in 4 * (0.02, 0.3, 5.0):
            spot = Spot()
            spot.reset(overlap)
            misses.append(miss(spot, rng.uniform(0.3, 1.2) * D1, rng.normal(size=2) * size * KAPPA * D1, damped=1.3))
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
