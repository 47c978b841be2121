"""A contact of two sides, as the Jacobian of an implicit step sees it: how its forces change with the coordinates of its bodies.

The contact has the unit normal n from its partner to its owner, and the axes e and g = n x e of its frame. It lies at
r = a - A n from the centre of mass of the owner's body, where a is the centre of the sphere and A = R - overlap/2, and at
r' = a' + A' n from that of the partner's, if that is a sphere. It acts on the owner with the force f = N n + T_1 e + T_2 g and
with the torque r x f + M, on the partner with -f and -r' x f - M. A plate is a side without coordinates of its own; a patch, or a
common plate, has its rise h. Let the body of a side move by u and turn by w. Relative to the partner, the centre of the owner's
sphere then moves by c = u + w x a and its surface by s = u + w x r; for the partner's body both are negative, with a' and r'; for
a plate that rises by h, c = s = -h z. To first order

    overlap and slip:   dd = -n.c             ds_1 = e.s      ds_2 = g.s
    normal:             dn = H c, with a symmetric tensor H: on planes 0, between spheres (1 - nn)/D with D = R + R' - overlap, on
                        rough plates `surface_contact.NORMAL_GRADIENT`
    frame:              turns by W = n x dn + (w.n/2) n: transported with the normal, turned about it by half the spin
    slip in the frame:  ds_1 += S.(W x e)     ds_2 += S.(W x g)    with the displacement S of the step
    force:              df = dN n + dT_1 e + dT_2 g + W x f,       moment alike, with the relative rotation
    effective radius:   d ln R_eff = G.c, which changes N and T_1, T_2 as an overlap of N/(2 dN/dd) d ln R_eff would do
    gradient force:     p = -U/2 G, at the centre of the owner's sphere, with the energy U of the normal spring;
                        dp = -(N dd + U/2 G.c)/2 G - U/2 B c, with the derivative B of G (`surface_contact.GRADIENT_CHANGE`)
    arms:               dr = w x a + dd n/2 - A dn              dr' = w x a' - dd n/2 + A' dn

and N, T_1, T_2, M_1, M_2 and the moment M_0 about n follow from the tangents of the laws. This is exact at the start of a step;
left out is what grows with the rotation in the step, and the change of a dashpot's normal velocity as the normal turns. G and B
are there on rough plates only. For contacts with planes, most of all contacts, the same is written by blocks of three columns;
the turning of the frame about its normal is left out there: Newton's method takes as many iterations without, and a step costs 6
to 15 % less.
"""

from typing import NamedTuple

import numpy as np
from numba import njit

from thirdbody.jit.options import BARE
from thirdbody.kernels.contact_geometry import read_vector
from thirdbody.kernels.implicit.workspace import FREEDOMS
from thirdbody.kernels.plates import is_upper, three
from thirdbody.kernels.rolling_kinematics import has_moments, has_twist
from thirdbody.kernels.tables import domain, sphere
from thirdbody.kernels.tile import TILE, contact_tangent, geometry, law_input, law_output, rolling_output


@njit(**BARE)
def cross(a, b):
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@njit(**BARE)
def dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@njit(**BARE)
def difference(a, b):
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@njit(**BARE)
def scaled_sum(x, a, y, b, z, c):
    return x * a[0] + y * b[0] + z * c[0], x * a[1] + y * b[1] + z * c[1], x * a[2] + y * b[2] + z * c[2]


@njit(**BARE)
def product(tensor, v):
    xx, yy, zz, xy, xz, yz = tensor
    x, y, z = v
    return xx * x + xy * y + xz * z, xy * x + yy * y + yz * z, xz * x + yz * y + zz * z


@njit(**BARE)
def depth_at(q, context, I):  # noqa: E741
    """Return the depth [m] of contact q, its overlap plus the reach, at the end of the step (`start_depths`: at the start)."""
    return I[law_input.OVERLAP * TILE + q] + context.D[domain.REACH]


@njit(**BARE)
def closed_fraction(q, start, context, I):  # noqa: E741
    """Return the fraction of the step in which contact q was within reach; `start`: depth at its start [m], < 0: not yet."""
    depth = depth_at(q, context, I)
    return depth / (depth - start) if start < 0.0 else 1.0


@njit(**BARE)
def vector_at(q, field, G):
    return read_vector(G, q + field * TILE)


@njit(**BARE)
def frame_of(q, G):
    return vector_at(q, geometry.NORMAL, G), vector_at(q, geometry.AXIS, G), vector_at(q, geometry.CROSS_AXIS, G)


@njit(**BARE)
def contact_force(q, tile):
    n, (normal, e, g) = tile.outputs[law_output.NORMAL_FORCE * TILE + q], frame_of(q, tile.geometry)
    t_1, t_2 = tile.outputs[law_output.TANGENTIAL_X * TILE + q], tile.outputs[law_output.TANGENTIAL_Y * TILE + q]
    return scaled_sum(n, normal, t_1, e, t_2, g)


