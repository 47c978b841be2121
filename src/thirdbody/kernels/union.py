"""Moments of the union of spheres, by slices whose union of discs is integrated in closed form.

A slice z = const cuts the spheres in discs. The boundary of their union consists of exposed arcs, and
Green's theorem turns area and moments into integrals over these arcs, which have closed forms. Along z
the moments are smooth between break heights (poles, ends of the circles where two spheres meet, points
where three meet) apart from half-integer powers at the ends, which z = mid - half cos(t) removes:
Gauss-Legendre in t then converges geometrically. Lengths are in units of the largest radius.
"""

from __future__ import annotations

import math
from functools import cache
from itertools import combinations

import numpy as np
from numba import njit

from .options import CHUNK, OPTIONS

TWO_PI = 2.0 * math.pi
# Order of the ten moments: 1, x, y, z, xx, yy, zz, xy, xz, yz.
MOMENTS = 10


def quadrature(orders: tuple[int, ...] = (5, 10, 20, 40, 80)) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Nodes in (-1, 1), weights, and offsets (levels + 1,) of Gauss-Legendre in t, z = -cos(t), per order."""
    nodes, weights = [], []
    for order in orders:
        x, w = np.polynomial.legendre.leggauss(order)
        t = 0.5 * math.pi * (x + 1.0)
        nodes.append(-np.cos(t))
        weights.append(0.5 * math.pi * w * np.sin(t))
    offsets = np.cumsum([0, *orders]).astype(np.int64)
    return np.concatenate(nodes), np.concatenate(weights), offsets


@njit(**CHUNK)
def add_arc(x, y, radius, start, end, out):
    """Adds the arc's part of area, x, y, xx, yy, xy (oint x dy and its kin) of the enclosed region."""
    s0, c0, s1, c1 = math.sin(start), math.cos(start), math.sin(end), math.cos(end)
    th = end - start
    sc0, sc1 = s0 * c0, s1 * c1
    # j_mn = integral of cos^m sin^n over the arc.
    j10 = s1 - s0
    j20 = 0.5 * (th + sc1 - sc0)
    j30 = j10 - (s1 * s1 * s1 - s0 * s0 * s0) / 3.0
    j40 = 0.375 * th + sc1 * (0.25 * c1 * c1 + 0.375) - sc0 * (0.25 * c0 * c0 + 0.375)
    j11 = 0.5 * (s1 * s1 - s0 * s0)
    j21 = (c0 * c0 * c0 - c1 * c1 * c1) / 3.0
    j12 = (s1 * s1 * s1 - s0 * s0 * s0) / 3.0
    j22 = 0.125 * (th - sc1 * (1.0 - 2.0 * s1 * s1) + sc0 * (1.0 - 2.0 * s0 * s0))
    j31 = 0.25 * (c0 * c0 * c0 * c0 - c1 * c1 * c1 * c1)
    r = radius
    xx_c = x * x * j10 + 2.0 * x * r * j20 + r * r * j30
    xx_cs = x * x * j11 + 2.0 * x * r * j21 + r * r * j31
    out[0] += r * (x * j10 + r * j20)
    out[1] += 0.5 * r * xx_c
    out[2] += r * (x * y * j10 + x * r * j11 + y * r * j20 + r * r * j21)
    out[3] += r * (x * x * (x * j10 + 3.0 * r * j20) + r * r * (3.0 * x * j30 + r * j40)) / 3.0
    out[4] += r * (x * (y * y * j10 + 2.0 * y * r * j11 + r * r * j12))
    out[4] += r * r * (y * y * j20 + 2.0 * y * r * j21 + r * r * j22)
    out[5] += 0.5 * r * (y * xx_c + r * xx_cs)


@njit(**CHUNK)
def cover(starts, ends, m, start, end):
    """Inserts the covered interval into the list sorted by start; gives the new length."""
    k = m
    while k > 0 and starts[k - 1] > start:
        starts[k] = starts[k - 1]
        ends[k] = ends[k - 1]
        k -= 1
    starts[k] = start
    ends[k] = end
    return m + 1


