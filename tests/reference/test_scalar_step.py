"""The explicit engine against a step written plainly in Python floats (`scalar_step`): every number of every table agrees to
rounding over a short run, and the engine's own bits are the same for any threads.

The two share the columns of the tables, the candidates of the search and the text of the law kernels, no more. That the
comparison can fail is shown by `test_a_fault_is_seen`: it changes one sign or one term of the plain step."""

import itertools
import math
from collections import namedtuple
from functools import cache

import numba
import numpy as np
import pytest
import scalar_bodies
import scalar_contact
import scalar_laws
import scalar_step
import small_scenes
from scalar_step import Reference
from thirdbody.engine import explicit
from thirdbody.engine.neighbours import search
from thirdbody.jit import threads as jit_threads
from thirdbody.jit.threads import allow_threads, allowed_threads
from thirdbody.kernels import schedule
from thirdbody.kernels.arguments import RUN_GROUPS, context_of
from thirdbody.kernels.bodies import BODIES
from thirdbody.kernels.explicit import step_loop
from thirdbody.kernels.explicit.contact_forces import GROUP
from thirdbody.kernels.explicit.passes import run_groups
from thirdbody.kernels.rolling_kinematics import MOMENTS, TWIST
from thirdbody.kernels.tables import body, body_extra, contact_state, orientation, patch, record, run_totals, sphere
from thirdbody.kernels.tile import TILE
from thirdbody.rotations import matrix_from_quaternion

SLOW = pytest.mark.full(kind="slow")
SCENES = {
    "crowd": (400, 40), "torn": (400, 8), "layer": (150, 6), "foundation": (60, 24), "rolled": (100, 50), "swarm": (200, 8),
    "springs": (16, 40),
}  # fmt: skip
"""About how many steps the engine goes alone, and how many with the plain step beside it: contacts then open and close."""
scenes = pytest.mark.parametrize(
    "name", [pytest.param(name, marks=SLOW) if name in ("swarm", "springs") else name for name in SCENES]
)
TOLERANCE, OF_FORCES = 1e-13, 1e-11
"""Of positions and velocities, and of all that overlaps decide, relative to the largest of their kind. A sum of some hundred
terms is rounded by 1e-15, whatever its order. A position of 60 um is rounded by 7e-21 m, which is 5e-13 of a usual overlap, and
so of forces, and happens a few times in a short run; see `test_sums_in_another_order_agree`."""
OF_HISTORY = 2.0**-15
"""Of forces of dashpots, as far as they are remembered: to one of two neighbours, whichever the rounding chooses. So the energy
that they take is only known to half of that."""
SEEN = 1e3  # tolerances by which a fault of the plain step changes some number at least: far above all rounding
MOTION = {
    "B": [*range(body.POSITION, body.FORCE)], "orientations": range(orientation.WIDTH), "E": range(body_extra.UPPER_PUSH),
    "S": range(sphere.WIDTH), "P": [patch.HEIGHT, patch.VELOCITY],
}  # fmt: skip
"""Columns of positions and velocities."""
OF_THE_SEARCH = {"P": (slice(None), patch.SEARCH_HEIGHT), "A": run_totals.MAX_DISPLACEMENT}  # what only the search looks at
VECTORS = {
    "B": (body.POSITION, body.VELOCITY, body.SPIN, body.FORCE, body.TORQUE),
    "E": (body_extra.ANGULAR_MOMENTUM, body_extra.INERTIA, body_extra.EFFECT_FORCE, body_extra.EFFECT_TORQUE),
    "S": (sphere.POSITION, sphere.MID_VELOCITY, sphere.MID_SPIN, sphere.END_VELOCITY, sphere.END_SPIN, sphere.ARM),
    "A": (run_totals.UPPER_IMPULSE, run_totals.LOWER_IMPULSE, run_totals.UPPER_FORCE, run_totals.LOWER_FORCE),
    "H": (contact_state.AXIS,),
    "R": (record.POINT, record.PARTNER_POINT, record.NORMAL, record.TANGENTIAL_FORCE, record.SURFACE_VELOCITY,
          record.PARTNER_VELOCITY, record.MOMENT),
}  # fmt: skip
"""First columns of the vectors in the tables; an orientation has four components."""


def lead(simulation, steps):
    state = simulation.state
    while int(state.A[run_totals.STEPS]) < steps:
        simulation.integrator.advance_to(time=state.time + 15.5 * state.dt)


