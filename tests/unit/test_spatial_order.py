"""How an explicit run keeps its bodies: order, rows of remote forces, orientations of balls; the search against all pairs."""

import importlib
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from balls import BALLS, edited
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation
from thirdbody.assembly.simulation import build
from thirdbody.engine import explicit, neighbours
from thirdbody.engine.meeting import may_have_touched
from thirdbody.engine.neighbours import remote_rows
from thirdbody.engine.placed import ONE_GROUP, in_columns
from thirdbody.engine.state import orientations
from thirdbody.kernels.bodies import BODIES
from thirdbody.kernels.explicit.contact_forces import GROUP
from thirdbody.kernels.neighbour_search import Grid, Spheres, pair_candidates
from thirdbody.kernels.step_tables import sphere_path
from thirdbody.kernels.tables import EVERYTHING, ONLY_LOWER, body, sphere
from thirdbody.scene.model import Scene

DIAMETER = 2e-5


def debris(count):
    """Places (count, 3) of bodies in a debris four diameters thick and as dense as debris, anywhere in the plane, m."""
    side = DIAMETER * np.sqrt(count / (4.0 * 1.1))
    return np.random.default_rng(1).uniform(0.0, 1.0, (count, 3)) * (side, side, 4.0 * DIAMETER) - (3e-4, 1e-5, 0.0)


def share_within_groups(positions, order):
    pairs = cKDTree(positions).query_pairs(DIAMETER, output_type="ndarray")
    group = np.empty(len(order), int)
    group[order] = np.arange(len(order)) // (GROUP * BODIES)
    return float(np.mean(group[pairs[:, 0]] == group[pairs[:, 1]]))


def test_every_body_has_one_place_and_neighbours_are_of_one_group():
    for count in (0, 1, ONE_GROUP, ONE_GROUP + 1, 3000):
        order = in_columns(debris(count), DIAMETER)
        assert np.array_equal(np.sort(order), np.arange(count))
        assert (count > ONE_GROUP) != np.array_equal(order, np.arange(count))  # the bodies of one group stay as they are
    bodies = debris(2 * ONE_GROUP)
    bodies[7] = 1e6, 1e6, 0.0  # very far away: the last
    order = in_columns(bodies, DIAMETER)
    assert np.array_equal(np.sort(order), np.arange(2 * ONE_GROUP)) and order[-1] == 7
    # the same for the same bodies however they are reported
    bodies = debris(3000)
    order = in_columns(bodies, DIAMETER)
    assert np.array_equal(order, in_columns(bodies.copy(), DIAMETER))
    mixed = np.random.default_rng(2).permutation(len(bodies))
    assert np.array_equal(bodies[order], bodies[mixed][in_columns(bodies[mixed], DIAMETER)])
    order = in_columns(np.repeat(debris(600), 2, axis=0), DIAMETER)  # bodies at the same place keep their order
    assert np.array_equal(order[1::2], order[::2] + 1) and np.all(order[::2] % 2 == 0)
    for count in (2000, 20_000):
        bodies = debris(count)
        scattered = share_within_groups(bodies, np.random.default_rng(3).permutation(count))
        found = share_within_groups(bodies, in_columns(bodies, DIAMETER))
        assert scattered == pytest.approx(GROUP * BODIES / count, rel=0.15)  # chance, of some thousand pairs
        # 512 of these bodies fill a square of 11 diameters; near pairs are 3/8 of a diameter apart along an axis, so its sides
        # part one in fifteen of them; a stretch of the curve has a border of less than twice that of the square
        assert found > 0.8


def test_rows_that_are_used_again_change_no_bit(sheared, monkeypatch):
    """A layer of six groups, on one and on two threads, with rows of their own and with rows that are used again."""
    make, advance = sheared
    states, used = [], []
    for few, threads in ((10**9, 1), (0, 1), (0, 2)):
        monkeypatch.setattr(neighbours, "FEW", few)
        monkeypatch.setattr(explicit.ThreadTuner, "threads", lambda *_, count=threads: count)
        simulation = make(3000)
        advance(simulation, 60)  # several searches
        state = simulation.state
        states.append((state.B.tobytes(), state.slots.H.tobytes(), state.A.tobytes()))
        used.append(len(np.unique(remote_rows(state.slots, state.body, threads))) / len(state.slots.remote_body))
        assert not state.slots.F.any()  # every force was added, and its row cleared
    assert states[1] == states[0] and states[2] == states[0]
    assert used[0] == 1.0 and used[1] < 0.8


def test_parts_that_run_at_the_same_time_share_no_row(monkeypatch):
    """A chain of six groups, of which each acts on the next one, in two parts of three."""
    monkeypatch.setattr(neighbours, "FEW", 0)
    body, five = np.arange(6) * GROUP * BODIES, np.arange(5)
    slots = SimpleNamespace(outer=five, own=five, remote_body=body[1:], lowest=np.array([0, 0, 1, 2, 3, 4]))
    rows = remote_rows(slots, body, 2)
    assert not set(rows[:3]) & set(rows[3:])
    assert len(set(remote_rows(slots, body, 1))) == 2  # one after the other: a group frees the row that the next but one writes


