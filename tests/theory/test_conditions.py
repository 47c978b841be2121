"""When a particle can stick or slide: hulls, the plane with weight, and friction cones by linear programming against each other.

Places are in units of the particle where no unit is said. P is the upper side, Q the lower one.
"""

import ast
import math
from pathlib import Path

import friction_cones as cones
import hull_conditions as hulls
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


def random_cases(seed, count):
    random = np.random.default_rng(seed)
    sides = lambda: random.uniform(-1.0, 1.0, (random.integers(1, 7), 2)) + random.uniform(-0.8, 0.8, 2)  # noqa: E731
    return [(sides(), sides(), random.uniform(0.3, 3.0)) for _ in range(count)]


INTERVALS = [
    (TRIANGLE, (-1.0, 0.0), (4.0 / 15.0, 14.0 / 15.0)),  # Q at y = .4 reaches from -2/3 to 2/3
    (TRIANGLE, (0.0, 1.0), hulls.NEVER),
    # (1.2 - 3 s, .4 + s) meets the sides of Q at s = .64/2.6 and 2.24/4.6; t = s sqrt(10)/2
    (TRIANGLE, (-3.0, 1.0), (0.389203404328415918, 0.769945865084474968)),
    (CROSSED, (1.0, 0.0), (0.4, 1.4 / 1.5)),
    (CROSSED, (-1.0, 0.0), (-1.4 / 1.5, -0.4)),
    (CROSSED, (2.0, 2.0), (0.6 * math.sqrt(2.0) / 1.5, math.sqrt(2.0) / 1.5)),  # {q - p} = [.6, 1.4] x [-1, 1]
    (CROSSED, (0.0, 1.0), hulls.NEVER),
    (SEGMENT, (1.0, 0.0), (0.5, 0.5)),  # {q - p} is the segment x = 1, |y| <= .5: one friction only
    (SEGMENT, (2.0, 1.0), (math.sqrt(5.0) / 4.0, math.sqrt(5.0) / 4.0)),  # its end
    (SEGMENT, (2.0, 1.01), hulls.NEVER),
    (SEGMENT, (0.0, 1.0), hulls.NEVER),
    (PAIR, (-3.0, -4.0), (0.25, 0.25)),
    (PAIR, (-1.0, 0.0), hulls.NEVER),
]


def test_hulls_in_numbers():
    # from the line 1.2 x + y = 1.2: .64/sqrt(2.44)/2; tan alpha of Eq. 16: .5/2
    for case, mu in ((TRIANGLE, 0.204859007892633558), (CROSSED, 0.4), (SEGMENT, 0.5), (PAIR, 0.25)):
        assert hulls.required_friction(*case) == pytest.approx(mu, **ROUND)
    for case, direction, interval in INTERVALS:
        assert hulls.sliding_interval(*case, direction) == pytest.approx(interval, **ROUND), (case, direction)
    # both hold at the ends
    assert hulls.can_stick(*CROSSED, 0.4) and not hulls.can_stick(*CROSSED, 0.4 - 1e-9)
    for case, mu, beyond in ((CROSSED, 0.4, 0.4 - 1e-9), (SEGMENT, 0.5, 0.5 + 1e-9)):
        assert hulls.can_slide(*case, mu, (1.0, 0.0)) and not hulls.can_slide(*case, beyond, (1.0, 0.0))
    # three spots are those of the plane
    x, h = (0.2, -2.0, 1.5), 4.0
    case = ([(x[0], 0.0)], [(x[1], 0.0), (x[2], 0.0)], h)
    ours = hulls.sliding_interval(*case, (-1.0, 0.0))
    assert ours == pytest.approx(theory.sliding_interval(x, h), **ROUND)
    assert conditions.planar_interval(x[:1], x[1:], h) == theory.sliding_interval(x, h) == pytest.approx((-0.325, 0.55), **ROUND)


