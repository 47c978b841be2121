"""Particles whose first contacts do not hold them: `balance` lets them turn until they sit, and presses them there."""

import math

import numpy as np
import pytest
from each import each
from scipy.optimize import linprog, minimize
from scipy.spatial.transform import Rotation
from slow import slow
from thirdbody_three_spot.balance import balance

MATERIALS = {
    "upper": {"shear_modulus": 80e9, "poisson_ratio": 0.3},
    "lower": {"shear_modulus": 60e9, "poisson_ratio": 0.35},
    "particle": {"shear_modulus": 120e9, "poisson_ratio": 0.2},
}
MU = 0.3
TILT = math.atan(0.05)  # of the line through the lower spheres' centres: .1 um over 2 um


def spot(side, x, z):
    return {"side": side, "x": x * 1e-6, "z": z * 1e-6, "radius": 1e-6}


# the strut from the left foot to the top leans by 1.5/4 = .375 > mu; the right foot hangs .1 um above the plate
LAME = (spot("upper", 0.5, 2.0), spot("lower", -1.0, -2.0), spot("lower", 1.0, -1.9))
# no foot to the right: the strut of .375 falls, and lies down ever more


def pressed(spots=LAME, level="mindlin", mu=MU, **path):
    path = path or {"load": 1e-4}
    tables = {"materials": MATERIALS, "friction": {"upper": mu, "lower": mu}, "particle": {"spots": list(spots)}}
    return balance(tables | {"path": {"drag": 0.0, "steps": 1} | path}, level)


@pytest.mark.parametrize(
    ("level", "control"), [("coulomb", "load"), ("mindlin", "indentation"), slow("mdr", "load"), slow("exact", "load")]
)
def test_a_particle_turns_into_its_seat_through_a_strut_that_does_not_hold(level, control):
    result = pressed(level=level, **{control: 1e-4 if control == "load" else 10e-9})
    assert result.stopped is None and result.seat is not None
    end, place = result.points[0], np.array(result.seat.spots)
    # the posture of the rigid particle, but for overlaps of .4 nm, at a hundredth of the load, on feet 2 um apart
    assert result.seat.rotation == pytest.approx(TILT, abs=4e-4)
    assert all(spot != "open" for spot in end.spots) and end.label != "rolling"
    # the balance of forces and of moments about the centre of mass, at the places in the seat, to the solver's tolerance
    sign, normal, shear = np.array([1.0, -1.0, -1.0]), np.array(end.N), np.array(end.T)
    scale = normal.sum()
    assert abs(sign @ normal) < 1e-8 * scale and abs(sign @ shear) < 1e-8 * scale
    assert abs(sign @ (normal * place[:, 0] - shear * place[:, 2])) < 1e-8 * scale * 2e-6
    assert np.all(np.abs(shear) <= MU * normal * (1.0 + 1e-9)) and any("rotates by" in line for line in result.warnings)


def test_seats_by_load_and_by_indentation_of_a_mirror_image_and_of_an_even_particle():
    """Both count from first touch in the seat; they turn into it under loads that differ."""
    same = pressed(load=pressed(indentation=10e-9).points[0].N[0]).points[0]
    # springs under tangential forces from the turning, at a hundredth of the load
    assert same.indentation == pytest.approx(10e-9, rel=0.005)
    here, there = pressed(), pressed([s | {"x": -s["x"]} for s in LAME])
    assert there.seat.rotation == pytest.approx(-here.seat.rotation, rel=1e-9)  # of first touch
    assert there.points[0].N == pytest.approx(here.points[0].N, rel=1e-8)
    assert pressed((LAME[0] | {"x": 0.0}, LAME[1], LAME[2] | {"z": -2e-6})).seat is None


def test_the_forecast_is_that_of_the_seat_and_none_where_the_particle_tips_over():
    """t = (x_1 - x)/h with the upper spot at x_1 and the feet at x, all turned: spheres of equal radius by their centres."""
    forecast = pressed().forecast
    c, sn = math.cos(TILT), math.sin(TILT)
    centres = [(0.5e-6, 1e-6), (-1e-6, -1e-6), (1e-6, -0.9e-6)]
    top, left, right = (x * c + z * sn for x, z in centres)
    h = (centres[0][1] - centres[1][1]) * c - (centres[0][0] - centres[1][0]) * sn + 2e-6
    # rotations of 4e-4 rad, and places that they move by 2 um of 4
    assert (forecast.t_min, forecast.t_max) == pytest.approx(((top - right) / h, (top - left) / h), abs=4e-4)
    assert forecast.possible == ["sticking", "sliding"]
    result = pressed((spot("upper", 0.5, 2.0), spot("lower", -1.0, -2.0), spot("lower", -1.5, -1.9)))
    assert result.points == [] and result.seat is None and result.stopped is not None and result.stopped.label == "rolling"
    # that of the two spots that touch; the third never does
    assert result.forecast.mu_required == pytest.approx(1.5 / 4.0, rel=1e-12) and result.forecast.possible == []


