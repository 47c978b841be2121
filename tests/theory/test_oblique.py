"""Oblique and spinning impacts against the closed forms of gross slip: Chung and Ooi's tests 6 and 7; Maw, Barber and Fawcett.

Spins about y, tangential motion along x. Gross slip means that the surfaces never stop slipping during the impact: friction's
impulse is then mu times the normal impulse, whatever the tangential law."""

import functools
import itertools
import math
from pathlib import Path

import closed_forms
import numpy as np
import pytest
import three_spot_theory as theory
from slow import slow
from thirdbody_three_spot import THREE_SPOT
from thirdbody.scene.model import Contact

DATA = Path(__file__).with_name("data")
RESOLVED = 200  # steps per elastic contact time
DAMPED = 3e-3  # restitution at `RESOLVED` steps, order 1.25 (test_impacts): below this for e >= .5
CONSTANTS = {"aluminium alloy": (70e9, 0.33, 2700.0), "nylon": (2.5e9, 0.4, 1000.0)}


def rebound(make, numbers, radius, velocity, spin=(0.0, 0.0, 0.0), steps=RESOLVED, **keys):
    material = make.solid(*numbers)
    e = theory.e_star(material.shear(), material.poisson_ratio, math.inf, 0.0)
    duration = closed_forms.impact_duration(make.ball_mass(material, radius), radius, e, -velocity[2])
    simulation = make.ball_on_plane(material, radius, velocity, spin, time_step=duration / steps, **keys)
    make.leave(simulation, duration)
    return make.velocity(simulation), make.spin(simulation), simulation


NORMAL, BIG = 0.2, 0.1


def spinning(make, name, surface_speed):
    """(beta, tan of the recoil angle) of the contact point in test 6: no tangential motion of the centre, only spin."""
    keys = {"friction": 0.4, "restitution": 0.5}
    v, w, _ = rebound(make, CONSTANTS[name], BIG, (0.0, 0.0, -NORMAL), (0.0, -surface_speed / BIG, 0.0), **keys)
    # velocity of the surface at the contact: v_x - R omega_y, which starts as +surface_speed
    after = v[0] - BIG * w[1]
    return -after / surface_speed, after / v[2]


def graph(file, index):
    parts = [part for part in (DATA / file).read_text().split("\n\n\n") if part.strip()]
    lines = [line for line in parts[index].splitlines() if line.strip() and not line.startswith("#")]
    return np.array([[float(x) for x in line.split(",")] for line in lines])


@pytest.mark.parametrize("index, name", list(enumerate(CONSTANTS)))
def test_chung_ooi_6_tangential_restitution_and_recoil_angle(make, index, name):
    """beta over 3.5 mu (1+e) v_n/v_st: the ball slips all through the impact while that number is below about one."""
    points = graph("test6_graph1_beta.dat", index)
    points = points[points[:, 0] < 1.0]
    assert len(points) == 5
    for x, digitised in points:
        slip = 3.5 * 0.4 * 1.5 * NORMAL / x
        beta, _ = spinning(make, name, slip)
        closed = closed_forms.gross_slip_tangential_restitution(0.4, 0.5, NORMAL, slip)
        # 1 + beta is friction's impulse; overlap/radius is 3e-3 (nylon) at most
        assert 1.0 + beta == pytest.approx(1.0 + closed, rel=DAMPED + 2e-3)
        # read off a figure: 1 % of the axis of beta (1.6 long), on a line that is 25 long in the other direction
        assert beta == pytest.approx(digitised, abs=0.016)
    points = graph("test6_graph2_recoil.dat", index)
    points = points[points[:, 0] > 2.5]
    assert len(points) == 4
    for x, digitised in points:
        _, tangent = spinning(make, name, x * NORMAL)
        # slope 2, axes 7 and 10 long: half a per cent of each
        assert tangent == pytest.approx(digitised, abs=0.1)


def test_chung_ooi_7_opposite_spins_do_not_rub(make):
    """The surfaces move alike at the contact, so there is no friction at all: the spin stays."""
    rows = np.loadtxt(DATA / "test7_note.dat")[:17:4]
    for constants, (omega, sideways, expected) in itertools.product([(70e9, 0.33, 2700.0), (120e9, 0.35, 8900.0)], rows):
        material, keys = make.solid(*constants), {"friction": 0.4, "restitution": 0.5}
        simulation = make.two_balls(material, BIG, (NORMAL, 0.0, 0.0), (0.0, omega, 0.0), **keys)
        make.leave(simulation, 1e-3)
        for body, sign in ((0, 1.0), (1, -1.0)):
            # rounding only: of the equal surface speeds of both balls, in some hundred steps
            assert make.spin(simulation, body)[1] == pytest.approx(sign * expected, rel=1e-12)
            assert abs(make.velocity(simulation, body)[2] - sideways) < 1e-12 * NORMAL


