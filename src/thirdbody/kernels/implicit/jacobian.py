"""How the unbalanced forces of a trial step change with its coordinates (see `residual`): the matrix of Newton's method."""

from numba import njit

from thirdbody.jit.options import INNER
from thirdbody.kernels.implicit.residual import FREEDOMS, Z_ARM, Z_MASS, Z_NOW, Z_PULL, inertia_of
from thirdbody.kernels.layout import (
    B_MASS,
    G_ARM_I,
    G_D,
    G_E,
    G_N,
    I_OVERLAP,
    I_SX,
    I_SY,
    K_NORMAL,
    K_ROLL,
    K_XD,
    K_XX,
    K_XY,
    K_YD,
    K_YX,
    K_YY,
    O_FN,
    O_TX,
    O_TY,
    P_DAMPING,
    P_FREE,
    P_MASS,
    P_SPRING,
    S_ARM,
    TILE,
)
from thirdbody.kernels.rolling_kinematics import MOMENTS


@njit(**INNER)
def assemble_jacobian(b, p, m, dt, spots, state, known, work, Z, tangents, coupled, J):
    """J (7, 7): how the unbalanced forces change with the coordinates, at the spots as staged.

    A patch whose height is prescribed has no equation of its own, unless `coupled` asks how the forces change with its height.
    """
    own, partner, _, edges, _ = spots
    S, B, P, _, _, E = state
    pairs, rolling = known[0], known[3]
    I, O, K, G, slots, before = work[0], work[1], work[2], work[3], work[4], work[5]  # noqa: E741
    tangents(I, K, m, pairs)
    for i in range(FREEDOMS):
        for j in range(FREEDOMS):
            J[i, j] = 0.0
    for q in range(m):
        add_contact_stiffness(q, slots[q], before[slots[q] - edges[b]], own, partner, S, I, O, K, G, rolling, J)
    arm = 1.0 / Z[Z_ARM]
    xx, yy, zz, xy, xz, yz = inertia_of(b, B, E)
    rate = Z[Z_NOW] / dt
    square = Z[Z_MASS] * rate * rate
    for k in range(3):
        J[k, k] -= B[b, B_MASS] * square
    J[3, 3] -= xx * square
    J[4, 4] -= yy * square
    J[5, 5] -= zz * square
    J[3, 4] -= xy * square
    J[4, 3] -= xy * square
    J[3, 5] -= xz * square
    J[5, 3] -= xz * square
    J[4, 5] -= yz * square
    J[5, 4] -= yz * square
    for i in range(FREEDOMS):
        for k in range(3, 6):
            J[i, k] *= arm
    for k in range(3, 6):
        for j in range(FREEDOMS):
            J[k, j] *= arm
    for k in range(6):
        J[k, k] -= Z[Z_PULL]
    if P[p, P_FREE] == 0.0 and not coupled:
        for k in range(6):
            J[6, k], J[k, 6] = 0.0, 0.0
        J[6, 6] = -1.0
    elif P[p, P_FREE] != 0.0:
        J[6, 6] -= P[p, P_DAMPING] * rate + P[p, P_MASS] * square + P[p, P_SPRING] + Z[Z_PULL]


