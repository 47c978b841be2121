"""Contact between bodies in the implicit integrator: balances in closed form, impacts, and what must not change the result."""

from __future__ import annotations

import math

import numpy as np
import pytest

from thirdbody.engine import implicit_islands
from thirdbody.engine.energy import Ledger
from thirdbody.engine.implicit_islands import ImplicitIslands
from thirdbody.engine.snapshot import restore, snapshot
from thirdbody.errors import GuardStop
from thirdbody.kernels.columns import record, run_totals
from thirdbody.runner.prepare import set_threads
from thirdbody.scene import model

R, LOAD, MU = 5e-6, 1e-4, 0.3
SIZE, MIDDLE, GAP = 2e-4, 1e-4, 2e-8
"""Side of the domain, place of the obstacle, and gaps between bodies, m."""

CLOSED = 1e-6
"""Largest residual of the ledger: Newton's method leaves 1e-9 of the forces unbalanced in a step."""

STIFF = 2e-3
"""Deviation of a force from its value for rigid bodies: overlaps tilt the forces by an overlap of 30 nm over the radius."""

BLOCK = tuple(
    {"center": (4e-6 * x, 4e-6 * y, 0.0), "radius": R}
    for x, y in [(0.0, 0.0)] + [(math.cos(k * math.pi / 3.0), math.sin(k * math.pi / 3.0)) for k in range(6)]
)
"""Seven balls as high as one: it cannot tip."""


def dragged(make, debris, pairs=None, speed=1e-3, load=LOAD, integrator="implicit", friction=MU, settle=2e-5, **solver):
    """Bodies with contact between them, each under a patch of its own. `pairs`: friction of other pairs than `friction`."""
    names = ("ball", "block", "floor")
    frictions = {pair: friction for pair in ((a, b) for a in names for b in names if a <= b)} | (pairs or {})
    upper = model.UpperPlate(
        material="ball", support="load_per_particle", load=load, motion=model.Motion(x=[model.ConstantVelocity(velocity=speed)])
    )
    scene = make.scene(
        debris, dict.fromkeys(names, make.STEEL),
        plates=model.Plates(lower=model.LowerPlate(material="floor"), upper=upper),
        contact=model.Contact(level="mindlin"), domain=model.Domain(size=(SIZE, SIZE), periodic=True),
        solver=model.Solver(duration=make.LONG, settle=settle, integrator=integrator, **solver),
    )  # fmt: skip
    pairs = tuple(model.Pair(between=names, friction=mu, restitution=0.6) for names, mu in frictions.items())
    return make.build(scene.model_copy(update={"pairs": pairs}))


def row(make, balls, x=MIDDLE):
    """A block at x (m) and a row of balls behind it."""
    first = x - 4e-6 - 2.0 * R - GAP
    places = [((first - k * (2.0 * R + GAP)) % SIZE, MIDDLE, R) for k in range(balls)]
    block = model.Spheres(material="block", shape=BLOCK, positions=((x, MIDDLE, R),))
    return [block, *(make.ball(R, place) for place in places)]


def between_bodies(simulation):
    """Records of the closed contacts between bodies, by owner."""
    slots = simulation.state.slots
    return slots.R[(slots.histories.slip > 0.0) & (slots.partner >= 0)]


def ledger_after(simulation, distance):
    """Advance to a distance (m) of the drag; the lines of the ledger, and the relative residual."""
    ledger, state = Ledger(simulation.state), simulation.state
    simulation.integrator.advance_to(time=simulation.settle)
    for stop in np.linspace(0.25, 1.0, 4) * distance:
        simulation.integrator.advance_to(distance=float(stop))
        ledger.watch(state)
    lines = ledger.lines(state)
    return lines, ledger.relative_residual(state, lines["residual"])


def test_two_equal_balls_that_touch_roll_on_together(make):
    """Both roll with half the speed of the plate, with no force between them worth naming."""
    simulation = dragged(make, [make.ball(R, (MIDDLE + x, MIDDLE, R)) for x in (0.0, 2.0 * R)])
    _, residual = ledger_after(simulation, 4e-6)
    assert isinstance(simulation.integrator, ImplicitIslands) and residual < CLOSED
    for body in (0, 1):
        assert make.velocity(simulation, body)[0] == pytest.approx(0.5e-3, rel=1e-3)
        assert make.label(simulation, body) == "rolling"
    assert all(contact[record.NORMAL_FORCE] < 1e-4 * LOAD for contact in between_bodies(simulation))


def forces_of_a_row(balls, mu, mu_pair):
    """Normal forces over the load in a row of balls that the drag presses against an obstacle, from the last ball on.

    A ball at rest whose top slips feels mu W there and T below; its neighbours press by N_1 from behind and N_2 from ahead, and
    rub by mu_pair of it. Balance of forces: N_2 - N_1 = mu W + T; of moments: mu W = T + mu_pair (N_1 + N_2).
    """
    forces = [0.0]
    for _ in range(balls):
        forces.append((2.0 * mu + (1.0 - mu_pair) * forces[-1]) / (1.0 + mu_pair))
    return forces[1:]