@pytest.fixture
def sheared(monkeypatch):
    """Makers of a dense layer of so many spheres that is sheared at 5 m/s, and of so many of its steps."""
    monkeypatch.syspath_prepend(Path(__file__).parents[1] / "bench")
    scenes, ours = (importlib.import_module(name) for name in ("peers_scenes", "ours"))
    return lambda count: scenes.simulation_of(scenes.start_of("S", scenes.generated(count))), ours.advance


def turns_of(q):
    return Rotation.from_quat(np.roll(q, -1, axis=1))


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


def test_a_straight_path_over_a_ball_meets_it(state):
    starts = state.S[:, :3].copy()
    starts[0, 2] += 9e-6
    steps = np.zeros((MOVES, len(starts), 3))
    steps[:, 0, 0] = 24e-6 / MOVES
    paths, places = walk(state, starts, steps)
    assert {(0, 1), (0, 2)} == met(places) <= found(state, starts, paths)


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


SKIN = 0.1
LARGEST = 0.5
REACH = 2.0 * LARGEST + SKIN


def spheres(n, box, seed, each=1):
    rng = np.random.default_rng(seed)
    S = np.zeros((n, sphere.WIDTH))
    S[:, : sphere.RADIUS] = rng.uniform(0.0, 1.0, (n, 3)) * box
    S[:, sphere.RADIUS] = rng.uniform(0.2, 1.0, n) * LARGEST
    S[0, sphere.RADIUS] = LARGEST
    return S, Spheres(np.arange(n) // each, np.where(rng.uniform(size=n) < 0.1, ONLY_LOWER, EVERYTHING).astype(np.int8))


def gaps_found(S, of, box, periodic, room):
    """The pairs (k, 2) of the search in cells that are as small as they may be, behind three slots that are there already."""
    low, count = np.zeros(3), np.maximum((np.array(box) / REACH).astype(np.int64), 1)
    own, partner = np.full(room, -7, np.int32), np.full(room, -7, np.int32)
    lengths = [box[k] if periodic[k] else 0.0 for k in (0, 1)]
    n = pair_candidates(S, of, SKIN, Grid(low, np.array(box) / count, count, np.array(periodic), *lengths), 3, own, partner)
    assert np.all(own[:3] == -7) and np.all(partner[:3] == -7)
    return np.column_stack((own, partner))[3:n] if n <= room else np.full((n - 3, 2), -1)


def expected(S, of, box, periodic):
    i, j = np.triu_indices(len(S), 1)
    d = S[i, : sphere.RADIUS] - S[j, : sphere.RADIUS]
    for k in (0, 1):
        d[:, k] -= box[k] * np.rint(d[:, k] / box[k]) if periodic[k] else 0.0
    near = np.sum(d * d, axis=1) < (S[i, sphere.RADIUS] + S[j, sphere.RADIUS] + SKIN) ** 2
    both = (of.side[i] == EVERYTHING) & (of.side[j] == EVERYTHING)
    keep = near & both & (of.body[i] != of.body[j])
    return np.column_stack((i[keep], j[keep]))


@pytest.mark.parametrize("periodic", [(True, True), (True, False), (False, False)])
def test_every_pair_is_found_once_and_in_order(periodic):
    for cells in ((2, 2, 1), (2, 3, 1), (3, 2, 2), (3, 3, 3), (4, 5, 1), (5, 2, 4)):
        for seed, spheres_per_body in enumerate((1, 1, 3)):
            box = tuple(1.05 * REACH * n for n in cells)
            S, of = spheres(60, box, seed, spheres_per_body)
            pairs = gaps_found(S, of, box, periodic, 4000)
            assert np.array_equal(pairs, expected(S, of, box, periodic)) and len(pairs) > 10


def test_one_cell_is_enough_outer_cells_hold_the_rest_and_too_little_space_is_reported():
    S, of = spheres(9, (1.0, 1.0, 1.0), 1)
    assert np.array_equal(gaps_found(S, of, (1.0, 1.0, 1.0), (False, False), 100), expected(S, of, (1.0,) * 3, (False, False)))
    box = (4.0, 4.0, 4.0)
    S, of = spheres(80, box, 2)
    S[:, : sphere.RADIUS] = 1.3 * S[:, : sphere.RADIUS] - 0.6
    assert np.array_equal(gaps_found(S, of, box, (False, False), 4000), expected(S, of, box, (False, False)))
    box = (4.0, 4.0, 4.0)
    S, of = spheres(80, box, 3)
    for room in (3, 4, 20):
        assert len(gaps_found(S, of, box, (True, True), room)) == len(expected(S, of, box, (True, True))) > 20
    none = Spheres(np.zeros(0, np.int64), np.zeros(0, np.int8))
    assert gaps_found(np.zeros((0, sphere.WIDTH)), none, box, (True, True), 10).shape == (0, 2)
