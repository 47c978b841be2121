"""Velocities of surfaces at a contact."""

from numba import njit

from thirdbody.jit.options import BARE
from thirdbody.kernels import first_body
from thirdbody.kernels.predicates import is_plate


@njit(**BARE)
def surface_velocity(i, S, columns, arm):
    """Return the velocity of sphere i's surface at `arm` from its centre [m/s]. `columns`: of velocity and spin."""
    v, w = columns
    o_x, o_y, o_z = S[i, w], S[i, w + 1], S[i, w + 2]
    r_x, r_y, r_z = arm
    return S[i, v] + o_y * r_z - o_z * r_y, S[i, v + 1] + o_z * r_x - o_x * r_z, S[i, v + 2] + o_x * r_y - o_y * r_x


@njit(**BARE)
def partner_velocity(j, context, columns, arm, motion):
    """Return the velocity of the partner's surface at the contact [m/s]; arguments as for `surface_velocity`."""
    if is_plate(j):
        return first_body.velocity(j, context.P, motion)
    return surface_velocity(j, context.S, columns, arm)
