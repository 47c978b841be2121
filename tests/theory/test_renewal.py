"""Spots that sway keep their tangential force, spots that roll on renew it, and steady rolling has Kalker's creep."""

import itertools
import math

import numpy as np
import pytest
import three_spot_theory as theory
from each import each
from theory.plain import plain
from theory.spots import Spot
from thirdbody_three_spot import exact, mdr
from thirdbody.assembly.option_values import option_value
from thirdbody.laws.contract import Material, Pair
from thirdbody.laws.friction import COULOMB, MINDLIN
from thirdbody.laws.renewal import RENEWAL, moved_ground
from thirdbody.scene.model import ConstantVelocity, Effects, Motion

LEVELS = {"mdr": (mdr.MDR, 64), "exact": (exact.EXACT, 3 * 48)}
SPRINGS = {law.name: (law.sized({"renewal": "kalker"}), 0) for law in (MINDLIN, COULOMB)}
EVERY = LEVELS | SPRINGS
OVERLAP, RADIUS = 1e-9, 1e-6
A = theory.contact_radius(RADIUS, OVERLAP)


def pair(nu, other=None, shear=80e9, friction=0.3):
    a, b = Material("a", 80e9, nu, 7850.0), Material("b", shear, nu if other is None else other, 7850.0)
    return Pair(a, b, friction, 1.0)


class RollingSpot(Spot):
    def __init__(self, level, materials, **options):
        law, width = EVERY[level]
        moduli = [x for m in (materials.a, materials.b) for x in (m.shear_modulus, m.poisson_ratio)]
        p = law.mix(materials, {"renewal": "kalker", "slip_scale": 1e-4} | options)
        super().__init__(law, p, width, theory.e_star(*moduli), RADIUS)
        self.move()
        self.critical = 0.3 * self.e_star / theory.g_star(*moduli) * OVERLAP if width else self.move().critical

    def evaluate(self, slip=0.0, roll=0.0, across=0.0, overlap=OVERLAP, aside=0.0):
        return super().evaluate(overlap, slip, aside, roll, across)

    def shear(self, share):
        return self.move(share * self.critical)


C11 = {0.0: (3.40, 0.02), 0.1: (3.687, 0.05), 0.25: (4.12, 0.02), 0.3: (4.332, 0.05), 0.4: (4.746, 0.05), 0.5: (5.20, 0.02)}
"""Kalker's coefficient T/(G a^2 xi) of a round patch, by Poisson's ratio, and how far springs may be off: as tabulated in his
book of 1990, or by boundary elements (Cerruti's compliance, 17 square cells over the diameter: 1 % above Kalker's)."""
FORCE_LEFT = {
    0.0: (0.9951, 0.9751, 0.9140, 0.7178),
    0.25: (0.9954, 0.9767, 0.9195, 0.7352),
    0.5: (0.9958, 0.9788, 0.9270, 0.7588),
}  # of a Hertzian traction, after rolling by 0.1, 0.25, 0.5 and 1 contact radii without creep, by 21 such cells


@each([(level, 1.0) for level in (*LEVELS, "mindlin")] + [("coulomb", scale) for scale in (1e-4, 1e-3, 1e-2)])
def test_steady_rolling_has_the_creep_of_kalker(case):
    """T = G a^2 C11 xi, whatever the length of the step, and whatever the stiffness of `coulomb`."""
    level, scale = case
    friction, longer = (0.3, 10.0) if level == "coulomb" else (1e6, 1.0)
    for (nu, (expected, tolerance)), step in itertools.product(C11.items(), (0.05 * longer, 0.5 * longer)):
        materials, creep = pair(nu, friction=friction), 1e-4
        spot = RollingSpot(level, materials, slip_scale=scale)
        for _ in range(int(20.0 * longer**2 / step)):  # exp(-0.5 * 20) of the start is left
            answer = spot.move(creep * step * A, step * A)
        # the 32 to 64 springs of the row carry 1 % more or less of a field that does not fall to the edge
        expected *= materials.a.shear_modulus * A**2 * creep
        assert -answer.x == pytest.approx(expected, rel=tolerance), (nu, step)