@njit(**OPTIONS)
def disc_moments(x, y, rho, n, starts, ends, out):
    """Area, x, y, xx, yy, xy moments of the union of the first n discs into out (6,).

    starts, ends: scratch of at least 2 n + 1.
    """
    for k in range(6):
        out[k] = 0.0
    for i in range(n):
        # Typed: numba compiles what a literal 0 is handed to twice, once for the literal.
        m = np.int64(0)
        hidden = False
        for j in range(n):
            if j == i:
                continue
            dx, dy = x[j] - x[i], y[j] - y[i]
            d = math.sqrt(dx * dx + dy * dy)
            if d >= rho[i] + rho[j]:
                continue
            if d <= rho[j] - rho[i]:
                # Of two equal discs in one place the first stands for both.
                if rho[j] > rho[i] or j < i or d > 0.0:
                    hidden = True
                    break
                continue
            if d <= rho[i] - rho[j]:
                continue
            cosine = (d * d + (rho[i] - rho[j]) * (rho[i] + rho[j])) / (2.0 * d * rho[i])
            half = math.acos(min(1.0, max(-1.0, cosine)))
            start = math.atan2(dy, dx) - half
            if start < 0.0:
                start += TWO_PI
            end = start + 2.0 * half
            if end > TWO_PI:
                m = cover(starts, ends, m, start, TWO_PI)
                m = cover(starts, ends, m, 0.0, end - TWO_PI)
            else:
                m = cover(starts, ends, m, start, end)
        if hidden:
            continue
        # A last interval closes the circle: one call of add_arc compiles faster than two.
        m = cover(starts, ends, m, TWO_PI, TWO_PI)
        at = 0.0
        for k in range(m):
            if starts[k] > at:
                add_arc(x[i], y[i], rho[i], at, starts[k], out)
            at = max(at, ends[k])


@cache
def triples(n: int) -> tuple[np.ndarray, np.ndarray]:
    """Triples i < j < k out of n, (3, m), and for each the place (m,) of (i, j) among the pairs."""
    rows = np.array(list(combinations(range(n), 3)), dtype=np.int64).reshape(-1, 3).T
    i, j, _ = rows
    return rows, i * n - i * (i + 1) // 2 + j - i - 1


def break_heights(c: np.ndarray, r: np.ndarray) -> np.ndarray:
    """Heights (m,), rising, where slices of the union change: poles, ends of circles, triple points.

    What another sphere covers is left out: no slice sees it. Plain numpy: as a kernel it took 0.1 ms less per
    clump and 0.6 s more at every cold start.
    """
    points = [c - r[:, None] * (0.0, 0.0, 1.0), c + r[:, None] * (0.0, 0.0, 1.0)]
    i, j = np.triu_indices(r.size, 1)
    arm = c[j] - c[i]
    d = np.sqrt((arm * arm).sum(axis=1))
    # Pairs that do not cut get a ring of NaN, which every later comparison drops.
    with np.errstate(invalid="ignore", divide="ignore"):
        axis = arm / d[:, None]
        along = (d * d + (r[i] - r[j]) * (r[i] + r[j])) / (2.0 * d)
        ring2 = np.where((d < r[i] + r[j]) & (d > np.abs(r[i] - r[j])), r[i] ** 2 - along**2, np.nan)
        center = c[i] + along[:, None] * axis
        steep = -axis[:, 2:] * axis + (0.0, 0.0, 1.0)
        flat = np.hypot(axis[:, 0], axis[:, 1])
        out = (np.sqrt(ring2) / flat)[:, None] * steep
        # A level circle lies wholly at one height, and no single point of it tells whether it is covered.
        level = center[flat < 1e-6, 2]
        points += [center - out, center + out]
        rows, pair = triples(r.size)
        meeting = np.isfinite(ring2[pair])
        (i, _, k), pair = rows[:, meeting], pair[meeting]
        arm = c[k] - c[i]
        v = (arm * axis[pair]).sum(axis=1)
        across = arm - v[:, None] * axis[pair]
        w2 = (across * across).sum(axis=1)
        t = (r[i] ** 2 - r[k] ** 2 + v * v + w2 - 2.0 * along[pair] * v) / (2.0 * w2)
        foot = center[pair] + t[:, None] * across
        out = np.cross(axis[pair], across) * np.sqrt(ring2[pair] / w2 - t * t)[:, None]
    marks = np.concatenate([*points, foot - out, foot + out])
    marks = marks[np.isfinite(marks).all(axis=1)]
    away = ((marks[:, None] - c) ** 2).sum(axis=2)
    shown = ~(away < r * r * (1.0 - 1e-9)).any(axis=1)
    return np.sort(np.concatenate([marks[shown, 2], level[np.isfinite(level)]]))


