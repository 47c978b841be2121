"""From the surfaces of a scene to heights on grids."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace

from thirdbody.engine.state import World
from thirdbody.errors import Fault, InputError
from thirdbody.laws.contract import Law
from thirdbody.laws.hertz import HERTZ
from thirdbody.scene.model import Scene
from thirdbody.scene.schema_base import key_location
from thirdbody.scene.surface_checks import SIDES, spacing_of
from thirdbody.scene.surfaces import Groove, SelfAffine, Sine, SurfaceFile, Waves
from thirdbody.surfaces import grid
from thirdbody.surfaces.periodic_scan import ScanOptions, periodic_scan
from thirdbody.surfaces.read_scan import read_scan
from thirdbody.surfaces.self_affine import Spectrum, self_affine
from thirdbody.surfaces.surface import Surface, about_mean_plane
from thirdbody.surfaces.waves import GrooveProfile, groove_heights, phases, sine_heights

Size = tuple[float, float]


def plate_surfaces(scene: Scene) -> dict[str, Surface]:
    """Return the surfaces of the plates that have one, "lower" and "upper". Raises InputError with all faults of their files."""
    surfaces, faults = {}, list[Fault]()
    for side in SIDES:
        given = getattr(getattr(scene.plates, side), "surface", None)
        if given is None:
            continue
        try:
            with _faults_of(scene, side):
                surfaces[side] = _surface(scene, given, SIDES.index(side))
        except InputError as error:
            faults += error.faults
    if faults:
        raise InputError(faults)
    return surfaces


def refuse_curvature(scene: Scene, surfaces: Mapping[str, Surface], laws: Iterable[Law]) -> None:
    """Raise InputError where the curvature of a surface is to enter contacts whose normal force is not that of Hertz alone.

    The force that comes from the changing effective radius is known for Hertz' energy (`contact_geometry.add_gradient_force`).
    """
    others = [law.name for law in laws if law.stage == "adhesion" or (law.stage == "normal" and law.name != HERTZ.name)]
    curved = [side for side, surface in surfaces.items() if surface.curvature]
    if others and curved:
        message = f"not with {', '.join(others)}: only the normal law hertz, without adhesion, knows curved plates; give false"
        raise InputError(scene.fault(("plates", side, "surface", "curvature"), message) for side in curved)


def with_surfaces(world: World, surfaces: Mapping[str, Surface]) -> World:
    """Return the world with these surfaces of its plates."""
    lower, upper = (surfaces.get(side) for side in SIDES)
    return replace(
        world, lower_surface=None if lower is None else lower.packed, upper_surface=None if upper is None else upper.packed,
        curved=(lower is None or lower.curvature, upper is None or upper.curvature),
    )  # fmt: skip


def surface_notes(surfaces: Mapping[str, Surface]) -> list[str]:
    """Return what was done to the measured surfaces, in words."""
    return [f"{side} plate: {note}" for side, surface in surfaces.items() for note in surface.notes]


def _surface(scene: Scene, given: SelfAffine | Waves | SurfaceFile, stream: int) -> Surface:
    size = scene.domain.size
    if isinstance(given, SurfaceFile):
        return replace(_measured(scene, given), curvature=given.curvature)
    shape = grid.grid_counts(size, spacing_of(given, size))
    if isinstance(given, SelfAffine):
        spectrum = Spectrum(given.rms, given.hurst, given.long, given.short)
        return Surface(self_affine(shape, size, spectrum, given.seed, stream), size, given.short, given.curvature)
    heights = about_mean_plane(sum(_wave_heights(wave, shape, size) for wave in given.wave))
    return Surface(heights, size, min(wave.shortest() for wave in given.wave), given.curvature)


def _wave_heights(wave: Sine | Groove, shape: tuple[int, int], size: Size):
    waves = grid.whole_waves(size, wave.wavelength, grid.angle_of(wave.direction))
    phase = phases(shape, waves.along, wave.phase)
    if isinstance(wave, Sine):
        return sine_heights(phase, wave.amplitude)
    return groove_heights(phase, GrooveProfile(wave.depth, wave.width, wave.run(), wave.corner(), waves.wavelength))


def _measured(scene: Scene, given: SurfaceFile) -> Surface:
    crop = (given.crop.x, given.crop.y) if given.crop else (None, None)
    options = ScanOptions(given.level or "plane", crop, given.short, given.join, given.missing)
    scan = read_scan(scene.beside(given.file), "file", given.unit, given.spacing)
    return periodic_scan(scan, scene.domain.size, options)


@contextmanager
def _faults_of(scene: Scene, side: str) -> Iterator[None]:
    """Give the faults of a file their place in the scene."""
    try:
        yield
    except InputError as error:
        keys = type(getattr(scene.plates, side).surface).model_fields
        raise InputError(_at(scene, side, keys, fault) for fault in error.faults) from None


def _at(scene: Scene, side: str, keys: Mapping[str, object], fault: Fault) -> Fault:
    """Return a fault at the key of the scene that it is about, or at the name of the file."""
    key = fault.key if fault.key.partition(".")[0] in keys else "file"
    text = fault.message if key == fault.key else str(replace(fault, file=None))
    message = f"{fault.file}: {text}" if fault.file else text
    return scene.fault(("plates", side, "surface", *key_location(key)), message)
