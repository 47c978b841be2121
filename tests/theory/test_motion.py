"""Free motion and free collisions: the torque-free top, conserved momenta, and the same motion at every size."""

import closed_forms
import numpy as np
import pytest
from each import each
from scipy.spatial.transform import Rotation
from thirdbody.assembly.simulation import build
from thirdbody.engine.state import angular_momentum, orientations
from thirdbody.kernels.explicit.critical_time_step import stable_step
from thirdbody.kernels.tables import body, body_extra
from thirdbody.rotations import matrix_from_quaternion
from thirdbody.scene.model import Effects, Spheres

MOMENTS, SPIN = (1.0, 2.0, 3.0), (0.05, 1.0, 0.05)
PERIOD = closed_forms.top_period(MOMENTS, SPIN)  # against its number in test_theory_numbers


def top(make, step):
    """A body with the principal moments `MOMENTS`, alone in space, spinning with `SPIN`."""
    simulation = build(make.scene([make.ball(1.0, (0.0, 0.0, 0.0))], {"ball": make.STEEL}, time_step=step), force=True)
    B, E = simulation.state.B, simulation.state.E
    E[:, body_extra.INERTIA3], B[:, body.SPHERE_INERTIA] = MOMENTS, 0.0
    B[:, body.SPIN3] = SPIN
    E[:, body_extra.ANGULAR_MOMENTUM3] = angular_momentum(B, E, simulation.state.orientations)
    return simulation


def swing(make, step):
    """Measured period: between two rising zeros of the spin about the middle axis."""
    simulation, rows = top(make, step), []
    while simulation.state.time < 1.9 * PERIOD:
        make.advance(simulation)
        bodies = simulation.state.bodies
        rows.append((simulation.state.time, matrix_from_quaternion(bodies.quaternion[:1])[0][:, 1] @ bodies.spin[0]))
    time, middle = np.array(rows).T
    k = np.flatnonzero((middle[:-1] < 0.0) & (middle[1:] >= 0.0))
    assert len(k) == 2
    # a straight line is exact to third order there: the curvature of the spin vanishes with it
    zeros = time[k] - middle[k] * (time[k + 1] - time[k]) / (middle[k + 1] - middle[k])
    return zeros[1] - zeros[0]


def test_the_period_of_a_top_is_of_second_order_and_it_keeps_momentum_and_energy(make):
    steps = np.array([0.2, 0.1, 0.05])
    errors = [abs(swing(make, step) / PERIOD - 1.0) for step in steps]
    # slopes differ from 2 by the next term, of relative size (.2 rad)^2
    assert np.polyfit(np.log(steps), np.log(errors), 1)[0] == pytest.approx(2.0, abs=0.06)
    assert errors[-1] < 1e-4
    simulation = top(make, 0.05)
    E = simulation.state.E
    momentum, energy = E[0, body_extra.ANGULAR_MOMENTUM3].copy(), make.kinetic(simulation)
    worst = 0.0
    for _ in range(60):
        simulation.integrator.advance_to(time=simulation.state.time + 10.0)
        worst = max(worst, abs(make.kinetic(simulation) / energy - 1.0))
    # world axes: nothing ever touches L; the splitting keeps a neighbour of the energy, (dt omega)^2/12 off at most
    assert np.array_equal(E[0, body_extra.ANGULAR_MOMENTUM3], momentum)
    assert worst < 0.05**2 / 12.0
    assert abs(np.linalg.norm(simulation.state.bodies.quaternion[0]) - 1.0) < 1e-14


def test_a_ball_turns_by_its_spin_at_every_stop(make):
    """A constant spin, at instants within a block of steps (`kernels.bodies`) and after several blocks."""
    step, spin = 0.05, np.array([0.3, -0.2, 0.1])
    simulation = build(make.scene([make.ball(1.0, (0.0, 0.0, 0.0))], {"ball": make.STEEL}, time_step=step), force=True)
    state = simulation.state
    state.B[:, body.SPIN3], start = spin, Rotation.from_quat(np.roll(state.bodies.quaternion[0], -1))
    largest = 14.0 / 3.0 * step * np.linalg.norm(spin)
    for steps in range(1, 70):
        simulation.integrator.advance_to(time=(steps - 0.5) * step)
        now = Rotation.from_quat(np.roll(orientations(state)[0], -1))
        off = (now * (Rotation.from_rotvec(steps * step * spin) * start).inv()).magnitude()
        # a rotation r at once is off by r^5/120: the tangent has two terms
        assert off < steps * largest**5 / 120.0 + 1e-14
    assert off > 1e-3 * steps * largest**5 / 120.0


LUMP = (
    {"center": (0.0, 0.0, 0.0), "radius": 1.0},
    {"center": (0.9, 0.2, 0.1), "radius": 0.7},
    {"center": (-0.3, 0.8, -0.4), "radius": 0.6},
    {"center": (0.1, -0.5, 0.9), "radius": 0.5},
)


