"""Spheres of a frame from their bodies: position, velocity and state, where the run file holds none."""

from collections.abc import Mapping
from functools import cached_property
from pathlib import Path

import numpy as np

from thirdbody.errors import InputError
from thirdbody.rotations import to_world
from thirdbody.trajectory.block_reader import BlockReader
from thirdbody.trajectory.named_arrays import Named, unknown_name
from thirdbody.trajectory.validate import damage_as_fault

LOCAL_CENTER = "local_center"
"""Static array of the spheres: centre in the axes of its body, from the centre of mass (S, 3) [m]."""


BODIES = ("position", "quaternion", "id", "velocity", "angular_velocity", "state", "state_reason")
"""Arrays of the bodies that those of the spheres come from."""


class RebuiltSpheres:
    """Block of the spheres of a run that does not hold them: read like a stored one."""

    def __init__(self, bodies: BlockReader, stored: BlockReader, path: Path):
        self._bodies, self._stored, self._path = bodies, stored, path

    @cached_property
    def _static(self) -> dict[str, np.ndarray]:
        return self._stored.whole()

    @property
    def names(self) -> list[str]:
        """Names of the arrays without `position`."""
        given = set(self._bodies.names)
        moving = ["velocity"] if {"velocity", "angular_velocity"} <= given else []
        return (
            [name for name in self._stored.names if name != LOCAL_CENTER]
            + moving
            + [n for n in ("state", "state_reason") if n in given]
        )

    def read(self, frame: int) -> dict[str, np.ndarray]:
        """Return all arrays of one frame. Raises InputError where the run holds no orientations."""
        if LOCAL_CENTER not in self._stored.names:
            raise InputError(
                f"{self._path}: holds no spheres (output.blocks of its scene), and no `quaternion` of the bodies from which they "
                "could be computed (output.arrays)"
            )
        given = {"position", *self._bodies.names}
        bodies = {name: self._bodies.array(name, frame) for name in BODIES if name in given}
        with damage_as_fault(self._path, "the spheres"):
            return Named(spheres_of(bodies, self._static))

    def array(self, name: str, frame: int) -> np.ndarray:
        """Return one array of one frame."""
        arrays = self.read(frame)
        if name not in arrays:
            raise unknown_name(name, arrays)
        return arrays[name]

    def rows(self, frame: int) -> int:
        """Return the number of spheres."""
        return len(self._static["radius"])


def spheres_of(bodies: Mapping[str, np.ndarray], static: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Return the arrays of the spheres of one frame, as a run holds them that writes them.

    Parameters
    ----------
    bodies : mapping of str to ndarray
        Arrays of the bodies: `position`, `quaternion`, `id`; `velocity` with `angular_velocity`, `state` and `state_reason` are
        passed on where they are there.
    static : mapping of str to ndarray
        `local_center`, `clump` (the `id` of the body), and arrays that are passed on (`radius`, `id`).

    Returns
    -------
    dict of str to ndarray
        `position` (S, 3) [m], `velocity` (S, 3) [m/s], `state`, `state_reason`, and the static arrays without `local_center`.
    """
    row = rows_of(bodies, static["clump"])
    arm = to_world(np.asarray(bodies["quaternion"], np.float64)[row], static[LOCAL_CENTER])
    arrays = {"position": bodies["position"][row] + arm}
    arrays |= {name: values for name, values in static.items() if name != LOCAL_CENTER}
    if "velocity" in bodies and "angular_velocity" in bodies:
        arrays["velocity"] = bodies["velocity"][row] + np.cross(bodies["angular_velocity"][row], arm)
    return arrays | {name: bodies[name][row] for name in ("state", "state_reason") if name in bodies}


def rows_of(bodies: Mapping[str, np.ndarray], ids: np.ndarray) -> np.ndarray:
    """Return the rows of bodies with these ids: rows may be in any order."""
    if "id" not in bodies:
        return ids.astype(np.int64)
    order = np.argsort(bodies["id"])
    return np.asarray(order[np.searchsorted(bodies["id"][order], ids)])
