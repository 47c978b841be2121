"""Faults of surfaces of the plates that depend on the domain: waves that do not fit, too many points of the grid."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING

from thirdbody import units
from thirdbody.scene.schema_base import Wrong
from thirdbody.scene.surfaces import Groove, SelfAffine, Sine, SurfaceFile, Waves
from thirdbody.surfaces import grid

if TYPE_CHECKING:
    from thirdbody.scene.tables import Domain, Plates, Solver

SIDES = ("lower", "upper")


def surface_faults(plates: Plates, domain: Domain) -> list[Wrong]:
    """Return the faults of the surfaces of both plates."""
    faults: list[Wrong] = []
    for side in SIDES:
        surface = getattr(getattr(plates, side), "surface", None)
        if surface is None:
            continue
        location = ("plates", side, "surface")
        if not domain.periodic:
            faults.append((location, "a surface repeats with the domain: domain.periodic must be true"))
        faults += [((*location, *where), text) for where, text in _in_domain(surface, domain.size)]
    return faults


def relax_faults(plates: Plates, solver: Solver) -> list[Wrong]:
    """Return the fault of bodies to be pushed apart between rough plates, which that does not know."""
    rough = [side for side in SIDES if getattr(getattr(plates, side), "surface", None) is not None]
    if solver.initial_overlap != "relax" or not rough:
        return []
    text = f"'relax' pushes bodies apart between flat plates only, and plates.{rough[0]}.surface is rough; "
    return [(("solver", "initial_overlap"), text + 'give positions without overlap, or placement = "layer"')]


def _in_domain(surface: SelfAffine | Waves | SurfaceFile, size: tuple[float, float]) -> Iterator[Wrong]:
    if isinstance(surface, SelfAffine):
        yield from _spectrum_faults(surface, size)
    if isinstance(surface, Waves):
        for k, wave in enumerate(surface.wave):
            yield from (((*_entry(surface, k), *where), text) for where, text in _wave_faults(wave, size))
    if isinstance(surface, SurfaceFile) and surface.short is not None:
        yield from _short_faults(surface.short, size)
    counts = grid.grid_counts(size, spacing_of(surface, size)) if not isinstance(surface, SurfaceFile) else (1, 1)
    if math.prod(counts) > grid.MAX_POINTS:
        finest = f"a grid of {counts[1]} x {counts[0]} points, at most {grid.MAX_POINTS:.2g} in all"
        yield (), f"needs {finest}: the domain is too large for the shortest wavelength"


def _entry(surface: Waves, k: int) -> tuple[str | int, ...]:
    return ("wave",) if len(surface.wave) == 1 else ("wave", k)


def _spectrum_faults(surface: SelfAffine, size: tuple[float, float]) -> Iterator[Wrong]:
    if surface.long > min(size) * (1.0 + 1e-9):
        yield ("long",), f"must be at most the smaller side of the domain, {units.pretty(min(size), 'length')}"
    yield from _short_faults(surface.short, size)


def _short_faults(short: float, size: tuple[float, float]) -> Iterator[Wrong]:
    if short > min(size) / 2.0:
        yield ("short",), f"must be at most half the smaller side of the domain, {units.pretty(min(size), 'length')}"


def _wave_faults(wave: Sine | Groove, size: tuple[float, float]) -> Iterator[Wrong]:
    nearest = grid.whole_waves(size, wave.wavelength, grid.angle_of(wave.direction))
    if nearest.deviation > grid.FIT:
        fitting = f'{nearest.along[0]} along x and {nearest.along[1]} along y: wavelength = "{1e6 * nearest.wavelength:.6g} um"'
        angle = "" if isinstance(wave.direction, str) else f', direction = "{math.degrees(nearest.angle):.6g} deg"'
        yield (
            ("wavelength",),
            f"{units.pretty(wave.wavelength, 'length')} does not fit the periodic domain; nearest: {fitting}{angle}",
        )


def spacing_of(surface: SelfAffine | Waves, size: tuple[float, float]) -> tuple[float, float]:
    """Return the largest spacing of grid points along x and y that the surface allows [m]."""
    if isinstance(surface, SelfAffine):
        return (surface.short / grid.POINTS_PER_WAVE,) * 2
    spacing = [math.inf, math.inf]
    for wave in surface.wave:
        waves = grid.whole_waves(size, wave.wavelength, grid.angle_of(wave.direction)).along
        step = wave.wavelength / grid.POINTS_PER_SINE if isinstance(wave, Sine) else wave.corner() / grid.POINTS_PER_CORNER
        for axis in (0, 1):
            part = abs(waves[axis]) * wave.wavelength / size[axis]  # cosine of the angle to the axis
            spacing[axis] = min(spacing[axis], step / part if part > 0.0 else math.inf)
    return spacing[0], spacing[1]
