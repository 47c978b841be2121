"""Bounds of the explicit time step: largest natural frequency and damping rate of bodies and patches.

Contacts are assumed as deep as they can get before the bound is computed again. Sums over the contacts of a body are vectors of
four, in world axes. Their trace and norm bound the step from below, so that only the few bodies that may have the shortest step
get matrices and bounds of their eigenvalues (in a dense layer of spheres 3 ns per step and sphere, not 12).
"""

import math

import numpy as np
from numba import njit, types

from thirdbody.jit.function_pointers import function_at
from thirdbody.jit.options import BARE, BARE_CHUNK, DIRECT, NO_COUNTS
from thirdbody.jit.simd import broadcast, broadcast_lane, cross, extract, load, set4, store, transpose, with_last
from thirdbody.kernels.bundles import Box, Candidates
from thirdbody.kernels.columns import body, body_extra, contact_stiffness, law_input, patch, sphere
from thirdbody.kernels.columns.tile import TILE
from thirdbody.kernels.narrow_phase import overlap_and_normal
from thirdbody.kernels.periodic import image, inverse
from thirdbody.kernels.predicates import is_sphere, is_upper, patch_of_partner
from thirdbody.kernels.rigid_body import arm_to_sphere
from thirdbody.kernels.rotation import matrix
from thirdbody.kernels.signatures import LAW

SAFE = 1.0 + 1e-9
"""Factor on norms, so that rounding excludes no body, not even one of equal stiffness."""


@njit(**BARE)
def stable_step(square, rate):
    """Return the longest stable step of oscillators x'' + rate x' + square x = 0 [s]; infinite without both.

    Velocity Verlet with the velocity of the dashpot predicted from the force before: its amplification has the eigenvalue -1
    where (omega dt)^2/4 + rate dt = 1.
    """
    return 2.0 / (rate + math.sqrt(rate * rate + square))


@njit(**BARE)
def approach(i, j, body_of, S, B, P, n_x, n_y, n_z, horizon):
    """Return how much deeper a contact can get within the horizon [s], from present speeds and forces [m]; >= 0."""
    b = body_of[i]
    v = S[i, sphere.END_VELOCITY] * n_x + S[i, sphere.END_VELOCITY + 1] * n_y + S[i, sphere.END_VELOCITY + 2] * n_z
    a = (B[b, body.FORCE] * n_x + B[b, body.FORCE + 1] * n_y + B[b, body.FORCE + 2] * n_z) / S[i, sphere.MASS]
    if is_sphere(j):
        b = body_of[j]
        v -= S[j, sphere.END_VELOCITY] * n_x + S[j, sphere.END_VELOCITY + 1] * n_y + S[j, sphere.END_VELOCITY + 2] * n_z
        a -= (B[b, body.FORCE] * n_x + B[b, body.FORCE + 1] * n_y + B[b, body.FORCE + 2] * n_z) / S[j, sphere.MASS]
    elif is_upper(j):
        p = patch_of_partner(j)
        v -= P[p, patch.VELOCITY] * n_z
        a -= P[p, patch.FREE] * (P[p, patch.FORCE] - P[p, patch.LOAD]) / P[p, patch.MASS] * n_z
    # a decelerating contact is deepest when its speed is zero; no branch: it would be mispredicted
    stop = -v / a
    t = min(horizon, stop) if (a > 0.0) & (v < 0.0) else horizon
    return max(-v * t - 0.5 * a * t * t, 0.0)


