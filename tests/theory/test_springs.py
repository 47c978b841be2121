"""The level `mdr`: its springs against Cattaneo-Mindlin theory, straight and curved paths, rolling, and oblique impacts."""

import itertools
import math
from pathlib import Path
from typing import NamedTuple

import closed_forms
import numpy as np
import pytest
from numba import njit
from slow import slow
from theory.spots import Spot
from thirdbody_three_spot import theory
from thirdbody_three_spot.mdr import MDR, SpringParameters

from thirdbody.kernels.bundles import Motion
from thirdbody.kernels.columns import geometry, patch, sphere
from thirdbody.kernels.columns.tile import TILE
from thirdbody.kernels.predicates import BASINS
from thirdbody.kernels.rolling_kinematics import travel
from thirdbody.laws.kernel_data import Load
from thirdbody.scene.model import Contact

E_STAR, G_STAR, RADIUS, MU = 1.0, 0.8, 1.0, 0.3
KAPPA = MU * E_STAR / G_STAR


def driver_of(springs, mu=MU):
    return Spot(MDR, SpringParameters(G_STAR, mu, mu * E_STAR / G_STAR, 2.0), 2 * springs)


LIMIT, CRITICAL = MU * theory.hertz_force(E_STAR, RADIUS, 0.01), KAPPA * 0.01


def test_the_virgin_curve():
    # all springs lie under the patch, those inside up to twice as wide; its edge falls somewhere in the last cell
    for springs, error in ((16, 1.5e-3), (64, 1e-4), (256, 6e-6)):
        driver = driver_of(springs)
        driver.move(0.01)
        for k in range(1, 13):
            force = -driver.move(0.01, 0.1 * CRITICAL).x
            expected = closed_forms.mindlin_loading(min(0.1 * k, 1.0) * CRITICAL, LIMIT, CRITICAL)
            assert force == pytest.approx(expected, abs=error * LIMIT), springs
        assert force <= LIMIT * (1.0 + 1e-12), "never beyond Coulomb's limit"


def test_reversal_and_loop():
    """Mindlin and Deresiewicz: the branches after a turn, and the work of the closed loop."""
    driver, turn, work = driver_of(512), 0.7 * CRITICAL, 0.0
    driver.move(0.01)
    top = -driver.move(0.01, turn).x
    for sign in (-1.0, 1.0):
        for k in range(1, 201):
            answer = driver.move(0.01, sign * 0.01 * turn)
            work += answer.dissipated
            branch = closed_forms.mindlin_reversal(turn - 0.01 * k * turn, turn, LIMIT, CRITICAL)
            # 256 to 512 springs carry the patch: 2e-6
            assert -answer.x == pytest.approx(-sign * branch, abs=4e-6 * LIMIT)
    assert -answer.x == pytest.approx(top, abs=4e-6 * LIMIT)
    # the 256 springs and more that carry the patch miss 1e-5 of the small area that slips
    assert work == pytest.approx(closed_forms.mindlin_loop_work(top / LIMIT) * LIMIT * CRITICAL, rel=1e-4)


MUCH = [0.3, 1e3, slow(0.0), slow(0.1), slow(10.0), slow(1e6)]
"""Coefficients of friction. With a large one springs slide only where the edge of the patch reaches them, at a limit that falls
to nothing within a part of a step."""


@pytest.mark.parametrize("mu", MUCH)
def test_a_straight_step_is_a_hundred(mu):
    """Along a line, with springs that touch, merge, turn round, slide and leave: neither force nor heat depends on the step."""
    rng, (one, hundred) = np.random.default_rng(5), (driver_of(32, mu), driver_of(32, mu))
    for _ in range(40):
        overlap, slip, start, heat = rng.uniform(1e-4, 0.02), rng.normal() * 3e-3, one.h[0], 0.0
        a = one.move(overlap, slip)
        for k in range(1, 101):
            b = hundred.move(start + (overlap - start) * k / 100, slip / 100)
            heat += b.dissipated
        # a hundred roundings of energies of the size of E* sqrt(R) d^2.5, which is 6e-5
        assert a.dissipated == pytest.approx(heat, rel=1e-8, abs=1e-18)
        assert a.x == pytest.approx(b.x, abs=1e-13 * max(mu, MU) * theory.hertz_force(E_STAR, RADIUS, 0.02))
    assert one.w == pytest.approx(hundred.w, abs=1e-15 * max(mu, 1.0))


