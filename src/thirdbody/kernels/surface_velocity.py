"""Velocities of surfaces at a contact."""

from numba import njit

from thirdbody.jit.options import BARE
from thirdbody.kernels.columns import patch
from thirdbody.kernels.predicates import is_lower, is_upper, patch_of_partner


@njit(**BARE)
def surface_velocity(S, i, v, w, r_x, r_y, r_z):
    """Return the velocity of sphere i's surface at the arm r from its centre [m/s]. v, w: columns of the table."""
    o_x, o_y, o_z = S[i, w], S[i, w + 1], S[i, w + 2]
    return (
        S[i, v] + o_y * r_z - o_z * r_y, S[i, v + 1] + o_z * r_x - o_x * r_z, S[i, v + 2] + o_x * r_y - o_y * r_x,
    )  # fmt: skip


@njit(**BARE)
def partner_velocity(S, P, j, v, w, r_x, r_y, r_z, v_x, v_y):
    """Return the velocity of the partner's surface [m/s]. v_x, v_y: of the upper plate."""
    if is_lower(j):
        return 0.0, 0.0, 0.0
    if is_upper(j):
        return v_x, v_y, P[patch_of_partner(j), patch.VELOCITY]
    return surface_velocity(S, j, v, w, r_x, r_y, r_z)
