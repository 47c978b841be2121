"""How an explicit run keeps its bodies: their order, rows of remote forces, orientations of balls, pairs between searches."""

import importlib
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from balls import BALLS, edited
from each import each
from numba import njit
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from thirdbody.assembly.simulation import build
from thirdbody.engine import explicit
from thirdbody.engine import remote_rows as module
from thirdbody.engine.explicit import BUDGET
from thirdbody.engine.neighbours import _between_groups
from thirdbody.engine.orientations import orientations
from thirdbody.engine.remote_rows import FEW, force_rows, remote_rows
from thirdbody.engine.spatial_order import FEWEST, WIDTH, in_columns
from thirdbody.engine.swept_paths import may_have_touched
from thirdbody.kernels.columns import body, sphere_path
from thirdbody.kernels.explicit.contact_forces import GROUP
from thirdbody.kernels.rigid_body import BODIES
from thirdbody.kernels.sphere_rotation import STEPS, steps_behind, weight_of
from thirdbody.scene.model import Scene

DIAMETER = 2e-5


def debris(count):
    """Places (count, 3) of bodies in a debris four diameters thick and as dense as debris, anywhere in the plane, m."""
    side = DIAMETER * np.sqrt(count / (4.0 * 1.1))
    return np.random.default_rng(1).uniform(0.0, 1.0, (count, 3)) * (side, side, 4.0 * DIAMETER) - (3e-4, 1e-5, 0.0)


def share_within_groups(positions, order):
    """Share of the pairs of near bodies that are of one group."""
    pairs = cKDTree(positions).query_pairs(DIAMETER, output_type="ndarray")
    group = np.empty(len(order), int)
    group[order] = np.arange(len(order)) // (GROUP * BODIES)
    return float(np.mean(group[pairs[:, 0]] == group[pairs[:, 1]]))


def test_every_body_has_one_place_that_depends_on_the_bodies_alone():
    for count in (0, 1, FEWEST, FEWEST + 1, 3000):
        order = in_columns(debris(count), DIAMETER)
        assert np.array_equal(np.sort(order), np.arange(count))
        assert (count > FEWEST) != np.array_equal(order, np.arange(count))  # the bodies of one group stay as they are
    bodies = debris(2 * FEWEST)
    bodies[7] = 1e6, 1e6, 0.0  # very far away: the last
    order = in_columns(bodies, DIAMETER)
    assert np.array_equal(np.sort(order), np.arange(2 * FEWEST)) and order[-1] == 7
    # the same for the same bodies however they are reported
    bodies = debris(3000)
    order = in_columns(bodies, DIAMETER)
    assert np.array_equal(order, in_columns(bodies.copy(), DIAMETER))
    mixed = np.random.default_rng(2).permutation(len(bodies))
    assert np.array_equal(bodies[order], bodies[mixed][in_columns(bodies[mixed], DIAMETER)])
    order = in_columns(np.repeat(debris(600), 2, axis=0), DIAMETER)  # bodies at the same place keep their order
    assert np.array_equal(order[1::2], order[::2] + 1) and np.all(order[::2] % 2 == 0)
    # On a lattice of columns: the place of a column has the bits of its two numbers in turn.
    width, side = WIDTH * DIAMETER, 16
    i, j, k = (axis.ravel() for axis in np.meshgrid(np.arange(side), np.arange(side), np.arange(3), indexing="ij"))
    bodies = np.column_stack(((i + 0.5) * width, (j + 0.5) * width, k * DIAMETER))
    bodies[0, :2] = 0.0  # the corner from which columns are counted
    curve = [int("".join(b + a for a, b in zip(f"{x:05b}", f"{y:05b}", strict=True)), 2) for x, y in zip(i, j, strict=True)]
    expected = sorted(range(len(bodies)), key=lambda body: (curve[body], k[body]))
    assert in_columns(bodies, DIAMETER).tolist() == expected


def test_neighbours_are_of_one_group():
    for count in (2000, 20_000):
        bodies = debris(count)
        scattered = share_within_groups(bodies, np.random.default_rng(3).permutation(count))
        found = share_within_groups(bodies, in_columns(bodies, DIAMETER))
        assert scattered == pytest.approx(GROUP * BODIES / count, rel=0.15)  # chance, of some thousand pairs
        # 512 of these bodies fill a square of 11 diameters; near pairs are 3/8 of a diameter apart along an axis, so its sides
        # part one in fifteen of them; a stretch of the curve has a border of less than twice that of the square
        assert found > 0.8


ROWS, GROUPS = GROUP * BODIES, 23
PARTS = (1, 2, 4, 7, GROUPS)