@njit(**CHUNK)
def add_slices(c, r, mid, half, nodes, weights, first, last, scratch, out):
    """Adds the ten moments of the layer mid +- half by the nodes first..last; scratch: (6, 2 n + 1)."""
    n = r.size
    x, y, rho = scratch[0], scratch[1], scratch[2]
    plane = scratch[5]
    for p in range(first, last):
        height, weight = mid + half * nodes[p], half * weights[p]
        m = np.int64(0)
        for i in range(n):
            dz = height - c[i, 2]
            square = r[i] * r[i] - dz * dz
            if square > 0.0:
                x[m], y[m], rho[m] = c[i, 0], c[i, 1], math.sqrt(square)
                m += 1
        disc_moments(x, y, rho, m, scratch[3], scratch[4], plane)
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


@njit(**OPTIONS)
def union_moments(c, r, z, nodes, weights, offsets, tolerance, scratch, total, old, new):
    """Ten moments (see MOMENTS) of the union and the sum of their errors over the layers, into total (2, 10).

    c: (n, 3), r: (n,), no sphere swallowed by another; z: the break heights, rising; scratch: (6, 2 n + 7);
    old, new: scratch (10,). A layer's order is raised until the moments of two orders differ by less than
    tolerance; that difference, the error of the lower order, is kept.
    """
    for b in range(z.size - 1):
        mid, half = 0.5 * (z[b] + z[b + 1]), 0.5 * (z[b + 1] - z[b])
        if half < 1e-14:
            continue
        worst = np.inf
        for level in range(offsets.size - 1):
            if worst < tolerance:
                break
            for q in range(MOMENTS):
                old[q] = new[q]
                new[q] = 0.0
            add_slices(c, r, mid, half, nodes, weights, offsets[level], offsets[level + 1], scratch, new)
            if level > 0:
                worst = 0.0
                for q in range(MOMENTS):
                    worst = max(worst, abs(new[q] - old[q]))
        for q in range(MOMENTS):
            total[0, q] += new[q]
            total[1, q] += abs(new[q] - old[q])


@njit(**OPTIONS)
def links(c, r, reach, joined):
    """Grows a tree from sphere 0, nearest first: reach[i] = distance over sum of radii at which i joined.

    The largest reach is the least factor on all radii that makes one body (Prim's algorithm); 1 or less:
    the spheres are connected. joined: scratch (n,) bool.
    """
    n = r.size
    for i in range(n):
        joined[i] = False
        reach[i] = math.inf
    reach[0] = 0.0
    for _ in range(n):
        best = -1
        for i in range(n):
            if not joined[i] and (best < 0 or reach[i] < reach[best]):
                best = i
        joined[best] = True
        for i in range(n):
            if not joined[i]:
                dx, dy, dz = c[i, 0] - c[best, 0], c[i, 1] - c[best, 1], c[i, 2] - c[best, 2]
                reach[i] = min(reach[i], math.sqrt(dx * dx + dy * dy + dz * dz) / (r[i] + r[best]))
