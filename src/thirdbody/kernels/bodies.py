"""Positions and velocities of spheres from those of their bodies, and checks of bodies, in chunks of fixed size.

Orientation of single-sphere bodies: no force depends on it, so it is integrated by a quadrature over several steps. The rotation
in a block of `STEPS` steps is their length times the sum of the spins in the middle of each. Instead of all of them four are
taken, with weights for which the sum is exact where a spin is a cubic polynomial in time (Gauss' idea, for sums). What a stop in
the middle of a block lacks is added to what it shows (`rotate_behind`), and not stored: stops change no bit.
"""

import math
from collections import namedtuple

import numpy as np
from numba import njit, types

from thirdbody.jit.options import BARE, BARE_CHUNK, DIRECT, NO_COUNTS, entry
from thirdbody.jit.simd import all_below, broadcast, cross, less_mask, load, set4, store, with_last
from thirdbody.kernels.plates import three
from thirdbody.kernels.tables import body, body_extra, domain, orientation, search_pose, sphere
from thirdbody.kernels.vectors import matrix, rotate_small, spin, total

BODIES = 64  # bodies per chunk

WITH_PLATE, WITH_SPHERE, REMOTE = range(3)
"""Rows of `cuts`: where the candidates of a chunk begin, of its spheres with plates, and of its spheres with others that they
own; then where the remote forces on its bodies begin."""

MAX_DISTANCE = 1e150  # bound of all distances [m]; its square is finite

NEGLIGIBLE_SPEED, NEGLIGIBLE_SPIN, NEGLIGIBLE_MOMENTUM = 1e-60, 1e-60, 1e-90
"""Bounds below which motion is set to zero [m/s, rad/s, kg m2/s], some fifty orders below any motion: a sphere that a dashpot
brings to rest between two plates decays for ever, and arithmetic on denormal numbers is thirty times slower."""

_I1, _F2 = types.Array(types.int64, 1, "C"), types.Array(types.float64, 2, "C")

BodyMotion = namedtuple("BodyMotion", "position rotation velocity spin end_velocity end_spin")
"""Pose of a body at the end of a step, with the columns of its rotation matrix; velocity and spin of the step, and those
predicted for its end: vectors of four of `jit.simd`, or tuples of three."""


@njit(**BARE)
def store_three(S, s, c, v):
    """Write the first three numbers of v into row s from column c on. The next column, another quantity, is preserved."""
    store(S, s, c, with_last(v, load(S, s, c)))


@njit(**BARE)
def place_sphere(s, offsets, motion, h, S):
    """Set position, arm and velocities of sphere s by a `BodyMotion` of vectors of four. The step uses the arm of h [s] ago."""
    rotation, w = motion.rotation, motion.spin
    arm = rotation[0] * broadcast(offsets[s, 0]) + rotation[1] * broadcast(offsets[s, 1]) + rotation[2] * broadcast(offsets[s, 2])
    middle = arm - broadcast(h) * cross(w, arm)
    store_three(S, s, np.int64(sphere.POSITION), motion.position + arm)
    store_three(S, s, np.int64(sphere.MID_VELOCITY), motion.velocity + cross(w, middle))
    if not is_aliased(S):
        store_three(S, s, np.int64(sphere.ARM), arm)
    store(S, s, sphere.MID_SPIN, w)
    store_three(S, s, np.int64(sphere.END_VELOCITY), motion.end_velocity + cross(motion.end_spin, arm))
    store_three(S, s, np.int64(sphere.END_SPIN), motion.end_spin)


@njit(**BARE)
def is_aliased(S):
    """Return whether bodies and spheres share one table (`body`): then no sphere has an arm."""
    return S.shape[1] != sphere.WIDTH


@njit(**BARE)
def arm_to_sphere(s, S):
    return broadcast(0.0) if is_aliased(S) else load(S, s, sphere.ARM)


@njit(**BARE)
def vector(v):
    return set4(v[0], v[1], v[2], 0.0)


@njit(**BARE)
def columns(matrix):
    a, b, c, d, e, f, g, h, i = matrix
    return set4(a, d, g, 0.0), set4(b, e, h, 0.0), set4(c, f, i, 0.0)


@njit(**BARE_CHUNK)
def place_body(b, start, offsets, S, motion, dt):
    """Set positions, arms and velocities of body b's spheres by a `BodyMotion` of tuples of three, with the quaternion."""
    x, q, v, w, end_v, end_w = motion
    vectors = BodyMotion(vector(x), columns(matrix(q[0], q[1], q[2], q[3])), vector(v), vector(w), vector(end_v), vector(end_w))
    for s in range(start[b], start[b + 1]):
        place_sphere(s, offsets, vectors, 0.5 * dt, S)