def follow(simulation, steps):
    state, engine, events, left = simulation.state, simulation.integrator, [], steps
    while left > 0:
        before = int(state.A[run_totals.STEPS])
        code, _ = engine._advance(left, math.inf, math.inf, state.dt)
        assert code in (step_loop.Stop.SEARCH, step_loop.Stop.BUDGET)
        if code == step_loop.Stop.SEARCH:
            search(state)
            engine._tables()
        made = int(state.A[run_totals.STEPS]) - before
        events.append((made, state.slots if code == step_loop.Stop.SEARCH else None))
        left -= made
    return events


def walk(reference, events, dt):
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


def split(H, physics):
    first = contact_state.LAW + (physics.dashpots if physics.dashpots >= 0 else len(physics.history))
    last = contact_state.LAW + len(physics.history)
    forces = [[force for one in row for force in scalar_laws.unpack_triple(one)] for row in H[:, first:last]]
    return {"H": np.delete(H, range(first, last), axis=1), "D": np.array(forces)}


def tables(simulation):
    state, slots = simulation.state, simulation.state.slots
    found = {name: getattr(state, name).copy() for name in (*"BESPAM", "orientations")}
    return found | split(slots.H, state.physics) | {"R": slots.R[slots.histories.slip > 0.0]}


def differing_bits(one, other):
    assert all(one[name].shape == other[name].shape for name in one)
    return {name for name in one if one[name].tobytes() != other[name].tobytes()}


def scales(name, table):
    finite = np.where(np.isfinite(table), np.abs(table), 0.0)
    scale = finite.reshape(-1, table.shape[-1]).max(axis=0, initial=0.0)
    for first in VECTORS.get(name, ()):
        scale[first : first + 3] = scale[first : first + 3].max(initial=0.0)
    return np.full(len(scale), scale.max()) if name == "orientations" else scale


def tolerances(name, table):
    relative = np.full(table.shape[-1], OF_HISTORY if name == "D" else OF_FORCES)
    if name == "A":
        relative[run_totals.DAMPING_WORK] = 0.5 * OF_HISTORY
    relative[[column for column in MOTION.get(name, ()) if column < len(relative)]] = TOLERANCE
    scale = scales(name, table)
    # a moment of dashpots that is 0 in all rows is 1e-30 of rounding in the other
    return relative * scale + (1e-20 * scale.max() if name == "D" else 0.0)


def departures(engine, plain):
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


Pass = namedtuple("Pass", "simulation engine reference expected events spare")
"""One scene gone through by both: the engine's tables and the plain step's, what happened (steps that the engine made at a
stretch, and the candidates of the search that ended them), and `spare` plain steps that stand where both began."""


def begun(name):
    simulation = getattr(small_scenes, name)()
    lead(simulation, SCENES[name][0])
    if name == "torn":
        small_scenes.tear(simulation)
    return simulation


@cache
def both(name):
    allow_threads(1)
    simulation = begun(name)
    reference, *spare = (Reference(simulation) for _ in range(1 + sum(scene == name for scene, *_ in CHANGES)))
    events = follow(simulation, SCENES[name][1])
    return Pass(simulation, tables(simulation), reference, walk(reference, events, simulation.state.dt), events, spare)


def engine_alone(name):
    simulation = begun(name)
    follow(simulation, SCENES[name][1])
    return tables(simulation)


def changed(name, spoil, patch):
    """How many tolerances a changed plain step is off the engine; tables with other rows, as others touch, are left out."""
    found = both(name)
    spoil(patch)
    wrong = walk(found.spare.pop(), found.events, found.simulation.state.dt)
    alike = {name: values for name, values in wrong.items() if values.shape == found.engine[name].shape}
    return departures({name: found.engine[name] for name in alike}, alike)


@pytest.fixture
def two_threads(monkeypatch):
    before = allowed_threads()
    allow_threads(2)
    monkeypatch.setattr(jit_threads, "STARVED", 0.0)  # on a busy machine, too,
    monkeypatch.setattr(jit_threads, "SHORT", 0.0)  # and one thread is not tried
    yield
    allow_threads(before)


@scenes
def test_the_engine_agrees_with_the_plain_step(name):
    found = both(name)
    assert max(departures(found.engine, found.expected).values()) <= 1.0


@scenes
def test_two_threads_have_the_bits_of_one(name, two_threads):
    assert differing_bits(engine_alone(name), both(name).engine) == set()


@SLOW
def test_threads_may_change_during_a_run(two_threads, monkeypatch):
    turns = itertools.cycle((2, 1))
    monkeypatch.setattr(explicit.ThreadTuner, "threads", lambda *_: next(turns))
    assert differing_bits(engine_alone("swarm"), both("swarm").engine) == set()


