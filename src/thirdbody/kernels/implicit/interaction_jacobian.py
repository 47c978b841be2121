"""What the interaction of the spots of a body (`close_spots`) adds to the Jacobian of an implicit step.

The relieved overlaps x = d - g N(x) change by dx = (1 + g W)^-1 dd, with the stiffness W_i = dN_i/dx_i of the spots. `jacobian`
takes dx = dd; here the difference -g W dx is added, times the change of force and torque per relieved overlap. Left out is the
change of the forces along the plate, smaller by the order of overlap over distance.
"""

from numba import njit

from thirdbody.jit.options import BARE, BARE_CHUNK
from thirdbody.kernels import first_body
from thirdbody.kernels.close_spots import ACCURACY, SWEEPS, compliance
from thirdbody.kernels.columns import contact_tangent, geometry
from thirdbody.kernels.columns.tile import TILE
from thirdbody.kernels.implicit.bundles import FREEDOMS
from thirdbody.kernels.implicit.residual import contact_point, frame_of
from thirdbody.kernels.predicates import is_upper


@njit(**BARE)
def cross(a, b):
    """Return the cross product."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@njit(**BARE)
def stiffness_of(q, context, space):
    """Return the stiffness of spot q [N/m], from Hertz' force and its relieved overlap."""
    G = space.tile.geometry
    depth = first_body.overlap(space.slots[q], context) - G[q + geometry.RELIEF * TILE]
    return 1.5 * G[q + geometry.SPOT_FORCE * TILE] / depth if depth > 0.0 else 0.0


@njit(**BARE)
def strain_of(q, context, space):
    """Return the change of the overlap of contact q with the seven coordinates, rotations in rad (`jacobian.add_contact`)."""
    k, G = space.slots[q], space.tile.geometry
    n = frame_of(q, G)[0]
    x, y, z = cross(contact_point(q, context.own[k], context.S, G), n)
    return -n[0], -n[1], -n[2], -x, -y, -z, n[2] if is_upper(context.partner[k]) else 0.0


@njit(**BARE_CHUNK)
def relieved_strains(m, context, space):
    """Write the changes of the relieved overlaps of m contacts with the coordinates into the tile."""
    K = space.tile.tangents
    for q in range(m):
        strain = strain_of(q, context, space)
        for c in range(FREEDOMS):
            K[(contact_tangent.RELIEVED + c) * TILE + q] = strain[c]
    for _ in range(SWEEPS if m > 1 else 0):
        change, size = 0.0, 0.0
        for q in range(m):
            strain = strain_of(q, context, space)
            for c in range(FREEDOMS):
                new, at = strain[c], (contact_tangent.RELIEVED + c) * TILE
                for p in range(m):
                    if p != q:
                        g = compliance(space.slots[q], space.slots[p], context)[0]
                        new -= g * stiffness_of(p, context, space) * K[at + p]
                change, size = max(change, abs(new - K[at + q])), max(size, abs(new))
                K[at + q] = new
        if change < ACCURACY * size:
            break


@njit(**BARE_CHUNK)
def add_interaction(m, context, space):
    """Add what the interaction of the m spots in the tile changes to the Jacobian."""
    J, K = space.jacobian, space.tile.tangents
    relieved_strains(m, context, space)
    for q in range(m):
        (n, e, g), k = frame_of(q, space.tile.geometry), space.slots[q]
        w, t_1, t_2 = stiffness_of(q, context, space), K[contact_tangent.XD * TILE + q], K[contact_tangent.YD * TILE + q]
        f = (
            w * n[0] + t_1 * e[0] + t_2 * g[0], w * n[1] + t_1 * e[1] + t_2 * g[1], w * n[2] + t_1 * e[2] + t_2 * g[2],
        )  # fmt: skip
        torque, strain = cross(contact_point(q, context.own[k], context.S, space.tile.geometry), f), strain_of(q, context, space)
        for c in range(FREEDOMS):
            change = K[(contact_tangent.RELIEVED + c) * TILE + q] - strain[c]
            for d in range(3):
                J[d, c] += f[d] * change
                J[3 + d, c] += torque[d] * change
            if is_upper(context.partner[k]):
                J[6, c] -= f[2] * change
