"""Irregular clumps, their asperities and size distributions: random debris, reproducible body by body."""

import math
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from statistics import NormalDist

import numpy as np

from thirdbody.bodies.clump import Clump, clump, clumps, sphere_points, stacks, touched
from thirdbody.bodies.union_moments import longest_links
from thirdbody.errors import Fault, InputError
from thirdbody.rotations import dot
from thirdbody.system.processes import cores

# Distance of linked centers over the sum of radii: a larger one looks like a string of beads,
# a smaller one hides the single spheres.
_NECK = (0.55, 0.8)
_NECK_FLAT = 0.9
# Smallest ratio of two radii of a clump: lower bound of the random weights.
_UNEQUAL = 0.6
# Smallest exposed fraction of a sphere's surface.
_EXPOSED = 0.08
_TRIES = 200
# Of the most angular clump: distance of linked centers over the sum of radii (a small sphere must be farther away to
# protrude), and the smallest radius of a corner over that of the core.
_NECK_SHARP = 0.95
_CORNER = 0.2
# Twice the number of times that the caps of all corners cover the sphere before random gaps no longer expose the core
# (the thinnest covering takes 2.4).
_COVER = 4.0
# Fewer spheres cannot surround a core.
_CORED = 5
# Candidate points per sphere or asperity, of which the farthest from those placed before is chosen (best candidate).
_CANDIDATES = 12
# Bodies with open random streams; largest size of a stack, spheres cubed times bodies, which takes some 60 MB.
_BLOCK, _LARGEST_STACK = 4096, 1_000_000
# The radius of asperities depends on the size of the whole body, which they change: each iteration reduces the misfit
# to less than this fraction (at most 0.5; 0.01 for small ones), so that rounding is reached long before the limit.
_ROUNDS = 60

_SURFACE = sphere_points(48)


def irregular(rng: np.random.Generator, n_spheres: int, aspect, diameter: float, angularity: float = 0.0) -> Clump:
    """Return a connected clump of unequal spheres that fills an envelope with the axis ratios aspect (3,).

    angularity (0 to 1): how much the spheres shrink towards the corners of the hull, so that summits get sharper
    (`clump.summit_radii`). The sphere nearest the middle becomes a core, the others move out onto the hull and shrink, at 1
    to the size at which planes still touch them and not the core (0.2 of it at least); links lengthen to 0.95 of the sum of
    radii. Fewer than 5 spheres cannot surround a core: only their links lengthen. Where corners would lose contact with the core
    (flat or long envelopes), the angularity is reduced to keep the aspect.

    The volume-equivalent diameter [m] holds to a third of the clump's stated error. Every sphere keeps at least 8 % of its
    surface exposed. A flat envelope needs many spheres: with few, the clump is as flat as connected spheres can be. One sphere is
    a sphere, whatever the aspect. InputError: too many spheres for each to be exposed.
    """
    return _irregulars([rng], n_spheres, aspect, np.array([diameter]), angularity)[0]


def _irregulars(rngs: list[np.random.Generator], n_spheres: int, aspect, diameters: np.ndarray, angularity: float) -> list[Clump]:
    """Return one body as of `irregular` for each stream and diameter; each is independent of the others."""
    if n_spheres == 1:
        return [clump(np.zeros((1, 3)), [0.5 * diameter]) for diameter in diameters]
    envelope = np.array(aspect, dtype=np.float64) / max(aspect)
    centers, radii = np.empty((len(rngs), n_spheres, 3)), np.empty((len(rngs), n_spheres))
    left = np.arange(len(rngs))
    for _ in range(_TRIES):
        centers[left], radii[left] = _grown([rngs[k] for k in left], n_spheres, envelope, angularity)
        left = left[~_all_exposed(centers[left], radii[left])]
        if not len(left):
            break
    else:
        raise InputError(
            f"no irregular clump of {n_spheres} spheres with aspect {list(aspect)} in {_TRIES} tries leaves "
            "every sphere partly free; take fewer spheres or a longer aspect"
        )
    built = clumps(centers, radii)
    return [body.scaled(diameter / body.diameter) for body, diameter in zip(built, diameters.tolist(), strict=True)]


