"""Removal of the overlaps of rigid bodies between walls, and dense beds: bodies that grow while overlaps are removed.

Poses X (n, 3) are centroids, Q (n, 4) quaternions (w, x, y, z; body to world); the spheres of body b are the rows
starts[b]..starts[b + 1] of `rel` (n, 3: centres in the body's frame) and `radii`. The box has walls, or is periodic in x and y.
Everything is serial, so the bits do not depend on threads.
"""

import math
from collections.abc import Sequence
from enum import IntEnum
from typing import NamedTuple

import numpy as np
from numba import njit

from thirdbody.bodies.clump import Clump
from thirdbody.bodies.packing import deepest, near_pairs, refuse_long, scatter
from thirdbody.errors import Fault, InputError
from thirdbody.jit.options import CHUNK, OPTIONS
from thirdbody.jit.simd import load, set4, store
from thirdbody.kernels.tables import sphere
from thirdbody.kernels.vectors import matrix, nearest_image, rotate_small

DT, ALPHA, DOWNHILL = 0, 1, 2  # indices into the memory of the relaxation
FLOOR, CEILING = -1, -2
"""Numbers of the walls above and below where a body overlaps one (`Overlaps.second`)."""
# Of the typical radius: a search costs as much as some ten steps.
_SKIN = 0.25
# Overlap over the radius that is none: positions are rounded.
_ROUNDING = 1e-9
# Guenole et al. 2020, table 1, except for the steps: a body of mass 1 with some 20 contacts of stiffness 1 oscillates at
# sqrt(20), and explicit steps are unstable from 2/sqrt(20) = 0.45 on.
_DT_MAX, _DT_MIN, _GROW, _SHRINK, _DELAY, _ALPHA, _CALM = 0.3, 0.003, 1.1, 0.5, 20, 0.25, 0.99
# A minimum with overlaps: the force on every body is below this fraction of the deepest overlap.
_BALANCED = 1e-3
# Of a dense bed, the gap over the sum of radii; at half of it nothing overlaps: convergence to exactly 0 would take forever.
_CLEARANCE = 1e-3
# Solid fraction at its start, by random addition: so dilute that even long bodies are placed at once.
_START = 0.08
# Steps of ln(size): the first, and the one at which growth stops (0.3 % of the solid fraction).
_STEP, _MIN_STEP = 0.08, 1e-3
# Relaxation steps per growth step: states free of overlap mostly take some hundred, nearly jammed ones some thousand.
_LIMIT = 4000

Array = np.ndarray


class RemovalOutcome(IntEnum):
    """How a call of `relax` ended."""

    RELAXED = 0  # no overlap of the spheres, enlarged by the clearance, exceeds half of it, so nothing touches
    MOVED = 1  # the candidates are out of date
    JAMMED = 2  # a minimum with overlaps
    SPENT = 3  # all steps were made


class RigidBodies(NamedTuple):
    """Shapes of the bodies at full size, and their spheres in the present poses: arms (n, 3) and S (n, 4: centre, radius).

    body of each sphere; lever: by which torques of a body are divided.
    """

    rel: Array
    radii: Array
    body: Array
    starts: Array
    lever: Array
    arms: Array
    S: Array


class Motion(NamedTuple):
    """What the relaxation changes, carried over from call to call: poses, velocities V (n, 6); memory, first (0.1, 0.25, 0)."""

    X: Array
    Q: Array
    V: Array
    memory: Array


class Walls(NamedTuple):
    """Corners of the box (3,), infinite where open; whether x and y are periodic; gap to keep over the sum of radii."""

    low: Array
    high: Array
    periodic: bool
    clearance: float


@njit(**OPTIONS)
def pose(X, Q, bodies, scale):
    rel, starts, arms, S = bodies.rel, bodies.starts, bodies.arms, bodies.S
    for b in range(X.shape[0]):
        a, e, i, d, f, j, g, h, k = matrix(Q[b, 0], Q[b, 1], Q[b, 2], Q[b, 3])
        for s in range(starts[b], starts[b + 1]):
            x, y, z = scale * rel[s, 0], scale * rel[s, 1], scale * rel[s, 2]
            arms[s, 0], arms[s, 1], arms[s, 2] = a * x + e * y + i * z, d * x + f * y + j * z, g * x + h * y + k * z
            S[s, sphere.X], S[s, sphere.Y], S[s, sphere.Z] = X[b, 0] + arms[s, 0], X[b, 1] + arms[s, 1], X[b, 2] + arms[s, 2]
            S[s, sphere.RADIUS] = scale * bodies.radii[s]


