"""The explicit engine against a step written plainly in Python floats (`scalar_step`): every bit of every table is the same.

The two share the columns of the tables, the candidates of the search and the text of the law kernels, no more. That the
comparison can fail is shown by `test_a_fault_is_seen`: it changes one sign, one term or one order of summation of the plain step.
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
from hypothesis import Phase, given, settings
from hypothesis import strategies as st
from scalar_step import Reference

from thirdbody.engine import explicit, pace
from thirdbody.engine.neighbours import search
from thirdbody.engine.state import Slots, rotation_matrices
from thirdbody.kernels import layout as at
from thirdbody.kernels import motion, step
from thirdbody.kernels.bodies import BODIES
from thirdbody.kernels.contacts import GROUP
from thirdbody.kernels.context import known
from thirdbody.kernels.rolling import MOMENTS
from thirdbody.kernels.signatures import KINDS, WORK, Context
from thirdbody.kernels.work import work
from thirdbody.scene.build import Simulation

SCENES = {
    "layer": (150, 10),
    "crowd": (400, 40),
    "swarm": (200, 8),
    "springs": (16, 40),
    "foundation": (60, 24),
    "rolled": (100, 50),
}
"""About how many steps the engine goes alone, and how many with the plain step beside it: contacts then open and close."""

OF_THE_SEARCH = {"P": (slice(None), at.P_Z0), "A": at.A_FAR}
"""What only the search looks at."""

Tables = dict[str, np.ndarray]
Event = tuple[int, Slots | None]
"""Steps that the engine made at a stretch, and the candidates of the search that ended them."""


def lead(simulation: Simulation, steps: int) -> None:
    """About so many steps of the engine, as a run makes them."""
    state = simulation.state
    while int(state.A[at.A_STEPS]) < steps:
        simulation.integrator.advance_to(time=state.time + 15.5 * state.dt)


def follow(simulation: Simulation, steps: int) -> list[Event]:
    """So many steps of the engine, all of the same length."""
    state, engine, events, left = simulation.state, simulation.integrator, [], steps
    while left > 0:
        before = int(state.A[at.A_STEPS])
        code, _ = engine._advance(left, math.inf, math.inf, state.dt)  # type: ignore[union-attr]
        assert code in (step.SEARCH, step.BUDGET)
        if code == step.SEARCH:
            search(state)
            engine._tables()  # type: ignore[union-attr]
        made = int(state.A[at.A_STEPS]) - before
        events.append((made, state.slots if code == step.SEARCH else None))
        left -= made
    return events


def walk(reference: Reference, events: list[Event], dt: float) -> Tables:
    """The same steps of the plain step; its tables afterwards."""
    for steps, slots in events:
        reference.advance(steps, dt)
        if slots is not None:
            reference.take(slots)
    found = {name: np.array(getattr(reference, name)) for name in "BSPAM"}
    found["B"], found["E"] = np.hsplit(found["B"], [at.B_COLS])
    found["S"] = found["S"][:, : at.B_COLS]  # where bodies and spheres are one table
    closed = [pair for pair in reference.pairs if reference.memory[pair][at.H_ON] > 0.0]
    return found | {
        "H": np.array([reference.memory[pair] for pair in reference.pairs]),
        "R": np.array([reference.records[pair] for pair in closed]),
    }


def tables(simulation: Simulation) -> Tables:
    """Every table that the engine's step writes: R where it is read, of closed contacts."""
    state, slots = simulation.state, simulation.state.slots
    found = {name: getattr(state, name).copy() for name in "BESPAM"}
    return found | {"H": slots.H.copy(), "R": slots.R[slots.H[:, at.H_ON] > 0.0]}


def differences(one: Tables, other: Tables) -> dict[str, str]:
    """Where two sets of tables differ in any bit, by table: row, column and values of the first number, and how many more."""
    found = {}
    for name in one:
        a, b = one[name], other[name]
        assert a.shape == b.shape and a.dtype == b.dtype == np.float64, name
        unlike = np.ascontiguousarray(a).view(np.uint64) != np.ascontiguousarray(b).view(np.uint64)
        if name in OF_THE_SEARCH:
            unlike[OF_THE_SEARCH[name]] = False
        if unlike.any():
            first = tuple(int(k[0]) for k in np.nonzero(unlike))
            found[name] = f"{first}: {a[first]!r} or {b[first]!r}, and {unlike.sum() - 1} more"
    return found