def population(
    seed: int,
    population_index: int,
    count: int,
    spheres: tuple[int, int],
    aspect,
    angularity: float = 0.0,
    asperities: tuple[int, Callable[[float], float]] | None = None,
    shapes: int | None = None,
    **size,
) -> list[Clump]:
    """Return the clumps of a population; size: keywords of `diameters`, spheres: range per body.

    asperities: their number, and their radius over the body's equivalent radius as a function of its diameter. Body k draws from
    its own stream, so it is the same for every count; asperities draw last, so that the body under them has the same shape as
    without them. From body `shapes` on, it draws its size and which of the first bodies it is a copy of. InputError: as
    `irregular` and `diameters`.
    """
    bodies: list[Clump] = []
    different = count if shapes is None else min(count, shapes)
    for rngs in _streams(seed, population_index, 0, different):
        n_spheres = np.array([rng.integers(spheres[0], spheres[1] + 1) for rng in rngs])
        wide = diameters(rngs, **size)
        built: dict[int, Clump] = {}
        with ThreadPoolExecutor(cores()) as pool:
            tasks = [
                (part, pool.submit(_irregulars, [rngs[k] for k in part], n, aspect, wide[part], angularity))
                for n, members in reversed([*stacks(n_spheres, _LARGEST_STACK)])  # the dearest first
                for part in np.array_split(members, min(cores(), len(members)))
            ]
        for part, task in reversed(tasks):
            built.update(zip(part.tolist(), task.result(), strict=True))
        for k, rng in enumerate(rngs):
            body, diameter = built[k], float(wide[k])
            if asperities is not None:
                body = with_asperities(rng, body, asperities[0], asperities[1](diameter))
            bodies.append(body)
    originals = bodies[:different]
    for rngs in _streams(seed, population_index, different, count):
        chosen = [int(rng.integers(different)) for rng in rngs]
        wide = diameters(rngs, **size)
        bodies += [originals[k].resized(diameter) for k, diameter in zip(chosen, wide.tolist(), strict=True)]
    return bodies


def _streams(seed: int, population_index: int, begin: int, end: int) -> Iterator[list[np.random.Generator]]:
    for first in range(begin, end, _BLOCK):
        block = range(first, min(end, first + _BLOCK))
        yield [np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(population_index, k))) for k in block]


def diameters(rngs: Sequence[np.random.Generator], distribution: str, **size: float) -> np.ndarray:
    """Return a diameter [m] from each random stream, of a distribution truncated (not clipped) at min and max.

    lognormal: median [m], sigma (of the logarithm); normal: mean, sigma [m]; uniform: min, max; constant: value. The truncation
    is exact: a uniform number between the cumulative values of the limits is inverted. InputError: nothing between the limits.
    """
    low, high = size.get("min", 0.0), size.get("max", math.inf)
    if distribution == "constant":
        return np.full(len(rngs), size["value"])
    levels = np.array([rng.random() for rng in rngs])
    if distribution == "uniform":
        return low + (high - low) * levels
    if distribution == "normal":
        return _cut_normal(levels, NormalDist(size["mean"], size["sigma"]), low, high)
    low, high = math.log(low) if low > 0.0 else -math.inf, math.log(high)
    return np.exp(_cut_normal(levels, NormalDist(math.log(size["median"]), size["sigma"]), low, high))


def _cut_normal(levels: np.ndarray, normal: NormalDist, low: float, high: float) -> np.ndarray:
    # The far tail above the mean loses its digits in 1 - tail: it is mirrored to below the mean.
    if low > normal.mean:
        return -_cut_normal(levels, NormalDist(-normal.mean, normal.stdev), -high, -low)
    first, last = normal.cdf(low), normal.cdf(high)
    if not last - first > 0.0:
        raise InputError(Fault("size", "the distribution has nothing between min and max"))
    # The limit itself closes the open end at 0 of the levels.
    drawn = np.maximum(first + (last - first) * levels, np.nextafter(first, 1.0))
    return np.clip([normal.inv_cdf(level) for level in drawn.tolist()], low, high)  # rounding of the inversion only