@njit(**BARE)
def store_stiffness(m, first, told, answer, P, rows, patches):
    """Write the stiffness of a tile of m contacts into rows from `first` on; add it to that of the patches."""
    for t in range(m):
        r = first + t
        k_n, k_t, k_r = answer[t], answer[t + TILE], answer[t + 2 * TILE]
        c_n, c_t, c_r = answer[t + 3 * TILE], answer[t + 4 * TILE], answer[t + 5 * TILE]
        twice, p = rows[r, contact_stiffness.TWICE], np.int64(rows[r, contact_stiffness.PATCH])
        if p >= 0:
            patches[p, 0] += 2.0 * k_n / P[p, patch.MASS]
            patches[p, 1] += 2.0 * c_n / P[p, patch.MASS]
        store(rows, r, np.int64(contact_stiffness.STIFFNESS), broadcast(twice) * set4(k_n - k_t, k_t, k_r, 0.0))
        store(rows, r, np.int64(contact_stiffness.DAMPING), broadcast(twice) * set4(c_n - c_t, c_t, c_r, 0.0))


@njit(**BARE_CHUNK)
def active_candidates(n_plates, n, own, partner, S, l_x, l_y, near, place):
    """List the candidates with plates, and those between spheres that touch; return their number. `place`: set to -1 for all."""
    m, c_x, c_y = np.int64(n_plates), inverse(l_x), inverse(l_y)
    for k in range(n_plates):
        near[k], place[k] = k, -1
    for p in range(n - n_plates):
        k = p + n_plates
        i, j = np.uint64(own[k]), np.uint64(partner[k])  # unsigned: no check for negative indices
        d_x, d_y, d_z = S[i, sphere.X] - S[j, sphere.X], S[i, sphere.Y] - S[j, sphere.Y], S[i, sphere.Z] - S[j, sphere.Z]
        d_x, d_y = image(d_x, l_x, c_x), image(d_y, l_y, c_y)
        reach = S[i, sphere.RADIUS] + S[j, sphere.RADIUS]
        near[m], place[k] = k, -1
        m += np.int64(d_x * d_x + d_y * d_y + d_z * d_z < reach * reach)
    return m


@njit(**BARE)
def find_contacts(n, near, own, partner, kind, body, S, B, P, pairs, l_x, l_y, horizon, limit, stiffness, patches, told, answer,
                  rows, place):  # fmt: skip
    """Fill rows of those candidates `near` that touch or will within the horizon. `place`: row of each candidate, or -1."""
    m, first = np.int64(0), np.int64(0)
    for e in range(n):
        k = near[e]
        overlap, n_x, n_y, n_z = overlap_and_normal(k, Candidates(own, partner, S, P), Box(l_x, l_y, 0.0, 0.0))
        i, j = own[k], partner[k]
        overlap = max(overlap, min(overlap + approach(i, j, body, S, B, P, n_x, n_y, n_z, horizon), limit * S[i, sphere.RADIUS]))
        if overlap > 0.0:
            radius, mass, twice, pressed = S[i, sphere.RADIUS], S[i, sphere.MASS], 1.0, -1.0
            if is_sphere(j):
                radius, mass = (
                    radius * S[j, sphere.RADIUS] / (radius + S[j, sphere.RADIUS]),
                    mass * S[j, sphere.MASS] / (mass + S[j, sphere.MASS]),
                )
                twice = 2.0
            elif is_upper(j) and P[patch_of_partner(j), patch.FREE] != 0.0:
                twice, pressed = 2.0, float(patch_of_partner(j))
            told[m + law_input.OVERLAP * TILE] = overlap
            told[m + law_input.RADIUS * TILE] = radius
            told[m + law_input.MASS * TILE] = mass
            told[m + law_input.PAIR_TYPE * TILE], told[m + law_input.NORMAL_VELOCITY * TILE] = kind[k], -1.0
            r = first + m
            place[k] = r
            rows[r, contact_stiffness.NORMAL] = n_x
            rows[r, contact_stiffness.NORMAL + 1] = n_y
            rows[r, contact_stiffness.NORMAL + 2] = n_z
            rows[r, contact_stiffness.NORMAL + 3] = 0.0
            rows[r, contact_stiffness.TWICE], rows[r, contact_stiffness.PATCH] = twice, pressed
            m += 1
        if m == TILE or (e == n - 1 and m > 0):
            stiffness(told, answer, m, pairs)
            store_stiffness(m, first, told, answer, P, rows, patches)
            first += m
            m = np.int64(0)