@dataclass
class Pass:
    """One scene gone through by both: the tables before (`spare` plain steps that stand there) and after, and what happened."""

    simulation: Simulation
    engine: Tables
    reference: Reference
    expected: Tables
    events: list[Event]
    spare: list[Reference]


@cache
def both(name: str) -> Pass:
    """A scene, its steps by the engine on one thread and by the plain step."""
    numba.set_num_threads(1)
    simulation = getattr(small_scenes, name)()
    before, steps = SCENES[name]
    lead(simulation, before)
    faults = sum(scene == name for scene, *_ in FAULTS.values())
    reference, *spare = (Reference(simulation) for _ in range(1 + faults))
    events = follow(simulation, steps)
    engine = tables(simulation)
    return Pass(simulation, engine, reference, walk(reference, events, simulation.state.dt), events, spare)


@pytest.fixture
def two_threads(monkeypatch) -> Iterator[None]:
    """Two threads; where there is one core the work is cut as for two all the same, and one thread does all parts."""
    before = numba.get_num_threads()
    numba.set_num_threads(min(2, numba.config.NUMBA_NUM_THREADS))  # type: ignore[attr-defined]
    monkeypatch.setattr(numba, "get_num_threads", lambda: 2)
    monkeypatch.setattr(pace, "STARVED", 0.0)  # on a busy machine, too,
    monkeypatch.setattr(pace, "SHORT", 0.0)  # and one thread is not tried
    yield
    numba.set_num_threads(before)


@pytest.mark.parametrize("name", SCENES)
def test_the_engine_has_the_bits_of_the_plain_step(name):
    found = both(name)
    assert differences(found.engine, found.expected) == {}


@pytest.mark.parametrize("name", SCENES)
def test_two_threads_have_the_bits_of_the_plain_step(name, two_threads):
    simulation = getattr(small_scenes, name)()
    before, steps = SCENES[name]
    lead(simulation, before)
    follow(simulation, steps)
    assert differences(tables(simulation), both(name).expected) == {}


def test_threads_may_change_on_the_way(two_threads, monkeypatch):
    """As they do where others use the cores."""
    turns = itertools.cycle((2, 1))
    monkeypatch.setattr(pace.Pace, "threads", lambda *_: next(turns))
    simulation = small_scenes.swarm()
    before, steps = SCENES["swarm"]
    lead(simulation, before)
    follow(simulation, steps)
    assert differences(tables(simulation), both("swarm").expected) == {}


@pytest.mark.parametrize("name", SCENES)
def test_nothing_is_farther_from_the_last_search_than_the_engine_thinks(name):
    state = both(name).simulation.state
    turn = rotation_matrices(state.X0[:, at.X_Q : at.X_Q + 4])[state.body]
    before = state.X0[state.body, at.X_X : at.X_X + 3] + np.einsum("nij,nj->ni", turn, state.offsets)
    gone = np.linalg.norm(state.S[:, at.S_X : at.S_X + 3] - before, axis=1).max()
    # a place is rounded by 1e-20 m in each of some hundred steps of more than 1e-10 m
    assert 0.0 < gone <= state.A[at.A_FAR] * (1.0 + 1e-9)


def pairs_of_groups(found: Pass) -> tuple[np.ndarray, np.ndarray]:
    """The groups of both bodies of every closed contact between spheres."""
    state, slots = found.simulation.state, found.simulation.state.slots
    closed = (slots.H[:, at.H_ON] > 0.0) & (slots.partner >= 0)
    owner, partner = state.body[slots.own[closed]], state.body[slots.partner[closed]]
    return owner // (GROUP * BODIES), partner // (GROUP * BODIES)


def work_from_the_last() -> Any:
    """The engine's passes over groups, each with its parts in the opposite order."""
    context_of = known(KINDS, Context)

    @numba.njit(WORK, error_model="numpy")
    def turned_round(task, part, begin, end, number, record, time, v_x, v_y, dt, left, context):
        groups = context_of(context).lowest.shape[0]
        work(task, part, groups - end, groups - begin, number, record, time, v_x, v_y, dt, left, context)

    return turned_round