@njit(**CHUNK)
def _add_force(b, arm, s, f_x, f_y, f_z, lever, F):
    F[b, 0] += f_x
    F[b, 1] += f_y
    F[b, 2] += f_z
    F[b, 3] += (arm[s, 1] * f_z - arm[s, 2] * f_y) / lever[b]
    F[b, 4] += (arm[s, 2] * f_x - arm[s, 0] * f_z) / lever[b]
    F[b, 5] += (arm[s, 0] * f_y - arm[s, 1] * f_x) / lever[b]


@njit(**CHUNK)
def _repulsion(bodies, own, partner, walls, F):
    """Compute forces F (n, 6) of the energy sum(overlap^2)/2; return its largest overlap, absolute and over the radii."""
    S, arms, body, lever = bodies.S, bodies.arms, bodies.body, bodies.lever
    low, high, periodic, clearance = walls
    F[:] = 0.0
    max_overlap, worst = 0.0, 0.0
    l_x, l_y = (high[0] - low[0], high[1] - low[1]) if periodic else (0.0, 0.0)
    for k in range(own.shape[0]):
        i, j = own[k], partner[k]
        d_x = nearest_image(S[i, sphere.X] - S[j, sphere.X], l_x)
        d_y = nearest_image(S[i, sphere.Y] - S[j, sphere.Y], l_y)
        d_z = S[i, sphere.Z] - S[j, sphere.Z]
        sum_r = S[i, sphere.RADIUS] + S[j, sphere.RADIUS]
        reach = sum_r * (1.0 + clearance)
        square = d_x * d_x + d_y * d_y + d_z * d_z
        if square < reach * reach:
            distance = math.sqrt(square)
            overlap = reach - distance
            max_overlap, worst = max(max_overlap, overlap), max(worst, overlap / sum_r)
            w = overlap / max(distance, 1e-12)
            _add_force(body[i], arms, i, w * d_x, w * d_y, w * d_z, lever, F)
            _add_force(body[j], arms, j, -w * d_x, -w * d_y, -w * d_z, lever, F)
    for i in range(S.shape[0]):
        reach = S[i, sphere.RADIUS] * (1.0 + clearance)
        for axis in range(2 if periodic else 0, 3):
            inward = max(low[axis] + reach - S[i, axis], 0.0) - max(S[i, axis] + reach - high[axis], 0.0)
            if inward != 0.0:
                max_overlap, worst = max(max_overlap, abs(inward)), max(worst, abs(inward) / S[i, sphere.RADIUS])
                f_x, f_y = inward if axis == 0 else 0.0, inward if axis == 1 else 0.0
                _add_force(body[i], arms, i, f_x, f_y, inward if axis == 2 else 0.0, lever, F)
    return max_overlap, worst


@njit(**CHUNK)
def _advance(X, Q, V, step, lever, longest):
    for b in range(X.shape[0]):
        length = abs(step) * math.sqrt((V[b] * V[b]).sum())
        part = step * min(1.0, longest / length) if length > 0.0 else 0.0
        for axis in range(3):
            X[b, axis] += part * V[b, axis]
        rotation = part / lever[b]
        store(Q, b, 0, rotate_small(load(Q, b, 0), set4(rotation * V[b, 3], rotation * V[b, 4], rotation * V[b, 5], 0.0)))


