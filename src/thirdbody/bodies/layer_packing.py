"""Placement of bodies in a layer on the lower plate without overlap, and overlaps of given positions."""

import math
from collections.abc import Iterator, Sequence

import numpy as np

from thirdbody.bodies.clump import Clump, matrix_from_quaternion
from thirdbody.bodies.overlap_grid import OverlapGrid, overlapping, place_body
from thirdbody.bodies.union_moments import union_of_discs
from thirdbody.errors import Fault, InputError

# Smallest gap between spheres over the sum of their radii, so that nothing touches at the start.
CLEARANCE = 1e-3
# Tries per body. Near the jamming of random addition fewer than one random position in ten thousand is free.
TRIES = 50_000
# Largest number of grid columns along one axis: enough for a million spheres.
_COLUMNS = 1024


def place_layer(
    clumps: Sequence[Clump], quaternions: np.ndarray, domain_size: tuple[float, float], periodic: bool, rng: np.random.Generator
) -> np.ndarray:
    """Return positions xy (n, 2) [m] of the centroids of bodies on z = 0, in [0, size).

    quaternions (n, 4): body to world. Random sequential addition, wide bodies first; spheres of different bodies keep a gap of
    1e-3 of the sum of their radii, in three dimensions: a body may reach under another. Without periodicity the whole body stays
    inside the domain. InputError: a body is wider than the domain, or 50 000 tries give no free position.
    """
    size = np.array(domain_size, dtype=np.float64)
    starts = np.cumsum([0, *(len(body.radii) for body in clumps)])
    xy = np.empty((len(clumps), 2))
    if not len(clumps):
        return xy
    spheres = _resting_spheres(clumps, quaternions, starts)
    low = np.minimum.reduceat(spheres[:, :2] - spheres[:, 3:], starts[:-1])
    high = np.maximum.reduceat(spheres[:, :2] + spheres[:, 3:], starts[:-1])
    _refuse_wide(high - low, size)
    cells = empty_grid(spheres[:, 3], size, periodic)
    order = np.argsort(-(high - low).prod(axis=1), kind="stable")
    margin = CLEARANCE * spheres[:, 3].max()
    count = 0
    for done, b in enumerate(order):
        lower_limit, upper_limit = (np.zeros(2), size) if periodic else (margin - low[b], size - margin - high[b])
        for batch in batches():
            tries = lower_limit + (upper_limit - lower_limit) * rng.random((batch, 2))
            k = place_body(tries, spheres[starts[b] : starts[b + 1]], count, cells, CLEARANCE)
            if k >= 0:
                break
        else:
            raise _full(spheres, starts, order, done, size)
        xy[b] = tries[k]
        count += starts[b + 1] - starts[b]
    return xy


def overlaps(
    centers: np.ndarray, radii: np.ndarray, body: np.ndarray, domain_size: tuple[float, float], periodic: bool
) -> list[tuple[int, int, float]]:
    """Return pairs of overlapping bodies (a < b) with their deepest overlap [m], the deepest pair first.

    centers (n, 3), radii (n,), body (n,): the body of each sphere. Spheres of one body are not compared. Periodic in x and y: to
    the nearest image. Touching is no overlap.
    """
    spheres = np.column_stack((centers, radii)).astype(np.float64)
    if not len(spheres):
        return []
    size = np.array(domain_size, dtype=np.float64)
    ids = np.ascontiguousarray(body, dtype=np.int64)
    margin = 1024
    while True:
        cells = empty_grid(spheres[:, 3], size, periodic)
        pairs, depth = np.empty((margin, 2), np.int64), np.empty(margin)
        result = overlapping(spheres, ids, cells, pairs, depth)
        if result <= margin:
            break
        margin = result
    max_overlaps: dict[tuple[int, int], float] = {}
    for (s, t), overlap in zip(ids[pairs[:result]].tolist(), depth[:result].tolist(), strict=True):
        pair = (min(s, t), max(s, t))
        max_overlaps[pair] = max(overlap, max_overlaps.get(pair, 0.0))
    return sorted(((a, b, overlap) for (a, b), overlap in max_overlaps.items()), key=lambda row: (-row[2], row[:2]))


def projected_area(spheres: np.ndarray) -> float:
    """Return the area [m2] that the spheres (k, 4: x, y, z, radius) cover seen from above."""
    scale = spheres[:, 3].max()
    discs, r = (spheres[:, :2] - spheres[0, :2]) / scale, spheres[:, 3] / scale
    moments = np.empty(6)
    union_of_discs(discs, r, moments)
    return float(moments[0] * scale**2)


def _resting_spheres(clumps: Sequence[Clump], quaternions: np.ndarray, starts: np.ndarray) -> np.ndarray:
    """Return spheres (k, 4) of the bodies rotated and put on z = 0, x and y relative to their centroids."""
    body = np.repeat(np.arange(len(clumps)), np.diff(starts))
    rotations = np.moveaxis(matrix_from_quaternion(quaternions.T), 2, 0)
    spheres = np.empty((len(body), 4))
    spheres[:, :3] = np.einsum("nij,nj->ni", rotations[body], np.concatenate([clump.centers for clump in clumps]))
    spheres[:, 3] = np.concatenate([clump.radii for clump in clumps])
    spheres[:, 2] += np.maximum.reduceat(spheres[:, 3] - spheres[:, 2], starts[:-1])[body]
    return spheres


def empty_grid(radii: np.ndarray, size: np.ndarray, periodic: bool) -> OverlapGrid:
    """Return an empty grid for radii (n,), columns of two largest radii with clearance."""
    width = 2.0 * radii.max() * (1.0 + CLEARANCE)
    nx, ny = (min(_COLUMNS, max(1, math.floor(length / width))) for length in size[:2])
    return OverlapGrid(np.empty((len(radii), 4)), np.full((nx, ny), -1, np.int64), np.empty(len(radii), np.int64), size, periodic)


def batches() -> Iterator[int]:
    """Yield growing sizes of batches of tries: most bodies are placed at once."""
    batch, left = 32, TRIES
    while left > 0:
        yield min(batch, left)
        left -= batch
        batch *= 4


def _refuse_wide(widths: np.ndarray, size: np.ndarray) -> None:
    """Raise InputError for a body wider than the domain: it would overlap its own image, or the border."""
    wide = np.flatnonzero((widths * (1.0 + 2.0 * CLEARANCE) >= size).any(axis=1))
    if len(wide):
        b = wide[0]
        raise InputError(
            Fault(
                "domain.size",
                f"body {b} is {widths[b, 0]:.3g} m by {widths[b, 1]:.3g} m wide and does not fit into "
                f"{size[0]:.3g} m by {size[1]:.3g} m",
            )
        )


def _full(spheres: np.ndarray, starts: np.ndarray, order: np.ndarray, done: int, size: np.ndarray) -> InputError:
    """Return the fault of a placement that failed after `done` bodies."""
    area = sum(projected_area(spheres[starts[b] : starts[b + 1]]) for b in order)
    reached = sum(projected_area(spheres[starts[b] : starts[b + 1]]) for b in order[:done])
    whole = size.prod()
    return InputError(
        Fault(
            "domain.size",
            f"no space for body {order[done]} after {TRIES} tries: {done} of {len(order)} bodies placed, "
            f"area fraction {reached / whole:.3f} reached of {area / whole:.3f} wanted; "
            "make domain.size larger or count smaller",
        )
    )
