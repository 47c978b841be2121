"""When a particle can stick or slide: the plane with weight against friction cones, the compiled forecast against hulls; how far
it is from static equilibrium."""

import math

import friction_cones as cones
import hull_conditions as hulls
import numpy as np
import pytest
import three_spot_theory as theory
from steel import SCENES
from thirdbody_three_spot import LABELLER
from thirdbody_three_spot.balance import balance
from thirdbody_three_spot.forecast import forecast, hull_corners
import thirdbody
from thirdbody.assembly.simulation import build

ROUND = {"rel": 1e-13, "abs": 1e-14}  # closed forms of a few operations on numbers of order 1
SOLVER = 1e-6  # the residual of 1e-8 that counts as balance, times the ratio of arms that occur below


@pytest.mark.parametrize("seeds", [range(8), pytest.param(range(8, 40), marks=pytest.mark.full(kind="slow"))])
def test_plane_with_weight_against_linear_programs(seeds):
    for random in map(np.random.default_rng, 100 + np.array(seeds)):
        upper, lower = (random.uniform(-1.0, 1.0, random.integers(1, 4)) + random.uniform(-0.7, 0.7) for _ in range(2))
        h, mus, w = random.uniform(0.5, 2.0), random.uniform(0.05, 1.0, 2), random.choice([0.0, 0.3, 1.0])
        scale = theory.required_scale(upper, lower, h, *mus, w)
        sides = [np.column_stack([x, np.zeros(len(x))]) for x in (upper, lower)]
        held = cones.between_plates(*sides, h, *mus, w, axis=(1.0, 0.0, 0.0))
        assert cones.required_scale(held) == pytest.approx((scale, scale), rel=SOLVER, abs=SOLVER)
        assert cones.can_balance(held) == (scale <= 1.0) or scale == pytest.approx(1.0, rel=SOLVER)


def test_the_plane_in_numbers():
    upper, lower, h = (0.2,), (-2.0, 1.5), 4.0
    assert theory.planar_interval(upper, lower, h, 0.5) == pytest.approx(((0.2 - 2.25) / 4.0, 3.2 / 4.0), **ROUND)
    # at the ends the lower resultant stands on a spot
    for t, spot in zip(theory.planar_interval(upper, lower, h, 0.5), (1.5, -2.0), strict=True):
        assert theory.lower_resultant(0.2, t, h, 0.5) == pytest.approx(spot, rel=1e-14)
    assert theory.planar_interval((0.2,), (-2.0,), h)[0] == theory.two_spot_friction(0.2, -2.0, h)
    assert (
        theory.planar_interval(upper, lower, h)
        == theory.sliding_interval((0.2, *lower), h)
        == pytest.approx((-0.325, 0.55), **ROUND)
    )
    # Eq. 20 names the side that slides
    spots = ((0.2,), (-2.0, 1.5), 4.0)
    assert theory.sliding_sides(*spots, 0.3, 0.3) == ("upper", "lower")
    assert theory.sliding_sides(*spots, 0.3, 0.25) == ("lower",)
    assert theory.sliding_sides(*spots, 0.3, 0.25, theory.sliding_weight_ratio(0.3, 0.25)) == ("upper", "lower")
    assert theory.sliding_sides(*spots, 0.3, 0.3, 0.01) == ("upper",)  # any weight with equal friction
    assert theory.sliding_sides(*spots, 0.56, 0.56) == ()  # t_max = .55
    # two contacts stick from the friction angle
    alpha = theory.two_spot_friction(0.2, -0.4, 2.0)
    assert theory.required_scale((0.2,), (-0.4,), 2.0, alpha, alpha) == pytest.approx(1.0, rel=1e-14)
    assert theory.required_scale((0.2,), (-0.4,), 2.0, 0.0, 1.0) == math.inf
    assert theory.required_scale((0.2,), (0.2,), 2.0, 0.0, 0.0) == 0.0
    # a steady drag ends sliding or tipping
    assert theory.dragged_friction(*spots, 0.3) == (0.3, "sliding")
    friction, state = theory.dragged_friction(*spots, 0.9)
    assert state == "rolling" and friction == pytest.approx(0.55, rel=1e-14)
    with pytest.raises(ValueError, match="at rest"):
        theory.dragged_friction((3.0,), (-2.0, 1.5), 4.0, 0.3)  # t_min = .375
    # x_1 = 0, symmetric, tilt free: slides up to mu h = L although Eq. 22 says mu h = 0 without tilt
    assert theory.dragged_friction((0.0,), (-1.0, 1.0), 2.0, 0.5) == (0.5, "sliding")


