"""What of a frame is written: blocks, arrays of the bodies, precision and compression (table `output` of a scene).

Spheres that are not written follow from their bodies: the static arrays of their block then hold each sphere's place in its body.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from thirdbody.trajectory.frame import FrameMaker
from thirdbody.trajectory.polydata_block import Storage
from thirdbody.trajectory.rebuilt_spheres import LOCAL_CENTER

CLUMPS, CONTACTS, SPHERES = "clumps", "contacts", "spheres"
ALL = (SPHERES, CLUMPS, CONTACTS)
ALWAYS = ("points", "state", "state_reason")
"""Arrays of the bodies that are written whatever `output.arrays` says."""
NEEDED = "quaternion"
"""Array of the bodies from which spheres are computed, with their positions."""


class Selection(NamedTuple):
    """What of a frame is written, and how; `arrays` None: all arrays of the bodies."""

    blocks: tuple[str, ...] = ALL
    arrays: tuple[str, ...] | None = None
    single: bool = False
    compress: bool = False

    @property
    def rebuilds(self) -> bool:
        """Whether spheres are computed where the run is read."""
        return SPHERES not in self.blocks and (self.arrays is None or NEEDED in self.arrays)

    def storage(self, block: str) -> Storage:
        """Return how the arrays of a block are stored."""
        # float32 for the velocities of spheres: their motion follows from the clump's, which is stored in full precision
        return Storage(self.single or block == SPHERES, self.single, self.compress and block in (CLUMPS, SPHERES))

    def static(self, maker: FrameMaker) -> dict[str, dict[str, np.ndarray]]:
        """Return the arrays that never change, with the places of the spheres where these are computed on reading."""
        arrays = maker.static()
        if not self.rebuilds:
            return arrays
        return arrays | {SPHERES: arrays[SPHERES] | {LOCAL_CENTER: maker.state.offsets[maker.spheres]}}


EVERYTHING = Selection()
"""Selection of a scene that names none."""
