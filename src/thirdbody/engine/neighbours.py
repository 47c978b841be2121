"""Neighbour search: a new list of candidates, with the contact histories of the old one."""

from collections.abc import Callable

import numpy as np

from thirdbody.engine.candidates import AllRows, Candidates, Numbers, sides_of
from thirdbody.engine.state import Array, Ints, State, table
from thirdbody.jit.threads import distribute, pieces_of
from thirdbody.kernels import neighbour_search as passes
from thirdbody.kernels.bodies import BODIES
from thirdbody.kernels.explicit.contact_forces import GROUP
from thirdbody.kernels.minima import RoughPlates, update
from thirdbody.kernels.plates import BASINS
from thirdbody.kernels.tables import LOWER, contact_state, domain, height_field, remote_force, run_totals, sphere, surface_contact


def search(state: State, recorded: bool = True) -> None:
    """Find all pairs that can touch before displacements reach the skin; transfer histories, and records if this step was
    `recorded`."""
    old, world = state.slots, state.world
    capacity = max(64, int(1.3 * old.count), 2 * state.n_spheres)
    n_plates, own, partner = _pairs_within(state, state.skin + state.reach, capacity, debris=world.debris_meets)
    Q = table(n_plates if world.rough else 0, surface_contact.WIDTH)
    Q[:, surface_contact.DISTANCE] = Q[:, surface_contact.SEARCHED] = np.inf
    if len(Q):
        _carry((0, n_plates), own, partner, Q, passes.CandidateRows(0, old.n_plates, old.own, old.partner, old.Q))
    state.slots = slots_of(state, own, partner, n_plates, (Q, *_carried_rows(state, n_plates, own, partner, recorded)))
    state.search_poses.position[:] = state.bodies.position
    state.search_poses.quaternion[:] = state.bodies.quaternion
    state.A[run_totals.MAX_DISPLACEMENT] = 0.0
    state.patches.search_height[:] = state.patches.height
    state.searches += 1
    if world.rough:
        update_closest_points(state, update)


def update_closest_points(state: State, update: Callable[[int, int, RoughPlates], None]) -> None:
    slots = state.slots
    tables = slots.own, slots.partner, state.S, state.P, slots.Q, state.D, state.lower_surface, state.upper_surface
    update(0, slots.n_plates, RoughPlates(*tables))