@njit(**BARE_CHUNK)
def spin_body(b, B, E, orientations):
    if B[b, body.SPHERE_INERTIA] != 0.0:
        store_three(E, b, np.int64(body_extra.ANGULAR_MOMENTUM), broadcast(B[b, body.SPHERE_INERTIA]) * load(B, b, body.SPIN))
    else:
        momentum, inertia = three(E, b, body_extra.ANGULAR_MOMENTUM), three(E, b, body_extra.INERTIA)
        w = spin(quaternion(b, orientations), momentum, inertia)
        B[b, body.SPIN], B[b, body.SPIN + 1], B[b, body.SPIN + 2] = w


@entry(types.void(types.boolean, _I1, _F2, _F2, _F2, _F2, _F2), **DIRECT, **NO_COUNTS)
def place_all(spins, start, offsets, S, B, E, orientations):
    """Place all spheres at the present poses and velocities of their bodies; update the spins of these, or take them as given."""
    for b in range(B.shape[0]):
        if spins:
            spin_body(b, B, E, orientations)
        if not is_aliased(S):
            place_as_it_is(b, start, offsets, S, B, orientations)


@njit(**BARE_CHUNK)
def place_as_it_is(b, start, offsets, S, B, orientations):
    x, v, w = three(B, b, body.POSITION), three(B, b, body.VELOCITY), three(B, b, body.SPIN)
    place_body(b, start, offsets, S, BodyMotion(x, quaternion(b, orientations), v, w, v, w), 0.0)


@njit(**BARE)
def quaternion(b, orientations):
    q = orientation.QUATERNION
    return orientations[b, q], orientations[b, q + 1], orientations[b, q + 2], orientations[b, q + 3]


@njit(**BARE)
def check_position(b, x, relative_distance, limits, bad, out):
    """Update `bad` and `out`: b + 1 if body b or its `relative_distance` is not finite, or if it left the domain."""
    low, high = limits
    finite = all_below(x, MAX_DISTANCE) & all_below(broadcast(0.0) - x, MAX_DISTANCE) & (relative_distance < MAX_DISTANCE)
    return bad if finite else b + 1, b + 1 if (less_mask(x, low) | less_mask(high, x)) != 0 else out


@njit(**BARE)
def limits_of(D):
    """Return lower and upper bounds of the domain; periodic or unbounded sides are infinite."""
    l_x, l_y = D[domain.LENGTH_X], D[domain.LENGTH_Y]
    low_x, high_x = (0.0, -l_x) if l_x < 0.0 else (-np.inf, np.inf)
    low_y, high_y = (0.0, -l_y) if l_y < 0.0 else (-np.inf, np.inf)
    return set4(low_x, low_y, D[domain.FLOOR], -np.inf), set4(high_x, high_y, np.inf, np.inf)


@njit(**BARE)
def largest_displacement(X0, B, E, orientations):
    largest = 0.0
    for b in range(B.shape[0]):
        x = B[b, body.POSITION] - X0[b, search_pose.POSITION]
        y = B[b, body.POSITION + 1] - X0[b, search_pose.POSITION + 1]
        z = B[b, body.POSITION + 2] - X0[b, search_pose.POSITION + 2]
        same = 0.0
        for k in range(4):
            same += orientations[b, orientation.QUATERNION + k] * X0[b, search_pose.QUATERNION + k]
        # a point at the end of the arm moves by the chord: twice the arm times the sine of half the angle
        chord = 2.0 * E[b, body_extra.LONGEST_ARM] * math.sqrt(max(1.0 - same * same, 0.0))
        largest = max(largest, math.sqrt(x * x + y * y + z * z) + chord)
    return largest


STEPS = 16  # steps of a block; the time step changes only at its ends

OUTER, INNER = (1, 14), (5, 10)
"""Steps of a block, from 0 on, whose spins are taken. At distances of 6.5 and 2.5 steps from the middle:"""

OUTER_WEIGHT, INNER_WEIGHT = 10.0 / 3.0, 14.0 / 3.0
"""2 (OUTER_WEIGHT + INNER_WEIGHT) = 16, and 2 (6.5^2 OUTER_WEIGHT + 2.5^2 INNER_WEIGHT) = sum of (k - 7.5)^2 = 340."""


@njit(**BARE)
def weight_of(step):
    """Return for how many steps the spin of a step stands. `step`: number of steps before it, of the run or of the block."""
    k = step % STEPS
    if k == OUTER[0] or k == OUTER[1]:
        return OUTER_WEIGHT
    return INNER_WEIGHT if k == INNER[0] or k == INNER[1] else 0.0


@njit(**BARE)
def rotate_sphere(q, w, time):
    """Return the quaternion q after a time [s] of the spin w [rad/s], vectors of four; error r^5/120 of a rotation r."""
    r = broadcast(time) * w
    return rotate_small(q, broadcast(1.0 + total(r * r) / 12.0) * r)


@njit(**BARE)
def rotate_behind(b, behind, B, orientations):
    """Return the orientation of body b now, a vector of four. `behind`: `run_totals.BEHIND` [s]."""
    q = load(orientations, b, orientation.QUATERNION)
    return q if B[b, body.SPHERE_INERTIA] == 0.0 or behind == 0.0 else rotate_sphere(q, load(B, b, body.SPIN), behind)
