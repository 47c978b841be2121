"""Measured surfaces in the formats of instruments, read by SurfaceTopography (the extra `topography`)."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from thirdbody import units
from thirdbody.bodies.bounded_read import read_bytes
from thirdbody.errors import Fault, InputError, MissingLibrary, UsageError
from thirdbody.surfaces.grid import MAX_POINTS
from thirdbody.surfaces.height_map import TEXTS, HeightMap, checked_map
from thirdbody.surfaces.read_scan import READERS, read_scan


def read_any_scan(path: Path, unit: str | None = None, spacing: str | None = None) -> HeightMap:
    """Return the height map of a file of any format that can be read; `unit` is that of a file which names none.

    spacing: that of the points of a text file, one length, or two with a comma, along x and y.

    Raises InputError for the file, UsageError for a unit that does not belong there, MissingLibrary for a format that needs
    SurfaceTopography.
    """
    if path.suffix.lower() in TEXTS:
        if unit is None or spacing is None:
            raise UsageError(f"{path}: text names neither its unit nor its points: give --unit um --spacing '0.5 um'")
        try:
            steps = [units.parse(text, "length") for text in spacing.split(",")]
        except ValueError as error:
            raise UsageError(f"--spacing: {error}") from None
        if len(steps) > 2:
            raise UsageError(f"--spacing: '{spacing}': expected one length, or two, along x and y")
        return read_scan(path, "", _unit(path, None, unit), (steps[0], steps[-1]))
    if spacing is not None:
        raise UsageError("--spacing: for text files (.csv, .txt); others have it")
    if path.suffix.lower() in READERS:
        if unit is not None:
            raise UsageError("--unit: NPZ and X3P files name their unit themselves")
        return read_scan(path)
    read_bytes(path)  # its faults are clearer than those of a reader of many formats
    try:
        from SurfaceTopography.IO import open_topography
    except ImportError:
        raise MissingLibrary(f"{path}: this format is read by SurfaceTopography: pip install 'thirdbody[topography]'") from None
    try:
        with open_topography(str(path)) as file:
            topography = file.topography()
            _refuse_many_points(path, math.prod(topography.nb_grid_pts))
            heights, sizes, named = topography.heights(), topography.physical_sizes, topography.unit
            regular = topography.dim == 2 and topography.is_uniform
    except InputError:
        raise
    except MemoryError:
        raise InputError(Fault("", "does not fit into memory", str(path))) from None
    except Exception as error:  # forty readers of foreign formats: a damaged file may raise anything
        reason = f"{type(error).__name__}: {error}".strip().splitlines()[0][:200]
        raise InputError(Fault("", f"SurfaceTopography cannot read it ({reason})", str(path))) from None
    if not regular:
        raise InputError(Fault("", "is no height map on a regular grid", str(path)))
    scale = _unit(path, named, unit)
    heights = np.ascontiguousarray(np.ma.filled(np.ma.asarray(heights, float), np.nan).T) * scale
    steps = [float(length) * scale / n for length, n in zip(sizes, heights.shape[::-1], strict=True)]
    return checked_map(heights, (steps[0], steps[1]), str(path))


def _refuse_many_points(path: Path, points: int) -> None:
    """Raise InputError for more points than are read, before they take memory."""
    if points > MAX_POINTS:
        raise InputError(Fault("", f"has {points:.3g} points, at most {MAX_POINTS:.3g} are read", str(path)))


def _unit(path: Path, named: str | None, given: str | None) -> float:
    """Return the unit of the lengths of a file [m]. Raises UsageError or InputError."""
    if named and given is not None:
        raise UsageError(f"--unit: {path} names its unit, {named}")
    if not named and given is None:
        raise UsageError(f"{path}: names no unit: give the one of its lengths, such as --unit um")
    text = str(named or given)
    try:
        return units.parse(text if text[:1].isdigit() else f"1 {text}", "length")
    except ValueError as error:
        if named:
            raise InputError(Fault("unit", str(error), str(path))) from None
        raise UsageError(f"--unit: {error}") from None
