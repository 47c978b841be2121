"""Poses in which a clump can rest on a horizontal plane under gravity."""

from __future__ import annotations

import math

import numpy as np

from thirdbody.bodies.clump import Clump, quaternion_product
from thirdbody.errors import ThirdbodyError
from thirdbody.kernels.union import triples

# In units of the largest radius: spheres this near to the plane count as contacts, and a centroid this near
# to the edge of the support as on it. Poses come out of closed forms, good to some 1e-15 of the body.
_TOLERANCE = 1e-9
# Angle by which a support may miss the half turn and still be an edge: _TOLERANCE over a short branch.
_EDGE = 1e-7
# Poses whose up-vectors differ by less are one: a pad of four contacts is found by each of its triples.
_SAME = 1e-6
# Directions tried where the height does not depend on the direction (a ball, a rod rolling on its axis).
_TURNED = [(math.cos(k * math.pi / 4.0), math.sin(k * math.pi / 4.0)) for k in range(8)]


def resting_poses(clump: Clump) -> tuple[np.ndarray, np.ndarray]:
    """Stable static equilibria on a plane below: quaternions (p, 4) and heights of the centroid (p,) in m.

    They are the local minima of h(u) = max_i(r_i - u.c_i) over unit up-vectors u of the body; the quaternion
    turns u to +z by the shortest way. Lowest first. Where a ball or rod rests at any turn about itself, one
    pose stands for all.
    """
    scale = clump.radii.max()
    c, r = clump.centers / scale, clump.radii / scale
    ups, touches, family = _candidates(c, r)
    standing = _on_own_sphere(ups, touches, c, r)
    ups, family = ups[standing], family[standing]
    resting = _rests(ups, c, r)
    ups = _distinct(ups[resting], family[resting])
    if not ups.size:
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


def _on_own_sphere(ups: np.ndarray, touches: np.ndarray, c: np.ndarray, r: np.ndarray) -> np.ndarray:
    """Indices of the candidates that no other sphere keeps off the plane: most fail here already."""
    kept = []
    # In blocks: a hundred spheres have 300 000 candidates.
    for first in range(0, len(ups), 8192):
        bottom = ups[first : first + 8192] @ c.T - r
        own = bottom[np.arange(len(bottom)), touches[first : first + 8192]]
        kept.append(first + np.flatnonzero(own <= bottom.min(axis=1) + _TOLERANCE))
    return np.concatenate(kept)


def _distinct(ups: np.ndarray, family: np.ndarray) -> np.ndarray:
    """The first of those that are the same direction or belong to the same family."""
    same = ((ups[:, None] - ups) ** 2).sum(axis=2) < _SAME**2
    same |= (family[:, None] == family) & (family >= 0)
    return ups[~np.tril(same, -1).any(axis=1)]


def _rests(ups: np.ndarray, c: np.ndarray, r: np.ndarray) -> np.ndarray:
    """Whether (m,) the body, up along each of ups (m, 3), is at a local minimum of its centroid's height.

    Equilibrium: the origin lies in the hull of the contacts' projections (multipliers >= 0). Well inside, any
    tilt raises the height at first order. On a corner or edge of the hull the second order decides: u.w >= 0
    with w the supporting combination of the contact centers.
    """
    m, n = len(ups), len(r)
    rows = np.arange(m)
    up = ups @ c.T
    bottom = up - r
    a, b = _tangents(ups)
    p, q = a @ c.T, b @ c.T
    arm = np.hypot(p, q)
    touching = bottom <= bottom.min(axis=1)[:, None] + _TOLERANCE
    below = touching & (arm <= _TOLERANCE)
    around = touching & ~below
    count = around.sum(axis=1)
    angle = np.where(around, np.arctan2(q, p), np.inf)
    order = np.argsort(angle, axis=1)
    angle = np.column_stack((np.take_along_axis(angle, order, axis=1), np.full(m, np.inf)))
    angle[rows, count] = angle[:, 0] + 2.0 * math.pi
    # Behind the last contact there is nothing to measure.
    angle[np.isinf(angle)] = 0.0
    gaps = np.where(np.arange(n) < count[:, None], angle[:, 1:] - angle[:, :-1], 0.0)
    widest = gaps.argmax(axis=1)
    gap = gaps[rows, widest]
    first = order[rows, widest]
    last = order[rows, (widest + 1) % np.maximum(count, 1)]
    lever = arm[rows, last] * up[rows, first] + arm[rows, first] * up[rows, last]
    edge = (np.abs(gap - math.pi) <= _EDGE) & (lever >= -_TOLERANCE * (arm[rows, first] + arm[rows, last]))
    corner = (below & (up >= -_TOLERANCE)).any(axis=1)
    return corner | ((count > 0) & ((gap < math.pi - _EDGE) | edge))