E1, E2 = theory.e_star(80e9, 0.3, 120e9, 0.2), theory.e_star(60e9, 0.35, 120e9, 0.2)
R, X, CLOSING = (2e-6, 1e-6, 1.5e-6), (0.2e-6, -2e-6, 1.5e-6), 10e-9

# weight, N: (N_1, N_2, N_3); mpmath, 30 digits, Newton on Eqs. 1, 5 and 6 in w and phi
HEAVY = {
    0.0: (99.9958052503446104e-6, 37.141299092985141e-6, 62.8545061573594694e-6),
    1e-6: (99.5523794566561764e-6, 37.4051695124722941e-6, 63.1472099441838823e-6),
    1e-5: (95.598422042237279e-6, 39.7936996156881322e-6, 65.8047224265491468e-6),
    5e-5: (78.8094393390560598e-6, 50.7006488973636793e-6, 78.1087904416923804e-6),
}


def test_normal_forces_with_tilt_and_weight_and_a_spot_that_lifts_off():
    ours = {weight: theory.tilted_normal_forces(X, E1, E2, R, CLOSING, weight) for weight in HEAVY}
    for weight, forces in HEAVY.items():
        assert ours[weight] == pytest.approx(forces, rel=1e-12, abs=0.0)
    assert ours[0.0] == pytest.approx(theory.tilted_state(X, E1, E2, R, CLOSING, 0.0)[2], rel=1e-13)
    # a particle that need not tilt follows Eq. 9
    radii, x, weight = (2e-6, 1e-6, 1e-6), (0.0, -1e-6, 1e-6), 2e-5
    m = theory.weight_number(weight, E1, radii[0], CLOSING)
    delta = theory.upper_fraction(theory.compliance_ratio(E1, radii[0], E2, *radii[1:]), m)
    upper, left, right = theory.tilted_normal_forces(x, E1, E2, radii, CLOSING, weight)
    assert upper == pytest.approx(theory.hertz_force(E1, radii[0], delta * CLOSING), rel=1e-12)
    assert left == pytest.approx(right, rel=1e-14) and left + right - upper == pytest.approx(weight, rel=1e-13)
    # the series in the weight is of second order
    particle = (X, E1, E2, R, CLOSING)
    exact, series = theory.tilted_normal_forces, theory.tilted_force_series
    errors = [abs(series(*particle, weight) - exact(*particle, weight)[0]) for weight in (2e-6, 4e-6)]
    assert math.log2(errors[1] / errors[0]) == pytest.approx(3.0, abs=0.05)  # the first missing term is (m g)^3
    with pytest.raises(ValueError, match="lifts off"):
        theory.tilted_normal_forces((2e-6, *X[1:]), E1, E2, R, CLOSING, 0.0)  # x_1 beyond x_3
    with pytest.raises(ValueError, match="lifts off"):
        theory.tilted_normal_forces(X, E1, E2, R, CLOSING, 1e-3)  # dh is less than the weight alone needs
    # the centre of mass left of spot 2: the weight lifts spot 3 until N_1 (x_1 - x_2) = m g x_2 turns it back
    hanging, weight = (0.5e-6, 0.2e-6, 1.5e-6), 9e-5
    force = weight * 0.2 / 0.3
    onset = theory.hertz_overlap(E1, R[0], force) + theory.hertz_overlap(E2, R[1], force + weight) * 1.0 / 1.3
    with pytest.raises(ValueError, match="lifts off"):
        theory.tilted_normal_forces(hanging, E1, E2, R, 0.999 * onset, weight)
    assert min(theory.tilted_normal_forces(hanging, E1, E2, R, 1.001 * onset, weight)) > 0.0
    # x_1 beyond x_3 stands while the weight holds spot 2 down: N_2 >= 0 bounds N_1
    beyond = (1.6e-6, *X[1:])
    force, left, right = theory.tilted_normal_forces(beyond, E1, E2, R, 5e-9, 5e-5)
    assert min(force, left, right) > 0.0 and left + right - force == pytest.approx(5e-5, rel=1e-12)
    assert force * beyond[0] - left * beyond[1] - right * beyond[2] == pytest.approx(0.0, abs=1e-13 * right * 1e-6)


