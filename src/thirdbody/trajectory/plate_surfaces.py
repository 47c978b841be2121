"""Surfaces of the plates in the file of a run: `/surfaces/lower` and `/surfaces/upper`, written once."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import h5py
import numpy as np

from thirdbody.surfaces.surface import Surface

SURFACES = "surfaces"
"""Name of the group. A data set holds heights (n_y, n_x) [m]; its attributes are the fields of `Surface`."""


def write_surfaces(file: h5py.File, surfaces: Mapping[str, Surface]) -> None:
    """Write the surfaces by plate into a new file."""
    for side, surface in surfaces.items():
        heights = file.require_group(SURFACES).create_dataset(side, data=np.asarray(surface.heights, np.float64))
        heights.attrs["units"] = "m"
        heights.attrs["size"] = np.array(surface.size)
        heights.attrs["shortest"] = surface.shortest
        heights.attrs["curvature"] = np.uint8(surface.curvature)
        heights.attrs["copies"] = np.array(surface.copies, np.int64)


def read_surfaces(file: h5py.File) -> dict[str, Surface]:
    """Return the surfaces by plate; none of flat plates."""
    return {side: _surface(heights) for side, heights in file.get(SURFACES, {}).items()}


def _surface(heights: h5py.Dataset) -> Surface:
    numbers: Any = heights.attrs
    size, copies = (tuple(numbers[name].tolist()) for name in ("size", "copies"))
    return Surface(heights[()], size, float(numbers["shortest"]), bool(numbers["curvature"]), copies=copies)


def refuse_unsound_surfaces(file: h5py.File) -> None:
    """Raise ValueError, TypeError or KeyError for surfaces that `write_surfaces` does not write."""
    for side, heights in file.get(SURFACES, {}).items():
        if side not in ("lower", "upper") or heights.ndim != 2 or heights.dtype.kind != "f" or min(heights.shape) < 4:
            raise ValueError(f"{heights.name} is no surface of a plate")
        if heights.nbytes > file.id.get_filesize() and heights.compression is None:
            raise ValueError(f"{heights.name} promises {heights.nbytes:.3g} bytes")
        for name in ("size", "copies"):
            if heights.attrs[name].shape != (2,) or not np.all((heights.attrs[name] > 0) & np.isfinite(heights.attrs[name])):
                raise ValueError(f"{heights.name}: {name} {str(heights.attrs[name])[:60]}")
