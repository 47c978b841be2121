"""Moments of the union of spheres, from slices whose union of discs is integrated in closed form.

A slice z = const cuts the spheres in discs. The boundary of their union consists of exposed arcs, and Green's theorem turns area
and moments into integrals over these arcs, which have closed forms. Along z the moments are smooth between break heights (poles,
ends of the circles where two spheres intersect, points where three intersect) apart from half-integer powers at the ends, which z
= mid - half cos(t) removes: Gauss-Legendre in t then converges geometrically. Lengths are in units of the largest radius.
"""

import math
from functools import cache
from itertools import combinations
from typing import NamedTuple

import numpy as np
from numba import njit

from thirdbody.jit.options import BARE, BARE_CHUNK, DIRECT, NO_COUNTS
from thirdbody.rotations import cross, dot

TWO_PI = 2.0 * math.pi
# Order of the ten moments: 1, x, y, z, xx, yy, zz, xy, xz, yz.
MOMENTS = 10
# Of a layer, in units of the largest radius: the error of some 40 layers is then below 1e-5 of the volume (> 4).
_TOLERANCE = 2e-7
# Largest number of distances from marks to centers in memory at once: a hundred spheres have 33 million.
_MEASURED = 1_000_000


class Rule(NamedTuple):
    """Gauss-Legendre in t, z = -cos(t), of several orders: nodes in (-1, 1), weights, and the first node of each order."""

    nodes: np.ndarray
    weights: np.ndarray
    offsets: np.ndarray


class Scratch(NamedTuple):
    """Scratch for one body: that of `disc_moments`, then radii and moments of the discs of a slice, and moments by two orders."""

    toward: np.ndarray
    cuts: np.ndarray
    order: np.ndarray
    rho: np.ndarray
    plane: np.ndarray
    old: np.ndarray
    new: np.ndarray


_ORDERS = (5, 10, 20, 40, 80)
_X, _W = np.concatenate([np.polynomial.legendre.leggauss(order) for order in _ORDERS], axis=1)
_T = 0.5 * math.pi * (_X + 1.0)
_RULE = Rule(-np.cos(_T), 0.5 * math.pi * _W * np.sin(_T), np.cumsum([0, *_ORDERS]).astype(np.int64))


@njit(**BARE_CHUNK)
def pair_directions(c, toward):
    """Compute distance, unit vector and angle from i to j, seen along z: toward (n, n, 4).

    The distance of a point to itself is set to infinity, so that it is not its own neighbour.
    """
    for i in range(c.shape[0]):
        for j in range(c.shape[0]):
            dx, dy = c[j, 0] - c[i, 0], c[j, 1] - c[i, 1]
            d = math.sqrt(dx * dx + dy * dy)
            toward[i, j, 0], toward[i, j, 1], toward[i, j, 2] = d, dx / d, dy / d
            toward[i, j, 3] = math.atan2(dy, dx)
        toward[i, i, 0] = math.inf


@njit(**BARE)
def covered_arcs(i, rho, toward, cuts, order):
    """Return the number of arcs of circle i that other discs cover, -1 if they hide all of it.

    Fills cuts (n, 4) by disc: start in [0, 2 pi), end, cosine and sine of half the arc; and order (n,) by ascending start.
    """
    m = 0
    for j in range(rho.size):
        d, more = toward[i, j, 0], rho[i] - rho[j]
        if d >= rho[i] + rho[j]:
            continue
        if d <= -more:
            # Of two equal concentric discs the first represents both.
            if more < 0.0 or j < i or d > 0.0:
                return -1
            continue
        if d <= more:
            continue
        cosine = min(1.0, max(-1.0, (d * d + more * (rho[i] + rho[j])) / (2.0 * d * rho[i])))
        half = math.acos(cosine)
        start = toward[i, j, 3] - half
        if start < 0.0:
            start += TWO_PI
        cuts[j, 0], cuts[j, 1], cuts[j, 2] = start, start + 2.0 * half, cosine
        cuts[j, 3] = math.sqrt((1.0 - cosine) * (1.0 + cosine))
        k = m
        while k > 0 and cuts[order[k - 1], 0] > start:
            order[k] = order[k - 1]
            k -= 1
        order[k] = j
        m += 1
    return m


