"""Blocks of a run file, read frame by frame, and spheres that follow from their bodies; maps and surfaces of the plates."""

from collections.abc import Collection, Iterable, Mapping
from functools import cached_property
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from thirdbody.errors import InputError, nearest
from thirdbody.rotations import to_world
from thirdbody.surfaces.surface import Surface
from thirdbody.trajectory.names import MAPS, PLATES, POSITION, SURFACES
from thirdbody.trajectory.open_file import damage_as_fault

LOCAL_CENTER = "local_center"
"""Static array of the spheres: centre in the axes of its body, from the centre of mass (S, 3) [m]."""

BODIES = (POSITION, "quaternion", "id", "velocity", "angular_velocity", "state", "state_reason")
"""Arrays of the bodies that those of the spheres come from."""


class Named(dict[str, Any]):
    """Dictionary whose KeyError suggests the nearest names."""

    def __missing__(self, name: object) -> Any:
        raise _unknown_name(name, self)


def _unknown_name(name: object, known: Iterable[str]) -> KeyError:
    return KeyError(f"no {name!r}; {nearest(str(name), known)}")


class BlockReader:
    """Arrays of one block, cut out of their growing data sets by the offsets of a frame."""

    def __init__(self, group: h5py.Group, path: Path):
        self._group, self._data = group, group["PointData"]
        self._steps = group["Steps"]
        self.frames = int(self._steps.attrs["NSteps"])
        self._path = path
        self.names_of: dict[str, int] = {}  # number of names, for arrays of codes

    @property
    def names(self) -> list[str]:
        """Names of the arrays without `position`."""
        return list(self._data)

    def whole(self) -> dict[str, np.ndarray]:
        """Return all arrays with all rows, of a block whose arrays never change."""
        with damage_as_fault(self._path, self._group.name):
            return {name: values[()] for name, values in self._data.items()}

    def read(self, frame: int, without: Collection[str] = ()) -> dict[str, np.ndarray]:
        """Return all arrays of one frame but some, the coordinates as `position`."""
        rows = self.rows(frame)  # once: each look into the file costs as much as an array
        return Named((name, self._cut(name, frame, rows)) for name in (POSITION, *self._data) if name not in without)

    def array(self, name: str, frame: int) -> np.ndarray:
        """Return one array of one frame."""
        if name != POSITION and name not in self._data:
            raise _unknown_name(name, (POSITION, *self._data))
        return self._cut(name, frame, self.rows(frame))

    def _cut(self, name: str, frame: int, rows: int) -> np.ndarray:
        with damage_as_fault(self._path, f"{self._group.name}/{name}"):
            if name == POSITION:
                data, offsets = self._group["Points"], self._steps["PointOffsets"]
            else:
                data, offsets = self._data[name], self._steps["PointDataOffsets"][name]
            start = int(offsets[frame])
            return self._known(name, data[start : start + rows])

    def rows(self, frame: int) -> int:
        """Return the number of rows of one frame."""
        with damage_as_fault(self._path, f"{self._group.name}/NumberOfPoints"):
            return int(self._group["NumberOfPoints"][int(self._steps["PartOffsets"][frame])])

    def history(self, name: str, frames: int) -> np.ndarray:
        """Return one varying array at all frames (frames, rows, ...), for a block with a constant number of rows."""
        rows = self.rows(0) if frames else 0
        with damage_as_fault(self._path, f"{self._group.name}/{name}"):
            data = self._data[name]
            return self._known(name, data[: frames * rows].reshape(frames, rows, *data.shape[1:]))

    def _known(self, name: str, codes: np.ndarray) -> np.ndarray:
        maximum = self.names_of.get(name)
        if maximum is not None and codes.size and not 0 <= codes.min() <= codes.max() < maximum:
            raise ValueError(f"codes {codes.min()} to {codes.max()}, of which {maximum} have names")
        return codes


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
        moving += [name for name in ("state", "state_reason") if name in given]
        return [name for name in self._stored.names if name != LOCAL_CENTER] + moving

    def read(self, frame: int) -> dict[str, np.ndarray]:
        """Return all arrays of one frame, as a run holds them that writes them.

        Raises InputError where the run holds no orientations.
        """
        if LOCAL_CENTER not in self._stored.names:
            raise InputError(
                f"{self._path}: holds no spheres (output.blocks of its scene), and no `quaternion` of the bodies from which they "
                "could be computed (output.arrays)"
            )
        given = {POSITION, *self._bodies.names}
        bodies = {name: self._bodies.array(name, frame) for name in BODIES if name in given}
        with damage_as_fault(self._path, "the spheres"):
            row = rows_of(bodies, self._static["clump"])
            arm = to_world(np.asarray(bodies["quaternion"], np.float64)[row], self._static[LOCAL_CENTER])
            arrays = Named({POSITION: bodies[POSITION][row] + arm})
            arrays.update((name, values) for name, values in self._static.items() if name != LOCAL_CENTER)
            if "velocity" in bodies and "angular_velocity" in bodies:
                arrays["velocity"] = bodies["velocity"][row] + np.cross(bodies["angular_velocity"][row], arm)
            arrays.update((name, bodies[name][row]) for name in ("state", "state_reason") if name in bodies)
            return arrays

    def array(self, name: str, frame: int) -> np.ndarray:
        """Return one array of one frame."""
        return self.read(frame)[name]

    def rows(self, frame: int) -> int:
        """Return the number of spheres."""
        return len(self._static["radius"])


def rows_of(bodies: Mapping[str, np.ndarray], ids: np.ndarray) -> np.ndarray:
    """Return the rows of bodies with these ids: rows may be in any order."""
    if "id" not in bodies:
        return ids.astype(np.int64)
    order = np.argsort(bodies["id"])
    return np.asarray(order[np.searchsorted(bodies["id"][order], ids)])


def read_maps(file: h5py.File, frame: int) -> dict[str, np.ndarray]:
    """Return the maps of one frame by name, (2, n_y, n_x); none in a run without."""
    result = {}
    for name, values in file.get(MAPS, {}).items():
        rows = int(values.attrs["rows"])
        result[name] = values[frame * rows : (frame + 1) * rows].reshape(2, rows // 2, values.shape[1])
    return result


def read_surfaces(file: h5py.File) -> dict[str, Surface]:
    """Return the surfaces by plate; none of flat plates."""
    surfaces = {}
    for side, heights in file.get(SURFACES, {}).items():
        numbers: Any = heights.attrs
        size, copies = (tuple(numbers[name].tolist()) for name in ("size", "copies"))
        surfaces[side] = Surface(heights[()], size, float(numbers["shortest"]), bool(numbers["curvature"]), copies=copies)
    return surfaces


def refuse_other_plates(plate: str) -> None:
    """Raise ValueError for a name of no plate."""
    if plate not in PLATES:
        raise ValueError(f"plate: '{plate}' is not one of 'lower', 'upper'")
