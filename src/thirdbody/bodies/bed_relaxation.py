"""Kernels of random placement in a volume and of the relaxation of overlapping rigid bodies.

Poses X (n, 3) are centroids, Q (n, 4) quaternions (w, x, y, z; body to world); the spheres of body b are the rows
starts[b]..starts[b + 1] of `rel` (n, 3: centres in the body's frame) and `radii`. The box has walls, or is periodic in x and y.
Everything is serial, so the bits do not depend on threads.
"""

import math
from enum import IntEnum
from typing import NamedTuple

import numpy as np
from numba import njit

from thirdbody.bodies.overlap_grid import enter, free
from thirdbody.jit.options import CHUNK, OPTIONS
from thirdbody.jit.simd import load, set4, store
from thirdbody.kernels.tables import sphere
from thirdbody.kernels.vectors import matrix, nearest_image, rotate_small

DT, ALPHA, DOWNHILL = 0, 1, 2  # indices into the memory of the relaxation


class Outcome(IntEnum):
    """How a call of `relax` ended."""

    RELAXED = 0
    """No overlap of the spheres, enlarged by the clearance, exceeds half of it, so nothing touches."""
    MOVED = 1
    """The candidates are out of date."""
    JAMMED = 2
    """A minimum with overlaps."""
    SPENT = 3
    """All steps were made."""


# Guenole et al. 2020, table 1, except for the steps: a body of mass 1 with some 20 contacts of stiffness 1 oscillates at
# sqrt(20), and explicit steps are unstable from 2/sqrt(20) = 0.45 on.
_DT_MAX, _DT_MIN, _GROW, _SHRINK, _DELAY, _ALPHA, _CALM = 0.3, 0.003, 1.1, 0.5, 20, 0.25, 0.99
# A minimum with overlaps: the force on every body is below this fraction of the deepest overlap.
_BALANCED = 1e-3


Array = np.ndarray


class RigidBodies(NamedTuple):
    """Shapes of the bodies at full size."""

    rel: Array
    radii: Array
    body: Array
    """Body of each sphere."""
    starts: Array
    lever: Array
    """By which torques of a body are divided."""


class Motion(NamedTuple):
    """What the relaxation changes; carried over from call to call."""

    X: Array
    Q: Array
    V: Array
    """Velocities (n, 6)."""
    memory: Array
    """Starts as (0.1, 0.25, 0)."""


class Walls(NamedTuple):
    """Corners of the box (3,), infinite where open; whether x and y are periodic; gap to keep over the sum of radii."""

    low: Array
    high: Array
    periodic: bool
    clearance: float


class Spheres(NamedTuple):
    """Spheres of the bodies in their poses: arms (n, 3) and S (n, 4: centre, radius)."""

    arms: Array
    S: Array


class Pairs(NamedTuple):
    """Candidates: pairs of spheres that may overlap until one has moved by half the skin."""

    own: Array
    partner: Array
    skin: float


@njit(**OPTIONS)
def enter_all(spheres, grid):
    """Enter spheres (n, 4) into the empty grid."""
    for t in range(spheres.shape[0]):
        enter(spheres[t, 0], spheres[t, 1], spheres[t, 2], spheres[t, 3], t, grid)


@njit(**OPTIONS)
def place_rotated(tries, rel, radii, count, grid, clearance, rotated_spheres):
    """Place a body in the box at its first free try, and return its index; -1 if none is free.

    tries (t, 7): unit quaternion, then x, y, z as fractions 0..1 of the range that the rotated body can take. turned_spheres (k,
    4) holds the spheres of the last try at the end. The size of the grid has three components: the box. In a periodic box x and y
    are arbitrary.
    """
    k, box, periodic = radii.shape[0], grid.size, grid.periodic
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
        if fits and free(0.0, 0.0, rotated_spheres, grid, clearance):
            for s in range(k):
                x, y, z, r = rotated_spheres[s, 0], rotated_spheres[s, 1], rotated_spheres[s, 2], rotated_spheres[s, 3]
                enter(x, y, z, r, count + s, grid)
            return t
    return -1