@njit(**BARE)
def arc_sums(m, toward, cuts, order):
    """Return integrals of cos^m sin^n over the free arcs of a circle, mn = 10, 20, 30, 40, 11, 21, 12, 22, 31."""
    last = order[0]
    for k in range(1, m):
        if cuts[order[k], 1] > cuts[last, 1]:
            last = order[k]
    at, th = cuts[last, 1] - TWO_PI, 0.0
    j10, sc, s3, j40, j11, j21, j22, j31 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(m):
        j = order[k]
        if cuts[j, 0] > at:
            th += cuts[j, 0] - at
            # The ends of a cut follow from its cosine: no sine or cosine of an angle is needed.
            u_x, u_y, c_h, s_h = toward[last, 1], toward[last, 2], cuts[last, 2], cuts[last, 3]
            c0, s0 = u_x * c_h - u_y * s_h, u_y * c_h + u_x * s_h
            u_x, u_y, c_h, s_h = toward[j, 1], toward[j, 2], cuts[j, 2], cuts[j, 3]
            c1, s1 = u_x * c_h + u_y * s_h, u_y * c_h - u_x * s_h
            cc0, cc1, ss0, ss1, sc0, sc1 = c0 * c0, c1 * c1, s0 * s0, s1 * s1, s0 * c0, s1 * c1
            j10 += s1 - s0
            sc += sc1 - sc0
            s3 += s1 * ss1 - s0 * ss0
            j40 += sc1 * (0.25 * cc1 + 0.375) - sc0 * (0.25 * cc0 + 0.375)
            j11 += ss1 - ss0
            j21 += c0 * cc0 - c1 * cc1
            j22 += sc0 * (1.0 - 2.0 * ss0) - sc1 * (1.0 - 2.0 * ss1)
            j31 += cc0 * cc0 - cc1 * cc1
        if cuts[j, 1] > at:
            at, last = cuts[j, 1], j
    j12 = s3 / 3.0
    j20, j40, j22 = 0.5 * (th + sc), 0.375 * th + j40, 0.125 * (th + j22)
    return j10, j20, j10 - j12, j40, 0.5 * j11, j21 / 3.0, j12, j22, 0.25 * j31


@njit(**BARE_CHUNK)
def disc_moments(c, rho, toward, cuts, order, out):
    """Compute area, x, y, xx, yy, xy moments of the union of discs at c (n, 3 or 2: x, y) into out (6,).

    rho (n,): radii, 0 for absent discs; toward: see `pair_directions`, the same for all slices of a body; cuts (n, 4), order
    (n,): workspace. Green's theorem: oint x dy and related integrals over the free arcs.
    """
    o0, o1, o2, o3, o4, o5 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(rho.size):
        x, y, r = c[i, 0], c[i, 1], rho[i]
        m = -1 if r <= 0.0 else covered_arcs(i, rho, toward, cuts, order)
        if m < 0:
            continue
        if m > 0:
            j10, j20, j30, j40, j11, j21, j12, j22, j31 = arc_sums(m, toward[i], cuts, order)
        else:
            j10, j30, j11, j21, j12, j31 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
            j20, j40, j22 = 0.5 * TWO_PI, 0.375 * TWO_PI, 0.125 * TWO_PI
        xx_c = x * x * j10 + 2.0 * x * r * j20 + r * r * j30
        xx_cs = x * x * j11 + 2.0 * x * r * j21 + r * r * j31
        o0 += r * (x * j10 + r * j20)
        o1 += 0.5 * r * xx_c
        o2 += r * (x * y * j10 + x * r * j11 + y * r * j20 + r * r * j21)
        o3 += r * (x * x * (x * j10 + 3.0 * r * j20) + r * r * (3.0 * x * j30 + r * j40)) / 3.0
        o4 += r * (x * (y * y * j10 + 2.0 * y * r * j11 + r * r * j12))
        o4 += r * r * (y * y * j20 + 2.0 * y * r * j21 + r * r * j22)
        o5 += 0.5 * r * (y * xx_c + r * xx_cs)
    out[0], out[1], out[2], out[3], out[4], out[5] = o0, o1, o2, o3, o4, o5


