"""The implicit integrator under a plate that all bodies carry, without inertia, and where it gives up or stops."""

import math

import numpy as np
import pytest
import three_spot_theory as theory
from scipy.optimize import brentq
from slow import slow
from thirdbody.engine.guards import Ledger
from thirdbody.errors import GuardStop
from thirdbody.kernels.arguments import Motion
from thirdbody.kernels.implicit import common_plate, control
from thirdbody.kernels.step_tables import body_solution, step_memory
from thirdbody.kernels.tables import body, patch, run_totals
from thirdbody.scene import model

SIZE = 2e-4
MICRO, TALLER = 5e-6, 1e-9  # radius of the smallest ball, and by how much each ball is larger than the one before, m
COUNT, LOAD, MU = 6, 2e-3, 0.3
STIFFNESS = 1e5  # of a patch's spring on a foundation, N/m: it yields by some nanometres, as the contacts do
SPRINGS = {"support": "foundation", "stiffness": STIFFNESS, "preload": 1e-4}
supports = pytest.mark.parametrize("plate", [None, SPRINGS], ids=["rigid", "foundation"])
CLOSED = 1e-6
"""Largest residual of the ledger: Newton's method leaves 1e-9 of the forces unbalanced in a step, corners of the laws 1e-6."""


def drag(speed=1e-3):
    return model.Motion(x=[model.ConstantVelocity(velocity=speed)])


def carried(make, debris, motion, integrator="implicit", plate=None, **keys):
    solver = {key: keys.pop(key) for key in tuple(keys) if key in model.Solver.model_fields}
    given = {key: value for key, value in ({"support": "rigid", "load": LOAD} | (plate or {})).items() if value is not None}
    upper = model.UpperPlate(material="ball", motion=motion, **given)
    tables = {
        "plates": model.Plates(lower=model.LowerPlate(material="ball"), upper=upper),
        "contact": model.Contact(level=keys.pop("level", "mindlin"), debris_contact="none"),
        "solver": model.Solver(**({"duration": make.LONG, "integrator": integrator} | solver)),
        "domain": model.Domain(size=(SIZE, SIZE), periodic=True),
    }
    keys = {"friction": MU, "restitution": 0.3} | keys
    return make.build(make.scene(debris, {"ball": make.STEEL}, **(tables | keys)))


def balls(make):
    radii = MICRO + TALLER * np.arange(COUNT)
    return [make.ball(r, (3e-5 + 2.5e-5 * k, 1e-4, r)) for k, r in enumerate(radii)]


def flakes(make, count=COUNT):
    """Hexagons of seven balls, each a little thicker than the one before."""
    shapes = [tuple(ball | {"radius": ball["radius"] + k * TALLER} for ball in make.HEXAGON) for k in range(count)]
    return [make.clump(shape, 3e-5 + 2.5e-5 * k, gap=0.0) for k, shape in enumerate(shapes)]


def pushes(simulation):
    state = simulation.state
    upper = state.slots.partner < -1
    return np.bincount(state.body[state.slots.own[upper]], state.slots.records.normal_force[upper], minlength=state.n_bodies)


def hertz(make, radius, squeeze, spots=1):
    """Force (N) on `spots` balls between two plates that are nearer to each other than the diameter by `squeeze` (m)."""
    g, nu = make.STEEL.shear(), make.STEEL.poisson_ratio
    overlap = np.maximum(0.5 * squeeze, 0.0)
    return spots * 4.0 / 3.0 * theory.e_star(g, nu, g, nu) * np.sqrt(radius) * overlap**1.5


def sprung(make, radii, plate, preload):
    """Force on every ball under a patch whose spring hangs from a plate at this height: preload + k (z - plate)."""
    forces = []
    for r in radii:
        unbalanced = lambda z, r=r: float(hertz(make, r, 2.0 * r - z)) - preload - STIFFNESS * (z - plate)  # noqa: E731
        low, high = 2.0 * r - 1e-6, max(2.0 * r, plate)
        z = brentq(unbalanced, low, high, xtol=1e-18, rtol=1e-15) if unbalanced(high) < 0.0 else high
        forces.append(float(hertz(make, r, 2.0 * r - z)))
    return np.array(forces)