def _candidates(c: np.ndarray, r: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Up-vectors (m, 3) that may be resting poses, one sphere (m,) that each must touch with, families (m,).

    One sphere: u = c/|c|. Two: u = alpha d + beta e, d along c_i - c_j, e the part of c_i normal to d. Three:
    u.(c_i - c_j) = r_i - r_j and the same for k. Of a family >= 0 one that rests is enough. c, r in
    units of the largest radius.
    """
    far = np.sqrt((c * c).sum(axis=1))
    bottom = c[:, 2] - r
    # A sphere round the centroid rolls freely, here on -z; with a second one there it is a pair's matter.
    alone = (bottom <= bottom.min() + _TOLERANCE).sum() == 1
    rolling = np.array([0.0, 0.0, 1.0 if alone else np.nan])
    single = np.where(far[:, None] > _TOLERANCE, c / np.maximum(far, _TOLERANCE)[:, None], rolling)
    i, j = np.triu_indices(r.size, 1)
    d = c[i] - c[j]
    length = np.sqrt((d * d).sum(axis=1))
    with np.errstate(invalid="ignore", divide="ignore"):
        d = np.where((length > np.abs(r[i] - r[j]) + _TOLERANCE)[:, None], d / length[:, None], np.nan)
        alpha = ((r[i] - r[j]) / length)[:, None]
        beta = np.sqrt(1.0 - alpha * alpha)
        e = c[i] - (c[i] * d).sum(axis=1)[:, None] * d
        off = np.sqrt((e * e).sum(axis=1))[:, None]
        # Where the centroid lies on the line of the centers all e are equal: a few turns stand for all, and
        # pairs on one line with one u.d are one family.
        free = np.flatnonzero(off <= _TOLERANCE)
        e = np.where(off > _TOLERANCE, e / off, _tangents(d)[0])
        f = np.cross(d, e)
        double = alpha * d + beta * e
        label = _families(alpha * d, d, free)
        turned = [alpha[free] * d[free] + beta[free] * (x * e[free] + y * f[free]) for x, y in _TURNED]
        (h, _, k), pair = triples(r.size)
        d, e, f, alpha, beta = d[pair], e[pair], f[pair], alpha[pair], beta[pair]
        g = c[h] - c[k]
        g_e, g_f = (g * e).sum(axis=1)[:, None], (g * f).sum(axis=1)[:, None]
        square = g_e * g_e + g_f * g_f
        near = ((r[h] - r[k])[:, None] - alpha * (g * d).sum(axis=1)[:, None]) / square
        side = np.sqrt(beta * beta / square - near * near)
        middle = alpha * d + near * (g_e * e + g_f * f)
        out = side * (g_e * f - g_f * e)
    ups = np.concatenate([single, double, middle - out, middle + out, *turned])
    touches = np.concatenate([np.arange(r.size), i, h, h, *(i[free] for _ in turned)])
    none = np.full(len(middle), -1)
    family = np.concatenate([np.full(r.size, -1), label, none, none, *(label[free] for _ in turned)])
    valid = np.isfinite(ups).all(axis=1)
    return ups[valid], touches[valid], family[valid]


def _families(shift: np.ndarray, d: np.ndarray, free: np.ndarray) -> np.ndarray:
    """For each pair -1, or for a free one the first of the free with the same line d and the same u.d d."""
    label = np.full(len(d), -1)
    if free.size:
        kind = np.column_stack((shift, (d[:, :, None] * d[:, None]).reshape(-1, 9)))[free]
        alike = ((kind[:, None] - kind) ** 2).sum(axis=2) < _SAME**2
        label[free] = alike.argmax(axis=1)
    return label


def _tangents(ups: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Unit vectors (m, 3) normal to the unit vectors given and to each other."""
    x, y, z = ups.T
    none = np.zeros_like(x)
    a = np.where(np.abs(ups[:, 2:]) < 0.7, np.column_stack((-y, x, none)), np.column_stack((none, -z, y)))
    a /= np.sqrt((a * a).sum(axis=1))[:, None]
    return a, np.cross(ups, a)
