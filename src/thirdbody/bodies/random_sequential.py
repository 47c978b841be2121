"""Random sequential addition: bodies at random positions and orientations in a volume, without overlap."""

from collections.abc import Sequence

import numpy as np

from thirdbody.bodies.bed_relaxation import enter_all, place_rotated
from thirdbody.bodies.clump import Clump, matrix_from_quaternion
from thirdbody.bodies.layer_packing import CLEARANCE, TRIES, batches, empty_grid
from thirdbody.errors import Fault, InputError


def scatter(
    clumps: Sequence[Clump],
    height: float,
    domain_size: tuple[float, float],
    periodic: bool,
    rng: np.random.Generator,
    standing: np.ndarray | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Return centroids (n, 3) [m] and quaternions (n, 4) of bodies placed between z = 0 and the height [m].

    Orientations are uniform over all rotations, positions over the range of the rotated body; x and y are in [0, size), periodic,
    or the whole body stays inside. Large bodies first; spheres of different bodies keep a gap of 1e-3 of the sum of their radii,
    also to those of `standing` (m, 4: x, y, z, radius) [m]. InputError, with the solid fraction reached: no free position in 50
    000 tries; or a body longer than a period.
    """
    box = np.array([*domain_size, height], dtype=np.float64)
    refuse_long(clumps, box, periodic)
    x, q = np.empty((len(clumps), 3)), np.empty((len(clumps), 4))
    if not len(clumps):
        return x, q
    old = np.empty((0, 4)) if standing is None else standing
    radii = np.concatenate([old[:, 3], *(body.radii for body in clumps)])
    grid = empty_grid(radii, box, periodic)
    count = len(old)
    enter_all(old, grid)
    order = np.argsort([-body.volume for body in clumps], kind="stable")
    for done, b in enumerate(order):
        body = clumps[b]
        spheres = np.empty((len(body.radii), 4))
        for batch in batches():
            tries = np.concatenate([rng.normal(size=(batch, 4)), rng.random((batch, 3))], axis=1)
            tries[:, :4] /= np.linalg.norm(tries[:, :4], axis=1)[:, None]
            k = place_rotated(tries, body.centers, body.radii, count, grid, CLEARANCE, spheres)
            if k >= 0:
                break
        else:
            raise _full(clumps, order, done, box)
        q[b] = tries[k, :4]
        x[b] = spheres[0, :3] - matrix_from_quaternion(q[b]) @ body.centers[0]
        count += len(spheres)
    x[:, :2] -= np.floor(x[:, :2] / box[:2]) * box[:2] if periodic else 0.0
    return x, q


def refuse_long(clumps: Sequence[Clump], size: np.ndarray, periodic: bool) -> None:
    """Raise InputError for a body that, in some orientation, would overlap its own image."""
    side = float(min(size[:2]))
    for b, body in enumerate(clumps if periodic else ()):
        apart = np.linalg.norm(body.centers[:, None] - body.centers, axis=-1)
        length = float((apart + body.radii[:, None] + body.radii).max())
        if length * (1.0 + 2.0 * CLEARANCE) >= side:
            message = f"body {b} is {length:.3g} m long and would meet its own image in a period of {side:.3g} m"
            raise InputError(Fault("domain.size", message))


def _full(clumps: Sequence[Clump], order: np.ndarray, done: int, box: np.ndarray) -> InputError:
    """Return the fault of a placement that failed after `done` bodies."""
    volumes = np.array([clumps[b].volume for b in order])
    reached, wanted = volumes[:done].sum() / box.prod(), volumes.sum() / box.prod()
    return InputError(
        Fault(
            "height",
            f"no space for body {order[done]} after {TRIES} tries: {done} of {len(order)} bodies placed, solid fraction "
            f"{reached:.3f} reached of {wanted:.3f} wanted in a volume {box[2]:.3g} m high",
        )
    )
