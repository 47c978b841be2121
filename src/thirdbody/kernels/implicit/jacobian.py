"""Jacobian of the residual of an implicit step (see `residual`)."""

from numba import njit

from thirdbody.jit.options import INNER
from thirdbody.kernels.columns import body, contact_tangent, geometry, law_input, law_output, patch, sphere, step_start
from thirdbody.kernels.columns.tile import TILE
from thirdbody.kernels.implicit.residual import FREEDOMS, inertia_of
from thirdbody.kernels.predicates import is_upper
from thirdbody.kernels.rolling_kinematics import MOMENTS


@njit(**INNER)
def assemble_jacobian(b, p, m, dt, spots, state, known, work, Z, tangents, coupled, J):
    """Write the Jacobian J (7, 7) [N/m] of the residual for the m contacts in the tile.

    A patch of prescribed height has no equation, unless `coupled`: then the derivatives with respect to its height are included.
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
    arm = 1.0 / Z[step_start.ARM]
    xx, yy, zz, xy, xz, yz = inertia_of(b, B, E)
    rate = Z[step_start.NOW] / dt
    square = Z[step_start.MASS_SHARE] * rate * rate
    for k in range(3):
        J[k, k] -= B[b, body.MASS] * square
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
        J[k, k] -= Z[step_start.PULL]
    if P[p, patch.FREE] == 0.0 and not coupled:
        for k in range(6):
            J[6, k], J[k, 6] = 0.0, 0.0
        J[6, 6] = -1.0
    elif P[p, patch.FREE] != 0.0:
        J[6, 6] -= P[p, patch.DAMPING] * rate + P[p, patch.MASS] * square + P[p, patch.SPRING] + Z[step_start.PULL]


@njit(**INNER)
def add_contact_stiffness(q, slot, gap, own, partner, S, I, O, K, G, rolling, J):  # noqa: E741
    """Add contact q to J (rotations in rad): stiffness, rotation of its arm, change of its area."""
    i, up, n_z = own[slot], is_upper(partner[slot]), G[q + (geometry.NORMAL + 2) * TILE]
    a_x, a_y, a_z = S[i, sphere.ARM], S[i, sphere.ARM + 1], S[i, sphere.ARM + 2]
    x, y, z = a_x, a_y, a_z - G[q + geometry.ARM * TILE] * n_z
    e_x = G[q + geometry.AXIS * TILE]
    e_y = G[q + (geometry.AXIS + 1) * TILE]
    g_x = G[q + geometry.CROSS_AXIS * TILE]
    g_y = G[q + (geometry.CROSS_AXIS + 1) * TILE]
    n = O[law_output.NORMAL_FORCE * TILE + q]
    t_1 = O[law_output.TANGENTIAL_X * TILE + q]
    t_2 = O[law_output.TANGENTIAL_Y * TILE + q]
    f_x, f_y, f_z = t_1 * e_x + t_2 * g_x, t_1 * e_y + t_2 * g_y, n * n_z
    xx = K[contact_tangent.XX * TILE + q]
    xy = K[contact_tangent.XY * TILE + q]
    yx = K[contact_tangent.YX * TILE + q]
    yy = K[contact_tangent.YY * TILE + q]
    xd, yd = K[contact_tangent.XD * TILE + q], K[contact_tangent.YD * TILE + q]
    if gap < 0.0:
        # the contact closes within the step: the fraction of the slip that counts grows with its overlap
        overlap = I[law_input.OVERLAP * TILE + q]
        fraction = overlap / (overlap - gap)
        growth = -gap / ((overlap - gap) * (overlap - gap)) / fraction
        xd += (xx * I[law_input.SLIP_X * TILE + q] + xy * I[law_input.SLIP_Y * TILE + q]) * growth
        yd += (yx * I[law_input.SLIP_X * TILE + q] + yy * I[law_input.SLIP_Y * TILE + q]) * growth
        xx, xy, yx, yy = fraction * xx, fraction * xy, fraction * yx, fraction * yy
    for c in range(FREEDOMS):
        # derivatives of overlap, slip and arm
        d, s_1, s_2, u_x, u_y, u_z = contact_displacements(c, a_x, a_y, a_z, x, y, z, n_z, e_x, e_y, g_x, g_y, up)
        u_z += 0.5 * n_z * d
        f_n = K[contact_tangent.NORMAL * TILE + q] * d
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
    """Return derivatives by coordinate c: overlap, slip along both axes, arm of the sphere (3)."""
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
    """Add column c of the rolling moment (rotation about the axes of the frame) to J."""
    turn_1 = e_x if c == 3 else (e_y if c == 4 else 0.0)
    turn_2 = g_x if c == 3 else (g_y if c == 4 else 0.0)
    at = contact_tangent.ROLLING * TILE + q
    m_1 = K[at] * turn_1 + K[at + TILE] * turn_2 + K[at + 4 * TILE] * d
    m_2 = K[at + 2 * TILE] * turn_1 + K[at + 3 * TILE] * turn_2 + K[at + 5 * TILE] * d
    J[3, c] += m_1 * e_x + m_2 * g_x
    J[4, c] += m_1 * e_y + m_2 * g_y
