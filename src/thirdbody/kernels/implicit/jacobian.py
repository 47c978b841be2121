"""Jacobian of the residual of an implicit step (see `residual`), for first bodies of any shape.

A contact with the unit normal n and the axes e and g = n x e of its frame lies at r = a - A n from the centre of mass, where a is
the centre of the sphere and A = R - overlap/2. It acts on the body with the force f = N n + T_1 e + T_2 g and with the torque
r x f + M, where M = M_1 e + M_2 g. Let the centre of mass move by u and the body turn by w, and the patch of an upper contact
rise by h. Relative to the first body, the centre of the sphere then moves by c = u + w x a - h z, and its surface by
s = u + w x r - h z. To first order

    overlap and slip:   dd = -n.c = -n.s      ds_1 = e.s      ds_2 = g.s
    normal:             dn = H c, with a symmetric tensor H (`surface_contact.NORMAL_GRADIENT`); on planes H = 0
    frame:              turns by W = n x dn + (w.n/2) n: transported with the normal, turned about it by half the spin
    slip in the frame:  ds_1 += S.(W x e)     ds_2 += S.(W x g)    with the displacement S of the step
    force:              df = dN n + dT_1 e + dT_2 g + W x f,       moment alike
    effective radius:   d ln R_eff = G.c, which changes N and T_1, T_2 as an overlap of N/(2 dN/dd) d ln R_eff would do
    gradient force:     p = -U/2 G, at the centre of the sphere, with the energy U of the normal spring;
                        dp = -(N dd + U/2 G.c)/2 G - U/2 B c, with the derivative B of G (`surface_contact.GRADIENT_CHANGE`)
    arm:                dr = w x a + dd n/2 - A dn

and N, T_1, T_2, M_1, M_2 and the moment M_0 about n follow from the tangents of the laws. This is exact at the start of a step;
left out is what grows with the rotation in the step, and the change of a dashpot's normal velocity as the normal turns. On planes
G = 0 and dn = 0; the turning of the frame about its normal is left out there, too: Newton's method takes as many iterations
without, and a step costs 6 to 15 % less.
"""

from typing import NamedTuple

from numba import njit

from thirdbody.jit.arguments import function_at
from thirdbody.jit.options import BARE, BARE_CHUNK
from thirdbody.kernels import first_body
from thirdbody.kernels.close_spots import interact, relieve, restore
from thirdbody.kernels.contact_geometry import padded
from thirdbody.kernels.implicit.bundles import FREEDOMS
from thirdbody.kernels.implicit.interaction_jacobian import add_interaction
from thirdbody.kernels.implicit.planar_jacobian import add_planar_contact
from thirdbody.kernels.implicit.residual import (
    closed_fraction,
    contact_force,
    contact_moment,
    contact_point,
    depth_at,
    frame_of,
    inertia_of,
    vector_at,
)
from thirdbody.kernels.implicit.tables import step_start
from thirdbody.kernels.implicit.vector_algebra import cross, dot, product
from thirdbody.kernels.predicates import is_upper
from thirdbody.kernels.rolling_kinematics import has_moments, has_twist
from thirdbody.kernels.rough_plates import update_by
from thirdbody.kernels.signatures import LAW
from thirdbody.kernels.tables import body, patch, sphere, surface_contact
from thirdbody.kernels.tile import TILE, contact_tangent, geometry, law_input, law_output, rolling_output

tangents_at = function_at(LAW)

Vector = tuple[float, float, float]

NO_TANGENT = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