def test_places_in_line():
    """P from .1 to .35, Q from .7 to 1.3 along one line: round-off leaves slivers, whose sides may all seem to have the origin on
    their left, far off its end; they are no area."""
    for angle, scale in [(angle, 1.0) for angle in np.linspace(0.0, 6.2, 200)] + [(0.927, 1e-6)]:
        path = np.array([math.cos(angle), math.sin(angle)])
        upper, lower = np.outer([0.1, 0.2, 0.35], path) * scale, np.outer([0.7, 1.3, 0.9, 1.0], path) * scale
        assert hulls.required_friction(upper, lower, scale) == pytest.approx(0.35, rel=1e-12)
        assert hulls.sliding_interval(upper, lower, scale, path) == pytest.approx((0.35, 1.2), rel=1e-12)
        assert hulls.sliding_interval(upper, lower, scale, path + 0.006 * path[::-1] * (-1.0, 1.0)) == hulls.NEVER


def test_coincident_spots_count_once():
    upper, lower, h = TRIANGLE
    assert hulls.required_friction(upper * 3, lower * 2, h) == hulls.required_friction(*TRIANGLE)
    assert hulls.required_friction([(0.1, 0.2)] * 2, [(0.1, 0.2)], 1.0) == 0.0
    assert hulls.sliding_interval([(0.1, 0.2)] * 2, [(0.1, 0.2)], 1.0, (1.0, 0.0)) == (0.0, 0.0)
    assert len(hulls.convex_hull([(0.0, 0.0)] * 3)) == 1 and len(hulls.convex_hull([(0.0, 0.0), (1.0, 1.0), (2.0, 2.0)])) == 2
    # what is no particle is refused
    for upper, lower, h, direction in (
        ([], [(0.0, 0.0)], 1.0, (1, 0)), ([(0.0, 0.0)], np.zeros((0, 2)), 1.0, (1, 0)), ([(0, 0)], [(1, 0)], 0.0, (1, 0)),
        ([(0, 0)], [(1, 0)], 1.0, (0, 0)), ([(0, 0, 0)], [(1, 0)], 1.0, (1, 0)),
    ):  # fmt: skip
        with pytest.raises(ValueError):
            hulls.sliding_interval(upper, lower, h, direction)


@pytest.mark.full(kind="slow")
@pytest.mark.parametrize("seed", range(6))
def test_hulls_do_not_contradict_linear_programs_on_sticking(seed):
    for upper, lower, h in random_cases(10 + seed, 50):
        mu = hulls.required_friction(upper, lower, h)
        held = cones.between_plates(upper, lower, h, 1.0, 1.0)
        # the inscribed pyramid of mu/cos(pi/K) contains the cone of mu; that of a smaller mu lies within it
        assert cones.can_balance(held, mu / math.cos(math.pi / K) * (1.0 + SOLVER) + SOLVER, K)
        if mu > SOLVER:
            assert not cones.can_balance(held, mu * (1.0 - SOLVER) - SOLVER, K)


@pytest.mark.full(kind="slow")
@pytest.mark.parametrize("seed", range(6))
def test_hulls_do_not_contradict_linear_programs_on_sliding(seed):
    random = np.random.default_rng(20 + seed)
    met = 0
    for upper, lower, h in random_cases(30 + seed, 50):
        middle = lower.mean(axis=0) - upper.mean(axis=0)
        e = middle / np.hypot(*middle) if random.random() < 0.7 else np.array([0.6, 0.8])
        pulls = np.repeat([[*e, 0.0], [*-e, 0.0]], [len(upper), len(lower)], axis=0)
        low, high = hulls.sliding_interval(upper, lower, h, e)

        def slides(mu, case=(upper, lower, h), pulls=pulls):
            return cones.can_slide(cones.between_plates(*case, mu, mu), pulls)

        width = 1e-4 * (high - low)
        if high > 0.0 and width > 0.0:
            met += 1
            assert slides(high - width) and slides(max(low, 0.0) + width)
            assert not slides(high + 1e-3)
            assert low < 2e-3 or not slides(low - 1e-3)
        elif high < low:
            mu = random.uniform(0.0, 2.0)
            # the solver's residual may reach a line that passes the set closely: only clear cases count
            nearby = [hulls.sliding_interval(upper, lower, h, e + d * np.array([-e[1], e[0]])) for d in (-1e-3, 1e-3)]
            assert not slides(mu) or min(nearby) != hulls.NEVER
    assert met > 15  # the test compares something


