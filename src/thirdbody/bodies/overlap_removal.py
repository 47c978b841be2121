"""Removal of the overlaps of rigid bodies between walls, with the search of their neighbours."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from thirdbody.bodies import bed_relaxation as kernels
from thirdbody.bodies.bed_relaxation import Outcome, Walls
from thirdbody.bodies.clump import Clump
from thirdbody.kernels.neighbour_search import Grid, Spheres, pair_candidates
from thirdbody.kernels.tables import EVERYTHING, sphere

_SKIN = 0.25  # of the typical radius: a search costs as much as some ten steps

_ROUNDING = 1e-9
"""Overlap over the radius that is no overlap: positions are rounded."""

FLOOR, CEILING = -1, -2
"""Numbers of the walls above and below where a body overlaps one (`Overlaps.second`)."""


class Overlaps(NamedTuple):
    """Overlapping pairs of bodies, and of a body and floor or ceiling, the deepest first, (n,).

    Attributes
    ----------
    first : ndarray
        Body.
    second : ndarray
        Body with a larger number, or a wall.
    depth : ndarray
        Overlap of their deepest spheres over the smaller of the two radii.
    """

    first: np.ndarray
    second: np.ndarray
    depth: np.ndarray

    @property
    def largest(self) -> float:
        """The deepest of all; 0 without any."""
        return float(self.depth[0]) if len(self.depth) else 0.0


class OverlapRemoval:
    """Poses X (n, 3), Q (n, 4) of rigid bodies between walls; all lengths are in units of a typical radius.

    `meet`: whether bodies see each other; else they see the walls only.
    """

    def __init__(self, clumps: Sequence[Clump], walls: Walls, meet: bool = True) -> None:
        self.walls, self.meet = walls, meet
        counts = [len(body.radii) for body in clumps]
        starts = np.cumsum([0, *counts])
        self.body = np.repeat(np.arange(len(clumps)), counts)
        rel = np.concatenate([body.centers for body in clumps])
        self.radii = np.concatenate([body.radii for body in clumps])
        # lever of the torques: distance of the outermost centre, so that no rotation is stiffer than a displacement
        arms = np.maximum.reduceat(np.linalg.norm(rel, axis=1), starts[:-1])
        lever = np.where(arms > 0.0, arms, 1.0)
        self.shapes = kernels.RigidBodies(rel, self.radii, self.body, starts, lever)
        self.X, self.Q = np.empty((len(clumps), 3)), np.empty((len(clumps), 4))
        self.S = np.empty((len(self.radii), 4))
        self.spheres = kernels.Spheres(np.empty((len(self.radii), 3)), self.S)
        # the search reads the engine's wide table, the relaxation a narrow one that stays in the cache
        self.wide = np.zeros((len(self.radii), sphere.WIDTH))
        self.sphere_data = Spheres(self.body, np.full(len(self.radii), EVERYTHING, np.int8))

    def relax(self, size: float, limit: int) -> tuple[Outcome, int]:
        """Remove the overlaps of bodies scaled by `size` in at most `limit` steps; return how it ended, and the steps."""
        motion = kernels.Motion(self.X, self.Q, np.zeros((len(self.X), 6)), np.array([0.1, 0.25, 0.0]))
        left = limit
        while left > 0:
            own, partner = self._search(size)
            pairs = kernels.Pairs(own, partner, _SKIN)
            code, done = kernels.relax(self.shapes, motion, size, pairs, self.walls, self.spheres, left)
            left -= done
            if code != Outcome.MOVED:
                return Outcome(code), limit - left
        return Outcome.SPENT, limit

    def overlaps(self) -> Overlaps:
        """Return the overlaps of the bodies at their true size."""
        own, partner = self._search(1.0)
        S, r, low, high = self.S, self.radii, self.walls.low, self.walls.high
        between = S[own, :3] - S[partner, :3]
        if self.walls.periodic:
            period = (high - low)[:2]
            between[:, :2] -= period * np.round(between[:, :2] / period)
        depth = (r[own] + r[partner] - np.linalg.norm(between, axis=1)) / np.minimum(r[own], r[partner])
        rows = [(self.body[own], self.body[partner], depth)]
        for inside, wall in ((S[:, 2] - low[2], FLOOR), (high[2] - S[:, 2], CEILING)):
            rows.append((self.body, np.full(len(r), wall), (r - inside) / r))
        return _deepest(*(np.concatenate(column) for column in zip(*rows, strict=True)))

    def _search(self, size: float) -> tuple[np.ndarray, np.ndarray]:
        """Return the pairs of spheres that come within the skin of each other."""
        kernels.pose(self.X, self.Q, self.shapes, size, self.spheres)
        if not self.meet:
            return np.empty(0, np.int32), np.empty(0, np.int32)
        self.wide[:, :4] = self.S
        low, high, periodic, clearance = self.walls
        skin = _SKIN + 2.0 * clearance * float(self.S[:, 3].max())
        reach = 2.0 * float(self.S[:, 3].max()) + skin
        low = np.where(np.isfinite(low), low, self.S[:, :3].min(axis=0))
        length = np.where(np.isfinite(high), high, self.S[:, :3].max(axis=0)) - low
        # at most twice the square root of the spheres as cells per axis: bounds the grid of a low bed of small bodies
        maximum = 2 * math.ceil(math.sqrt(len(self.S)))
        count = np.clip((length / reach).astype(np.int64), 1, maximum)
        wraps = np.array([periodic, periodic])
        grid = Grid(low, np.maximum(length, reach) / count, count, wraps, *(length[:2].tolist() if periodic else (0.0, 0.0)))
        capacity = 16 * len(self.S)
        while True:
            own, partner = np.empty(capacity, np.int32), np.empty(capacity, np.int32)
            n = pair_candidates(self.wide, self.sphere_data, skin, grid, 0, own, partner)
            if n <= capacity:
                return own[:n].copy(), partner[:n].copy()
            capacity = int(1.2 * n)


def _deepest(first: np.ndarray, second: np.ndarray, depth: np.ndarray) -> Overlaps:
    """Return the deepest overlap of every pair."""
    overlapping = depth > _ROUNDING
    first, second, depth = first[overlapping], second[overlapping], depth[overlapping]
    wall = second < 0
    a, b = np.where(wall, first, np.minimum(first, second)), np.where(wall, second, np.maximum(first, second))
    order = np.lexsort((b, a, -depth))
    pairs = np.column_stack((a, b))[order]
    _, rows = np.unique(pairs, axis=0, return_index=True)
    rows.sort()
    return Overlaps(pairs[rows, 0], pairs[rows, 1], depth[order][rows])
