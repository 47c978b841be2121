"""Random debris: irregular clumps and size distributions, reproducible body by body."""

from __future__ import annotations

import math
from statistics import NormalDist

import numpy as np

from thirdbody.bodies.asperities import Asperities, sphere_points, with_asperities
from thirdbody.bodies.clump import Clump, clump
from thirdbody.errors import Fault, InputError
from thirdbody.kernels.union import links

# Neighbours overlap until their centers are this fraction of the sum of radii apart: less looks like a
# string of beads, more hides the single spheres.
_NECK = (0.55, 0.8)
_NECK_FLAT = 0.9
# Smallest radius over largest, before chance.
_UNEQUAL = 0.6
# Least part of a sphere's surface that the other spheres leave free.
_EXPOSED = 0.08
_TRIES = 200
# Of the sharpest clump: the part of the sum of radii that centers are apart (a small sphere must stand farther off to
# stand out), and the least radius of a corner over that of the core.
_NECK_SHARP = 0.95
_CORNER = 0.2
# Twice the times that the caps of all corners cover the sphere before chance leaves no gap that shows the core (the
# thinnest covering takes 2.4).
_COVER = 4.0
# Fewer spheres cannot surround a core.
_CORED = 5


_SURFACE = sphere_points(48)


def irregular(rng: np.random.Generator, n_spheres: int, aspect, diameter: float, angularity: float = 0.0) -> Clump:
    """Connected clump of unequal spheres filling an envelope with the axis ratios aspect (3,).

    angularity (0 to 1): how strongly the spheres shrink towards the corners of the hull, so that summits get sharper
    (`asperities.summit_radii`). The sphere nearest the middle becomes a core, the others move out onto the hull and
    shrink, at 1 to the size at which planes still touch them and not the core (0.2 of it at least); links lengthen to
    0.95 of the sum of radii. Fewer than 5 spheres cannot surround a core: only their links lengthen. Where corners
    would lose touch with the core (flat or long envelopes), the body is only as angular as keeps its aspect.

    The volume-equivalent diameter (m) holds to a third of the clump's stated error. Every sphere keeps at
    least 8 % of its surface free. A flat envelope needs many spheres: with few, the clump is as flat as
    connected spheres can be. One sphere is a sphere, whatever the aspect.
    InputError: n_spheres < 1, aspect or diameter not positive, angularity out of range, or too many spheres to leave
    each one free.
    """
    envelope = _checked_envelope(n_spheres, aspect, diameter)
    if not 0.0 <= angularity <= 1.0:
        raise InputError(Fault("angularity", f"{angularity:g} must be 0 to 1"))
    if n_spheres == 1:
        return clump(np.zeros((1, 3)), [0.5 * diameter])
    for _ in range(_TRIES):
        centers, radii = _grown(rng, n_spheres, envelope, angularity)
        if _all_exposed(centers, radii):
            body = clump(centers, radii)
            return body.scaled(diameter / body.diameter)
    raise InputError(
        f"no irregular clump of {n_spheres} spheres with aspect {list(aspect)} in {_TRIES} tries leaves "
        "every sphere partly free; take fewer spheres or a longer aspect"
    )


def population(
    seed: int,
    population_index: int,
    count: int,
    spheres: tuple[int, int],
    aspect,
    angularity: float = 0.0,
    asperities: Asperities | None = None,
    **size,
) -> list[Clump]:
    """Clumps of one population; size: the keywords of `diameters`, spheres: least and most per body.

    Body k draws from its own stream, so it is the same for every count; asperities draw last, so that the body under
    them has the shape that it has without. InputError: as `irregular`, `diameters` and `Asperities.fraction`.
    """
    least, most = spheres
    if not 1 <= least <= most:
        raise InputError(Fault("spheres", f"[{least}, {most}] must be 1 or more, the lesser first"))
    bodies = []
    for k in range(count):
        rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(population_index, k)))
        n_spheres = int(rng.integers(least, most + 1))
        diameter = float(diameters(rng, 1, **size)[0])
        body = irregular(rng, n_spheres, aspect, diameter, angularity)
        if asperities is not None:
            body = with_asperities(rng, body, asperities.count, asperities.fraction(diameter))
        bodies.append(body)
    return bodies


