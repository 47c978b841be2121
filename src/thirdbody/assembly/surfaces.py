"""From the surfaces of a scene to heights on grids, and their scales against the debris: does Hertz's theory hold, do spheres
touch at several points?"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any

from thirdbody.assembly.physics import CompiledPhysics
from thirdbody.assembly.schedule import schedule
from thirdbody.engine.state import World
from thirdbody.errors import Fault, InputError
from thirdbody.laws.contract import Law
from thirdbody.laws.hertz import HERTZ
from thirdbody.scene.model import Scene
from thirdbody.scene.surfaces import SIDES, Groove, SelfAffine, Sine, SurfaceFile, Waves, spacing_of
from thirdbody.schema.parts import key_location
from thirdbody.surfaces import grid
from thirdbody.surfaces.grid import groove_heights, phases, self_affine, sine_heights
from thirdbody.surfaces.reading import read_scan
from thirdbody.surfaces.scan import ScanOptions, periodic_scan
from thirdbody.surfaces.statistics import Statistics
from thirdbody.surfaces.surface import Surface, about_mean_plane
from thirdbody.surfaces.wear import flat_surface
from thirdbody.units import percent, pretty

Size = tuple[float, float]

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


def plate_surfaces(scene: Scene) -> dict[str, Surface]:
    """Return the surfaces of the plates that have one, "lower" and "upper". Raises InputError with all faults of their files."""
    surfaces, faults = {}, list[Fault]()
    for side in SIDES:
        given = getattr(getattr(scene.plates, side), "surface", None)
        if given is None:
            continue
        try:
            surfaces[side] = _surface(scene, given, SIDES.index(side))
        except InputError as error:
            for fault in error.faults:
                key = fault.key if fault.key.partition(".")[0] in type(given).model_fields else "file"
                text = fault.message if key == fault.key else str(fault._replace(file=None))
                message = f"{fault.file}: {text}" if fault.file else text
                faults.append(scene.fault(("plates", side, "surface", *key_location(key)), message))
    if faults:
        raise InputError(faults)
    return surfaces


def with_flat_surfaces(scene: Scene, surfaces: Mapping[str, Surface], choice: CompiledPhysics) -> dict[str, Surface]:
    """Return the surfaces of the plates, of both where wear changes them: one of zero height for a flat plate, whose curvature
    changes contacts where the laws know it. Raises InputError for a curvature that they do not know (`refuse_curvature`), and
    where wear counts cycles that the motion does not have."""
    measures, wear = choice.physics.measures, scene.plates.wear
    refuse_curvature(scene, surfaces, choice.chain.laws)
    if wear is None or measures is None:
        return dict(surfaces)
    if wear.cycles is not None and not schedule(scene, 0.0).closed_paths():
        message = "the motion of the upper plate does not come back: give distance instead"
        raise InputError(scene.fault(("plates", "wear", "cycles"), message))
    flat = flat_surface(scene.domain.size, measures.cells, not flat_laws(choice.chain.laws))
    return {side: surfaces.get(side, flat) for side in SIDES}


def flat_laws(laws: Iterable[Law]) -> list[str]:
    """Return the names of laws with which contacts cannot know the curvature of plates (`refuse_curvature`)."""
    return [law.name for law in laws if law.stage == "adhesion" or (law.stage == "normal" and law.name != HERTZ.name)]


def refuse_curvature(scene: Scene, surfaces: Mapping[str, Surface], laws: Iterable[Law]) -> None:
    """Raise InputError where the curvature of a surface is to enter contacts whose normal force is not that of Hertz alone.

    The force that comes from the changing effective radius is known for Hertz' energy (`contact_geometry.add_gradient_force`).
    """
    others = flat_laws(laws)
    curved = [side for side, surface in surfaces.items() if surface.curvature]
    if others and curved:
        message = f"not with {', '.join(others)}: only the normal law hertz, without adhesion, knows curved plates; give false"
        raise InputError(scene.fault(("plates", side, "surface", "curvature"), message) for side in curved)


def with_surfaces(world: World, surfaces: Mapping[str, Surface]) -> World:
    """Return the world with these surfaces of its plates, copies that wear may change."""
    lower, upper = (surfaces.get(side) for side in SIDES)
    return replace(
        world, lower_surface=None if lower is None else lower.packed.copy(),
        upper_surface=None if upper is None else upper.packed.copy(),
        curved=(lower is None or lower.curvature, upper is None or upper.curvature),
    )  # fmt: skip


def _surface(scene: Scene, given: SelfAffine | Waves | SurfaceFile, stream: int) -> Surface:
    size = scene.domain.size
    if isinstance(given, SurfaceFile):
        crop = (given.crop.x, given.crop.y) if given.crop else (None, None)
        options = ScanOptions(given.level or "plane", crop, given.short, given.join, given.missing)
        scan = read_scan(scene.beside(given.file), "file", given.unit, given.spacing)
        return replace(periodic_scan(scan, size, options), curvature=given.curvature)
    shape = grid.grid_counts(size, spacing_of(given, size))
    if isinstance(given, SelfAffine):
        heights = self_affine(shape, size, given.rms, given.hurst, given.long, given.short, given.seed, stream)
        return Surface(heights, size, given.short, given.curvature)
    heights = about_mean_plane(sum(_wave_heights(wave, shape, size) for wave in given.wave))
    return Surface(heights, size, min(wave.shortest() for wave in given.wave), given.curvature)


def _wave_heights(wave: Sine | Groove, shape: tuple[int, int], size: Size):
    waves = grid.whole_waves(size, wave.wavelength, grid.angle_of(wave.direction))
    phase = phases(shape, waves.along, wave.phase)
    if isinstance(wave, Sine):
        return sine_heights(phase, wave.amplitude)
    return groove_heights(phase, wave.depth, wave.width, wave.run(), wave.corner(), waves.wavelength)


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
