"""Arguments of the implicit kernels that travel together, and their scratch.

An island is a set of bodies that could meet each other before the next search, or one body alone. Its bodies share their steps,
and its equations are solved together. Tables of the run, of the islands, scratch of a thread, and that of one body are each a
pointer to packed arguments (`jit.arguments`), of which kernels read what they need.
"""

from collections import namedtuple
from typing import Any, NamedTuple

import numpy as np
from numba import njit, types

from thirdbody.jit.arguments import PACKED, Kinds, Packer, Unpacked, function_at, make_unpacker
from thirdbody.jit.options import BARE
from thirdbody.kernels import arguments, plates
from thirdbody.kernels.arguments import Motion
from thirdbody.kernels.contact_geometry import SPARE
from thirdbody.kernels.minima import UPDATE, RoughPlates
from thirdbody.kernels.step_tables import contact_sums, step_contacts, step_memory, step_start
from thirdbody.kernels.tables import observed_body
from thirdbody.kernels.tile import TILE, contact_tangent, geometry, law_input, law_output, rolling_input, rolling_output

FREEDOMS = 7
"""Coordinates of a body and its patch: displacement of the centre of mass (3,) [m], rotation vector of the step times the arm of
the body (3,) [m] in world axes, and rise of its patch of the upper plate [m]."""

MOTION = types.NamedUniTuple(types.float64, 3, Motion)  # numba's type of a `Motion`

_I, _I1, _S1 = types.int64, types.Array(types.int64, 1, "C"), types.Array(types.int32, 1, "C")
_ROW, _TABLE, _STACK = (types.Array(types.float64, n, "C") for n in (1, 2, 3))


def packed(name: str, kinds: Kinds) -> tuple[Any, Unpacked, Any]:
    """Return a named tuple of packed arguments, numba's type of them, and a function for kernels that unpacks them."""
    names = namedtuple(name, tuple(kinds))  # type: ignore[misc]
    kind = Unpacked(kinds, names)
    return names, kind, make_unpacker(kind)


SHARED = (
    "kind", "body", "start", "patch", "offsets", "S", "P", "Q", "pairs", "interaction", "effect_parameters", "D", "schedule",
    "first", "lower", "upper", "zone", "spring", "field_begin", "field_size", "rolling", "force", "moment", "twist", "stored",
    "dashpots", "loss_column", "has_effects", "labels", "law", "effects", "observe", "measured", "measure",
    "measure_parameters", "observe_bodies",
)  # fmt: skip
"""Fields that the explicit integrator has, too, beside those of `arguments.Observed`."""

ADDRESSES = (
    # function that updates the closest points of rough plates (`rough`)
    "update_minima",
    # parts of a step that few scenes need (`PART`): contacts between bodies, curved surfaces, spots
    "pairs_part", "rough_part", "spots_part",
    # books of contacts (`books`)
    "book_contacts", "write_contacts", "end_contact",
)  # fmt: skip
"""Fields with the address of a compiled function, 0 where a scene needs none."""

KINDS: Kinds = {
    **arguments.OBSERVED, **{name: arguments.KINDS[name] for name in SHARED},
    # candidates with plates of each body, like `edges` and `incidence` of all; they come first, in the order of bodies, so that
    # `plate_edges` are numbers of candidates, too
    "plate_edges": _S1, "plate_incidence": _S1,
    # settings of the step control; totals and memory of each body
    "settings": _ROW, "totals": _TABLE, "memory": _TABLE,
    # of bodies under a common plate (`common_plate`), else empty
    "starts": _TABLE, "ends": _TABLE, "solutions": _TABLE,
    # overlap plus reach of each candidate at the start of the step [m]
    "start_depths": _ROW,
    # of spheres since the last search for islands (`sphere_path`), else empty
    "paths": _TABLE,
    # address of the laws' tangents
    "tangents": _I,
    **dict.fromkeys(ADDRESSES, _I),
}  # fmt: skip
"""Types of all arguments of an implicit step, by name."""

ImplicitContext, CONTEXT, context_of = packed("ImplicitContext", KINDS)
"""All tables and numbers of a run; kernels unpack it from an array."""

ISLANDS: Kinds = {
    # bodies of all islands, island by island; where each island begins, and their number; position of each body in its island
    "bodies": _I1, "body_edges": _I1, "position": _I1,
    # candidates between the bodies of an island; where those of each island begin; largest difference of positions of a pair
    "pairs": _I1, "pair_edges": _I1, "widths": _I1,
    # islands in the order in which they are advanced
    "order": _I1,
}  # fmt: skip
"""Types of the tables of the islands, by name."""