def test_the_order_of_parts_does_not_matter(two_threads, monkeypatch):
    """Threads that wait for each other by luck only would pass the tests of two threads."""
    monkeypatch.setattr(explicit, "work", work_from_the_last())
    simulation = small_scenes.swarm()
    before, steps = SCENES["swarm"]
    lead(simulation, before)
    follow(simulation, steps)
    assert differences(tables(simulation), both("swarm").expected) == {}


def test_the_scenes_are_hard_enough():
    """Contacts that open and close, searches on the way, several tiles and chunks, labels, moments, a plate of every kind."""
    layer, crowd, swarm, springs, foundation, rolled = (both(name) for name in SCENES)
    assert all(found.reference.opened > 0 for found in (layer, crowd, springs, rolled))
    assert all(found.reference.closed > 0 for found in (layer, crowd, springs))
    assert len(layer.engine["R"]) > 2 * at.TILE
    for found in (layer, swarm):  # contacts between bodies of two groups
        hosts, guests = pairs_of_groups(found)
        assert np.count_nonzero(hosts != guests) > 10
    assert layer.simulation.state.S is layer.simulation.state.B and swarm.simulation.state.S is not swarm.simulation.state.B
    assert set(zip(hosts, guests, strict=True)) >= {(0, 1), (1, 2), (2, 3)}
    assert swarm.simulation.state.n_bodies > 3 * GROUP * BODIES > step.FEW * GROUP * BODIES  # fewer are not shared out to threads
    assert swarm.reference.opened > 0 and swarm.reference.closed > 0
    assert any(slots is not None for found in (layer, crowd, springs, rolled) for _, slots in found.events)
    for found in (crowd, springs, rolled):  # unlike materials in one tile
        slots = found.simulation.state.slots
        closed = [[k for k in row if slots.H[k, at.H_ON] > 0.0] for row in found.reference.rows()]
        tiles = [row[first : first + at.TILE] for row in closed for first in range(0, len(row), at.TILE)]
        assert any(len(set(slots.kind[tile])) > 1 for tile in tiles)
    assert [found.simulation.state.physics.labels for found in (layer, crowd, springs)] == [False, True, True]
    assert springs.simulation.state.slots.n_plates == springs.simulation.state.slots.count
    assert springs.simulation.state.n_bodies > BODIES and len(springs.reference.P) == springs.simulation.state.n_bodies
    assert len(foundation.reference.P) == foundation.simulation.state.n_bodies + 1
    assert foundation.reference.plan.rows[motion.LOAD] and foundation.reference.plan.rows[motion.Y]
    clock, settled = rolled.engine["A"][at.A_TIME], rolled.simulation.settle  # what ends with settling ends on the way
    assert clock - SCENES["rolled"][1] * rolled.simulation.state.dt < settled < clock
    assert np.any(rolled.engine["R"][:, at.R_M : at.R_M + 3] != 0.0) and rolled.simulation.state.physics.rolling == MOMENTS


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


def at_once(patch: pytest.MonkeyPatch) -> None:
    """Bodies of other groups get their share with the contact, not behind those of their own group."""
    right = Reference.push

    def wrong(reference: Reference, k: int, done: Any) -> list[Any]:
        for push in right(reference, k, done):
            reference.give(*push[1:])
        return []

    patch.setattr(Reference, "push", wrong)


def backwards(patch: pytest.MonkeyPatch) -> None:
    """The contacts of every group from the last to the first."""
    right = Reference.rows
    patch.setattr(Reference, "rows", lambda reference: [slots[::-1] for slots in right(reference)])


def spheres_first(patch: pytest.MonkeyPatch) -> None:
    """In every group the contacts between spheres before those with plates."""
    right = Reference.rows
    patch.setattr(Reference, "rows", lambda reference: [right(reference)[row ^ 1] for row in range(len(right(reference)))])


def not_shared(patch: pytest.MonkeyPatch) -> None:
    """All of the friction work of a contact for both of its bodies."""
    give = Reference.give

    def wrong(reference: Reference, b: int, force: Any, torque: Any, work: float, slip: float) -> None:
        give(reference, b, force, torque, 2.0 * work, slip)

    patch.setattr(Reference, "give", wrong)