@njit(**DIRECT)
def union_of_discs(c, rho, out):
    """`disc_moments` for one set of discs, c (n, 2 or 3) and rho (n,); compiled only if needed."""
    n = rho.size
    toward = np.empty((n, n, 4))
    pair_directions(c, toward)
    disc_moments(c, rho, toward, np.empty((n, 4)), np.empty(n, np.int64), out)


@cache
def triples(n: int) -> tuple[np.ndarray, np.ndarray]:
    """Return triples i < j < k out of n, (3, m), and for each the index (m,) of (i, j) among the pairs."""
    rows = np.array(list(combinations(range(n), 3)), dtype=np.int64).reshape(-1, 3).T
    i, j, _ = rows
    return rows, i * n - i * (i + 1) // 2 + j - i - 1


def break_heights(c: np.ndarray, r: np.ndarray) -> np.ndarray:
    """Return ascending heights (b, m), then NaN, at which slices change: poles, ends of circles, triple points.

    c (b, n, 3), r (b, n): a stack of bodies. Points covered by another sphere are left out: no slice sees them. Plain numpy: for
    a stack it is as fast as a kernel, which every cold start would compile for 0.6 s.
    """
    n = r.shape[1]
    pole = r[:, :, None] * (0.0, 0.0, 1.0)
    i, j = np.triu_indices(n, 1)
    arm, r_i, r_j = c[:, j] - c[:, i], r[:, i], r[:, j]
    d = np.sqrt(dot(arm, arm))
    # Pairs that do not intersect get a ring of NaN, which every later comparison drops.
    with np.errstate(invalid="ignore", divide="ignore"):
        axis = arm / d[:, :, None]
        along = (d * d + (r_i - r_j) * (r_i + r_j)) / (2.0 * d)
        ring2 = np.where((d < r_i + r_j) & (d > np.abs(r_i - r_j)), r_i**2 - along**2, np.nan)
        center = c[:, i] + along[:, :, None] * axis
        steep = -axis[:, :, 2:] * axis + (0.0, 0.0, 1.0)
        flat = np.hypot(axis[:, :, 0], axis[:, :, 1])
        out = (np.sqrt(ring2) / flat)[:, :, None] * steep
        # A horizontal circle lies at one height as a whole, and no single point of it shows whether it is covered.
        level = np.where(flat < 1e-6, center[:, :, 2], np.nan)
        # midpoints and half differences of the points where three spheres meet
        (i, _, k), pair = triples(n)
        arm, one, toward = c[:, k] - c[:, i], axis[:, pair], along[:, pair]
        v = dot(arm, one)
        across = arm - v[:, :, None] * one
        w2 = dot(across, across)
        t = (r[:, i] ** 2 - r[:, k] ** 2 + v * v + w2 - 2.0 * toward * v) / (2.0 * w2)
        foot = center[:, pair] + t[:, :, None] * across
        side = cross(one, across) * np.sqrt(ring2[:, pair] / w2 - t * t)[:, :, None]
        marks = np.concatenate([c - pole, c + pole, center - out, center + out, foot - side, foot + side], axis=1)
        hidden, size = np.empty(marks.shape[:2], np.bool_), max(1, _MEASURED // r.size)
        for first in range(0, marks.shape[1], size):
            block, away = slice(first, first + size), 0.0
            for k in range(3):
                apart = marks[:, block, None, k] - c[:, None, :, k]
                away = away + apart * apart
            hidden[:, block] = (away < (r * r * (1.0 - 1e-9))[:, None]).any(axis=2)
    shown = np.where(np.isfinite(marks).all(axis=2) & ~hidden, marks[:, :, 2], np.nan)
    heights = np.sort(np.concatenate([shown, np.where(np.isfinite(level), level, np.nan)], axis=1), axis=1)
    # One memory layout for the kernel; else numba would compile it a second time.
    return np.ascontiguousarray(heights[:, : int(np.isfinite(heights).sum(axis=1).max())])


@njit(**BARE_CHUNK)
def add_slices(c, r, layer, rule, level, scratch, out):
    (mid, half), rho, plane, n = layer, scratch.rho, scratch.plane, r.size
    for p in range(rule.offsets[level], rule.offsets[level + 1]):
        height, weight = mid + half * rule.nodes[p], half * rule.weights[p]
        for i in range(n):
            dz = height - c[i, 2]
            rho[i] = math.sqrt(max(0.0, r[i] * r[i] - dz * dz))
        disc_moments(c, rho, scratch.toward, scratch.cuts, scratch.order, plane)
        out[0] += weight * plane[0]
        out[1] += weight * plane[1]
        out[2] += weight * plane[2]
        out[3] += weight * height * plane[0]
        out[4] += weight * plane[3]
        out[5] += weight * plane[4]
        out[6] += weight * height * height * plane[0]
        out[7] += weight * plane[5]
        out[8] += weight * height * plane[1]
        out[9] += weight * height * plane[2]


def union_moments(c: np.ndarray, r: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return ten moments (b, 10; see MOMENTS) of unions of spheres, and their errors (b, 10).

    c (b, n, 3), r (b, n): a stack of bodies, no sphere inside another, lengths in units of the largest radius. The order of a
    layer is raised until the moments of two orders differ by less than the tolerance; that difference, the error of the lower
    order, is the stated error.
    """
    n, heights, total = r.shape[1], break_heights(c, r), np.zeros((len(r), 2, MOMENTS))
    # in a kernel each of these calls would be compiled again
    scratch = Scratch(
        np.empty((n, n, 4)), np.empty((n, 4)), np.empty(n, np.int64), np.empty(n), np.empty(6), np.zeros(MOMENTS),
        np.zeros(MOMENTS),
    )  # fmt: skip
    stack_moments(c, r, heights, _RULE, _TOLERANCE, total, scratch)
    return total[:, 0], total[:, 1]


@njit(nogil=True, **DIRECT, **NO_COUNTS)
def stack_moments(C, R, Z, rule, tolerance, total, scratch):
    """Add moments and errors of unions to total (b, 2, 10); Z (b, m): the break heights, ascending, then NaN."""
    old, new = scratch.old, scratch.new
    for body in range(R.shape[0]):
        c, r, z = C[body], R[body], Z[body]
        pair_directions(c, scratch.toward)
        for b in range(z.size - 1):
            mid, half = 0.5 * (z[b] + z[b + 1]), 0.5 * (z[b + 1] - z[b])
            # Not "half < 1e-14": that is false for the NaN after the last height.
            if not half >= 1e-14:
                continue
            worst = np.inf
            for level in range(rule.offsets.size - 1):
                if worst < tolerance:
                    break
                for q in range(MOMENTS):
                    old[q] = new[q]
                    new[q] = 0.0
                add_slices(c, r, (mid, half), rule, level, scratch, new)
                if level > 0:
                    worst = 0.0
                    for q in range(MOMENTS):
                        worst = max(worst, abs(new[q] - old[q]))
            for q in range(MOMENTS):
                total[body, 0, q] += new[q]
                total[body, 1, q] += abs(new[q] - old[q])


def longest_links(c: np.ndarray, r: np.ndarray) -> np.ndarray:
    """Return the largest link (b,) of each of a stack of bodies (b, n, 3), (b, n).

    Grows a tree from sphere 0, nearest first, by the distance over the sum of radii. The longest link is the smallest factor on
    all radii that connects the body (Prim's algorithm); 1 or less: the spheres are connected. Plain numpy, as above.
    """
    bodies = np.arange(r.shape[0])
    reach, joined = np.full(r.shape, np.inf), np.zeros(r.shape, np.bool_)
    reach[:, 0] = 0.0
    for _ in range(r.shape[1]):
        best = np.where(joined, np.inf, reach).argmin(axis=1)
        joined[bodies, best] = True
        arm = c - c[bodies, best][:, None]
        near = np.sqrt(dot(arm, arm)) / (r + r[bodies, best][:, None])
        reach = np.where(joined, reach, np.minimum(reach, near))
    return reach.max(axis=1)
