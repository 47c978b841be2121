"""Contacts of spheres with rough plates in the explicit integrator: closed forms, conservation, several contacts, tracking.

Forces at a place are those of the engine, evaluated in a step of zero length, in which nothing moves and nothing slides."""

import functools
import math

import numpy as np
import pytest
from rough import field, rough_plates
from scipy.interpolate import make_interp_spline
from scipy.optimize import brentq
from thirdbody.assembly.simulation import build
from thirdbody.engine.neighbours import search
from thirdbody.engine.state import refresh_spheres
from thirdbody.kernels.height_field import RAMP
from thirdbody.kernels.minima import RoughPlates, update
from thirdbody.kernels.plates import BASINS
from thirdbody.kernels.tables import run_totals, surface_contact

SIZE, CELLS, WAVES, SLOPE = 10.0, 80, 2, 0.16  # period of the surface [m], cells along x, waves along x, and their steepest slope
Q_X = 2.0 * math.pi * WAVES / SIZE
AMPLITUDE = SLOPE / Q_X
RADIUS = 4.4 / Q_X
DEPTH = 1e-3 * RADIUS


def crests(x, y):
    return AMPLITUDE * np.cos(Q_X * x)


@pytest.fixture(scope="module")
def lifted_ball(make):
    """Builds a ball without friction far above a rough rigid plane, to be put anywhere."""

    def build_ball(heights, radius, curved=True, **keys):
        materials = {"ball": make.STEEL, "plane": make.stiffened(make.STEEL)}
        size = keys.pop("size", SIZE)
        surface = field(heights, (size, size), keys.pop("cells", (CELLS, 4)), curved)
        debris = [make.ball(radius, (5.0, 5.0, 4.0 * radius))]
        with rough_plates(surface):
            return build(make.scene(debris, materials, lower="plane", size=size, **keys))

    return build_ball


def put(simulation, centre):
    simulation.state.bodies.position[0] = centre
    refresh_spheres(simulation.state)


def update_minima(state):
    """Follow the minima of all spheres to where they are now, and search for new ones where a sphere has moved far enough."""
    slots = state.slots
    tables = slots.own, slots.partner, state.S, state.P, slots.Q, state.D, state.lower_surface, state.upper_surface
    update(0, slots.n_plates, RoughPlates(*tables))


def force_at(simulation, centre):
    """Force of the contacts on the ball with its centre there, the part from the gradient of the radius, and their energy."""
    state = simulation.state
    put(simulation, centre)
    search(state)
    simulation.integrator._tables()
    simulation.integrator._advance(1, math.inf, math.inf, 0.0)
    on = state.slots.histories.slip > 0.0
    stored = state.slots.records.stored_normal[on]
    gradient = -0.5 * stored @ state.slots.Q[on[: len(state.slots.Q)]][:, surface_contact.GRADIENT3]
    return state.bodies.force[0].copy(), gradient, float(stored.sum())


class Profile:
    def __init__(self, heights):
        x = np.linspace(0.0, SIZE, CELLS + 1)
        self.spline = make_interp_spline(x, heights(np.append(x[:-1], 0.0), 0.0), k=3, bc_type="periodic")

    def centre(self, x, far):
        """Point at a distance from the surface along the normal at x, and its derivative with x."""
        h, s, b = (float(self.spline(x, k)) for k in range(3))
        w = math.sqrt(1.0 + s * s)
        return np.array([x - far * s / w, 5.0, h + far / w]), np.array([1.0 - far * b / w**3, 0.0, s - far * s * b / w**3])


@pytest.fixture(scope="module")
def wavy(lifted_ball):
    return lifted_ball(crests, RADIUS)


def test_a_field_of_zeros_is_a_flat_plate_bit_for_bit(make):

    def states(surface):
        with rough_plates(surface):
            keys = {"friction": 0.3, "restitution": 0.6, "gravity": (0.0, 0.0, -9.81), "size": SIZE}
            simulation = make.ball_on_plane(make.STEEL, 1.0, (0.5, -0.2, -1.0), (0.3, 2.0, 0.1), **keys)
        seen = []
        for _ in range(8):
            simulation.integrator.advance_to(time=simulation.state.time + 2e-4)
            state, on = simulation.state, simulation.state.slots.histories.slip > 0.0
            ledger = state.A[[run_totals.FRICTION_WORK, run_totals.DAMPING_WORK, run_totals.STORED_NORMAL, run_totals.STEPS]]
            seen += [state.B.copy(), state.E.copy(), state.slots.H[on].copy(), state.slots.R[on].copy(), ledger]
        return seen

    flat, rough = states(None), states(field(lambda x, y: 0.0 * x, (SIZE, SIZE), (8, 8)))
    assert any(len(rows) for rows in flat[2::5]), "it touches"
    assert [rows.tobytes() for rows in flat] == [rows.tobytes() for rows in rough]