@each([{"load": 1e-4}, {"indentation": 10e-9}])
def test_blunt_spots_turn_until_their_centres_lie_above_each_other(path):
    """As two convex lenses. Of spheres whose centres almost coincide none turns so far, however little is unbalanced."""
    places = ("upper", 0.5, 0.3, 2.0), ("lower", 0, 0, -2.0)
    lens = [spot(side, x, z) | {"y": y * 1e-6, "radius": 4e-6} for side, x, y, z in places]
    seat = pressed(lens, mu=0.0, **path).seat
    # the centres are 4 um apart in height; the forces balance to 1e-9 of themselves, a way of 4e-9 of the arm
    apart = np.hypot(0.3, 0.5)
    assert seat.rotation == pytest.approx(np.array([-0.3, 0.5, 0.0]) / apart * math.atan(apart / 4.0), abs=1e-8)
    ball = [spot("upper", 0.004, 2.0) | {"radius": 1.999e-6}, spot("lower", 0.0, -2.0) | {"radius": 1.999e-6}]
    stopped = pressed(ball, mu=0.0, **path).stopped
    assert stopped.label == "rolling" and stopped.message.startswith("no static state exists while it is pressed")
    assert 0.0 < (stopped.load or stopped.indentation) <= 0.01 * (path.get("load") or path["indentation"])


def test_a_particle_that_takes_too_many_steps_into_its_seat_is_undecided(monkeypatch):
    monkeypatch.setattr("thirdbody.statics.seat.STEPS", 1)
    stopped = pressed().stopped
    assert stopped is not None and stopped.label == "undecided" and "no static state" not in stopped.message


def test_a_strut_that_rolls_by_a_large_angle_keeps_to_its_circles():
    """Two spheres that roll without slip between the plates: drag = (r_1 + r_2) phi + what the line of centres goes along."""
    strut = (spot("upper", 0.0, 2.0), spot("lower", 0.5, -2.0))
    result = pressed(strut, load=1e-4, drag=1.2e-6, steps=120, direction=(1.0, 0.0))
    assert result.stopped is None
    end = result.points[-1]
    c, sn = math.cos(end.phi), math.sin(end.phi)
    along, height = -0.5e-6 * c + 2e-6 * sn, 2e-6 * c + 0.5e-6 * sn
    # elastic slip of a nanometre; with the spots where they were at first 1.3 um would be 1.2
    assert 2e-6 * end.phi + along + 0.5e-6 == pytest.approx(1.2e-6, abs=3e-9)
    # Eq. 16 in the present posture, which the spots follow to .01 overlaps, i.e. a hundredth of a radian
    assert end.T[0] / end.N[0] == pytest.approx(along / (height + 2e-6), abs=5e-3)
    assert {p.label for p in result.points[5:]} == {"rolling"}


def test_a_particle_that_snaps_over_in_the_drag_goes_on_in_its_next_seat():
    """The strut, held at rest by a friction above .375, turns with the drag until it leans by more, and falls on its foot."""
    tables = {"materials": MATERIALS, "friction": {"upper": 0.38, "lower": 0.38}, "particle": {"spots": list(LAME)}}
    path = {"load": 1e-4, "drag": 1e-7, "steps": 100, "direction": (1.0, 0.0)}
    result = balance(tables | {"path": path}, "mindlin")
    assert result.stopped is None and result.seat is None
    turn = np.array([p.phi for p in result.points])
    snap = int(np.diff(turn).argmax()) + 1
    # less than the rigid particle by an overlap of 7 nm on feet 2 um apart: the strut still carries nearly all
    assert turn[snap - 1] < 0.5 * TILT and turn[snap] == pytest.approx(TILT, abs=4e-3)
    assert all(spot != "open" for spot in result.points[snap].spots)
    end = result.points[-1]  # it turned on over the foot that it fell on
    assert (end.label, end.reason, end.spots[1]) == ("rolling", "lift_off", "open")


SIZE, DEEP = 2e-6, 10e-9
RISES = (0.0, 0.5e-9, 3e-9, 10e-9, 200e-9)  # of the lowest spot of a side: from none to more than the indentation
CASES = [(*sides, rise, k) for k, (sides, rise) in enumerate((s, r) for s in ((3, 1), (1, 3), (3, 3), (6, 5)) for r in RISES)]


