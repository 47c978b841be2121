"""Orientation of single-sphere bodies: no force depends on it, so it is integrated by a quadrature over several steps.

The rotation in a block of `STEPS` steps is their length times the sum of the spins in the middle of each. Instead of all of them
four are taken, with weights for which the sum is exact where a spin is a cubic polynomial in time (Gauss' idea, for sums). The
spin of a contact of 40 steps, a half wave, is summed to 1e-4 of it; what a sphere does at constant spin is exact.

What a stop in the middle of a block lacks is added to what it shows (`rotate_behind`), and not stored: stops change no bit.
"""

from numba import njit

from thirdbody.jit.options import BARE
from thirdbody.jit.simd import broadcast, extract, load
from thirdbody.kernels.rotation import rotate_small
from thirdbody.kernels.tables import body, orientation

STEPS = 16
"""Steps of a block; the time step changes only at its ends."""

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
def steps_behind(steps):
    """Return by how many steps the orientations are behind after so many steps of the run; negative: ahead."""
    weights = 0.0
    for k in range(steps % STEPS):
        weights += weight_of(k)
    return steps % STEPS - weights


@njit(**BARE)
def rotate_sphere(q, w, time):
    """Return the quaternion q after a time [s] of the spin w [rad/s], vectors of four; error r^5/120 of a rotation r."""
    r = broadcast(time) * w
    square = extract(r, 0) * extract(r, 0) + extract(r, 1) * extract(r, 1) + extract(r, 2) * extract(r, 2)
    return rotate_small(q, broadcast(1.0 + square / 12.0) * r)


@njit(**BARE)
def rotate_behind(b, behind, B, orientations):
    """Return the orientation of body b now, a vector of four. `behind`: `run_totals.BEHIND` [s], for a single sphere."""
    q = load(orientations, b, orientation.QUATERNION)
    return q if B[b, body.SPHERE_INERTIA] == 0.0 or behind == 0.0 else rotate_sphere(q, load(B, b, body.SPIN), behind)
