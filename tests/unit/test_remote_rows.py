"""Rows of remote forces: two forces share a row only if the first was added before the second is written, by the same thread."""

import importlib
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from thirdbody.engine import explicit
from thirdbody.engine import remote_rows as module
from thirdbody.engine.neighbours import _between_groups
from thirdbody.engine.remote_rows import FEW, force_rows, remote_rows
from thirdbody.kernels.explicit.contact_forces import GROUP
from thirdbody.kernels.rigid_body import BODIES

SIZE, GROUPS = GROUP * BODIES, 23


def pairs_of_a_bed(rng):
    """Pairs in a periodic bed: most partners are at most two groups behind the owner, some are a whole domain away."""
    n = GROUPS * SIZE - 100
    one = np.sort(rng.integers(0, n, 12000))
    other = np.minimum(one + rng.integers(1, 2 * SIZE, one.size), n - 1)
    across = rng.uniform(size=one.size) < 0.05
    other[across] = np.maximum(one[across], n - 1 - one[across] % SIZE)
    return one, other, n


@pytest.mark.parametrize("parts", [1, 2, 4, 7, GROUPS])
def test_no_row_is_written_before_its_last_force_was_added(parts):
    one, other, n = pairs_of_a_bed(np.random.default_rng(parts))
    outer, remote_body, lowest, _ = _between_groups(one, other, n)
    own = np.arange(len(one), dtype=np.int32)
    slots = SimpleNamespace(own=own, outer=outer, remote_body=remote_body, lowest=lowest)
    rows = remote_rows(slots, one, parts)
    assert len(rows) > FEW and rows.min() == 0 and rows.max() + 1 == len(np.unique(rows))  # none is left out
    sender, receiver = np.empty(len(rows), int), remote_body // SIZE
    sender[outer[outer >= 0]] = one[outer >= 0] // SIZE
    part = np.searchsorted(np.arange(1, parts + 1) * GROUPS // parts, np.arange(GROUPS), side="right")
    first = np.array([np.flatnonzero(part == p)[0] for p in range(parts)])
    late = lowest[receiver] < first[part[receiver]]  # added after all parts have written
    for row in np.unique(rows):
        users = np.flatnonzero(rows == row)
        users = users[np.argsort(sender[users], kind="stable")]
        if len(users) > 1:
            assert not late[users].any() and len(set(part[sender[users]])) == 1
            assert np.all(sender[users][1:] > receiver[users][:-1])
    assert parts > 1 or len(np.unique(rows)) < len(rows) / 3


@pytest.mark.parametrize("parts", [1, 2, 4, 7, GROUPS])
def test_no_two_groups_sum_forces_in_the_same_rows_at_one_time(parts):
    """Groups share rows only if they are of one part and get forces from that part alone; all rows are in the table."""
    one, other, n = pairs_of_a_bed(np.random.default_rng(parts))
    lowest = _between_groups(one, other, n)[2]
    shifts, count = force_rows(lowest, parts)
    first = shifts + SIZE * np.arange(GROUPS)
    part = np.searchsorted(np.arange(1, parts + 1) * GROUPS // parts, np.arange(GROUPS), side="right")
    alone = np.array([part[low] == part[g] for g, low in enumerate(lowest)])
    assert np.all(first % SIZE == 0) and first.min() >= 0 and first.max() + SIZE <= count
    for row in np.unique(first):
        users = np.flatnonzero(first == row)
        assert len(users) == 1 or (alone[users].all() and len(set(part[users])) == 1)
    assert len(np.unique(first)) == len(set(part[alone])) + np.count_nonzero(~alone)


def test_rows_that_are_used_again_change_no_bit(monkeypatch):
    """A layer of six groups, on one and on two threads, with rows of their own and with rows that are used again."""
    monkeypatch.syspath_prepend(Path(__file__).parents[1] / "bench")
    scenes, ours = (importlib.import_module(name) for name in ("peers_scenes", "ours"))
    start, states, used = scenes.start_of("S", scenes.generated(3000)), [], []
    for few, threads in ((10**9, 1), (0, 1), (0, 2)):
        monkeypatch.setattr(module, "FEW", few)
        monkeypatch.setattr(explicit.ThreadTuner, "threads", lambda *_, count=threads: count)
        simulation = scenes.simulation_of(start)
        ours.advance(simulation, 150)  # several searches
        state = simulation.state
        states.append((state.B.tobytes(), state.slots.H.tobytes(), state.A.tobytes()))
        used.append(len(np.unique(remote_rows(state.slots, state.body, threads))) / len(state.slots.remote_body))
        assert not state.slots.F.any()  # every force was added, and its row cleared
    assert states[1] == states[0] and states[2] == states[0]
    assert used[0] == 1.0 and used[1] < 0.8