@njit(**OPTIONS)
def relax(bodies, motion, scale, own, partner, walls, limit):
    """Remove overlaps of rigid bodies by FIRE (with both corrections of Guenole et al. 2020); return (`RemovalOutcome`, steps).

    own, partner: pairs of spheres that may overlap until one has moved by half the skin; limit: largest number of steps. Lengths
    are in units of a typical radius. Under an open top a body stops as soon as nothing pushes it: else the uppermost ones would
    fly off.
    """
    X, Q, V, memory = motion
    n, lever, is_open = X.shape[0], bodies.lever, math.isinf(walls.high[2])
    F = np.empty((n, 6))
    pose(X, Q, bodies, scale)
    S0 = bodies.S.copy()
    for step in range(limit):
        max_overlap, worst = _repulsion(bodies, own, partner, walls, F)
        if worst <= 0.5 * walls.clearance:
            return RemovalOutcome.RELAXED, step
        power, speed, force, max_force = 0.0, 0.0, 0.0, 0.0
        for b in range(n):
            here = 0.0
            for c in range(6):
                power += F[b, c] * V[b, c]
                speed += V[b, c] * V[b, c]
                here += F[b, c] * F[b, c]
            force += here
            max_force = max(max_force, here)
        if math.sqrt(max_force) < _BALANCED * max_overlap:
            return RemovalOutcome.JAMMED, step
        if power > 0.0:
            memory[DOWNHILL] += 1.0
            if memory[DOWNHILL] > _DELAY:
                memory[DT] = min(_DT_MAX, memory[DT] * _GROW)
                memory[ALPHA] *= _CALM
        else:
            if memory[DOWNHILL] > 0.0:
                memory[DT] = max(_DT_MIN, memory[DT] * _SHRINK)
            memory[DOWNHILL], memory[ALPHA] = 0.0, _ALPHA
            _advance(X, Q, V, -0.5 * memory[DT], lever, 0.1)
            V[:] = 0.0
            speed = 0.0
        mixed = memory[ALPHA] * math.sqrt(speed / force)
        for b in range(n):
            if is_open and not F[b].any():
                V[b] = 0.0
            for c in range(6):
                V[b, c] = (1.0 - memory[ALPHA]) * (V[b, c] + memory[DT] * F[b, c]) + mixed * F[b, c]
        _advance(X, Q, V, memory[DT], lever, 0.1)
        pose(X, Q, bodies, scale)
        for i in range(S0.shape[0]):
            d_x, d_y, d_z = bodies.S[i, 0] - S0[i, 0], bodies.S[i, 1] - S0[i, 1], bodies.S[i, 2] - S0[i, 2]
            if d_x * d_x + d_y * d_y + d_z * d_z > 0.25 * _SKIN * _SKIN:
                return RemovalOutcome.MOVED, step + 1
    return RemovalOutcome.SPENT, limit


class Overlaps(NamedTuple):
    """Overlapping pairs of bodies, and of a body (`first`) and floor or ceiling (`second`), the deepest first, (n,).

    depth: overlap of the deepest spheres over the smaller of the two radii.
    """

    first: np.ndarray
    second: np.ndarray
    depth: np.ndarray

    @property
    def largest(self) -> float:
        """The deepest of all; 0 without any."""
        return float(self.depth[0]) if len(self.depth) else 0.0


class OverlapRemoval:
    """Poses X, Q of rigid bodies between walls, in units of a typical radius; unless they `meet`, bodies see the walls only."""

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
        self.S = np.empty((len(self.radii), 4))
        self.shapes = RigidBodies(rel, self.radii, self.body, starts, lever, np.empty((len(self.radii), 3)), self.S)
        self.X, self.Q = np.empty((len(clumps), 3)), np.empty((len(clumps), 4))

    def relax(self, size: float, limit: int) -> tuple[RemovalOutcome, int]:
        """Remove the overlaps of bodies scaled by `size` in at most `limit` steps; return how it ended, and the steps."""
        motion = Motion(self.X, self.Q, np.zeros((len(self.X), 6)), np.array([0.1, 0.25, 0.0]))
        left = limit
        while left > 0:
            code, done = relax(self.shapes, motion, size, *self._search(size), self.walls, left)
            left -= done
            if code != RemovalOutcome.MOVED:
                return RemovalOutcome(code), limit - left
        return RemovalOutcome.SPENT, limit

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
        first, second, depth = (np.concatenate(column) for column in zip(*rows, strict=True))
        real = depth > _ROUNDING
        return Overlaps(*deepest(first[real], second[real], depth[real]))

    def _search(self, size: float) -> tuple[np.ndarray, np.ndarray]:
        pose(self.X, self.Q, self.shapes, size)
        if not self.meet:
            return (np.empty(0, np.int32),) * 2
        low, high, periodic, clearance = self.walls
        skin = _SKIN + 2.0 * clearance * float(self.S[:, 3].max())
        return near_pairs(self.S, self.body, (low, high), periodic, skin)


