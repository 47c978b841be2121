"""Hard cases of the implicit integrator at slow drags: it finds its steps, makes no energy, and labels what happens."""

from dataclasses import dataclass

import numpy as np
import pytest
from hard.between_plates import HEIGHT, SPAN, particle
from hard.trial import TRIPOD
from slow import slow
from theory import builders as make
from thirdbody.engine.guards import Ledger
from thirdbody.kernels.tables import run_totals
from thirdbody.scene.model import ConstantVelocity, Effects, Motion, Pause, Ramp, Stroke

LEVELS = ("mindlin", slow("coulomb"), slow("mdr"), slow("exact"))
LOAD, PLACE = 1e-4, (1e-4, 1e-4)


def clump(*balls):
    """A clump of (x, y, z, radius), um, a micrometre above the plate."""
    shape = [{"center": (1e-6 * x, 1e-6 * y, 1e-6 * z), "radius": 1e-6 * r} for x, y, z, r in balls]
    return make.clump(shape, *PLACE, gap=1e-6)


def sheet():
    """Nineteen spheres that differ in height by parts of an overlap: many spots share the load."""
    rng = np.random.default_rng(7)
    places = [(x, y) for x in range(-2, 3) for y in range(-2, 3) if abs(x) + abs(y) < 4]
    return clump(*((2.5 * x, 2.5 * y, 0.0, 2.0 + 2e-4 * rng.random()) for x, y in places))


def drag(speed=1e-3):
    return Motion(x=[ConstantVelocity(velocity=speed)])


THREE, FOUR = particle([0.0], [-SPAN, SPAN]), particle([-SPAN, SPAN], [-SPAN, SPAN])
FLAT = clump(*TRIPOD)


def start(one, motion, **keys):
    keys = {"friction": 0.3, "restitution": 0.5, "size": 2e-4, "load": LOAD} | keys
    return make.under_patches([one], {"ball": make.STEEL}, keys.pop("load"), motion, integrator="implicit", **keys)


@dataclass(frozen=True)
class Sequence:
    """Labels, force of the plate along x over the load, and friction work (J) at the stops; sets of spots that were loaded."""

    labels: list[str]
    force: np.ndarray
    work: np.ndarray
    contacts: set[tuple[bool, ...]]


def follow(simulation, stops, kind="distance", load=LOAD, gained=1e-3):
    """The course of a run over its stops (m of drag, or s after settling), after the checks that every run must pass."""
    ledger, state = Ledger(simulation.state), simulation.state
    simulation.integrator.advance_to(time=simulation.settle, watch=lambda: ledger.watch(state))
    labels, rows, contacts = [], [], set()
    for stop in stops:
        target = {"distance": stop} if kind == "distance" else {"time": simulation.settle + stop}
        simulation.integrator.advance_to(**target, watch=lambda: ledger.watch(state))
        labels.append(make.label(simulation))
        rows.append((-state.A[run_totals.UPPER_FORCE] / load, state.A[run_totals.FRICTION_WORK]))
        contacts.add(tuple(make.touching(simulation)))
        assert all(np.all(np.isfinite(table)) for table in (state.S, state.B, state.P, state.A, state.slots.H))
    assert not simulation.integrator.summary()["unsolved"]
    # Newton's method leaves 1e-9 of the forces in a step, where laws have corners 1e-6
    assert ledger.relative_residual(state, ledger.lines(state)["residual"]) < 1e-6
    # truncation has either sign; a bad law returns 1e-2 and more
    assert make.numerical_share(simulation) > -gained
    force, work = np.array(rows).T
    return Sequence(labels, force, work, contacts)


PATH = np.arange(1, 11) * 1e-7


@pytest.mark.parametrize("level", LEVELS)
def test_many_spots_slide_together_and_friction_above_the_lever_arm_tips_a_body(level):
    simulation = start(sheet(), drag(), level=level)
    run = follow(simulation, PATH)
    assert run.labels[-1] == "sliding" and np.count_nonzero(make.touching(simulation)) > 20
    assert run.force[-1] == pytest.approx(0.3, rel=1e-4)  # the dashpot of the patch carries the rest
    simulation = start(THREE, drag(), level=level, friction=0.7)
    run = follow(simulation, PATH[:5])
    assert run.labels[-1] == "rolling" and run.force[-1] < SPAN / HEIGHT
    assert simulation.state.bodies.position[0, 1] == PLACE[1]  # planar to the last bit


ROCKING = [("mindlin", 5e-4, 4e-3), slow("coulomb", 5e-4, 1e-3), slow("mdr", 5e-4, 1e-3), slow("exact", 5e-4, 1e-3),
           slow("mindlin", 8e-6, 1e-3)]  # fmt: skip
"""Level, tolerance, and the energy that may be made over the work."""


