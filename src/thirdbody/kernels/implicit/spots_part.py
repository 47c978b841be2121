"""The interaction of the spots of a body (`close_spots`) in an implicit step: the part `spots_part` of it (`workspace.PART`).

The relieved overlaps x = d - g N(x) change by dx = (1 + g W)^-1 dd, with the stiffness W_i = dN_i/dx_i of the spots. `jacobian`
takes dx = dd; here the difference -g W dx is added, times the change of force and torque per relieved overlap. Left out is the
change of the forces along the plate, smaller by the order of overlap over distance.
"""

import math

from numba import njit

from thirdbody.jit.options import BARE, BARE_CHUNK, NO_COUNTS, POINTED, entry
from thirdbody.kernels import plates
from thirdbody.kernels.close_spots import NEAR, SWEEPS, Spots, add_interaction_energy, relieve, restore, solve_bodies
from thirdbody.kernels.implicit.contact import contact_point, cross, frame_of, scaled_sum
from thirdbody.kernels.implicit.residual import add_force
from thirdbody.kernels.implicit.workspace import FREEDOMS, PART, STAGE, space_at
from thirdbody.kernels.plates import is_lower, is_upper
from thirdbody.kernels.tables import sphere
from thirdbody.kernels.tile import TILE, contact_tangent, geometry

ACCURACY = 1e-9  # change of a relieved strain over the largest that ends the sweeps: of a tangent, not of a force


@njit(**BARE)
def stiffness_of(q, context, space):
    """Return the stiffness of spot q [N/m], from Hertz' force and its relieved overlap."""
    G = space.geometry
    relieved = plates.overlap(space.slots[q], context) - G[q + geometry.RELIEF * TILE]
    return 1.5 * G[q + geometry.SPOT_FORCE * TILE] / relieved if relieved > 0.0 else 0.0


@njit(**BARE)
def strain_of(q, context, space):
    """Return the change of the overlap of contact q with the seven coordinates, rotations in rad (`contact`)."""
    k, G = space.slots[q], space.geometry
    n = frame_of(q, G)[0]
    x, y, z = cross(contact_point(q, context.own[k], context.S, G), n)
    return -n[0], -n[1], -n[2], -x, -y, -z, n[2] if is_upper(context.partner[k]) else 0.0


@njit(**BARE_CHUNK)
def relieved_strains(m, context, space):
    K, S, at = space.tangents, context.S, contact_tangent.RELIEVED * TILE
    for q in range(m):
        strain = strain_of(q, context, space)
        for c in range(FREEDOMS):
            K[at + c * TILE + q] = strain[c]
    for _ in range(SWEEPS if m > 1 else 0):
        change, size = 0.0, 0.0
        for q in range(m):
            strain = strain_of(q, context, space)
            for p in range(m):
                i, j = context.own[space.slots[p]], context.own[space.slots[q]]
                low = is_lower(context.partner[space.slots[p]])
                if p != q and low == is_lower(context.partner[space.slots[q]]):  # on one side
                    apart = math.hypot(S[i, sphere.ARM] - S[j, sphere.ARM], S[i, sphere.ARM + 1] - S[j, sphere.ARM + 1])
                    near = NEAR * min(S[i, sphere.RADIUS], S[j, sphere.RADIUS])
                    g = context.interaction[0 if low else 1] / max(apart, near)
                    x, w, k = strain, g * stiffness_of(p, context, space), at + p
                    strain = (
                        x[0] - w * K[k], x[1] - w * K[k + TILE], x[2] - w * K[k + 2 * TILE], x[3] - w * K[k + 3 * TILE],
                        x[4] - w * K[k + 4 * TILE], x[5] - w * K[k + 5 * TILE], x[6] - w * K[k + 6 * TILE],
                    )  # fmt: skip
            for c in range(FREEDOMS):
                change = max(change, abs(strain[c] - K[at + c * TILE + q]))
                size = max(size, abs(strain[c]))
                K[at + c * TILE + q] = strain[c]
        if change < ACCURACY * size:
            break


@njit(**BARE_CHUNK)
def add_interaction(m, context, space):
    J, K = space.jacobian, space.tangents
    relieved_strains(m, context, space)
    for q in range(m):
        (n, e, g), k = frame_of(q, space.geometry), space.slots[q]
        w, t_1, t_2 = stiffness_of(q, context, space), K[contact_tangent.XD * TILE + q], K[contact_tangent.YD * TILE + q]
        f = scaled_sum(w, n, t_1, e, t_2, g)
        torque, strain = cross(contact_point(q, context.own[k], context.S, space.geometry), f), strain_of(q, context, space)
        for c in range(FREEDOMS):
            change = K[(contact_tangent.RELIEVED + c) * TILE + q] - strain[c]
            for d in range(3):
                J[FREEDOMS * d + c] += f[d] * change
                J[FREEDOMS * (3 + d) + c] += torque[d] * change
            if is_upper(context.partner[k]):
                J[FREEDOMS * 6 + c] -= f[2] * change


@entry(PART, **POINTED, **NO_COUNTS)
def spots_part(stage, _, a, m, motion, context, islands, scratch):
    space = space_at(a, scratch)
    if stage == STAGE.TRIAL:
        G, a, b = space.geometry, geometry.RELIEF * TILE, geometry.SPOT_FORCE * TILE
        c, d = geometry.PULL * TILE, (geometry.PULL + 1) * TILE
        spots = Spots(G[a : a + TILE], G[b : b + TILE], G[c : c + TILE], G[d : d + TILE], space.outputs)
        solve_bodies(m, space.slots, context, spots)
    elif stage == STAGE.RELIEVE:
        relieve(m, space)
    elif stage == STAGE.RESTORE:
        restore(m, space.slots, context, space)
    elif stage == STAGE.PULL:
        add_interaction_energy(m, space)
        for q in range(m):  # the forces along the plate, at the centres of the spheres
            pull = space.geometry[q + geometry.PULL * TILE], space.geometry[q + (geometry.PULL + 1) * TILE], 0.0
            add_force(pull, plates.three(context.S, context.own[space.slots[q]], sphere.ARM), False, space.residual)
    elif stage == STAGE.TANGENTS:
        add_interaction(m, context, space)