@pytest.mark.parametrize("kind", ["balls", "flakes"])
def test_rigid_plate_shares_its_load_after_hertz(make, kind):
    bodies, spots, radius = (balls(make), 1, MICRO) if kind == "balls" else (flakes(make), 7, 2e-6)
    simulation = carried(make, bodies, drag())
    assert simulation.integrator.together
    simulation.integrator.advance_to(time=simulation.settle)
    radii = radius + TALLER * np.arange(COUNT)
    force, top = (lambda gap: hertz(make, radii, 2.0 * radii - gap, spots)), 2.0 * float(np.max(radii))
    # the gap at which they carry the load together
    gap = brentq(lambda z: float(np.sum(force(z))) - LOAD, top - 1e-7, top, xtol=1e-18, rtol=1e-15)
    expected, found = force(gap), pushes(simulation)
    assert np.count_nonzero(expected) >= 3 and expected.max() > 1.5 * expected[expected > 0.0].min()
    # what is still coming down as the time for settling ends
    assert found.sum() == pytest.approx(LOAD, rel=1e-6)
    assert found == pytest.approx(expected, abs=1e-5 * LOAD)
    assert simulation.state.patches.height[-1] == pytest.approx(gap, abs=1e-13)
    for stop in np.arange(1, 9) * 2.5e-7:
        simulation.integrator.advance_to(distance=stop)
        force = make.plate_force(simulation)
        # the plate is solved to 1e-8; bodies that still tilt or roll move it, and its dashpot carries 1e-8
        assert [pushes(simulation).sum(), force[2]] == pytest.approx([LOAD, LOAD], rel=1e-6)
        assert kind == "balls" or -force[0] == pytest.approx(MU * LOAD, rel=1e-6)
    loaded = {make.label(simulation, k) for k in np.flatnonzero(pushes(simulation))}
    assert loaded == {"rolling" if kind == "balls" else "sliding"}


@supports
def test_common_plate_is_that_of_the_explicit_integrator(make, plate):
    speed, runs = 0.1, []
    motion = model.Motion(x=[model.Ramp(ramp=speed, duration=5e-7), model.ConstantVelocity(velocity=speed)])
    for kind in ("implicit", "explicit"):
        simulation = carried(make, flakes(make), motion, kind, plate)
        simulation.integrator.advance_to(time=simulation.settle)
        simulation.integrator.advance_to(distance=1.5e-7)
        force, state = make.mean_force(simulation, 5e-8), simulation.state
        runs.append((state.patches.height[-1], pushes(simulation), force, state.B[:, :3]))
    (z, push, force, place), theirs = runs
    # both end in balance, on a path that the errors of steps do not change: 1e-7 of the load, with overlaps of 20 nm
    assert z == pytest.approx(theirs[0], abs=1e-14)
    assert push == pytest.approx(theirs[1], abs=1e-7 * LOAD)
    assert force == pytest.approx(theirs[2], abs=1e-7 * LOAD)
    assert -force[0] / force[2] == pytest.approx(MU, rel=1e-6)
    # where a flake comes to slide follows from the start at 0.1 m/s: 5e-4 of a contact radius of .2 um, in some ten steps
    assert np.abs(place - theirs[3]).max() < 5e-9


def test_foundation_balances_load_and_springs(make):
    preload = 2e-4
    simulation = carried(make, balls(make), drag(), plate=SPRINGS | {"preload": preload})
    assert simulation.integrator.together
    simulation.integrator.advance_to(time=simulation.settle)
    P, found = simulation.state.P, pushes(simulation)
    springs = P[:-1, patch.SPRING] * (P[:-1, patch.HEIGHT] - P[-1, patch.HEIGHT])
    radii = MICRO + TALLER * np.arange(COUNT)
    # a patch carries its own load beside its spring
    total = LOAD + COUNT * preload
    plate = brentq(lambda z: sprung(make, radii, z, preload).sum() - total, 2.0 * MICRO - 1e-7, 2.0 * MICRO + 1e-7, xtol=1e-18)
    # dashpots still carry 3e-5 as the time for settling ends: twelve relaxation times, of which some are spent in coming down
    assert springs.sum() == pytest.approx(LOAD, rel=1e-4)
    assert found.sum() == pytest.approx(total, rel=1e-4)
    expected = sprung(make, radii, plate, preload)
    assert np.ptp(expected) > 0.05 * LOAD
    assert found == pytest.approx(expected, abs=5e-5 * LOAD)
    assert P[-1, patch.HEIGHT] == pytest.approx(plate, abs=2e-12)  # 1e-4 of the load over 6 times 48 N/mm of spring and contacts