@njit(**BARE)
def total(v):
    """Return the sum of the first three numbers of v."""
    return extract(v, 0) + extract(v, 1) + extract(v, 2)


@njit(**BARE)
def cyclic_shift(v):
    """Return the numbers y, z, x of v."""
    return set4(extract(v, 1), extract(v, 2), extract(v, 0), 0.0)


@njit(**BARE)
def contact_jacobian(n, arm, reach):
    """Return the products that make up the stiffness of a contact of normal n at r = arm + reach n.

    r: from the centre of mass. Products of n and w = r x n: n n^T, w w^T, n w^T; and r^2 1 - r r^T, r. Symmetric ones: diagonal
    and yz, zx, xy; others: diagonal, those, and zy, xz, yx.
    """
    r, w = with_last(arm + broadcast(reach) * n, n), cross(arm, n)
    n_1, w_1, r_1 = cyclic_shift(n), cyclic_shift(w), cyclic_shift(r)
    n_2, w_2, r_2 = cyclic_shift(n_1), cyclic_shift(w_1), cyclic_shift(r_1)
    rr = r * r
    square = total(rr)
    return (
        n * n, n_1 * n_2, w * w, w_1 * w_2, n * w, n_1 * w_2, n_2 * w_1, set4(square, square, square, 0.0) - rr, r_1 * r_2, r
    )  # fmt: skip


@njit(**BARE)
def add_stiffness(s, k, g):
    """Add the stiffness of a contact with `contact_jacobian` g to the sum s.

    J^T (k_t 1 + (k_n - k_t) n n^T) J + k_r (1 - n n^T), J = (1, -[r]x): forces per displacement, moments per rotation, forces per
    rotation. The second part resists by k_r all rotations but those about n.
    """
    d, t, r, one = broadcast_lane(k, 0), broadcast_lane(k, 1), broadcast_lane(k, 2), set4(1.0, 1.0, 1.0, 0.0)
    return (
        s[0] + (t * one + d * g[0]), s[1] + d * g[1],
        s[2] + (t * g[7] + d * g[2] + r * (one - g[0])), s[3] + (d * g[3] - t * g[8] - r * g[1]),
        s[4] + d * g[4], s[5] + (d * g[5] + t * g[9]), s[6] + (d * g[6] - t * g[9]),
    )  # fmt: skip


@njit(**BARE_CHUNK)
def assemble(b, own, partner, edges, incidence, place, near, rows, S):
    """Return the sums of stiffness and damping over the contacts of body b (`add_stiffness`). `near`: scratch for a list."""
    z, m = broadcast(0.0), np.int64(0)
    for e in range(edges[b], edges[b + 1]):
        near[m] = incidence[e]
        m += place[incidence[e] >> 1] >= 0
    K, C = (z, z, z, z, z, z, z), (z, z, z, z, z, z, z)
    for e in range(m):
        k, back = np.uint64(near[e] >> 1), near[e] & 1
        i, r = np.uint64(partner[k] if back else own[k]), np.uint64(place[k])
        g = contact_jacobian(
            load(rows, r, np.int64(contact_stiffness.NORMAL)), arm_to_sphere(i, S), S[i, sphere.RADIUS] * (2.0 * back - 1.0)
        )
        K, C = (
            add_stiffness(K, load(rows, r, np.int64(contact_stiffness.STIFFNESS)), g),
            add_stiffness(C, load(rows, r, np.int64(contact_stiffness.DAMPING)), g),
        )
    return K, C


