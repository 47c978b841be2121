"""Arguments of the implicit kernels that travel together; `Motion` and `Tile` are those of `kernels.bundles`.

The tables of a run are packed into one array at the boundary of compiled code (`jit.arguments`).
"""

from collections import namedtuple
from typing import NamedTuple

import numpy as np
from numba import njit, types

from thirdbody.jit.arguments import Kinds, make_unpacker
from thirdbody.jit.options import BARE, CHUNK
from thirdbody.kernels import signatures
from thirdbody.kernels.bundles import Motion, Tile
from thirdbody.kernels.explicit.tables import contact_sums
from thirdbody.kernels.implicit.tables import step_contacts
from thirdbody.kernels.tables import observed_body
from thirdbody.kernels.tile import TILE, contact_tangent, geometry, law_input, law_output, rolling_input, rolling_output

Array = np.ndarray

FREEDOMS = 7
"""Coordinates of a body and its patch: displacement of the centre of mass (3,) [m], rotation vector of the step times the arm of
the body (3,) [m] in world axes, and rise of its patch of the upper plate [m]."""

MOTION = types.NamedUniTuple(types.float64, 3, Motion)
"""Numba's type of a `Motion`."""

SHARED = (
    "own", "partner", "kind", "edges", "incidence", "body", "start", "patch", "offsets", "S", "B", "E", "orientations",
    "P", "Q", "H", "R", "M", "pairs", "interaction", "effect_parameters", "D", "schedule", "first", "lower", "upper", "drag",
    "n_history", "field_begin", "field_size", "rolling", "force", "moment", "twist", "stored", "dashpots", "loss_column",
    "width", "has_effects", "labels", "law", "effects", "observe", "update_surfaces", "measured", "measure", "measure_parameters",
)  # fmt: skip
"""Fields that the explicit integrator has, too. `own`, `partner`: here all pairs of a sphere and a plate."""

_TABLE, _ROW = types.Array(types.float64, 2, "C"), types.Array(types.float64, 1, "C")
KINDS: Kinds = {
    **{name: signatures.KINDS[name] for name in SHARED},
    # settings of the step control (`columns.step_settings`); totals and memory of each body
    "settings": _ROW, "totals": _TABLE, "memory": _TABLE,
    # of bodies under a common plate (`common_plate`), else empty
    "starts": _TABLE, "ends": _TABLE, "solutions": _TABLE, "initial_overlaps": _ROW,
    # of spheres since the last search for islands (`columns.sphere_path`), else empty
    "paths": _TABLE,
    # largest number of candidates of a body; address of the laws' tangents
    "max_per_body": types.int64, "tangents": types.int64,
    # addresses of the functions that take the closest points of rough plates as those of an accepted step, and that write what
    # the Jacobian needs of them (`surface_steps`)
    "accept_surfaces": types.int64, "surface_tangents": types.int64,
}  # fmt: skip
"""Types of all arguments of an implicit step, by name."""

ImplicitContext = namedtuple("ImplicitContext", tuple(KINDS))  # type: ignore[misc]
"""All tables and numbers of a run; kernels unpack it from an array."""

context_of = make_unpacker(KINDS, ImplicitContext)
"""context_of(packed): the `ImplicitContext` in an array of int64."""


class ActiveBody(NamedTuple):
    """The body that is advanced."""

    number: int
    patch: int
    """Its patch of the upper plate."""
    start: Array
    """`columns.step_start`: state at the start of the step."""
    memory: Array
    """Its row of `columns.step_memory`."""
    totals: Array
    """Its row of `columns.run_totals`."""


@njit(**BARE)
def active_body(b, context):
    """Return body b, whose start of the step is a row of `starts`: of bodies that share their steps."""
    return ActiveBody(b, context.patch[b], context.starts[b], context.memory[b], context.totals[b])


class Workspace(NamedTuple):
    """Scratch for one body at a time."""

    tile: Tile
    slots: Array
    """Candidates of the contacts in the tile."""
    before: Array
    """Overlaps [m] of all candidates of the body at the start of the step; negative: a gap."""
    y: Array
    """Coordinates (7,) of the step."""
    trial: Array
    """Coordinates that are tried."""
    residual: Array
    """Residual (7,) [N] there."""
    correction: Array
    """Correction of the coordinates, or solution of another linear system."""
    jacobian: Array
    """Derivative of the residual (7, 7) [N/m], or its factors."""
    pivots: Array
    """Rows (7,) that the factors were exchanged with."""
    diagnostics: Array
    """`columns.step_contacts`"""
    sums: Array
    """`columns.contact_sums`, one row."""
    observed: Array
    """`columns.observed_body`: the labeller's row of the body."""
    rows: Array
    """`columns.loaded_contact`: the labeller's rows of its contacts."""


@njit(**CHUNK)
def make_workspace(context):
    """Return the scratch for one body."""
    history = context.n_history
    tile = Tile(
        # laws compute whole vectors (`contact_geometry.padded`): elements without a contact must have a pair type
        np.zeros((law_input.HISTORY + history + rolling_input.WIDTH) * TILE),
        np.empty((law_output.HISTORY + history + rolling_output.WIDTH) * TILE),
        np.empty(contact_tangent.SPOTS_WIDTH * TILE),
        np.empty(geometry.WIDTH * TILE),
    )
    return Workspace(
        tile, np.zeros(TILE, np.int64), np.zeros(context.max_per_body), np.zeros(FREEDOMS), np.zeros(FREEDOMS),
        np.zeros(FREEDOMS), np.zeros(FREEDOMS), np.empty((FREEDOMS, FREEDOMS)), np.zeros(FREEDOMS, np.int64),
        np.zeros(step_contacts.WIDTH), np.zeros((1, contact_sums.WIDTH)), np.zeros(observed_body.WIDTH),
        np.empty((context.max_per_body, context.width)),
    )  # fmt: skip