def test_brackets_close_in_like_the_cosine():
    mu = hulls.required_friction(*TRIANGLE)
    held = cones.between_plates(*TRIANGLE, 1.0, 1.0)
    for edges in (3, 5, 8, 16, 64):
        lower, upper = cones.required_scale(held, edges)
        assert lower * (1.0 - SOLVER) <= mu <= upper * (1.0 + SOLVER)
        # the bisection stops at 1e-7 absolute
        assert lower / upper == pytest.approx(math.cos(math.pi / edges), rel=1e-6)
    # frictions that differ scale together
    held = cones.between_plates(*PAIR, 0.5, 0.2)
    low, high = cones.required_scale(held)
    assert low <= 0.25 / 0.2 * (1.0 + SOLVER) and 0.25 / 0.2 <= high * (1.0 + SOLVER)  # the weaker side decides
    assert cones.required_scale(cones.between_plates(*PAIR, 0.0, 0.2)) == (math.inf, math.inf)
    assert cones.required_scale(cones.between_plates([(0.0, 0.0)], [(0.0, 0.0)], 1.0, 0.0, 0.0)) == (0.0, 0.0)


def test_a_block_on_a_slope_and_a_wedge():
    slope = math.tan(0.4)
    feet = [(1.0, 1.0, 0.0), (-1.0, 1.0, 0.0), (-1.0, -1.0, 0.0), (1.0, -1.0, 0.0)]
    weight = (math.sin(0.4), 0.0, -math.cos(0.4))
    held = cones.grasp(feet, [(0.0, 0.0, 1.0)] * 4, 0.5, [True] * 4, math.cos(0.4), weight)
    low, high = cones.required_scale(held, 64)
    assert low * (1.0 - SOLVER) <= slope / 0.5 <= high * (1.0 + SOLVER)
    # a moment of the weight about the lower edge: centre of mass at height z tips it once z tan > 1, whatever the friction
    for z, held_fast in ((0.9 / slope, True), (1.1 / slope, False)):
        turned = cones.grasp(feet, held.normals, 5.0, held.pressed, held.load, weight, np.cross((0.0, 0.0, z), weight))
        assert cones.can_balance(turned, 1.0, 64) == held_fast
    # two walls that lean by 2 gamma hold what is between them without weight iff mu >= tan gamma
    gamma = 0.3
    walls = [(math.cos(gamma), 0.0, -math.sin(gamma)), (-math.cos(gamma), 0.0, -math.sin(gamma))]
    wedge = cones.grasp([(-1.0, 0.0, 0.0), (1.0, 0.0, 0.0)], walls, 1.0, [True, False], axis=(0.0, 0.0, 1.0))
    assert wedge.axis is not None
    pinched = cones.grasp(wedge.points, walls, 1.0, wedge.pressed)
    low, high = cones.required_scale(pinched, 64)
    assert low * (1.0 - SOLVER) <= math.tan(gamma) <= high * (1.0 + SOLVER)