@njit(**BARE)
def eigenvalue_upper_bound(s, u, v):
    """Return an upper bound of `eigenvalue` of a sum over a mass >= 1/u and moments of inertia >= 1/v.

    From the trace t and the Frobenius norm f: eigenvalues do not exceed l = t/6 + (5/6 (f^2 - t^2/6))^(1/2) (Wolkowicz and Styan
    1980, theorem 2.1), so their powers sum to t l^15 at most; its root is concave in t, hence below its tangent at 3 l.
    """
    two = broadcast(2.0)
    forces, moments = s[0] * s[0] + two * s[1] * s[1], s[2] * s[2] + two * s[3] * s[3]
    both = s[4] * s[4] + s[5] * s[5] + s[6] * s[6]
    square = total(broadcast(u * u) * forces + broadcast(2.0 * u * v) * both + broadcast(v * v) * moments)
    trace = total(broadcast(u) * s[0] + broadcast(v) * s[2])
    largest = trace / 6.0 + math.sqrt(max(square - trace * trace / 6.0, 0.0) * (5.0 / 6.0))
    return SAFE * min(math.sqrt(square), 3.0 ** (1.0 / 16.0) * (45.0 * largest + trace) / 48.0)


@njit(**BARE)
def symmetric(s, o):
    """Return the rows of a symmetric matrix from its diagonal and yz, zx, xy."""
    return (
        set4(extract(s, 0), extract(o, 2), extract(o, 1), 0.0), set4(extract(o, 2), extract(s, 1), extract(o, 0), 0.0),
        set4(extract(o, 1), extract(o, 0), extract(s, 2), 0.0),
    )  # fmt: skip


@njit(**BARE)
def times(v, X):
    """Return the row v times the matrix of rows X."""
    return broadcast_lane(v, 0) * X[0] + broadcast_lane(v, 1) * X[1] + broadcast_lane(v, 2) * X[2]


@njit(**BARE)
def frame(b, B, E):
    """Return the rows of the matrix from body b's moments to principal axes, over the roots of its inertias."""
    q = matrix(B[b, body.QUATERNION], B[b, body.QUATERNION + 1], B[b, body.QUATERNION + 2], B[b, body.QUATERNION + 3])
    i = set4(
        1.0 / math.sqrt(E[b, body_extra.INERTIA]),
        1.0 / math.sqrt(E[b, body_extra.INERTIA + 1]),
        1.0 / math.sqrt(E[b, body_extra.INERTIA + 2]),
        0.0,
    )
    return set4(q[0], q[1], q[2], 0.0) * i, set4(q[3], q[4], q[5], 0.0) * i, set4(q[6], q[7], q[8], 0.0) * i


@njit(**BARE)
def write(M, row, left, right, scale):
    """Write a row of a matrix of six, scaled; columns 3 and 7 are void."""
    store(M, np.int64(row), np.int64(0), broadcast(scale) * left)
    store(M, np.int64(row), np.int64(4), broadcast(scale) * right)


@njit(**BARE_CHUNK)
def normalise(s, mass, X, M):
    """Write a sum over mass, inertias (X: `frame`) and trace into M (6, 8). Returns its translational and rotational trace."""
    z, root, d, up, low = broadcast(0.0), broadcast(1.0 / math.sqrt(mass)), s[4], s[5], s[6]
    A, D, Y = symmetric(s[0], s[1]), symmetric(s[2], s[3]), transpose(X[0], X[1], X[2], z)
    x = root * times(set4(extract(d, 0), extract(up, 2), extract(low, 1), 0.0), X)
    y = root * times(set4(extract(low, 2), extract(d, 1), extract(up, 0), 0.0), X)
    w = root * times(set4(extract(up, 1), extract(low, 0), extract(d, 2), 0.0), X)
    D = times(D[0], X), times(D[1], X), times(D[2], X)
    D = times(Y[0], D), times(Y[1], D), times(Y[2], D)
    along, around = total(s[0]) / mass, extract(D[0], 0) + extract(D[1], 1) + extract(D[2], 2)
    scale, u, T = 1.0 / max(along + around, 1e-300), broadcast(1.0 / mass), transpose(x, y, w, z)
    write(M, 0, u * A[0], x, scale)
    write(M, 1, u * A[1], y, scale)
    write(M, 2, u * A[2], w, scale)
    write(M, 3, T[0], D[0], scale)
    write(M, 4, T[1], D[1], scale)
    write(M, 5, T[2], D[2], scale)
    return along, around