class Contact(NamedTuple):
    """A contact as the Jacobian sees it: forces and geometry at the end of the step, and tangents."""

    frame: tuple[Vector, Vector, Vector]
    """Normal and both axes."""
    centre: Vector
    """Centre of the sphere from the centre of mass [m]."""
    point: Vector
    """Contact point from there [m]."""
    arm: float
    """Distance of the contact point from the centre of the sphere [m]."""
    force: Vector
    moment: Vector
    normal_force: float
    energy: float
    """Energy of the normal spring [J]."""
    gradient: Vector
    """Gradient of the logarithm of the effective radius [1/m]."""
    gradient_change: tuple[float, float, float, float, float, float]
    """Change of that with the displacement of the sphere (`surface_contact.GRADIENT_CHANGE`) [1/m2]."""
    normal_gradient: tuple[float, float, float, float, float, float]
    """Change of the normal with the displacement of the sphere (`surface_contact.NORMAL_GRADIENT`) [1/m]."""
    displacement: Vector
    """Displacement of the step (3,) [m] along the normal and the axes of the frame."""
    tangent: tuple[float, float, float, float, float, float, float]
    """Change of N with the overlap, and of T_1, T_2 with the slip and the overlap (`columns.contact_tangent`)."""
    rolling: bool
    """Whether it has a moment; its tangents: change of M_1, M_2 with rotations about the axes and with the overlap."""
    rolling_tangent: tuple[float, float, float, float, float, float]
    twist_tangent: tuple[float, float]
    """Change of the moment about the normal with the rotation about it, and with the overlap."""
    upper: bool
    """Whether it is a contact with the upper plate."""


class Column(NamedTuple):
    """One coordinate of the body: what a contact sees as it changes (notation of this module)."""

    coordinate: int
    strain: Vector
    """Overlap d and slip s_1, s_2."""
    moved: Vector
    """Displacement c of the centre of the sphere."""
    swing: Vector
    """w x a"""
    spin: Vector
    """w along the normal and the axes."""


@njit(**BARE)
def assemble_jacobian(context, active, m, dt, coupled, space):
    """Write the Jacobian (7, 7) [N/m] of the residual for the m contacts in the tile.

    A patch of prescribed height has no equation, unless `coupled`: then the derivatives with respect to its height are included.
    """
    p, Z, P, J, tile = active.patch, active.start, context.P, space.jacobian, space.tile
    give_springs(m, context, tile)
    if interact(context):
        relieve(m, tile)
    tangents_at(context.tangents)(tile.inputs, tile.tangents, padded(m, context.n_history), context.pairs)
    if interact(context):
        restore(m, tile)
    for i in range(FREEDOMS):
        for j in range(FREEDOMS):
            J[i, j] = 0.0
    if first_body.is_rough(context):
        b = active.number
        update_by(context.surface_tangents, context.edges[b], context.edges[b + 1], context)
        add_rough_contacts(m, b, dt, context, space)
    else:
        for q in range(m):
            add_contact(contact_at(q, active.number, dt, context, False, space), False, J)
    if interact(context):
        add_interaction(m, context, space)
    subtract_inertia(context, active, dt, J)
    if P[p, patch.FREE] == 0.0 and not coupled:
        for k in range(6):
            J[6, k], J[k, 6] = 0.0, 0.0
        J[6, 6] = -1.0
    elif P[p, patch.FREE] != 0.0:
        rate = Z[step_start.NOW] / dt
        square = Z[step_start.MASS_FRACTION] * rate * rate
        J[6, 6] -= P[p, patch.DAMPING] * rate + P[p, patch.MASS] * square + P[p, patch.SPRING] + Z[step_start.TETHER_STIFFNESS]


@njit(**BARE)
def give_springs(m, context, tile):
    """Give the tangents the spring that the law has answered: a law with a field is not evaluated twice."""
    if context.dashpots < 0:
        return
    O, K = tile.outputs, tile.tangents  # noqa: E741
    behind = (law_output.HISTORY + context.n_history) * TILE
    for q in range(m):
        total, damped = law_output.TANGENTIAL_X * TILE + q, behind + rolling_output.VISCOUS_X * TILE + q
        K[contact_tangent.SPRING_X * TILE + q] = O[total] - O[damped]
        K[contact_tangent.SPRING_Y * TILE + q] = O[total + TILE] - O[damped + TILE]
        K[contact_tangent.SPRING_LIMIT * TILE + q] = O[law_output.FRICTION_LIMIT * TILE + q]