@pytest.mark.parametrize("level, tolerance, gained", ROCKING)
def test_rocking_body_loses_and_finds_spots(level, tolerance, gained):
    """A dumbbell with a bump rolls over: spots leave and touch again, also within one long step. What `mindlin` makes is
    truncation: 2.0e-3, 1.3e-3, 8.6e-4, 4.8e-4, 2.6e-4 at a tolerance of 5e-4, 1.25e-4, 3e-5, 8e-6, 2e-6."""
    dumbbell, motion = clump((-3, 0, 0, 3), (3, 0.5, 0, 3), (0, 1, 1, 3.2)), Motion(y=[ConstantVelocity(velocity=1e-3)])
    simulation = start(dumbbell, motion, level=level, friction=0.5, tolerance=tolerance)
    assert len(follow(simulation, np.arange(1, 41) * 2.5e-7, gained=gained).contacts) > 2, "no spot came or went"
    # the history of an open spot is forgotten
    assert np.all(simulation.state.slots.H[simulation.state.slots.histories.slip == 0.0] == 0.0)


@pytest.mark.parametrize("load", [1e-10, slow(1e-8), slow(1e-6), 1e-2])
def test_loads_over_eight_decades(load):
    """From overlaps of 1e-13 m to a sixth of the radius: the same mu, and no more steps."""
    # a light load moves only a light patch and meets only a slow drag quasi-statically
    simulation = start(FLAT, drag(1e-5), load=load)
    a = (0.75 * load * 2e-6 / 1.15e11) ** (1.0 / 3.0)
    run = follow(simulation, np.arange(1, 6) * 20.0 * a, load=load)
    assert run.labels[-1] == "sliding" and run.force[-1] == pytest.approx(0.3, rel=1e-3)
    assert simulation.integrator.summary()["steps"] < 2000


@pytest.mark.parametrize("shape", ["sine", "triangle"])
@pytest.mark.parametrize("level", LEVELS)
def test_reversals_of_a_stroke(level, shape):
    frequency = 10.0
    simulation = start(FLAT, Motion(x=[Stroke(stroke=4e-7, frequency=frequency, shape=shape)]), level=level)
    run = follow(simulation, (np.arange(1, 121) / 40.0) / frequency, "time")
    forces, labels = run.force, run.labels[80:]
    assert np.abs(forces).max() == pytest.approx(0.3, rel=1e-3)
    assert forces[15] > 0.299 and forces[35] < -0.299
    # the second cycle repeats the first from its first turn on
    assert forces[62:78] == pytest.approx(forces[22:38], abs=3e-3)
    assert labels[15] == "sliding" and labels[35] == "sliding"


@pytest.mark.parametrize("level", LEVELS)
def test_pause_leaves_a_body_sticking(level):
    motion = Motion(x=[Stroke(stroke=4e-7, frequency=10.0, cycles=0.25), Pause(pause=0.1)])
    run = follow(start(FLAT, motion, level=level, duration=0.1), [0.025, 0.05, 0.1], "time")
    assert run.labels[1:] == ["sticking", "sticking"]
    assert np.all(np.diff(run.work) < 1e-3 * run.work[0])


def test_weight_and_drag_act_while_nothing_else_does():
    """Gravity of a tenth of the load: the lower side carries both, the upper the load, and the upper slides."""
    simulation = start(FOUR, drag(), effects=Effects(gravity=(0.0, 0.0, -0.1 * LOAD / 1e-13)))
    assert follow(simulation, PATH).labels[-1] == "sliding"
    A = simulation.state.A
    assert abs(A[run_totals.LOWER_FORCE + 2] / A[run_totals.UPPER_FORCE + 2]) == pytest.approx(1.1, rel=1e-4)
    assert abs(A[run_totals.UPPER_FORCE] / A[run_totals.UPPER_FORCE + 2]) == pytest.approx(0.3, rel=1e-6)
    assert simulation.state.bodies.position[0, 0] - PLACE[0] < 1e-8  # it stays with the lower plate


@pytest.mark.parametrize("tolerance, gained", [(5e-4, 5e-3), (3e-5, 1e-3)])
def test_a_fast_drag_makes_no_energy(tolerance, gained):
    """A clump that is pressed, dragged at 1 m/s and tips: inertia decides, and the plate's work is a trapezoid in long steps.
    What is made is truncation: up to 5e-3 on the way, or 2e-3 at the end, at the default tolerance; 3e-4 at 3e-5."""
    motion = Motion(x=[Ramp(ramp=1.0, duration=5e-7), ConstantVelocity(velocity=1.0)])
    simulation = start(make.clump(make.LUMP), motion, restitution=0.3, tolerance=tolerance)
    follow(simulation, 2.0 * PATH, gained=gained)
