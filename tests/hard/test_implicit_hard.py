"""Hard cases of the implicit integrator: it stays finite, finds its steps, makes no energy, and labels what happens."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from thirdbody.engine.energy import Ledger
from thirdbody.kernels.columns import body, run_totals
from thirdbody.scene.model import ConstantVelocity, Effects, Motion, Pause, Ramp, Spots, Stroke

LEVELS = ("coulomb", "mindlin", "mdr", "exact")
LOAD, PLACE = 1e-4, (1e-4, 1e-4)
HEIGHT, SPAN = 4e-6, 2e-6
"""Height h of a particle of three spots and distance L of its lower spots from the middle: t_max = L/h = .5 at x_1 = 0."""


def particle(upper, lower, radius=1.5e-6):
    """A planar particle with spots of one radius at these x (m), above and below."""
    spots = [{"side": "upper", "x": x, "z": 0.5 * HEIGHT, "radius": radius} for x in upper]
    spots += [{"side": "lower", "x": x, "z": -0.5 * HEIGHT, "radius": radius} for x in lower]
    return Spots(material="ball", planar=True, mass=1e-13, inertia=(2e-25,) * 3, spots=tuple(spots), positions=(PLACE,))


def clump(make, *balls):
    """A clump of (x, y, z, radius), um, a micrometre above the plate."""
    shape = [{"center": (1e-6 * x, 1e-6 * y, 1e-6 * z), "radius": 1e-6 * r} for x, y, z, r in balls]
    return make.clump(shape, *PLACE, gap=1e-6)


def tripod(make):
    """Three balls side by side: three spots below and three above, a little flatter than wide."""
    return clump(make, (-1.9, -1.1, 0.0, 2.0), (1.9, -1.1, 0.0, 2.0), (0.0, 2.2, 0.0, 2.0))


def drag(speed=1e-3):
    return Motion(x=[ConstantVelocity(velocity=speed)])


def start(make, body, motion, **keys):
    keys = {"friction": 0.3, "restitution": 0.5, "size": 2e-4, "load": LOAD} | keys
    return make.under_patches([body], {"ball": make.STEEL}, keys.pop("load"), motion, integrator="implicit", **keys)


@dataclass(frozen=True)
class Sequence:
    """Labels, force of the plate along x over the load, and friction work (J) at the stops; sets of spots that were loaded."""

    labels: list[str]
    force: np.ndarray
    work: np.ndarray
    contacts: set[tuple[bool, ...]]


def follow(make, simulation, stops, kind="distance", load=LOAD, gained=1e-3):
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
        for table in (state.S, state.B, state.P, state.A, state.slots.H):
            assert np.all(np.isfinite(table))
    assert not simulation.integrator.summary()["unsolved"]
    # Newton's method leaves 1e-9 of the forces in a step, where laws have corners 1e-6
    assert ledger.relative_residual(state, ledger.lines(state)["residual"]) < 1e-6
    # truncation has either sign; a bad law returns 1e-2 and more
    assert make.numerical_share(simulation) > -gained
    force, work = np.array(rows).T
    return Sequence(labels, force, work, contacts)


PATH = np.arange(1, 11) * 1e-7


@pytest.mark.parametrize("level", LEVELS)
def test_symmetric_particle_slides_below_its_limit(make, level):
    """x_1 = 0, x_3 = -x_2: pressed without any slip, it slides for mu h < L."""
    simulation = start(make, particle([0.0], [-SPAN, SPAN]), drag(), level=level)
    run = follow(make, simulation, PATH)
    assert run.labels[-1] == "sliding"
    assert run.force[-1] == pytest.approx(0.3, rel=1e-4)  # what the dashpot of the patch carries
    assert simulation.state.bodies.position[0, 1] == PLACE[1]  # planar to the last bit


def test_symmetric_particle_pressed_only_does_nothing(make):
    simulation = start(make, particle([0.0], [-SPAN, SPAN]), Motion(), settle=2e-5)
    assert follow(make, simulation, [2e-5, 4e-5], "time").labels == ["sticking", "sticking"]
    # mirror images add up in opposite order: rounding
    assert abs(simulation.state.bodies.position[0, 0] - PLACE[0]) < 1e-18 + 1e-15 * PLACE[0]
    assert np.all(np.abs(simulation.state.bodies.spin[0]) < 1e-6)


@pytest.mark.parametrize("level", LEVELS)
def test_both_sides_slide_with_equal_friction(make, level):
    """Neutral: whether the body rides on one plate or the other is undecided; the force and the label are not."""
    one = particle([-SPAN, SPAN], [-SPAN, SPAN])
    simulation = start(make, one, drag(), level=level)
    run = follow(make, simulation, PATH)
    assert set(run.labels[1:]) == {"sliding"}
    assert run.force[-1] == pytest.approx(0.3, rel=1e-4)
    moved = simulation.state.bodies.position[0, 0] - PLACE[0]
    assert -1e-8 < moved < PATH[-1] + 1e-8


@pytest.mark.parametrize("change", [-1e-6, 0.0, 1e-6])
@pytest.mark.parametrize("level", ["mindlin", "exact"])
def test_exactly_at_t_max(make, level, change):
    """mu h = L: one lower spot is without load; the particle may slide or start to tip, at T/N = t_max."""
    mu = SPAN / HEIGHT * (1.0 + change)
    simulation = start(make, particle([0.0], [-SPAN, SPAN]), drag(), level=level, friction=mu)
    run = follow(make, simulation, [2.5e-8, 5e-8])
    assert set(run.labels) <= {"sliding", "rolling"}
    # once it tips, by phi = way/h = .0125 at most, the upper spot moves on by as much as phi h, against L = h/2
    assert run.force[-1] == pytest.approx(mu, rel=0.025)


@pytest.mark.parametrize("level", LEVELS)
def test_above_t_max_it_tips(make, level):
    simulation = start(make, particle([0.0], [-SPAN, SPAN]), drag(), level=level, friction=0.7)
    run = follow(make, simulation, PATH[:5])
    assert run.labels[-1] == "rolling"
    assert run.force[-1] < 0.5


@pytest.mark.parametrize("level", LEVELS)
def test_without_friction_nothing_is_dragged(make, level):
    one = tripod(make)
    simulation = start(make, one, drag(), level=level, friction=0.0)
    assert set(follow(make, simulation, PATH).labels) == {"sliding"}
    assert np.all(simulation.state.slots.records.tangential_force == 0.0)
    assert simulation.state.A[run_totals.FRICTION_WORK] == 0.0
    assert np.all(simulation.state.B[0, [body.POSITION, body.POSITION + 1]] == PLACE)


@pytest.mark.parametrize("level", LEVELS)
@pytest.mark.parametrize("mu", [1e3, 1e9])
def test_friction_without_bound(make, level, mu):
    """A flake as wide as high cannot slide at mu = 1e9: it tips or is dragged over, with finite forces."""
    body = tripod(make)
    simulation = start(make, body, drag(), level=level, friction=mu)
    run = follow(make, simulation, PATH)
    assert run.labels[-1] == "rolling" and "sliding" not in run.labels
    # it pivots about the edge of two spots, at most span over height = 5/2 times the load
    assert np.abs(run.force).max() < 2.5


@pytest.mark.parametrize("level", LEVELS)
def test_nearly_flat_clump_with_many_spots(make, level):
    """Nineteen spheres in a sheet that differ in height by parts of an overlap: many spots share the load, all slide."""
    rng = np.random.default_rng(7)
    places = [(x, y) for x in range(-2, 3) for y in range(-2, 3) if abs(x) + abs(y) < 4]
    body = clump(make, *((2.5 * x, 2.5 * y, 0.0, 2.0 + 2e-4 * rng.random()) for x, y in places))
    simulation = start(make, body, drag(), level=level, load=LOAD)
    run = follow(make, simulation, PATH)
    assert run.labels[-1] == "sliding"
    assert np.count_nonzero(make.touching(simulation)) > 20
    assert run.force[-1] == pytest.approx(0.3, rel=1e-4)


ROCKING = [(level, 5e-4, 4e-3 if level == "mindlin" else 1e-3) for level in LEVELS] + [("mindlin", 8e-6, 1e-3)]
"""Level, tolerance, and the energy that may be made over the work."""


@pytest.mark.parametrize("level, tolerance, gained", ROCKING)
def test_rocking_body_loses_and_finds_spots(make, level, tolerance, gained):
    """A dumbbell with a bump rolls over: spots leave and touch again, also within one long step.

    What `mindlin` makes is truncation: 2.0e-3, 1.3e-3, 8.6e-4, 4.8e-4, 2.6e-4 at a tolerance of 5e-4, 1.25e-4, 3e-5, 8e-6, 2e-6.
    """
    body = clump(make, (-3, 0, 0, 3), (3, 0.5, 0, 3), (0, 1, 1, 3.2))
    simulation = start(make, body, Motion(y=[ConstantVelocity(velocity=1e-3)]), level=level, friction=0.5, tolerance=tolerance)
    run = follow(make, simulation, np.arange(1, 41) * 2.5e-7, gained=gained)
    assert len(run.contacts) > 2, "no spot came or went"
    # the history of an open spot is forgotten
    open_spots = simulation.state.slots.histories.slip == 0.0
    assert np.all(simulation.state.slots.H[open_spots] == 0.0)


@pytest.mark.parametrize("load", [1e-10, 1e-8, 1e-6, 1e-2])
def test_loads_over_eight_decades(make, load):
    """From overlaps of 1e-13 m to a sixth of the radius: the same mu, and no more steps."""
    body = tripod(make)
    # a light load moves only a light patch and meets only a slow drag quasi-statically
    simulation = start(make, body, drag(1e-5), load=load)
    a = (0.75 * load * 2e-6 / 1.15e11) ** (1.0 / 3.0)
    run = follow(make, simulation, np.arange(1, 6) * 20.0 * a, load=load)
    assert run.labels[-1] == "sliding"
    assert run.force[-1] == pytest.approx(0.3, rel=1e-3)
    assert simulation.integrator.summary()["steps"] < 2000


@pytest.mark.parametrize("shape", ["sine", "triangle"])
@pytest.mark.parametrize("level", LEVELS)
def test_reversals_of_a_stroke(make, level, shape):
    """Three cycles: sliding in between, sticking just after each turn, the same loop each time."""
    frequency, stroke = 10.0, 4e-7
    motion = Motion(x=[Stroke(stroke=stroke, frequency=frequency, shape=shape)])
    body = tripod(make)
    simulation = start(make, body, motion, level=level)
    stops = (np.arange(1, 121) / 40.0) / frequency
    run = follow(make, simulation, stops, "time")
    forces, labels = run.force, run.labels[80:]
    assert np.abs(forces).max() == pytest.approx(0.3, rel=1e-3)
    assert forces[15] > 0.299 and forces[35] < -0.299
    # the second cycle repeats the first from its first turn on
    assert forces[62:78] == pytest.approx(forces[22:38], abs=3e-3)
    assert labels[15] == "sliding" and labels[35] == "sliding"


@pytest.mark.parametrize("level", LEVELS)
def test_pause_leaves_a_body_sticking(make, level):
    """Dragged, then at rest: T stays below its limit and nothing slips any more."""
    motion = Motion(x=[Stroke(stroke=4e-7, frequency=10.0, cycles=0.25), Pause(pause=0.1)])
    body = tripod(make)
    simulation = start(make, body, motion, level=level, duration=0.1)
    run = follow(make, simulation, [0.025, 0.05, 0.1], "time")
    assert run.labels[1:] == ["sticking", "sticking"]
    assert np.all(np.diff(run.work) < 1e-3 * run.work[0])


def test_weight_and_drag_act_while_nothing_else_does(make):
    """Gravity of a tenth of the load: the lower side carries both, the upper the load, and the upper slides."""
    gravity = (0.0, 0.0, -0.1 * LOAD / 1e-13)
    one = particle([-SPAN, SPAN], [-SPAN, SPAN])
    simulation = start(make, one, drag(), effects=Effects(gravity=gravity))
    assert follow(make, simulation, PATH).labels[-1] == "sliding"
    A = simulation.state.A
    assert abs(A[run_totals.LOWER_FORCE + 2] / A[run_totals.UPPER_FORCE + 2]) == pytest.approx(1.1, rel=1e-4)
    assert abs(A[run_totals.UPPER_FORCE] / A[run_totals.UPPER_FORCE + 2]) == pytest.approx(0.3, rel=1e-6)
    assert simulation.state.bodies.position[0, 0] - PLACE[0] < 1e-8  # it stays with the lower plate


@pytest.mark.parametrize("tolerance, gained", [(5e-4, 5e-3), (3e-5, 1e-3)])
def test_a_fast_drag_makes_no_energy(make, tolerance, gained):
    """A clump that is pressed, dragged at 1 m/s and tips: inertia decides, and the plate's work is a trapezoid in long steps.

    What is made is truncation: up to 5e-3 on the way, or 2e-3 at the end, at the default tolerance; 3e-4 at 3e-5.
    """
    motion = Motion(x=[Ramp(ramp=1.0, duration=5e-7), ConstantVelocity(velocity=1.0)])
    simulation = start(make, make.clump(make.LUMP), motion, restitution=0.3, tolerance=tolerance)
    follow(make, simulation, 2.0 * PATH, gained=gained)
