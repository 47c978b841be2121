"""Spots on one plate, solved by the kernel of the engine (`kernels.close_spots`) as the tests give them."""

from collections import namedtuple

import numpy as np
from numba import njit
from thirdbody.kernels.close_spots import LANES, Spots, finish_lanes, lane, solve_side, spot, sweep

Loads = namedtuple("Loads", "relief force pull")  # of each spot: [m], [N], along the plate (n, 2) [N]


@njit
def _solve(n, c, W, G, swept, spots):
    if swept:
        sweep(0, n, c, W, G, spots)
    else:
        L = np.zeros(lane.WIDTH * LANES)
        finish_lanes(solve_side(0, 0, n, c, L, W, G, spots), L, W, G, spots)


@njit
def _work(path, speed, depth, c, W, G, spots, opened):
    n, work, energy = len(depth), 0.0, 0.0
    for t in range(len(path)):
        for p in range(n):
            a, d = p * spot.WIDTH, depth[p] + path[t, p, 2]
            W[a + spot.X], W[a + spot.Y] = path[t, p, 0], path[t, p, 1]
            W[a + spot.OVERLAP] = max(d, 1e-12 * depth[p])
        _solve(n, c, W, G, False, spots)
        stored = 0.0
        for p in range(n):
            d = W[p * spot.WIDTH + spot.OVERLAP]
            opened[p] += 1.0 if spots.force[p] < 1e-15 * c else 0.0
            work += spots.force[p] * speed[t, p, 2] - spots.pull_x[p] * speed[t, p, 0] - spots.pull_y[p] * speed[t, p, 1]
            stored += 0.4 * spots.force[p] * max(d - spots.relief[p], 0.0) + 0.5 * spots.force[p] * spots.relief[p]
        energy = max(energy, stored)
    return work / len(path), energy


def _rows(place, depth, radius, stiffness):
    W = np.zeros((len(depth), spot.WIDTH))
    W[:, spot.NUMBER], W[:, spot.X], W[:, spot.Y] = np.arange(len(depth)), place[:, 0], place[:, 1]
    W[:, spot.RADIUS], W[:, spot.SPHERE_RADIUS], W[:, spot.OVERLAP] = radius, radius, depth
    W[:, spot.FACTOR] = stiffness / radius
    return W.ravel()


def solved(place, depth, radius, stiffness, c, swept=False, scratch=1000) -> Loads:
    """Solve spots at `place` (n, 2) with overlaps `depth` (n,) and radii (n,) [m]; `stiffness`: 4/3 E* [Pa]; c [m2/N]. `swept`:
    by sweeps; `scratch`: numbers of it."""
    relief, force, x, y = np.full((4, len(depth)), np.nan)
    rows = _rows(place, depth, radius, stiffness)
    _solve(len(depth), c, rows, np.zeros(scratch), swept, Spots(relief, force, x, y, rows))
    return Loads(relief, force, np.stack([x, y], axis=1))


def closed_path(path, speed, depth, radius, stiffness, c):
    """Work along a closed path [J], by the trapezoid rule, the largest energy on it [J], and how often spots carry none. `path`
    (t, n, 3): places and what is added to the overlaps `depth` (n,), at equal intervals; `speed`: its rate, per round."""
    rows, none = _rows(path[0, :, :2], depth, radius, stiffness), np.zeros(len(depth))
    spots = Spots(*np.zeros((4, len(depth))), rows)
    return *_work(path, speed, depth, c, rows, np.zeros(1000), spots, none), int(none.sum())
