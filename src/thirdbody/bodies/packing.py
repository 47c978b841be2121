"""Placement of bodies: in a layer on the lower plate, or scattered in a volume; and overlaps of given positions."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numba import njit

from thirdbody.bodies.clump import Clump
from thirdbody.bodies.union_moments import union_of_discs
from thirdbody.errors import Fault, InputError
from thirdbody.jit.options import BARE, BARE_CHUNK, DIRECT, NO_COUNTS, OPTIONS
from thirdbody.kernels import neighbour_search
from thirdbody.kernels.tables import EVERYTHING, sphere
from thirdbody.kernels.vectors import matrix
from thirdbody.rotations import matrix_from_quaternion

# Smallest gap between spheres over the sum of their radii, so that nothing touches at the start.
CLEARANCE = 1e-3
# Tries per body, in batches: most bodies are placed at once; near the jamming of random addition fewer than one random position
# in ten thousand is free.
_BATCHES = (32, 128, 512, 2048, 8192, 32768, 6320)
# Largest number of grid columns along one axis: enough for a million spheres.
_COLUMNS = 1024

Array = np.ndarray


class Columns(NamedTuple):
    """Spheres in columns over the x-y plane, each at least one largest diameter wide.

    placed (n, 4): x, y, z, radius; heads (nx, ny): last sphere entered into each column, -1 for none; following (n,): the one
    entered before each into its column; size: lengths of the domain [m]; periodic: whether x and y are.
    """

    placed: Array
    heads: Array
    following: Array
    size: Array
    periodic: bool


@njit(**BARE)
def column(at, size, cells):
    """Return the index along one axis of the grid column that contains the coordinate."""
    return min(cells - 1, max(0, np.int64(at / size * cells)))


@njit(**BARE)
def apart(d, size, periodic):
    """Return the difference of two coordinates, to the nearest image if periodic."""
    return d - size * math.floor(d / size + 0.5) if periodic else d


@njit(**BARE_CHUNK)
def enter_if_free(p_x, p_y, spheres, count, columns, clearance):
    """Enter the spheres, moved by (p_x, p_y), as those from `count` on, if they clear all others; return whether they do."""
    placed, heads, following, size, periodic = columns
    nx, ny = heads.shape
    for entering in (False, True):
        for s in range(spheres.shape[0]):
            x, y, z, r = spheres[s, 0] + p_x, spheres[s, 1] + p_y, spheres[s, 2], spheres[s, 3]
            if periodic:
                x -= size[0] * math.floor(x / size[0])
                y -= size[1] * math.floor(y / size[1])
            cx, cy = column(x, size[0], nx), column(y, size[1], ny)
            if entering:
                t = count + s
                placed[t, 0], placed[t, 1], placed[t, 2], placed[t, 3] = x, y, z, r
                following[t] = heads[cx, cy]
                heads[cx, cy] = t
                continue
            for gx in range(cx - 1, cx + 2):
                for gy in range(cy - 1, cy + 2):
                    if not periodic and (gx < 0 or gy < 0 or gx >= nx or gy >= ny):
                        continue
                    t = heads[gx % nx, gy % ny]
                    while t >= 0:
                        dx = apart(placed[t, 0] - x, size[0], periodic)
                        dy = apart(placed[t, 1] - y, size[1], periodic)
                        dz = placed[t, 2] - z
                        reach = (r + placed[t, 3]) * (1.0 + clearance)
                        if dx * dx + dy * dy + dz * dz < reach * reach:
                            return False
                        t = following[t]
    return True


@njit(**DIRECT, **NO_COUNTS)
def place_body(tries, spheres, count, columns, clearance):
    """Place a body at the first free try (x, y), and return its index; -1 if none is free.

    tries (t, 2) [m]; spheres (n, 4) of the body: x, y relative to it, z, radius; count: spheres in the columns. Spheres closer
    than (1 + clearance) times the sum of radii do not fit.
    """
    for k in range(tries.shape[0]):
        if enter_if_free(tries[k, 0], tries[k, 1], spheres, count, columns, clearance):
            return k
    return -1


@njit(**OPTIONS)
def place_rotated(tries, rel, radii, count, columns, clearance, rotated_spheres):
    """Place a body in the box at its first free try, and return its index; -1 if none is free.

    tries (t, 7): unit quaternion, then x, y, z as fractions 0..1 of the range that the rotated body can take. rotated_spheres (k,
    4) holds the spheres of the last try at the end. The size of the columns has three components: the box. In a periodic box x
    and y are arbitrary.
    """
    k, box, periodic = radii.shape[0], columns.size, columns.periodic
    for t in range(tries.shape[0]):
        a, b, c, d, e, f, g, h, i = matrix(tries[t, 0], tries[t, 1], tries[t, 2], tries[t, 3])
        for s in range(k):
            x, y, z = rel[s, 0], rel[s, 1], rel[s, 2]
            rotated_spheres[s, 0] = a * x + b * y + c * z
            rotated_spheres[s, 1] = d * x + e * y + f * z
            rotated_spheres[s, 2] = g * x + h * y + i * z
            rotated_spheres[s, 3] = radii[s]
        fits = True
        for axis in range(3):
            low, high = 0.0, box[axis]
            if axis == 2 or not periodic:
                for s in range(k):
                    reach = radii[s] * (1.0 + clearance)
                    low = max(low, reach - rotated_spheres[s, axis])
                    high = min(high, box[axis] - reach - rotated_spheres[s, axis])
            fits = fits and low < high
            at = low + (high - low) * tries[t, 4 + axis]
            for s in range(k):
                rotated_spheres[s, axis] += at
        if fits and enter_if_free(0.0, 0.0, rotated_spheres, count, columns, clearance):
            return t
    return -1


def _empty_columns(radii: Array, size: Array, periodic: bool) -> Columns:
    width = 2.0 * radii.max() * (1.0 + CLEARANCE)
    nx, ny = (min(_COLUMNS, max(1, math.floor(length / width))) for length in size[:2])
    return Columns(np.empty((len(radii), 4)), np.full((nx, ny), -1, np.int64), np.empty(len(radii), np.int64), size, periodic)


def place_layer(
    clumps: Sequence[Clump], quaternions: Array, domain_size: tuple[float, float], periodic: bool, rng: np.random.Generator
) -> Array:
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
    # spheres put on z = 0, x and y relative to their centroids
    body = np.repeat(np.arange(len(clumps)), np.diff(starts))
    spheres = np.empty((len(body), 4))
    rotations = matrix_from_quaternion(quaternions)[body]
    spheres[:, :3] = np.einsum("nij,nj->ni", rotations, np.concatenate([clump.centers for clump in clumps]))
    spheres[:, 3] = np.concatenate([clump.radii for clump in clumps])
    spheres[:, 2] += np.maximum.reduceat(spheres[:, 3] - spheres[:, 2], starts[:-1])[body]
    low = np.minimum.reduceat(spheres[:, :2] - spheres[:, 3:], starts[:-1])
    high = np.maximum.reduceat(spheres[:, :2] + spheres[:, 3:], starts[:-1])
    widths = high - low
    wide = np.flatnonzero((widths * (1.0 + 2.0 * CLEARANCE) >= size).any(axis=1))
    if len(wide):  # it would overlap its own image, or the border
        b = wide[0]
        message = f"body {b} is {widths[b, 0]:.3g} m by {widths[b, 1]:.3g} m wide and does not fit into"
        raise InputError(Fault("domain.size", f"{message} {size[0]:.3g} m by {size[1]:.3g} m"))
    columns = _empty_columns(spheres[:, 3], size, periodic)
    order = np.argsort(-widths.prod(axis=1), kind="stable")
    margin = CLEARANCE * spheres[:, 3].max()
    count = 0
    for done, b in enumerate(order):
        lower_limit, upper_limit = (np.zeros(2), size) if periodic else (margin - low[b], size - margin - high[b])
        for batch in _BATCHES:
            tries = lower_limit + (upper_limit - lower_limit) * rng.random((batch, 2))
            k = place_body(tries, spheres[starts[b] : starts[b + 1]], count, columns, CLEARANCE)
            if k >= 0:
                break
        else:
            areas = np.array([projected_area(spheres[starts[b] : starts[b + 1]]) for b in order]) / size.prod()
            raise InputError(
                Fault("domain.size", f"{_no_space(order, done, areas, 'area')}; make domain.size larger or count smaller")
            )
        xy[b] = tries[k]
        count += starts[b + 1] - starts[b]
    return xy


def _no_space(order: Array, done: int, fractions: Array, kind: str) -> str:
    reached = f"{kind} fraction {fractions[:done].sum():.3f} reached of {fractions.sum():.3f} wanted"
    return f"no space for body {order[done]} after {sum(_BATCHES)} tries: {done} of {len(order)} bodies placed, {reached}"


def near_pairs(S: Array, body: Array, corners: tuple[Array, Array], periodic: bool, skin: float) -> tuple[Array, Array]:
    """Return the pairs of spheres S (n, 4) of different bodies, body (n,), that come within the skin of each other.

    corners: of the domain, (3,) each, infinite where it is open; periodic: whether it is so in x and y.
    """
    table = np.zeros((len(S), sphere.WIDTH))  # the search reads that of the engine
    table[:, :4] = S
    spheres = neighbour_search.Spheres(body, np.full(len(S), EVERYTHING, np.int8))
    reach = 2.0 * float(S[:, 3].max()) + skin
    low = np.where(np.isfinite(corners[0]), corners[0], S[:, :3].min(axis=0))
    length = np.where(np.isfinite(corners[1]), corners[1], S[:, :3].max(axis=0)) - low
    # at most twice the square root of the spheres as cells per axis: bounds the grid of a low bed of small bodies
    count = np.clip((length / reach).astype(np.int64), 1, 2 * math.ceil(math.sqrt(len(S))))
    periods = length[:2].tolist() if periodic else (0.0, 0.0)
    grid = neighbour_search.Grid(low, np.maximum(length, reach) / count, count, np.array([periodic] * 2), *periods)
    capacity = 16 * len(S)
    while True:
        own, partner = np.empty(capacity, np.int32), np.empty(capacity, np.int32)
        n = neighbour_search.pair_candidates(table, spheres, skin, grid, 0, own, partner)
        if n <= capacity:
            return own[:n].copy(), partner[:n].copy()
        capacity = int(1.2 * n)


def deepest(first: Array, second: Array, depth: Array) -> tuple[Array, Array, Array]:
    """Return the deepest overlap of every pair of bodies, the deepest pair first: bodies (n,), the lesser first, and depth (n,).

    A negative number in second names a wall and stays there.
    """
    wall = second < 0
    a, b = np.where(wall, first, np.minimum(first, second)), np.where(wall, second, np.maximum(first, second))
    order = np.lexsort((b, a, -depth))
    pairs = np.column_stack((a, b))[order]
    rows = np.sort(np.unique(pairs, axis=0, return_index=True)[1])
    return pairs[rows, 0], pairs[rows, 1], depth[order][rows]


def overlaps(
    centers: Array, radii: Array, body: Array, domain_size: tuple[float, float], periodic: bool
) -> list[tuple[int, int, float]]:
    """Return pairs of overlapping bodies (a < b) with their deepest overlap [m], the deepest pair first.

    centers (n, 3), radii (n,), body (n,): the body of each sphere. Spheres of one body are not compared. Periodic in x and y: to
    the nearest image. Touching is no overlap.
    """
    if not len(radii):
        return []
    ids, period = np.ascontiguousarray(body, dtype=np.int64), np.array([*domain_size, math.inf])
    corners = (np.zeros(3), period) if periodic else (np.full(3, -math.inf), np.full(3, math.inf))
    corners[0][2] = -math.inf
    own, partner = near_pairs(np.column_stack((centers, radii)), ids, corners, periodic, 0.0)
    between = centers[own] - centers[partner]
    if periodic:
        between[:, :2] -= period[:2] * np.floor(between[:, :2] / period[:2] + 0.5)
    depth = radii[own] + radii[partner] - np.linalg.norm(between, axis=1)
    real = depth > 0.0
    columns = deepest(ids[own][real], ids[partner][real], depth[real])
    return list(zip(*(column.tolist() for column in columns), strict=True))


def projected_area(spheres: Array) -> float:
    """Return the area [m2] that the spheres (k, 4: x, y, z, radius) cover seen from above."""
    scale = spheres[:, 3].max()
    moments = np.empty(6)
    union_of_discs((spheres[:, :2] - spheres[0, :2]) / scale, spheres[:, 3] / scale, moments)
    return float(moments[0] * scale**2)


def scatter(
    clumps: Sequence[Clump],
    height: float,
    domain_size: tuple[float, float],
    periodic: bool,
    rng: np.random.Generator,
    standing: Array | None = None,
) -> tuple[Array, Array]:
    """Return centroids (n, 3) [m] and quaternions (n, 4) of bodies placed between z = 0 and the height [m].

    Orientations are uniform over all rotations, positions over the range of the rotated body; x and y are in [0, size), periodic,
    or the whole body stays inside. Large bodies first; spheres of different bodies keep a gap of 1e-3 of the sum of their radii,
    also to those of `standing` (m, 4: x, y, z, radius) [m]. InputError, with the solid fraction reached: no free position in 50
    000 tries; or a body longer than a period.
    """
    box = np.array([*domain_size, height], dtype=np.float64)
    refuse_long(clumps, box, periodic)
    x, q = np.empty((len(clumps), 3)), np.empty((len(clumps), 4))
    if not len(clumps):
        return x, q
    old = np.empty((0, 4)) if standing is None else standing
    columns = _empty_columns(np.concatenate([old[:, 3], *(body.radii for body in clumps)]), box, periodic)
    count = len(old)
    place_body(np.zeros((1, 2)), old, 0, columns, CLEARANCE)  # where they are
    order = np.argsort([-body.volume for body in clumps], kind="stable")
    for done, b in enumerate(order):
        body = clumps[b]
        spheres = np.empty((len(body.radii), 4))
        for batch in _BATCHES:
            tries = np.concatenate([rng.normal(size=(batch, 4)), rng.random((batch, 3))], axis=1)
            tries[:, :4] /= np.linalg.norm(tries[:, :4], axis=1)[:, None]
            k = place_rotated(tries, body.centers, body.radii, count, columns, CLEARANCE, spheres)
            if k >= 0:
                break
        else:
            fractions = np.array([clumps[b].volume for b in order]) / box.prod()
            message = f"{_no_space(order, done, fractions, 'solid')} in a volume {height:.3g} m high"
            raise InputError(Fault("height", message))
        q[b] = tries[k, :4]
        x[b] = spheres[0, :3] - matrix_from_quaternion(q[b]) @ body.centers[0]
        count += len(spheres)
    x[:, :2] -= np.floor(x[:, :2] / box[:2]) * box[:2] if periodic else 0.0
    return x, q


def refuse_long(clumps: Sequence[Clump], size: Array, periodic: bool) -> None:
    """Raise InputError for a body that, in some orientation, would overlap its own image."""
    side = float(min(size[:2]))
    for b, body in enumerate(clumps if periodic else ()):
        apart = np.linalg.norm(body.centers[:, None] - body.centers, axis=-1)
        length = float((apart + body.radii[:, None] + body.radii).max())
        if length * (1.0 + 2.0 * CLEARANCE) >= side:
            message = f"body {b} is {length:.3g} m long and would meet its own image in a period of {side:.3g} m"
            raise InputError(Fault("domain.size", message))
