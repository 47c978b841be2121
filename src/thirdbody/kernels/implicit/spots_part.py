"""The interaction of the spots of a body (`close_spots`) in an implicit step: the part `spots_part` of it (`workspace.PART`).

The relieved overlaps x = d - g N(x) change by dx = (1 + g W)^-1 dd, with the stiffness W_i = dN_i/dx_i of the spots. `jacobian`
takes dx = dd; here the difference -g W dx is added, times the change of force and torque per relieved overlap. Left out is the
change of the forces along the plate, smaller by the order of overlap over distance.
"""

import math

from numba import njit

from thirdbody.jit.options import BARE, BARE_CHUNK, NO_COUNTS, POINTED, entry
from thirdbody.kernels import plates
from thirdbody.kernels.close_spots import add_interaction_energy, relieve, restore, spots_of
from thirdbody.kernels.implicit.contact import cross
from thirdbody.kernels.implicit.residual import contact_point, frame_of
from thirdbody.kernels.implicit.workspace import FREEDOMS, GATHER, PART, PULL, RELIEVE, RESTORE, TANGENTS, space_at
from thirdbody.kernels.plates import is_lower, is_upper
from thirdbody.kernels.spot_loads import NEAR, SWEEPS, solve_body
from thirdbody.kernels.tables import sphere
from thirdbody.kernels.tile import TILE, contact_tangent, geometry

ACCURACY = 1e-9
"""Change of a relieved strain over the largest that ends the sweeps: of a tangent, not of a force."""


@njit(**BARE)
def stiffness_of(q, context, space):
    """Return the stiffness of spot q [N/m], from Hertz' force and its relieved overlap."""
    G = space.geometry
    depth = plates.overlap(space.slots[q], context) - G[q + geometry.RELIEF * TILE]
    return 1.5 * G[q + geometry.SPOT_FORCE * TILE] / depth if depth > 0.0 else 0.0


@njit(**BARE)
def strain_of(q, context, space):
    """Return the change of the overlap of contact q with the seven coordinates, rotations in rad (`contact`)."""
    k, G = space.slots[q], space.geometry
    n = frame_of(q, G)[0]
    x, y, z = cross(contact_point(q, context.own[k], context.S, G), n)
    return -n[0], -n[1], -n[2], -x, -y, -z, n[2] if is_upper(context.partner[k]) else 0.0


@njit(**BARE)
def compliance_between(p, q, context, space):
    """Return g of two contacts with plates [m/N]; 0 on two sides."""
    i, j, partner = context.own[space.slots[p]], context.own[space.slots[q]], context.partner
    low = is_lower(partner[space.slots[p]])
    if low != is_lower(partner[space.slots[q]]):
        return 0.0
    S = context.S
    apart = math.hypot(S[i, sphere.ARM] - S[j, sphere.ARM], S[i, sphere.ARM + 1] - S[j, sphere.ARM + 1])
    return context.interaction[0 if low else 1] / max(apart, NEAR * min(S[i, sphere.RADIUS], S[j, sphere.RADIUS]))


@njit(**BARE)
def reduced(x, factor, p, K):
    """Return the seven strains x less a factor times the relieved strains of contact p."""
    a = contact_tangent.RELIEVED * TILE + p
    return (
        x[0] - factor * K[a], x[1] - factor * K[a + TILE], x[2] - factor * K[a + 2 * TILE], x[3] - factor * K[a + 3 * TILE],
        x[4] - factor * K[a + 4 * TILE], x[5] - factor * K[a + 5 * TILE], x[6] - factor * K[a + 6 * TILE],
    )  # fmt: skip


@njit(**BARE_CHUNK)
def relieved_strains(m, context, space):
    """Write the changes of the relieved overlaps of m contacts with the coordinates into the tile."""
    K, at = space.tangents, contact_tangent.RELIEVED * TILE
    for q in range(m):
        strain = strain_of(q, context, space)
        for c in range(FREEDOMS):
            K[at + c * TILE + q] = strain[c]
    for _ in range(SWEEPS if m > 1 else 0):
        change, size = 0.0, 0.0
        for q in range(m):
            strain = strain_of(q, context, space)
            for p in range(m):
                g = compliance_between(p, q, context, space) if p != q else 0.0
                if g > 0.0:
                    strain = reduced(strain, g * stiffness_of(p, context, space), p, K)
            for c in range(FREEDOMS):
                change = max(change, abs(strain[c] - K[at + c * TILE + q]))
                size = max(size, abs(strain[c]))
                K[at + c * TILE + q] = strain[c]
        if change < ACCURACY * size:
            break


@njit(**BARE_CHUNK)
def add_interaction(m, context, space):
    """Add what the interaction of the m spots in the tile changes to the Jacobian."""
    J, K = space.jacobian, space.tangents
    relieved_strains(m, context, space)
    for q in range(m):
        (n, e, g), k = frame_of(q, space.geometry), space.slots[q]
        w, t_1, t_2 = stiffness_of(q, context, space), K[contact_tangent.XD * TILE + q], K[contact_tangent.YD * TILE + q]
        f = (
            w * n[0] + t_1 * e[0] + t_2 * g[0], w * n[1] + t_1 * e[1] + t_2 * g[1], w * n[2] + t_1 * e[2] + t_2 * g[2],
        )  # fmt: skip
        torque, strain = cross(contact_point(q, context.own[k], context.S, space.geometry), f), strain_of(q, context, space)
        for c in range(FREEDOMS):
            change = K[(contact_tangent.RELIEVED + c) * TILE + q] - strain[c]
            for d in range(3):
                J[FREEDOMS * d + c] += f[d] * change
                J[FREEDOMS * (3 + d) + c] += torque[d] * change
            if is_upper(context.partner[k]):
                J[FREEDOMS * 6 + c] -= f[2] * change


@njit(**BARE)
def add_spot_pull(q, context, space):
    """Add the force along the plate on the spot of contact q (`close_spots`), at the centre of its sphere, to the residual."""
    i, S, G, r = context.own[space.slots[q]], context.S, space.geometry, space.residual
    f_x, f_y = G[q + geometry.PULL * TILE], G[q + (geometry.PULL + 1) * TILE]
    x, y, z = S[i, sphere.ARM], S[i, sphere.ARM + 1], S[i, sphere.ARM + 2]
    r[0] += f_x
    r[1] += f_y
    r[3] -= z * f_y
    r[4] += z * f_x
    r[5] += x * f_y - y * f_x


@entry(PART, **POINTED, **NO_COUNTS)
def spots_part(stage, _, a, m, motion, context, islands, scratch):
    """Do what a stage of a step requires for the m spots of the body at position a of an island."""
    space = space_at(a, scratch)
    if stage == GATHER:
        solve_body(m, space.slots, context, spots_of(space))
    elif stage == RELIEVE:
        relieve(m, space)
    elif stage == RESTORE:
        restore(m, space)
    elif stage == PULL:
        add_interaction_energy(m, space)
        for q in range(m):
            add_spot_pull(q, context, space)
    elif stage == TANGENTS:
        add_interaction(m, context, space)
