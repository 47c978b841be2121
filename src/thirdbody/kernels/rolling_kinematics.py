"""What a contact's moment, or a law whose history belongs to the rolling material, needs of the engine, and only where a scene
names one: a pass over a tile before the law and, for moments, one after it, so that the loop of all other scenes is untouched.

The relative rotation of the step lies in the contact's plane, in the carried frame. It is conjugate to the moment: the work
of the pair (M on the owner, -M on the partner) is M . (w_i - w_j) dt, none for two bodies that turn as one. A plate does not
turn. The part about the normal (pivoting) is left out.
"""

import numpy as np
from numba import njit

from thirdbody.jit.options import BARE
from thirdbody.kernels.layout import (
    G_ARM_I,
    G_ARM_J,
    G_D,
    G_E,
    G_N,
    G_TI,
    G_TJ,
    I_HISTORY,
    J_RATE_X,
    J_RATE_Y,
    J_TRAVEL_X,
    J_TRAVEL_Y,
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
)
from thirdbody.kernels.surface_velocity import partner_velocity, surface_velocity

MOMENTS = 2
"""Value of `rolling` in a scene with moments; 1: a law asks for the travel only, 0: nothing of this."""


@njit(**BARE)
def relative_spin(S, i, j, column):
    """Angular velocity of the owner's body relative to the partner's, from a column of the table of spheres."""
    if j < 0:
        return S[i, column], S[i, column + 1], S[i, column + 2]
    return (
        S[i, column] - S[j, column], S[i, column + 1] - S[j, column + 1], S[i, column + 2] - S[j, column + 2],
    )  # fmt: skip


@njit(**BARE)
def travel(i, j, q, S, P, G, v_x, v_y):
    """Velocity of the patch over the two surfaces, their mean, along the frame's axes: of the contact point less the material's.

    The contact point lies on the line of centres; under a ball on a plate it moves with the ball.
    """
    n_x, n_y, n_z = G[q + G_N * TILE], G[q + (G_N + 1) * TILE], G[q + (G_N + 2) * TILE]
    u, w = np.int64(S_U), np.int64(S_W)  # not literals, for which the callees would be compiled once more
    a_i, a_j = G[q + G_ARM_I * TILE], G[q + G_ARM_J * TILE]
    b_x, b_y, b_z = partner_velocity(S, P, j, u, w, a_j * n_x, a_j * n_y, a_j * n_z, v_x, v_y)
    a_x, a_y, a_z = surface_velocity(S, i, u, w, -a_i * n_x, -a_i * n_y, -a_i * n_z)
    fraction = 0.0
    p_x, p_y, p_z = 0.0, 0.0, 0.0
    if j >= 0:
        fraction = S[i, S_R] / (S[i, S_R] + S[j, S_R])
        p_x, p_y, p_z = S[j, S_U], S[j, S_U + 1], S[j, S_U + 2]
    c_x = (1.0 - fraction) * S[i, S_U] + fraction * p_x - 0.5 * (a_x + b_x)
    c_y = (1.0 - fraction) * S[i, S_U + 1] + fraction * p_y - 0.5 * (a_y + b_y)
    c_z = (1.0 - fraction) * S[i, S_U + 2] + fraction * p_z - 0.5 * (a_z + b_z)
    along = c_x * G[q + G_E * TILE] + c_y * G[q + (G_E + 1) * TILE] + c_z * G[q + (G_E + 2) * TILE]
    across = c_x * G[q + G_D * TILE] + c_y * G[q + (G_D + 1) * TILE] + c_z * G[q + (G_D + 2) * TILE]
    return along, across


@njit(**BARE)
def gather_rolling(q, k, own, partner, S, P, dt, v_x, v_y, I, G, n_history):  # noqa: E741
    """Put the relative rotation of the step and its rate at the end of the step, about the frame's axes, and the travel of the
    patch into the tile."""
    i, j = own[k], partner[k]
    at = (I_HISTORY + n_history) * TILE + q
    w_x, w_y, w_z = relative_spin(S, i, j, np.int64(S_W))
    I[at + J_X * TILE] = (w_x * G[q + G_E * TILE] + w_y * G[q + (G_E + 1) * TILE] + w_z * G[q + (G_E + 2) * TILE]) * dt
    I[at + J_Y * TILE] = (w_x * G[q + G_D * TILE] + w_y * G[q + (G_D + 1) * TILE] + w_z * G[q + (G_D + 2) * TILE]) * dt
    w_x, w_y, w_z = relative_spin(S, i, j, np.int64(S_O))
    I[at + J_RATE_X * TILE] = w_x * G[q + G_E * TILE] + w_y * G[q + (G_E + 1) * TILE] + w_z * G[q + (G_E + 2) * TILE]
    I[at + J_RATE_Y * TILE] = w_x * G[q + G_D * TILE] + w_y * G[q + (G_D + 1) * TILE] + w_z * G[q + (G_D + 2) * TILE]
    along, across = travel(i, j, q, S, P, G, v_x, v_y)
    I[at + J_TRAVEL_X * TILE], I[at + J_TRAVEL_Y * TILE] = along * dt, across * dt


@njit(**BARE)
def add_moments(n, O, G, n_history):  # noqa: E741
    """Add the moments of n contacts to the torques: M on the owner's body, -M on the partner's."""
    for q in range(n):
        at = (O_HISTORY + n_history) * TILE + q
        m_1, m_2 = O[at + Q_X * TILE], O[at + Q_Y * TILE]
        for d in range(3):
            moment = m_1 * G[q + (G_E + d) * TILE] + m_2 * G[q + (G_D + d) * TILE]
            G[q + (G_TI + d) * TILE] += moment
            G[q + (G_TJ + d) * TILE] -= moment


@njit(**BARE)
def record_rolling(q, k, O, G, R, n_history):  # noqa: E741
    """The moment on the owner's body, world axes, and its limit, for output."""
    at = (O_HISTORY + n_history) * TILE + q
    for d in range(3):
        R[k, R_M + d] = O[at + Q_X * TILE] * G[q + (G_E + d) * TILE] + O[at + Q_Y * TILE] * G[q + (G_D + d) * TILE]
    R[k, R_M_LIMIT] = O[at + Q_LIMIT * TILE]