@pytest.mark.parametrize("mu", MUCH)
def test_heat_and_springs_take_the_work_of_an_impact(mu):
    """An undamped oblique impact of 300 straight steps. The work is that of the mean force over the 64th part of each."""
    coarse, fine, heat, work = driver_of(32, mu), driver_of(32, mu), 0.0, 0.0
    overlap, place, force = 0.0, 0.0, 0.0
    for k in range(1, 300):
        to, there = 0.01 * math.sin(math.pi * k / 300), 0.005 * math.sin(2.2 * math.pi * k / 300)
        answer = coarse.move(to, there - place)
        heat += answer.dissipated
        for part in range(1, 65):
            now = fine.move(overlap + (to - overlap) * part / 64, (there - place) / 64).x
            work -= 0.5 * (force + now) * (there - place) / 64
            force = now
        overlap, place = to, there
    energy = 8.0 / 15.0 * E_STAR * 0.01**2.5
    # the work is short of the jumps of springs that leave the patch within a part of a step
    assert heat + answer.stored == pytest.approx(work, abs=1e-5 * energy)
    assert mu == 0.0 or heat > 0.1 * energy


def test_curved_paths_are_of_first_order():
    """A quarter turn of slip after partial slip, in 8, 16, 32 steps, against 2048."""

    def end(steps: int) -> np.ndarray:
        driver = driver_of(128)
        driver.move(0.01, 0.0)
        driver.move(0.01, 0.8 * CRITICAL)
        for k in range(steps):
            angle = 0.5 * math.pi * (k + 0.5) / steps
            chord = 2.0 * CRITICAL * math.sin(0.25 * math.pi / steps)
            answer = driver.move(0.01, chord * math.cos(angle), chord * math.sin(angle))
        return np.array([answer.x, answer.y])

    fine = end(2048)
    errors = [np.linalg.norm(end(steps) - fine) / LIMIT for steps in (8, 16, 32)]
    orders = np.diff(np.log2(errors)) * -1.0
    assert errors[0] < 0.06
    assert np.all((orders > 0.8) & (orders < 1.3))


def test_without_friction_and_with_a_great_deal():
    assert driver_of(32, mu=0.0).move(0.01, 1.0).x == 0.0
    driver = driver_of(256, mu=1e9)
    driver.move(0.01)
    # all stick: T = 2 G* a s; the grid carries the edge of the patch to half a spring of 128 at least
    assert -driver.move(0.01, 1e-5).x == pytest.approx(2.0 * G_STAR * 0.1 * 1e-5, rel=0.5 / 128)


def test_a_step_to_an_absurd_overlap_ends():
    """A run whose step is too large gets there before a guard stops it: the grid cannot follow without bound."""
    load = Load(1.0, 1.0, 1.0, 1.0, 0.0)
    for start, overlap in itertools.product((0.0, 0.01), (1e6, 1e40, math.inf)):
        driver = driver_of(16)
        driver.move(start)
        touch, _, *rest = driver.evaluate(0.01, 1e-3)
        touch = touch._replace(overlap=overlap)
        answer, _ = MDR.kernel(touch, load, *rest, np.empty_like(driver.w))
        MDR.tangent(touch, load, *rest)
        assert not abs(answer.x) > 2.0 * G_STAR * 2.0**32 * 1e-3  # the grid ends at 2^30 or 2^31 radii


def test_rolling_renews_the_material():
    driver = driver_of(64, mu=1e6)  # all springs stick: a uniform row decays and stays uniform
    driver.move(0.01)
    force = -driver.move(0.01, 0.3 * CRITICAL).x
    answers = [driver.move(0.01, roll=0.01) for _ in range(20)]  # two contact radii in all
    assert -answers[-1].x == pytest.approx(force * math.exp(-4.0), rel=1e-12)
    lost = sum(answer.dissipated for answer in answers)
    assert lost == pytest.approx(answers[-1].stored * (math.exp(8.0) - 1.0), rel=1e-9)


def spheres(*rows):
    S = np.zeros((len(rows), sphere.WIDTH))
    for k, (radius, velocity, spin) in enumerate(rows):
        S[k, sphere.RADIUS], S[k, sphere.MID_VELOCITY3], S[k, sphere.MID_SPIN3] = radius, velocity, spin
    return S


class Tables(NamedTuple):
    own: np.ndarray
    partner: np.ndarray
    S: np.ndarray
    P: np.ndarray


@njit
def travel_speed(i, j, tables, G, plate):
    return travel(i, j, 0, tables, Motion(1.0, plate, 0.0), G)