@njit(**BARE)
def contact_point(q, i, S, G):
    n, a = vector_at(q, geometry.NORMAL, G), G[q + geometry.ARM * TILE]
    return S[i, sphere.ARM] - a * n[0], S[i, sphere.ARM + 1] - a * n[1], S[i, sphere.ARM + 2] - a * n[2]


@njit(**BARE)
def contact_moment(q, context, tile):
    at = (law_output.HISTORY + context.n_history) * TILE + q
    m_1, m_2 = tile.outputs[at + rolling_output.MOMENT_X * TILE], tile.outputs[at + rolling_output.MOMENT_Y * TILE]
    n, e, g = frame_of(q, tile.geometry)
    x, y, z = m_1 * e[0] + m_2 * g[0], m_1 * e[1] + m_2 * g[1], m_1 * e[2] + m_2 * g[2]
    if has_twist(context):
        twist = tile.outputs[at + rolling_output.TWIST_MOMENT * TILE]
        x, y, z = x + twist * n[0], y + twist * n[1], z + twist * n[2]
    return x, y, z


Vector = tuple[float, float, float]
Tensor = tuple[float, float, float, float, float, float]  # symmetric: xx, yy, zz, xy, xz, yz

NOWHERE, ZERO_TENSOR = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
PLANE = ZERO_TENSOR, NOWHERE, ZERO_TENSOR  # shape of a plane: bend, gradient and its change


class Side(NamedTuple):
    row: int  # first row and column of its body in the equations; -1: a plate, which has none
    lift: int  # row and column of the rise of a plate; -1: a body, or a plate at rest
    scale: float  # one over the arm of the body [1/m], if rotations are scaled in the equations; else 1
    centre: Vector  # of the sphere, from the centre of mass [m]
    point: Vector  # of the contact, from there [m]
    arm: float  # distance of the contact point from the centre of the sphere [m]


class ContactOfSides(NamedTuple):
    """A contact: forces and geometry at the end of the step, and tangents."""

    owner: Side
    partner: Side
    frame: tuple[Vector, Vector, Vector]  # normal and both axes
    force: Vector
    moment: Vector
    displacement: Vector  # of the step, along the normal and the axes of the frame [m]
    tangent: tuple[float, float, float, float, float, float, float]
    """Change of N with the overlap, and of T_1, T_2 with the slip and the overlap (`contact_tangent`)."""
    rolling_tangent: Tensor  # change of M_1, M_2 with rotations about the axes and with the overlap; zero without moments
    twist_tangent: tuple[float, float]  # change of the moment about the normal with the rotation about it, and with the overlap
    bend: Tensor  # H [1/m]
    normal_force: float
    energy: float  # of the normal spring [J]
    gradient: Vector  # G [1/m]
    gradient_change: Tensor  # B [1/m2]


@njit(**BARE)
def contact_of(q, dt, sides, shape, context, tile):
    """Return contact q of a tile; `shape`: bend, gradient and its change."""
    I, K, frame, start = tile.inputs, tile.tangents, frame_of(q, tile.geometry), context.start_depths[tile.slots[q]]  # noqa: E741
    fraction = closed_fraction(q, start, context, I)
    s_1, s_2, moments = I[law_input.SLIP_X * TILE + q], I[law_input.SLIP_Y * TILE + q], has_moments(context)
    displacement = dt * dot(vector_at(q, geometry.MID_VELOCITY, tile.geometry), frame[0]), s_1 / fraction, s_2 / fraction
    xx, xy = K[contact_tangent.XX * TILE + q], K[contact_tangent.XY * TILE + q]
    yx, yy = K[contact_tangent.YX * TILE + q], K[contact_tangent.YY * TILE + q]
    xd, yd = K[contact_tangent.XD * TILE + q], K[contact_tangent.YD * TILE + q]
    if start < 0.0:
        # the contact closes within the step: the fraction of the slip that counts grows with its overlap
        depth = depth_at(q, context, I)
        growth = -start / ((depth - start) * (depth - start)) / fraction
        xd += (xx * s_1 + xy * s_2) * growth
        yd += (yx * s_1 + yy * s_2) * growth
        xx, xy, yx, yy = fraction * xx, fraction * xy, fraction * yx, fraction * yy
    # rotations count from when the contact closed
    at, of_twist = contact_tangent.ROLLING * TILE + q, contact_tangent.TWIST * TILE + q
    rolling = (
        fraction * K[at], fraction * K[at + TILE], fraction * K[at + 2 * TILE], fraction * K[at + 3 * TILE],
        K[at + 4 * TILE], K[at + 5 * TILE],
    )  # fmt: skip
    return ContactOfSides(
        sides[0], sides[1], frame, contact_force(q, tile), contact_moment(q, context, tile) if moments else NOWHERE, displacement,
        (K[contact_tangent.NORMAL * TILE + q], xx, xy, yx, yy, xd, yd), rolling if moments else ZERO_TENSOR,
        (fraction * K[of_twist], K[of_twist + TILE]) if has_twist(context) else (0.0, 0.0), shape[0],
        tile.outputs[law_output.NORMAL_FORCE * TILE + q], tile.outputs[law_output.STORED_NORMAL * TILE + q], shape[1], shape[2],
    )  # fmt: skip