@njit(**BARE_CHUNK)
def add_rough_contacts(m, b, dt, context, space):
    """Add m contacts of body b, some of them with rough plates, to the Jacobian."""
    for q in range(m):
        contact = contact_at(q, b, dt, context, True, space)
        if is_curved(contact):
            add_contact(contact, True, space.jacobian)
        else:
            add_contact(contact, False, space.jacobian)


@njit(**BARE)
def subtract_inertia(context, active, dt, J):
    """Subtract inertia and spring of the body; scale rotations and torques with its arm."""
    b, Z, B = active.number, active.start, context.B
    arm = 1.0 / Z[step_start.ARM]
    xx, yy, zz, xy, xz, yz = inertia_of(b, context.E, context.orientations)
    rate = Z[step_start.NOW] / dt
    square = Z[step_start.MASS_FRACTION] * rate * rate
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
        J[k, k] -= Z[step_start.TETHER_STIFFNESS]


@njit(**BARE)
def is_curved(contact):
    """Return whether the normal of a contact turns as its sphere moves."""
    xx, yy, zz, xy, xz, yz = contact.normal_gradient
    return xx != 0.0 or yy != 0.0 or zz != 0.0 or xy != 0.0 or xz != 0.0 or yz != 0.0


@njit(**BARE)
def tensor_at(k, t, context):
    """Return the six columns from t on of candidate k: a symmetric tensor of `surface_contact`."""
    Q = context.Q
    return Q[k, t], Q[k, t + 1], Q[k, t + 2], Q[k, t + 3], Q[k, t + 4], Q[k, t + 5]


@njit(**BARE)
def gradient_at(k, context):
    """Return the gradient of the logarithm of the effective radius of candidate k (3,) [1/m]."""
    return first_body.three(context.Q, k, surface_contact.GRADIENT)


@njit(**BARE)
def contact_at(q, b, dt, context, rough, space):
    """Return contact q of body b as a `Contact`."""
    k, tile, G = space.slots[q], space.tile, space.tile.geometry
    i, upper = context.own[k], is_upper(context.partner[k])
    before = space.before[k - context.edges[b]]
    rolling, frame = has_moments(context), frame_of(q, G)
    fraction = closed_fraction(q, before, context, tile.inputs)
    displacement = (
        dt * dot(vector_at(q, geometry.MID_VELOCITY, G), frame[0]),
        tile.inputs[law_input.SLIP_X * TILE + q] / fraction,
        tile.inputs[law_input.SLIP_Y * TILE + q] / fraction,
    )
    return Contact(
        frame, (context.S[i, sphere.ARM], context.S[i, sphere.ARM + 1], context.S[i, sphere.ARM + 2]),
        contact_point(q, i, context.S, G), G[q + geometry.ARM * TILE], contact_force(q, tile),
        contact_moment(q, context, tile) if rolling else (0.0, 0.0, 0.0),
        tile.outputs[law_output.NORMAL_FORCE * TILE + q], tile.outputs[law_output.STORED_NORMAL * TILE + q],
        gradient_at(k, context) if rough else (0.0, 0.0, 0.0),
        tensor_at(k, surface_contact.GRADIENT_CHANGE, context) if rough else NO_TANGENT,
        tensor_at(k, surface_contact.NORMAL_GRADIENT, context) if rough else NO_TANGENT,
        displacement,
        tangent_at(q, before, context, tile), rolling, rolling_tangent_at(q, fraction, tile.tangents) if rolling else NO_TANGENT,
        twist_tangent_at(q, fraction, tile.tangents) if has_twist(context) else (0.0, 0.0), upper,
    )  # fmt: skip