# differences of places of order 1, divided by crossing angles that may be small; h is .3 or more
APPROX = {"rel": 1e-9, "abs": 1e-11}
NOTHING = (math.inf, math.inf, -math.inf)
TRIANGLE = (((1.2, 0.4),), ((-1.0, 0.0), (1.0, 0.0), (0.0, 1.2)), 2.0)
CROSSED = (((0.0, 1.0), (0.0, -1.0)), ((0.6, 0.0), (1.4, 0.0)), 1.5)
SEGMENT = (((0.0, 0.0), (0.0, 1.0)), ((1.0, 0.5),), 2.0)
PAIR = (((0.3, 0.4),), ((0.0, 0.0),), 2.0)


def forecast_of(upper, lower, h, e):
    upper, lower = np.array(upper, dtype=float).reshape(-1, 2), np.array(lower, dtype=float).reshape(-1, 2)
    return forecast(upper, len(upper), lower, len(lower), float(h), float(e[0]), float(e[1]))


def expect(upper, lower, h, e):
    return hulls.required_friction(upper, lower, h), *hulls.sliding_interval(upper, lower, h, e)


@pytest.mark.parametrize("seed", [0, *(pytest.param(k, marks=pytest.mark.full(kind="slow")) for k in range(1, 8))])
def test_random_bodies(seed):
    random = np.random.default_rng(seed)
    sliding = 0
    for _ in range(250):
        total = random.integers(3, 13)
        above = random.integers(1, total)
        places = random.uniform(-1.0, 1.0, (total, 2))
        places[:above] += random.uniform(-1.0, 1.0, 2)
        angle, h, unit = random.uniform(0.0, 2.0 * math.pi), random.uniform(0.3, 3.0), 10.0 ** random.uniform(-7.0, 0.0)
        case = (places[:above] * unit, places[above:] * unit, h * unit, (math.cos(angle), math.sin(angle)))
        ours = forecast_of(*case)
        assert ours == pytest.approx(expect(*case), **APPROX)
        sliding += ours[1] <= ours[2]
    assert 40 < sliding < 240  # both outcomes occur


@pytest.mark.parametrize("seed", [0, *(pytest.param(k, marks=pytest.mark.full(kind="slow")) for k in range(1, 4))])
def test_bodies_on_a_grid_have_ties_lines_and_coincidences(seed):
    """Whole numbers: hulls share lines with the drag, corners stand exactly on it, spots coincide."""
    random = np.random.default_rng(50 + seed)
    for _ in range(250):
        upper, lower = (random.integers(0, 4, (random.integers(1, 6), 2)).astype(float) for _ in range(2))
        e = random.integers(-2, 3, 2)
        if e.any():
            assert forecast_of(upper, lower, 2.0, e) == pytest.approx(expect(upper, lower, 2.0, e), **APPROX)


