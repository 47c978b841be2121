"""The passes of the explicit step, each alone: what to run, and what it reads, writes and computes.

A pass runs on the tables of a scene that flows, over all of the scene, on one thread. In a step the passes come group by group,
so each finds in the near cache what the one before it read; alone it starts over at the other end of the tables.

Bytes are columns that a pass reads and columns that it writes, 8 bytes each, 4 or 8 a number in lists: as the kernels and the
layout have them, to be counted anew when these change. Fields of tiles of contacts and the gaps of a group count; the staging of
a chunk of clumps does not.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numba import njit

from thirdbody.engine.state import table
from thirdbody.jit.options import NO_COUNTS
from thirdbody.jit.packed_arguments import argument_specs, pack
from thirdbody.kernels import contact_geometry, contact_history, first_body, narrow_phase, rigid_body
from thirdbody.kernels.bundles import Box, Motion, Step, Tile
from thirdbody.kernels.columns import body, body_force, domain, geometry, law_input, law_output, rolling_input, rolling_output
from thirdbody.kernels.columns.tile import TILE
from thirdbody.kernels.explicit import (
    contact_dissipation,
    contact_forces,
    contact_tiles,
    drift_spheres,
    gather_forces,
    group_forces,
)
from thirdbody.kernels.explicit import drift as motion
from thirdbody.kernels.explicit.contact_forces import GROUP
from thirdbody.kernels.explicit.passes import effects_at, law_at
from thirdbody.kernels.rigid_body import BODIES, WITH_PLATE, WITH_SPHERE
from thirdbody.kernels.signatures import KINDS, context_of

kernel = njit(error_model="numpy", **NO_COUNTS)

NO_LENGTH = Step(number=1, record=False, time=0.0, dt=0.0, v_x=0.0, v_y=0.0, pending=1.0, turn=0.0)
"""A step of no length."""


@kernel
def over_parts(repeats, one, count, arguments):
    """Call `one` for every chunk or group."""
    for _ in range(repeats):
        for c in range(count):
            one(np.int64(c), *arguments)


@kernel
def over_tiles(repeats, one, tiles, arguments):
    """Call `one` for every tile: how many contacts, and what it works on."""
    for _ in range(repeats):
        for t in range(tiles.shape[0]):
            one(tiles[t, 1], *arguments)


@kernel
def over_slots(repeats, one, tiles, slots, arguments):
    """Call `one` for every tile: how many contacts, which slots, and what it works on."""
    for _ in range(repeats):
        for t in range(tiles.shape[0]):
            one(tiles[t, 1], slots[tiles[t, 0] :], *arguments)


@kernel
def drift(c, packed, step, Z, staged):
    """The bodies of a chunk."""
    k = context_of(packed)
    motion.drift_bodies(c, k, step, Z, staged)
    rigid_body.reset_plate_forces(k.cuts[WITH_PLATE, c], k.cuts[WITH_PLATE, c + 1], k.own, k.body, k.E)


@kernel
def kick(c, packed, step):
    """The bodies of a chunk, without their kick."""
    k = context_of(packed)
    group_forces.reset_forces(c * BODIES, min((c + 1) * BODIES, k.B.shape[0]), np.int64(0), k)
    gather_forces.gather_forces(c, k, step, effects_at(k.effects))


@kernel
def ends(g, cuts, side):
    """Where the slots of a group begin and end."""
    return cuts[side, g * GROUP], cuts[side, min((g + 1) * GROUP, cuts.shape[1] - 1)]


@kernel
def measure(g, context, box, found):
    """The gaps of a group."""
    first, last = ends(g, context.cuts, WITH_PLATE)
    narrow_phase.plate_overlaps(first, last, context, box, found)
    first, last = ends(g, context.cuts, WITH_SPHERE)
    narrow_phase.pair_overlaps(first, last, context, box, found)


@kernel
def sort(g, cuts, found, closed, touching, opened):
    """Who touches in a group, by the gaps of another: the work does not depend on them."""
    for side in range(WITH_PLATE, WITH_SPHERE + 1):
        first, last = ends(g, cuts, side)
        narrow_phase.compact_active(first, last, found, closed, touching, opened)


@kernel
def law(n, place, tile, pairs):
    """The law on a tile."""
    law_at(place)(tile.inputs, tile.outputs, n, pairs)


@kernel
def tally(n, slots, tile, sums):
    """The sums of a tile."""
    contact_forces.store_sums(0, 0.0, 0.0, contact_forces.reduce_tile(n, slots, tile, contact_forces.empty_sums()), sums)


@kernel
def push_flat(n, slots, context, tile):
    """A tile of contacts with plates."""
    contact_forces.scatter_plate_tile(n, np.int64(0), slots, context, tile)


@kernel
def push_pairs(n, slots, context, tile):
    """A tile of contacts between spheres."""
    contact_forces.scatter_pair_tile(n, np.int64(0), slots, context, tile)


@dataclass(frozen=True)
class Pass:
    """A pass over a scene: what to run so many times; then, of a step: calls of its kernel, how many of which things it works on,
    the bytes that it reads and writes, the bytes of all tables that it does so in, and kernels with how often they run."""

    name: str
    run: Callable[[int], Any]
    calls: int
    items: int
    things: str
    touched: float
    tables: float
    kernels: Sequence[tuple[Any, float]]


class Tables:
    """The tables of a scene, copied where a pass changes them, and the contacts of now in tiles."""

    def __init__(self, integrator: Any) -> None:
        s = self.state = integrator.state
        self.slots, self.physics, self.at = s.slots, s.physics, integrator
        self.B, self.E, self.H, self.F = s.B.copy(), s.E.copy(), s.slots.H.copy(), s.slots.F.copy()
        self.S = self.B if s.S is s.B else s.S.copy()
        self.rows = self.B.nbytes + (0 if s.S is s.B else self.S.nbytes)
        self.sums, self.moves, self.closed = integrator.sums.copy(), integrator.moves.copy(), s.slots.closed.copy()
        self.room = table(*integrator.scratch.shape)
        self.marks = np.empty((2, max(s.slots.count + contact_geometry.SPARE, BODIES)), np.int32)
        self.h, self.groups = len(s.physics.history), len(s.slots.lowest)
        fields = (
            law_input.HISTORY + self.h + rolling_input.WIDTH,
            law_output.HISTORY + self.h + rolling_output.WIDTH,
            geometry.WIDTH,
        )
        inputs, outputs, geometries = (table(n, TILE).ravel() for n in fields)
        self.tile = Tile(inputs, outputs, inputs[:0], geometries)
        integrator._context()
        self.context = integrator.packer.given._replace(
            S=self.S, B=self.B, E=self.E, H=self.H, F=self.F, sums=self.sums, moves=self.moves, closed=self.closed
        )
        behind = [max(s.slots.count - 1, 0)] * contact_geometry.SPARE  # as far as it is looked ahead
        self.touching = np.append(np.flatnonzero(self.closed == 1), behind).astype(np.int32)
        self.flat, self.paired = self._tiles(WITH_PLATE), self._tiles(WITH_SPHERE)
        self.tiles = np.concatenate((self.flat, self.paired))
        self.forces = table(len(self.B), body_force.WIDTH)  # of all bodies: a pass goes through all groups
        own = {"S": self.S, "B": self.B, "E": self.E, "H": self.H, "F": self.F, "sums": self.sums, "moves": self.moves,
               "orientations": s.orientations.copy(), "forces": self.forces,
               "force_rows": np.zeros(self.groups, np.int32)}  # fmt: skip
        self.context = integrator.packer.given._replace(**own)
        self.packed = pack(argument_specs(KINDS), self.context)
        length = max(s.D[domain.LENGTH_X], 0.0), max(s.D[domain.LENGTH_Y], 0.0)
        self.box = Box(*length, *(1.0 / x if x else 0.0 for x in length), s.reach)

    def _tiles(self, side: int) -> np.ndarray:
        """Where each tile begins in the list of those that touch, and how many it has: as a step cuts them, group by group."""
        found = []
        for g in range(self.groups):
            first, last = np.searchsorted(self.touching[: -contact_geometry.SPARE], ends(g, self.slots.cuts, side))
            found += [(t, min(TILE, last - t)) for t in range(first, last, TILE)]
        return np.array(found, np.int64).reshape(-1, 2)


def passes_of(k: Tables) -> list[Pass]:
    """All passes of a step that have something to do, in their order; a pass may need what those before it left in a tile."""
    found = [drift_of(k), *gaps_of(k), *staging_of(k), *fields_of(k), *pushes_of(k), gather_of(k)]
    return [one for one in found if one.items]


def drift_of(k: Tables) -> Pass:
    """Motion of the bodies, places of their spheres. Of a ball: B and its orientation, both ways; of its sphere in a table of its
    own, the columns up to the last velocity."""
    s, slots, round_ones = k.state, k.slots, k.B[:, body.SPHERE_INERTIA] != 0.0
    many, clumps = int(round_ones.sum()), int((~round_ones).sum())
    placed = int(np.diff(slots.beginning)[~round_ones].sum())
    apart = 0 if k.S is k.B else 4 + 20 - 8
    touched = 8 * many * (1 + 24 + 24 + apart) + clumps * (8 * (2 + 28 + 13) + 8) + placed * (8 * (3 + 12 + 24) + 4)
    given = k.packed, NO_LENGTH, k.room[0], k.marks[0]
    kernels = [
        (drift_spheres.drift_ball, many),
        (motion.drift_tile, clumps),
        (rigid_body.place_sphere, placed),
        (motion.check_limits, clumps),
    ]
    return Pass("drift", lambda n: over_parts(n, drift, len(k.moves), given), len(k.moves), len(k.B), "bodies",
                touched + slots.n_plates * (12 + 8), k.rows + s.offsets.nbytes, kernels)  # fmt: skip


def gaps_of(k: Tables) -> list[Pass]:
    """Gaps of all candidates: places and radii of two spheres; and a list of those that touch."""
    slots, calls = k.slots, 2 * k.groups
    flat, paired = slots.n_plates, slots.count - slots.n_plates
    given = (k.context, k.box, k.room[0])
    sorts = (slots.cuts, k.room[0], k.closed, *k.marks)
    return [
        Pass("measure", lambda n: over_parts(n, measure, k.groups, given), calls, slots.count, "candidates",
             flat * (8 + 8 * 4) + paired * (8 + 8 * 9), k.S.nbytes + 8 * slots.count,
             [(first_body.plane_overlap, flat), (narrow_phase.pair_overlaps, paired)]),
        Pass("sort", lambda n: over_parts(n, sort, k.groups, sorts), calls, slots.count, "candidates",
             18 * slots.count, k.closed.nbytes, []),
    ]  # fmt: skip


def staging_of(k: Tables) -> list[Pass]:
    """Rows to fields: of both spheres all columns but the arm, the axis and the mark of the contact, its history."""
    slots, h = k.slots, k.h
    kept = k.S.nbytes + k.H.nbytes + 12 * slots.count
    flat = (k.context, Motion(0.0, 0.0, 0.0), k.tile)
    return [
        slotted(k, "stage, plates", contact_tiles.gather_plate_contacts, k.flat, flat,
                16 + 8 * (14 + 4 + 36 + 2 * h), kept, contact_geometry.gather_plate_contact, 1),
        slotted(k, "stage, pairs", contact_geometry.gather_pair_contacts, k.paired, (k.context, k.tile),
                16 + 8 * (40 + 4 + 30 + 2 * h), kept, contact_geometry.gather_pair_contacts, 4),
    ]  # fmt: skip


def fields_of(k: Tables) -> list[Pass]:
    """What works on the fields of a tile alone, with the number of fields that each reads and writes."""
    dt, meeting, laws = k.state.dt, (k.state.dt, k.box, k.tile), (k.at.law, k.tile, k.physics.pairs)
    return [
        tiled(k, "meet", contact_geometry.pair_geometry, k.paired, meeting, 10 + 11),
        tiled(k, "turn frames", contact_geometry.transport_frames, k.tiles, (dt, k.tile), 13 + 6),
        tiled(k, "slide", contact_geometry.slip_increment, k.tiles, (dt, k.tile), 31 + 5),
        tiled(k, "law", law, k.tiles, laws, law_input.HISTORY + law_output.HISTORY + 2 * k.h, k.physics.law),
        *booking_of(k),
        tiled(k, "push", contact_geometry.force_and_torques, k.tiles, (k.tile,), 15 + 9),
        slotted(k, "tally", tally, k.tiles, (k.tile, k.sums), 4 + 8 * 8, 8 * 8 * TILE, contact_forces.reduce_tile, 4),
    ]


def booking_of(k: Tables) -> list[Pass]:
    """What friction takes, where the laws remember their force, and what dashpots take: forces before and after, slip, velocity
    along the normal, energies (no rolling moments)."""
    (force, moment, _), place, found = k.physics.force_columns, k.physics.dashpots, []
    if force >= 0 and moment < 0:
        found.append(tiled(k, "book friction", contact_dissipation.book, k.tiles, (k.context, k.tile), 11 + 1))
    if place >= 0 and moment < 0:
        dashpots = (k.state.dt, k.context, k.tile)
        found.append(tiled(k, "book dashpots", contact_dissipation.book_dashpots, k.tiles, dashpots, 14 + 2))
    return found


def pushes_of(k: Tables) -> list[Pass]:
    """Fields to rows: force and torque of both bodies, both ways, with the arm of a clump's sphere; the memory of the contact."""
    slots, h, clumps = k.slots, k.h, len(k.S) != len(k.B)
    arms, listed = 16 + 8 * 8 if clumps else 0, slots.own.nbytes + slots.partner.nbytes
    tables = listed + k.forces.nbytes + (k.S.nbytes if clumps else 0)
    return [
        slotted(
            k,
            "bodies, plates",
            push_flat,
            k.flat,
            (k.context, k.tile),
            20 + 8 * (8 + 4 + 9 + 9),
            tables,
            contact_forces.scatter_plate_tile,
            4,
        ),
        slotted(
            k,
            "bodies, pairs",
            push_pairs,
            k.paired,
            (k.context, k.tile),
            16 + arms + 8 * (11 + 16 + 16),
            tables + k.F.nbytes + slots.outer.nbytes,
            contact_forces.scatter_pair_tile,
            4,
        ),
        slotted(
            k,
            "keep",
            contact_history.store_history,
            k.tiles,
            (k.context, k.tile),
            4 + 8 * (6 + 5 + 2 * h),
            k.H.nbytes,
            contact_history.store_history,
            4,
        ),
    ]