def test_foundation_at_a_height_is_one_that_came_there(make):
    """A free plate finds its height under the load while bodies slide; held there, each with steps of its own, it is the same."""
    free = carried(make, flakes(make), drag(), plate=SPRINGS)
    free.integrator.advance_to(distance=5e-7)
    height = float(free.state.patches.height[-1])
    held = carried(make, flakes(make), drag(), plate=SPRINGS | {"load": None, "gap": height})
    assert not held.integrator.together
    held.integrator.advance_to(distance=5e-7)
    # Newton's method leaves 1e-9 of the forces of a body; the plate is solved to 1e-8
    assert pushes(held) == pytest.approx(pushes(free), abs=1e-8 * LOAD)
    assert make.plate_force(held) == pytest.approx(make.plate_force(free), abs=1e-8 * LOAD)
    # they slid on while the plate was a little lower, and with other steps: parts of the elastic way of 10 nm
    assert np.abs(free.state.B[:, :3] - held.state.B[:, :3]).max() < 5e-9


@pytest.mark.parametrize("path", [0.0, 2e-7], ids=["stick", "sliding"])
@supports
@pytest.mark.parametrize("level", ["mindlin", slow("exact")])
def test_slope_is_the_difference_quotient_of_the_push(make, plate, path, level):
    simulation = carried(make, flakes(make, 3), drag(), plate=plate, level=level)
    one = simulation.integrator
    one.advance_to(time=simulation.settle)
    one.advance_to(distance=path)  # none: it still sticks
    state = simulation.state
    poses = np.hstack((state.B[:, : body.SPIN], state.orientations))
    dt, h, context = one.plate.memory[step_memory.NEXT_DT], 1e-12, one.packed()
    velocity = common_plate.plate_velocity_of(simulation.state.time, context, dt)
    solutions = []
    for rise in (-h, 0.0, h):
        one.plate.each_island(common_plate.solve_at, True, rise, Motion(dt, *velocity))
        solutions.append(one.solutions.copy())
        one.plate.each_island(common_plate.restore_islands)
    assert all(solution[:, body_solution.SOLVED].all() for solution in solutions)
    quotient = (solutions[2][:, body_solution.PUSH] - solutions[0][:, body_solution.PUSH]) / (2.0 * h)
    assert np.all(quotient < -1e4)
    # the push is curved: a fourth of h^2 over the square of an overlap of some nm, and its rounding of 1e-9 N/m over h
    assert solutions[1][:, body_solution.SLOPE] == pytest.approx(quotient, rel=2e-5)
    moved = np.abs(np.hstack((state.B[:, : body.SPIN], state.orientations)) - poses)
    assert moved[:, :3].max() < 1e-15 and moved.max() < 1e-12, "bodies were not put back"


@supports
@pytest.mark.parametrize("level", ["mindlin", slow("coulomb"), slow("mdr"), slow("exact")])
def test_ledger_closes_under_a_common_plate(make, plate, level):
    simulation = carried(make, flakes(make, 3), drag(), plate=plate, level=level)
    ledger, state, one = Ledger(simulation.state), simulation.state, simulation.integrator
    for goal in ({"time": simulation.settle}, {"distance": 1e-6}):
        one.advance_to(**goal, watch=lambda: ledger.watch(state))
    assert ledger.relative_residual(state, ledger.lines(state)["residual"]) < CLOSED
    # long steps of a patch that is renewed book part of what it held here: it is .01 of the work at most
    assert -1e-3 < make.numerical_share(simulation) < 1e-2
    own, row = simulation.integrator.plate.totals, simulation.state.P[-1]
    assert simulation.state.P[:, patch.DISPLACEMENT] == pytest.approx(1e-6, rel=1e-9)  # of all patches, step by step
    fallen = row[patch.SEARCH_HEIGHT] - row[patch.HEIGHT]
    assert own[run_totals.PLATE_WORK] == pytest.approx(LOAD * fallen, rel=1e-9)  # the load has lost this height, step by step
    assert 0.0 < own[run_totals.DAMPING_WORK] < own[run_totals.PLATE_WORK]  # as it came down
    # backward Euler and BDF2 lose less than the kinetic energy that it had, and make none to speak of
    assert abs(own[run_totals.NUMERICAL_LOSS]) < 0.1 * own[run_totals.PLATE_WORK]