@scenes
def test_nothing_is_farther_from_the_last_search_than_the_engine_thinks(name):
    state = both(name).simulation.state
    turn = matrix_from_quaternion(state.search_poses.quaternion)[state.body]
    before = state.search_poses.position[state.body] + np.einsum("nij,nj->ni", turn, state.offsets)
    gone = np.linalg.norm(state.spheres.position - before, axis=1).max()
    # a place is rounded by 1e-20 m in each of some hundred steps of more than 1e-10 m
    assert 0.0 < gone <= state.A[run_totals.MAX_DISPLACEMENT] * (1.0 + 1e-9)


def work_from_the_last():
    from_the_first = run_groups.compiled()

    @numba.njit(RUN_GROUPS, error_model="numpy")
    def turned_round(task, part, begin, end, step, packed):
        groups = context_of(packed).lowest.shape[0]
        from_the_first(task, part, groups - end, groups - begin, step, packed)

    return turned_round


@SLOW
def test_the_order_of_parts_does_not_matter(two_threads, monkeypatch):
    """Threads that wait for each other by luck only would pass the tests of two threads."""
    monkeypatch.setattr(explicit, "run_groups", work_from_the_last())
    assert differing_bits(engine_alone("swarm"), both("swarm").engine) == set()


@SLOW
def test_the_scenes_are_hard_enough():
    """Contacts that open and close, searches on the way, several tiles and chunks, labels, moments, a plate of every kind."""
    crowd, torn, layer, foundation, rolled, swarm, springs = (both(name) for name in SCENES)
    assert all(found.reference.opened > 0 for found in (layer, crowd, springs, rolled, swarm))
    assert all(found.reference.closed > 0 for found in (layer, crowd, springs, swarm))
    assert any(slots is not None for found in (layer, crowd, springs, rolled) for _, slots in found.events)
    assert len(layer.engine["R"]) > 2 * TILE
    for found in (layer, swarm):  # contacts between bodies of two groups
        state, slots = found.simulation.state, found.simulation.state.slots
        closed = (slots.histories.slip > 0.0) & (slots.partner >= 0)
        pairs = {(a, b) for a, b in (state.body[np.stack((slots.own, slots.partner), 1)[closed]] // (GROUP * BODIES)).tolist()}
        assert sum(a != b for a, b in pairs) > 1
    assert pairs >= {(0, 1), (1, 2), (2, 3)}
    assert layer.simulation.state.S is layer.simulation.state.B and swarm.simulation.state.S is not swarm.simulation.state.B
    assert swarm.simulation.state.n_bodies > 3 * GROUP * BODIES > step_loop.FEW * GROUP * BODIES  # fewer: on one thread
    for found in (crowd, springs, rolled):  # unlike materials
        assert len(set(found.simulation.state.slots.kind)) > 1
    assert [found.simulation.state.physics.labels for found in (layer, crowd, springs)] == [False, True, True]
    assert springs.simulation.state.slots.n_plates == springs.simulation.state.slots.count
    assert springs.simulation.state.n_bodies > BODIES and len(springs.reference.P) == springs.simulation.state.n_bodies
    assert len(foundation.reference.P) == foundation.simulation.state.n_bodies + 1
    assert foundation.reference.plan.rows[schedule.LOAD] and foundation.reference.plan.rows[schedule.Y]
    clock, settled = rolled.engine["A"][run_totals.TIME], rolled.simulation.settle  # what ends with settling ends on the way
    assert clock - SCENES["rolled"][1] * rolled.simulation.state.dt < settled < clock
    assert torn.reference.opened > 50 and torn.reference.lost > SEEN * OF_FORCES * torn.engine["A"][run_totals.FRICTION_WORK]
    for found, kind in ((swarm, MOMENTS), (rolled, TWIST)):
        assert np.any(found.engine["R"][:, record.MOMENT3] != 0.0) and found.simulation.state.physics.rolling >= kind
    moment, limit = np.abs(rolled.engine["R"][:, record.TWIST_MOMENT]), rolled.engine["R"][:, record.TWIST_LIMIT]
    assert np.any(moment == limit) and np.any((moment > 0.1 * limit) & (moment < 0.9 * limit))


def around(where, name, wrong):
    def spoil(patch):
        right = getattr(where, name)
        patch.setattr(where, name, lambda *arguments: wrong(right, *arguments))

    return spoil


def forgotten(_, S, i, j, memory, *rest):
    memory[:] = [0.0] * len(memory)
    return 0.0, 0.0


def untwisted(right, frame, memory, dt):
    frame.moved = frame.moved[0], (0.0, 0.0, 0.0), frame.moved[2]
    right(frame, memory, dt)


def end_twist(right, *arguments):
    (turn, twist), roll = right(*arguments)
    return (turn, twist._replace(angle=twist.rate * arguments[-1].dt)), roll


def other_sign(right, *arguments):
    torque, back = right(*arguments)
    return scalar_contact.scaled(torque, -1.0), back


FAULTS = {
    "sign of the torque of friction": ("crowd", around(scalar_contact, "torques", other_sign), "BSAHR"),
    "twist of a contact that does not turn its axis": ("torn", around(scalar_contact, "carry", untwisted), "H"),
    "energy of springs that open": ("torn", around(scalar_step, "let_go", forgotten), "BA"),
    "shares of what opens": ("torn", around(Reference, "lose", lambda *_: None), "B"),
    "velocity of a point": (
        "crowd", around(scalar_bodies, "carried", lambda _, v, w, r: scalar_bodies.added(v, scalar_bodies.cross(w, r), -1.0)),
        "BSAHR"),
    "nearest image": ("crowd", around(scalar_contact, "image", lambda _, d, length: d), "BSHR"),
    "viscous part of friction": ("crowd", around(scalar_laws, "fitted", lambda _, x, y, *rest: (x, y, (0.0, 0.0))), "BSAHR"),
    "normal of the end of the step, not of its middle": (
        "crowd", around(scalar_contact, "slipping", lambda right, frame, moved, _: right(frame, moved, frame.n)), "BSAHR"),
    "arm of the force": ("crowd", around(Reference, "about", lambda right, self, s, torque, force: torque), "BSAHR"),
    "friction work for both bodies": (
        "swarm", around(Reference, "give", lambda right, self, b, force, torque, work, slip:
                        right(self, b, force, torque, 2.0 * work, slip)), "B"),
    "bodies that effects act on: the first chunk": (
        "crowd", around(Reference, "total", lambda right, self, powers: right(self, powers[:BODIES])), "A"),
    "load": ("crowd", around(scalar_bodies.Patches, "drift", lambda *_: None), "BSPAHR"),
    "radius of the partner": ("swarm", around(scalar_contact, "torques", lambda right, *a: (right(*a)[0],) * 2), "BSAHR"),
    "limit of pivoting friction": (
        "rolled", around(scalar_laws, "within", lambda _, moment, viscous, limit: (moment + viscous, viscous)), "BHR"),
    "normal of pivoting": ("rolled", around(scalar_contact, "rolling", end_twist), "BHR"),
}  # fmt: skip
"""Of the plain step: in which scene, what is changed, and in which tables that must be seen."""
QUICK = [*FAULTS][1:4]
ORDERS = {
    "contacts backwards": ("crowd", around(Reference, "order", lambda right, self: right(self)[::-1])),
    "every other first": ("swarm", around(Reference, "order", lambda right, self: [*right(self)[::2], *right(self)[1::2]])),
    "bodies backwards": ("crowd", around(Reference, "total", lambda _, s, powers: sum(p for b in powers[::-1] for p in b[::-1]))),
}
CHANGES = [*FAULTS.values(), *ORDERS.values()]


@pytest.mark.parametrize("fault", [fault if fault in QUICK else pytest.param(fault, marks=SLOW) for fault in FAULTS])
def test_a_fault_is_seen(fault, monkeypatch):
    name, spoil, where = FAULTS[fault]
    apart = changed(name, spoil, monkeypatch)
    assert min(apart[table] for table in where if table in apart) >= SEEN


@SLOW
@pytest.mark.parametrize("order", ORDERS)
def test_sums_in_another_order_agree(order, monkeypatch):
    assert max(changed(*ORDERS[order], monkeypatch).values()) <= 1.0


SLOW_HEAPS = [(0, 0.0, "coulomb", 0, ""), (2, -5.0, "mindlin", 300, ""), (5821, -0.31, "mindlin", 160, ""),
         (7, 2.5, "coulomb", 17, ""), (9999, -2.17, "coulomb", 230, ""), (48, 3.7, "mindlin", 90, "pivoting = {}")]  # fmt: skip
HEAPS = [(1, 1.0, "mindlin", 40, "pivoting = {}"), (3, 5.0, "coulomb", 300, "")]


@pytest.mark.parametrize("heap", [*HEAPS, *(pytest.param(heap, marks=SLOW) for heap in SLOW_HEAPS)])
def test_any_heap_agrees_with_the_plain_step(heap):
    seed, speed, level, steps, effects = heap
    simulation = small_scenes.heap(seed, speed, level, effects)
    lead(simulation, steps)
    expected = walk(Reference(simulation), follow(simulation, 40), simulation.state.dt)
    assert max(departures(tables(simulation), expected).values()) <= 1.0
