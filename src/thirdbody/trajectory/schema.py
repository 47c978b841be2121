"""Common definitions of the writer and the reader of a run: a frame, and the names in the file."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

Arrays = Mapping[str, np.ndarray]

BLOCKS = ("spheres", "clumps", "contacts", "plates")
REQUIRED_TEXTS = ("scene_text", "state_names", "reason_names", "units")
STATIC_TEXT, SUMMARY_TEXT = "static_arrays", "summary"
PROFILES = "profiles"
"""Name of the group of profiles, and of the text with their `bins` and `axis`."""

# Name of the coordinates in arrays that are read; VTK calls them `Points`.
POSITION = "position"


@dataclass(frozen=True)
class Frame:
    """All arrays written at one time, by name, in SI units.

    `points` of spheres (S, 3) and clumps (B, 3) are centres, of contacts (C, 3) the contact points, of plates (8, 3) the corners
    of the lower plate, then of the upper one; other arrays have one row per point. C may change and be 0. The names of the arrays
    are those of the first frame. `series` holds numbers or small vectors, `profiles` arrays with one row per slab, `maps` arrays
    (2, n_y, n_x) of what lies on the cells of the lower and of the upper plate.
    """

    time: float
    spheres: Arrays
    clumps: Arrays
    contacts: Arrays
    plates: Arrays | None = None
    series: Mapping[str, Any] = field(default_factory=dict)
    profiles: Arrays = field(default_factory=dict)
    maps: Arrays = field(default_factory=dict)

    def block(self, name: str) -> Arrays:
        """Return the arrays of one block; without plates the block has no points."""
        arrays = getattr(self, name)
        return {"points": np.empty((0, 3))} if arrays is None else arrays