def test_shift_of_the_reference_point_takes_its_moment_along():
    force, arm = np.array([0.05, 0.1, -0.3]), np.array([0.2, -0.3, 0.1])
    held = cones.between_plates(*TRIANGLE, 0.5, 0.5)
    first = cones.grasp(held.points, held.normals, held.mu, held.pressed, 1.0, force, (0.0, 0.02, 0.03))
    moved = cones.grasp(held.points - arm, held.normals, held.mu, held.pressed, 1.0, force, first.moment - np.cross(arm, force))
    # both bisect to 1e-7
    assert cones.required_scale(first) == pytest.approx(cones.required_scale(moved), abs=1e-6)
    assert math.isfinite(cones.required_scale(first)[1])
    # what is no grasp is refused
    good = {"points": [(0.0, 0.0, 0.0)], "normals": [(0.0, 0.0, 1.0)], "mu": 0.1, "pressed": [True], "load": 1.0}
    for change in ({"load": 0.0}, {"mu": -0.1}, {"normals": [(0.0, 0.0, 2.0)]}, {"pressed": [True, True]}):
        with pytest.raises(ValueError):
            cones.grasp(**(good | change))
    with pytest.raises(ValueError, match="edges"):
        cones.required_scale(cones.grasp(**good), 2)


@pytest.mark.parametrize("seeds", [range(8), pytest.param(range(8, 40), marks=pytest.mark.full(kind="slow"))])
def test_plane_with_weight_against_linear_programs(seeds):
    for random in map(np.random.default_rng, 100 + np.array(seeds)):
        upper, lower = (random.uniform(-1.0, 1.0, random.integers(1, 4)) + random.uniform(-0.7, 0.7) for _ in range(2))
        h, mus, w = random.uniform(0.5, 2.0), random.uniform(0.05, 1.0, 2), random.choice([0.0, 0.3, 1.0])
        scale = conditions.required_scale(upper, lower, h, *mus, w)
        sides = [np.column_stack([x, np.zeros(len(x))]) for x in (upper, lower)]
        held = cones.between_plates(*sides, h, *mus, w, axis=(1.0, 0.0, 0.0))
        assert cones.required_scale(held) == pytest.approx((scale, scale), rel=SOLVER, abs=SOLVER)
        assert cones.can_balance(held) == (scale <= 1.0) or scale == pytest.approx(1.0, rel=SOLVER)


def test_the_plane_in_numbers():
    upper, lower, h = (0.2,), (-2.0, 1.5), 4.0
    assert conditions.planar_interval(upper, lower, h, 0.5) == pytest.approx(((0.2 - 2.25) / 4.0, 3.2 / 4.0), **ROUND)
    # at the ends the lower resultant stands on a spot
    for t, spot in zip(conditions.planar_interval(upper, lower, h, 0.5), (1.5, -2.0), strict=True):
        assert conditions.lower_resultant(0.2, t, h, 0.5) == pytest.approx(spot, rel=1e-14)
    assert conditions.planar_interval((0.2,), (-2.0,), h)[0] == theory.two_spot_friction(0.2, -2.0, h)
    for bad in (((), lower, h), (upper, (), h), (upper, lower, 0.0), (upper, lower, h, -0.1)):
        with pytest.raises(ValueError):
            conditions.planar_interval(*bad)
    # Eq. 20 names the side that slides
    spots = ((0.2,), (-2.0, 1.5), 4.0)
    assert conditions.sliding_sides(*spots, 0.3, 0.3) == ("upper", "lower")
    assert conditions.sliding_sides(*spots, 0.3, 0.25) == ("lower",)
    assert conditions.sliding_sides(*spots, 0.3, 0.25, theory.sliding_weight_ratio(0.3, 0.25)) == ("upper", "lower")
    assert conditions.sliding_sides(*spots, 0.3, 0.3, 0.01) == ("upper",)  # any weight with equal friction
    assert conditions.sliding_sides(*spots, 0.56, 0.56) == ()  # t_max = .55
    # mirrored, the particle is dragged against what was its far side: t_max = .325
    mirrored = ((-0.2,), (2.0, -1.5), 4.0)
    assert conditions.sliding_sides(*mirrored, 0.32, 0.32) and not conditions.sliding_sides(*mirrored, 0.33, 0.33)
    # two contacts stick from the friction angle
    alpha = theory.two_spot_friction(0.2, -0.4, 2.0)
    assert conditions.required_scale((0.2,), (-0.4,), 2.0, alpha, alpha) == pytest.approx(1.0, rel=1e-14)
    assert conditions.required_scale((0.2,), (-0.4,), 2.0, 0.0, 1.0) == math.inf
    assert conditions.required_scale((0.2,), (0.2,), 2.0, 0.0, 0.0) == 0.0
    # a steady drag ends sliding or tipping
    assert conditions.dragged_friction(*spots, 0.3) == (0.3, "sliding")
    friction, state = conditions.dragged_friction(*spots, 0.9)
    assert state == "rolling" and friction == pytest.approx(0.55, rel=1e-14)
    with pytest.raises(ValueError, match="at rest"):
        conditions.dragged_friction((3.0,), (-2.0, 1.5), 4.0, 0.3)  # t_min = .375
    # x_1 = 0, symmetric, tilt free: slides up to mu h = L although Eq. 22 says mu h = 0 without tilt
    assert conditions.dragged_friction((0.0,), (-1.0, 1.0), 2.0, 0.5) == (0.5, "sliding")