@njit(**BARE)
def tangent_at(q, before, context, tile):
    """Return the tangents of contact q; `before`: overlap at the start of the step [m], negative: a gap."""
    K, I = tile.tangents, tile.inputs  # noqa: E741
    xx, xy = K[contact_tangent.XX * TILE + q], K[contact_tangent.XY * TILE + q]
    yx, yy = K[contact_tangent.YX * TILE + q], K[contact_tangent.YY * TILE + q]
    xd, yd = K[contact_tangent.XD * TILE + q], K[contact_tangent.YD * TILE + q]
    if before < 0.0:
        # the contact closes within the step: the fraction of the slip that counts grows with its overlap
        depth, fraction = depth_at(q, context, I), closed_fraction(q, before, context, I)
        growth = -before / ((depth - before) * (depth - before)) / fraction
        xd += (xx * I[law_input.SLIP_X * TILE + q] + xy * I[law_input.SLIP_Y * TILE + q]) * growth
        yd += (yx * I[law_input.SLIP_X * TILE + q] + yy * I[law_input.SLIP_Y * TILE + q]) * growth
        xx, xy, yx, yy = fraction * xx, fraction * xy, fraction * yx, fraction * yy
    return K[contact_tangent.NORMAL * TILE + q], xx, xy, yx, yy, xd, yd


@njit(**BARE)
def rolling_tangent_at(q, fraction, K):
    """Return the tangents of the moment of contact q; `fraction`: of the rotation that counts, as the contact was closed."""
    at = contact_tangent.ROLLING * TILE + q
    xx, xy, yx, yy = K[at], K[at + TILE], K[at + 2 * TILE], K[at + 3 * TILE]
    return fraction * xx, fraction * xy, fraction * yx, fraction * yy, K[at + 4 * TILE], K[at + 5 * TILE]


@njit(**BARE)
def twist_tangent_at(q, fraction, K):
    """Return the tangents of the moment of contact q about its normal; `fraction`: as in `rolling_tangent_at`."""
    at = contact_tangent.TWIST * TILE + q
    return fraction * K[at], K[at + TILE]


@njit(**BARE)
def add_contact(contact, curved, J):
    """Add a contact to J (rotations in rad). `curved`: as `is_curved`; a constant, so that planes cost nothing."""
    if not (curved or contact.rolling):
        add_planar_contact(contact, J)
        return
    n, e, g = contact.frame
    x, y, z = contact.centre
    rn, re, rg = cross(contact.point, n), cross(contact.point, e), cross(contact.point, g)
    none, about_x, about_y, about_z = (0.0, 0.0, 0.0), (0.0, -z, y), (z, 0.0, -x), (-y, x, 0.0)
    add_column(Column(0, (-n[0], e[0], g[0]), (1.0, 0.0, 0.0), none, none), contact, curved, J)
    add_column(Column(1, (-n[1], e[1], g[1]), (0.0, 1.0, 0.0), none, none), contact, curved, J)
    add_column(Column(2, (-n[2], e[2], g[2]), (0.0, 0.0, 1.0), none, none), contact, curved, J)
    add_column(Column(3, (-rn[0], re[0], rg[0]), about_x, about_x, (n[0], e[0], g[0])), contact, curved, J)
    add_column(Column(4, (-rn[1], re[1], rg[1]), about_y, about_y, (n[1], e[1], g[1])), contact, curved, J)
    add_column(Column(5, (-rn[2], re[2], rg[2]), about_z, about_z, (n[2], e[2], g[2])), contact, curved, J)
    if contact.upper:
        add_column(Column(6, (n[2], -e[2], -g[2]), (0.0, 0.0, -1.0), none, none), contact, curved, J)


