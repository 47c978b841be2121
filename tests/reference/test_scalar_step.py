"""The explicit engine against a step written plainly in Python floats (`scalar_step`): every number of every table agrees to
rounding over a short run, and the engine's own bits are the same for any threads.

The two share the columns of the tables, the candidates of the search and the text of the law kernels, no more. That the
comparison can fail is shown by `test_a_fault_is_seen`: it changes one sign or one term of the plain step.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache
from typing import Any

import numba
import numpy as np
import pytest
import scalar_bodies
import scalar_contact
import scalar_laws
import scalar_plates
import scalar_step
import small_scenes
from scalar_step import Reference

from thirdbody.assembly.simulation import Simulation
from thirdbody.engine import explicit, thread_tuner
from thirdbody.engine.candidates import Candidates
from thirdbody.engine.neighbours import search
from thirdbody.engine.state import Physics
from thirdbody.jit.threads import allow_threads, allowed_threads
from thirdbody.kernels import schedule
from thirdbody.kernels.columns import body, body_extra, contact_state, orientation, patch, record, run_totals, sphere
from thirdbody.kernels.columns.tile import TILE
from thirdbody.kernels.explicit import step_loop
from thirdbody.kernels.explicit.contact_forces import GROUP
from thirdbody.kernels.explicit.passes import work
from thirdbody.kernels.rigid_body import BODIES
from thirdbody.kernels.rolling_kinematics import MOMENTS, TWIST
from thirdbody.kernels.signatures import WORK, context_of
from thirdbody.rotations import rotation_matrices

SCENES = {
    "layer": (150, 10),
    "crowd": (400, 40),
    "swarm": (200, 8),
    "springs": (16, 40),
    "foundation": (60, 24),
    "rolled": (100, 50),
    "torn": (400, 8),
}
"""About how many steps the engine goes alone, and how many with the plain step beside it: contacts then open and close."""

TOLERANCE, OF_FORCES = 1e-13, 1e-11
"""Of positions and velocities, and of all that overlaps decide, relative to the largest of their kind. A sum of some hundred
terms is rounded by 1e-15, whatever its order. A position of 60 um is rounded by 7e-21 m, which is 5e-13 of a usual overlap, and
so of forces, and happens a few times in a short run; see `test_sums_in_another_order_agree`."""

OF_HISTORY = 2.0**-15
"""Of forces of dashpots, as far as they are remembered: to one of two neighbours, whichever the rounding chooses. So the energy
that they take is only known to half of that."""

SEEN = 1e3
"""Tolerances by which a fault of the plain step changes some number at least: far above all rounding."""

MOTION = {
    "B": [*range(body.POSITION, body.FORCE)],
    "orientations": range(orientation.WIDTH),
    "E": range(body_extra.UPPER_PUSH),
    "S": range(sphere.WIDTH),
    "P": [patch.HEIGHT, patch.VELOCITY],
}
"""Columns of positions and velocities."""

OF_THE_SEARCH = {"P": (slice(None), patch.SEARCH_HEIGHT), "A": run_totals.MAX_DISPLACEMENT}
"""What only the search looks at."""

VECTORS = {
    "B": [(body.POSITION, 3), (body.VELOCITY, 3), (body.SPIN, 3), (body.FORCE, 3), (body.TORQUE, 3)],
    "orientations": [(orientation.QUATERNION, 4)],
    "E": [(body_extra.ANGULAR_MOMENTUM, 3), (body_extra.INERTIA, 3), (body_extra.EFFECT_FORCE, 3), (body_extra.EFFECT_TORQUE, 3)],
    "S": [
        (sphere.POSITION, 3),
        (sphere.MID_VELOCITY, 3),
        (sphere.MID_SPIN, 3),
        (sphere.END_VELOCITY, 3),
        (sphere.END_SPIN, 3),
        (sphere.ARM, 3),
    ],
    "A": [(run_totals.UPPER_IMPULSE, 3), (run_totals.LOWER_IMPULSE, 3), (run_totals.UPPER_FORCE, 3), (run_totals.LOWER_FORCE, 3)],
    "H": [(contact_state.AXIS, 3)],
    "R": [
        (column, 3)
        for column in (
            record.POINT,
            record.PARTNER_POINT,
            record.NORMAL,
            record.TANGENTIAL_FORCE,
            record.SURFACE_VELOCITY,
            record.PARTNER_VELOCITY,
            record.MOMENT,
        )
    ],
}
"""First columns and lengths of the vectors in the tables."""

Tables = dict[str, np.ndarray]
Spoil = Callable[[pytest.MonkeyPatch], None]
Event = tuple[int, Candidates | None]
"""Steps that the engine made at a stretch, and the candidates of the search that ended them."""


def lead(simulation: Simulation, steps: int) -> None:
    """About so many steps of the engine, as a run makes them."""
    state = simulation.state
    while int(state.A[run_totals.STEPS]) < steps:
        simulation.integrator.advance_to(time=state.time + 15.5 * state.dt)


def follow(simulation: Simulation, steps: int) -> list[Event]:
    """So many steps of the engine, all of the same length."""
    state, engine, events, left = simulation.state, simulation.integrator, [], steps
    while left > 0:
        before = int(state.A[run_totals.STEPS])
        code, _ = engine._advance(left, math.inf, math.inf, state.dt)  # type: ignore[union-attr]
        assert code in (step_loop.Stop.SEARCH, step_loop.Stop.BUDGET)
        if code == step_loop.Stop.SEARCH:
            search(state)
            engine._tables()  # type: ignore[union-attr]
        made = int(state.A[run_totals.STEPS]) - before
        events.append((made, state.slots if code == step_loop.Stop.SEARCH else None))
        left -= made
    return events


def walk(reference: Reference, events: list[Event], dt: float) -> Tables:
    """The same steps of the plain step; its tables afterwards."""
    for steps, slots in events:
        reference.advance(steps, dt)
        if slots is not None:
            reference.take(slots)
    found = {name: np.array(getattr(reference, name)) for name in "BSPAM"}
    found["B"], found["orientations"], found["E"] = np.hsplit(found["B"], [body.WIDTH, body.WIDTH + orientation.WIDTH])
    found["S"] = found["B"] if reference.aliased else found["S"]
    closed = [pair for pair in reference.pairs if reference.memory[pair][contact_state.SLIP] > 0.0]
    rows = np.array([reference.memory[pair] for pair in reference.pairs])
    return found | split(rows, reference.physics) | {"R": np.array([reference.records[pair] for pair in closed])}


def split(H: np.ndarray, physics: Physics) -> Tables:
    """The rows of H without the forces of dashpots, and these (`D`)."""
    first = contact_state.LAW + (physics.dashpots if physics.dashpots >= 0 else len(physics.history))
    last = contact_state.LAW + len(physics.history)
    forces = [[force for one in row for force in scalar_laws.unpack_triple(one)] for row in H[:, first:last]]
    return {"H": np.delete(H, range(first, last), axis=1), "D": np.array(forces)}


def tables(simulation: Simulation) -> Tables:
    """Every table that the engine's step writes: R where it is read, of closed contacts."""
    state, slots = simulation.state, simulation.state.slots
    found = {name: getattr(state, name).copy() for name in (*"BESPAM", "orientations")}
    return found | split(slots.H, state.physics) | {"R": slots.R[slots.histories.slip > 0.0]}


