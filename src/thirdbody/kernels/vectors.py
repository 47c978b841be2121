"""Rotations as quaternions, and separations in a periodic domain; an axis of length 0 is not periodic."""

import math

import numpy as np
from numba import njit

from thirdbody.jit.options import BARE
from thirdbody.jit.simd import axis_times_quaternion, broadcast, broadcast_lane, extract, round_to_nearest
from thirdbody.kernels.arguments import Box
from thirdbody.kernels.tables import domain

NEARLY_UNIT = 5e-6
"""Largest difference of a squared length from 1 at which its root is computed by a series: the next term, 5/16 of the cube, is
4e-17."""


@njit(**BARE)
def matrix(w, x, y, z):
    return (
        1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y),
        2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x),
        2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y),
    )  # fmt: skip


@njit(**BARE)
def _to_body(w, x, y, z, v):
    a, b, c, d, e, f, g, h, i = matrix(w, x, y, z)
    return a * v[0] + d * v[1] + g * v[2], b * v[0] + e * v[1] + h * v[2], c * v[0] + f * v[1] + i * v[2]


@njit(**BARE)
def spin(q, angular_momentum, inertia):
    a, b, c, d, e, f, g, h, i = matrix(q[0], q[1], q[2], q[3])
    l_x, l_y, l_z = _to_body(q[0], q[1], q[2], q[3], angular_momentum)
    p_x, p_y, p_z = l_x / inertia[0], l_y / inertia[1], l_z / inertia[2]
    return a * p_x + b * p_y + c * p_z, d * p_x + e * p_y + f * p_z, g * p_x + h * p_y + i * p_z


@njit(**BARE)
def _about(w, x, y, z, angle):
    """Return the quaternion after a rotation about the body's own axis of x, with tan(angle/2) replaced by angle/2: it preserves
    length and reversibility. For the other axes permute the arguments cyclically."""
    s = 0.5 * angle
    c = 1.0 / math.sqrt(1.0 + s * s)
    s *= c
    return w * c - x * s, x * c + w * s, y * c + z * s, z * c - y * s


@njit(**BARE)
def free_rotation(q, angular_momentum, inertia, dt):
    """Return the orientation after dt with constant angular momentum: rotations about the principal axes 3, 2, 1, 2, 3, the
    splitting of Dullweber, Leimkuhler and McLachlan 1997 (Miller et al. 2002), second order and time-reversible."""
    (w, x, y, z), (i_x, i_y, i_z), momentum, half = q, inertia, angular_momentum, 0.5 * dt
    w, z, x, y = _about(w, z, x, y, half * _to_body(w, x, y, z, momentum)[2] / i_z)
    w, y, z, x = _about(w, y, z, x, half * _to_body(w, x, y, z, momentum)[1] / i_y)
    w, x, y, z = _about(w, x, y, z, dt * _to_body(w, x, y, z, momentum)[0] / i_x)
    w, y, z, x = _about(w, y, z, x, half * _to_body(w, x, y, z, momentum)[1] / i_y)
    w, z, x, y = _about(w, z, x, y, half * _to_body(w, x, y, z, momentum)[2] / i_z)
    return normalise((w, x, y, z))


@njit(**BARE)
def total(v):
    return extract(v, 0) + extract(v, 1) + extract(v, 2)


@njit(**BARE)
def rotate_small(q, r):
    """Return the unit quaternion q after a small rotation r, world axes. tan(r/2) is replaced by r/2 (error r^3/12)."""
    half = broadcast(0.5) * r
    new = (
        (q + broadcast_lane(half, 0) * axis_times_quaternion(q, 0)) + broadcast_lane(half, 1) * axis_times_quaternion(q, 1)
    ) + broadcast_lane(half, 2) * axis_times_quaternion(q, 2)
    squares = new * new
    longer = (extract(squares, 0) + extract(squares, 1)) + (extract(squares, 2) + extract(squares, 3)) - 1.0
    # most rotations are so small that three terms of 1/sqrt(1 + longer) are exact to the last digit: no root, no division
    s = 1.0 - longer * (0.5 - 0.375 * longer) if abs(longer) < NEARLY_UNIT else 1.0 / math.sqrt(1.0 + longer)
    return broadcast(s) * new


@njit(**BARE)
def rotate(q, x, y, z):
    size = math.sqrt(x * x + y * y + z * z)
    # sin(size/2)/size, without loss of digits at zero
    s = 0.5 * (1.0 - size * size / 24.0) if size < 1e-4 else math.sin(0.5 * size) / size
    w, a, b, c = math.cos(0.5 * size), s * x, s * y, s * z
    return normalise(
        (w * q[0] - a * q[1] - b * q[2] - c * q[3], w * q[1] + a * q[0] + b * q[3] - c * q[2],
         w * q[2] + b * q[0] + c * q[1] - a * q[3], w * q[3] + c * q[0] + a * q[2] - b * q[1])
    )  # fmt: skip


@njit(**BARE)
def normalise(q):
    s = 1.0 / math.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    return q[0] * s, q[1] * s, q[2] * s, q[3] * s


@njit(**BARE)
def nearest_image(d, length):
    return d - length * np.rint(d / length) if length > 0.0 else d


@njit(**BARE)
def inverse(length):
    """Return 1/length for `image`, 0 where the axis is not periodic."""
    return 1.0 / length if length > 0.0 else 0.0


@njit(**BARE)
def image(d, length, inverse):
    """Return the separation d to the nearest image, without division or branch. For loops over candidates."""
    return d - length * np.rint(d * inverse)


@njit(**BARE)
def images(d, length, inverse):
    return d - broadcast(length) * round_to_nearest(d * broadcast(inverse))


@njit(**BARE)
def box_of(D):
    l_x, l_y = max(D[domain.LENGTH_X], 0.0), max(D[domain.LENGTH_Y], 0.0)
    return Box(l_x, l_y, inverse(l_x), inverse(l_y), D[domain.REACH])
