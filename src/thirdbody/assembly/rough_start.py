"""Initial heights of bodies and of the upper plate between rough plates.

Bodies keep the pose that they would have on a plane and are lifted until they touch the lower surface; under load they turn into
a seat of the rough surface while they settle.
"""

from collections.abc import Sequence

import numpy as np

from thirdbody.assembly.placement import spheres_of
from thirdbody.bodies.clump import Clump
from thirdbody.bodies.packing import overlaps
from thirdbody.scene.model import Scene
from thirdbody.surfaces.surface import Surface, dilation

ABOVE = 1e-6
"""Height above the first touch over the diameter: more than the error of `dilation`, so that nothing touches at the start."""

ROUNDS = 100
"""Largest number of rounds that lift neighbours to a common height."""


def lift_bodies(scene: Scene, clumps: Sequence[Clump], members: np.ndarray, x: np.ndarray, q: np.ndarray, lower: Surface) -> None:
    """Move bodies that rest on the plane z = 0 (rows `members` of x) up or down until they touch the rough lower plate.

    Bodies that would overlap at different heights, one reaching under the other, keep their relative height.
    """
    if not len(members):
        return
    centres, radii, body = spheres_of([clumps[b] for b in members], x[members], q[members])
    lift = np.full(len(members), -np.inf)
    np.maximum.at(lift, body, dilation(lower, centres, radii) - centres[:, 2])
    for _ in range(ROUNDS if scene.contact.debris_contact != "none" else 0):
        raised = centres + np.array([0.0, 0.0, 1.0]) * lift[body][:, None]
        pairs = overlaps(raised, radii, body, scene.domain.size, scene.domain.periodic)
        if not pairs:
            break
        for a, b, _depth in pairs:
            lift[a] = lift[b] = max(lift[a], lift[b])
    x[members, 2] += lift + ABOVE * np.array([clumps[b].diameter for b in members])


def depth_in_lower(lower: Surface | None, centres: np.ndarray, radii: np.ndarray) -> np.ndarray:
    """Return how deep (n,) [m] spheres reach into the lower plate, rough or flat; negative above it."""
    return (radii if lower is None else dilation(lower, centres, radii)) - centres[:, 2]


def plate_heights(upper: Surface | None, centres: np.ndarray, radii: np.ndarray) -> np.ndarray:
    """Return the height (n,) [m] of the upper plate's mean plane at which it first touches each sphere."""
    if upper is None:
        return centres[:, 2] + radii
    return centres[:, 2] + dilation(upper, centres, radii)
