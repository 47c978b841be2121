"""When a particle can stick or slide: hulls, the plane with weight, and friction cones by linear programming against each other.

Places are in units of the particle where no unit is said. P is the upper side, Q the lower one.
"""

from __future__ import annotations

import ast
import math
from pathlib import Path

import friction_cones
import hull_conditions
import numpy as np
import pytest
from thirdbody_three_spot import conditions, theory

ROUND = {"rel": 1e-13, "abs": 1e-14}  # closed forms of a few operations on numbers of order 1
SOLVER = 1e-6  # the residual of 1e-8 that counts as balance, times the ratio of arms that occur below
K = 16

TRIANGLE = (((1.2, 0.4),), ((-1.0, 0.0), (1.0, 0.0), (0.0, 1.2)), 2.0)
CROSSED = (((0.0, 1.0), (0.0, -1.0)), ((0.6, 0.0), (1.4, 0.0)), 1.5)
SEGMENT = (((0.0, 0.0), (0.0, 1.0)), ((1.0, 0.5),), 2.0)
PAIR = (((0.3, 0.4),), ((0.0, 0.0),), 2.0)


def random_side(random, most=6):
    return random.uniform(-1.0, 1.0, (random.integers(1, most + 1), 2)) + random.uniform(-0.8, 0.8, 2)


def random_cases(seed, count, most=6):
    random = np.random.default_rng(seed)
    return [(random_side(random, most), random_side(random, most), random.uniform(0.3, 3.0)) for _ in range(count)]


# -- hulls: numbers --


@pytest.mark.parametrize(
    "case, mu",
    [
        (TRIANGLE, 0.204859007892633558),  # from the line 1.2 x + y = 1.2: .64/sqrt(2.44)/2
        (CROSSED, 0.4),
        (SEGMENT, 0.5),
        (PAIR, 0.25),  # tan alpha of Eq. 16: .5/2
    ],
)
def test_required_friction(case, mu):
    assert hull_conditions.required_friction(*case) == pytest.approx(mu, **ROUND)


@pytest.mark.parametrize(
    "case, direction, interval",
    [
        (TRIANGLE, (-1.0, 0.0), (4.0 / 15.0, 14.0 / 15.0)),  # Q at y = .4 reaches from -2/3 to 2/3
        (TRIANGLE, (0.0, 1.0), hull_conditions.NEVER),
        # (1.2 - 3 s, .4 + s) meets the sides of Q at s = .64/2.6 and 2.24/4.6; t = s sqrt(10)/2
        (TRIANGLE, (-3.0, 1.0), (0.389203404328415918, 0.769945865084474968)),
        (CROSSED, (1.0, 0.0), (0.4, 1.4 / 1.5)),
        (CROSSED, (-1.0, 0.0), (-1.4 / 1.5, -0.4)),
        (CROSSED, (2.0, 2.0), (0.6 * math.sqrt(2.0) / 1.5, math.sqrt(2.0) / 1.5)),  # {q - p} = [.6, 1.4] x [-1, 1]
        (CROSSED, (0.0, 1.0), hull_conditions.NEVER),
        (SEGMENT, (1.0, 0.0), (0.5, 0.5)),  # {q - p} is the segment x = 1, |y| <= .5: one friction only
        (SEGMENT, (2.0, 1.0), (math.sqrt(5.0) / 4.0, math.sqrt(5.0) / 4.0)),  # its end
        (SEGMENT, (2.0, 1.01), hull_conditions.NEVER),
        (SEGMENT, (0.0, 1.0), hull_conditions.NEVER),
        (PAIR, (-3.0, -4.0), (0.25, 0.25)),
        (PAIR, (-1.0, 0.0), hull_conditions.NEVER),
    ],
)
def test_sliding_interval(case, direction, interval):
    assert hull_conditions.sliding_interval(*case, direction) == pytest.approx(interval, **ROUND)


def test_can_stick_and_can_slide_hold_at_the_ends():
    assert hull_conditions.can_stick(*CROSSED, 0.4) and not hull_conditions.can_stick(*CROSSED, 0.4 - 1e-9)
    assert hull_conditions.can_slide(*CROSSED, 0.4, (1.0, 0.0)) and not hull_conditions.can_slide(
        *CROSSED, 0.4 - 1e-9, (1.0, 0.0)
    )
    assert hull_conditions.can_slide(*SEGMENT, 0.5, (1.0, 0.0)) and not hull_conditions.can_slide(
        *SEGMENT, 0.5 + 1e-9, (1.0, 0.0)
    )