def test_undamped_gross_slip_and_no_friction(make):
    """Maw, Barber and Fawcett: psi_2 = psi_1 - 4 chi where the whole impact slips, psi = v_t/v_n 2 (1-nu)/(mu (2-nu))."""
    nu = 0.3
    chi = closed_forms.maw_chi(nu)
    for friction, excess in itertools.product((0.1, 0.3), (1.3, 2.0, 5.0)):
        scale, psi = 2.0 * (1.0 - nu) / (friction * (2.0 - nu)), excess * (4.0 * chi - 1.0)
        v, w, _ = rebound(make, (210e9, nu, 7850.0), 1e-3, (psi / scale * NORMAL, 0.0, -NORMAL), friction=friction)
        after = (v[0] - 1e-3 * w[1]) * scale / NORMAL
        # friction's impulse is 4 chi; undamped truncation is 1e-5, the overlap .2 % of the radius
        assert psi - after == pytest.approx(psi - closed_forms.maw_gross_slip(psi, chi), rel=3e-3)
    v, w, simulation = rebound(make, (210e9, 0.3, 7850.0), 1e-3, (3.0, -1.0, -1.0), (100.0, 200.0, 300.0), friction=0.0)
    assert np.array_equal(v[:2], [3.0, -1.0])
    # the spin is taken from the angular momentum, which no torque changes
    assert w == pytest.approx([100.0, 200.0, 300.0], rel=1e-15) and np.all(simulation.state.slots.R[:, 15:18] == 0.0)


@pytest.mark.parametrize("degrees", [36, slow(10), slow(76)])
def test_direction_of_the_plane_does_not_matter(make, degrees):
    """The same impact turned about the normal turns with it: tangential forces have no preferred axis."""
    angle, found = math.radians(degrees), []
    for turn in (0.0, 0.7, 2.0):
        c, s = math.cos(turn), math.sin(turn)
        start = math.sin(angle), math.cos(angle)
        v, w, _ = rebound(make, (210e9, 0.3, 7850.0), 1e-3, (start[0] * c, start[0] * s, -start[1]), friction=0.3)
        found.append((v[0] * c + v[1] * s, v[1] * c - v[0] * s, v[2], (w[1] * c - w[0] * s) * 1e-3, (w[0] * c + w[1] * s) * 1e-3))
    for row in found[1:]:
        # rounding of a few hundred steps
        assert row == pytest.approx(found[0], rel=1e-11, abs=1e-12)


SPEED, FRICTION, RESTITUTION, RADIUS = 3.9, 0.092, 0.98, 2.5e-3
ANGLES = range(5, 86, 10)
LEVELS = sorted(THREE_SPOT.levels)
levels = pytest.mark.parametrize("level", [slow("exact") if level == "exact" else level for level in LEVELS])


def rebound_at(make, degrees, level):
    """v_t'/v_t of the centre, spin over that of a grazing slip (SPEED/RADIUS), rebound angle of the contact point in degrees."""
    angle = math.radians(degrees)
    start, contact = (SPEED * math.sin(angle), 0.0, -SPEED * math.cos(angle)), Contact(law="three_spot", level=level)
    keys = {"friction": FRICTION, "restitution": RESTITUTION, "contact": contact}
    v, spin, _ = rebound(make, (380e9, 0.23, 4000.0), RADIUS, start, steps=400, **keys)
    return v[0] / start[0], spin[1] * RADIUS / SPEED, math.degrees(math.atan2(v[0] - RADIUS * spin[1], v[2]))


@functools.cache
def rows_of(make, level):
    return [rebound_at(make, degrees, level) for degrees in ANGLES]


@levels
def test_steep_impacts_slip_throughout_and_shallow_ones_come_back(make, level):
    """Gross slip from about 31 degrees on: the impulse of friction is mu times the normal one, whatever the law."""
    for (ratio, spin, _), degrees in zip(rows_of(make, level), ANGLES, strict=True):
        if degrees >= (55 if level == "coulomb" else 45):
            angle = math.radians(degrees)
            # restitution to 3e-3, and the overlap of 1e-2 R shortens friction's arm by half of that
            assert 1.0 - ratio == pytest.approx(1.0 - closed_forms.gross_slip_speed_ratio(FRICTION, RESTITUTION, angle), rel=3e-3)
            report = closed_forms.gross_slip_spin(FRICTION, RESTITUTION, angle, SPEED, RADIUS) * RADIUS / SPEED
            assert spin == pytest.approx(-report, rel=9e-3)  # that of the theory counts against the drag
    # near the normal the tangential spring throws the contact point back: its rebound is reversed
    assert min(angle for _, _, angle in rows_of(make, level)) < 0.0 and all(ratio < 1.0 for ratio, _, _ in rows_of(make, level))


@pytest.mark.full(kind="slow")
def test_springs_follow_the_finest_level(make):
    for k, degrees in enumerate(ANGLES):
        cells = " | ".join("{:.3f} {:.4f} {:+.1f}".format(*rows_of(make, level)[k]) for level in LEVELS)
        print(f"| {degrees} | {cells} |")
    for coarse, fine in zip(rows_of(make, "mdr"), rows_of(make, "exact"), strict=True):
        # 32 springs: 1e-3 of the friction limit, which is a third of the speeds here at most
        assert coarse[0] == pytest.approx(fine[0], abs=2e-3)
