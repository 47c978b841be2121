"""Bounds of the explicit time step: largest natural frequency and damping rate of bodies and patches.

Contacts are assumed as deep as they can get before the bound is computed again. Sums over the contacts of a body are vectors of
four, in world axes. Their trace and norm bound the step from below, so that only the few bodies that may have the shortest step
get matrices and bounds of their eigenvalues (in a dense layer of spheres 3 ns per step and sphere, not 12).
"""

import math
from collections import namedtuple
from typing import NamedTuple

import numpy as np
from numba import njit, types

from thirdbody.jit.arguments import function_at
from thirdbody.jit.options import BARE, BARE_CHUNK, DIRECT, NO_COUNTS, entry
from thirdbody.jit.simd import broadcast, load, set4, store
from thirdbody.kernels import plates
from thirdbody.kernels.arguments import KINDS, LAW
from thirdbody.kernels.bodies import arm_to_sphere, vector
from thirdbody.kernels.contact_geometry import overlap_and_normal, square_within_reach
from thirdbody.kernels.drive import is_sprung
from thirdbody.kernels.explicit import stiffness_matrix
from thirdbody.kernels.plates import is_sphere, is_upper, max_stiffness, patch_of_partner
from thirdbody.kernels.step_tables import contact_stiffness
from thirdbody.kernels.tables import body, body_extra, drive, patch, sphere, surface_contact
from thirdbody.kernels.tile import TILE, law_input
from thirdbody.kernels.vectors import box_of

Array = np.ndarray

FIELDS = ("own", "partner", "kind", "edges", "incidence", "body", "S", "B", "E", "orientations", "P", "Q", "D", "pairs", "spring")

Assembly = namedtuple("Assembly", ("n_plates", *FIELDS))  # type: ignore[misc]
"""Number of candidates with plates, which come first; then bodies, patches and candidates by their names in
`arguments.Context`. Usable as a context of `contact_geometry`."""

Horizon = namedtuple("Horizon", "time limit v_x v_y")
"""Time until the bound is computed again [s], largest new depth until then over the radius, velocity of the upper plate [m/s]."""


class Tables(NamedTuple):
    """What the candidates and bodies of all pieces write, and the results: lower bounds of the longest stable steps."""

    stiffnesses: Array
    """`contact_stiffness`: in the rows of the candidates of a piece, one after the other, those of its contacts."""
    row_of: Array  # row of each candidate in `stiffnesses`, or -1
    minimum: Array  # lower bounds of the steps of each body, by frequency and by both [s]
    patches: Array
    """(patches, 4), zero at first: squared frequency [1/s2], damping rate [1/s], longest step by the frequency alone and by
    both [s]; where springs drive the plate, a last row for its lateral motion."""
    number: Array  # bodies that may have the shortest step, in order
    bodies: Array  # (bodies, 4): squared frequencies (traces) of translation and of rotation only [1/s2], and the same two steps
    matrices: Array  # scratch: stiffness and damping of a body, and their squares


Scratch = namedtuple("Scratch", "inputs outputs near")
"""Of a piece: a tile of `law_input`; k_n, k_t, k_r, c_n, c_t, c_r of a tile, then k_w and c_w about the normal; candidates."""


@njit(**BARE)
def stable_step(square, rate):
    """Return the longest stable step of x'' + rate x' + square x = 0 [s]. Velocity Verlet with the velocity of the dashpot
    predicted from the force before: -1 is an eigenvalue of its amplification where (omega dt)^2/4 + rate dt = 1."""
    return 2.0 / (rate + math.sqrt(rate * rate + square))