E1, E2 = theory.e_star(80e9, 0.3, 120e9, 0.2), theory.e_star(60e9, 0.35, 120e9, 0.2)
R, X, CLOSING = (2e-6, 1e-6, 1.5e-6), (0.2e-6, -2e-6, 1.5e-6), 10e-9

# weight, N: (N_1, N_2, N_3); mpmath, 30 digits, Newton on Eqs. 1, 5 and 6 in w and phi
HEAVY = {
    0.0: (99.9958052503446104e-6, 37.141299092985141e-6, 62.8545061573594694e-6),
    1e-6: (99.5523794566561764e-6, 37.4051695124722941e-6, 63.1472099441838823e-6),
    1e-5: (95.598422042237279e-6, 39.7936996156881322e-6, 65.8047224265491468e-6),
    5e-5: (78.8094393390560598e-6, 50.7006488973636793e-6, 78.1087904416923804e-6),
}


def test_normal_forces_with_tilt_and_weight():
    ours = {weight: conditions.tilted_normal_forces(X, E1, E2, R, CLOSING, weight) for weight in HEAVY}
    for weight, forces in HEAVY.items():
        assert ours[weight] == pytest.approx(forces, rel=1e-12, abs=0.0)
    assert ours[0.0] == pytest.approx(theory.tilted_state(X, E1, E2, R, CLOSING, 0.0)[2], rel=1e-13)
    # a particle that need not tilt follows Eq. 9
    radii, x, weight = (2e-6, 1e-6, 1e-6), (0.0, -1e-6, 1e-6), 2e-5
    m = theory.weight_number(weight, E1, radii[0], CLOSING)
    delta = theory.upper_fraction(theory.compliance_ratio(E1, radii[0], E2, *radii[1:]), m)
    upper, left, right = conditions.tilted_normal_forces(x, E1, E2, radii, CLOSING, weight)
    assert upper == pytest.approx(theory.hertz_force(E1, radii[0], delta * CLOSING), rel=1e-12)
    assert left == pytest.approx(right, rel=1e-14) and left + right - upper == pytest.approx(weight, rel=1e-13)
    # the series in the weight is of second order
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


def test_theory_imports_nothing_of_ours():
    for module in (conditions, hulls, cones):
        nodes = list(ast.walk(ast.parse(Path(module.__file__).read_text(encoding="utf-8"))))
        names = {alias.name for node in nodes if isinstance(node, ast.Import) for alias in node.names}
        names |= {"thirdbody." * bool(node.level) + str(node.module) for node in nodes if isinstance(node, ast.ImportFrom)}
        assert not [name for name in names if "thirdbody" in name]