@each(list(itertools.product(LEVELS, FORCE_LEFT)))
def test_rolling_takes_first_what_the_edge_carries(case):
    """A field that falls to nothing at the edge, from loading at a constant angle, loses little at first, as in truth. Beyond
    one contact radius the springs fall behind: 0.48 instead of 0.34 is left after two."""
    level, nu = case
    spot = RollingSpot(level, pair(nu))
    spot.h, spot.w = (0.0,) * len(spot.h), np.zeros_like(spot.w)
    start = spot.shear(0.3).x
    forces = [spot.move(roll=0.01 * A).x / start for _ in range(100)]
    found = np.interp((0.1, 0.25, 0.5, 1.0), np.arange(1, 101) / 100.0, forces)
    # half the field's share that 21 cells miss, and what the mean of both sides of the patch cannot tell; 0.13 before
    assert found == pytest.approx(FORCE_LEFT[nu], abs=0.04)


@each(EVERY)
def test_creep_curve_beside_carter_and_kalker(level):
    """The whole curve T/(mu N) over its linear part, G a^2 C11 xi/(mu N). Springs that renew alike everywhere share one
    elongation and slide from the edge on: T/(mu N) = 1 - (1 - 2 x/3)^1.5. The slope is Kalker's; full sliding comes early, at x
    = 1.5, against 2 of Carter's cylinder and 3 of the ball. At most (of the places looked at, x = 1.3) the curve is 0.07 above
    Carter's and 0.13 above that of the ball. The one spring of `mindlin` and `coulomb` slides as a whole, at x = 1, up to 0.25
    and 0.30 above them."""
    nu, far, longer = 0.25, [0.0, 0.0], 10 if level == "coulomb" else 1
    for share in (0.1, 0.6, 1.0, 1.3, 1.5, 3.0):
        spot = RollingSpot(level, pair(nu))
        limit = 0.3 * theory.hertz_force(spot.e_star, RADIUS, OVERLAP)
        creep = share * limit / (80e9 * A**2 * C11[nu][0])
        for _ in range(150):
            answer = spot.move(0.1 * longer * creep * A, 0.1 * longer * A)
        found = -answer.x / limit
        expected = min(share, 1.0) if level in SPRINGS else 1.0 - (1.0 - min(2.0 * share / 3.0, 1.0)) ** 1.5
        assert found == pytest.approx(expected, abs=0.005)  # springs, and C11 to 1 %
        # T/(mu N) of a cylinder (Carter 1926), of a ball (Vermeulen and Johnson 1964, with Kalker's C11)
        carter, johnson = (1.0 - (1.0 - min(share / n, 1.0)) ** n for n in (2, 3))
        far = [max(far[0], found - carter), max(far[1], found - johnson)]
        assert found > carter - 0.005
    assert far == pytest.approx([0.25, 0.30] if level in SPRINGS else [0.07, 0.13], abs=0.01)


@each(["mindlin", "exact"])
def test_unlike_materials_have_the_creep_of_their_mean_compliance(level):
    """Kalker: 1/G and nu/G are the means of both bodies'."""
    materials, creep = pair(0.4, 0.1, shear=40e9, friction=1e6), 1e-4
    shear = 2.0 / (1.0 / 80e9 + 1.0 / 40e9)
    nu = 0.5 * shear * (0.4 / 80e9 + 0.1 / 40e9)  # 0.2
    spot = RollingSpot(level, materials)
    for _ in range(50):
        answer = spot.move(0.3 * creep * A, 0.3 * A)
    assert -answer.x == pytest.approx(
        shear * A**2 * (3.40 + (4.12 - 3.40) * nu / 0.25) * creep, rel=0.03
    )  # C11 is a little convex


@each(EVERY)
def test_a_spot_that_sways_keeps_its_force(level):
    """+-0.5 nm, 40 cycles, with a contact radius of 32 nm: the first sway meets 0.5 nm of fresh ground, the others none."""
    spot = RollingSpot(level, pair(0.3))
    forces = [spot.shear(0.5).x]
    for _ in range(40):
        forces += [spot.move(roll=path).x for path in (5e-10, -1e-9, 5e-10)][-1:]
    assert forces[-1] == pytest.approx(forces[1], rel=1e-12) and forces[-1] == pytest.approx(forces[0], rel=0.01)