def alone(make, debris, motion, **keys):
    keys = {"friction": MU, "restitution": 0.3, "size": SIZE, "integrator": "implicit"} | keys
    return make.under_patches(debris, {"ball": make.STEEL}, 1e-4, motion, **keys)


@pytest.mark.parametrize(("speed", "step"), [(1e-3, 5e-8), (1.0, 5e-9)])
def test_without_inertia_a_ball_rolls_at_half_any_speed(make, speed, step):
    keys = {"restitution": 1.0, "patch": {"damping": 1e-9}, "settle": 2e-5, "inertia": False, "largest_step": step}
    simulation = alone(make, [make.ball(MICRO, (1e-4, 1e-4, MICRO))], drag(speed), **keys)
    simulation.integrator.advance_to(time=simulation.settle)
    simulation.integrator.advance_to(distance=5e-7)
    # no force where nothing resists; what the contacts yield at the start is T/k_t
    assert make.plate_force(simulation)[0] / 1e-4 == pytest.approx(0.0, abs=1e-3)
    assert simulation.state.bodies.position[0, 0] - 1e-4 == pytest.approx(2.5e-7, rel=1e-3)


def test_body_between_equal_plates_stays(make):
    spots = [{"side": s, "x": x, "z": z, "radius": 1.5e-6} for s, z in (("upper", 2e-6), ("lower", -2e-6)) for x in (-2e-6, 2e-6)]
    solid = {"material": "ball", "planar": True, "mass": 1e-13, "inertia": (2e-25,) * 3}
    one = model.Spots(**solid, spots=tuple(spots), positions=((1e-4, 1e-4),))
    simulation = alone(make, [one], drag(), inertia=False)
    simulation.integrator.advance_to(time=simulation.settle)
    for stop in (1e-7, 5e-7, 1e-6):
        simulation.integrator.advance_to(distance=stop)
        assert make.label(simulation) == "sliding"
        assert -make.plate_force(simulation)[0] / 1e-4 == pytest.approx(MU, rel=1e-6)
        # what holds it back is weak, but all that is left: of the drag's 1 mm/s it takes nothing
        assert np.abs(make.velocity(simulation)).max() < 1e-6 * 1e-3
    assert abs(simulation.state.bodies.position[0, 0] - 1e-4) < 1e-8  # the elastic way of its spots


@pytest.mark.parametrize("choice", ["stop", "continue"])
def test_a_body_that_cannot_be_solved(make, choice):
    simulation = alone(make, [make.clump(make.HEXAGON, 3e-5 + 4e-5 * k) for k in range(3)], drag(), on_failure=choice)
    one = simulation.integrator
    one.advance_to(time=simulation.settle)
    assert one.summary()["unsolved"] == {}
    one.memory[1, step_memory.CODE] = control.BodyStop.UNSOLVED
    if choice == "stop":
        with pytest.raises(GuardStop, match="no step of body 1 at"):
            one.advance_to(distance=1e-7)
        return
    before = one.totals.copy()
    one.advance_to(distance=5e-7)
    gone = one.totals - before
    assert gone[:, run_totals.DISTANCE] == pytest.approx([5e-7, 0.0, 5e-7], rel=1e-9)
    assert gone[1, run_totals.STEPS] == 0 and gone[[0, 2], run_totals.STEPS].min() > 0
    assert [make.label(simulation, body) for body in (0, 2)] == ["sliding", "sliding"]
    lost = one.summary()["unsolved"]
    assert list(lost) == [1]
    assert lost[1].startswith(f"stopped at t = {one.totals[1, run_totals.TIME]:.6g} s: no step of body 1 at")
    for spot in (f"sphere {k} on the {side} plate" for k in range(7) for side in ("lower", "upper")):
        assert f"{spot} with N = 1.43e-05 N" in lost[1]  # a seventh of 0.1 mN


