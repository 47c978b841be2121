"""Poses in which a clump can rest on a horizontal plane under gravity."""

import math
from collections.abc import Sequence

import numpy as np

from thirdbody.bodies.clump import Clump, sphere_points, stacks
from thirdbody.bodies.union_moments import triples
from thirdbody.rotations import cross, dot

# In units of the largest radius: spheres within this distance of the plane are contacts, and a centroid this near
# to the edge of the support lies on it. Poses follow from closed forms, accurate to some 1e-15 of the body.
_TOLERANCE = 1e-9
# Angle by which a support may differ from a half turn and still be an edge: _TOLERANCE over a short branch.
_EDGE = 1e-7
# Poses whose up-vectors differ by less are one: a pad of four contacts is found from each of its triples.
_SAME = 1e-6
# Directions that differ by less have the same contacts: all triples of a flat layer of 100 spheres are one direction.
_EQUAL = 1e-11
# Size of a stack of bodies (`clump.stacks`): with 6e4, tables of triples of spheres stay in the cache; largest
# number of candidates evaluated at once, and of entries in a table of their pairs: 100 spheres have 300 000 candidates.
_MAX_BLOCK, _MEASURED, _PAIRED = 60_000, 8192, 2_000_000
# Of bodies of more spheres only those count that planes of so many directions touch: triples of all would not fit into memory.
# They are thin: poses that are so many times as high as the lowest stand on an edge and fall at a touch.
_MANY, _PLANES, _STANDING = 100, 64, 3.0
# Directions tried where the height does not depend on the direction (a sphere, a rod rolling on its axis).
_DIRECTIONS = [(math.cos(k * math.pi / 4.0), math.sin(k * math.pi / 4.0)) for k in range(8)]


def resting_poses(clump: Clump) -> tuple[np.ndarray, np.ndarray]:
    """Return the stable poses on a plane: quaternions (p, 4) and heights (p,) [m] of the centroid.

    They are the local minima of h(u) = max_i(r_i - u.c_i) over unit up-vectors u of the body; the quaternion is the smallest
    rotation of u to +z. Lowest first. Where a sphere or rod rests at any rotation about itself, one pose represents all.
    """
    quaternions, heights = _poses_of(clump.centers[None], clump.radii[None])
    return quaternions[0], heights[0]


