"""Scales of rough plates against the debris: does Hertz's theory hold, do spheres touch at several points?"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from thirdbody.quantity import percent
from thirdbody.surfaces.statistics import Statistics
from thirdbody.surfaces.surface import Surface
from thirdbody.units import pretty

NARROW = 0.1
"""Contact radius over the shortest wavelength, or over the radius of the sharpest crest, from which on a warning is given.

At 0.1 the fourth-order term of a wave is 3 % of the second-order one at the edge of the contact: (2 pi 0.1)^2/12.
"""

MERGING = 0.4
"""Energy of a contact over load times overlap (Hertz): at most about as much is made or lost where two contacts of a hollow
become one. Measured: 0.28 (`tests/theory/test_sharp_hollows.py`).
"""

NOTICED = 3e-3
"""That energy over the work of the load along the shortest wavelength, from which on a warning is given: with a friction of 0.3 a
contact that merges once in each wave changes the work by 1 %.
"""

STEEP = 1.0
"""Slope from which on a warning is given: 45 degrees, as steep as the edge of a step becomes when it is smoothed."""


@dataclass(frozen=True)
class SurfaceScales:
    """A rough plate against the debris.

    `radius`: of the largest sphere [m]; `contact_radius`: expected on a flat plate [m], 0 where no load is known; `shortest`:
    shortest wavelength [m]; `curved`: whether curvature changes the radius of contacts.
    """

    statistics: Statistics
    radius: float
    contact_radius: float
    shortest: float
    curved: bool

    @property
    def crest(self) -> float:
        """Curvature of the sharpest crest, times the radius."""
        return self.statistics.crest_curvature * self.radius

    @property
    def valley(self) -> float:
        """Curvature of the sharpest valley, times the radius: above 1 the sphere touches at several points."""
        return self.statistics.valley_curvature * self.radius

    @property
    def merging(self) -> float:
        """Energy made or lost where two contacts of a sphere become one, over the load [m]; 0 where a sphere has one contact."""
        return MERGING * self.contact_radius**2 / self.radius if self.valley > 1.0 else 0.0

    @property
    def crest_contact_radius(self) -> float:
        """Contact radius on the sharpest crest [m]: it goes with the third root of the effective radius (Hertz)."""
        return self.contact_radius / (1.0 + (self.crest if self.curved else 0.0)) ** (1.0 / 3.0)

    @property
    def width(self) -> float:
        """Contact radius over the shortest wavelength."""
        return self.contact_radius / self.shortest

    def document(self) -> dict[str, Any]:
        """Return what `thirdbody check` reports, in SI."""
        s = self.statistics
        return {
            "rms_height": s.rms_height,
            "rms_slope": s.rms_slope,
            "max_slope": s.max_slope,
            "highest": s.highest,
            "lowest": s.lowest,
            "shortest_wavelength": self.shortest,
            "largest_sphere": self.radius,
            "crest_curvature_times_radius": self.crest,
            "valley_curvature_times_radius": self.valley,
            "several_contacts": self.valley > 1.0,
            "energy_of_merging_contacts_over_load": self.merging or None,
            "contact_radius": self.contact_radius or None,
            "contact_radius_over_shortest_wavelength": self.width or None,
        }

    def warnings(self, side: str) -> list[str]:
        """Return what makes contacts on this plate doubtful, in words."""
        result, wide = [], pretty(self.contact_radius, "length")
        if self.width > NARROW:
            result.append(
                f"{side} plate: contacts have a radius of {wide}, {percent(self.width)} of the shortest wavelength "
                f"({pretty(self.shortest, 'length')}); Hertz's theory needs less than {percent(NARROW)}: give a longer one"
            )
        if (ratio := self.crest_contact_radius * self.statistics.crest_curvature) > NARROW:
            wide = pretty(self.crest_contact_radius, "length")
            result.append(
                f"{side} plate: contacts on crests have a radius of {wide}, {percent(ratio)} of that of the sharpest crest; "
                f"Hertz's theory needs less than {percent(NARROW)}"
            )
        if self.merging > NOTICED * self.shortest:
            energy = f"energy is made or lost, each time up to that of the load along {pretty(self.merging, 'length')}"
            result.append(
                f"{side} plate: curvature times the radius of the largest sphere is {self.valley:.2g} in valleys. Where two of "
                f"its contacts become one, {energy}: give a longer shortest wavelength or a lower load"
            )
        if self.statistics.max_slope > STEEP:
            text = f"{side} plate: slopes up to {self.statistics.max_slope:.2g}: does the file hold steps?"
            result.append(f"{text} Filtered, they are flanks as wide as the shortest wavelength")
        return result


def surface_scales(surfaces: Mapping[str, Surface], radius: float, overlap: float) -> dict[str, SurfaceScales]:
    """Return the scales of rough plates by side.

    `radius`: of the largest sphere [m]; `overlap`: expected on a flat plate, over the radius.
    """
    contact_radius = radius * overlap**0.5
    return {
        side: SurfaceScales(surface.statistics, radius, contact_radius, surface.shortest, surface.curvature)
        for side, surface in surfaces.items()
    }