def test_samples_and_what_hulls_refuse():
    # from the line 1.2 x + y = 1.2: .64/sqrt(2.44)/2; tan alpha of Eq. 16: .5/2
    required = {id(TRIANGLE): 0.204859007892633558, id(CROSSED): 0.4, id(SEGMENT): 0.5, id(PAIR): 0.25}
    for case, direction, interval in [
        (TRIANGLE, (-1.0, 0.0), (4.0 / 15.0, 14.0 / 15.0)),  # Q at y = .4 reaches from -2/3 to 2/3
        # (1.2 - 3 s, .4 + s) meets the sides of Q at s = .64/2.6 and 2.24/4.6; t = s sqrt(10)/2
        (TRIANGLE, (-3.0, 1.0), (0.389203404328415918, 0.769945865084474968)), (TRIANGLE, (0.0, 1.0), hulls.NEVER),
        (CROSSED, (1.0, 0.0), (0.4, 1.4 / 1.5)), (CROSSED, (-1.0, 0.0), (-1.4 / 1.5, -0.4)), (CROSSED, (0.0, 1.0), hulls.NEVER),
        (CROSSED, (2.0, 2.0), (0.6 * math.sqrt(2.0) / 1.5, math.sqrt(2.0) / 1.5)),  # {q - p} = [.6, 1.4] x [-1, 1]
        (SEGMENT, (1.0, 0.0), (0.5, 0.5)),  # {q - p} is the segment x = 1, |y| <= .5: one friction only
        (SEGMENT, (2.0, 1.0), (math.sqrt(5.0) / 4.0, math.sqrt(5.0) / 4.0)),  # its end
        (SEGMENT, (2.0, 1.01), hulls.NEVER), (SEGMENT, (0.0, 1.0), hulls.NEVER),
        (PAIR, (-3.0, -4.0), (0.25, 0.25)), (PAIR, (-1.0, 0.0), hulls.NEVER),
    ]:  # fmt: skip
        ours = forecast_of(*case, direction)
        assert ours == pytest.approx((required[id(case)], *interval), rel=1e-13, abs=1e-14), (case, direction)
    assert forecast_of([(0.2, 0)], [(-2.0, 0), (1.5, 0)], 4.0, (-1, 0)) == pytest.approx((0.0, -0.325, 0.55), rel=1e-13)
    # turned by any angle the answer stays: the tolerance is of the size of the patch
    for angle in np.linspace(0.1, 6.2, 40):
        turn = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
        case = (*(np.array(side) @ turn.T * 1e-6 for side in SEGMENT[:2]), 2e-6, turn @ (2.0, 1.0))
        assert forecast_of(*case) == pytest.approx((0.5, math.sqrt(5.0) / 4.0, math.sqrt(5.0) / 4.0), rel=1e-12)
    assert forecast_of([], [(0, 0)], 1.0, (1, 0)) == NOTHING and forecast_of([(0, 0)], [], 1.0, (1, 0)) == NOTHING
    assert forecast_of([(0, 0)], [(1, 0)], 0.0, (1, 0)) == forecast_of([(0, 0)], [(1, 0)], -1.0, (1, 0)) == NOTHING
    assert forecast_of([(0, 0)], [(3, 4)], 2.0, (0, 0)) == (2.5, math.inf, -math.inf)
    assert forecast_of([(0.1, 0.1)], [(0, 0), (1, 0), (0, 1)], 2.0, (0, 0)) == (0.0, math.inf, -math.inf)
    assert forecast_of([(0.1, 0.1)], [(0.1, 0.1)], 2.0, (1, 0)) == (0.0, 0.0, 0.0)
    # rows beyond the counts and further columns are not read
    upper, lower = np.full((5, 3), np.nan), np.full((6, 3), np.nan)
    upper[0, :2] = (1.2, 0.4)
    lower[:3, :2] = [(-1, 0), (1, 0), (0, 1.2)]
    plain = forecast_of(upper[:1, :2], lower[:3, :2], 2.0, (-1, 0))
    assert forecast(upper, 1, lower, 3, 2.0, -1.0, 0.0) == plain
    assert forecast(upper, 1, lower, 3, 2.0, -7.0, 0.0) == pytest.approx(plain, rel=1e-15)  # any length of the drag