@each(EVERY)
def test_a_spot_that_rolls_on_loses_its_history(level):
    """Whatever the direction; swaying on the way adds nothing. All springs stick: a uniform field stays uniform."""
    spots = [RollingSpot(level, pair(0.3, friction=1e6)) for _ in range(3)]
    for spot in spots:
        start = spot.shear(0.3).x
    for _ in range(100):
        straight = spots[0].move(roll=0.02 * A).x
        across = spots[1].move(across=-0.02 * A).x
        spots[2].move(roll=0.03 * A)
        swaying = spots[2].move(roll=-0.01 * A).x
    rate = getattr(spots[0].p, "of_stiffness", spots[0].p.renewal)  # no spring is stiffer than 2 G* a
    # 1.5e-8 measured with `exact`, whose field is kept at its nodes
    assert straight == pytest.approx(start * math.exp(-2.0 * rate), rel=1e-7)
    assert across == pytest.approx(straight, rel=1e-9) and swaying == pytest.approx(straight, rel=0.01)  # it went 0.01 a farther


def test_the_rate_is_a_word_or_a_number_of_the_scene():
    for level, rate in itertools.product(EVERY, (0.0, 2.0)):
        spot = RollingSpot(level, pair(0.3, friction=1e6), renewal=rate)
        start = spot.shear(0.3).x
        for _ in range(10):
            force = spot.move(roll=0.1 * A).x
        assert force == pytest.approx(start * math.exp(-rate), rel=1e-7 if level == "exact" else 1e-12), level
    assert option_value(RENEWAL, "kalker", True) == "kalker" and option_value(RENEWAL, 0.3, True) == 0.3
    with pytest.raises(ValueError, match="expected 'kalker' or a number from 0 to 100, got 'hertz'"):
        option_value(RENEWAL, "hertz", True)
    with pytest.raises(ValueError, match="between 0 and 100"):
        option_value(RENEWAL, -1.0, True)
    assert MINDLIN.sized({"renewal": "kalker"}).rolls and COULOMB.sized({"renewal": 0.5}).rolls
    for options in ({}, {"renewal": 0.0}, {"renewal": "kalker", "memory": "rescaled"}):
        assert MINDLIN.sized(options) is MINDLIN and COULOMB.sized(options) is COULOMB


def test_ground_is_fresh_after_the_diameter_of_the_patch_and_never_where_it_shrinks():
    ground, step = plain(moved_ground)(0.0, 0.0, A, 0.0, 0.0, 0.0), plain(moved_ground)
    for _ in range(50):
        ground = step(0.1 * A, 0.0, A, *ground[1:])
    assert ground.path == pytest.approx(0.1 * A)
    paths = []
    for _ in range(30):
        ground = step(-0.1 * A, 0.0, A, *ground[1:])
        paths.append(ground.path)
    assert sum(paths) == pytest.approx(1.0 * A)
    assert paths[:19] == pytest.approx([0.0] * 19, abs=1e-12 * A)  # roundings of the offset
    ground = step(0.0, 0.0, 0.5 * A, *step(0.9 * A, 0.0, A, 0.0, 0.0, 0.0)[1:])
    assert ground == pytest.approx((0.0, 0.5 * A, 0.0, 0.5 * A)) and step(0.0, 0.0, A, *ground[1:]).path == 0.0


def test_heat_takes_the_work_of_steady_rolling():
    """Without slip, and sliding throughout: what renewal and friction take is the work of the tangential force."""
    for level, creep in itertools.product(EVERY, (1e-4, 1.0)):
        spot = RollingSpot(level, pair(0.3))
        for _ in range(100):
            answer = spot.move(0.3 * creep * A, 0.3 * A)
        # measured: 9e-8 of the steady state after 100 steps, `exact` 2.4e-4; where they slide throughout, `mdr` and `exact` book
        # 2.7 and 3.0 % too much
        error = (4e-2 if creep == 1.0 else 1e-3) if level in LEVELS else 1e-6
        assert answer.dissipated == pytest.approx(-answer.x * 0.3 * creep * A, rel=error), (level, creep)


def random_steps(seed, corners, pieces):
    """Straight pieces of a random path of overlap, slip along and aside, and rolled way, each cut into so many steps."""
    rng, before = np.random.default_rng(seed), OVERLAP
    for _ in range(corners):
        overlap = rng.uniform(0.02, 2.0) * OVERLAP
        slip, aside = rng.normal(size=2) * 0.5 * OVERLAP
        roll, across = rng.normal(size=2) * 0.2 * A
        for piece in range(1, pieces + 1):
            now = before + (overlap - before) * piece / pieces
            names = ("slip", "aside", "roll", "across")
            yield {"overlap": now} | {name: path / pieces for name, path in zip(names, (slip, aside, roll, across), strict=True)}
        before = overlap


