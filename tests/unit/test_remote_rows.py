"""Rows of remote forces: two forces share a row only if the first was added before the second is written, by the same thread."""

from types import SimpleNamespace

import numpy as np
import pytest

from thirdbody.engine.neighbours import _between_groups
from thirdbody.engine.remote_rows import remote_rows
from thirdbody.kernels.explicit.contact_forces import GROUP
from thirdbody.kernels.rigid_body import BODIES

SIZE, GROUPS = GROUP * BODIES, 23


def pairs_of_a_bed(rng):
    """Pairs in a periodic bed: most partners are at most two groups behind the owner, some are a whole domain away."""
    n = GROUPS * SIZE - 100
    one = np.sort(rng.integers(0, n, 4000))
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
    assert rows.min() == 0 and rows.max() + 1 == len(np.unique(rows))  # none is left out
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