@njit(**BARE_CHUNK)
def square_matrix(M, to):
    """Write the square of M into `to`. Returns the sum of the squares of its numbers, which is the trace of M^4."""
    size = broadcast(0.0)
    for p in range(6):
        left, right = broadcast(0.0), broadcast(0.0)
        for r in range(6):
            x = broadcast(M[p, r + (r > 2)])
            left, right = left + x * load(M, r, np.int64(0)), right + x * load(M, r, np.int64(4))
        store(to, p, np.int64(0), left)
        store(to, p, np.int64(4), right)
        size = size + (left * left + right * right)
    return total(size)


@njit(**BARE)
def eigenvalue(M, square):
    """Return tr(M^16)^(1/16), an upper bound of the largest eigenvalue of M, at most 12 % high. M: positive semidefinite;
    `square`: that of M; both are scratch."""
    square_matrix(square, M)
    return square_matrix(M, square) ** (1.0 / 16.0)


@njit(**BARE_CHUNK)
def candidate_bound(b, sums, B, E, scratch, m, number, bodies, shortest):
    """Write row m of `bodies` for body b if it may have one of the `shortest` steps. These are by frequency alone and with
    damping [s]. Returns the number of rows then, and the shortest steps."""
    by_frequency, by_both = shortest
    X, mass, K, K_2, C, C_2 = frame(b, B, E), B[b, body.MASS], scratch[0], scratch[1], scratch[2], scratch[3]
    along, around = normalise(sums[0], mass, X, K)
    c_along, c_around = normalise(sums[1], mass, X, C)
    scale, c_scale = along + around, c_along + c_around
    maximum, worst = (
        SAFE * scale * square_matrix(K, K_2) ** 0.25,
        SAFE * c_scale * square_matrix(C, C_2) ** 0.25,
    )  # from traces of fourth powers
    if stable_step(maximum, 0.0) > by_frequency and stable_step(maximum, worst) > by_both:
        return m, by_frequency, by_both
    every, rate = scale * eigenvalue(K, K_2), c_scale * eigenvalue(C, C_2)
    number[m], bodies[m, 0], bodies[m, 1] = b, along, around
    bodies[m, 2], bodies[m, 3] = stable_step(every, 0.0), stable_step(every, rate)
    return m + 1, min(by_frequency, bodies[m, 2]), min(by_both, bodies[m, 3])


@njit(**BARE)
def patch_bounds(P, patches):
    """Add the springs to the stiffness of the patches, and write their stable steps."""
    plate = P.shape[0] - 1
    for p in range(plate):
        patches[p, 0] += 2.0 * P[p, patch.SPRING] / P[p, patch.MASS]
        patches[plate, 0] += 2.0 * P[p, patch.SPRING] / P[plate, patch.MASS] * P[plate, patch.FREE]
    for p in range(plate + 1):
        patches[p, 2], patches[p, 3] = stable_step(patches[p, 0], 0.0), stable_step(patches[p, 0], patches[p, 1])


_F3, _F2, _F1 = (types.Array(types.float64, n, "C") for n in (3, 2, 1))
_I1, _S1 = types.Array(types.int64, 1, "C"), types.Array(types.int32, 1, "C")
stiffness_at = function_at(LAW)
STIFFNESS = types.int64(
    types.int64, types.int64, _S1, _S1, _S1, _S1, _S1, _I1, _F2, _F2, _F2, _F2, _F1, types.float64, types.float64,
    types.float64, types.float64, types.int64, _F2, _I1, _F2, _F1, _F1, _F2, _S1, _S1, _F2, _F3
)  # fmt: skip