@njit(**BARE)
def approach(i, j, normal, context, horizon):
    """Return how much deeper a contact can get within the horizon, from present speeds and forces [m]; >= 0."""
    S, B, P, (n_x, n_y, n_z) = context.S, context.B, context.P, normal
    b = context.body[i]
    v = S[i, sphere.MID_VELOCITY] * n_x + S[i, sphere.MID_VELOCITY + 1] * n_y + S[i, sphere.MID_VELOCITY + 2] * n_z
    a = (B[b, body.FORCE] * n_x + B[b, body.FORCE + 1] * n_y + B[b, body.FORCE + 2] * n_z) / S[i, sphere.MASS]
    if is_sphere(j):
        b = context.body[j]
        v -= S[j, sphere.MID_VELOCITY] * n_x + S[j, sphere.MID_VELOCITY + 1] * n_y + S[j, sphere.MID_VELOCITY + 2] * n_z
        a -= (B[b, body.FORCE] * n_x + B[b, body.FORCE + 1] * n_y + B[b, body.FORCE + 2] * n_z) / S[j, sphere.MASS]
    elif is_upper(j):
        p = patch_of_partner(j)
        v -= horizon.v_x * n_x + horizon.v_y * n_y + P[p, patch.VELOCITY] * n_z
        a -= P[p, patch.FREE] * (P[p, patch.FORCE] - P[p, patch.LOAD]) / P[p, patch.MASS] * n_z
    # a decelerating contact is deepest when its speed is zero; no branch: it would be mispredicted
    stop = -v / a
    t = min(horizon.time, stop) if (a > 0.0) & (v < 0.0) else horizon.time
    return max(-v * t - 0.5 * a * t * t, 0.0)


@njit(**BARE)
def find_contacts(n, first, context, horizon, stiffness, scratch, tables):
    """Fill rows from `first` on for the n candidates in `scratch.near` that are or will be within reach; load the patches."""
    S, P, inputs, outputs, box = context.S, context.P, scratch.inputs, scratch.outputs, box_of(context.D)
    stiffnesses, patches, m = tables.stiffnesses, tables.patches, np.int64(0)
    for e in range(n):
        k = scratch.near[e]
        i, j = context.own[k], context.partner[k]
        overlap, normal = overlap_and_normal(k, context, box)
        deeper = approach(i, j, normal, context, horizon)
        overlap = max(overlap, min(overlap + deeper, horizon.limit * S[i, sphere.RADIUS]))
        if overlap > -box.reach:
            radius, mass, count, pressed = S[i, sphere.RADIUS], S[i, sphere.MASS], 1.0, -1.0
            if is_sphere(j):
                radius = radius * S[j, sphere.RADIUS] / (radius + S[j, sphere.RADIUS])
                mass = mass * S[j, sphere.MASS] / (mass + S[j, sphere.MASS])
                count = 2.0
            else:
                radius = plates.effective_radius(k, context)
                if is_upper(j) and (P[patch_of_partner(j), patch.FREE] != 0.0 or is_sprung(context)):
                    count, pressed = 2.0, float(patch_of_partner(j))
            inputs[m + law_input.OVERLAP * TILE] = overlap
            inputs[m + law_input.RADIUS * TILE] = radius
            inputs[m + law_input.MASS * TILE] = mass
            inputs[m + law_input.PAIR_TYPE * TILE], inputs[m + law_input.NORMAL_VELOCITY * TILE] = context.kind[k], -1.0
            r = first + m
            tables.row_of[k] = r
            store(stiffnesses, r, np.int64(contact_stiffness.NORMAL), vector(normal))
            stiffnesses[r, contact_stiffness.COUNT], stiffnesses[r, contact_stiffness.PATCH] = count, pressed
            m += 1
        if m == TILE or (e == n - 1 and m > 0):
            stiffness(inputs, outputs, m, context.pairs)
            for t in range(m):
                k_n, k_t, k_r, k_w = outputs[t], outputs[t + TILE], outputs[t + 2 * TILE], outputs[t + 6 * TILE]
                c_n, c_t, c_r, c_w = outputs[t + 3 * TILE], outputs[t + 4 * TILE], outputs[t + 5 * TILE], outputs[t + 7 * TILE]
                r = first + t
                twice, p = broadcast(stiffnesses[r, contact_stiffness.COUNT]), np.int64(stiffnesses[r, contact_stiffness.PATCH])
                if p >= 0:
                    patches[p, 0] += 2.0 * k_n / P[p, patch.MASS] * P[p, patch.FREE]
                    patches[p, 1] += 2.0 * c_n / P[p, patch.MASS] * P[p, patch.FREE]
                    if is_sprung(context):  # on slopes the normal stiffness is lateral, too
                        patches[P.shape[0], 0] += 2.0 * max(k_n, k_t) / context.spring[drive.MASS]
                        patches[P.shape[0], 1] += 2.0 * max(c_n, c_t) / context.spring[drive.MASS]
                store(stiffnesses, r, np.int64(contact_stiffness.STIFFNESS), twice * set4(k_n - k_t, k_t, k_r, k_w))
                store(stiffnesses, r, np.int64(contact_stiffness.DAMPING), twice * set4(c_n - c_t, c_t, c_r, c_w))
            first += m
            m = np.int64(0)


