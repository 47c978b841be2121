"""What a labeller sees: one row per loaded contact of a body, the body's motion and that of the plates."""

import numpy as np
from numba import njit

from thirdbody.jit.options import BARE
from thirdbody.kernels.contact_history import labeller_column
from thirdbody.kernels.layout import (
    A_DX,
    A_DY,
    A_ELAPSED,
    A_HEADING,
    B_F,
    B_MASS,
    B_Q,
    B_T,
    B_V,
    B_W,
    B_X,
    C_A,
    C_CRITICAL,
    C_CURVATURE,
    C_FN,
    C_IDENTITY,
    C_LIMIT,
    C_LOAD,
    C_MEMORY,
    C_NORMAL,
    C_OVERLAP,
    C_PARTNER,
    C_POINT,
    C_SLIP,
    C_T,
    C_V,
    DEBRIS,
    E_EF,
    E_ET,
    H_LEAST,
    H_ON,
    H_SLIP,
    LOWER,
    O_DRAG,
    O_EF,
    O_ELAPSED,
    O_ET,
    O_F,
    O_LDOT,
    O_MA,
    O_MASS,
    O_Q,
    O_SHIFT,
    O_SPEED,
    O_T,
    O_V,
    O_W,
    O_X,
    R_A,
    R_CRITICAL,
    R_CURVATURE,
    R_CURVATURE_J,
    R_FN,
    R_LIMIT,
    R_LOAD,
    R_N,
    R_OVERLAP,
    R_POINT,
    R_POINT_J,
    R_T,
    R_VI,
    R_VJ,
    UPPER,
)
from thirdbody.kernels.rigid_body import BODIES


@njit(**BARE)
def contact_row(C, n, k, second, own, partner, H, R, memory_at):
    """Row n of a body's contact table from slot k, seen from the owner or from its partner (`second`)."""
    j = partner[k]
    sign = -1.0 if second else 1.0
    C[n, C_PARTNER] = DEBRIS if j >= 0 else (LOWER if j == -1 else UPPER)
    for d in range(3):
        C[n, C_POINT + d] = R[k, R_POINT_J + d] if second else R[k, R_POINT + d]
        C[n, C_NORMAL + d] = sign * R[k, R_N + d]
        C[n, C_T + d] = sign * R[k, R_T + d]
        C[n, C_V + d] = R[k, R_VI + d] if second else R[k, R_VJ + d]
    C[n, C_CURVATURE] = R[k, R_CURVATURE_J] if second else R[k, R_CURVATURE]
    C[n, C_A], C[n, C_OVERLAP], C[n, C_FN], C[n, C_LOAD] = R[k, R_A], R[k, R_OVERLAP], R[k, R_FN], R[k, R_LOAD]
    C[n, C_LIMIT], C[n, C_CRITICAL], C[n, C_SLIP] = R[k, R_LIMIT], R[k, R_CRITICAL], H[k, H_SLIP] - H_LEAST
    # unique within the body: its own sphere and the partner, which is a plate (-1, -2) or a sphere
    here, there = (j, own[k]) if second else (own[k], max(j, -2))
    C[n, C_IDENTITY] = here * 67108864.0 + there + 3.0
    for m in range(C.shape[1] - C_MEMORY):
        C[n, C_MEMORY + m] = H[k, memory_at + m]


@njit(**BARE)
def body_row(b, B, E, A, drag, speed, O):  # noqa: E741
    """Fill O with body b's state and its surroundings."""
    O[O_MASS] = B[b, B_MASS]
    for k in range(3):
        O[O_X + k], O[O_V + k], O[O_W + k] = B[b, B_X + k], B[b, B_V + k], B[b, B_W + k]
        O[O_F + k], O[O_T + k] = B[b, B_F + k], B[b, B_T + k]
        # Newton's second law as the integrator applies it: the acceleration is the force of this instant
        O[O_MA + k], O[O_LDOT + k] = B[b, B_F + k], B[b, B_T + k]
        O[O_EF + k], O[O_ET + k] = (E[b, E_EF + k], E[b, E_ET + k]) if E.shape[1] > E_EF else (0.0, 0.0)
    for k in range(4):
        O[O_Q + k] = B[b, B_Q + k]
    O[O_ELAPSED], O[O_SHIFT], O[O_SHIFT + 1] = A[A_ELAPSED], A[A_DX], A[A_DY]
    moved = A[A_HEADING] != 0.0 or A[A_HEADING + 1] != 0.0
    # the planned direction until the plates have moved; then that of their last motion, which a stroke reverses
    O[O_DRAG] = A[A_HEADING] if moved else drag[0]
    O[O_DRAG + 1] = A[A_HEADING + 1] if moved else drag[1]
    O[O_SPEED] = speed


@njit(**BARE)
def body_contacts(b, edges, incidence, own, partner, H, R, width, memory_at, C):
    """Fill the contact table C of body b; its rows are the loaded contacts in the order of their slots. Returns how many."""
    n = np.int64(0)  # not the literal 0, for which the callees would be compiled once more
    for e in range(edges[b], edges[b + 1]):
        k = incidence[e] >> 1
        if H[k, H_ON] != 0.0:
            contact_row(C, n, k, incidence[e] & 1, own, partner, H, R, memory_at + (incidence[e] & 1) * (width - C_MEMORY))
            n += 1
    return n


@njit(**BARE)
def update_body_memory(b, edges, incidence, own, partner, H, R, B, E, A, M, drag, speed, n_history, width, observe, O, C):  # noqa: E741
    """Let the labeller observe body b: it updates its memory per body and per contact. O and C are scratch."""
    result = body_contacts(b, edges, incidence, own, partner, H, R, width, labeller_column(n_history), C)
    body_row(b, B, E, A, drag, speed, O)
    observe(C[:result], result, O, M[b])
    n = 0
    for e in range(edges[b], edges[b + 1]):
        k = incidence[e] >> 1
        if H[k, H_ON] != 0.0:
            to = labeller_column(n_history) + (incidence[e] & 1) * (width - C_MEMORY)
            for m in range(width - C_MEMORY):
                H[k, to + m] = C[n, C_MEMORY + m]
            n += 1


@njit(**BARE)
def update_memory(c, edges, incidence, own, partner, H, R, B, E, A, M, drag, speed, n_history, width, observe, O, C):  # noqa: E741
    """Let the labeller observe the bodies of chunk c. O and C are scratch."""
    for b in range(c * BODIES, min((c + 1) * BODIES, B.shape[0])):
        update_body_memory(b, edges, incidence, own, partner, H, R, B, E, A, M, drag, speed, n_history, width, observe, O, C)
