"""Any contact in the Jacobian: with a curved surface, or between bodies (`contact` has the theory).

All changes are linear in the displacements of surface and centre, so that their responses along three axes give all coordinates.
"""

from typing import NamedTuple

from numba import njit

from thirdbody.jit.options import BARE
from thirdbody.kernels.implicit.contact import Vector, cross, dot, product, scaled_sum


class Response(NamedTuple):
    """How a contact answers a small motion."""

    force: Vector
    """Change of the force on the owner, opposite to that on a partner that is a body."""
    torque: Vector
    """Change of the torque on the owner, about its centre of mass."""
    back: Vector
    """Change of the torque on the partner, about its own."""


@njit(**BARE)
def axis_of(k):
    """Return the unit vector along coordinate k."""
    return 1.0 if k == 0 else 0.0, 1.0 if k == 1 else 0.0, 1.0 if k == 2 else 0.0


@njit(**BARE)
def to_surface(s, contact):
    """Return the response to a displacement s of the surface, in which the frame stays."""
    (n, e, g), (k_n, xx, xy, yx, yy, xd, yd) = contact.frame, contact.tangent
    d, s_1, s_2 = -dot(n, s), dot(e, s), dot(g, s)
    df = scaled_sum(k_n * d, n, xx * s_1 + xy * s_2 + xd * d, e, yx * s_1 + yy * s_2 + yd * d, g)
    dm = scaled_sum(contact.rolling_tangent[4] * d, e, contact.rolling_tangent[5] * d, g, contact.twist_tangent[1] * d, n)
    arm = scaled_sum(0.5 * d, cross(n, contact.force), 0.0, n, 0.0, n)
    return Response(
        df,
        scaled_sum(1.0, cross(contact.owner.point, df), 1.0, arm, 1.0, dm),
        scaled_sum(-1.0, cross(contact.partner.point, df), 1.0, arm, -1.0, dm),
    )


@njit(**BARE)
def to_bend(c, contact):
    """Return the response to a displacement c of the centre beyond that of the surface: normal and effective radius change."""
    (n, e, g), (k_n, xx, xy, yx, yy, xd, yd) = contact.frame, contact.tangent
    dn, bent = product(contact.bend, c), dot(contact.gradient, c)
    turn, depth = cross(n, dn), 0.5 * contact.normal_force / k_n * bent if k_n > 0.0 else 0.0
    slip = scaled_sum(contact.displacement[0], n, contact.displacement[1], e, contact.displacement[2], g)
    s_1, s_2 = dot(slip, cross(turn, e)), dot(slip, cross(turn, g))
    df = scaled_sum(k_n * depth, n, xx * s_1 + xy * s_2 + xd * depth, e, yx * s_1 + yy * s_2 + yd * depth, g)
    df = scaled_sum(1.0, df, 1.0, cross(turn, contact.force), 0.0, n)
    arm, dm = cross(dn, contact.force), cross(turn, contact.moment)
    # the gradient force, which acts on the owner's centre; only rough plates have one
    size, changed = -0.5 * contact.energy, product(contact.gradient_change, c)
    dp = scaled_sum(0.5 * (contact.normal_force * dot(n, c) + size * bent), contact.gradient, size, changed, 0.0, n)
    torque = scaled_sum(1.0, cross(contact.owner.point, df), -contact.owner.arm, arm, 1.0, dm)
    return Response(
        scaled_sum(1.0, df, 1.0, dp, 0.0, n),
        scaled_sum(1.0, torque, 1.0, cross(contact.owner.centre, dp), 0.0, n),
        scaled_sum(-1.0, cross(contact.partner.point, df), -contact.partner.arm, arm, -1.0, dm),
    )


@njit(**BARE)
def to_spin(contact):
    """Return the response to a turn of a body about the normal, as it turns the frame."""
    (n, e, g), (_, xx, xy, yx, yy, _, _) = contact.frame, contact.tangent
    _, s_1, s_2 = contact.displacement
    df = scaled_sum(0.5 * (xx * s_2 - xy * s_1), e, 0.5 * (yx * s_2 - yy * s_1), g, 0.5, cross(n, contact.force))
    dm = cross(n, contact.moment)
    return Response(
        df,
        scaled_sum(1.0, cross(contact.owner.point, df), 0.5, dm, 0.0, n),
        scaled_sum(-1.0, cross(contact.partner.point, df), -0.5, dm, 0.0, n),
    )