@njit(**BARE_CHUNK)
def assemble(b, context, near, tables):
    own, partner, edges, incidence, S = context.own, context.partner, context.edges, context.incidence, context.S
    row_of, stiffnesses = tables.row_of, tables.stiffnesses
    z, m = broadcast(0.0), np.int64(0)
    for e in range(edges[b], edges[b + 1]):
        near[m] = incidence[e]
        m += row_of[incidence[e] >> 1] >= 0
    K, C = (z, z, z, z, z, z, z), (z, z, z, z, z, z, z)
    for e in range(m):
        k, back = np.uint64(near[e] >> 1), near[e] & 1
        i, r = np.uint64(partner[k] if back else own[k]), np.uint64(row_of[k])
        normal = load(stiffnesses, r, np.int64(contact_stiffness.NORMAL))
        g = stiffness_matrix.contact_jacobian(normal, arm_to_sphere(i, S), S[i, sphere.RADIUS] * (2.0 * back - 1.0))
        K = stiffness_matrix.add_stiffness(K, load(stiffnesses, r, np.int64(contact_stiffness.STIFFNESS)), g)
        C = stiffness_matrix.add_stiffness(C, load(stiffnesses, r, np.int64(contact_stiffness.DAMPING)), g)
    return K, C


@njit(**BARE_CHUNK)
def candidate_bound(b, sums, context, m, tables, shortest):
    """Write row m of the bounds for body b if it may have one of the `shortest` steps, by frequency alone and with damping [s].
    Returns the number of rows then, and the shortest steps."""
    by_frequency, by_both = shortest
    number, bodies, matrices = tables.number, tables.bodies, tables.matrices
    X, mass = stiffness_matrix.frame(b, context.E, context.orientations), context.B[b, body.MASS]
    K, K_2, C, C_2 = matrices[0], matrices[1], matrices[2], matrices[3]
    along, around = stiffness_matrix.normalise(sums[0], mass, X, K)
    c_along, c_around = stiffness_matrix.normalise(sums[1], mass, X, C)
    scale, c_scale = along + around, c_along + c_around
    maximum = stiffness_matrix.SAFE * scale * stiffness_matrix.square_matrix(K, K_2) ** 0.25  # from traces of fourth powers
    worst = stiffness_matrix.SAFE * c_scale * stiffness_matrix.square_matrix(C, C_2) ** 0.25
    if stable_step(maximum, 0.0) > by_frequency and stable_step(maximum, worst) > by_both:
        return m, by_frequency, by_both
    every, rate = scale * stiffness_matrix.eigenvalue(K, K_2), c_scale * stiffness_matrix.eigenvalue(C, C_2)
    number[m], bodies[m, 0], bodies[m, 1] = b, along, around
    bodies[m, 2], bodies[m, 3] = stable_step(every, 0.0), stable_step(every, rate)
    return m + 1, min(by_frequency, bodies[m, 2]), min(by_both, bodies[m, 3])


_F3, _F2, _F1 = (types.Array(types.float64, n, "C") for n in (3, 2, 1))
_I, _I1, _S1 = types.int64, types.Array(types.int64, 1, "C"), types.Array(types.int32, 1, "C")
stiffness_at = function_at(LAW)
ASSEMBLY = types.NamedTuple((_I, *(KINDS[name] for name in FIELDS)), Assembly)
TABLES = types.NamedTuple((_F2, _S1, _F2, _F2, _I1, _F2, _F3), Tables)
SCRATCH, HORIZON = types.NamedTuple((_F1, _F1, _S1), Scratch), types.NamedUniTuple(types.float64, 4, Horizon)