@pytest.mark.parametrize("balls", [1, 2, 3])
@pytest.mark.parametrize("mu_pair", [0.0, MU])
def test_a_row_of_balls_against_a_body_that_sticks_to_the_lower_plate(make, balls, mu_pair):
    """Their tops slip, the plate feels mu W from each; between two balls the friction is MU."""
    simulation = dragged(make, row(make, balls), {("block", "floor"): 5.0, ("ball", "block"): mu_pair})
    lines, residual = ledger_after(simulation, 4e-6)
    forces = sorted(between_bodies(simulation)[:, record.NORMAL_FORCE] / LOAD)
    expected = forces_of_a_row(balls - 1, MU, MU)
    ahead = expected[-1] if expected else 0.0
    # the contact with the block rubs less than those between balls
    last = (2.0 * MU + (1.0 - MU) * ahead) / (1.0 + mu_pair)
    assert forces == pytest.approx(sorted([*expected, last]), rel=STIFF)
    upper = simulation.state.A[run_totals.UPPER_FORCE3]
    # the upper plate is of the material of the balls
    assert -upper[0] / LOAD == pytest.approx(balls * MU + mu_pair, rel=1e-6)
    assert [make.label(simulation, body) for body in range(balls + 1)] == ["sliding"] * (balls + 1)
    assert residual < CLOSED and abs(lines["numerical"]) < 1e-3 * lines["plate_work"]


def test_a_contact_across_a_periodic_face_is_any_other(make):
    forces = []
    for x in (MIDDLE, 2e-6):
        simulation = dragged(make, row(make, 1, x), {("block", "floor"): 5.0})
        ledger_after(simulation, 2e-6)
        forces.append(between_bodies(simulation)[0, [record.NORMAL_FORCE, record.FRICTION_LIMIT]])
    # positions are 20 times nearer to the origin in the second, and are rounded less
    np.testing.assert_allclose(*forces, rtol=1e-6)


APPROACH = np.array([[0.2, 0.0], [-0.1, 0.0]])
"""Velocities before an impact, m/s."""


def impact(make, tolerance):
    """Two balls that meet off centre between plates without friction, after the impact; and the error of their velocities.

    In closed form the velocities change along the line of centres alone, by half of 1 + e times the approach.
    """
    starts = zip((-6e-6, 6e-6), (0.0, 3e-6), APPROACH, strict=True)
    balls = [make.ball(R, (MIDDLE + x, MIDDLE + y, R), (*v, 0.0)) for x, y, v in starts]
    none = dict.fromkeys([("ball", "ball"), ("ball", "floor")], 0.0)
    simulation = dragged(make, balls, none, load=1e-6, settle=0.0, tolerance=tolerance)
    before = make.momenta(simulation)[0]
    simulation.integrator.advance_to(time=3e-5)
    assert make.momenta(simulation)[0][:2] == pytest.approx(before[:2], rel=1e-9, abs=1e-9 * abs(before[0]))
    normal = np.array([-math.sqrt(4.0 * R**2 - 3e-6**2), -3e-6]) / (2.0 * R)
    change = 0.5 * 1.6 * normal * ((APPROACH[0] - APPROACH[1]) @ normal)
    found = np.array([make.velocity(simulation, body)[:2] for body in (0, 1)])
    return simulation, float(np.abs(found - APPROACH - np.array([-change, change])).max())


def test_an_impact_off_centre_keeps_the_momentum_and_converges_with_the_second_order(make):
    """They fly farther in a stride than candidates are looked for: the stride is repeated as an island."""
    (few, coarse), (many, fine) = impact(make, 1e-6), impact(make, 1e-8)
    assert many.integrator.summary()["islands"]["repeated"] > 0
    ratio = many.integrator.summary()["steps"] / few.integrator.summary()["steps"]
    # 1e-4 of the approach: the patches, whose dashpots the impact moves
    assert ratio > 3.0 and fine < 1.5 * coarse / ratio**2 + 1e-4 * 0.3
    assert fine < 2e-4 * 0.3


def bits(simulation):
    """The state of a run, and the totals of its bodies."""
    state = simulation.state
    on = state.slots.histories.slip > 0.0
    return [state.B, state.S[:, :3], state.slots.H[on], state.slots.partner[on], simulation.integrator.totals]


def chain(make, **solver):
    """A row of balls of different sizes with gaps between them, driven against a block."""
    debris = row(make, 0)
    x = MIDDLE - 4e-6 - R
    for k in range(6):
        radius = R * (1.0 - 0.03 * k)
        x -= radius + GAP * (k + 1)
        debris.append(make.ball(radius, (x, MIDDLE + 2e-7 * (-1) ** k, radius)))
        x -= radius
    return dragged(make, debris, {("block", "floor"): 5.0}, **solver)


def test_the_number_of_threads_and_a_resume_do_not_change_a_bit(make):
    runs = []
    for threads in (1, 2):
        set_threads(threads)
        simulation = chain(make)
        simulation.integrator.advance_to(time=simulation.settle)
        simulation.integrator.advance_to(distance=1e-6)
        if threads == 2:
            kept = snapshot(simulation.state, simulation.integrator, Ledger(simulation.state))
            simulation = chain(make)
            restore(kept, simulation.state, simulation.integrator, Ledger(simulation.state))
        simulation.integrator.advance_to(distance=2e-6)
        runs.append(simulation)
    assert len(between_bodies(runs[0])) > 2
    for one, other in zip(bits(runs[0]), bits(runs[1]), strict=True):
        np.testing.assert_array_equal(one, other)


def test_an_island_that_does_not_pay_stops_the_run_or_goes_on_as_the_scene_says(make, monkeypatch):
    monkeypatch.setattr(implicit_islands, "LARGEST", 2)
    with pytest.raises(GuardStop, match=r"bodies could meet within the next .* more than 2 do not pay"):
        chain(make).integrator.advance_to(distance=2e-6)
    going = chain(make, on_failure="continue")
    going.integrator.advance_to(distance=2e-6)
    assert going.integrator.summary()["islands"]["largest"] > 2