def test_many_spots_have_the_forecast_of_the_corners_of_their_hull():
    """At random, on a grid, where many lie in one line, and all in one line."""
    random = np.random.default_rng(5)
    for k in range(30):
        upper, lower = random.normal(size=(2, random.integers(16, 120), 2))
        upper = np.round(2.0 * upper) if k % 3 == 0 else upper * (1.0, k % 3 - 1.0)
        corners = hull_corners(upper), hull_corners(lower)
        whole = forecast_of(upper, lower, 1.0, (1.0, 0.3))
        np.testing.assert_allclose(forecast_of(*corners, 1.0, (1.0, 0.3)), whole, rtol=1e-12, atol=1e-12)
        assert len(corners[1]) < len(lower)


RADIUS, SPEED = 1e-5, 0.05


def report(simulation, number=0):
    row = simulation.integrator.label()[number]
    margins = dict(zip(LABELLER.margins, row[2:].tolist(), strict=False))
    return LABELLER.states[int(row[0])], LABELLER.reasons[int(row[1])], margins


def test_a_ball_in_an_impact_is_unbalanced_until_it_flies_and_by_moments_if_oblique(make):
    """No gravity, so only inertia balances the contact."""
    impact = make.ball_on_plane(make.STEEL, RADIUS, (0.0, 0.0, -SPEED), restitution=0.6)
    make.advance(impact, 10)
    state, reason, margins = report(impact)
    assert (state, reason) == ("sticking", "unbalanced")
    # the contact force is the whole sum: 1 - 1/0.05
    assert margins["force_balance"] == pytest.approx(-19.0, rel=1e-12)
    assert margins["moment_balance"] == 1.0  # it acts through the centre
    while make.touching(impact).any():
        make.advance(impact, 5)
    assert make.velocity(impact)[2] > 0.0
    state, reason, margins = report(impact)
    assert (state, reason) == ("free", "none")  # without a contact there is no condition to violate
    assert set(margins.values()) == {1.0}
    simulation = make.ball_on_plane(make.STEEL, RADIUS, (SPEED, 0.0, -SPEED), friction=0.3)
    make.advance(simulation, 10)
    _, reason, margins = report(simulation)
    assert reason == "unbalanced"
    # it slides: 0.3 N at the arm R, and the lever is 2 R
    assert margins["moment_balance"] == pytest.approx(1.0 - 0.3 / 2.0 / 0.05, rel=1e-9)


@pytest.mark.parametrize("integrator", ["explicit", "implicit"])
def test_a_particle_in_slow_drag_is_in_static_equilibrium(integrator):
    built = build(thirdbody.Scene.load(SCENES / "three_spot.toml").with_settings({"solver.integrator": integrator}))
    built.integrator.advance_to(time=built.settle)
    built.integrator.advance_to(distance=3e-9)
    _, reason, margins = report(built)
    assert reason != "unbalanced"
    # at 10 mm/s inertia is less than a thousandth of the friction at work; the explicit particle still rings a little
    assert min(margins["force_balance"], margins["moment_balance"]) > 0.9


def test_equilibria_of_balance_are_balanced():
    result = balance(SCENES / "balance" / "three_spot.toml", "mindlin")
    margins = [(point.margins["force_balance"], point.margins["moment_balance"]) for point in result.points]
    # Newton's method leaves 1e-12 of the forces, twenty times that of the margin
    assert np.min(margins) == pytest.approx(1.0, abs=1e-9)
    assert "unbalanced" not in {point.reason for point in result.points}