@njit(**BARE)
def to_rotation(w, contact):
    """Return the moment (3,) that answers a rotation w of the owner relative to the partner."""
    n, e, g = contact.frame
    xx, xy, yx, yy, _, _ = contact.rolling_tangent
    x, y = dot(w, e), dot(w, g)
    return scaled_sum(xx * x + xy * y, e, yx * x + yy * y, g, contact.twist_tangent[0] * dot(w, n), n)


@njit(**BARE)
def weighted(v, responses):
    """Return the response to a displacement v from those to displacements along the three axes."""
    x, y, z = responses
    return Response(
        scaled_sum(v[0], x.force, v[1], y.force, v[2], z.force),
        scaled_sum(v[0], x.torque, v[1], y.torque, v[2], z.torque),
        scaled_sum(v[0], x.back, v[1], y.back, v[2], z.back),
    )


@njit(**BARE)
def response_to(s, c, turn, responses):
    """Return the response to displacements s and c of surface and centre, and a turn about the normal."""
    surface, bend, spin = weighted(s, responses[0]), weighted(c, responses[1]), responses[2]
    return Response(
        scaled_sum(1.0, surface.force, 1.0, bend.force, turn, spin.force),
        scaled_sum(1.0, surface.torque, 1.0, bend.torque, turn, spin.torque),
        scaled_sum(1.0, surface.back, 1.0, bend.back, turn, spin.back),
    )


@njit(**BARE)
def add_curved(contact, J, step, offset):
    """Add any contact to the Jacobian J (`jacobian`), coordinate by coordinate."""
    x, y, z = axis_of(0), axis_of(1), axis_of(2)
    responses = (
        (to_surface(x, contact), to_surface(y, contact), to_surface(z, contact)),
        (to_bend(x, contact), to_bend(y, contact), to_bend(z, contact)),
        to_spin(contact),
    )
    add_side(contact.owner, 1.0, responses, contact, J, step, offset)
    if contact.partner.row >= 0:
        add_side(contact.partner, -1.0, responses, contact, J, step, offset)
    elif contact.partner.lift >= 0:
        down = 0.0, 0.0, -1.0
        add_response(response_to(down, down, 0.0, responses), contact.partner.lift, 1.0, contact, J, step, offset)


@njit(**BARE)
def add_side(side, sign, responses, contact, J, step, offset):
    """Add the responses to the coordinates of the body of a side; `sign`: 1 owner, -1 partner.

    A displacement of a body moves surface and centre alike, a rotation w by w x r and w x a; it turns the frame, and the arm.
    """
    n, of_owner, of_partner = contact.frame[0], max(sign, 0.0), max(-sign, 0.0)
    pull = scaled_sum(1.0, contact.force, -0.5 * contact.energy, contact.gradient, 0.0, n)
    for k in range(3):
        w = axis_of(k)
        u, swing, moment = scaled_sum(sign, w, 0.0, n, 0.0, n), cross(w, side.centre), to_rotation(w, contact)
        add_response(response_to(u, u, 0.0, responses), side.row + k, 1.0, contact, J, step, offset)
        rotated = response_to(cross(u, side.point), cross(u, side.centre), dot(w, n), responses)
        torque = scaled_sum(1.0, rotated.torque, of_owner, cross(swing, pull), sign, moment)
        back = scaled_sum(1.0, rotated.back, -of_partner, cross(swing, contact.force), -sign, moment)
        add_response(Response(rotated.force, torque, back), side.row + 3 + k, side.scale, contact, J, step, offset)


@njit(**BARE)
def add_response(response, at, scale, contact, J, step, offset):
    """Add the response to one coordinate, column `at` of J, times `scale`."""
    owner, partner, (force, torque, back) = contact.owner, contact.partner, response
    for k in range(3):
        J[(owner.row + k) * step + at + offset] += scale * force[k]
        J[(owner.row + 3 + k) * step + at + offset] += scale * owner.scale * torque[k]
    if partner.row >= 0:
        for k in range(3):
            J[(partner.row + k) * step + at + offset] -= scale * force[k]
            J[(partner.row + 3 + k) * step + at + offset] += scale * partner.scale * back[k]
    elif partner.lift >= 0:
        J[partner.lift * step + at + offset] -= scale * force[2]
