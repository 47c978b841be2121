"""Wear in the check of a scene: how deep a spot that slides all the way wears, told where nothing measures it and it matters."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

from thirdbody.report.expected_spots import expected_spots

if TYPE_CHECKING:
    from thirdbody.assembly.simulation import Simulation

LARGE = 0.3
"""Worn depth over overlap from which on a scene is warned: the spot is then no longer that of a fresh sphere."""

COEFFICIENT = 1e-14
"""Volume worn per load times slip [m3/J], of steel on steel that is not lubricated: 1e-15 to 1e-13 (Archard 1953)."""

MEASURE = "wear"


class Wear(NamedTuple):
    """Depth [m] that a spot wears, the same over its overlap, and the names of both materials."""

    depth: float
    fraction: float
    pair: str


def expected_wear(built: Simulation) -> Wear | None:
    """Return the wear of the pair that wears deepest: a sphere of median radius that slides on one spot, all the way.

    h = k p s with the mean pressure p of Hertz under the expected load and the path s of the plate (Archard 1953, J. Appl. Phys.
    24, 981, Eq. 4, with k = K/H). None where no load is known.
    """
    path, spots = built.schedule.path(0.0, built.planned_time), expected_spots(built)
    if spots is None or not 0.0 < path < math.inf:
        return None
    area = math.pi * spots.contact_radius * spots.contact_radius
    deepest = spots.loads.index(max(spots.loads))
    depth, pair = COEFFICIENT * spots.loads[deepest] / area * path, built.choice.pairs[deepest]
    return Wear(depth, depth / spots.overlap, f"{pair.a.name}/{pair.b.name}")


def wear_warnings(built: Simulation) -> list[str]:
    """Return a warning where spots would wear off noticeably and no measure of the scene tells where."""
    wear = expected_wear(built)
    if wear is None or wear.fraction < LARGE or any(measure.name == MEASURE for measure in built.choice.measures):
        return []
    return [
        f"a spot of {wear.pair} that slides all the way wears by some {1e9 * wear.depth:.2g} nm, {wear.fraction:.2g} of its "
        f"overlap, at {COEFFICIENT:g} m3/J (steel, not lubricated): measures.{MEASURE} tells where; shapes stay as they are"
    ]