def pairs_of_a_bed(parts):
    """Pairs in a periodic bed: most partners are at most two groups behind the owner, some are a whole domain away."""
    rng, n = np.random.default_rng(parts), GROUPS * ROWS - 100
    one = np.sort(rng.integers(0, n, 12000))
    other = np.minimum(one + rng.integers(1, 2 * ROWS, one.size), n - 1)
    across = rng.uniform(size=one.size) < 0.05
    other[across] = np.maximum(one[across], n - 1 - one[across] % ROWS)
    part = np.searchsorted(np.arange(1, parts + 1) * GROUPS // parts, np.arange(GROUPS), side="right")
    return one, part, _between_groups(one, other, n)


@each(PARTS)
def test_no_row_is_written_before_its_last_force_was_added(parts):
    one, part, (outer, remote_body, lowest, _) = pairs_of_a_bed(parts)
    slots = SimpleNamespace(own=np.arange(len(one), dtype=np.int32), outer=outer, remote_body=remote_body, lowest=lowest)
    rows = remote_rows(slots, one, parts)
    assert len(rows) > FEW and rows.min() == 0 and rows.max() + 1 == len(np.unique(rows))  # none is left out
    sender, receiver = np.empty(len(rows), int), remote_body // ROWS
    sender[outer[outer >= 0]] = one[outer >= 0] // ROWS
    first = np.array([np.flatnonzero(part == p)[0] for p in range(parts)])
    late = lowest[receiver] < first[part[receiver]]  # added after all parts have written
    for row in np.unique(rows):
        users = np.flatnonzero(rows == row)
        users = users[np.argsort(sender[users], kind="stable")]
        if len(users) > 1:
            assert not late[users].any() and len(set(part[sender[users]])) == 1
            assert np.all(sender[users][1:] > receiver[users][:-1])
    assert parts > 1 or len(np.unique(rows)) < len(rows) / 3


@each(PARTS)
def test_no_two_groups_sum_forces_in_the_same_rows_at_one_time(parts):
    """Groups share rows only if they are of one part and get forces from that part alone; all rows are in the table."""
    _, part, (_, _, lowest, _) = pairs_of_a_bed(parts)
    shifts, count = force_rows(lowest, parts)
    first = shifts + ROWS * np.arange(GROUPS)
    alone = np.array([part[low] == part[g] for g, low in enumerate(lowest)])
    assert np.all(first % ROWS == 0) and first.min() >= 0 and first.max() + ROWS <= count
    for row in np.unique(first):
        users = np.flatnonzero(first == row)
        assert len(users) == 1 or (alone[users].all() and len(set(part[users])) == 1)
    assert len(np.unique(first)) == len(set(part[alone])) + np.count_nonzero(~alone)


def test_rows_that_are_used_again_change_no_bit(sheared, monkeypatch):
    """A layer of six groups, on one and on two threads, with rows of their own and with rows that are used again."""
    make, advance = sheared
    states, used = [], []
    for few, threads in ((10**9, 1), (0, 1), (0, 2)):
        monkeypatch.setattr(module, "FEW", few)
        monkeypatch.setattr(explicit.ThreadTuner, "threads", lambda *_, count=threads: count)
        simulation = make(3000)
        advance(simulation, 100)  # several searches
        state = simulation.state
        states.append((state.B.tobytes(), state.slots.H.tobytes(), state.A.tobytes()))
        used.append(len(np.unique(remote_rows(state.slots, state.body, threads))) / len(state.slots.remote_body))
        assert not state.slots.F.any()  # every force was added, and its row cleared
    assert states[1] == states[0] and states[2] == states[0]
    assert used[0] == 1.0 and used[1] < 0.8


@njit
def weights(steps):
    """Weights of so many steps, and by how many steps orientations are behind after each number of them."""
    return [weight_of(k) for k in range(steps)], [steps_behind(k) for k in range(steps)]


WEIGHTS, BEHIND = weights(3 * STEPS)
TAKEN = {k: weight for k, weight in enumerate(WEIGHTS[:STEPS]) if weight != 0.0}


@pytest.fixture
def sheared(monkeypatch):
    """Makers of a dense layer of so many spheres that is sheared at 5 m/s, and of so many of its steps."""
    monkeypatch.syspath_prepend(Path(__file__).parents[1] / "bench")
    scenes, ours = (importlib.import_module(name) for name in ("peers_scenes", "ours"))
    return lambda count: scenes.simulation_of(scenes.start_of("S", scenes.generated(count))), ours.advance


def turns_of(q):
    """Rotations of quaternions (n, 4), w first."""
    return Rotation.from_quat(np.roll(q, -1, axis=1))


def test_weights_of_a_block():
    """Exact for cubic polynomials; the time step changes between blocks only; what a stop lacks is the rest of the block."""
    for power in range(5):
        every = sum((k - 7.0) ** power for k in range(STEPS))  # not from the middle: odd powers are tested, too
        taken = sum(weight * (k - 7.0) ** power for k, weight in TAKEN.items())
        assert (taken == pytest.approx(every, rel=1e-14)) == (power < 4)
    assert len(TAKEN) == STEPS / 4 and BUDGET % STEPS == 0
    for steps in range(3 * STEPS):
        assert BEHIND[steps] == pytest.approx(steps - sum(WEIGHTS[:steps]), abs=1e-13)
        assert abs(BEHIND[steps]) < 2.1


def test_rotations_agree_with_those_of_every_step(sheared):
    """In collisions and under friction: the error of the quadrature, 2e-3 of the rotation at most."""
    make, advance = sheared
    simulation = make(300)
    advance(simulation, 100)
    state, engine = simulation.state, simulation.integrator
    B, every = state.B, turns_of(orientations(state))
    start = every
    for _ in range(400):
        middle = B[:, body.SPIN3] + 0.5 * state.dt / B[:, [body.SPHERE_INERTIA]] * B[:, body.TORQUE3]
        advance(simulation, 1)
        every = Rotation.from_rotvec(state.dt * middle) * every
    assert engine.summary()["steps"] == 500
    off, turned = (turns_of(orientations(state)) * every.inv()).magnitude(), (every * start.inv()).magnitude()
    assert np.sqrt(np.mean(off**2)) < 2e-3 * np.sqrt(np.mean(turned**2))


def test_stops_change_no_bit(sheared):
    make, advance = sheared
    one, other = make(300), make(300)
    advance(one, 150)
    for steps in (1, 2, 5, 10, 14, 30, 3, 85):
        advance(other, steps)
        orientations(other.state)
    for name in ("orientations", "B", "A"):
        assert getattr(one.state, name).tobytes() == getattr(other.state, name).tobytes()


R, DOMAIN, MOVES = 5e-6, (8e-5, 6e-5), 40


@pytest.fixture
def state():
    """Twelve balls, 2 um from each other, in a box with periodic sides, with contact between them."""
    places = ", ".join(f'["{12 * (k % 4) + 6} um", "{12 * (k // 4) + 6} um", "5 um"]' for k in range(12))
    return build(Scene.parse(edited(BALLS, ("count = 4\nseed = 1", f"positions = [{places}]")))).state


def walk(state, starts, steps):
    """Move the spheres from `starts` (n, 3) by `steps` (m, n, 3) [m]; the paths as steps of bodies keep them, and all places."""
    places = starts + np.concatenate((np.zeros((1, *starts.shape)), np.cumsum(steps, axis=0)))
    paths = np.zeros((len(starts), sphere_path.WIDTH))
    paths[:, sphere_path.LENGTH] = np.linalg.norm(steps, axis=2).sum(axis=0)
    paths[:, sphere_path.LOW3], paths[:, sphere_path.HIGH3] = places.min(axis=0), places.max(axis=0)
    state.S[:, :3] = places[-1]
    return paths, places


def met(places):
    """The pairs of balls that overlapped at one of the instants."""
    i, j = np.triu_indices(places.shape[1], 1)
    between = places[:, i] - places[:, j]
    for axis in (0, 1):
        between[..., axis] -= DOMAIN[axis] * np.rint(between[..., axis] / DOMAIN[axis])
    near = (np.linalg.norm(between, axis=2) < 2.0 * R).any(axis=0)
    return set(zip(i[near].tolist(), j[near].tolist(), strict=True))


def found(state, starts, paths):
    return set(zip(*(side.tolist() for side in may_have_touched(state, starts, paths)), strict=True))


def test_no_pair_that_met_is_missed(state):
    """Random walks, of balls that stay, that move on, and of one that flies."""
    starts = state.S[:, :3].copy()
    for drift in (0.0, 2e-7, 1e-6):
        rng, number = np.random.default_rng(1), 0
        for _ in range(20):
            steps = rng.normal(0.0, 2e-7, (MOVES, len(starts), 3)) + drift * rng.normal(size=(1, len(starts), 3))
            steps[:, 0] *= 10.0
            paths, places = walk(state, starts, steps)
            pairs = met(places)
            number += len(pairs)
            assert pairs <= found(state, starts, paths)
        assert number > 20


def test_a_ball_that_chatters_meets_only_what_it_can_reach(state):
    """It goes to and fro by 0.5 um, and 100 um in all; its neighbours are 2 um from it, and one 0.4 um."""
    starts = state.S[:, :3].copy()
    starts[6, 0] += 1.6e-6
    steps = np.zeros((200, len(starts), 3))
    steps[::2, 5, 0], steps[1::2, 5, 0] = 5e-7, -5e-7
    paths, _ = walk(state, starts, steps)
    assert found(state, starts, paths) == set()
    starts[6, 0] -= 1.6e-6 + 1.6e-6
    paths, _ = walk(state, starts, steps)
    assert found(state, starts, paths) == {(5, 6)}