@njit(**BARE)
def owner_side(q, i, row, scale, S, G):
    return Side(row, -1, scale, three(S, i, sphere.ARM), contact_point(q, i, S, G), G[q + geometry.ARM * TILE])


@njit(**BARE)
def plate_contact(q, dt, shape, context, space):
    """Return contact q of a body, with a plate, in the equations of this body alone; `shape`: see `contact_of`."""
    k = space.slots[q]
    owner = owner_side(q, context.own[k], np.int64(0), 1.0, context.S, space.geometry)
    sides = owner, Side(-1, 6 if is_upper(context.partner[k]) else -1, 1.0, NOWHERE, NOWHERE, 0.0)
    return contact_of(q, dt, sides, shape, context, space)


@njit(**BARE)
def moment_rows(r, rows, p, arm):
    """Return the rows of r x A - p arm, where `rows` are those of A."""
    x, y, z = r
    first, second = scaled_sum(y, rows[2], -z, rows[1], -p[0], arm), scaled_sum(z, rows[0], -x, rows[2], -p[1], arm)
    return first, second, scaled_sum(x, rows[1], -y, rows[0], -p[2], arm)


@njit(**BARE)
def add_planar(contact, J):
    """Add the forces of a contact with a plane to the Jacobian of its body, J (7, 7), flat; rotations in rad.

    The force on the body changes with the displacement s of its surface by the tensor A, and s = u + w x r:

        df/du = A                        df/dw: rows r x A_i
        dt/du = r x A - p n              dt/dw = r x df/dw - p (r x n) + a f - (a.f) 1        with p = n x f/2

    from dt = r x df + dr x f and dr = w x a + dd n/2, where the overlap changes by dd = -n.s."""
    (n, e, g), (k_n, xx, xy, yx, yy, xd, yd) = contact.frame, contact.tangent
    r, f, a = contact.owner.point, contact.force, contact.owner.centre
    t_1, t_2 = scaled_sum(xx, e, xy, g, -xd, n), scaled_sum(yx, e, yy, g, -yd, n)
    a_1, a_2 = scaled_sum(e[0], t_1, g[0], t_2, -k_n * n[0], n), scaled_sum(e[1], t_1, g[1], t_2, -k_n * n[1], n)
    A = a_1, a_2, scaled_sum(e[2], t_1, g[2], t_2, -k_n * n[2], n)
    force_by_rotation = cross(r, A[0]), cross(r, A[1]), cross(r, A[2])
    x, y, z = cross(n, f)
    p, along_arm = (0.5 * x, 0.5 * y, 0.5 * z), dot(a, f)
    torque_by_displacement, torque_by_rotation = moment_rows(r, A, p, n), moment_rows(r, force_by_rotation, p, cross(r, n))
    for i in range(3):
        force, torque = FREEDOMS * i, FREEDOMS * (3 + i)
        for k in range(3):
            J[force + k] += A[i][k]
            J[force + 3 + k] += force_by_rotation[i][k]
            J[torque + k] += torque_by_displacement[i][k]
            J[torque + 3 + k] += torque_by_rotation[i][k]
            J[torque + 3 + k] += a[i] * f[k]
        J[torque + 3 + i] -= along_arm
    if contact.partner.lift >= 0:
        # the patch rises: the body moves down relative to it, and the opposite force acts on it
        for i in range(3):
            J[FREEDOMS * i + 6] -= A[i][2]
            J[FREEDOMS * (3 + i) + 6] -= torque_by_displacement[i][2]
            J[FREEDOMS * 6 + i] -= A[2][i]
            J[FREEDOMS * 6 + 3 + i] -= force_by_rotation[2][i]
        J[FREEDOMS * 6 + 6] += A[2][2]


@njit(**BARE)
def add_plane(contact, context, J):
    """Add a contact with a plane to the Jacobian of its body, J (7, 7), flat; moments change with rotation w and overlap d: dM =
    M w + m dd        with dd = -n.(u + w x r)"""
    add_planar(contact, J)
    if not has_moments(context):
        return
    (n, e, g), (xx, xy, yx, yy, xd, yd) = contact.frame, contact.rolling_tangent
    twist, by_overlap = contact.twist_tangent
    m, along = scaled_sum(xd, e, yd, g, by_overlap, n), cross(contact.owner.point, n)
    x, y = scaled_sum(xx, e, xy, g, 0.0, n), scaled_sum(yx, e, yy, g, 0.0, n)
    for i in range(3):
        row = scaled_sum(e[i], x, g[i], y, twist * n[i], n)
        for k in range(3):
            J[FREEDOMS * (3 + i) + k] -= m[i] * n[k]
            J[FREEDOMS * (3 + i) + 3 + k] += row[k] - m[i] * along[k]
        if contact.partner.lift >= 0:
            J[FREEDOMS * (3 + i) + 6] += m[i] * n[2]