@njit(STIFFNESS, **DIRECT, **NO_COUNTS)
def shortest_steps(n_plates, n, own, partner, kind, edges, incidence, body_of, S, B, E, P, pairs, l_x, l_y, horizon, limit,
                   stiffness, patches, number, bodies, told, answer, rows, near, place, minimum, scratch):  # fmt: skip
    """Compute lower bounds of the longest stable steps of patches and of bodies that may have the shortest.

    `bodies` (m, 4): squared frequencies (traces) of translation and of rotation only [1/s2]; longest step by the frequency alone
    and by the damping rate, too [s]; their indices: `number`, in order. Returns m, at least 1. `patches` (n, 4), zero at first:
    squared frequency [1/s2], damping rate [1/s], and the same steps [s]. Contacts are assumed as deep as they can get within the
    `horizon` [s], but no new depth beyond `limit` times the radius. `stiffness`: address of the compiled function. A contact
    between two bodies that both move counts twice in each (|J1 x1 - J2 x2|^2 <= 2 |J1 x1|^2 + 2 |J2 x2|^2).
    """
    law = stiffness_at(stiffness)
    m = active_candidates(n_plates, n, own, partner, S, l_x, l_y, near, place)
    find_contacts(m, near, own, partner, kind, body_of, S, B, P, pairs, l_x, l_y, horizon, limit, law, patches, told, answer,
                  rows, place)  # fmt: skip
    patch_bounds(P, patches)
    first, by_frequency, by_both = (np.int64(0), np.int64(0)), np.inf, np.inf
    many = np.int64(B.shape[0]) if n > 0 else np.int64(0)
    for b in range(many):
        K, C = assemble(b, own, partner, edges, incidence, place, near, rows, S)
        u = 1.0 / B[b, body.MASS]
        v = 1.0 / min(E[b, body_extra.INERTIA], E[b, body_extra.INERTIA + 1], E[b, body_extra.INERTIA + 2])
        maximum = eigenvalue_upper_bound(K, u, v)
        minimum[b, 0], minimum[b, 1] = stable_step(maximum, 0.0), stable_step(maximum, eigenvalue_upper_bound(C, u, v))
        if minimum[b, 0] < by_frequency:
            first, by_frequency = (np.int64(b), first[1]), minimum[b, 0]
        if minimum[b, 1] < by_both:
            first, by_both = (first[0], np.int64(b)), minimum[b, 1]
    number[0], bodies[0, 0], bodies[0, 1], bodies[0, 2], bodies[0, 3] = 0, 0.0, 0.0, np.inf, np.inf
    m, by_frequency, by_both = np.int64(0), np.inf, np.inf
    for t in range(many + 2 if many > 0 else 0):
        one = first[t] if t < 2 else np.int64(t - 2)
        # comparisons in this form let NaN through
        if minimum[one, 1] != np.inf and not (minimum[one, 0] > by_frequency and minimum[one, 1] > by_both):
            sums = assemble(one, own, partner, edges, incidence, place, near, rows, S)
            result, by_frequency, by_both = candidate_bound(one, sums, B, E, scratch, m, number, bodies, (by_frequency, by_both))
            if t > 1:  # the first two are visited again in their order
                m = result
    return max(m, 1)


def scratch(n_bodies, n_slots):
    """Return the scratch of `shortest_steps`: `number`, `bodies` and all after them. Allocated here since each allocation in a
    kernel costs 0.1 s of compilation; untouched parts cost no memory."""
    return (
        np.empty(n_bodies, np.int64),
        np.empty((n_bodies, 4)),
        np.zeros((law_input.HISTORY + 1) * TILE),
        np.empty(6 * TILE),
        np.empty((n_slots, contact_stiffness.WIDTH)),
        np.empty(n_slots + 1, np.int32),
        np.empty(n_slots, np.int32),
        np.empty((n_bodies, 2)),
        np.empty((4, 6, 8)),
    )