R = 2e-6


def flying(make, one, other, speed=1.0, tolerance=5e-4):
    """Two balls without friction under one plate; each is (x, y, v_x, v_y). With 1 m/s, metres of the drag are seconds."""
    pair = [make.ball(R, (x, y, R), (v_x, v_y, 0.0)) for x, y, v_x, v_y in (one, other)]
    keys = {"settle": 1e-7, "contact": model.Contact(level="mindlin", debris_contact="auto"), "tolerance": tolerance}
    return carried(make, pair, drag(speed), plate={"load": 2e-4}, friction=0.0, **keys)


GRAZE = 1e-9  # gap, or overlap, of two balls that pass each other, m
STRAIGHT = (0.5e-4, 1e-4, 0.3, 0.0)
ACROSS = (1.9e-4, 1e-4, 0.3, 0.0)  # 15 um from the ball behind the face
LATE = (0.7e-4, 0.94e-4, 0.0, 0.3)  # it comes by 14 um of way before the other; 10 um apart at the nearest


def beside(x, gap):
    """A ball at rest at x (m) beside the way of the other."""
    return (x, 1e-4 + 2.0 * R + gap, 0.0, 0.0)


PASS = {"same place, other times": (STRAIGHT, LATE), "graze across a face": (ACROSS, beside(0.05e-4, GRAZE))}
MEET = {
    "same place, same time": (STRAIGHT, (0.6e-4, 0.9e-4, 0.0, 0.3)),
    "off centre": (STRAIGHT, beside(0.6e-4, -R)),
    "off centre across a face": (ACROSS, beside(0.05e-4, -R)),
    "off centre across a face in y": ((1e-4, 1.9e-4, 0.0, 0.3), (1e-4 + R, 0.05e-4, 0.0, 0.0)),
}


@pytest.mark.parametrize("name", ["same place, other times", "graze across a face"])
def test_balls_that_pass_each_other_go_on(make, name):
    pair = PASS[name]
    simulation = flying(make, *pair)
    simulation.integrator.advance_to(distance=1e-4)
    S, path = simulation.state.S, 0.3 * (1e-4 + 1e-7)
    # nothing holds them: they went on, past each other
    assert S[0, 0] - pair[0][0] == pytest.approx(path, rel=1e-9)
    assert S[1, 1] - pair[1][1] == pytest.approx(pair[1][3] / 0.3 * path, rel=1e-9, abs=1e-15)


@pytest.mark.parametrize("speed", [slow(1.0), 0.03])
@pytest.mark.parametrize("name", MEET)
def test_balls_that_meet_under_one_plate_rebound(make, name, speed):
    """Their approach along the line of centres is reversed, times the restitution; under a slow drag they fly far in a stride."""
    pair = MEET[name]
    simulation = flying(make, *pair, speed, tolerance=2e-6)
    before = np.array([ball[2:] for ball in pair])
    simulation.integrator.advance_to(time=6e-5)
    relative = before[0] - before[1]
    between = np.array(pair[1][:2]) - np.array(pair[0][:2])
    between -= SIZE * np.rint(between / SIZE)
    # where they touch: the root of |between - relative t| = 2 R
    square, along = relative @ relative, between @ relative
    normal = between - relative * (along - math.sqrt(along**2 - square * (between @ between - 4.0 * R**2))) / square
    normal /= 2.0 * R
    change = 0.5 * 1.3 * (relative @ normal) * normal
    found = simulation.state.B[np.argsort(simulation.state.order)][:, body.VELOCITY : body.VELOCITY + 2]
    # 2e-6 of a contact radius of .1 um a step, in some ten steps of an impact whose overlap is .6 nm
    np.testing.assert_allclose(found, [before[0] - change, before[1] + change], atol=0.01 * math.sqrt(square))
    assert simulation.integrator.summary()["islands"]["repeated"] > 0 or speed == 1.0