def slots_of(state: State, own: Numbers, partner: Numbers, n_plates: int, rows: tuple[Array, Array, Array]) -> Candidates:
    """Return the candidates with their `rows` (closest points Q, histories H, records R), and the index tables of the pairs."""
    Q, H, R = rows
    spheres, incidence = passes.incidences(len(own), own, partner, state.n_spheres)
    can_touch = np.diff(spheres) > 0
    owner_body = state.body[own]
    outer, remote_body, lowest, needs = _between_groups(owner_body[n_plates:], state.body[partner[n_plates:]], state.n_bodies)
    chunks = np.arange(-(-state.n_bodies // BODIES) + 1) * BODIES
    flat, paired = np.searchsorted(owner_body[:n_plates], chunks), n_plates + np.searchsorted(owner_body[n_plates:], chunks)
    columns = remote_force.WIDTH if state.physics.loss else remote_force.WIDTH_WITHOUT_NORMAL_LOSS
    cuts = flat, paired, np.searchsorted(remote_body // BODIES * BODIES, chunks)
    return Candidates(
        own=own, partner=partner, kind=kinds_of(state, own, partner), closed=(H[:, contact_state.SLIP] > 0.0).astype(np.int8),
        outer=np.concatenate((np.full(n_plates, -1, np.int32), outer)), edges=spheres[state.start], incidence=incidence,
        near=np.flatnonzero(can_touch).astype(np.int32),
        beginning=np.concatenate(([0], np.cumsum(can_touch)))[state.start].astype(np.int32), remote_body=remote_body,
        cuts=np.array(cuts, np.int32), lowest=lowest, needs=needs, n_plates=n_plates, Q=Q,
        F=table(len(remote_body), columns), rows=AllRows(H, R),
    )  # fmt: skip


def plate_pairs(state: State) -> Candidates:
    """Return all pairs of a sphere and a plate, without history: where bodies meet only plates, these are all contacts that may
    ever come, whenever other bodies made a search due."""
    n, own, partner = _pairs_within(state, np.inf, 2 * BASINS * state.n_spheres, debris=False)
    none = np.zeros((n, contact_state.LAW))
    return slots_of(state, own, partner, n, (state.slots.Q[:0], none, none))


def search_pairs(state: State, skin: float) -> tuple[Numbers, Numbers]:
    """Return the pairs of spheres of different bodies with gaps smaller than `skin` [m]: owners and partners, sorted."""
    return _pairs_within(state, skin, max(64, state.n_spheres), plates=False)[1:]


def replace_pairs(state: State, own: Numbers, partner: Numbers) -> None:
    """Replace the candidates between bodies by these pairs, sorted by owner and partner; histories and records are carried."""
    old, n = state.slots, state.slots.n_plates
    own, partner = np.concatenate((old.own[:n], own)), np.concatenate((old.partner[:n], partner))
    state.slots = slots_of(state, own, partner, n, (old.Q, *_carried_rows(state, n, own, partner, True)))
    state.searches += 1


def _between_groups(owner_body: Ints, partner_body: Ints, n_bodies: int) -> tuple[Numbers, Numbers, Numbers, Numbers]:
    """Return `outer`, `remote_body`, `lowest` and `needs` of `Candidates` for pairs of bodies (owner, partner)."""
    size, groups = BODIES * GROUP, -(-n_bodies // (BODIES * GROUP))
    others = np.flatnonzero(owner_body // size != partner_body // size)
    others = others[np.argsort(partner_body[others] // BODIES, kind="stable")]
    outer = np.full(len(owner_body), -1, np.int32)
    outer[others] = np.arange(len(others))
    requested = np.unique(owner_body[others] // size * groups + partner_body[others] // size)
    one, other = requested // groups, requested % groups
    lowest = np.arange(groups, dtype=np.int32)
    np.minimum.at(lowest, other, one.astype(np.int32))
    needs = np.concatenate((groups + 1 + np.searchsorted(one, np.arange(groups + 1)), other))
    return outer, partner_body[others].astype(np.int32), lowest, needs.astype(np.int32)


def _carried_rows(state: State, n_plates: int, own: Numbers, partner: Numbers, recorded: bool) -> tuple[Array, Array]:
    old, n = state.slots, len(own)
    H, R = table(n, old.H.shape[1]), table(n if recorded or state.physics.labels else 0, old.R.shape[1])
    for source, target in ((old.H, H), (old.R, R))[: 1 + recorded]:
        for part, first, last in (((0, n_plates), 0, old.n_plates), ((n_plates, n), old.n_plates, old.count)):
            _carry(part, own, partner, target, passes.CandidateRows(first, last, old.own, old.partner, source))
    return H, R


def _carry(part: tuple[int, int], own: Numbers, partner: Numbers, target: Array, old: passes.CandidateRows) -> None:
    """Carry rows to candidates `part[0]` to `part[1]` - 1; both lists are sorted by owner."""
    owners = old.own[old.first : old.last]

    def carry(piece: tuple[int, int]) -> None:
        if piece[0] < piece[1]:
            first = old.first + int(np.searchsorted(owners, own[piece[0]]))
            passes.carry_history(passes.CandidateRows(*piece, own, partner, target), old._replace(first=first))

    distribute(pieces_of(*part, passes.MIN_SPHERES), lambda: carry)


def _pairs_within(
    state: State, distance: float, capacity: int, plates: bool = True, debris: bool = True
) -> tuple[int, Numbers, Numbers]:
    """Return the number of pairs with plates, then owners and partners of all pairs with gaps smaller than `distance` [m].
    `capacity`: room for pairs in the first attempt; `plates`, `debris`: whether to find such pairs."""
    world, spheres, cells = state.world, passes.Spheres(state.body, state.side), grid(state, distance) if debris else None

    def limit(exists: bool, surface: Array | None) -> tuple[int, float]:
        if surface is None:
            return int(exists), distance
        return BASINS * int(exists), float(surface[height_field.MAX_HEIGHT]) + distance

    limits = (limit(world.lower is not None, world.lower_surface), limit(world.upper is not None, world.upper_surface),
              world.size[1] if world.walls else 0.0)  # fmt: skip
    while True:
        own, partner = np.empty(capacity, np.int32), np.empty(capacity, np.int32)
        n = n_plates = passes.plate_candidates(state.S, state.P, spheres, state.patch, limits, own, partner) if plates else 0
        if debris:
            n = passes.pair_candidates(state.S, spheres, distance, cells, n, own, partner)
        if n <= capacity:
            return n_plates, own[:n].copy(), partner[:n].copy()
        capacity = int(1.2 * n)


def grid(state: State, skin: float) -> passes.Grid:
    columns = np.ascontiguousarray(state.S[:, : sphere.RADIUS + 1].T)  # ten times faster in numpy than short rows
    cell = 2.0 * float(columns[sphere.RADIUS].max()) + skin
    lowest, highest = columns[:3].min(axis=1), columns[:3].max(axis=1)
    low, length = lowest - 0.5 * cell, highest - lowest + cell
    lengths = np.maximum(state.D[[domain.LENGTH_X, domain.LENGTH_Y]], 0.0)
    periodic = lengths > 0.0
    low[:2][periodic], length[:2][periodic] = 0.0, lengths[periodic]
    # bounded number of cells along each axis: an escaping body must not inflate the grid
    count = np.clip((length / cell).astype(np.int64), 1, max(1, 2 * int(np.ceil(np.sqrt(state.n_spheres)))))
    return passes.Grid(low, length / count, count, periodic, float(lengths[0]), float(lengths[1]))


def kinds_of(state: State, own: Numbers, partner: Numbers) -> Numbers:
    if state.physics.kinds.size == 1:
        return np.full(len(own), state.physics.kinds.item(), np.int32)
    material = state.material[state.body]
    world = state.world
    lower = -1 if world.lower is None else world.lower
    upper = -1 if world.upper is None else world.upper.material
    other, with_sphere = np.where(sides_of(partner) == LOWER, lower, upper), partner >= 0
    other[with_sphere] = material[partner[with_sphere]]
    return state.physics.kinds[material[own], other].astype(np.int32)


# -- rows of the tables of forces --
#
# A row is used again as soon as its force was added, so that the tables stay in the cache. The groups of a part are handled one
# after the other. The contacts of a group write their forces on bodies of later groups; a group adds what it got after its own
# contacts, and from then on these rows are free for the next groups. Where contacts of another part act on a group, it adds them
# late: nobody else uses their rows.

FEW = 2048
"""Remote forces whose rows, 128 KiB, stay in the cache anyway: each has a row of its own, which takes no time to find."""


def remote_rows(slots: Candidates, body: np.ndarray, parts: int) -> Numbers:
    """Return the row of F of every remote force, in the order of `remote_body`, where a pass has so many parts. Which rows are
    used changes no bit of a run: forces are added in this order. `body`: of every sphere."""
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
    """Return the row of a group's first body in the table of forces less its number, for each group, and the rows of the
    table."""
    groups, size = len(lowest), BODIES * GROUP
    begin = _begins(groups, parts)
    alone = lowest >= begin
    blocks = np.searchsorted(np.unique(begin), begin)
    blocks[~alone] = parts + np.arange(np.count_nonzero(~alone))
    return (size * (blocks - np.arange(groups))).astype(np.int32), size * (parts + int(np.count_nonzero(~alone)))


def _begins(groups: int, parts: int) -> np.ndarray:
    begins = np.arange(parts + 1) * groups // parts
    return np.repeat(begins[:-1], np.diff(begins))


def _by_group(group: np.ndarray, groups: int) -> list[np.ndarray]:
    """Return the numbers of the remote forces of each group, in order; group number `groups` is left out."""
    order = np.argsort(group, kind="stable")
    return np.split(order, np.searchsorted(group[order], np.arange(1, groups + 1)))[:groups]
