"""Rows of the tables of forces: a row is used again as soon as its force was added, so that the tables stay in the cache.

The groups of a part are handled one after the other. The contacts of a group write their forces on bodies of later groups; a
group adds what it got after its own contacts, and from then on these rows are free for the next groups. Where contacts of another
part act on a group, it adds them late: nobody else uses their rows.
"""

import numpy as np

from thirdbody.engine.candidates import Candidates, Numbers
from thirdbody.kernels.bodies import BODIES
from thirdbody.kernels.explicit.contact_forces import GROUP

FEW = 2048
"""Remote forces whose rows, 128 KiB, stay in the cache anyway: each has a row of its own, which takes no time to find."""


def remote_rows(slots: Candidates, body: np.ndarray, parts: int) -> Numbers:
    """Return the row of F of every remote force, in the order of `remote_body`, where a pass has so many parts.

    `body`: of every sphere. Which rows are used changes no bit of a run: forces are added in the order of `remote_body`.
    """
    if len(slots.remote_body) <= FEW:
        return np.arange(len(slots.remote_body), dtype=np.int32)
    groups, size = len(slots.lowest), BODIES * GROUP
    begin = _begins(groups, parts)
    senders = np.flatnonzero(slots.outer >= 0)
    sender = np.empty(len(slots.remote_body), np.int64)
    sender[slots.outer[senders]] = body[slots.own[senders]] // size
    receiver = slots.remote_body.astype(np.int64) // size
    alone = (slots.lowest >= begin)[receiver]
    rows = np.empty(len(sender), np.int32)
    rows[~alone] = np.arange(np.count_nonzero(~alone))
    used = int(np.count_nonzero(~alone))
    sent, received = _by_group(np.where(alone, sender, groups), groups), _by_group(np.where(alone, receiver, groups), groups)
    free = np.empty(0, np.int32)
    for g in range(groups):
        if g == begin[g]:
            free = free[:0]  # other parts run at the same time
        count = len(sent[g])
        again = min(count, len(free))
        rows[sent[g][:again]], free = free[len(free) - again :], free[: len(free) - again]
        rows[sent[g][again:]] = np.arange(used, used + count - again)
        used += count - again
        free = np.concatenate((free, rows[received[g]]))
    return rows


def force_rows(lowest: Numbers, parts: int) -> tuple[Numbers, int]:
    """Return the row of a group's first body in the table of forces less its number, for each group, and the rows of the table.

    Groups of a part that get forces from this part alone use the same rows one after the other; others have rows of their own
    until these forces are added late.
    """
    groups, size = len(lowest), BODIES * GROUP
    begin = _begins(groups, parts)
    alone = lowest >= begin
    blocks = np.searchsorted(np.unique(begin), begin)
    blocks[~alone] = parts + np.arange(np.count_nonzero(~alone))
    return (size * (blocks - np.arange(groups))).astype(np.int32), size * (parts + int(np.count_nonzero(~alone)))


def _begins(groups: int, parts: int) -> np.ndarray:
    """Return the first group of the part of each group."""
    begins = np.arange(parts + 1) * groups // parts
    return np.repeat(begins[:-1], np.diff(begins))


def _by_group(group: np.ndarray, groups: int) -> list[np.ndarray]:
    """Return the numbers of the remote forces of each group, in order; group number `groups` is left out."""
    order = np.argsort(group, kind="stable")
    return np.split(order, np.searchsorted(group[order], np.arange(1, groups + 1)))[:groups]
