"""What a contact's moment, or a law whose history belongs to the rolling material, needs of the engine, and only where a scene
names one: a pass over a tile before the law and, for moments, one after it, so that the loop of all other scenes is untouched.

The relative rotation of the step lies in the contact's plane, in the carried frame. It is conjugate to the moment: the work
of the pair (M on the owner, -M on the partner) is M . (w_i - w_j) dt, none for two bodies that turn as one. A plate does not
turn. The part about the normal (pivoting) is left out.
"""

import math

from numba import njit

from .layout import (
    F_TI,
    F_TJ,
    I_HISTORY,
    J_RATE_X,
    J_RATE_Y,
    J_TRAVEL,
    J_X,
    J_Y,
    O_HISTORY,
    Q_LIMIT,
    Q_X,
    Q_Y,
    R_M,
    R_M_LIMIT,
    S_O,
    S_R,
    S_U,
    S_W,
    TILE,
)  # fmt: skip
from .options import INNER
from .surface import partner_velocity, surface_velocity

MOMENTS = 2
"""Value of `rolling` in a scene with moments; 1: a law asks for the travel only, 0: nothing of this."""


@njit(**INNER)
def relative_spin(S, i, j, column):
    """Angular velocity of the owner's body relative to the partner's, from a column of the table of spheres."""
    if j < 0:
        return S[i, column], S[i, column + 1], S[i, column + 2]
    return (
        S[i, column] - S[j, column], S[i, column + 1] - S[j, column + 1], S[i, column + 2] - S[j, column + 2],
    )  # fmt: skip


@njit(**INNER)
def travel(i, j, q, S, P, G, v_x, v_y):
    """Speed at which the patch wanders over the two surfaces, their mean: that of the contact point less the material's.

    The contact point lies on the line of centres; under a ball on a plate it moves with the ball.
    """
    n_x, n_y, n_z, a_i, a_j = G[q, 0], G[q, 1], G[q, 2], G[q, 9], G[q, 10]
    b_x, b_y, b_z = partner_velocity(S, P, j, S_U, S_W, a_j * n_x, a_j * n_y, a_j * n_z, v_x, v_y)
    a_x, a_y, a_z = surface_velocity(S, i, S_U, S_W, -a_i * n_x, -a_i * n_y, -a_i * n_z)
    share = 0.0
    p_x, p_y, p_z = 0.0, 0.0, 0.0
    if j >= 0:
        share = S[i, S_R] / (S[i, S_R] + S[j, S_R])
        p_x, p_y, p_z = S[j, S_U], S[j, S_U + 1], S[j, S_U + 2]
    c_x = (1.0 - share) * S[i, S_U] + share * p_x - 0.5 * (a_x + b_x)
    c_y = (1.0 - share) * S[i, S_U + 1] + share * p_y - 0.5 * (a_y + b_y)
    c_z = (1.0 - share) * S[i, S_U + 2] + share * p_z - 0.5 * (a_z + b_z)
    along = c_x * G[q, 3] + c_y * G[q, 4] + c_z * G[q, 5]
    across = c_x * G[q, 6] + c_y * G[q, 7] + c_z * G[q, 8]
    return math.sqrt(along * along + across * across)


@njit(**INNER)
def stage_rolling(q, k, own, partner, S, P, dt, v_x, v_y, I, G, n_history):  # noqa: E741
    """Put the relative rotation of the step and its rate at the end of the step, about the frame's axes, and the travel of the
    patch into the tile."""
    i, j = own[k], partner[k]
    at = (I_HISTORY + n_history) * TILE + q
    w_x, w_y, w_z = relative_spin(S, i, j, S_W)
    I[at + J_X * TILE] = (w_x * G[q, 3] + w_y * G[q, 4] + w_z * G[q, 5]) * dt
    I[at + J_Y * TILE] = (w_x * G[q, 6] + w_y * G[q, 7] + w_z * G[q, 8]) * dt
    w_x, w_y, w_z = relative_spin(S, i, j, S_O)
    I[at + J_RATE_X * TILE] = w_x * G[q, 3] + w_y * G[q, 4] + w_z * G[q, 5]
    I[at + J_RATE_Y * TILE] = w_x * G[q, 6] + w_y * G[q, 7] + w_z * G[q, 8]
    I[at + J_TRAVEL * TILE] = travel(i, j, q, S, P, G, v_x, v_y) * dt


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