@njit(**INNER)
def add_contact_stiffness(q, slot, gap, own, partner, S, I, O, K, G, rolling, J):  # noqa: E741
    """Add the spot at place q of the tile to J, with rotations in radians: stiffness, turn of its arm, growth of its patch."""
    i, up, n_z = own[slot], partner[slot] < -1, G[q + (G_N + 2) * TILE]
    a_x, a_y, a_z = S[i, S_ARM], S[i, S_ARM + 1], S[i, S_ARM + 2]
    x, y, z = a_x, a_y, a_z - G[q + G_ARM_I * TILE] * n_z
    e_x, e_y, g_x, g_y = G[q + G_E * TILE], G[q + (G_E + 1) * TILE], G[q + G_D * TILE], G[q + (G_D + 1) * TILE]
    n, t_1, t_2 = O[O_FN * TILE + q], O[O_TX * TILE + q], O[O_TY * TILE + q]
    f_x, f_y, f_z = t_1 * e_x + t_2 * g_x, t_1 * e_y + t_2 * g_y, n * n_z
    xx, xy, yx, yy = K[K_XX * TILE + q], K[K_XY * TILE + q], K[K_YX * TILE + q], K[K_YY * TILE + q]
    xd, yd = K[K_XD * TILE + q], K[K_YD * TILE + q]
    if gap < 0.0:
        # the share of the slip grows with the overlap that is reached
        overlap = I[I_OVERLAP * TILE + q]
        fraction = overlap / (overlap - gap)
        growth = -gap / ((overlap - gap) * (overlap - gap)) / fraction
        xd += (xx * I[I_SX * TILE + q] + xy * I[I_SY * TILE + q]) * growth
        yd += (yx * I[I_SX * TILE + q] + yy * I[I_SY * TILE + q]) * growth
        xx, xy, yx, yy = fraction * xx, fraction * xy, fraction * yx, fraction * yy
    for c in range(FREEDOMS):
        # overlap, slip and arm per coordinate
        d, s_1, s_2, u_x, u_y, u_z = contact_displacements(c, a_x, a_y, a_z, x, y, z, n_z, e_x, e_y, g_x, g_y, up)
        u_z += 0.5 * n_z * d
        f_n = K[K_NORMAL * TILE + q] * d
        d_1, d_2 = xx * s_1 + xy * s_2 + xd * d, yx * s_1 + yy * s_2 + yd * d
        d_x, d_y, d_z = d_1 * e_x + d_2 * g_x, d_1 * e_y + d_2 * g_y, f_n * n_z
        J[0, c] += d_x
        J[1, c] += d_y
        J[2, c] += d_z
        J[3, c] += y * d_z - z * d_y + u_y * f_z - u_z * f_y
        J[4, c] += z * d_x - x * d_z + u_z * f_x - u_x * f_z
        J[5, c] += x * d_y - y * d_x + u_x * f_y - u_y * f_x
        if up:
            J[6, c] -= d_z
        if rolling == MOMENTS:
            add_moment(q, c, d, e_x, e_y, g_x, g_y, K, J)


@njit(**INNER)
def contact_displacements(c, a_x, a_y, a_z, x, y, z, n_z, e_x, e_y, g_x, g_y, up):
    """Changes with coordinate c: overlap, slip along both axes of the frame, and the arm of the sphere (3)."""
    if c == 0:
        return 0.0, e_x, g_x, 0.0, 0.0, 0.0
    if c == 1:
        return 0.0, e_y, g_y, 0.0, 0.0, 0.0
    if c == 2:
        return -n_z, 0.0, 0.0, 0.0, 0.0, 0.0
    if c == 3:
        return -n_z * a_y, -e_y * z, -g_y * z, 0.0, -a_z, a_y
    if c == 4:
        return n_z * a_x, e_x * z, g_x * z, a_z, 0.0, -a_x
    if c == 5:
        return 0.0, e_y * x - e_x * y, g_y * x - g_x * y, -a_y, a_x, 0.0
    return (n_z if up else 0.0), 0.0, 0.0, 0.0, 0.0, 0.0


@njit(**INNER)
def add_moment(q, c, d, e_x, e_y, g_x, g_y, K, J):
    """Add the moment of a rolling law, which resists the rotation about the axes of the frame."""
    turn_1 = e_x if c == 3 else (e_y if c == 4 else 0.0)
    turn_2 = g_x if c == 3 else (g_y if c == 4 else 0.0)
    at = K_ROLL * TILE + q
    m_1 = K[at] * turn_1 + K[at + TILE] * turn_2 + K[at + 4 * TILE] * d
    m_2 = K[at + 2 * TILE] * turn_1 + K[at + 3 * TILE] * turn_2 + K[at + 5 * TILE] * d
    J[3, c] += m_1 * e_x + m_2 * g_x
    J[4, c] += m_1 * e_y + m_2 * g_y