def test_three_spots_are_those_of_the_plane():
    x, h = (0.2, -2.0, 1.5), 4.0
    case = ([(x[0], 0.0)], [(x[1], 0.0), (x[2], 0.0)], h)
    ours = hull_conditions.sliding_interval(*case, (-1.0, 0.0))
    assert ours == pytest.approx(theory.sliding_interval(x, h), **ROUND)
    assert conditions.planar_interval(x[:1], x[1:], h) == theory.sliding_interval(x, h) == pytest.approx((-0.325, 0.55), **ROUND)


# -- hulls: degenerate places --

LINE = np.array([0.6, 0.8])


@pytest.mark.parametrize("scale", [1.0, 1e-6])
def test_places_in_line(scale):
    upper, lower = np.outer([0.1, 0.2, 0.35], LINE) * scale, np.outer([0.7, 1.3, 0.9, 1.0], LINE) * scale
    # P from .1 to .35, Q from .7 to 1.3 along one line; round-off of the products leaves slivers
    assert hull_conditions.required_friction(upper, lower, scale) == pytest.approx(0.35, rel=1e-12)
    assert hull_conditions.sliding_interval(upper, lower, scale, LINE) == pytest.approx((0.35, 1.2), rel=1e-12)
    assert hull_conditions.sliding_interval(upper, lower, scale, (0.6, 0.81)) == hull_conditions.NEVER


def test_slivers_that_round_off_leaves_are_no_area():
    """Along any direction: the sides of a sliver may all seem to have the origin on their left, far off its end."""
    for angle in np.linspace(0.0, 6.2, 500):
        path = np.array([math.cos(angle), math.sin(angle)])
        upper, lower = np.outer([0.1, 0.2, 0.35], path), np.outer([0.7, 1.3, 0.9, 1.0], path)
        assert hull_conditions.required_friction(upper, lower, 1.0) == pytest.approx(0.35, rel=1e-12)
        assert hull_conditions.sliding_interval(upper, lower, 1.0, path) == pytest.approx((0.35, 1.2), rel=1e-12)


def test_coincident_spots_count_once():
    upper, lower, h = TRIANGLE
    assert hull_conditions.required_friction(upper * 3, lower * 2, h) == hull_conditions.required_friction(*TRIANGLE)
    assert hull_conditions.required_friction([(0.1, 0.2)] * 2, [(0.1, 0.2)], 1.0) == 0.0
    assert hull_conditions.sliding_interval([(0.1, 0.2)] * 2, [(0.1, 0.2)], 1.0, (1.0, 0.0)) == (0.0, 0.0)
    assert (
        len(hull_conditions.convex_hull([(0.0, 0.0)] * 3)) == 1
        and len(hull_conditions.convex_hull([(0.0, 0.0), (1.0, 1.0), (2.0, 2.0)])) == 2
    )


@pytest.mark.parametrize(
    "upper, lower, h, direction",
    [([], [(0.0, 0.0)], 1.0, (1, 0)), ([(0.0, 0.0)], np.zeros((0, 2)), 1.0, (1, 0)), ([(0, 0)], [(1, 0)], 0.0, (1, 0)),
     ([(0, 0)], [(1, 0)], 1.0, (0, 0)), ([(0, 0, 0)], [(1, 0)], 1.0, (1, 0))],
)  # fmt: skip
def test_what_is_no_particle_is_refused(upper, lower, h, direction):
    with pytest.raises(ValueError):
        hull_conditions.sliding_interval(upper, lower, h, direction)


# -- hulls: invariance --


@pytest.mark.parametrize("case", random_cases(1, 20))
def test_answers_do_not_depend_on_frame_order_or_unit(case):
    upper, lower, h = case
    random = np.random.default_rng(2)
    angle, shift, e = 0.7, np.array([3.0, -5.0]), np.array([0.8, -0.6])
    turn = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
    mirror = np.array([-1.0, 1.0])
    mu, interval = hull_conditions.required_friction(*case), hull_conditions.sliding_interval(*case, e)
    for other, path in (
        ((upper + shift, lower + shift, h), e),
        ((upper @ turn.T, lower @ turn.T, h), turn @ e),
        ((upper * mirror, lower * mirror, h), e * mirror),
        ((random.permutation(upper), random.permutation(lower), h), e),
        ((upper * 1e-6, lower * 1e-6, h * 1e-6), e),
        ((lower, upper, h), -e),  # turned upside down, the upper side drags the other way
    ):
        # the shift is eight times the particle: it takes a digit
        assert hull_conditions.required_friction(*other) == pytest.approx(mu, rel=1e-11, abs=1e-14)
        assert hull_conditions.sliding_interval(*other, path) == pytest.approx(interval, rel=1e-11, abs=1e-13)