@njit(**OPTIONS)
def pose(X, Q, bodies, scale, spheres):
    """Compute the spheres of the bodies scaled by `scale`."""
    rel, starts, arms, S = bodies.rel, bodies.starts, spheres.arms, spheres.S
    for b in range(X.shape[0]):
        a, e, i, d, f, j, g, h, k = matrix(Q[b, 0], Q[b, 1], Q[b, 2], Q[b, 3])
        for s in range(starts[b], starts[b + 1]):
            x, y, z = scale * rel[s, 0], scale * rel[s, 1], scale * rel[s, 2]
            arms[s, 0], arms[s, 1], arms[s, 2] = a * x + e * y + i * z, d * x + f * y + j * z, g * x + h * y + k * z
            S[s, sphere.X], S[s, sphere.Y], S[s, sphere.Z] = X[b, 0] + arms[s, 0], X[b, 1] + arms[s, 1], X[b, 2] + arms[s, 2]
            S[s, sphere.RADIUS] = scale * bodies.radii[s]


@njit(**CHUNK)
def _add_force(b, arm, s, f_x, f_y, f_z, lever, F):
    """Add a force at the centre of sphere s to its body; torques are divided by the body's lever."""
    F[b, 0] += f_x
    F[b, 1] += f_y
    F[b, 2] += f_z
    F[b, 3] += (arm[s, 1] * f_z - arm[s, 2] * f_y) / lever[b]
    F[b, 4] += (arm[s, 2] * f_x - arm[s, 0] * f_z) / lever[b]
    F[b, 5] += (arm[s, 0] * f_y - arm[s, 1] * f_x) / lever[b]


@njit(**CHUNK)
def _repulsion(bodies, spheres, pairs, walls, F):
    """Compute forces F (n, 6) of the energy sum(overlap^2)/2; return its largest overlap, absolute and over the radii."""
    S, arms, body, lever, own, partner = spheres.S, spheres.arms, bodies.body, bodies.lever, pairs.own, pairs.partner
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
    """Move and rotate every body along V (n, 6) by the step, none farther than `longest`."""
    for b in range(X.shape[0]):
        length = abs(step) * math.sqrt((V[b] * V[b]).sum())
        part = step * min(1.0, longest / length) if length > 0.0 else 0.0
        for axis in range(3):
            X[b, axis] += part * V[b, axis]
        rotation = part / lever[b]
        store(Q, b, 0, rotate_small(load(Q, b, 0), set4(rotation * V[b, 3], rotation * V[b, 4], rotation * V[b, 5], 0.0)))


@njit(**CHUNK)
def _moved_beyond(S, S0, skin):
    """Return whether a sphere has moved by more than `skin`."""
    for i in range(S.shape[0]):
        d_x, d_y, d_z = S[i, 0] - S0[i, 0], S[i, 1] - S0[i, 1], S[i, 2] - S0[i, 2]
        if d_x * d_x + d_y * d_y + d_z * d_z > skin * skin:
            return True
    return False


@njit(**OPTIONS)
def relax(bodies, motion, scale, pairs, walls, spheres, limit):
    """Remove overlaps of rigid bodies by FIRE (with both corrections of Guenole et al. 2020); return (`Outcome`, steps).

    `limit`: largest number of steps. Lengths are in units of a typical radius. Under an open top a body stops as soon as nothing
    pushes it: else the uppermost ones would fly off.
    """
    X, Q, V, memory = motion
    n, lever, is_open = X.shape[0], bodies.lever, math.isinf(walls.high[2])
    F = np.empty((n, 6))
    pose(X, Q, bodies, scale, spheres)
    S0 = spheres.S.copy()
    for step in range(limit):
        max_overlap, worst = _repulsion(bodies, spheres, pairs, walls, F)
        if worst <= 0.5 * walls.clearance:
            return Outcome.RELAXED, step
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
            return Outcome.JAMMED, step
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
        pose(X, Q, bodies, scale, spheres)
        if _moved_beyond(spheres.S, S0, 0.5 * pairs.skin):
            return Outcome.MOVED, step + 1
    return Outcome.SPENT, limit