@pytest.mark.parametrize(("x", "sign"), [(0.0, 1.0), (0.5 * SIZE / WAVES, -1.0)], ids=["crest", "valley"])
def test_crest_and_valley_have_the_radius_of_hertz(lifted_ball, wavy, x, sign):
    """(1/R_eff)^2 = (1/R + k)/R with the curvature k of the spline at a node, in closed form. The second derivative changes by
    angle^2/2 of itself to the next node; its kink here is rounded off by RAMP/2 of that."""
    angle = 2.0 * math.pi * WAVES / CELLS
    scale = 6.0 * AMPLITUDE / (4.0 + 2.0 * math.cos(angle))
    bend = sign * scale * 2.0 * (1.0 - math.cos(angle)) * (CELLS / SIZE) ** 2 * (1.0 - 0.5 * RAMP * (1.0 - math.cos(angle)))
    force, gradient, _ = force_at(wavy, (x, 5.0, sign * AMPLITUDE + RADIUS - DEPTH))
    plain, none, _ = force_at(lifted_ball(crests, RADIUS, curved=False), (x, 5.0, sign * AMPLITUDE + RADIUS - DEPTH))
    # N goes as the root of the effective radius; rounding of coordinates of 10 m against an overlap of 2 mm: 1e-12
    assert force[2] / plain[2] == pytest.approx((1.0 + RADIUS * bend) ** -0.25, rel=1e-9)
    # where the surface is symmetric; rounding as above, with the root of the overlap
    assert np.abs(gradient[:2]).max() < 1e-9 * force[2] and not none.any()
    assert wavy.state.slots.records.effective_radius[:BASINS].max() == pytest.approx(RADIUS / math.sqrt(1.0 + RADIUS * bend))


def loop_work(simulation, profile):
    """Press at a crest, move along to the valley, release there: work done with and without the gradient force, energies there.
    Gauss' rule in each cell and on the ramps at its borders, where all is smooth, and along the indentation with depth ~ t^2."""
    points, weights = np.polynomial.legendre.leggauss(5)
    points, weights = 0.5 * (points + 1.0), 0.5 * weights
    valley, whole, plain, energies = 0.5 * SIZE / WAVES, 0.0, 0.0, []
    for x, sign in ((0.0, 1.0), (valley, -1.0)):
        for t, w in zip(points, weights, strict=True):
            force, gradient, _ = force_at(simulation, profile.centre(x, RADIUS - DEPTH * t * t)[0])
            work = sign * w * 2.0 * t * DEPTH * force[2]
            whole, plain = whole + work, plain + work
        energies.append(force_at(simulation, profile.centre(x, RADIUS - DEPTH)[0])[2])
    cell = SIZE / CELLS
    for k in range(round(valley / cell)):
        for first, last in ((0.0, RAMP), (RAMP, 1.0 - RAMP), (1.0 - RAMP, 1.0)):
            for t, w in zip(first + (last - first) * points, (last - first) * weights, strict=True):
                centre, along = profile.centre(cell * (k + t), RADIUS - DEPTH)
                force, gradient, _ = force_at(simulation, centre)
                whole, plain = whole - w * cell * force @ along, plain - w * cell * (force - gradient) @ along
    return whole, plain, *energies


def test_a_closed_path_makes_no_energy(lifted_ball, wavy):
    """Without the gradient force it makes what the energies at both ends differ by: .55 of what was pressed in."""
    profile = Profile(crests)
    whole, plain, pressed, released = loop_work(wavy, profile)
    assert abs(whole) < 1e-5 * pressed
    assert plain == pytest.approx(pressed - released, rel=1e-5)
    assert (released - pressed) / pressed == pytest.approx(0.55, abs=0.01)
    whole, plain, pressed, released = loop_work(lifted_ball(crests, RADIUS, curved=False), profile)
    assert abs(whole) < 1e-5 * pressed and whole == plain
    assert released == pytest.approx(pressed, rel=1e-9)