def test_required_friction_is_the_nearest_point_of_the_interval_over_all_directions():
    angles = np.linspace(0.0, 2.0 * math.pi, 7200, endpoint=False)
    ends = [hull_conditions.sliding_interval(*TRIANGLE, (math.cos(a), math.sin(a)))[0] for a in angles]
    nearest = min(t for t in ends if t > 0.0)  # each line is met twice, once backwards
    # a minimum met within half a step of 8.7e-4: relative error below its square
    assert nearest == pytest.approx(hull_conditions.required_friction(*TRIANGLE), rel=2e-7)


# -- hulls against cones --


@pytest.mark.parametrize("seed", range(6))
def test_hulls_do_not_contradict_linear_programs_on_sticking(seed):
    for upper, lower, h in random_cases(10 + seed, 50):
        mu = hull_conditions.required_friction(upper, lower, h)
        held = friction_cones.between_plates(upper, lower, h, 1.0, 1.0)
        # the inscribed pyramid of mu/cos(pi/K) contains the cone of mu; that of a smaller mu lies within it
        assert friction_cones.can_balance(held, mu / math.cos(math.pi / K) * (1.0 + SOLVER) + SOLVER, K)
        if mu > SOLVER:
            assert not friction_cones.can_balance(held, mu * (1.0 - SOLVER) - SOLVER, K)


@pytest.mark.parametrize("seed", range(6))
def test_hulls_do_not_contradict_linear_programs_on_sliding(seed):
    random = np.random.default_rng(20 + seed)
    met = 0
    for upper, lower, h in random_cases(30 + seed, 50):
        middle = lower.mean(axis=0) - upper.mean(axis=0)
        e = middle / np.hypot(*middle) if random.random() < 0.7 else np.array([0.6, 0.8])
        pulls = np.repeat([[*e, 0.0], [*-e, 0.0]], [len(upper), len(lower)], axis=0)
        low, high = hull_conditions.sliding_interval(upper, lower, h, e)

        def slides(mu, case=(upper, lower, h), pulls=pulls):
            return friction_cones.can_slide(friction_cones.between_plates(*case, mu, mu), pulls)

        width = 1e-4 * (high - low)
        if high > 0.0 and width > 0.0:
            met += 1
            assert slides(high - width) and slides(max(low, 0.0) + width)
            assert not slides(high + 1e-3)
            assert low < 2e-3 or not slides(low - 1e-3)
        elif high < low:
            mu = random.uniform(0.0, 2.0)
            # the solver's residual may reach a line that passes the set closely: only clear cases count
            nearby = [hull_conditions.sliding_interval(upper, lower, h, e + d * np.array([-e[1], e[0]])) for d in (-1e-3, 1e-3)]
            assert not slides(mu) or min(nearby) != hull_conditions.NEVER
    assert met > 15  # the test compares something


# -- cones --


def test_brackets_close_in_like_the_cosine():
    mu = hull_conditions.required_friction(*TRIANGLE)
    held = friction_cones.between_plates(*TRIANGLE, 1.0, 1.0)
    for edges in (3, 5, 8, 16, 64):
        lower, upper = friction_cones.required_scale(held, edges)
        assert lower * (1.0 - SOLVER) <= mu <= upper * (1.0 + SOLVER)
        # the bisection stops at 1e-7 absolute
        assert lower / upper == pytest.approx(math.cos(math.pi / edges), rel=1e-6)


def test_frictions_that_differ_scale_together():
    held = friction_cones.between_plates(*PAIR, 0.5, 0.2)
    low, high = friction_cones.required_scale(held)
    assert low <= 0.25 / 0.2 * (1.0 + SOLVER) and 0.25 / 0.2 <= high * (1.0 + SOLVER)  # the weaker side decides
    assert friction_cones.required_scale(friction_cones.between_plates(*PAIR, 0.0, 0.2)) == (math.inf, math.inf)
    assert friction_cones.required_scale(friction_cones.between_plates([(0.0, 0.0)], [(0.0, 0.0)], 1.0, 0.0, 0.0)) == (0.0, 0.0)


