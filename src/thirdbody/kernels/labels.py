"""Labels: input of a labeller, rows of the loaded contacts of a body, motion of body and plates; and the labels of all bodies."""

import numpy as np
from numba import njit, types

from thirdbody.jit.arguments import PACKED, function_at
from thirdbody.jit.options import BARE, DIRECT, NO_COUNTS, POINTED, entry
from thirdbody.jit.simd import put
from thirdbody.kernels import tables
from thirdbody.kernels.arguments import LABEL, OBSERVE, OBSERVE_BODIES, observed_of
from thirdbody.kernels.bodies import rotate_behind
from thirdbody.kernels.plates import BASINS, has_effect_columns, is_lower, is_plate, is_sphere, is_touching, order_on_sphere
from thirdbody.kernels.tables import body, body_extra, contact_state, loaded_contact, observed_body, record, run_totals


@njit(**BARE)
def memory_column(second, context):
    """Return the column of the history where the labeller's memory of a contact begins. `second`: as the partner of the owner."""
    return max(contact_state.LAW + context.n_history, contact_state.MIN_WIDTH) + second * (context.width - loaded_contact.MEMORY)


@njit(**BARE)
def body_row(b, context, A, observed):
    B, E, drag = context.B, context.E, context.drag
    observed[observed_body.MASS] = B[b, body.MASS]
    for k in range(3):
        observed[observed_body.POSITION + k] = B[b, body.POSITION + k]
        observed[observed_body.VELOCITY + k] = B[b, body.VELOCITY + k]
        observed[observed_body.SPIN + k] = B[b, body.SPIN + k]
        observed[observed_body.FORCE + k], observed[observed_body.TORQUE + k] = B[b, body.FORCE + k], B[b, body.TORQUE + k]
        observed[observed_body.EFFECT_FORCE + k], observed[observed_body.EFFECT_TORQUE + k] = (
            (E[b, body_extra.EFFECT_FORCE + k], E[b, body_extra.EFFECT_TORQUE + k]) if has_effect_columns(E) else (0.0, 0.0)
        )
    put(observed, np.int64(observed_body.QUATERNION), rotate_behind(b, A[run_totals.BEHIND], B, context.orientations))
    observed[observed_body.ELAPSED] = A[run_totals.ELAPSED]
    observed[observed_body.PLATE_SHIFT] = A[run_totals.SHIFT_X]
    observed[observed_body.PLATE_SHIFT + 1] = A[run_totals.SHIFT_Y]
    moved = A[run_totals.HEADING] != 0.0 or A[run_totals.HEADING + 1] != 0.0
    # the planned direction until the plates have moved; then that of their last motion, which a stroke reverses
    observed[observed_body.DRAG] = A[run_totals.HEADING] if moved else drag[0]
    observed[observed_body.DRAG + 1] = A[run_totals.HEADING + 1] if moved else drag[1]
    observed[observed_body.PLATE_SPEED] = A[run_totals.PLATE_SPEED]


@njit(**BARE)
def body_contacts(b, context, C):
    """Fill the table C with the touching contacts of body b, in the order of candidates; return their number."""
    own, H, R, n = context.own, context.H, context.R, np.int64(0)
    for e in range(context.edges[b], context.edges[b + 1]):
        k, second = context.incidence[e] >> 1, context.incidence[e] & 1  # second: the body is the partner, not the owner
        if not is_touching(k, H, R):
            continue
        j = context.partner[k]
        sign = -1.0 if second else 1.0
        C[n, loaded_contact.PARTNER] = tables.DEBRIS if is_sphere(j) else (tables.LOWER if is_lower(j) else tables.UPPER)
        for d in range(3):
            C[n, loaded_contact.POINT + d] = R[k, record.PARTNER_POINT + d] if second else R[k, record.POINT + d]
            C[n, loaded_contact.NORMAL + d] = sign * R[k, record.NORMAL + d]
            C[n, loaded_contact.TANGENTIAL_FORCE + d] = sign * R[k, record.TANGENTIAL_FORCE + d]
            C[n, loaded_contact.PARTNER_VELOCITY + d] = (
                R[k, record.SURFACE_VELOCITY + d] if second else R[k, record.PARTNER_VELOCITY + d]
            )
        C[n, loaded_contact.SPHERE_RADIUS] = R[k, record.PARTNER_RADIUS] if second else R[k, record.SPHERE_RADIUS]
        for d in range(4):  # and overlap, normal force, load
            C[n, loaded_contact.CONTACT_RADIUS + d] = R[k, record.CONTACT_RADIUS + d]
        C[n, loaded_contact.FRICTION_LIMIT] = R[k, record.FRICTION_LIMIT]
        C[n, loaded_contact.CRITICAL_SLIP] = R[k, record.CRITICAL_SLIP]
        C[n, loaded_contact.SLIP] = H[k, contact_state.SLIP] - contact_state.CLOSED
        # unique within the body: its own sphere and the partner, which is a basin of a plate (-1, -2, ...) or a sphere
        here, there = (j, own[k]) if second else (own[k], -1 - order_on_sphere(j) if is_plate(j) else j)
        C[n, loaded_contact.IDENTITY] = here * 67108864.0 + there + (1.0 + 2.0 * BASINS)
        memory_at = memory_column(second, context)
        for m in range(C.shape[1] - loaded_contact.MEMORY):
            C[n, loaded_contact.MEMORY + m] = H[k, memory_at + m]
        n += 1
    return n


observe_at, label_at = function_at(OBSERVE), function_at(LABEL)


@entry(OBSERVE_BODIES, **POINTED, **NO_COUNTS)
def observe_bodies(first, last, context, A, observe, observed, C):
    """Update the labeller's memory of the bodies first to last - 1 and of their contacts. `observed`, C: scratch."""
    for b in range(first, last):
        n = body_contacts(b, context, C)
        body_row(b, context, A, observed)
        observe_at(observe)(C[:n], n, observed, context.M[b])
        n = 0
        for e in range(context.edges[b], context.edges[b + 1]):
            k = context.incidence[e] >> 1
            if is_touching(k, context.H, context.R):
                to = memory_column(context.incidence[e] & 1, context)
                for m in range(context.width - loaded_contact.MEMORY):
                    context.H[k, to + m] = C[n, loaded_contact.MEMORY + m]
                n += 1


_F2, _F1 = types.Array(types.float64, 2, "C"), types.Array(types.float64, 1, "C")


@entry(types.void(PACKED, _F1, types.int64, types.int64, _F2, _F1, _F2), nogil=True, **DIRECT, **NO_COUNTS)
def label_bodies(packed, A, observe, label, out, observed, table):
    """Compute state, reason, margins and extras of every body from the contacts that carry a load, with a copy of the labeller's
    memory. Scratch: `observed` (observed_body.WIDTH,), `table` (largest number of contacts of a body, width)."""
    context = observed_of(packed)
    for b in range(context.B.shape[0]):
        n, m = body_contacts(b, context, table), np.int64(0)
        body_row(b, context, A, observed)
        if A[run_totals.ELAPSED] > 0.0:
            observe_at(observe)(table[:n], n, observed, context.M[b])
        # where a sphere leaves a plate its dashpot can cancel the elastic force: the contact is closed, but carries nothing
        for i in range(n):
            if table[i, loaded_contact.NORMAL_FORCE] != 0.0 or table[i, loaded_contact.LOAD] > 0.0:
                for k in range(table.shape[1]):
                    table[m, k] = table[i, k]
                m += 1
        label_at(label)(table[:m], m, observed, context.M[b], out[b])