def with_asperities(rng: np.random.Generator, body: Clump, count: int, fraction: float) -> Clump:
    """Return the body with `count` spheres on its surface, of its original volume-equivalent diameter.

    The centre of each sphere lies on the surface of the body, where a plane from a random direction would touch it: its summit
    protrudes by its own radius towards that plane, which then touches it and nothing else; the body stays in one piece. The
    points are spread: each is the farthest of 12 candidates from those before. The radius is `fraction` of the equivalent radius
    (half the diameter) of the whole; the asperities come last among the spheres, all of one radius.
    """
    normals = rng.normal(size=(count, _CANDIDATES, 3))
    normals /= np.linalg.norm(normals, axis=2, keepdims=True)
    sphere = touched(body, normals.reshape(-1, 3)).reshape(count, _CANDIDATES)
    points = body.centers[sphere] + body.radii[sphere][:, :, None] * normals
    summits = np.empty((count, 3))
    summits[0] = points[0, 0]
    for k in range(1, count):
        apart = ((points[k][:, None] - summits[:k]) ** 2).sum(axis=2).min(axis=1)
        summits[k] = points[k, np.argmax(apart)]
    radius = 0.5 * body.diameter
    small, size = fraction * radius, radius
    for _ in range(_ROUNDS):
        whole = clump(np.concatenate((body.centers, summits)), np.concatenate((body.radii, np.full(count, small))))
        before, size = size, 0.5 * whole.diameter
        if abs(size - before) <= 1e-14 * size:
            break
        small = fraction * size
    return whole.scaled(radius / size)


def _grown(rngs: list[np.random.Generator], n: int, envelope: np.ndarray, angularity: float) -> tuple[np.ndarray, np.ndarray]:
    """Return centers (b, n, 3) and radii (b, n) of connected trial clumps inside the envelope, one per stream."""
    candidates, numbers = np.empty((len(rngs), n, _CANDIDATES, 3)), np.empty((len(rngs), (_CANDIDATES + 1) * n + 1))
    for k, rng in enumerate(rngs):
        rng.standard_normal(out=candidates[k])
        rng.random(out=numbers[k])
    seeds = _scattered_seeds(candidates, numbers[:, : _CANDIDATES * n].reshape(-1, n, _CANDIDATES), envelope)
    weights = _UNEQUAL + (1.0 - _UNEQUAL) * numbers[:, _CANDIDATES * n : -1]
    neck = _NECK[0] + (_NECK[1] - _NECK[0]) * numbers[:, -1]
    thinnest = envelope.min()
    inset = np.ones_like(weights)
    if angularity > 0.0:
        seeds, weights, inset, neck = _sharpened(seeds, weights, neck, envelope, angularity)

    # The larger the spheres, the smaller the volume of their centers: find the smallest radius that connects them.
    low, high = np.full(len(rngs), 0.02 * thinnest), np.full(len(rngs), thinnest)
    excess = _reach(seeds, weights, inset, envelope, high) / neck
    flat = excess > 1.0
    for _ in range(12):
        middle = 0.5 * (low + high)
        apart = _reach(seeds, weights, inset, envelope, middle) / neck > 1.0
        low, high = np.where(apart, middle, low), np.where(apart, high, middle)
    high[flat] = thinnest
    centers = seeds * (envelope - high[:, None, None] * inset[:, :, None])
    # Too flat for this many spheres: contracted in the plane until they connect, and no closer than necessary, to look flat.
    centers[flat] /= (excess * neck / _NECK_FLAT)[flat, None, None]
    return centers, high[:, None] * weights


def _reach(seeds, weights: np.ndarray, inset, envelope: np.ndarray, radius: np.ndarray) -> np.ndarray:
    """Return the largest distance over sum of radii, (b,), of links in clumps of largest radius (b,)."""
    return longest_links(seeds * (envelope - radius[:, None, None] * inset[:, :, None]), radius[:, None] * weights)


