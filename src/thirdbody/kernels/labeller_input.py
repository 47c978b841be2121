"""Input of a labeller: rows of the loaded contacts of a body, motion of body and plates."""

import numpy as np
from numba import njit

from thirdbody.jit.options import BARE
from thirdbody.kernels.columns import body, body_extra, contact_state, loaded_contact, observed_body, record, run_totals
from thirdbody.kernels.columns.sides import DEBRIS, LOWER, UPPER
from thirdbody.kernels.contact_history import labeller_column
from thirdbody.kernels.predicates import has_effect_columns, is_closed, is_lower, is_sphere
from thirdbody.kernels.rigid_body import BODIES


@njit(**BARE)
def contact_row(C, n, k, second, own, partner, H, R, memory_at):
    """Fill row n of a body's contact table from candidate k. `second`: the body is the partner, not the owner."""
    j = partner[k]
    sign = -1.0 if second else 1.0
    C[n, loaded_contact.PARTNER] = DEBRIS if is_sphere(j) else (LOWER if is_lower(j) else UPPER)
    for d in range(3):
        C[n, loaded_contact.POINT + d] = R[k, record.PARTNER_POINT + d] if second else R[k, record.POINT + d]
        C[n, loaded_contact.NORMAL + d] = sign * R[k, record.NORMAL + d]
        C[n, loaded_contact.TANGENTIAL_FORCE + d] = sign * R[k, record.TANGENTIAL_FORCE + d]
        C[n, loaded_contact.PARTNER_VELOCITY + d] = (
            R[k, record.SURFACE_VELOCITY + d] if second else R[k, record.PARTNER_VELOCITY + d]
        )
    C[n, loaded_contact.CURVATURE] = R[k, record.PARTNER_CURVATURE] if second else R[k, record.CURVATURE]
    C[n, loaded_contact.CONTACT_RADIUS] = R[k, record.CONTACT_RADIUS]
    C[n, loaded_contact.OVERLAP] = R[k, record.OVERLAP]
    C[n, loaded_contact.NORMAL_FORCE] = R[k, record.NORMAL_FORCE]
    C[n, loaded_contact.LOAD] = R[k, record.LOAD]
    C[n, loaded_contact.FRICTION_LIMIT] = R[k, record.FRICTION_LIMIT]
    C[n, loaded_contact.CRITICAL_SLIP] = R[k, record.CRITICAL_SLIP]
    C[n, loaded_contact.SLIP] = H[k, contact_state.SLIP] - contact_state.CLOSED
    # unique within the body: its own sphere and the partner, which is a plate (-1, -2) or a sphere
    here, there = (j, own[k]) if second else (own[k], max(j, -2))
    C[n, loaded_contact.IDENTITY] = here * 67108864.0 + there + 3.0
    for m in range(C.shape[1] - loaded_contact.MEMORY):
        C[n, loaded_contact.MEMORY + m] = H[k, memory_at + m]


@njit(**BARE)
def body_row(b, B, E, A, drag, speed, O):  # noqa: E741
    """Fill O with the state and the surroundings of body b."""
    O[observed_body.MASS] = B[b, body.MASS]
    for k in range(3):
        O[observed_body.POSITION + k] = B[b, body.POSITION + k]
        O[observed_body.VELOCITY + k] = B[b, body.VELOCITY + k]
        O[observed_body.SPIN + k] = B[b, body.SPIN + k]
        O[observed_body.FORCE + k], O[observed_body.TORQUE + k] = B[b, body.FORCE + k], B[b, body.TORQUE + k]
        # Newton's second law as the integrator applies it: the acceleration is the force of this instant
        O[observed_body.MOMENTUM_RATE + k] = B[b, body.FORCE + k]
        O[observed_body.ANGULAR_MOMENTUM_RATE + k] = B[b, body.TORQUE + k]
        O[observed_body.EFFECT_FORCE + k], O[observed_body.EFFECT_TORQUE + k] = (
            (E[b, body_extra.EFFECT_FORCE + k], E[b, body_extra.EFFECT_TORQUE + k]) if has_effect_columns(E) else (0.0, 0.0)
        )
    for k in range(4):
        O[observed_body.QUATERNION + k] = B[b, body.QUATERNION + k]
    O[observed_body.ELAPSED] = A[run_totals.ELAPSED]
    O[observed_body.PLATE_SHIFT] = A[run_totals.SHIFT_X]
    O[observed_body.PLATE_SHIFT + 1] = A[run_totals.SHIFT_Y]
    moved = A[run_totals.HEADING] != 0.0 or A[run_totals.HEADING + 1] != 0.0
    # the planned direction until the plates have moved; then that of their last motion, which a stroke reverses
    O[observed_body.DRAG] = A[run_totals.HEADING] if moved else drag[0]
    O[observed_body.DRAG + 1] = A[run_totals.HEADING + 1] if moved else drag[1]
    O[observed_body.PLATE_SPEED] = speed


@njit(**BARE)
def body_contacts(b, edges, incidence, own, partner, H, R, width, memory_at, C):
    """Fill the table C with the loaded contacts of body b, in the order of candidates; return their number."""
    n = np.int64(0)  # not the literal 0, for which the callees would be compiled once more
    for e in range(edges[b], edges[b + 1]):
        k = incidence[e] >> 1
        if is_closed(k, H):
            contact_row(
                C, n, k, incidence[e] & 1, own, partner, H, R, memory_at + (incidence[e] & 1) * (width - loaded_contact.MEMORY)
            )
            n += 1
    return n


@njit(**BARE)
def update_body_memory(b, edges, incidence, own, partner, H, R, B, E, A, M, drag, speed, n_history, width, observe, O, C):  # noqa: E741
    """Update the labeller's memory of body b and of its contacts by an observation. O and C are scratch."""
    result = body_contacts(b, edges, incidence, own, partner, H, R, width, labeller_column(n_history), C)
    body_row(b, B, E, A, drag, speed, O)
    observe(C[:result], result, O, M[b])
    n = 0
    for e in range(edges[b], edges[b + 1]):
        k = incidence[e] >> 1
        if is_closed(k, H):
            to = labeller_column(n_history) + (incidence[e] & 1) * (width - loaded_contact.MEMORY)
            for m in range(width - loaded_contact.MEMORY):
                H[k, to + m] = C[n, loaded_contact.MEMORY + m]
            n += 1


@njit(**BARE)
def update_memory(c, edges, incidence, own, partner, H, R, B, E, A, M, drag, speed, n_history, width, observe, O, C):  # noqa: E741
    """Update the labeller's memory of the bodies of chunk c. O and C are scratch."""
    for b in range(c * BODIES, min((c + 1) * BODIES, B.shape[0])):
        update_body_memory(b, edges, incidence, own, partner, H, R, B, E, A, M, drag, speed, n_history, width, observe, O, C)