def test_a_sphere_in_a_groove_has_two_contacts(lifted_ball):
    """Walls at 45 degrees, a ball that falls in and comes to rest: N = W / (2 cos th) each."""
    keys = {"gravity": (0.0, 0.0, -1e5), "restitution": 0.2, "time_step": "auto"}
    simulation = lifted_ball(lambda x, y: np.abs(x - 0.5 * SIZE), 1.0, cells=(256, 4), **keys)
    state = simulation.state
    put(simulation, (5.0, 5.0, math.sqrt(2.0) * 1.0005))
    simulation.integrator.start()
    simulation.integrator.advance_to(time=0.03)
    on = np.flatnonzero(state.slots.histories.slip > 0.0)
    N, normals = state.slots.records.normal_force[on], state.slots.records.normal[on]
    assert sorted(state.slots.partner[on].tolist()) == [-2, -1]
    assert sorted(normals[:, 0]) == pytest.approx([-math.sqrt(0.5), math.sqrt(0.5)], rel=1e-3)
    # what still swings
    assert pytest.approx(state.bodies.mass[0] * 1e5 / (2.0 * math.cos(math.radians(45.0))), rel=1e-3) == N


def test_the_path_of_a_rigid_sphere_is_the_dilation_of_the_field(lifted_ball):
    """ISO 16610-41: the lowest centre above x is max over u of h(u) + sqrt(R^2 - (u - x)^2)."""
    rng = np.random.default_rng(3)
    rows = [(rng.integers(-5, 6, 2), rng.uniform(0.0, 2.0 * math.pi), rng.uniform(0.05, 0.15)) for _ in range(12)]
    heights = functools.partial(waves, rows=rows)
    simulation, radius = lifted_ball(heights, 1.0, cells=(160, 160)), 1.0
    state, fine = simulation.state, np.linspace(-radius, radius, 801)
    search(state)

    def gap(x, y, z):
        put(simulation, (x, y, z))
        update_minima(state)
        return float(state.slots.Q[:, surface_contact.DISTANCE].min()) - radius

    for x, y in rng.uniform(0.0, SIZE, (3, 2)):
        u, v = np.meshgrid(x + fine, y + fine, indexing="ij")
        inside = np.maximum(radius**2 - (u - x) ** 2 - (v - y) ** 2, 0.0)
        top = float(np.where(inside > 0.0, heights(u, v) + np.sqrt(inside), -np.inf).max())
        # the points of the brute force are 2.5e-3 apart: it is low by that squared over a small radius; splines by 1e-6
        assert brentq(lambda z, x=x, y=y: gap(x, y, z), top - 0.01, top + 0.01, xtol=1e-9) == pytest.approx(top, abs=2e-5)


def waves(x, y, rows):
    return sum(a * np.cos(2.0 * math.pi / SIZE * (k[0] * x + k[1] * y) + p) for k, p, a in rows)


SHARP = [((3, 1), 0.7, 0.12), ((-2, 4), 2.1, 0.1), ((5, -3), 4.0, 0.08), ((1, 5), 5.5, 0.08)]
"""Waves whose valleys are sharper than a ball of radius 1."""


def touching(simulation):
    distances = simulation.state.slots.Q[:, surface_contact.DISTANCE]
    return sorted(distances[distances < 1.0])


def test_contacts_that_are_followed_are_those_of_a_search(lifted_ball):
    """A ball hops and slides along valleys sharper than itself, and comes to rest in one: at every step, all that touches."""
    keys = {"cells": (120, 120), "gravity": (0.0, 0.0, -1e3), "restitution": 0.5}
    simulation = lifted_ball(functools.partial(waves, rows=SHARP), 1.0, **keys)
    state, numbers, wrong = simulation.state, [], 0
    put(simulation, (5.0, 5.0, 1.5))
    state.bodies.velocity[0] = 20.0, 7.0, 0.0
    simulation.integrator.start()
    for _ in range(1500):
        simulation.integrator.advance_to(time=state.time + 4e-4)
        followed, rows = touching(simulation), state.slots.Q.copy()
        state.slots.Q[:, surface_contact.SEARCHED] = np.inf
        update_minima(state)
        searched = touching(simulation)
        state.slots.Q[:] = rows
        numbers.append(len(searched))
        wrong += len(followed) != len(searched) or not np.allclose(followed, searched, rtol=1e-12)
    # where two minima part while both touch, the second one is found after `minima.MOVED_TOUCHING` radii at most
    assert wrong <= 1
    assert numbers.count(0) > 100 and numbers.count(1) > 100 and numbers.count(2) + numbers.count(3) > 50