def path(S, i, j, normal, arms, plate=0.0):
    """Velocity of the patch over its ground, along x and y, or y and z for a normal along x."""
    G = np.zeros((geometry.WIDTH, TILE))
    e, f = ((1, 0, 0), (0, 1, 0)) if abs(normal[2]) == 1 else ((0, 1, 0), (0, 0, 1))
    G[geometry.NORMAL3, 0], G[geometry.AXIS3, 0], G[geometry.CROSS_AXIS3, 0] = normal, e, f
    G[geometry.ARM, 0], G[geometry.PARTNER_ARM, 0] = arms
    nobody = np.zeros(0, np.int32)
    return travel_speed(i, j, Tables(nobody, nobody, S, np.zeros((1, patch.WIDTH))), G.ravel(), plate)


def test_the_path_of_the_patch():
    up = (0.0, 0.0, 1.0)
    rolling = spheres((2.0, (3.0, 0.0, 0.0), (0.0, 1.5, 0.0)))
    assert path(rolling, 0, -1, up, (2.0, 0.0)) == pytest.approx((3.0, 0.0))
    back = spheres((2.0, (0.0, -3.0, 0.0), (1.5, 0.0, 0.0)))
    assert path(back, 0, -1, up, (2.0, 0.0)) == pytest.approx((0.0, -3.0)), "the way has a direction"
    skidding = spheres((2.0, (3.0, 0.0, 0.0), (0.0, 0.0, 0.0)))
    assert path(skidding, 0, -1, up, (2.0, 0.0)) == pytest.approx((1.5, 0.0)), "new material on one side only"
    riding = spheres((2.0, (3.0, 0.0, 0.0), (0.0, 0.0, 0.0)))
    assert path(riding, 0, -1 - BASINS, (0.0, 0.0, -1.0), (2.0, 0.0), plate=3.0) == (0.0, 0.0)
    gears = spheres((1.0, (0.0, 0.0, 0.0), (0.0, 0.0, 2.0)), (1.0, (0.0, 0.0, 0.0), (0.0, 0.0, -2.0)))
    assert np.hypot(*path(gears, 0, 1, (-1.0, 0.0, 0.0), (1.0, 1.0))) == pytest.approx(2.0)
    # two spheres that turn about their common centre as one body
    dumbbell = spheres((1.0, (0.0, -2.0, 0.0), (0.0, 0.0, 2.0)), (1.0, (0.0, 2.0, 0.0), (0.0, 0.0, 2.0)))
    assert path(dumbbell, 0, 1, (-1.0, 0.0, 0.0), (1.0, 1.0)) == pytest.approx((0.0, 0.0), abs=1e-15)


APPROACH = 1.5e-10
"""m/s: an overlap of 1e-10 of the radius, so that the patch rolls on by 3e-5 of its own radius during the impact."""


def impact(make, psi, level, nu=0.3, **options):
    """psi_2 of an undamped oblique impact that starts with psi_1, without spin."""
    material, radius, mu = make.solid(210e9, nu, 7850.0), 1e-3, 0.3
    e = theory.e_star(material.shear(), nu, math.inf, 0.0)
    duration = closed_forms.impact_duration(make.ball_mass(material, radius), radius, e, APPROACH)
    scale = 2.0 * (1.0 - nu) / (mu * (2.0 - nu))
    simulation = make.ball_on_plane(
        material, radius, (psi / scale * APPROACH, 0.0, -APPROACH), friction=mu, time_step=duration / 1000.0,
        contact=Contact(law="three_spot", level=level, options=options),
    )  # fmt: skip
    before = make.kinetic(simulation)
    make.leave(simulation, duration)
    assert make.kinetic(simulation) <= (1.0 + 2e-5) * before, "the normal part comes back to 1e-5 at 1000 steps"
    return (make.velocity(simulation)[0] - radius * make.spin(simulation)[1]) * scale / APPROACH


CURVE = np.loadtxt(Path(__file__).with_name("data") / "maw_barber_fawcett_nu03.csv", delimiter=",", comments="#", skiprows=2)
EXACT = slow("exact", 2e-4, {}, CURVE)


@pytest.mark.parametrize(
    ("level", "error", "options", "rows"),
    [("mdr", 4e-4, {"springs": 64}, CURVE[::4]), slow("mdr", 4e-4, {"springs": 64}, CURVE), EXACT],
)
def test_maw_barber_fawcett(make, level, error, options, rows):
    """The rebound of a sphere over its angle of incidence."""
    found = [impact(make, psi, level, **options) for psi in rows[:, 2]]
    # 64 springs carry the patch (1e-4 of the limit); the patch rolls by 3e-5 of its radius; 1000 steps an impact
    assert found == pytest.approx(rows[:, 3], abs=error)