IslandTables, ISLAND_TABLES, islands_of = packed("IslandTables", ISLANDS)
"""Tables of the islands; kernels unpack it from an array."""

SPACE: Kinds = {
    # tile (`arguments.Tile`), and candidates of the contacts in it
    "inputs": _ROW, "outputs": _ROW, "tangents": _ROW, "geometry": _ROW, "slots": _I1,
    # coordinates (7,) of the iteration and of the trial, residual [N] and correction; derivative of the residual (49,) [N/m], or
    # its factors
    "y": _ROW, "trial": _ROW, "residual": _ROW, "correction": _ROW, "jacobian": _ROW,
    # `step_contacts`, `contact_sums` (1, n), `step_start`
    "diagnostics": _ROW, "sums": _TABLE, "start": _ROW,
}  # fmt: skip
"""Types of the scratch of one body, by name; of contacts between bodies there is a tile with candidates only."""

Space, SPACE_TYPE, space_of = packed("Space", SPACE)
"""Scratch of one body of an island, usable as a `Tile`; kernels unpack it from an array."""

SCRATCH: Kinds = {
    # packed `Space` of each body, and of each tile of contacts between bodies, whose candidates are padded
    "spaces": types.Array(_I, 2, "C"), "pair_spaces": types.Array(_I, 2, "C"),
    # their tables, row by row (`SPACE`)
    **dict.fromkeys(("inputs", "outputs", "tangents", "geometry"), _TABLE), "slots": types.Array(_I, 2, "C"),
    "coordinates": _STACK, "jacobian": _TABLE, "diagnostics": _TABLE, "sums": _STACK, "starts": _TABLE,
    **dict.fromkeys(("pair_inputs", "pair_outputs", "pair_tangents", "pair_geometry"), _TABLE),
    "pair_slots": types.Array(_I, 2, "C"),
    # of each body: number of contacts with plates; sum of all acting forces [N], and one over that sum at the start of the
    # iteration; error of the friction work of its contacts with others, and the energy that these can store [J]
    "counts": _I1, "scales": _TABLE, "errors": _TABLE,
    # the labeller's row of a body, and rows of its contacts
    "observed": _ROW, "rows": _TABLE,
    # Jacobian of several bodies: row i has the columns from i - w to i + 2 w, side by side; rows exchanged; right-hand side, then
    # the solution
    "band": _ROW, "pivots": _I1, "solution": _ROW,
    # what a part returns (`PART`)
    "answer": _ROW,
}  # fmt: skip
"""Types of the scratch of a thread, by name."""

Scratch, THREAD, scratch_of = packed("Scratch", SCRATCH)  # scratch for one island at a time

PART = types.void(_I, _I, _I, _I, MOTION, CONTEXT, ISLAND_TABLES, THREAD)
"""part(stage, island, position of the body in it, number of contacts, motion, context, islands, scratch)"""

UPDATE_MINIMA = types.void(_I, *UPDATE.args)  # update_minima(stage, first candidate, last + 1, tables)

part_at, update_minima_at = function_at(PART), function_at(UPDATE_MINIMA)

ADVANCE = types.void(_I, _I, types.float64, types.float64, PACKED, PACKED, PACKED)
"""Signature of `driver.advance_islands`, which ensembles call through a pointer."""


class Stages(NamedTuple):
    START: int = 0  # the step begins
    TRIAL: int = 1  # bodies are where a trial leads: closest points, solved spots, and what pairs add to the residuals
    RELIEVE: int = 2  # spots are solved and relieved before the laws,
    RESTORE: int = 3  # restored after them,
    PULL: int = 4  # and pulled
    TANGENTS: int = 5  # derivatives are added to the Jacobian
    LIMIT: int = 6  # a correction is limited
    ERRORS: int = 7  # errors of the step
    ACCEPT: int = 8  # it is accepted


STAGE = Stages()


