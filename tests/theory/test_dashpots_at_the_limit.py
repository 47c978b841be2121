"""Spring and dashpot at the friction limit: their sum is the nearest point of the circle of radius mu N; local damping."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
import three_spot_theory as theory
from thirdbody_three_spot.mdr import MDR
from thirdbody.assembly.simulation import build
from thirdbody.engine.guards import Ledger
from thirdbody.errors import InputError
from thirdbody.kernels.implicit.jacobian import give_springs
from thirdbody.kernels.tables import body, body_extra
from thirdbody.kernels.tile import TILE, contact_tangent, law_input, law_output, rolling_input, rolling_output
from thirdbody.laws.compose import compose
from thirdbody.laws.contract import Material, Pair
from thirdbody.laws.damping import TANGENTIAL_DAMPING
from thirdbody.laws.friction import MINDLIN
from thirdbody.laws.hertz import HERTZ
from thirdbody.scene.model import Effects, Solver

STEEL = Material("steel", 210e9 / 2.6, 0.3, 7850.0)
OVERLAP, RADIUS, MASS, FRICTION = 5e-9, 3e-6, 4e-12, 0.3
NUMBER, RATE = 8, 1e7
LIMIT = FRICTION * 4.0 / 3.0 * 210e9 / (2.0 * 0.91) * np.sqrt(RADIUS) * OVERLAP**1.5


class Bench:
    """The compiled laws of a level on contacts whose springs are at the limit along x."""

    def __init__(self, level):
        laws, given = (HERTZ, level, TANGENTIAL_DAMPING), {"springs": 16.0, "renewal": 0.0} if level is MDR else {}
        options = {law.name: {o.name: given.get(o.name, o.default) for o in law.options} for law in laws}
        self.field, self.chain = level is MDR, compose(law.sized(options[law.name]) for law in laws)
        mixed = (law.mix(Pair(STEEL, STEEL, FRICTION, 0.6), options[law.name]) for law in self.chain.laws)
        self.values = np.array([float(x) for values in mixed for x in values])
        self.history = len(self.chain.history)
        self.memory = np.zeros((self.history, TILE))
        if self.field:  # a slip that brings all springs to their limits
            for slip in ((0.0, 0.0), (OVERLAP, 0.0)):
                answer = self.outputs(np.tile(slip, (NUMBER, 1)), np.zeros((NUMBER, 2)), 0.0)
                self.memory = answer[law_output.HISTORY : law_output.HISTORY + self.history]
        else:
            names = [name.split(".")[-1] for name in self.chain.history]
            self.memory[names.index("force_x")] = LIMIT
            self.memory[names.index("energy")] = LIMIT * OVERLAP  # more than T^2/(2 k): the whole force is carried

    def inputs(self, slip, velocity, rate):
        """Slip [m] in a step of the time 1/rate, and velocity [m/s] (n, 2)."""
        I = np.zeros((law_input.HISTORY + self.history + rolling_input.WIDTH, TILE))  # noqa: E741
        I[law_input.OVERLAP], I[law_input.RADIUS], I[law_input.MASS] = OVERLAP, RADIUS, MASS
        I[law_input.HISTORY : law_input.HISTORY + self.history] = self.memory
        I[law_input.SLIP_X, : len(slip)], I[law_input.SLIP_Y, : len(slip)] = slip.T
        I[law_input.VELOCITY_X, : len(slip)], I[law_input.VELOCITY_Y, : len(slip)] = velocity.T
        I[law_input.HISTORY + self.history + rolling_input.INVERSE_DT] = rate
        return I

    def outputs(self, slip, velocity, rate=RATE):
        O = np.zeros((law_output.HISTORY + self.history + rolling_output.WIDTH, TILE))  # noqa: E741
        self.chain.law(self.inputs(slip, velocity, rate).ravel(), O.ravel(), len(slip), self.values)  # a view: O is contiguous
        return O

    def moved(self, velocity):
        """Force (n, 2), limit and power of the dashpot (n,) of contacts that move without slip."""
        O = self.outputs(0.0 * velocity, velocity)[:, : len(velocity)]  # noqa: E741
        return (
            O[law_output.TANGENTIAL_X : law_output.TANGENTIAL_X + 2].T,
            O[law_output.FRICTION_LIMIT],
            O[law_output.DASHPOT_POWER],
        )

    def forces(self, slip):
        """Tangential forces (n, 2) where slip is velocity times the step."""
        return self.outputs(slip, RATE * slip)[law_output.TANGENTIAL_X : law_output.TANGENTIAL_X + 2, :NUMBER].T

    def tangents(self, slip):
        """Their derivatives by the slip (n, 2, 2) [N/m]; for a law with a field with the springs that the engine gives."""
        K = np.zeros((contact_tangent.SPOTS_WIDTH, TILE))
        if self.field:
            answered = SimpleNamespace(outputs=self.outputs(slip, RATE * slip).ravel(), tangents=K.ravel())
            give_springs.py_func(NUMBER, SimpleNamespace(dashpots=0, n_history=self.history), answered)
        self.chain.tangents(self.inputs(slip, RATE * slip, RATE).ravel(), K.ravel(), NUMBER, self.values)
        return K[contact_tangent.XX : contact_tangent.XX + 4, :NUMBER].T.reshape(-1, 2, 2)


def test_the_sum_is_the_nearest_point_of_the_circle():
    bench = Bench(MINDLIN)
    # c of the dashpot [N s/m], from a small velocity along the spring's force, inwards: the sum is then within the limit
    force, _, _ = bench.moved(np.array([[1e-6, 0.0], [0.0, 0.0]]))
    viscosity = float(force[1, 0] - force[0, 0]) / 1e-6
    angles = np.linspace(0.0, 2.0 * np.pi, NUMBER, endpoint=False)
    velocity = 1e-2 * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    force, limits, power = bench.moved(velocity)
    limit = limits[0]
    free = np.array([limit, 0.0]) - viscosity * velocity
    nearest = free * np.minimum(1.0, limit / np.linalg.norm(free, axis=1))[:, None]
    # c is a difference of forces, known to 1e-9 of mu N here
    np.testing.assert_allclose(force, nearest, atol=1e-7 * limit)
    # what it dissipates is the work of its own part, at least its square over c (projection onto a convex set)
    part = force - np.array([limit, 0.0])
    np.testing.assert_allclose(power, -np.sum(part * velocity, axis=1), atol=1e-7 * limit * 1e-2)
    assert (power >= np.sum(part**2, axis=1) / viscosity - 1e-7 * limit * 1e-2).all()


@pytest.mark.parametrize("level", [MINDLIN, pytest.param(MDR, marks=pytest.mark.full(kind="slow"))], ids=["mindlin", "mdr"])
def test_the_tangent_of_the_sum_is_its_derivative(level):
    """Against central differences where slip changes the velocity by slip/dt: sticking, sliding, and returned by the dashpot."""
    bench, h = Bench(level), 1e-14
    angles = np.linspace(0.1, 2.0 * np.pi + 0.1, NUMBER, endpoint=False)
    slip = 2e-11 * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    limit = bench.outputs(slip, RATE * slip)[law_output.FRICTION_LIMIT, :NUMBER]
    # the springs of `mdr` together reach 1 - 1.5 (spacing/2a)^2 of the limit: only the dashpot goes beyond
    returned = np.linalg.norm(bench.forces(slip), axis=1) > (1.0 - (1e-9 if bench.field else 1e-12)) * limit
    assert returned.any() and not returned.all()
    found = bench.tangents(slip)
    for column in range(2):
        step = h * np.eye(2)[column]
        derivative = (bench.forces(slip + step) - bench.forces(slip - step)) / (2.0 * h)
        # a difference of forces of 1e-4 N over 2e-14 m is rounded by some 1e-6 of the stiffness, 1e6 N/m with the dashpot
        np.testing.assert_allclose(found[:, :, column], derivative, rtol=0.0, atol=1e-5 * np.abs(derivative).max())


BALL_RADIUS, GRAVITY, DROP = 1e-3, 1e4, 1e-3  # such a strong gravity makes short falls: two thousand steps each


def dropped(make, alpha, settle, drop=DROP, step="auto", **more):
    """A ball at a height over a plane, without any other damping; every body of the scene settles for `settle` seconds."""
    effects = {"gravity": (0.0, 0.0, -GRAVITY), "named": {"local_damping": {"coefficient": alpha}} | more}
    solver = Solver(duration=1.0, settle=settle, time_step=step)
    one = [make.ball(BALL_RADIUS, (5.0, 5.0, BALL_RADIUS + drop))]
    return build(make.scene(one, {"ball": make.STEEL}, lower="ball", effects=Effects(**effects), solver=solver))


def height(simulation):
    return simulation.state.spheres.position[0, 2] - BALL_RADIUS


def test_a_dropped_ball_bounces_lower(make):
    """Between turning points (1 + alpha) U_2 = (1 - alpha) U_1, U from the equilibrium: two of them make a bounce."""
    alpha = 0.6
    # a quarter of the automatic step: the force turns at a step, not at the turning point
    simulation = dropped(make, alpha, 1.0, step=5e-8)
    ledger, scale = Ledger(simulation.state), GRAVITY * DROP * make.ball_mass(make.STEEL, BALL_RADIUS)
    fall, ratio = math.sqrt(2.0 * DROP / (GRAVITY * (1.0 - alpha))), ((1.0 - alpha) / (1.0 + alpha)) ** 2
    simulation.integrator.advance_to(time=0.9 * fall)
    # the first half step, from rest, is not damped yet: alpha/(1 - alpha) of it
    assert DROP - height(simulation) == pytest.approx(DROP * (simulation.state.time / fall) ** 2, rel=1e-3)
    simulation.integrator.advance_to(time=1.1 * fall)
    while make.velocity(simulation)[2] > 0.0:
        make.advance(simulation)
    g, nu = make.STEEL.shear(), make.STEEL.poisson_ratio
    weight = GRAVITY * make.ball_mass(make.STEEL, BALL_RADIUS)
    # potential of the equilibrium below first touch: m g d - (2/5) m g d, an equivalent height
    sunk = 0.6 * theory.hertz_overlap(theory.e_star(g, nu, g, nu), BALL_RADIUS, weight)
    # that turn is late by some 1/120 of the impact's depth, squared
    assert height(simulation) + sunk == pytest.approx(ratio * (DROP + sunk), rel=5e-3)
    lines = ledger.lines(simulation.state)
    # the ledger: gravity's work and the damping's own stand together as body effects; truncation of the short impact
    assert abs(lines["residual"]) < 3e-3 * scale and lines["damping"] == lines["friction"] == 0.0
    assert lines["body_effects"] == pytest.approx(lines["kinetic"] + lines["elastic_normal"], abs=3e-3 * scale)


def test_a_rocking_ball_decays_by_the_logarithmic_decrement(make):
    """ln((1 + alpha)/(1 - alpha)) a period, whatever the frequency: here that of the rolling spring; torques like forces."""
    alpha, rolling = 0.1, {"rolling_resistance": {"coefficient": 0.5}}
    simulation = dropped(make, alpha, 1.0, drop=0.0, **rolling)
    simulation.integrator.advance_to(time=2e-3)
    B, E = simulation.state.B, simulation.state.E
    B[0, body.SPIN + 1], E[0, body_extra.ANGULAR_MOMENTUM + 1] = 1.0, E[0, body_extra.INERTIA]
    ledger, energy, spins = Ledger(simulation.state), make.kinetic(simulation), []
    earlier = ledger.lines(simulation.state)["residual"]
    while len(spins) < 20000 and np.count_nonzero(np.diff(np.sign(spins))) < 9:
        make.advance(simulation)
        spins.append(make.spin(simulation)[1])
    turns = np.flatnonzero(np.diff(np.sign(spins)))
    peaks = [np.abs(spins[a:b]).max() for a, b in zip(turns, turns[1:], strict=False)]
    # the sign turns at a step, with omega dt = 0.08: 7e-4, and a quarter with half the step
    decrement = 2.0 * np.log(peaks[0] / peaks[-1]) / (len(peaks) - 1)
    assert decrement == pytest.approx(math.log((1.0 + alpha) / (1.0 - alpha)), rel=2e-3)
    # the work of the torques, but for truncation
    assert abs(ledger.lines(simulation.state)["residual"] - earlier) < 1e-3 * energy


def test_it_ends_with_the_settling(make):
    settle = 2e-4
    simulation = dropped(make, 0.5, settle)
    simulation.integrator.advance_to(time=settle)
    start, speed = simulation.state.time, make.velocity(simulation)[2]
    # the step that ends the settling may be half damped: 1 in 1000 steps
    assert speed == pytest.approx(-0.5 * GRAVITY * start, rel=2e-3)
    force = simulation.state.bodies.force[0]
    assert np.array_equal(force, simulation.state.bodies.mass[0] * np.array([0.0, 0.0, -GRAVITY]))
    simulation.integrator.advance_to(time=1.5 * settle)
    # free fall: only round-off
    assert make.velocity(simulation)[2] - speed == pytest.approx(-GRAVITY * (simulation.state.time - start), rel=1e-10)

    with pytest.raises(InputError, match=r"effects.local_damping: acts while the debris settles, and this scene has no"):
        dropped(make, 0.3, 0.0)