@njit(**BARE)
def add_column(column, contact, curved, J):
    """Add the change of force and torque with one coordinate to J."""
    n, e, g = contact.frame
    d, s_1, s_2 = column.strain
    dn, w = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    if curved:
        dn, w, more_1, more_2 = frame_change(column, contact)
        s_1, s_2 = s_1 + more_1, s_2 + more_2
    k_n, xx, xy, yx, yy, xd, yd = contact.tangent
    equivalent = d
    if curved and k_n > 0.0:
        equivalent += 0.5 * contact.normal_force / k_n * dot(contact.gradient, column.moved)
    f_n = k_n * equivalent
    t_1, t_2 = xx * s_1 + xy * s_2 + xd * equivalent, yx * s_1 + yy * s_2 + yd * equivalent
    df = t_1 * e[0] + t_2 * g[0] + f_n * n[0], t_1 * e[1] + t_2 * g[1] + f_n * n[1], t_1 * e[2] + t_2 * g[2] + f_n * n[2]
    swing = column.swing
    dr = swing[0] + 0.5 * n[0] * d, swing[1] + 0.5 * n[1] * d, swing[2] + 0.5 * n[2] * d
    if curved:
        rotated, arm = cross(w, contact.force), contact.arm
        df = df[0] + rotated[0], df[1] + rotated[1], df[2] + rotated[2]
        dr = dr[0] - arm * dn[0], dr[1] - arm * dn[1], dr[2] - arm * dn[2]
    (x, y, z), f, c = contact.point, contact.force, column.coordinate
    J[0, c] += df[0]
    J[1, c] += df[1]
    J[2, c] += df[2]
    J[3, c] += y * df[2] - z * df[1] + dr[1] * f[2] - dr[2] * f[1]
    J[4, c] += z * df[0] - x * df[2] + dr[2] * f[0] - dr[0] * f[2]
    J[5, c] += x * df[1] - y * df[0] + dr[0] * f[1] - dr[1] * f[0]
    if contact.upper:
        J[6, c] -= df[2]
    if curved:
        add_gradient_column(column, contact, J)
    if contact.rolling:
        add_moment(column, w, contact, curved, J)


@njit(**BARE)
def add_gradient_column(column, contact, J):
    """Add the change of the gradient force, and of its torque, with one coordinate to J."""
    (x, y, z), (s_x, s_y, s_z), (g_x, g_y, g_z), c = contact.centre, column.swing, contact.gradient, column.coordinate
    size = -0.5 * contact.energy
    change = -0.5 * contact.normal_force * column.strain[0] + 0.5 * size * dot(contact.gradient, column.moved)
    b_x, b_y, b_z = product(contact.gradient_change, column.moved)
    p_x, p_y, p_z = change * g_x + size * b_x, change * g_y + size * b_y, change * g_z + size * b_z
    J[0, c] += p_x
    J[1, c] += p_y
    J[2, c] += p_z
    J[3, c] += y * p_z - z * p_y + size * (s_y * g_z - s_z * g_y)
    J[4, c] += z * p_x - x * p_z + size * (s_z * g_x - s_x * g_z)
    J[5, c] += x * p_y - y * p_x + size * (s_x * g_y - s_y * g_x)
    if contact.upper:
        J[6, c] -= p_z


@njit(**BARE)
def frame_change(column, contact):
    """Return change of the normal (3,), rotation of the frame (3,), and change of the slip along its axes, for one coordinate."""
    (n, e, g), half = contact.frame, 0.5 * column.spin[0]
    dn = product(contact.normal_gradient, column.moved)
    x, y, z = cross(n, dn)
    s_n, s_1, s_2 = contact.displacement
    w_e, w_g = -dot(dn, g), dot(dn, e)
    w = x + half * n[0], y + half * n[1], z + half * n[2]
    return dn, w, s_2 * half - s_n * w_g, s_n * w_e - s_1 * half


@njit(**BARE)
def add_moment(column, w, contact, curved, J):
    """Add the change of the moment with one coordinate to J; `w`: rotation of the frame."""
    (n, e, g), c, d, (rotation, rotation_1, rotation_2) = contact.frame, column.coordinate, column.strain[0], column.spin
    xx, xy, yx, yy, xd, yd = contact.rolling_tangent
    m_1 = xx * rotation_1 + xy * rotation_2 + xd * d
    m_2 = yx * rotation_1 + yy * rotation_2 + yd * d
    m_0 = contact.twist_tangent[0] * rotation + contact.twist_tangent[1] * d
    dm = m_1 * e[0] + m_2 * g[0] + m_0 * n[0], m_1 * e[1] + m_2 * g[1] + m_0 * n[1], m_1 * e[2] + m_2 * g[2] + m_0 * n[2]
    if curved:
        rotated = cross(w, contact.moment)
        dm = dm[0] + rotated[0], dm[1] + rotated[1], dm[2] + rotated[2]
    J[3, c] += dm[0]
    J[4, c] += dm[1]
    J[5, c] += dm[2]