def diameters(
    rng: np.random.Generator,
    count: int,
    distribution: str,
    *,
    median: float | None = None,
    mean: float | None = None,
    sigma: float | None = None,
    value: float | None = None,
    min: float | None = None,
    max: float | None = None,
) -> np.ndarray:
    """Diameters (count,) in m from a distribution cut off (not clipped) at min and max.

    lognormal: median (m), sigma (of the logarithm); normal: mean, sigma (m); uniform: min, max;
    constant: value. The cut is exact: a uniform number between the cumulative values of the limits is
    inverted. InputError: a parameter that is missing, not used, or out of range, an unknown distribution.
    """
    given = {"median": median, "mean": mean, "sigma": sigma, "value": value, "min": min, "max": max}
    _check_size(distribution, given)
    low, high = min or 0.0, math.inf if max is None else max
    if value is not None:
        return np.full(count, value)
    if distribution == "uniform":
        return low + (high - low) * rng.random(count)
    if median is not None:
        normal = NormalDist(math.log(median), sigma or 0.0)
        low, high = math.log(low) if low > 0.0 else -math.inf, math.log(high)
        return np.exp(_cut_normal(rng, count, normal, low, high))
    return _cut_normal(rng, count, NormalDist(mean or 0.0, sigma or 0.0), low, high)


def _cut_normal(
    rng: np.random.Generator, count: int, normal: NormalDist, low: float, high: float
) -> np.ndarray:
    # The far tail above the mean loses its digits in 1 - tail: mirror it to the side below.
    if low > normal.mean:
        mirrored = NormalDist(-normal.mean, normal.stdev)
        return -_cut_normal(rng, count, mirrored, -high, -low)
    first, last = normal.cdf(low), normal.cdf(high)
    if not last - first > 0.0:
        raise InputError(Fault("size", "the distribution has nothing between min and max"))
    # 1 - random() lies in (0, 1]; the open end at 1 is closed by the limit itself.
    levels = first + (last - first) * rng.random(count)
    smallest = np.nextafter(first, 1.0)
    drawn = [normal.inv_cdf(float(np.maximum(level, smallest))) for level in levels]
    return np.clip(drawn, low, high)  # rounding of the inversion only


_SIZE_KEYS = {
    "lognormal": ({"median", "sigma"}, {"min", "max"}),
    "normal": ({"mean", "sigma"}, {"min", "max"}),
    "uniform": ({"min", "max"}, set()),
    "constant": ({"value"}, set()),
}


def _check_size(distribution: str, given: dict[str, float | None]) -> None:
    if distribution not in _SIZE_KEYS:
        known = ", ".join(_SIZE_KEYS)
        raise InputError(Fault("size.distribution", f"'{distribution}' is not known; known: {known}"))
    needed, optional = _SIZE_KEYS[distribution]
    faults = []
    for key, number in given.items():
        if number is None:
            if key in needed:
                faults.append(Fault(f"size.{key}", f"a {distribution} distribution needs it"))
        elif key not in needed | optional:
            faults.append(Fault(f"size.{key}", f"a {distribution} distribution does not use it"))
        elif not (math.isfinite(number) and number > 0.0):
            faults.append(Fault(f"size.{key}", f"{number:g} must be positive and finite"))
    low, high = given["min"], given["max"]
    if not faults and low is not None and high is not None and low > high:
        faults.append(Fault("size.min", f"{low:g} m is more than max = {high:g} m"))
    if faults:
        raise InputError(faults)


def _checked_envelope(n_spheres: int, aspect, diameter: float) -> np.ndarray:
    """Half axes (3,) of the envelope, the longest 1."""
    axes = np.array(aspect, dtype=np.float64)
    faults = []
    if n_spheres < 1:
        faults.append(Fault("spheres", f"{n_spheres} must be 1 or more"))
    if axes.shape != (3,) or not np.isfinite(axes).all() or not (axes > 0.0).all():
        faults.append(Fault("aspect", f"{axes.tolist()} must be three positive numbers"))
    if not (math.isfinite(diameter) and diameter > 0.0):
        faults.append(Fault("size", f"diameter {diameter:g} m must be positive and finite"))
    if faults:
        raise InputError(faults)
    return axes / axes.max()


def _grown(
    rng: np.random.Generator, n: int, envelope: np.ndarray, angularity: float
) -> tuple[np.ndarray, np.ndarray]:
    """Centers (n, 3) and radii (n,) of a connected trial clump inside the envelope."""
    seeds = _spread(rng, n, envelope)
    weights = rng.uniform(_UNEQUAL, 1.0, n)
    neck = rng.uniform(*_NECK)
    thinnest = envelope.min()
    inset = np.ones((n, 1))
    if angularity > 0.0:
        seeds, weights, inset, neck = _sharpened(seeds, weights, neck, envelope, angularity)

    def stretched(radius: float) -> float:
        return _reach(seeds, weights, inset, envelope, radius) / neck

    # The larger the spheres, the smaller the room for their centers: the least radius that connects them.
    low, high = 0.02 * thinnest, thinnest
    if (excess := stretched(high)) > 1.0:
        # Too flat for this many spheres: drawn together in the plane until they connect, and no closer than
        # they must, or it would not look flat.
        return seeds * (envelope - high * inset) / (excess * neck / _NECK_FLAT), high * weights
    for _ in range(12):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if stretched(middle) > 1.0 else (low, middle)
    return seeds * (envelope - high * inset), high * weights


