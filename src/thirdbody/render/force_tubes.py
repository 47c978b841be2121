"""Contact forces as tubes from the centres of bodies to their contacts; the thickness shows the force."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from thirdbody.errors import InputError
from thirdbody.palette import rgb
from thirdbody.render.coloring import Arrays, Coloring
from thirdbody.trajectory.rebuilt_spheres import rows_of

if TYPE_CHECKING:
    import pyvista

# Radius of the thickest tube over the mean radius of the bodies, and the percentage of forces that are thinner.
THICKEST, COMMON = 0.17, 99.0

# Darker tubes show no roundness.
TUBE = "#3C424B"

_SIDES = 8


@dataclass(frozen=True)
class Tubes:
    """Segments `start`, `end` (T, 3) [m] with `force` (T,) [N] and `colors` (T, 3); `body` (T,) is the row of its body.

    `full_scale` is the force of the thickest tube; few larger ones are drawn no thicker.
    """

    start: np.ndarray
    end: np.ndarray
    force: np.ndarray
    colors: np.ndarray
    body: np.ndarray
    full_scale: float


def force_tubes(contacts: Arrays, bodies: Arrays, shift: np.ndarray, size: np.ndarray | None, coloring: Coloring) -> Tubes:
    """Return the tubes of one frame: centre of a body, contact point and, for two bodies, the other centre.

    `shift` (B, 3) is subtracted to wrap bodies, `size` (2,) the periodic domain or None. Tubes have the colours of contacts if
    these have the drawn array, and are dark otherwise. Raises InputError without forces.
    """
    if "force" not in contacts or "body" not in contacts:
        raise InputError("forces: this run recorded no forces of its contacts")
    force = np.linalg.norm(contacts["force"], axis=1)
    colors = np.tile(np.array(rgb(TUBE), np.uint8), (len(force), 1))
    if coloring.tubes is not None:
        colors = coloring.colors(coloring.tubes)
    own = rows_of(bodies, contacts["body"])
    middle = bodies["position"] - shift
    point = nearest_image(contacts["position"] - shift[own] - middle[own], size) + middle[own]
    pair = contacts["partner"] >= 0
    other = rows_of(bodies, contacts["partner"][pair])
    end = nearest_image(middle[other] - point[pair], size) + point[pair]
    return Tubes(
        start=np.concatenate([middle[own], point[pair]]),
        end=np.concatenate([point, end]),
        force=np.concatenate([force, force[pair]]),
        colors=np.concatenate([colors, colors[pair]]),
        body=np.concatenate([own, own[pair]]),
        full_scale=float(np.percentile(force, COMMON)) if len(force) else 0.0,
    )


def nearest_image(vectors: np.ndarray, size: np.ndarray | None) -> np.ndarray:
    """Return the shortest periodic images of vectors (n, 3); unchanged without a periodic domain."""
    if size is None:
        return vectors
    short = vectors.copy()
    short[:, :2] -= np.rint(vectors[:, :2] / size) * size
    return short


def tube_mesh(start: np.ndarray, end: np.ndarray, radii: np.ndarray, colors: np.ndarray) -> pyvista.PolyData:
    """Return one tube per segment from `start` to `end` (n, 3) with `radii` (n,) and `colors` (n, 3) uint8, the array `color`."""
    import pyvista

    points = np.stack([start, end], axis=1).reshape(-1, 3).astype(np.float32)
    lines = np.insert(np.arange(len(points)).reshape(-1, 2), 0, 2, axis=1)
    mesh = pyvista.PolyData(points, lines=lines.ravel())
    mesh["radius"], mesh["color"] = np.repeat(np.float32(radii), 2), np.repeat(colors, 2, axis=0)
    return mesh.tube(scalars="radius", absolute=True, n_sides=_SIDES)