def forgotten(memory: list[float]) -> float:
    """A contact that opens without a loss."""
    memory[at.H_STORED] = 0.0
    return scalar_contact.let_go(memory)


def term_by_term(v: Any, w: Any, r: Any) -> Any:
    """The velocity of a point as (v + one product) - the other."""
    return v[0] + w[1] * r[2] - w[2] * r[1], v[1] + w[2] * r[0] - w[0] * r[2], v[2] + w[0] * r[1] - w[1] * r[0]


def from_the_right(a: Any, b: Any) -> float:
    """The scalar product summed from its last term."""
    return a[2] * b[2] + a[1] * b[1] + a[0] * b[0]


def unfitted(x: float, y: float, *_: float) -> tuple[float, float, float]:
    """A tangential force without its dashpot."""
    return x, y, 0.0


def end_normal(frame: Any, moved: Any, _: Any) -> Any:
    """Slip with the normal of the end of the step instead of that of its middle."""
    return RIGHT_SLIP(frame, moved, frame.n)


RIGHT_SLIP = scalar_contact.slipping

Spoil = Callable[[pytest.MonkeyPatch], None]


def instead(where: Any, name: str, wrong: Any) -> Spoil:
    """Something wrong in place of what has this name."""
    return lambda patch: patch.setattr(where, name, wrong)


FAULTS: dict[str, tuple[str, Spoil, str]] = {
    "sign of the torque of friction": ("crowd", other_sign, "BSAHR"),
    "order within a scalar product": ("crowd", instead(scalar_bodies, "dot", from_the_right), "BSHR"),
    "velocity of a point": ("crowd", instead(scalar_bodies, "carried", term_by_term), "BSHR"),
    "nearest image": ("crowd", instead(scalar_contact, "image", lambda d, _: d), "BSHR"),
    "viscous part of friction": ("crowd", instead(scalar_laws, "fitted", unfitted), "BSAHR"),
    "normal of the middle of the step": ("crowd", instead(scalar_contact, "slipping", end_normal), "BSAHR"),
    "arm of the force": ("crowd", instead(Reference, "about", lambda _, s, torque, force: torque), "BSAHR"),
    "energy of springs that open": ("rolled", instead(scalar_step, "let_go", forgotten), "B"),
    "order of contacts": ("crowd", backwards, "BSAHR"),
    "plates before spheres": ("crowd", spheres_first, "BSAHR"),
    "shares of friction work": ("swarm", not_shared, "B"),
    "shares of what opens": ("rolled", instead(Reference, "lose", lambda *_: []), "B"),
    "bodies that are summed together": ("crowd", instead(scalar_step, "BODIES", BODIES // 2), "A"),
    "load": ("crowd", instead(scalar_plates.Patches, "drift", lambda *_: None), "BSPAHR"),
    "radius of the partner": ("swarm", one_radius, "BSAHR"),
    "bodies of one group": ("swarm", instead(scalar_step, "GROUP", GROUP // 2), "BSAHR"),
    "partners in other groups": ("swarm", at_once, "BSHR"),
}
"""Of the plain step: in which scene, what is changed, and in which tables that must be seen."""


@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_is_seen(fault, monkeypatch):
    name, spoil, where = FAULTS[fault]
    found = both(name)
    spoil(monkeypatch)
    wrong = walk(found.spare.pop(), found.events, found.simulation.state.dt)
    wrong = {name: values for name, values in wrong.items() if values.shape == found.engine[name].shape}  # others may touch
    assert set(differences({name: found.engine[name] for name in wrong}, wrong)) >= set(where) & set(wrong)


@settings(max_examples=8, deadline=None, derandomize=True, phases=[Phase.generate])  # a smaller scene would tell no more
@given(
    seed=st.integers(0, 10_000),
    speed=st.floats(-5.0, 5.0).map(lambda v: round(v, 2)),
    level=st.sampled_from(["coulomb", "mindlin"]),
    steps=st.integers(0, 300),
)
def test_any_heap_has_the_bits_of_the_plain_step(seed, speed, level, steps):
    simulation = small_scenes.heap(seed, speed, level)
    lead(simulation, steps)
    reference = Reference(simulation)
    events = follow(simulation, 40)
    assert differences(tables(simulation), walk(reference, events, simulation.state.dt)) == {}