def differing_bits(one: Tables, other: Tables) -> set[str]:
    """Tables that differ in any bit."""
    found = set()
    for name in one:
        a, b = (np.ascontiguousarray(tables[name]).view(np.uint64) for tables in (one, other))
        assert a.shape == b.shape, name
        if not np.array_equal(a, b):
            found.add(name)
    return found


def scales(name: str, table: np.ndarray) -> np.ndarray:
    """The largest size in every column of a table; components of one vector share theirs."""
    finite = np.where(np.isfinite(table), np.abs(table), 0.0)
    scale = finite.reshape(-1, table.shape[-1]).max(axis=0, initial=0.0)
    for first, length in VECTORS.get(name, ()):
        scale[first : first + length] = scale[first : first + length].max(initial=0.0)
    return scale


def tolerances(name: str, table: np.ndarray) -> np.ndarray:
    """How far a number in every column of a table may be off."""
    relative = np.full(table.shape[-1], OF_HISTORY if name == "D" else OF_FORCES)
    if name == "A":
        relative[run_totals.DAMPING_WORK] = 0.5 * OF_HISTORY
    relative[[column for column in MOTION.get(name, ()) if column < len(relative)]] = TOLERANCE
    return relative * scales(name, table)


def departures(engine: Tables, plain: Tables) -> dict[str, float]:
    """Largest difference in each table, in tolerances; columns of the search are left out."""
    found = {}
    for name, a in engine.items():
        b = plain[name]
        assert a.shape == b.shape and a.dtype == b.dtype == np.float64, name
        with np.errstate(invalid="ignore", divide="ignore"):
            apart = np.where(a == b, 0.0, np.abs(a - b) / tolerances(name, a))
        apart[np.isnan(apart)] = math.inf
        if name in OF_THE_SEARCH:
            apart[OF_THE_SEARCH[name]] = 0.0
        found[name] = float(apart.max(initial=0.0))
    return found