def lump(scale, where, velocity, spin):
    """One irregular clump, `scale` times as large as `LUMP` (m); lengths and times grow with the scale."""
    shape = tuple({"center": tuple(scale * x for x in ball["center"]), "radius": scale * ball["radius"]} for ball in LUMP)
    place = (tuple(scale * x for x in where),)
    spin = tuple(w / scale for w in spin)
    return Spheres(material="ball", shape=shape, positions=place, velocity=velocity, angular_velocity=spin)


@pytest.mark.parametrize("friction, restitution", [(0.3, 1.0), (0.5, 0.5)])
def test_free_collision_conserves_momenta(make, friction, restitution):
    """Three irregular clumps meet in open space: forces and torques cancel in pairs, to rounding."""
    bodies = [
        lump(1e-3, (-2.5, 0.1, 0.2), (2.0, 0.0, 0.0), (0.3, -0.2, 0.1)),
        lump(1e-3, (2.5, 0.3, -0.2), (-2.0, 0.0, 0.0), (0.0, 0.25, -0.3)),
        lump(1e-3, (0.3, 3.5, 0.4), (0.0, -2.5, 0.0), (0.1, 0.0, 0.4)),
    ]
    simulation = build(make.scene(bodies, {"ball": make.STEEL}, friction=friction, restitution=restitution))
    (p, angular), energy = make.momenta(simulation), make.kinetic(simulation)
    B, E = simulation.state.B, simulation.state.E
    largest, start = B[0, body.MASS] * 4.0, E[:, body_extra.ANGULAR_MOMENTUM3].copy()
    simulation.integrator.advance_to(time=1.2e-3)
    after_p, after_angular = make.momenta(simulation)
    changed = np.abs(E[:, body_extra.ANGULAR_MOMENTUM3] - start).max(axis=1)
    assert np.all(changed > 0.1 * np.abs(start).max()), "all of them collided"
    # some 1e4 steps with an error of half a unit in the last place each, at random: 1e2 * 1e-16 of the largest momentum
    assert np.abs(after_p - p).max() < 1e-13 * largest
    assert np.abs(after_angular - angular).max() < 1e-13 * largest * 5e-3
    assert make.kinetic(simulation) < energy * (1.0 + 1e-3 if restitution == 1.0 else 0.99)


def tumble(make, scale):
    """A clump of that size (m) thrown on a plate: dimensionless height, attitude and spin at equal dimensionless times."""
    one = lump(scale, (20.0, 20.0, 1.9), (0.5, 0.1, -1.0), (0.2, -0.3, 0.1))
    gravity = Effects(gravity=(0.0, 0.0, -0.05 / scale))
    keys = {"lower": "ball", "friction": 0.4, "restitution": 0.6, "size": 40.0 * scale, "effects": gravity}
    simulation = build(make.scene([one], {"ball": make.STEEL}, **keys))
    rows = []
    for k in range(1, 9):
        simulation.integrator.advance_to(time=1.5 * k * scale)
        bodies = simulation.state.bodies
        rows.append(np.concatenate([bodies.position[0] / scale, bodies.quaternion[0], bodies.spin[0] * scale]))
    return np.array(rows)


def test_micrometre_clumps_tumble_like_metre_sized_ones(make):
    """Hertz-Mindlin contact has no length of its own: lengths and times scale together, speeds stay."""
    large, small = tumble(make, 1.0), tumble(make, 2.0**-20)
    assert np.abs(np.diff(large[:, 3:7], axis=0)).max() > 0.1  # it does turn
    # a power of two changes no digits; what differs is the quadrature of the moments, 1e-13, times the growth of errors in a few
    # bounces
    assert small == pytest.approx(large, rel=1e-9, abs=1e-9)


def growth(omega, rate, dt):
    """Spectral radius of one step of velocity Verlet; the dashpot sees v + dt a, predicted from the force before."""
    w, g = (omega * dt) ** 2, rate * dt
    # x, v dt, a dt^2: drift, new acceleration, closing half kick
    drift = np.array([[1.0, 1.0, 0.5], [0.0, 1.0, 0.5], [0.0, 0.0, 1.0]])
    force = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [-w, -g, -0.5 * g]])
    kick = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.5], [0.0, 0.0, 1.0]])
    return float(np.abs(np.linalg.eigvals(kick @ force @ drift)).max())


@each([(1.0, 0.0), (1.0, 0.1), (1.0, 1.0), (1.0, 4.0), (1.0, 100.0), (1e-3, 1.0)])
def test_the_stable_step_is_the_edge_of_stability(row):
    omega, rate = row
    limit = stable_step.py_func(omega**2, rate)
    # undamped the scheme is neutral below the limit: rounding of the double eigenvalue is 1e-8
    assert growth(omega, rate, 0.999 * limit) <= 1.0 + 1e-7
    assert growth(omega, rate, 1.001 * limit) > 1.0 + 1e-4
