"""Jacobian of the residuals of an island (`residual`): of each body with its plates, and of contacts between bodies."""

import numpy as np
from numba import njit

from thirdbody.jit.arguments import function_at
from thirdbody.jit.options import BARE
from thirdbody.kernels import plates
from thirdbody.kernels.arguments import LAW
from thirdbody.kernels.contact_geometry import padded
from thirdbody.kernels.implicit.contact import (
    NOWHERE,
    ZERO_TENSOR,
    add_planar,
    add_planar_moments,
    contact_of,
    owner_side,
    plate_side,
)
from thirdbody.kernels.implicit.residual import inertia_of
from thirdbody.kernels.implicit.tables import step_start
from thirdbody.kernels.implicit.workspace import FREEDOMS, STAGE, body_at, call_part, space_at
from thirdbody.kernels.plates import is_upper
from thirdbody.kernels.rolling_kinematics import has_moments
from thirdbody.kernels.tables import body, patch
from thirdbody.kernels.tile import TILE, contact_tangent, law_output, rolling_output

tangents_at = function_at(LAW)


@njit(**BARE)
def give_springs(m, context, tile):
    """Give the tangents the spring that the law has answered: a law with a field is not evaluated twice."""
    if context.dashpots < 0:
        return
    O, K = tile.outputs, tile.tangents  # noqa: E741
    behind = (law_output.HISTORY + context.n_history) * TILE
    for q in range(m):
        total, damped = law_output.TANGENTIAL_X * TILE + q, behind + rolling_output.VISCOUS_X * TILE + q
        K[contact_tangent.SPRING_X * TILE + q] = O[total] - O[damped]
        K[contact_tangent.SPRING_Y * TILE + q] = O[total + TILE] - O[damped + TILE]
        K[contact_tangent.SPRING_LIMIT * TILE + q] = O[law_output.FRICTION_LIMIT * TILE + q]


@njit(**BARE)
def plate_contact(q, b, dt, shape, context, space):
    """Return contact q of body b, with a plate, as a `Contact` of the equations of this body alone; `shape`: see `contact_of`."""
    k = space.slots[q]
    owner = owner_side(q, context.own[k], np.int64(0), 1.0, context.S, space.geometry)
    sides = owner, plate_side(np.int64(6) if is_upper(context.partner[k]) else np.int64(-1))
    return contact_of(q, space.before[k - context.plate_edges[b]], dt, sides, shape, context, space)


@njit(**BARE)
def add_plane(contact, context, J):
    """Add a contact with a plane to the Jacobian of its body, J (7, 7), flat."""
    add_planar(contact, J)
    if has_moments(context):
        add_planar_moments(contact, J)


@njit(**BARE)
def assemble_body(a, m, coupled, motion, context, island, scratch):
    """Write the Jacobian (49,) [N/m] of the residual of the body at position a, for its m contacts with plates.

    A patch of prescribed height has no equation, unless `coupled`: then the derivatives with respect to its height are included.
    """
    b, space, dt = body_at(a, island), space_at(a, scratch), motion.dt
    p, Z, P, J = context.patch[b], space.start, context.P, space.jacobian
    give_springs(m, context, space)
    if context.spots_part != 0:
        call_part(context.spots_part, STAGE.RELIEVE, a, m, motion, context, island, scratch)
    tangents_at(context.tangents)(space.inputs, space.tangents, padded(m, context.n_history), context.pairs)
    if context.spots_part != 0:
        call_part(context.spots_part, STAGE.RESTORE, a, m, motion, context, island, scratch)
    for i in range(FREEDOMS * FREEDOMS):
        J[i] = 0.0
    if plates.is_rough(context):
        call_part(context.rough_part, STAGE.TANGENTS, a, m, motion, context, island, scratch)
    else:
        for q in range(m):
            add_plane(plate_contact(q, b, dt, (ZERO_TENSOR, NOWHERE, ZERO_TENSOR), context, space), context, J)
    if context.spots_part != 0:
        call_part(context.spots_part, STAGE.TANGENTS, a, m, motion, context, island, scratch)
    subtract_inertia(context, b, dt, space)
    if P[p, patch.FREE] == 0.0 and not coupled:
        for k in range(6):
            J[42 + k], J[FREEDOMS * k + 6] = 0.0, 0.0
        J[48] = -1.0
    elif P[p, patch.FREE] != 0.0:
        rate = Z[step_start.NOW] / dt
        square = Z[step_start.MASS_FRACTION] * rate * rate
        J[48] -= P[p, patch.DAMPING] * rate + P[p, patch.MASS] * square + P[p, patch.SPRING] + Z[step_start.TETHER_STIFFNESS]


@njit(**BARE)
def subtract_inertia(context, b, dt, space):
    """Subtract inertia and spring of the body; scale rotations and torques with its arm."""
    Z, B, J = space.start, context.B, space.jacobian
    per_arm = 1.0 / Z[step_start.ARM]
    xx, yy, zz, xy, xz, yz = inertia_of(b, context.E, context.orientations)
    rate, rows = Z[step_start.NOW] / dt, ((xx, xy, xz), (xy, yy, yz), (xz, yz, zz))
    square = Z[step_start.MASS_FRACTION] * rate * rate
    for i in range(3):
        J[8 * i] -= B[b, body.MASS] * square
        for k in range(3):
            J[FREEDOMS * (3 + i) + 3 + k] -= rows[i][k] * square
    for i in range(FREEDOMS):
        for k in range(3, 6):
            J[FREEDOMS * i + k] *= per_arm
    for k in range(3, 6):
        for i in range(FREEDOMS):
            J[FREEDOMS * k + i] *= per_arm
    for k in range(6):
        J[8 * k] -= Z[step_start.TETHER_STIFFNESS]


@njit(**BARE)
def assemble(m, coupled, motion, context, island, scratch):
    """Write the Jacobian of the island, with m contacts between its bodies, to `band`; of one body alone only its own.

    `coupled`: see `assemble_body`; then also that of one body is a band.
    """
    n, w, J = island.n, island.half_width, scratch.band
    for a in range(n):
        assemble_body(a, scratch.counts[a], coupled, motion, context, island, scratch)
    if n == 1 and not coupled:
        return
    for e in range(FREEDOMS * n * (3 * w + 1)):
        J[e] = 0.0
    for a in range(n):
        first = FREEDOMS * a * (3 * w + 1) + w
        for i in range(FREEDOMS):
            for j in range(FREEDOMS):
                J[first + 3 * w * i + j] = scratch.jacobian[a, FREEDOMS * i + j]
    if m > 0:
        call_part(context.pairs_part, STAGE.TANGENTS, 0, m, motion, context, island, scratch)
