"""Stiffness or damping of a body from its contacts, and bounds of its largest eigenvalue.

Sums over the contacts of a body are seven vectors of four, in world axes (`add_stiffness`).
"""

import math

import numpy as np
from numba import njit

from thirdbody.jit.options import BARE, BARE_CHUNK
from thirdbody.jit.simd import broadcast, broadcast_lane, cross, extract, load, set4, store, transpose, with_last
from thirdbody.kernels.bodies import quaternion
from thirdbody.kernels.tables import body_extra
from thirdbody.kernels.vectors import matrix, total

SAFE = 1.0 + 1e-9  # factor on norms, so that rounding excludes no body, not even one of equal stiffness


@njit(**BARE)
def cyclic_shift(v):
    return set4(extract(v, 1), extract(v, 2), extract(v, 0), 0.0)


@njit(**BARE)
def contact_jacobian(n, arm, radius):
    """Return products of n and w = r x n that make up the stiffness of a contact of normal n at r = arm + radius n: n n^T, w w^T,
    n w^T; and r^2 1 - r r^T, r. Symmetric ones: diagonal and yz, zx, xy; others: diagonal, those, and zy, xz, yx."""
    r, w = with_last(arm + broadcast(radius) * n, n), cross(arm, n)
    n_1, w_1, r_1 = cyclic_shift(n), cyclic_shift(w), cyclic_shift(r)
    n_2, w_2, r_2 = cyclic_shift(n_1), cyclic_shift(w_1), cyclic_shift(r_1)
    rr = r * r
    square = total(rr)
    return (
        n * n, n_1 * n_2, w * w, w_1 * w_2, n * w, n_1 * w_2, n_2 * w_1, set4(square, square, square, 0.0) - rr, r_1 * r_2, r
    )  # fmt: skip


@njit(**BARE)
def add_stiffness(s, k, g):
    """Add the stiffness of a contact with `contact_jacobian` g to the sum s: J^T (k_t 1 + (k_n - k_t) n n^T) J + k_r (1 - n n^T)
    + k_w n n^T, J = (1, -[r]x): forces per displacement, moments per rotation, forces per rotation."""
    d, t, r, one = broadcast_lane(k, 0), broadcast_lane(k, 1), broadcast_lane(k, 2), set4(1.0, 1.0, 1.0, 0.0)
    w = broadcast_lane(k, 3)
    return (
        s[0] + (t * one + d * g[0]), s[1] + d * g[1],
        s[2] + (t * g[7] + d * g[2] + r * (one - g[0]) + w * g[0]), s[3] + (d * g[3] - t * g[8] - r * g[1] + w * g[1]),
        s[4] + d * g[4], s[5] + (d * g[5] + t * g[9]), s[6] + (d * g[6] - t * g[9]),
    )  # fmt: skip


@njit(**BARE)
def eigenvalue_upper_bound(s, u, v):
    """Return an upper bound of `eigenvalue` of a sum over a mass >= 1/u and moments of inertia >= 1/v. From the trace t and the
    Frobenius norm f: eigenvalues do not exceed l = t/6 + (5/6 (f^2 - t^2/6))^(1/2) (Wolkowicz and Styan 1980, theorem 2.1), so
    their powers sum to t l^15 at most; its root is concave in t, hence below its tangent at 3 l."""
    two = broadcast(2.0)
    forces, moments = s[0] * s[0] + two * s[1] * s[1], s[2] * s[2] + two * s[3] * s[3]
    both = s[4] * s[4] + s[5] * s[5] + s[6] * s[6]
    square = total(broadcast(u * u) * forces + broadcast(2.0 * u * v) * both + broadcast(v * v) * moments)
    trace = total(broadcast(u) * s[0] + broadcast(v) * s[2])
    largest = trace / 6.0 + math.sqrt(max(square - trace * trace / 6.0, 0.0) * (5.0 / 6.0))
    return SAFE * min(math.sqrt(square), 3.0 ** (1.0 / 16.0) * (45.0 * largest + trace) / 48.0)


@njit(**BARE)
def symmetric(s, o):
    return (
        set4(extract(s, 0), extract(o, 2), extract(o, 1), 0.0), set4(extract(o, 2), extract(s, 1), extract(o, 0), 0.0),
        set4(extract(o, 1), extract(o, 0), extract(s, 2), 0.0),
    )  # fmt: skip


@njit(**BARE)
def times(v, X):
    return broadcast_lane(v, 0) * X[0] + broadcast_lane(v, 1) * X[1] + broadcast_lane(v, 2) * X[2]


@njit(**BARE)
def frame(b, E, orientations):
    """Return the rows of the matrix from body b's moments to principal axes, over the roots of its inertias."""
    w, x, y, z = quaternion(b, orientations)
    q, at = matrix(w, x, y, z), body_extra.INERTIA
    i = set4(1.0 / math.sqrt(E[b, at]), 1.0 / math.sqrt(E[b, at + 1]), 1.0 / math.sqrt(E[b, at + 2]), 0.0)
    return set4(q[0], q[1], q[2], 0.0) * i, set4(q[3], q[4], q[5], 0.0) * i, set4(q[6], q[7], q[8], 0.0) * i


@njit(**BARE)
def write(M, row, left, right, scale):
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
    """Return tr(M^16)^(1/16), an upper bound of the largest eigenvalue of M >= 0, at most 12 % high; both are scratch."""
    square_matrix(square, M)
    return square_matrix(M, square) ** (1.0 / 16.0)
