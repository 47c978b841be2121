"""Random particles between two bodies: planar ones with spots of unequal height, and clumps that stand in a stable pose."""

import numpy as np
from scipy.spatial.transform import Rotation

from thirdbody.bodies.irregular_clumps import irregular
from thirdbody.bodies.resting_poses import settle_all


def planar(seed):
    """One to three spots above and below, heights of 2 um up to .1 um apart; and a friction."""
    draw = np.random.default_rng([21, seed])
    above, below = (int(n) for n in draw.integers(1, 4, 2))
    spots = []
    for side, count, sign in (("upper", above, 1.0), ("lower", max(below, 3 - above), -1.0)):
        for _ in range(count):
            z, x, radius = 2e-6 + draw.uniform(-1e-7, 1e-7), draw.uniform(-2e-6, 2e-6), draw.uniform(0.5e-6, 2e-6)
            spots.append({"side": side, "x": float(x), "z": float(sign * z), "radius": float(radius)})
    return spots, float(draw.uniform(0.1, 0.6))


def clump(seed):
    """Centres (n, 3) and radii (n,) of four to eight spheres, 10 um in all, in a stable pose; and a friction."""
    draw = np.random.default_rng([22, seed])
    body = irregular(draw, int(draw.integers(4, 9)), (1.0, 0.8, 0.6), 10e-6)
    (quaternion,), _ = settle_all([body], draw)
    centers = Rotation.from_quat(np.roll(quaternion, -1)).apply(body.centers)
    return centers, body.radii, float(draw.uniform(0.1, 0.6))