class Particle:
    """Spots near the corners of two polygons, lower than the outermost by up to `rise`."""

    def __init__(self, uppers, lowers, rise, seed):
        rng, count = np.random.default_rng(seed), uppers + lowers
        corner = np.concatenate([2.0 * np.pi * (np.arange(n) + rng.uniform()) / n for n in (uppers, lowers)])
        self.upper, self.radius = np.arange(count) < uppers, rng.uniform(0.5e-6, SIZE, count)
        self.sign = np.where(self.upper, 1.0, -1.0)
        far = SIZE * np.where(np.where(self.upper, uppers, lowers) > 1, rng.uniform(0.7, 1.0, count), 0.1)
        heights = self.sign * (SIZE - rise * rng.uniform(size=count))
        self.p = np.column_stack([far * np.cos(corner), far * np.sin(corner), heights])

    def turned(self, tilt):
        """Summits (n, 3) of spheres that turn with the particle."""
        summit = np.outer(self.sign * self.radius, (0.0, 0.0, 1.0))
        return Rotation.from_rotvec([*tilt, 0.0]).apply(self.p - summit) + summit

    def gap(self, p):
        """Distances (n,) from plates that touch the outermost spots, and the distance of the plates."""
        above, below = (z := self.sign * p[:, 2])[self.upper].max(), z[~self.upper].max()
        return np.where(self.upper, above, below) - z, above + below

    def seat(self):
        """Spots (n, 3) where no tilt brings the plates closer, by linear programmes for ever smaller tilts."""
        tilt, limit = np.zeros(2), 0.02
        while limit > 1e-13:
            p = self.turned(tilt)
            gap, apart = self.gap(p)
            # over `limit`: tilts, and how far the plates move apart, which stay beyond all spots
            rows = np.column_stack([self.sign * p[:, 1], -self.sign * p[:, 0], -SIZE * self.upper, -SIZE * ~self.upper]) / SIZE
            found = linprog((0, 0, 1, 1), rows, gap / (SIZE * limit), bounds=[(-1, 1)] * 2 + [(None, None)] * 2)
            closer = self.gap(self.turned(tilt + limit * found.x[:2]))[1] < apart
            tilt, limit = (tilt + limit * found.x[:2], limit) if closer else (tilt, 0.25 * limit)
        return self.turned(tilt)

    def forces(self, p):
        """Normal forces (n,) of least energy, sum 8/15 E* sqrt(R) d^2.5, over height and tilts from first touch at `p`."""
        soft = {side: (1.0 - m["poisson_ratio"]) / (2.0 * m["shear_modulus"]) for side, m in MATERIALS.items()}
        k = np.sqrt(self.radius) / (np.where(self.upper, soft["upper"], soft["lower"]) + soft["particle"])
        rows = self.sign[:, None] * np.column_stack([np.ones(len(p)), p[:, 1] / SIZE, -p[:, 0] / SIZE])
        d = lambda y: np.maximum(self.upper - self.gap(p)[0] / DEEP + rows @ y, 0.0)  # noqa: E731
        least = minimize(
            lambda y: 8.0 / 15.0 * k / k[0] @ d(y) ** 2.5, (-0.5, 0.0, 0.0), method="trust-exact", options={"gtol": 1e-10},
            jac=lambda y: 4.0 / 3.0 * rows.T @ (k / k[0] * d(y) ** 1.5),
            hess=lambda y: 2.0 * rows.T @ ((k / k[0] * d(y) ** 0.5)[:, None] * rows),
        )  # fmt: skip
        return 4.0 / 3.0 * k * (d(least.x) * DEEP) ** 1.5


@pytest.mark.parametrize("cases", [CASES[2::10], slow(CASES)])
def test_a_particle_with_unequal_spots_is_pressed_in_its_seat(cases):
    for case in cases:
        particle = Particle(*case)
        spots = [
            {"side": "upper" if up else "lower", "x": x, "y": y, "z": z, "radius": r}
            for (x, y, z), r, up in zip(particle.p, particle.radius, particle.upper, strict=True)
        ]
        result, place = pressed(spots, mu=0.0, indentation=DEEP), particle.seat()
        if result.seat is None:  # held by linear kinematics as it stands
            assert case[2] <= 0.5e-9
            place = particle.p
        else:  # four spots touch at once
            assert np.sort(particle.gap(np.array(result.seat.spots))[0])[3] < 1e-9 * DEEP
        # the judge's gradient of 1e-10 over its softest stiffness
        expected = particle.forces(place)
        assert result.points[0].N == pytest.approx(expected, rel=1e-7, abs=1e-7 * expected.max())