def gather_of(k: Tables) -> Pass:
    """Forces from zero, what other groups left, a row each, sums to the bodies; the closing half kick is the drift's."""
    n, remote = len(k.B), len(k.slots.remote_body)
    return Pass(
        "gather",
        lambda many: over_parts(many, kick, len(k.moves), (k.packed, NO_LENGTH)),
        len(k.moves),
        n,
        "bodies",
        8 * len(k.moves) + 8 * 32 * n + (8 + 8 * 32) * remote,
        k.B.nbytes + k.forces.nbytes + k.F.nbytes,
        [(gather_forces.add_remote_forces, remote)],
    )


def tiled(k: Tables, name: str, one: Any, tiles: np.ndarray, given: tuple, fields: int, counted: Any = None) -> Pass:
    """A pass over fields of tiles."""
    n = int(tiles[:, 1].sum())
    return Pass(name, lambda many: over_tiles(many, one, tiles, given), len(tiles), n, "contacts", 8 * fields * n,
                8 * fields * TILE, [(counted or one, n)])  # fmt: skip


def slotted(k: Tables, name: str, one: Any, tiles: np.ndarray, given: tuple, each: int, tables: float, counted: Any,
            unrolled: int) -> Pass:  # fmt: skip
    """A pass over slots of tiles, of so many bytes each; `counted` does `unrolled` contacts in a round."""
    n = int(tiles[:, 1].sum())
    return Pass(name, lambda many: over_slots(many, one, tiles, k.touching, given), len(tiles), n, "contacts", each * n, tables,
                [(counted, n / unrolled)])  # fmt: skip