@each(EVERY)
def test_work_of_rolling_spots_is_stored_or_dissipated(level):
    """Over random paths that turn, grow, shrink and roll: the ledger closes with the step, at least to first order."""
    missing = []
    for pieces in (10, 80):
        spot, work, heat, x, y = RollingSpot(level, pair(0.3)), 0.0, 0.0, 0.0, 0.0
        for step in random_steps(1, 12, pieces):
            answer = spot.move(**step)
            assert answer.dissipated >= -1e-12 * answer.limit * OVERLAP  # rounding of the energy of a step
            work -= 0.5 * ((x + answer.x) * step["slip"] + (y + answer.y) * step["aside"])
            x, y, heat = answer.x, answer.y, heat + answer.dissipated
        missing.append(abs(work - heat - answer.stored) / heat)
    # `mindlin` and `coulomb` start to slide at once, within a step
    assert missing[1] < (2e-3 if level in LEVELS else 5e-3) and missing[1] < 0.25 * missing[0]


@each(list(itertools.product(SPRINGS, (0.2, 3.0))))
def test_tangent_of_rolling_springs(case):
    """Against central differences, sticking and sliding, at steps of a third of a contact radius."""
    level, share = case
    spot = RollingSpot(level, pair(0.3))
    critical = spot.shear(0.1).critical
    step = {"slip": share * critical, "aside": 0.4 * share * critical, "roll": 0.3 * A, "overlap": 1.1 * OVERLAP}
    found, wanted = spot.tangent(**step), []
    for name, size in (("slip", 1e-6 * critical), ("aside", 1e-6 * critical), ("overlap", 1e-6 * OVERLAP)):
        ends = [spot.answer(**(step | {name: step[name] + sign * size}))[0] for sign in (1.0, -1.0)]
        wanted.append([(ends[0].x - ends[1].x) / (2.0 * size), (ends[0].y - ends[1].y) / (2.0 * size)])
    (xx, yx), (xy, yy), (xd, yd) = wanted
    scale = max(abs(xx), abs(yy))
    assert found == pytest.approx((xx, xy, yx, yy, xd, yd), rel=1e-5, abs=1e-6 * scale)


SIDE = 1e-4  # force that holds the pinched ball back, N: a tenth of the friction limit of its two spots


@pytest.mark.parametrize("integrator", ["explicit", "implicit"])
def test_a_pinched_ball_creeps_where_its_springs_are_renewed(make, integrator):
    """Loaded sideways by its weight, it rolls with Kalker's creep: behind half the way of the plate, which it keeps otherwise."""
    behind, pull = {}, Effects(gravity=(-SIDE / make.ball_mass(make.STEEL, 1e-5), 0.0, 0.0))
    for renewal in (0.0, "kalker"):
        motion = Motion(x=[ConstantVelocity(velocity=0.1)])
        simulation = make.under_patches(
            [make.ball(1e-5, (1e-4, 1e-4, 1e-5))], {"ball": make.STEEL}, 1e-3, motion, size=2e-4, friction=0.5, restitution=0.3,
            options={"renewal": renewal}, integrator=integrator, effects=pull,
        )  # fmt: skip
        assert simulation.state.physics.rolling == (0 if renewal == 0.0 else 1)
        simulation.integrator.advance_to(distance=1e-5)  # a way of 13 contact radii of the patch
        start = simulation.state.bodies.position[0, 0]
        simulation.integrator.advance_to(distance=1.4e-5)
        behind[renewal] = 1.0 - (simulation.state.bodies.position[0, 0] - start) / 2e-6
    steel = make.STEEL.shear(), make.STEEL.poisson_ratio
    overlap = theory.hertz_overlap(theory.e_star(*steel, *steel), 1e-5, 1e-3)
    creep = 0.5 * SIDE / (steel[0] * theory.contact_radius(1e-5, overlap) ** 2 * C11[0.3][0])
    assert abs(behind[0.0]) < 0.05 * creep and behind["kalker"] == pytest.approx(creep, rel=0.1)