def _reach(seeds, weights: np.ndarray, inset, envelope: np.ndarray, radius: float) -> float:
    """Largest distance over sum of radii among the links of the trial clump whose largest radius is `radius`."""
    reach, joined = np.empty(weights.size), np.empty(weights.size, np.bool_)
    links(seeds * (envelope - radius * inset), radius * weights, reach, joined)
    return float(reach.max())


def _sharpened(
    seeds: np.ndarray, weights: np.ndarray, neck: float, envelope: np.ndarray, angularity: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
    """Seeds (n, 3), weights (n,), insets (n, 1) and neck of a sharper trial clump.

    Aspect goes first: where the corners would be too small to reach the core, the angularity is lowered until they do.
    """
    thinnest = envelope.min()
    plain = _reach(seeds, weights, np.ones((weights.size, 1)), envelope, thinnest)
    low, high = 0.0, angularity
    for step in range(8):
        trial = high if step == 0 else 0.5 * (low + high)
        made = _cored(seeds, weights, neck, trial)
        connects = _reach(*made[:3], envelope, thinnest) <= max(plain, made[3])
        low, high = (trial, high) if connects else (low, trial)
        if low == angularity:
            break
    return _cored(seeds, weights, neck, low)


def _cored(
    seeds: np.ndarray, weights: np.ndarray, neck: float, angularity: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
    """The seed nearest the middle as core, the others as corners that stand on the hull: as `_sharpened`.

    A plane between corners that surround a core of radius 1 evenly, at the distance s (1 + rho), clears it if
    s (1 + rho) cos t + rho > 1; m caps of the angle t have m (1 - cos t) / 2 times the area of the sphere.
    """
    n = weights.size
    neck = neck + angularity * (_NECK_SHARP - neck)
    inset = np.ones((n, 1))
    if n < _CORED:
        return seeds, weights, inset, neck
    cosine = _NECK_SHARP * max(0.0, 1.0 - _COVER / (n - 1))
    corner = max(_CORNER, (1.0 - cosine) / (1.0 + cosine))
    far = np.linalg.norm(seeds, axis=1, keepdims=True)
    core = np.arange(n) == far.argmin()
    moved = np.where(core[:, None], 1.0 - angularity, 1.0 - angularity + angularity / far)
    shrunk = np.where(core, 1.0, 1.0 - angularity * (1.0 - corner))
    full = np.where(core, weights + angularity * (1.0 - weights), weights * shrunk)
    return seeds * moved, full, shrunk[:, None], neck


def _spread(rng: np.random.Generator, n: int, envelope: np.ndarray) -> np.ndarray:
    """Points (n, 3) in the unit ball, far apart once stretched to the envelope (best candidate of 12)."""
    candidates = rng.normal(size=(n, 12, 3))
    candidates /= np.linalg.norm(candidates, axis=2, keepdims=True)
    candidates *= rng.random((n, 12, 1)) ** (1.0 / 3.0)
    points = np.empty((n, 3))
    points[0] = candidates[0, 0]
    for k in range(1, n):
        gaps = (candidates[k][:, None] - points[:k]) * envelope
        points[k] = candidates[k, np.argmax((gaps * gaps).sum(axis=2).min(axis=1))]
    if n >= 4:
        # Filled to the envelope's sides, or few spheres would not show the aspect.
        low, high = points.min(axis=0), points.max(axis=0)
        points = (2.0 * points - low - high) / (high - low)
    return points


def _all_exposed(centers: np.ndarray, radii: np.ndarray) -> bool:
    """Whether every sphere shows at least the part _EXPOSED of its surface."""
    n = radii.size
    points = centers[:, None] + radii[:, None, None] * _SURFACE
    square = ((points[:, :, None] - centers) ** 2).sum(axis=3)
    inside = square < radii**2
    inside[np.arange(n), :, np.arange(n)] = False
    return bool(((~inside.any(axis=2)).mean(axis=1) >= _EXPOSED).all())