def make_scratch(context: Any, bodies: int, pairs: int, band: int, row: int) -> Any:
    """Return scratch for islands of at most so many bodies, pairs, numbers in the band, and candidates of a body."""
    history, tiles = context.n_history, (pairs + TILE - 1) // TILE
    widths = {
        "inputs": law_input.HISTORY + history + rolling_input.WIDTH,
        "outputs": law_output.HISTORY + history + rolling_output.WIDTH,
        "tangents": contact_tangent.SPOTS_WIDTH, "geometry": geometry.WIDTH,
    }  # fmt: skip
    # laws compute whole vectors (`contact_geometry.padded`): elements without a contact must have a pair type
    tables = {name: np.zeros((bodies, width * TILE)) for name, width in widths.items()}
    tables |= {f"pair_{name}": np.zeros((tiles, width * TILE)) for name, width in widths.items()}
    shapes = {
        "coordinates": (bodies, 4, FREEDOMS), "jacobian": (bodies, FREEDOMS * FREEDOMS),
        "diagnostics": (bodies, step_contacts.WIDTH), "sums": (bodies, 1, contact_sums.WIDTH),
        "starts": (bodies, step_start.WIDTH), "scales": (bodies, 2), "errors": (bodies, 2),
        "observed": (observed_body.WIDTH,), "rows": (row, context.width),
        "band": (band,), "solution": (FREEDOMS * bodies,), "answer": (4,),
    }  # fmt: skip
    whole = {"slots": (bodies, TILE), "pivots": (FREEDOMS * bodies,), "counts": (bodies,), "pair_slots": (tiles, TILE + SPARE)}
    tables |= {name: np.zeros(shape) for name, shape in shapes.items()}
    tables |= {name: np.zeros(shape, np.int64) for name, shape in whole.items()}
    packed = dict(zip(("spaces", "pair_spaces"), spaces_of(tables), strict=True))
    return Scratch(**tables, **{name: np.array([Packer(SPACE)(space) for space in spaces]) for name, spaces in packed.items()})


def spaces_of(tables: dict[str, np.ndarray]) -> tuple[list[Any], list[Any]]:
    rows, others = ("inputs", "outputs", "tangents", "geometry", "slots"), ("jacobian", "diagnostics", "sums", "starts")
    none, no_sums = np.zeros(0), np.zeros((0, contact_sums.WIDTH))
    bodies = [
        Space(*(tables[name][a] for name in rows), *tables["coordinates"][a], *(tables[name][a] for name in others))
        for a in range(len(tables["slots"]))
    ]
    pairs = range(len(tables["pair_slots"]))
    return bodies, [Space(*(tables[f"pair_{name}"][t] for name in rows), *[none] * 6, no_sums, none) for t in pairs]  # type: ignore[call-arg]


Island = namedtuple("Island", "number low n first_pair n_pairs half_width all")
"""An island: its number; where its n bodies begin in the table of all, and where the candidates between them; half width of the
band of its Jacobian; `IslandTables`."""


@njit(**BARE)
def unpack(packed, tables, packed_scratch):
    return context_of(packed), islands_of(tables), scratch_of(packed_scratch)


@njit(**BARE)
def island_at(h, islands):
    low, first = islands.body_edges[h], islands.pair_edges[h]
    n, n_pairs = islands.body_edges[h + 1] - low, islands.pair_edges[h + 1] - first
    return Island(h, low, n, first, n_pairs, FREEDOMS * (islands.widths[h] + 1) - 1, islands)


@njit(**BARE)
def body_at(a, island):
    return island.all.bodies[island.low + a]


@njit(**BARE)
def pair_at(e, island):
    return island.all.pairs[island.first_pair + e]


@njit(**BARE)
def space_at(a, scratch):
    return space_of(scratch.spaces[a])


@njit(**BARE)
def pair_tile(t, m, scratch):
    return space_of(scratch.pair_spaces[t]), min(np.int64(TILE), m - t * TILE)


@njit(**BARE)
def call_part(part, stage, a, m, motion, context, island, scratch):
    if part != 0:
        part_at(part)(stage, island.number, np.int64(a), np.int64(m), motion, context, island.all, scratch)


@njit(**BARE)
def update_rough(stage, b, context):
    if plates.is_rough(context):
        c, first, last = context, np.int64(context.plate_edges[b]), np.int64(context.plate_edges[b + 1])
        tables = RoughPlates(c.own, c.partner, c.S, c.P, c.Q, c.D, c.lower, c.upper)
        update_minima_at(context.update_minima)(stage, first, last, tables)


@njit(**BARE)
def last_candidate(b, context):
    """Return the end of the candidates of body b in `plate_incidence` that can touch in this step."""
    if plates.is_rough(context):
        return context.plate_edges[b] + int(context.memory[b, step_memory.CANDIDATES])
    return context.plate_edges[b + 1]