@dataclass
class Pass:
    """One scene gone through by both: the engine's tables and the plain step's, what happened, and `spare` plain steps that
    stand where both began."""

    simulation: Simulation
    engine: Tables
    reference: Reference
    expected: Tables
    events: list[Event]
    spare: list[Reference]


def begun(name: str) -> Simulation:
    """A scene after the steps that the engine goes alone."""
    simulation = getattr(small_scenes, name)()
    lead(simulation, SCENES[name][0])
    if name == "torn":
        small_scenes.tear(simulation)
    return simulation


@cache
def both(name: str) -> Pass:
    """A scene, its steps by the engine on one thread and by the plain step."""
    allow_threads(1)
    simulation = begun(name)
    reference, *spare = (Reference(simulation) for _ in range(1 + sum(scene == name for scene, *_ in CHANGES)))
    events = follow(simulation, SCENES[name][1])
    engine = tables(simulation)
    return Pass(simulation, engine, reference, walk(reference, events, simulation.state.dt), events, spare)


def engine_alone(name: str) -> Tables:
    """The tables after the same steps, by the engine as it now is."""
    simulation = begun(name)
    follow(simulation, SCENES[name][1])
    return tables(simulation)


def changed(name: str, spoil: Spoil, patch: pytest.MonkeyPatch) -> dict[str, float]:
    """How many tolerances a changed plain step is off the engine; tables with other rows, as others touch, are left out."""
    found = both(name)
    spoil(patch)
    wrong = walk(found.spare.pop(), found.events, found.simulation.state.dt)
    alike = {name: values for name, values in wrong.items() if values.shape == found.engine[name].shape}
    return departures({name: found.engine[name] for name in alike}, alike)


@pytest.fixture
def two_threads(monkeypatch) -> Iterator[None]:
    """Two threads, also where there is one core."""
    before = allowed_threads()
    allow_threads(2)
    monkeypatch.setattr(thread_tuner, "STARVED", 0.0)  # on a busy machine, too,
    monkeypatch.setattr(thread_tuner, "SHORT", 0.0)  # and one thread is not tried
    yield
    allow_threads(before)


@pytest.mark.parametrize("name", SCENES)
def test_the_engine_agrees_with_the_plain_step(name):
    found = both(name)
    assert max(departures(found.engine, found.expected).values()) <= 1.0


@pytest.mark.parametrize("name", SCENES)
def test_two_threads_have_the_bits_of_one(name, two_threads):
    assert differing_bits(engine_alone(name), both(name).engine) == set()


def test_threads_may_change_during_a_run(two_threads, monkeypatch):
    """As they do where others use the cores."""
    turns = itertools.cycle((2, 1))
    monkeypatch.setattr(thread_tuner.ThreadTuner, "threads", lambda *_: next(turns))
    assert differing_bits(engine_alone("swarm"), both("swarm").engine) == set()


@pytest.mark.parametrize("name", SCENES)
def test_nothing_is_farther_from_the_last_search_than_the_engine_thinks(name):
    state = both(name).simulation.state
    turn = rotation_matrices(state.search_poses.quaternion)[state.body]
    before = state.search_poses.position[state.body] + np.einsum("nij,nj->ni", turn, state.offsets)
    gone = np.linalg.norm(state.spheres.position - before, axis=1).max()
    # a place is rounded by 1e-20 m in each of some hundred steps of more than 1e-10 m
    assert 0.0 < gone <= state.A[run_totals.MAX_DISPLACEMENT] * (1.0 + 1e-9)