class Bed(NamedTuple):
    """Centroids (n, 3) [m], quaternions (n, 4), solid fraction and height [m] up to the highest point."""

    positions: Array
    quaternions: Array
    solid_fraction: float
    height: float


def pack(
    clumps: Sequence[Clump], fraction: float, domain_size: tuple[float, float], periodic: bool, rng: np.random.Generator
) -> Bed:
    """Return a bed of the bodies on z = 0 with this solid fraction, up to the highest point.

    The bodies, scaled down, are scattered in the final box and grow to their true size in steps; after each step FIRE removes the
    overlaps of the rigid bodies (soft repulsion, as O'Hern et al. 2003, who detect jamming this way). A step after which overlaps
    remain is undone and halved. No spheres of different bodies touch at the end: gaps are at least 5e-4 of the sum of radii. In a
    domain that is not periodic the box has walls. The bed ends slightly denser than requested, because of its gaps. InputError:
    the box is lower than the largest sphere, or the bodies jam before their true size; the message gives the fraction reached.
    """
    size = np.array(domain_size, dtype=np.float64)
    refuse_long(clumps, size, periodic)
    volume = sum(body.volume for body in clumps)
    height = volume / (fraction * float(size.prod()))
    largest = 2.0 * max(float(body.radii.max()) for body in clumps)
    if height < largest * (1.0 + 2.0 * _CLEARANCE):
        message = (
            f"the bed would be {height:.3g} m high, lower than its largest sphere, {largest:.3g} m: raise count or lower "
            'solid_fraction or domain.size, or lay the bodies with placement = "layer"'
        )
        raise InputError(Fault("solid_fraction", message))
    unit = float(np.mean([body.radii.mean() for body in clumps]))
    box = np.array([*size, height]) / unit
    walls = Walls(np.zeros(3), box, periodic, _CLEARANCE)
    grown, bed = _grown([body.scaled(1.0 / unit) for body in clumps], fraction, walls, rng)
    if grown < 1.0:
        reached = f"a solid fraction of about {fraction * grown**3:.3f} is reached, {fraction:.3f} wanted"
        raise InputError(Fault("solid_fraction", f"the bodies jam: {reached} (a bed {height:.3g} m high)"))
    x, q = bed.X * unit, bed.Q.copy()
    z, r = bed.S[:, 2] * unit, np.concatenate([body.radii for body in clumps])
    floor = float((z - r).min())
    x[:, 2] -= floor
    top = float((z + r).max()) - floor
    x[:, :2] -= np.floor(x[:, :2] / size) * size if periodic else 0.0
    return Bed(x, q, volume / (float(size.prod()) * top), top)


def _grown(clumps: Sequence[Clump], fraction: float, walls: Walls, rng: np.random.Generator) -> tuple[float, OverlapRemoval]:
    """Return the largest size without overlaps, over the true one and at most that, and the bodies of that size.

    Lengths in units of the mean radius. Raises InputError when the bodies cannot be scattered at any size.
    """
    bed = OverlapRemoval(clumps, walls)
    x, y, height = walls.high.tolist()
    size, step = min(1.0, (_START / fraction) ** (1.0 / 3.0)), _STEP
    while True:
        try:
            bed.X, bed.Q = scatter([body.scaled(size) for body in clumps], height, (x, y), walls.periodic, rng)
            break
        except InputError:
            if size < 0.1:
                raise
            size *= 0.7
    while True:
        before = bed.X.copy(), bed.Q.copy()
        trial = min(1.0, size * math.exp(step))
        if bed.relax(trial, _LIMIT)[0] is RemovalOutcome.RELAXED:
            if trial == 1.0:
                return 1.0, bed
            size, step = trial, min(1.5 * step, _STEP)
            continue
        (bed.X, bed.Q), step = before, 0.5 * step
        if step < _MIN_STEP:
            return size, bed