def test_a_block_on_a_slope_and_a_wedge():
    slope = math.tan(0.4)
    feet = [(1.0, 1.0, 0.0), (-1.0, 1.0, 0.0), (-1.0, -1.0, 0.0), (1.0, -1.0, 0.0)]
    weight = (math.sin(0.4), 0.0, -math.cos(0.4))
    held = friction_cones.grasp(feet, [(0.0, 0.0, 1.0)] * 4, 0.5, [True] * 4, math.cos(0.4), weight)
    low, high = friction_cones.required_scale(held, 64)
    assert low * (1.0 - SOLVER) <= slope / 0.5 <= high * (1.0 + SOLVER)
    # a moment of the weight about the lower edge: centre of mass at height z tips it once z tan > 1, whatever the friction
    for z, held_fast in ((0.9 / slope, True), (1.1 / slope, False)):
        turned = friction_cones.grasp(feet, held.normals, 5.0, held.pressed, held.load, weight, np.cross((0.0, 0.0, z), weight))
        assert friction_cones.can_balance(turned, 1.0, 64) == held_fast
    # two walls that lean by 2 gamma hold what is between them without weight iff mu >= tan gamma
    gamma = 0.3
    walls = [(math.cos(gamma), 0.0, -math.sin(gamma)), (-math.cos(gamma), 0.0, -math.sin(gamma))]
    wedge = friction_cones.grasp([(-1.0, 0.0, 0.0), (1.0, 0.0, 0.0)], walls, 1.0, [True, False], axis=(0.0, 0.0, 1.0))
    assert wedge.axis is not None
    pinched = friction_cones.grasp(wedge.points, walls, 1.0, wedge.pressed)
    low, high = friction_cones.required_scale(pinched, 64)
    assert low * (1.0 - SOLVER) <= math.tan(gamma) <= high * (1.0 + SOLVER)


def test_shift_of_the_reference_point_takes_its_moment_along():
    force, arm = np.array([0.05, 0.1, -0.3]), np.array([0.2, -0.3, 0.1])
    held = friction_cones.between_plates(*TRIANGLE, 0.5, 0.5)
    first = friction_cones.grasp(held.points, held.normals, held.mu, held.pressed, 1.0, force, (0.0, 0.02, 0.03))
    moved = friction_cones.grasp(
        held.points - arm, held.normals, held.mu, held.pressed, 1.0, force, first.moment - np.cross(arm, force)
    )
    # both bisect to 1e-7
    assert friction_cones.required_scale(first) == pytest.approx(friction_cones.required_scale(moved), abs=1e-6)
    assert math.isfinite(friction_cones.required_scale(first)[1])


@pytest.mark.parametrize("change", [{"load": 0.0}, {"mu": -0.1}, {"normals": [(0.0, 0.0, 2.0)]}, {"pressed": [True, True]}])
def test_what_is_no_grasp_is_refused(change):
    good = {"points": [(0.0, 0.0, 0.0)], "normals": [(0.0, 0.0, 1.0)], "mu": 0.1, "pressed": [True], "load": 1.0}
    with pytest.raises(ValueError):
        friction_cones.grasp(**(good | change))
    with pytest.raises(ValueError, match="edges"):
        friction_cones.required_scale(friction_cones.grasp(**good), 2)


# -- the plane, with weight --


@pytest.mark.parametrize("seed", range(40))
def test_plane_with_weight_against_linear_programs(seed):
    random = np.random.default_rng(100 + seed)
    upper, lower = (random.uniform(-1.0, 1.0, random.integers(1, 4)) + random.uniform(-0.7, 0.7) for _ in range(2))
    h, mus, w = random.uniform(0.5, 2.0), random.uniform(0.05, 1.0, 2), random.choice([0.0, 0.3, 1.0])
    scale = conditions.required_scale(upper, lower, h, *mus, w)
    sides = [np.column_stack([x, np.zeros(len(x))]) for x in (upper, lower)]
    held = friction_cones.between_plates(*sides, h, *mus, w, axis=(1.0, 0.0, 0.0))
    assert friction_cones.required_scale(held) == pytest.approx((scale, scale), rel=SOLVER, abs=SOLVER)
    assert friction_cones.can_balance(held) == (scale <= 1.0) or scale == pytest.approx(1.0, rel=SOLVER)