def pairs_of_groups(found: Pass) -> tuple[np.ndarray, np.ndarray]:
    """The groups of both bodies of every closed contact between spheres."""
    state, slots = found.simulation.state, found.simulation.state.slots
    closed = (slots.histories.slip > 0.0) & (slots.partner >= 0)
    owner, partner = state.body[slots.own[closed]], state.body[slots.partner[closed]]
    return owner // (GROUP * BODIES), partner // (GROUP * BODIES)


def rows(found: Pass, slots: np.ndarray) -> list[np.ndarray]:
    """These slots, row by row: of every group those between spheres and plates, then those that its spheres own."""
    state = found.simulation.state
    row = 2 * (state.body[state.slots.own[slots]] // (GROUP * BODIES)) + (slots >= state.slots.n_plates)
    return [slots[row == k] for k in range(int(row.max()) + 1)]


def work_from_the_last() -> Any:
    """The engine's passes over groups, each with its parts in the opposite order."""

    @numba.njit(WORK, error_model="numpy")
    def turned_round(task, part, begin, end, step, packed):
        groups = context_of(packed).lowest.shape[0]
        work(task, part, groups - end, groups - begin, step, packed)

    return turned_round


def test_the_order_of_parts_does_not_matter(two_threads, monkeypatch):
    """Threads that wait for each other by luck only would pass the tests of two threads."""
    monkeypatch.setattr(explicit, "work", work_from_the_last())
    assert differing_bits(engine_alone("swarm"), both("swarm").engine) == set()


def test_the_scenes_are_hard_enough():
    """Contacts that open and close, searches on the way, several tiles and chunks, labels, moments, a plate of every kind."""
    layer, crowd, swarm, springs, foundation, rolled, torn = (both(name) for name in SCENES)
    assert all(found.reference.opened > 0 for found in (layer, crowd, springs, rolled))
    assert all(found.reference.closed > 0 for found in (layer, crowd, springs))
    assert len(layer.engine["R"]) > 2 * TILE
    for found in (layer, swarm):  # contacts between bodies of two groups
        hosts, remote = pairs_of_groups(found)
        assert np.count_nonzero(hosts != remote) > 10
    assert layer.simulation.state.S is layer.simulation.state.B and swarm.simulation.state.S is not swarm.simulation.state.B
    assert set(zip(hosts, remote, strict=True)) >= {(0, 1), (1, 2), (2, 3)}
    assert (
        swarm.simulation.state.n_bodies > 3 * GROUP * BODIES > step_loop.FEW * GROUP * BODIES
    )  # fewer are not shared out to threads
    assert swarm.reference.opened > 0 and swarm.reference.closed > 0
    assert any(slots is not None for found in (layer, crowd, springs, rolled) for _, slots in found.events)
    for found in (crowd, springs, rolled):  # unlike materials in one tile
        slots = found.simulation.state.slots
        closed = np.flatnonzero(slots.histories.slip > 0.0)
        tiles = [row[first : first + TILE] for row in rows(found, closed) for first in range(0, len(row), TILE)]
        assert any(len(set(slots.kind[tile])) > 1 for tile in tiles)
    assert [found.simulation.state.physics.labels for found in (layer, crowd, springs)] == [False, True, True]
    assert springs.simulation.state.slots.n_plates == springs.simulation.state.slots.count
    assert springs.simulation.state.n_bodies > BODIES and len(springs.reference.P) == springs.simulation.state.n_bodies
    assert len(foundation.reference.P) == foundation.simulation.state.n_bodies + 1
    assert foundation.reference.plan.rows[schedule.LOAD] and foundation.reference.plan.rows[schedule.Y]
    clock, settled = rolled.engine["A"][run_totals.TIME], rolled.simulation.settle  # what ends with settling ends on the way
    assert clock - SCENES["rolled"][1] * rolled.simulation.state.dt < settled < clock
    assert torn.reference.opened > 50 and torn.reference.lost > SEEN * OF_FORCES * torn.engine["A"][run_totals.FRICTION_WORK]
    assert np.any(swarm.engine["R"][:, record.MOMENT3] != 0.0) and swarm.simulation.state.physics.rolling == MOMENTS
    assert np.any(rolled.engine["R"][:, record.MOMENT3] != 0.0) and rolled.simulation.state.physics.rolling >= TWIST
    pivoting = np.abs(rolled.engine["R"][:, record.TWIST_MOMENT]), rolled.engine["R"][:, record.TWIST_LIMIT]
    assert np.any(pivoting[0] == pivoting[1]) and np.any((pivoting[0] > 0.1 * pivoting[1]) & (pivoting[0] < 0.9 * pivoting[1]))


def other_sign(patch: pytest.MonkeyPatch) -> None:
    """The torque of friction on the owner turned round."""
    right = scalar_contact.torques

    def wrong(*arguments: Any) -> Any:
        torque, back = right(*arguments)
        return (-torque[0], -torque[1], -torque[2]), back

    patch.setattr(scalar_contact, "torques", wrong)


def one_radius(patch: pytest.MonkeyPatch) -> None:
    """The same torque on both bodies, whatever their radii."""
    right = scalar_contact.torques
    patch.setattr(scalar_contact, "torques", lambda *arguments: (right(*arguments)[0],) * 2)


def no_reaction(patch: pytest.MonkeyPatch) -> None:
    """A contact does nothing to its partner where that is of another group of bodies."""
    give, push = Reference.give, Reference.push

    def wrong(reference: Reference, k: int, done: Any) -> None:
        i, j = reference.pairs[k]
        here, there = reference.body[i], reference.body[max(j, 0)]
        far = j >= 0 and here // (GROUP * BODIES) != there // (GROUP * BODIES)
        with pytest.MonkeyPatch.context() as only:
            only.setattr(Reference, "give", lambda self, b, *rest: None if far and b == there else give(self, b, *rest))
            push(reference, k, done)

    patch.setattr(Reference, "push", wrong)


def not_shared(patch: pytest.MonkeyPatch) -> None:
    """All of the friction work of a contact for both of its bodies."""
    give = Reference.give

    def wrong(reference: Reference, b: int, force: Any, torque: Any, work: float, slip: float) -> None:
        give(reference, b, force, torque, 2.0 * work, slip)

    patch.setattr(Reference, "give", wrong)


def first_chunk(_: Reference, powers: list[list[float]]) -> float:
    """The powers of the effects on the bodies of the first chunk only."""
    return sum(power for body in powers[:BODIES] for power in body)


def forgotten(S: Any, i: int, j: int, memory: list[float], *_: Any) -> tuple[float, float]:
    """A contact that opens without a loss."""
    memory[:] = [0.0] * len(memory)
    return 0.0, 0.0


def turned_round(v: Any, w: Any, r: Any) -> Any:
    """The velocity of a point as if the body turned the other way."""
    return scalar_bodies.added(v, scalar_bodies.cross(w, r), -1.0)


def untwisted(frame: Any, memory: Any, dt: float) -> None:
    """A carried axis that does not turn with the spin about the normal."""
    frame.moved = frame.moved[0], (0.0, 0.0, 0.0), frame.moved[2]
    RIGHT_CARRY(frame, memory, dt)


def unfitted(x: float, y: float, *_: float) -> tuple[float, float, tuple[float, float]]:
    """A tangential force without its dashpot."""
    return x, y, (0.0, 0.0)


def unlimited(moment: float, viscous: float, _: float) -> tuple[float, float]:
    """A moment about the normal with all of its dashpot."""
    return moment + viscous, viscous


def end_twist(*arguments: Any) -> Any:
    """Rotation about the normal of the end of the step instead of that of its middle."""
    (turn, twist), roll = RIGHT_ROLLING(*arguments)
    return (turn, twist._replace(angle=twist.rate * arguments[-1].dt)), roll


def end_normal(frame: Any, moved: Any, _: Any) -> Any:
    """Slip with the normal of the end of the step instead of that of its middle."""
    return RIGHT_SLIP(frame, moved, frame.n)


RIGHT_SLIP, RIGHT_CARRY, RIGHT_ROLLING = scalar_contact.slipping, scalar_contact.carry, scalar_contact.rolling


def instead(where: Any, name: str, wrong: Any) -> Spoil:
    """Something wrong in place of what has this name."""
    return lambda patch: patch.setattr(where, name, wrong)


FAULTS: dict[str, tuple[str, Spoil, str]] = {
    "sign of the torque of friction": ("crowd", other_sign, "BSAHR"),
    "velocity of a point": ("crowd", instead(scalar_bodies, "carried", turned_round), "BSAHR"),
    "nearest image": ("crowd", instead(scalar_contact, "image", lambda d, _: d), "BSHR"),
    "viscous part of friction": ("crowd", instead(scalar_laws, "fitted", unfitted), "BSAHR"),
    "normal of the middle of the step": ("crowd", instead(scalar_contact, "slipping", end_normal), "BSAHR"),
    "twist of a contact": ("torn", instead(scalar_contact, "carry", untwisted), "H"),
    "arm of the force": ("crowd", instead(Reference, "about", lambda _, s, torque, force: torque), "BSAHR"),
    "energy of springs that open": ("torn", instead(scalar_step, "let_go", forgotten), "BA"),
    "shares of what opens": ("torn", instead(Reference, "lose", lambda *_: None), "B"),
    "shares of friction work": ("swarm", not_shared, "B"),
    "bodies that effects act on": ("crowd", instead(Reference, "total", first_chunk), "A"),
    "load": ("crowd", instead(scalar_plates.Patches, "drift", lambda *_: None), "BSPAHR"),
    "radius of the partner": ("swarm", one_radius, "BSAHR"),
    "limit of pivoting friction": ("rolled", instead(scalar_laws, "within", unlimited), "BHR"),
    "normal of pivoting": ("rolled", instead(scalar_contact, "rolling", end_twist), "BHR"),
    "partners in other groups": ("swarm", no_reaction, "BSHR"),
}
"""Of the plain step: in which scene, what is changed, and in which tables that must be seen."""


def backwards(patch: pytest.MonkeyPatch) -> None:
    """The contacts act from the last to the first."""
    patch.setattr(Reference, "order", lambda reference: range(len(reference.pairs))[::-1])


def every_other_first(patch: pytest.MonkeyPatch) -> None:
    """Every other contact, then those between."""
    patch.setattr(Reference, "order", lambda reference: [*range(0, len(reference.pairs), 2), *range(1, len(reference.pairs), 2)])


def bodies_backwards(patch: pytest.MonkeyPatch) -> None:
    """The powers of effects from the last body to the first."""
    patch.setattr(Reference, "total", lambda _, powers: sum(power for body in powers[::-1] for power in body[::-1]))


ORDERS: dict[str, tuple[str, Spoil]] = {
    "contacts backwards": ("crowd", backwards),
    "contacts of many bodies": ("swarm", every_other_first),
    "bodies backwards": ("crowd", bodies_backwards),
}
"""Of sums in the plain step: in which scene, and how they are ordered."""

CHANGES = [*FAULTS.values(), *ORDERS.values()]


@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_is_seen(fault, monkeypatch):
    name, spoil, where = FAULTS[fault]
    apart = changed(name, spoil, monkeypatch)
    assert min(apart[table] for table in where if table in apart) >= SEEN


@pytest.mark.parametrize("order", ORDERS)
def test_sums_in_another_order_agree(order, monkeypatch):
    """Nothing is asked of the order of sums: any is right, and the tolerance is above what it changes."""
    assert max(changed(*ORDERS[order], monkeypatch).values()) <= 1.0


@pytest.mark.parametrize(
    ("seed", "speed", "level", "steps", "effects"),
    [
        (0, 0.0, "coulomb", 0, ""),
        (1, 1.0, "mindlin", 40, "pivoting = {}"),
        (2, -5.0, "mindlin", 300, ""),
        (3, 5.0, "coulomb", 300, ""),
        (5821, -0.31, "mindlin", 160, ""),
        (7, 2.5, "coulomb", 17, ""),
        (9999, -2.17, "coulomb", 230, ""),
        (48, 3.7, "mindlin", 90, "pivoting = {}"),
    ],
)
def test_any_heap_agrees_with_the_plain_step(seed, speed, level, steps, effects):
    simulation = small_scenes.heap(seed, speed, level, effects)
    lead(simulation, steps)
    reference = Reference(simulation)
    events = follow(simulation, 40)
    expected = walk(reference, events, simulation.state.dt)
    assert max(departures(tables(simulation), expected).values()) <= 1.0
