"""What a contact's moment needs of the engine, and only where a scene names a rolling law: one pass over a tile before the law
and one after it, so that the loop of all other scenes is untouched.

The relative rotation of the step lies in the contact's plane, in the carried frame. It is conjugate to the moment: the work
of the pair (M on the owner, -M on the partner) is M . (w_i - w_j) dt, none for two bodies that turn as one. A plate does not
turn. The part about the normal (pivoting) is left out.
"""

from numba import njit

from .layout import (
    F_TI,
    F_TJ,
    I_HISTORY,
    J_RATE_X,
    J_RATE_Y,
    J_X,
    J_Y,
    O_HISTORY,
    Q_LIMIT,
    Q_X,
    Q_Y,
    R_M,
    R_M_LIMIT,
    S_O,
    S_W,
    TILE,
)  # fmt: skip
from .options import INNER


@njit(**INNER)
def relative_spin(S, i, j, column):
    """Angular velocity of the owner's body relative to the partner's, from a column of the table of spheres."""
    if j < 0:
        return S[i, column], S[i, column + 1], S[i, column + 2]
    return (
        S[i, column] - S[j, column], S[i, column + 1] - S[j, column + 1], S[i, column + 2] - S[j, column + 2],
    )  # fmt: skip


@njit(**INNER)
def stage_rolling(q, k, own, partner, S, dt, I, G, n_history):  # noqa: E741
    """Put the relative rotation of the step and its rate at the end of the step, about the frame's axes, into the tile."""
    i, j = own[k], partner[k]
    at = (I_HISTORY + n_history) * TILE + q
    w_x, w_y, w_z = relative_spin(S, i, j, S_W)
    I[at + J_X * TILE] = (w_x * G[q, 3] + w_y * G[q, 4] + w_z * G[q, 5]) * dt
    I[at + J_Y * TILE] = (w_x * G[q, 6] + w_y * G[q, 7] + w_z * G[q, 8]) * dt
    w_x, w_y, w_z = relative_spin(S, i, j, S_O)
    I[at + J_RATE_X * TILE] = w_x * G[q, 3] + w_y * G[q, 4] + w_z * G[q, 5]
    I[at + J_RATE_Y * TILE] = w_x * G[q, 6] + w_y * G[q, 7] + w_z * G[q, 8]


@njit(**INNER)
def apply_rolling(q, k, partner, O, G, F, n_history):  # noqa: E741
    """Add the moment of place q to the torques of slot k: M on the owner's body, -M on the partner's."""
    at = (O_HISTORY + n_history) * TILE + q
    m_1, m_2 = O[at + Q_X * TILE], O[at + Q_Y * TILE]
    for d in range(3):
        m = m_1 * G[q, 3 + d] + m_2 * G[q, 6 + d]
        F[k, F_TI + d] += m
        if partner[k] >= 0:
            F[k, F_TJ + d] -= m


@njit(**INNER)
def record_rolling(q, k, O, G, R, n_history):  # noqa: E741
    """The moment on the owner's body, world axes, and its limit, for output."""
    at = (O_HISTORY + n_history) * TILE + q
    for d in range(3):
        R[k, R_M + d] = O[at + Q_X * TILE] * G[q, 3 + d] + O[at + Q_Y * TILE] * G[q, 6 + d]
    R[k, R_M_LIMIT] = O[at + Q_LIMIT * TILE]