def test_weight_moves_the_interval():
    upper, lower, h = (0.2,), (-2.0, 1.5), 4.0
    assert conditions.planar_interval(upper, lower, h, 0.5) == pytest.approx(((0.2 - 2.25) / 4.0, 3.2 / 4.0), **ROUND)
    # at the ends the lower resultant stands on a spot
    for t, spot in zip(conditions.planar_interval(upper, lower, h, 0.5), (1.5, -2.0), strict=True):
        assert conditions.lower_resultant(0.2, t, h, 0.5) == pytest.approx(spot, rel=1e-14)
    assert conditions.planar_interval((0.2,), (-2.0,), h)[0] == theory.two_spot_friction(0.2, -2.0, h)
    for bad in (((), lower, h), (upper, (), h), (upper, lower, 0.0), (upper, lower, h, -0.1)):
        with pytest.raises(ValueError):
            conditions.planar_interval(*bad)


def test_eq_20_names_the_side_that_slides():
    spots = ((0.2,), (-2.0, 1.5), 4.0)
    assert conditions.sliding_sides(*spots, 0.3, 0.3) == ("upper", "lower")
    assert conditions.sliding_sides(*spots, 0.3, 0.25) == ("lower",)
    assert conditions.sliding_sides(*spots, 0.3, 0.25, theory.sliding_weight_ratio(0.3, 0.25)) == ("upper", "lower")
    assert conditions.sliding_sides(*spots, 0.3, 0.3, 0.01) == ("upper",)  # any weight with equal friction
    assert conditions.sliding_sides(*spots, 0.56, 0.56) == ()  # t_max = .55
    # mirrored, the particle is dragged against what was its far side: t_max = .325
    mirrored = ((-0.2,), (2.0, -1.5), 4.0)
    assert conditions.sliding_sides(*mirrored, 0.32, 0.32) and not conditions.sliding_sides(*mirrored, 0.33, 0.33)


def test_two_contacts_stick_from_the_friction_angle():
    alpha = theory.two_spot_friction(0.2, -0.4, 2.0)
    assert conditions.required_scale((0.2,), (-0.4,), 2.0, alpha, alpha) == pytest.approx(1.0, rel=1e-14)
    assert conditions.required_scale((0.2,), (-0.4,), 2.0, 0.0, 1.0) == math.inf
    assert conditions.required_scale((0.2,), (0.2,), 2.0, 0.0, 0.0) == 0.0


def test_a_steady_drag_ends_sliding_or_tipping():
    spots = ((0.2,), (-2.0, 1.5), 4.0)
    assert conditions.dragged_friction(*spots, 0.3) == (0.3, "sliding")
    friction, state = conditions.dragged_friction(*spots, 0.9)
    assert state == "rolling" and friction == pytest.approx(0.55, rel=1e-14)
    with pytest.raises(ValueError, match="at rest"):
        conditions.dragged_friction((3.0,), (-2.0, 1.5), 4.0, 0.3)  # t_min = .375
    # x_1 = 0, symmetric, tilt free: slides up to mu h = L although Eq. 22 says mu h = 0 without tilt
    assert conditions.dragged_friction((0.0,), (-1.0, 1.0), 2.0, 0.5) == (0.5, "sliding")


# -- normal forces with tilt and weight --

E1 = theory.e_star(80e9, 0.3, 120e9, 0.2)
E2 = theory.e_star(60e9, 0.35, 120e9, 0.2)
R = (2e-6, 1e-6, 1.5e-6)
X = (0.2e-6, -2e-6, 1.5e-6)
CLOSING = 10e-9

# weight, N: (N_1, N_2, N_3); mpmath, 30 digits, Newton on Eqs. 1, 5 and 6 in w and phi
HEAVY = {
    0.0: (99.9958052503446104e-6, 37.141299092985141e-6, 62.8545061573594694e-6),
    1e-6: (99.5523794566561764e-6, 37.4051695124722941e-6, 63.1472099441838823e-6),
    1e-5: (95.598422042237279e-6, 39.7936996156881322e-6, 65.8047224265491468e-6),
    5e-5: (78.8094393390560598e-6, 50.7006488973636793e-6, 78.1087904416923804e-6),
}