def _sharpened(
    seeds: np.ndarray, weights: np.ndarray, neck: np.ndarray, envelope: np.ndarray, angularity: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return seeds (b, n, 3), weights (b, n), insets (b, n) and necks (b,) of more angular trial clumps.

    The aspect has priority: where corners would be too small to reach the core, the angularity is reduced until they do.
    """
    thinnest = np.full(len(neck), envelope.min())
    plain = _reach(seeds, weights, np.ones_like(weights), envelope, thinnest)
    low, high = np.zeros_like(neck), np.full_like(neck, angularity)
    for step in range(8):
        trial = high if step == 0 else 0.5 * (low + high)
        built = _cored(seeds, weights, neck, trial)
        connects = _reach(*built[:3], envelope, thinnest) <= np.maximum(plain, built[3])
        low, high = np.where(connects, trial, low), np.where(connects, high, trial)
    return _cored(seeds, weights, neck, low)


def _cored(
    seeds: np.ndarray, weights: np.ndarray, neck: np.ndarray, angularity: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Make the seed nearest the middle the core, the others corners on the hull (see `_sharpened`).

    A plane between corners that surround a core of radius 1 evenly, at the distance s (1 + rho), clears it if s (1 + rho) cos t +
    rho > 1; m caps of the angle t have m (1 - cos t) / 2 times the area of the sphere.
    """
    n = weights.shape[1]
    neck = neck + angularity * (_NECK_SHARP - neck)
    if n < _CORED:
        return seeds, weights, np.ones_like(weights), neck
    cosine = _NECK_SHARP * max(0.0, 1.0 - _COVER / (n - 1))
    corner = max(_CORNER, (1.0 - cosine) / (1.0 + cosine))
    distance, sharp = np.sqrt(dot(seeds, seeds)), angularity[:, None]
    core = np.arange(n) == distance.argmin(axis=1)[:, None]
    moved = np.where(core, 1.0 - sharp, 1.0 - sharp + sharp / distance)
    shrunk = np.where(core, 1.0, 1.0 - sharp * (1.0 - corner))
    full = np.where(core, weights + sharp * (1.0 - weights), weights * shrunk)
    return seeds * moved[:, :, None], full, shrunk, neck


def _scattered_seeds(candidates: np.ndarray, levels: np.ndarray, envelope: np.ndarray) -> np.ndarray:
    """Return points (b, n, 3) in the unit sphere, far apart in the envelope (best candidate).

    candidates (b, n, 12, 3): normal numbers, levels (b, n, 12): uniform ones.
    """
    candidates = candidates / np.sqrt(dot(candidates, candidates))[..., None]
    candidates *= (levels ** (1.0 / 3.0))[..., None]
    bodies, n = np.arange(len(candidates)), candidates.shape[1]
    points = np.empty((len(candidates), n, 3))
    points[:, 0] = candidates[:, 0, 0]
    for k in range(1, n):
        gaps = (candidates[:, k, :, None] - points[:, None, :k]) * envelope
        points[:, k] = candidates[bodies, k, dot(gaps, gaps).min(axis=2).argmax(axis=1)]
    if n >= 4:
        # Extended to the sides of the envelope, else few spheres would not show the aspect.
        low, high = points.min(axis=1, keepdims=True), points.max(axis=1, keepdims=True)
        points = (2.0 * points - low - high) / (high - low)
    return points


def _all_exposed(centers: np.ndarray, radii: np.ndarray) -> np.ndarray:
    n = radii.shape[1]
    arm = centers[:, :, None] - centers[:, None]
    # A point r u of sphere i lies in sphere j if (arm + r u)^2 < r_j^2.
    reach = (radii**2)[:, None] - (radii**2)[:, :, None] - dot(arm, arm)
    reach[:, np.arange(n), np.arange(n)] = -np.inf
    inside = 2.0 * radii[:, :, None, None] * arm @ _SURFACE.T < reach[..., None]
    return ((~inside.any(axis=2)).mean(axis=2) >= _EXPOSED).all(axis=1)
