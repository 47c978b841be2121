"""Kinematics and moments of rolling contacts, and travel of the contact area; only in scenes with a law that needs them.

The relative rotation of the step is in the contact's plane, in the transported frame. It is conjugate to the moment: the work of
the pair (M on the owner, -M on the partner) is M . (w_i - w_j) dt. A plate does not rotate. The part about the normal goes to
laws of the twisting stage only: with the normal of the middle of the step, so that its work is exact to second order.
"""

import numpy as np
from numba import njit

from thirdbody.jit.options import BARE
from thirdbody.kernels.contact_geometry import read_vector
from thirdbody.kernels.plates import is_plate, is_sphere, partner_velocity, surface_velocity
from thirdbody.kernels.tables import record, sphere
from thirdbody.kernels.tile import TILE, geometry, law_input, law_output, rolling_input, rolling_output

MOMENTS = 2  # value of `rolling` in a scene with a rolling law; 1: a law requests the travel only, 0: neither

TWIST = 4
"""Added to `rolling` in a scene with a twisting law. Without a rolling law the moments about the tangential axes are zero."""


def record_width(rolling):
    return record.TWIST_WIDTH if rolling >= TWIST else record.ROLLING_WIDTH if rolling >= MOMENTS else record.WIDTH


@njit(**BARE)
def has_moments(context):
    return context.rolling >= MOMENTS


@njit(**BARE)
def has_twist(context):
    return context.rolling >= TWIST


@njit(**BARE)
def relative_spin(S, i, j, column):
    if is_plate(j):
        return S[i, column], S[i, column + 1], S[i, column + 2]
    return S[i, column] - S[j, column], S[i, column + 1] - S[j, column + 1], S[i, column + 2] - S[j, column + 2]


@njit(**BARE)
def component(q, field, v, G):
    x, y, z = read_vector(G, q + field * TILE)
    return v[0] * x + v[1] * y + v[2] * z


@njit(**BARE)
def gather_rolling(q, k, context, motion, tile):
    i, j, S, dt = context.own[k], context.partner[k], context.S, motion.dt
    I, G, at = tile.inputs, tile.geometry, (law_input.HISTORY + context.n_history) * TILE + q  # noqa: E741
    w = relative_spin(S, i, j, np.int64(sphere.MID_SPIN))
    I[at + rolling_input.ROTATION_X * TILE] = component(q, np.int64(geometry.AXIS), w, G) * dt
    I[at + rolling_input.ROTATION_Y * TILE] = component(q, np.int64(geometry.CROSS_AXIS), w, G) * dt
    if has_twist(context):
        I[at + rolling_input.TWIST * TILE] = dt * component(q, np.int64(geometry.MID_NORMAL), w, G)
    w = relative_spin(S, i, j, np.int64(sphere.END_SPIN))
    if has_twist(context):
        I[at + rolling_input.TWIST_RATE * TILE] = component(q, np.int64(geometry.NORMAL), w, G)
    I[at + rolling_input.RATE_X * TILE] = component(q, np.int64(geometry.AXIS), w, G)
    I[at + rolling_input.RATE_Y * TILE] = component(q, np.int64(geometry.CROSS_AXIS), w, G)
    # mean velocity of the contact point less that of the material on both sides; the point lies on the line of centres; under a
    # sphere on a plate it moves with the sphere
    n_x, n_y, n_z = read_vector(G, q + geometry.NORMAL * TILE)
    a_i, a_j = G[q + geometry.ARM * TILE], G[q + geometry.PARTNER_ARM * TILE]
    columns = np.int64(sphere.MID_VELOCITY), np.int64(sphere.MID_SPIN)  # not literals: callees would be compiled once more
    b_x, b_y, b_z = partner_velocity(j, context, columns, (a_j * n_x, a_j * n_y, a_j * n_z), motion)
    a_x, a_y, a_z = surface_velocity(i, S, columns, (-a_i * n_x, -a_i * n_y, -a_i * n_z))
    fraction, p_x, p_y, p_z = 0.0, 0.0, 0.0, 0.0
    if is_sphere(j):
        fraction = S[i, sphere.RADIUS] / (S[i, sphere.RADIUS] + S[j, sphere.RADIUS])
        p_x, p_y, p_z = S[j, sphere.MID_VELOCITY], S[j, sphere.MID_VELOCITY + 1], S[j, sphere.MID_VELOCITY + 2]
    c_x = (1.0 - fraction) * S[i, sphere.MID_VELOCITY] + fraction * p_x - 0.5 * (a_x + b_x)
    c_y = (1.0 - fraction) * S[i, sphere.MID_VELOCITY + 1] + fraction * p_y - 0.5 * (a_y + b_y)
    c_z = (1.0 - fraction) * S[i, sphere.MID_VELOCITY + 2] + fraction * p_z - 0.5 * (a_z + b_z)
    c = c_x, c_y, c_z
    I[at + rolling_input.TRAVEL_X * TILE] = component(q, np.int64(geometry.AXIS), c, G) * dt
    I[at + rolling_input.TRAVEL_Y * TILE] = component(q, np.int64(geometry.CROSS_AXIS), c, G) * dt


@njit(**BARE)
def add_moments(n, context, tile):
    O, G = tile.outputs, tile.geometry  # noqa: E741
    for q in range(n):
        at = (law_output.HISTORY + context.n_history) * TILE + q
        m_1, m_2 = O[at + rolling_output.MOMENT_X * TILE], O[at + rolling_output.MOMENT_Y * TILE]
        for d in range(3):
            moment = m_1 * G[q + (geometry.AXIS + d) * TILE] + m_2 * G[q + (geometry.CROSS_AXIS + d) * TILE]
            G[q + (geometry.TORQUE + d) * TILE] += moment
            G[q + (geometry.PARTNER_TORQUE + d) * TILE] -= moment
            if has_twist(context):
                moment = O[at + rolling_output.TWIST_MOMENT * TILE] * G[q + (geometry.NORMAL + d) * TILE]
                G[q + (geometry.TORQUE + d) * TILE] += moment
                G[q + (geometry.PARTNER_TORQUE + d) * TILE] -= moment


@njit(**BARE)
def record_rolling(q, k, context, tile):
    R, O, G, at = context.R, tile.outputs, tile.geometry, (law_output.HISTORY + context.n_history) * TILE + q  # noqa: E741
    for d in range(3):
        R[k, record.MOMENT + d] = (
            O[at + rolling_output.MOMENT_X * TILE] * G[q + (geometry.AXIS + d) * TILE]
            + O[at + rolling_output.MOMENT_Y * TILE] * G[q + (geometry.CROSS_AXIS + d) * TILE]
        )
    R[k, record.MOMENT_LIMIT] = O[at + rolling_output.MOMENT_LIMIT * TILE]
    if has_twist(context):
        R[k, record.TWIST_MOMENT] = O[at + rolling_output.TWIST_MOMENT * TILE]
        R[k, record.TWIST_LIMIT] = O[at + rolling_output.TWIST_LIMIT * TILE]