@pytest.mark.parametrize("weight", HEAVY)
def test_normal_forces_with_tilt_and_weight(weight):
    assert conditions.tilted_normal_forces(X, E1, E2, R, CLOSING, weight) == pytest.approx(HEAVY[weight], rel=1e-12, abs=0.0)


def test_weightless_normal_forces_are_the_smooth_tilted_state():
    ours = conditions.tilted_normal_forces(X, E1, E2, R, CLOSING, 0.0)
    assert ours == pytest.approx(theory.tilted_state(X, E1, E2, R, CLOSING, 0.0)[2], rel=1e-13)


def test_a_particle_that_need_not_tilt_follows_eq_9():
    radii, x = (2e-6, 1e-6, 1e-6), (0.0, -1e-6, 1e-6)
    weight = 2e-5
    m = theory.weight_number(weight, E1, radii[0], CLOSING)
    delta = theory.upper_fraction(theory.compliance_ratio(E1, radii[0], E2, *radii[1:]), m)
    upper, left, right = conditions.tilted_normal_forces(x, E1, E2, radii, CLOSING, weight)
    assert upper == pytest.approx(theory.hertz_force(E1, radii[0], delta * CLOSING), rel=1e-12)
    assert left == pytest.approx(right, rel=1e-14) and left + right - upper == pytest.approx(weight, rel=1e-13)


def test_series_in_the_weight_is_of_second_order():
    particle = (X, E1, E2, R, CLOSING)
    exact, series = conditions.tilted_normal_forces, conditions.tilted_force_series
    errors = [abs(series(*particle, weight) - exact(*particle, weight)[0]) for weight in (2e-6, 4e-6)]
    assert math.log2(errors[1] / errors[0]) == pytest.approx(3.0, abs=0.05)  # the first missing term is (m g)^3
    with pytest.raises(ValueError, match="between"):
        conditions.tilted_force_series((2e-6, *X[1:]), E1, E2, R, CLOSING, 0.0)


def test_a_spot_that_lifts_off_is_reported():
    with pytest.raises(ValueError, match="lifts off"):
        conditions.tilted_normal_forces((2e-6, *X[1:]), E1, E2, R, CLOSING, 0.0)  # x_1 beyond x_3
    with pytest.raises(ValueError, match="lifts off"):
        conditions.tilted_normal_forces(X, E1, E2, R, CLOSING, 1e-3)  # dh is less than the weight alone needs
    # the centre of mass left of spot 2: the weight lifts spot 3 until N_1 (x_1 - x_2) = m g x_2 turns it back
    hanging, weight = (0.5e-6, 0.2e-6, 1.5e-6), 9e-5
    force = weight * 0.2 / 0.3
    onset = theory.hertz_overlap(E1, R[0], force) + theory.hertz_overlap(E2, R[1], force + weight) * 1.0 / 1.3
    with pytest.raises(ValueError, match="lifts off"):
        conditions.tilted_normal_forces(hanging, E1, E2, R, 0.999 * onset, weight)
    assert min(conditions.tilted_normal_forces(hanging, E1, E2, R, 1.001 * onset, weight)) > 0.0
    # x_1 beyond x_3 stands while the weight holds spot 2 down: N_2 >= 0 bounds N_1
    beyond = (1.6e-6, *X[1:])
    force, left, right = conditions.tilted_normal_forces(beyond, E1, E2, R, 5e-9, 5e-5)
    assert min(force, left, right) > 0.0 and left + right - force == pytest.approx(5e-5, rel=1e-12)
    assert force * beyond[0] - left * beyond[1] - right * beyond[2] == pytest.approx(0.0, abs=1e-13 * right * 1e-6)


# -- imports --


@pytest.mark.parametrize("module", [conditions, hull_conditions, friction_cones])
def test_theory_imports_nothing_of_ours(module):
    nodes = list(ast.walk(ast.parse(Path(module.__file__).read_text(encoding="utf-8"))))
    names = {alias.name for node in nodes if isinstance(node, ast.Import) for alias in node.names}
    relative = {node.module for node in nodes if isinstance(node, ast.ImportFrom) and node.level}
    names |= {node.module for node in nodes if isinstance(node, ast.ImportFrom) and node.module}
    assert not relative and not [name for name in names if "thirdbody" in name]
