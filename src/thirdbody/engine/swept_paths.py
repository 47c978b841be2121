"""Spheres of different bodies that may have touched since the last search, by the paths that they sweep."""

import numpy as np

from thirdbody.engine.candidates import Numbers
from thirdbody.engine.neighbours import search_pairs
from thirdbody.engine.state import Array, Ints, State
from thirdbody.kernels.implicit.accept_step import ROUNDED
from thirdbody.kernels.implicit.tables import sphere_path
from thirdbody.kernels.tables import EVERYTHING, domain, sphere

OUTLIER = 4.0
"""Paths longer than this many times those of 99 % of the spheres are those of single bodies that tip or fly. Their pairs are
found one by one: a grid for such distances would list all pairs of all bodies."""


def may_have_touched(state: State, positions: Array, swept: Array) -> tuple[Numbers, Numbers]:
    """Return the pairs of spheres of different bodies that may have touched: owners and partners.

    `positions`: (n, 3) of all spheres at the last search [m]; `swept` (n, sphere_path.WIDTH): their paths since then.
    """
    paths = ROUNDED * swept[:, sphere_path.LENGTH]
    usual = min(float(paths.max()), OUTLIER * float(np.quantile(paths, 0.99)))
    own, partner = search_pairs(state, 2.0 * usual + float(state.D[domain.REACH]))
    if np.any(paths > usual):
        own, partner = _with_fast(state, paths, np.flatnonzero(paths > usual), own, partner)
    # a body that chatters has a long path in a small box, one that slides a straight path in a large one
    near = _gaps_of_boxes(state, swept, own, partner) <= state.D[domain.REACH]
    own, partner = own[near], partner[near]
    near = _smallest_gaps(state, positions, paths, own, partner) <= state.D[domain.REACH]
    return own[near], partner[near]


def _with_fast(state: State, paths: Array, fast: Ints, own: Numbers, partner: Numbers) -> tuple[Numbers, Numbers]:
    """Return these pairs and those of the `fast` spheres with all within reach of both paths, sorted."""
    S, free, n = state.S, state.side == EVERYTHING, state.n_spheres
    keys = [own.astype(np.int64) * n + partner]
    for i in fast[free[fast]]:
        between = _nearest_images(state, S[:, :3] - S[i, :3])
        reach = S[:, sphere.RADIUS] + S[i, sphere.RADIUS] + paths + paths[i]
        near = free & (state.body != state.body[i]) & (np.sum(between**2, axis=1) < reach**2)
        j = np.flatnonzero(near)
        keys.append(np.minimum(i, j) * n + np.maximum(i, j))
    both = np.unique(np.concatenate(keys))
    return (both // n).astype(np.int32), (both % n).astype(np.int32)


def _nearest_images(state: State, between: Array) -> Array:
    """Return separations (n, 3) [m] to the nearest images."""
    for axis in (0, 1):
        length = max(float(state.D[domain.LENGTH_X + axis]), 0.0)
        if length > 0.0:
            between[:, axis] -= length * np.rint(between[:, axis] / length)
    return between


def _smallest_gaps(state: State, positions: Array, paths: Array, own: Numbers, partner: Numbers) -> Array:
    """Return the smallest gaps (n,) [m] of pairs of straight paths, less their largest deviations; -inf: they are too long."""
    S = state.S
    moved = S[:, :3] - positions
    strayed = 0.5 * np.sqrt(np.maximum(paths**2 - np.sum(moved**2, axis=1), 0.0))
    now = _nearest_images(state, S[own, :3] - S[partner, :3])
    # speeds along the paths are unknown, so the whole paths must be apart, not only simultaneous positions
    touch = S[own, sphere.RADIUS] + S[partner, sphere.RADIUS] + strayed[own] + strayed[partner]
    gaps = _apart(now, moved[own], moved[partner]) - touch
    # paths that are long enough to meet another image than the one that is nearest now
    reach = S[own, sphere.RADIUS] + S[partner, sphere.RADIUS] + paths[own] + paths[partner]
    lengths = state.D[domain.LENGTH_X : domain.LENGTH_X + 2]
    return np.where(reach < 0.5 * np.min(lengths, where=lengths > 0.0, initial=np.inf), gaps, -np.inf)


def _gaps_of_boxes(state: State, swept: Array, own: Numbers, partner: Numbers) -> Array:
    """Return lower bounds (n,) of the gaps [m] of pairs anywhere in the boxes around their paths."""
    low, high, radius = swept[:, sphere_path.LOW3], swept[:, sphere_path.HIGH3], state.S[:, sphere.RADIUS]
    middle, half = 0.5 * (low + high), 0.5 * (high - low)
    between = np.abs(_nearest_images(state, middle[own] - middle[partner])) - half[own] - half[partner]
    return np.linalg.norm(np.maximum(between, 0.0), axis=1) - radius[own] - radius[partner]


def _apart(between: Array, a: Array, b: Array) -> Array:
    """Return the smallest distances (n,) of segments a and b (n, 3).

    `between` (n, 3): vector from the end of b to the end of a. Closest points of two segments (Ericson 2005, Real-time collision
    detection, 5.1.9): those of the lines, then clipped.
    """
    start = between - a + b
    aa, bb, ab = np.sum(a * a, axis=1), np.sum(b * b, axis=1), np.sum(a * b, axis=1)
    along_a, along_b = np.sum(a * start, axis=1), np.sum(b * start, axis=1)

    def part(value: Array, by: Array) -> Array:
        return np.clip(np.divide(value, by, out=np.zeros_like(value), where=by > 0.0), 0.0, 1.0)

    s = part(ab * along_b - along_a * bb, aa * bb - ab * ab)
    t = part(ab * s + along_b, bb)
    s = part(ab * t - along_a, aa)
    return np.linalg.norm(start + s[:, None] * a - t[:, None] * b, axis=1)
