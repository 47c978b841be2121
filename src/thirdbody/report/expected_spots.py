"""Spots that the checks of heat and wear expect: a sphere of median radius under the expected load, on each pair of materials."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from thirdbody.statics.contacts import response

if TYPE_CHECKING:
    from thirdbody.assembly.simulation import Simulation


class Spots(NamedTuple):
    """Overlap and contact radius [m] of all spots, and the load [N] of that of each pair."""

    overlap: float
    contact_radius: float
    loads: list[float]


def expected_spots(built: Simulation) -> Spots | None:
    """Return the spots by the overlap that all pairs share; None where no load is known."""
    shared, n = built.upper.shared_overlap, len(built.choice.pairs)
    if shared <= 0.0:
        return None
    radius = np.full(n, float(np.median(built.state.spheres.radius)))
    loads = response(built.state.physics, shared * radius, radius, np.arange(n)).force
    return Spots(shared * float(radius[0]), math.sqrt(shared) * float(radius[0]), [float(load) for load in loads])