@entry(types.void(_I, _I, ASSEMBLY, HORIZON, _I, SCRATCH, TABLES), nogil=True, **DIRECT, **NO_COUNTS)
def find_stiffnesses(first, last, context, horizon, stiffness, scratch, tables):
    """Fill the rows of candidates first to last - 1, as deep as they can get within the `horizon`. A contact between two bodies
    that both move counts twice in each (|J1 x1 - J2 x2|^2 <= 2 |J1 x1|^2 + 2 |J2 x2|^2)."""
    own, partner, S, near, row_of = context.own, context.partner, context.S, scratch.near, tables.row_of
    m, box = np.int64(0), box_of(context.D)
    for k in range(first, min(last, context.n_plates)):
        near[m], row_of[k] = k, -1
        m += np.int64(not plates.is_rough(context) or context.Q[k, surface_contact.DISTANCE] < np.inf)
    for k in range(max(first, context.n_plates), last):  # those within reach
        near[m], row_of[k] = k, -1
        m += np.int64(square_within_reach(own[k], partner[k], S, box) > 0.0)
    find_contacts(m, np.int64(first), context, horizon, stiffness_at(stiffness), scratch, tables)


@entry(types.void(_I, _I, ASSEMBLY, _S1, TABLES), nogil=True, **DIRECT, **NO_COUNTS)
def bound_bodies(first, last, context, near, tables):
    B, E, minimum = context.B, context.E, tables.minimum
    for b in range(first, last):
        K, C = assemble(b, context, near, tables)
        u = 1.0 / B[b, body.MASS]
        v = 1.0 / min(E[b, body_extra.INERTIA], E[b, body_extra.INERTIA + 1], E[b, body_extra.INERTIA + 2])
        square, rate = stiffness_matrix.eigenvalue_upper_bound(K, u, v), stiffness_matrix.eigenvalue_upper_bound(C, u, v)
        minimum[b, 0], minimum[b, 1] = stable_step(square, 0.0), stable_step(square, rate)


@njit(**BARE)
def smallest(minimum, column):
    """Return the first body with the smallest of the bounds in a column; 0 if none is a number."""
    first, limit = np.int64(0), np.inf
    for b in range(minimum.shape[0]):
        if minimum[b, column] < limit:
            first, limit = np.int64(b), minimum[b, column]
    return first


@entry(_I(_I, ASSEMBLY, types.float64, _S1, TABLES), **DIRECT, **NO_COUNTS)
def shortest_steps(many, context, time, near, tables):
    """Bound the steps of patches, with springs and direct contact, and of the first `many` bodies that may have the shortest;
    return how many bodies these are, at least 1. `time`: horizon [s]; `near`: scratch."""
    P, patches, minimum, number, bodies = context.P, tables.patches, tables.minimum, tables.number, tables.bodies
    plate = P.shape[0] - 1
    for p in range(plate):
        patches[p, 0] += 2.0 * P[p, patch.SPRING] / P[p, patch.MASS]
        patches[plate, 0] += 2.0 * P[p, patch.SPRING] / P[plate, patch.MASS] * P[plate, patch.FREE]
    if P[plate, patch.DIRECT_PREFACTOR] != 0.0:
        patches[plate, 0] += max_stiffness(P, plate, time) / P[plate, patch.MASS]
    if is_sprung(context):
        Y = context.spring
        patches[plate + 1, 0] += max(Y[drive.STIFFNESS], Y[drive.STIFFNESS + 1]) / Y[drive.MASS]
    for p in range(patches.shape[0]):
        patches[p, 2], patches[p, 3] = stable_step(patches[p, 0], 0.0), stable_step(patches[p, 0], patches[p, 1])
    number[0], bodies[0, 0], bodies[0, 1], bodies[0, 2], bodies[0, 3] = 0, 0.0, 0.0, np.inf, np.inf
    m, by_frequency, by_both = np.int64(0), np.inf, np.inf
    first = smallest(minimum, 0), smallest(minimum, 1)
    for t in range(many + 2 if many > 0 else 0):
        one = first[t] if t < 2 else np.int64(t - 2)
        # comparisons in this form let NaN through
        if minimum[one, 1] != np.inf and not (minimum[one, 0] > by_frequency and minimum[one, 1] > by_both):
            sums, shortest = assemble(one, context, near, tables), (by_frequency, by_both)
            result, by_frequency, by_both = candidate_bound(one, sums, context, m, tables, shortest)
            if t > 1:  # the first two are visited again in their order
                m = result
    return max(m, 1)
