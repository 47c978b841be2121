"""Poses in which a clump can rest on a horizontal plane under gravity."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from thirdbody.bodies.clump import Clump, quaternion_product
from thirdbody.errors import ThirdbodyError
from thirdbody.kernels.options import INNER, OPTIONS

# In units of the largest radius: spheres this near to the plane count as contacts, and a centroid this near
# to the edge of the support as on it. Poses come out of closed forms, good to some 1e-15 of the body.
_TOLERANCE = 1e-9
# Angle by which a support may miss the half turn and still be an edge: _TOLERANCE over a short branch.
_EDGE = 1e-7
# Poses whose up-vectors differ by less are one: a pad of four contacts is found by each of its triples.
_SAME = 1e-6
# Directions tried where the height does not depend on the direction (a ball, a rod rolling on its axis).
_TURNS = 8


def resting_poses(clump: Clump) -> tuple[np.ndarray, np.ndarray]:
    """Stable static equilibria on a plane below: quaternions (p, 4) and heights of the centroid (p,) in m.

    They are the local minima of h(u) = max_i(r_i - u.c_i) over unit up-vectors u of the body; the quaternion
    turns u to +z by the shortest way. Lowest first. Where a ball or rod rests at any turn about itself, one
    pose stands for all.
    """
    scale = clump.radii.max()
    c, r = np.ascontiguousarray(clump.centers / scale), clump.radii / scale
    n = r.size
    found = np.empty((2 * n + n * n + n * n * n, 3))
    ups = found[: _minima(c, r, found, np.empty((3, n + 1)), np.empty(n + 1, np.int64))]
    if not len(ups):
        raise ThirdbodyError(
            f"no resting pose found for the clump with centers {c.tolist()}, radii {r.tolist()}"
        )
    heights = (clump.radii - ups @ clump.centers.T).max(axis=1)
    order = np.argsort(heights, kind="stable")
    return _turned_up(ups[order]), heights[order]


def settle(clump: Clump, rng: np.random.Generator) -> tuple[np.ndarray, float]:
    """Quaternion (4,) and height (m) of the resting pose nearest to a random direction, turned at random."""
    quaternions, heights = resting_poses(clump)
    up = rng.normal(size=3)
    w, x, y, z = quaternions.T
    # Body up-vector of each pose: third row of its rotation matrix.
    ups = np.stack((2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)), axis=1)
    k = int(np.argmax(ups @ up))
    half = rng.uniform(0.0, math.pi)
    yaw = np.array([math.cos(half), 0.0, 0.0, math.sin(half)])
    return quaternion_product(yaw, quaternions[k]), float(heights[k])


def _turned_up(ups: np.ndarray) -> np.ndarray:
    """Quaternions (p, 4) that turn the unit vectors (p, 3) to +z by the shortest way."""
    quaternions = np.column_stack((1.0 + ups[:, 2], ups[:, 1], -ups[:, 0], np.zeros(len(ups))))
    # Straight down has no shortest way: half a turn about x.
    quaternions[quaternions[:, 0] < 1e-14] = (0.0, 1.0, 0.0, 0.0)
    return quaternions / np.linalg.norm(quaternions, axis=1)[:, None]


@njit(**INNER)
def _rests(u, c, r, flat, ids):
    """Whether the body, up along u, is at a local minimum of its centroid's height.

    Equilibrium: the origin lies in the hull of the contacts' projections (multipliers >= 0). Well inside, any
    tilt raises the height at first order. On a corner or edge of the hull the second order decides: u.w >= 0
    with w the supporting combination of the contact centers.
    """
    ux, uy, uz = u
    if abs(uz) < 0.7:
        s = math.sqrt(ux * ux + uy * uy)
        ax, ay, az = -uy / s, ux / s, 0.0
    else:
        s = math.sqrt(uz * uz + uy * uy)
        ax, ay, az = 0.0, -uz / s, uy / s
    bx, by, bz = uy * az - uz * ay, uz * ax - ux * az, ux * ay - uy * ax
    angle, arm, up = flat[0], flat[1], flat[2]
    lowest = np.inf
    for i in range(r.size):
        up[i] = ux * c[i, 0] + uy * c[i, 1] + uz * c[i, 2]
        lowest = min(lowest, up[i] - r[i])
    m = 0
    for i in range(r.size):
        if up[i] - r[i] > lowest + _TOLERANCE:
            continue
        p = ax * c[i, 0] + ay * c[i, 1] + az * c[i, 2]
        q = bx * c[i, 0] + by * c[i, 1] + bz * c[i, 2]
        arm[i] = math.sqrt(p * p + q * q)
        if arm[i] <= _TOLERANCE:
            if up[i] >= -_TOLERANCE:
                return True
            continue
        turn = math.atan2(q, p)
        k = m
        while k > 0 and angle[k - 1] > turn:
            angle[k] = angle[k - 1]
            ids[k] = ids[k - 1]
            k -= 1
        angle[k] = turn
        ids[k] = i
        m += 1
    if m == 0:
        return False
    angle[m] = angle[0] + 2.0 * math.pi
    ids[m] = ids[0]
    widest, first, last = 0.0, 0, 0
    for k in range(m):
        if angle[k + 1] - angle[k] > widest:
            widest, first, last = angle[k + 1] - angle[k], ids[k], ids[k + 1]
    if widest < math.pi - _EDGE or widest > math.pi + _EDGE:
        return widest < math.pi
    return arm[last] * up[first] + arm[first] * up[last] >= -_TOLERANCE * (arm[first] + arm[last])


@njit(**INNER)
def _added(u, c, r, found, m, flat, ids):
    """Number of poses found after trying u."""
    for k in range(m):
        dx, dy, dz = found[k, 0] - u[0], found[k, 1] - u[1], found[k, 2] - u[2]
        if dx * dx + dy * dy + dz * dz < _SAME * _SAME:
            return m
    if not _rests(u, c, r, flat, ids):
        return m
    found[m, 0], found[m, 1], found[m, 2] = u
    return m + 1


@njit(**INNER)
def _axis(u):
    """Unit vector along u."""
    s = 1.0 / math.sqrt(u[0] * u[0] + u[1] * u[1] + u[2] * u[2])
    return u[0] * s, u[1] * s, u[2] * s


@njit(**INNER)
def _across(d):
    """A unit vector normal to the unit vector d."""
    if abs(d[2]) < 0.7:
        return _axis((-d[1], d[0], 0.0))
    return _axis((0.0, -d[2], d[1]))


@njit(**OPTIONS)
def _minima(c, r, found, flat, ids):
    """Up-vectors of all resting poses into found; gives their number. c, r in units of the largest radius."""
    n = r.size
    m = 0
    for i in range(n):
        ci = (c[i, 0], c[i, 1], c[i, 2])
        square = ci[0] * ci[0] + ci[1] * ci[1] + ci[2] * ci[2]
        if square > _TOLERANCE * _TOLERANCE:
            m = _added(_axis(ci), c, r, found, m, flat, ids)
        else:
            m = _added((0.0, 0.0, 1.0), c, r, found, m, flat, ids)
    for i in range(n):
        for j in range(i + 1, n):
            # d along c_i - c_j; u.d = alpha for every u that touches with both.
            dx, dy, dz = c[i, 0] - c[j, 0], c[i, 1] - c[j, 1], c[i, 2] - c[j, 2]
            length = math.sqrt(dx * dx + dy * dy + dz * dz)
            if length <= abs(r[i] - r[j]) + _TOLERANCE:
                continue
            dx, dy, dz = dx / length, dy / length, dz / length
            alpha = (r[i] - r[j]) / length
            beta = math.sqrt(1.0 - alpha * alpha)
            along = c[i, 0] * dx + c[i, 1] * dy + c[i, 2] * dz
            ex, ey, ez = c[i, 0] - along * dx, c[i, 1] - along * dy, c[i, 2] - along * dz
            if ex * ex + ey * ey + ez * ez > _TOLERANCE * _TOLERANCE:
                ex, ey, ez = _axis((ex, ey, ez))
                turns = 1
            else:
                ex, ey, ez = _across((dx, dy, dz))
                turns = _TURNS
            fx, fy, fz = dy * ez - dz * ey, dz * ex - dx * ez, dx * ey - dy * ex
            before = m
            for k in range(turns):
                p = beta * math.cos(2.0 * math.pi * k / _TURNS)
                q = beta * math.sin(2.0 * math.pi * k / _TURNS)
                u = (alpha * dx + p * ex + q * fx, alpha * dy + p * ey + q * fy, alpha * dz + p * ez + q * fz)
                if m == before:
                    m = _added(u, c, r, found, m, flat, ids)
            # e, f span the plane normal to d: u = alpha d + p e + q f, and the third sphere gives p, q.
            for k in range(j + 1, n):
                gx, gy, gz = c[i, 0] - c[k, 0], c[i, 1] - c[k, 1], c[i, 2] - c[k, 2]
                g_e, g_f = gx * ex + gy * ey + gz * ez, gx * fx + gy * fy + gz * fz
                off = math.sqrt(g_e * g_e + g_f * g_f)
                if off <= _TOLERANCE:
                    continue
                g_e, g_f = g_e / off, g_f / off
                near = (r[i] - r[k] - alpha * (gx * dx + gy * dy + gz * dz)) / off
                square = beta * beta - near * near
                if square < 0.0:
                    continue
                side = math.sqrt(square)
                for _ in range(2):
                    side = -side
                    p, q = near * g_e - side * g_f, near * g_f + side * g_e
                    u = (
                        alpha * dx + p * ex + q * fx,
                        alpha * dy + p * ey + q * fy,
                        alpha * dz + p * ez + q * fz,
                    )
                    m = _added(u, c, r, found, m, flat, ids)
    return m