def settle_all(clumps: Sequence[Clump], rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Return random resting poses, rotated randomly about z: quaternions (n, 4) and heights (n,) [m].

    Drawn for one body after the other from one stream.
    """
    drawn = [(*rng.standard_normal(3), rng.uniform(0.0, math.pi)) for _ in clumps]
    up, half = np.split(np.array(drawn).reshape(-1, 4), [3], axis=1)
    q, height = np.empty((len(clumps), 4)), np.empty(len(clumps))
    shapes = list({id(body.shape or body): body.shape or body for body in clumps}.values())
    number = {id(body): k for k, body in enumerate(shapes)}
    shape = np.array([number[id(body.shape or body)] for body in clumps], np.int64)
    size = np.array([body.radii[0] for body in clumps])
    for _, members in stacks([len(body.radii) for body in shapes], _MAX_BLOCK):
        centers = np.array([shapes[s].centers for s in members])
        quaternions, heights = _poses_of(centers, np.array([shapes[s].radii for s in members]))
        w, x, y, z = np.moveaxis(quaternions, 2, 0)
        # Body up-vector of each pose: third row of its rotation matrix.
        ups = np.stack((2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)), axis=2)
        row = np.full(len(shapes), -1)
        row[members] = np.arange(len(members))
        bodies = np.flatnonzero(row[shape] >= 0)
        rows, own = row[shape[bodies]], np.array([shapes[s].radii[0] for s in members])
        near = np.where(np.isfinite(heights[rows]), dot(ups[rows], up[bodies][:, None]), -np.inf)
        k = near.argmax(axis=1)
        q[bodies], height[bodies] = quaternions[rows, k], heights[rows, k] * (size[bodies] / own[rows])
    return _yawed(q, half[:, 0]), height


def _yawed(q: np.ndarray, half: np.ndarray) -> np.ndarray:
    """Return quaternions (n, 4) rotated about z by twice the angles `half` (n,)."""
    c, s = np.cos(half), np.sin(half)
    w, x, y, z = q.T
    return np.column_stack((c * w - s * z, c * x - s * y, c * y + s * x, c * z + s * w))


def headed(q: np.ndarray, heading: np.ndarray) -> np.ndarray:
    """Return quaternions (n, 4) rotated about z until axes of least inertia have the headings (n,) [rad], from above."""
    w, x, y, z = q.T
    return _yawed(q, 0.5 * (heading - np.arctan2(2.0 * (x * y + w * z), 1.0 - 2.0 * (y * y + z * z))))


def _poses_of(centers: np.ndarray, radii: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """`resting_poses` of a stack (b, n, 3), (b, n): quaternions (b, p, 4), heights (b, p), infinite after the last."""
    scale = radii.max(axis=1)
    c, r = centers / scale[:, None, None], radii / scale[:, None]
    exposed = _exposed(c, r)
    if r.shape[1] > _MANY:
        touched = (r[:, None] - sphere_points(_PLANES) @ c.transpose(0, 2, 1)).argmax(axis=2)
        exposed &= (touched[:, :, None] == np.arange(r.shape[1])).any(axis=1)
    count = exposed.sum(axis=1)
    stacks = []
    for n in np.unique(count):
        members = np.flatnonzero(count == n)
        inner = exposed[members]
        stacks.append((members, _minima(c[members][inner].reshape(-1, n, 3), r[members][inner].reshape(-1, n))))
    # One row per body: its poses, then NaN.
    rows = np.full((len(radii), max(ups.shape[1] for _, ups in stacks), 3), np.nan)
    for members, ups in stacks:
        rows[members, : ups.shape[1]] = ups
    heights = (radii[:, None] - rows @ centers.transpose(0, 2, 1)).max(axis=2)
    heights[np.isnan(heights)] = np.inf
    if r.shape[1] > _MANY:
        heights[heights > _STANDING * heights.min(axis=1, keepdims=True)] = np.inf
    order = np.argsort(heights, axis=1, kind="stable")[:, : int(np.isfinite(heights).sum(axis=1).max())]
    ups = np.take_along_axis(rows, order[:, :, None], axis=1)
    # The smallest rotations to +z; straight down it is not unique: half a turn about x.
    quaternions = np.stack((1.0 + ups[..., 2], ups[..., 1], -ups[..., 0], np.zeros(ups.shape[:-1])), axis=-1)
    quaternions[quaternions[..., 0] < 1e-14] = (0.0, 1.0, 0.0, 0.0)
    return quaternions / np.linalg.norm(quaternions, axis=-1)[..., None], np.take_along_axis(heights, order, axis=1)


def _exposed(c: np.ndarray, r: np.ndarray) -> np.ndarray:
    """Return which spheres (b, n) protrude from all others; of coincident ones the largest, or the first."""
    bodies, exposed = np.arange(len(r)), np.zeros(r.shape, np.bool_)
    for sphere in np.argsort(-r, axis=1, kind="stable").T:
        arm = c - c[bodies, sphere][:, None]
        within = np.sqrt(dot(arm, arm)) + r[bodies, sphere][:, None] <= r + _TOLERANCE
        exposed[bodies, sphere] = np.logical_not((within & exposed).any(axis=1))
    return exposed


def _minima(c: np.ndarray, r: np.ndarray) -> np.ndarray:
    """Return up-vectors (b, p, 3) of the resting poses, or NaN; lengths over the largest radius."""
    directions, touches, families = _candidates(c, r)
    heights, own = _heights(directions, touches, c, r)
    body, index = np.nonzero(own)
    ups, family = directions[body, index], families[body, index]
    # of equal directions of one body and family the first
    keys = np.column_stack((body, family, np.rint(ups / _EQUAL).astype(np.int64)))
    order = np.lexsort(keys.T)
    is_first = np.ones(len(body), np.bool_)
    is_first[1:] = (keys[order[1:]] != keys[order[:-1]]).any(axis=1)
    first = np.sort(order[is_first])
    body, ups, family = body[first], ups[first], family[first]
    stable = np.zeros(len(body), np.bool_)
    size = max(1, _PAIRED // r.shape[1])
    for begin in range(0, len(body), size):
        block = slice(begin, begin + size)
        stable[block] = _is_stable(ups[block], c[body[block]], r[body[block]])
    # The lowest direction of all is a minimum, even where close contacts hide it by rounding.
    alone = np.flatnonzero(np.bincount(body[stable], minlength=len(r)) == 0)
    body, ups, family = body[stable], ups[stable], family[stable]
    count = np.bincount(body, minlength=len(r))
    index = np.arange(len(body)) - (np.cumsum(count) - count)[body]
    rows, families = np.full((len(r), max(count.max(), 1), 3), np.nan), np.full((len(r), max(count.max(), 1)), -1)
    rows[body, index], families[body, index] = ups, family
    rows[~_distinct(rows, families)] = np.nan
    rows[alone, 0] = directions[alone, heights[alone].argmin(axis=1)]
    return rows


def _heights(ups: np.ndarray, touches: np.ndarray, c: np.ndarray, r: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return heights (b, m) of the centroid, infinite for NaN, and whether (b, m) the sphere in contact is the lowest.

    Most candidates fail here: another sphere is below the plane.
    """
    heights, own = np.empty(ups.shape[:2]), np.empty(ups.shape[:2], np.bool_)
    transposed = c.transpose(0, 2, 1)
    for first in range(0, ups.shape[1], _MEASURED):
        block = slice(first, first + _MEASURED)
        bottom = ups[:, block] @ transposed - r[:, None]
        heights[:, block] = -bottom.min(axis=2)
        touching = np.take_along_axis(bottom, touches[None, block, None], axis=2)[:, :, 0]
        own[:, block] = touching <= _TOLERANCE - heights[:, block]
    heights[np.isnan(heights)] = np.inf
    return heights, own


def _distinct(ups: np.ndarray, family: np.ndarray) -> np.ndarray:
    """Return the first (b, m) of candidates with the same direction or of the same family."""
    bodies, m = family.shape
    distinct, size = np.empty((bodies, m), np.bool_), max(1, _PAIRED // (bodies * m))
    for begin in range(0, m, size):
        block, before = slice(begin, begin + size), slice(0, begin + size)
        apart = ups[:, block, None] - ups[:, None, before]
        same = dot(apart, apart) < _SAME**2
        same |= (family[:, block, None] == family[:, None, before]) & (family >= 0)[:, block, None]
        distinct[:, block] = np.logical_not(np.tril(same, begin - 1).any(axis=2))
    return distinct


def _is_stable(ups: np.ndarray, c: np.ndarray, r: np.ndarray) -> np.ndarray:
    """Return whether (m,) bodies c (m, n, 3), r (m, n) with up-vectors (m, 3) rest in stable equilibrium.

    The height of the centroid has a local minimum. Equilibrium: the origin lies in the hull of the contacts' projections
    (multipliers >= 0). In its interior, any tilt raises the height at first order. On a corner or edge of the hull the second
    order decides: u.w >= 0 with w the supporting combination of the contact centers.
    """
    m, n = r.shape
    rows = np.arange(m)
    up = dot(ups[:, None], c)
    bottom = up - r
    a, b = _tangents(ups)
    p, q = dot(a[:, None], c), dot(b[:, None], c)
    arm = np.hypot(p, q)
    touching = bottom <= bottom.min(axis=1)[:, None] + _TOLERANCE
    below = touching & (arm <= _TOLERANCE)
    around = touching & ~below
    count = around.sum(axis=1)
    angle = np.where(around, np.arctan2(q, p), np.inf)
    order = np.argsort(angle, axis=1)
    angle = np.column_stack((np.take_along_axis(angle, order, axis=1), np.full(m, np.inf)))
    angle[rows, count] = angle[:, 0] + 2.0 * math.pi
    # Columns after the last contact are empty.
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
    """Return candidate up-vectors (b, m, 3), a sphere (m,) in contact for each, and families (b, m).

    One sphere: u = c/|c|. Two: u = alpha d + beta e, d along c_i - c_j, e the part of c_i normal to d. Three: u.(c_i - c_j) = r_i
    - r_j and the same for k. Of a family >= 0 one resting pose is enough. For a stack (b, n, 3), (b, n) in units of the largest
    radius; NaN where there is no such direction.
    """
    n = r.shape[1]
    distance = np.sqrt(dot(c, c))
    bottom = c[:, :, 2] - r
    # A sphere about the centroid rolls freely, here on -z; with a second one there, pairs cover the case.
    alone = (bottom <= bottom.min(axis=1, keepdims=True) + _TOLERANCE).sum(axis=1) == 1
    rolling = np.where(alone[:, None], (0.0, 0.0, 1.0), np.nan)[:, None]
    single = np.where(distance[:, :, None] > _TOLERANCE, c / np.maximum(distance, _TOLERANCE)[:, :, None], rolling)
    i, j = np.triu_indices(n, 1)
    d, r_i, r_j = c[:, i] - c[:, j], r[:, i], r[:, j]
    length = np.sqrt(dot(d, d))
    with np.errstate(invalid="ignore", divide="ignore"):
        d = np.where((length > np.abs(r_i - r_j) + _TOLERANCE)[:, :, None], d / length[:, :, None], np.nan)
        alpha = ((r_i - r_j) / length)[:, :, None]
        beta = np.sqrt(1.0 - alpha * alpha)
        e = c[:, i] - dot(c[:, i], d)[:, :, None] * d
        off = np.sqrt(dot(e, e))[:, :, None]
        # Where the centroid lies on the line of the centers all e are equivalent: a few rotations represent all, and
        # pairs on one line with one u.d are one family.
        free = off[:, :, 0] <= _TOLERANCE
        e = np.where(off > _TOLERANCE, e / off, _tangents(d)[0])
        f = cross(d, e)
        label = _families(alpha * d, d, free)
        triple, third = _triple(c, r, d, e, f, alpha, beta), triples(n)[0][0]
        ups, touches = [single, alpha * d + beta * e, *triple], [np.arange(n), i, third, third]
        none = np.full(triple[0].shape[:2], -1)
        family = [np.full(r.shape, -1), label, none, none]
        for x, y in _DIRECTIONS if free.any() else ():
            ups.append(np.where(free[:, :, None], alpha * d + beta * (x * e + y * f), np.nan))
            touches.append(i)
            family.append(label)
    return np.concatenate(ups, axis=1), np.concatenate(touches), np.concatenate(family, axis=1)


def _triple(c, r, d, e, f, alpha, beta) -> tuple[np.ndarray, np.ndarray]:
    """Return both up-vectors (b, m, 3) of bodies that rest on three spheres, from the frames and slopes of the pairs."""
    (h, _, k), pair = triples(r.shape[1])
    d, e, f, alpha, beta = d[:, pair], e[:, pair], f[:, pair], alpha[:, pair], beta[:, pair]
    g = c[:, h] - c[:, k]
    g_e, g_f = dot(g, e)[:, :, None], dot(g, f)[:, :, None]
    square = g_e * g_e + g_f * g_f
    near = ((r[:, h] - r[:, k])[:, :, None] - alpha * dot(g, d)[:, :, None]) / square
    side = np.sqrt(beta * beta / square - near * near)
    middle = alpha * d + near * (g_e * e + g_f * f)
    out = side * (g_e * f - g_f * e)
    return middle - out, middle + out


def _families(shift: np.ndarray, d: np.ndarray, free: np.ndarray) -> np.ndarray:
    """Return families (b, p): -1, or for a free pair the first one on the same line d with the same u.d."""
    label = np.full(free.shape, -1)
    for body in np.flatnonzero(free.any(axis=1)):
        left = np.flatnonzero(free[body])
        line = d[body, left]
        kind = np.column_stack((shift[body, left], (line[:, :, None] * line[:, None]).reshape(-1, 9)))
        while len(left):
            alike = ((kind - kind[0]) ** 2).sum(axis=1) < _SAME**2
            label[body, left[alike]] = left[0]
            left, kind = left[~alike], kind[~alike]
    return label


def _tangents(ups: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return two unit vectors (..., 3) normal to the given ones and to each other."""
    x, y, z = np.moveaxis(ups, -1, 0)
    none = np.zeros_like(x)
    a = np.where(np.abs(ups[..., 2:]) < 0.7, np.stack((-y, x, none), axis=-1), np.stack((none, -z, y), axis=-1))
    a /= np.sqrt(dot(a, a))[..., None]
    return a, cross(ups, a)
