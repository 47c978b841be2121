"""Kernels of random placement and of overlaps of spheres, on a grid of columns over the x-y plane."""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from thirdbody.jit.options import BARE, BARE_CHUNK, DIRECT, NO_COUNTS

Array = np.ndarray


class OverlapGrid(NamedTuple):
    """Spheres in columns, each at least one largest diameter wide."""

    placed: Array
    """Spheres (n, 4): x, y, z, radius."""
    heads: Array
    """Last sphere entered into each column (nx, ny); -1: none."""
    following: Array
    """Sphere entered before each one into its column (n,)."""
    size: Array
    """Lengths of the domain [m]."""
    periodic: bool
    """Whether x and y are periodic."""


@njit(**BARE)
def column(at, size, cells):
    """Return the index along one axis of the grid column that contains the coordinate."""
    return min(cells - 1, max(0, np.int64(at / size * cells)))


@njit(**BARE)
def apart(d, size, periodic):
    """Return the difference of two coordinates, to the nearest image if periodic."""
    return d - size * math.floor(d / size + 0.5) if periodic else d


@njit(**BARE_CHUNK)
def free(px, py, spheres, grid, clearance):
    """Return whether the spheres, moved by (px, py), clear all spheres in the grid."""
    placed, heads, following, size, periodic = grid
    nx, ny = heads.shape
    for s in range(spheres.shape[0]):
        x, y, z, r = spheres[s, 0] + px, spheres[s, 1] + py, spheres[s, 2], spheres[s, 3]
        if periodic:
            x -= size[0] * math.floor(x / size[0])
            y -= size[1] * math.floor(y / size[1])
        cx, cy = column(x, size[0], nx), column(y, size[1], ny)
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


@njit(**BARE_CHUNK)
def enter(x, y, z, r, t, grid):
    """Enter sphere t into the grid."""
    placed, heads, following, size, periodic = grid
    if periodic:
        x -= size[0] * math.floor(x / size[0])
        y -= size[1] * math.floor(y / size[1])
    cx, cy = column(x, size[0], heads.shape[0]), column(y, size[1], heads.shape[1])
    placed[t, 0], placed[t, 1], placed[t, 2], placed[t, 3] = x, y, z, r
    following[t] = heads[cx, cy]
    heads[cx, cy] = t


@njit(**DIRECT, **NO_COUNTS)
def place_body(tries, spheres, count, grid, clearance):
    """Place a body at the first free try (x, y), and return its index; -1 if none is free.

    tries (t, 2) [m]; spheres (n, 4) of the body: x, y relative to it, z, radius; count: spheres in the grid. Spheres closer than
    (1 + clearance) times the sum of radii do not fit.
    """
    for k in range(tries.shape[0]):
        px, py = tries[k, 0], tries[k, 1]
        if free(px, py, spheres, grid, clearance):
            for s in range(spheres.shape[0]):
                enter(spheres[s, 0] + px, spheres[s, 1] + py, spheres[s, 2], spheres[s, 3], count + s, grid)
            return k
    return -1


@njit(**DIRECT, **NO_COUNTS)
def overlapping(spheres, body, grid, pairs, depth):
    """Count overlapping pairs of spheres of different bodies; store the first in pairs and depth.

    spheres (n, 4): x, y, z, radius; body (n,); the grid is empty at first. If the number exceeds the length of pairs (m, 2), call
    again with larger arrays. In a grid of fewer than three columns a pair may be listed twice.
    """
    placed, heads, following, size, periodic = grid
    nx, ny = heads.shape
    m = 0
    for s in range(spheres.shape[0]):
        x, y, z, r = spheres[s, 0], spheres[s, 1], spheres[s, 2], spheres[s, 3]
        enter(x, y, z, r, s, grid)
    for s in range(spheres.shape[0]):
        x, y, z, r = placed[s, 0], placed[s, 1], placed[s, 2], placed[s, 3]
        cx, cy = column(x, size[0], nx), column(y, size[1], ny)
        for gx in range(cx - 1, cx + 2):
            for gy in range(cy - 1, cy + 2):
                if not periodic and (gx < 0 or gy < 0 or gx >= nx or gy >= ny):
                    continue
                t = heads[gx % nx, gy % ny]
                while t >= 0:
                    if t < s and body[t] != body[s]:
                        dx = apart(placed[t, 0] - x, size[0], periodic)
                        dy = apart(placed[t, 1] - y, size[1], periodic)
                        dz = placed[t, 2] - z
                        overlap = r + placed[t, 3] - math.sqrt(dx * dx + dy * dy + dz * dz)
                        if overlap > 0.0:
                            if m < depth.size:
                                pairs[m, 0], pairs[m, 1], depth[m] = t, s, overlap
                            m += 1
                    t = following[t]
    return m
