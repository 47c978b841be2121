"""Surfaces of the plates: a random self-affine one, waves and grooves, or a measured one from a file."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Annotated, Literal

from pydantic import WrapValidator

from thirdbody import units
from thirdbody.schema.fields import (
    Angle,
    Flag,
    PositiveLength,
    Quantity,
    Seed,
    ShortForm,
    Text,
    TwoLengths,
    TwoPositiveLengths,
    Unit,
)
from thirdbody.schema.parts import Part, Wrong, one_or_more, table_by_leading_key
from thirdbody.surfaces import grid
from thirdbody.surfaces.scan import TEXTS

Direction = Annotated[float | Literal["x", "y"], Quantity(dimension="angle", words=("x", "y"))]


class SelfAffine(Part):
    """A random self-affine surface: the power spectrum is flat from the longest wave of the domain to `long`, falls as
    q^(-2 - 2 `hurst`) to `short`, and is zero beyond (Persson et al. 2005); phases are random.
    """

    rms: PositiveLength
    """Root mean square of the height. Example: "0.2 um"."""
    hurst: Annotated[float, Quantity(gt=0, le=1)] = 0.8
    """Hurst exponent. Example: 0.7."""
    long: PositiveLength
    """Wavelength above which the spectrum is flat; at most the smaller side of the domain. Example: "20 um"."""
    short: PositiveLength
    """Shortest wavelength; shorter ones belong to the contact law. Example: "2 um"."""
    seed: Seed = 1
    """Seed of the phases; the two plates differ with the same seed. Example: 7."""
    curvature: Flag = True
    """Whether curvature of the surface changes the radius of contacts (normal law `hertz`). Example: false."""

    def checks(self) -> list[Wrong]:
        if self.short < self.long:
            return []
        return [(("short",), f"must be less than long, {units.pretty(self.long, 'length')}")]


class Sine(Part):
    """A sinusoidal wave."""

    amplitude: PositiveLength
    """Height of the crests above the mean, and depth of the valleys. Example: "0.3 um"."""
    wavelength: PositiveLength
    """Wavelength, or distance from groove to groove; the domain must hold a whole number of them. Example: "20 um"."""
    direction: Direction = "x"
    """Direction in which the height changes: an axis, or an angle from x towards y. Example: "y"."""
    phase: Angle = 0.0
    """Phase: at 0 a crest, or the middle of a groove, is at the origin. Example: "90 deg"."""

    def shortest(self) -> float:
        """Return the shortest wavelength [m]."""
        return self.wavelength


class Groove(Part):
    """A row of equal grooves with straight flanks, between lands; corners are rounded so that curvature is continuous."""

    depth: PositiveLength
    """Depth of a groove. Example: "2 um"."""
    width: PositiveLength
    """Width at the top, before rounding. Example: "8 um"."""
    flank: Annotated[float, Quantity(dimension="angle", gt=0, le=math.radians(80.0))]
    """Angle between flank and plane, at most 80 deg. Example: "40 deg"."""
    rounding: PositiveLength | None = None
    """How far a corner is rounded to either side, along the plane. By default a fifth of the length of a flank along the plane.
    Example: "0.5 um"."""
    wavelength: PositiveLength
    """Wavelength, or distance from groove to groove; the domain must hold a whole number of them. Example: "20 um"."""
    direction: Direction = "x"
    """Direction in which the height changes: an axis, or an angle from x towards y. Example: "y"."""
    phase: Angle = 0.0
    """Phase: at 0 a crest, or the middle of a groove, is at the origin. Example: "90 deg"."""

    def run(self) -> float:
        """Return the length of a flank along the plane [m]."""
        return self.depth / math.tan(self.flank)

    def corner(self) -> float:
        """Return half the length of a rounded corner [m]."""
        return 0.2 * self.run() if self.rounding is None else self.rounding

    def shortest(self) -> float:
        """Return the length over which the slope changes [m], which takes the role of a wavelength."""
        return 2.0 * self.corner()

    def checks(self) -> list[Wrong]:
        faults: list[Wrong] = []
        run, corner = units.pretty(self.run(), "length"), units.pretty(self.corner(), "length")
        if 2.0 * self.run() > self.width * (1.0 + 1e-9):
            deepest = units.pretty(0.5 * self.width * math.tan(self.flank), "length")
            faults.append((("depth",), f"the two flanks, {run} each, are wider than the groove; allowed: at most {deepest}"))
        if 2.0 * self.corner() > self.run() * (1.0 + 1e-9):
            faults.append((("rounding",), f"{corner} is more than half the flank, {run}: nothing of it would be straight"))
        if self.width + 2.0 * self.corner() > self.wavelength:
            faults.append((("wavelength",), f"a groove with its rounded corners is wider ({units.pretty(self.width, 'length')} "
                            f"and {corner} on each side): no land would be left"))  # fmt: skip
        return faults


_WAVES = one_or_more("waves", {"amplitude": Sine, "depth": Groove}, '{amplitude = "0.3 um", wavelength = "20 um"}')


class Waves(Part):
    """A sum of waves and rows of grooves."""

    wave: Annotated[tuple[Sine | Groove, ...], _WAVES, ShortForm()]
    """A wave or a row of grooves, or a list of them to add. Example: {amplitude = "0.3 um", wavelength = "20 um"}."""
    curvature: Flag = True
    """Whether curvature of the surface changes the radius of contacts (normal law `hertz`). Example: false."""


class Crop(Part):
    """The part of a measured surface that is used, from its first point."""

    x: TwoLengths | None = None
    """First and last position along this axis. Example: ["10 um", "90 um"]."""
    y: TwoLengths | None = None
    """First and last position along this axis. Example: ["10 um", "90 um"]."""

    def checks(self) -> list[Wrong]:
        ranges = (("x", self.x), ("y", self.y))
        return [((key,), "the first position must be at least 0, and below the last")
                for key, ends in ranges if ends is not None and not 0.0 <= ends[0] < ends[1]]  # fmt: skip


class SurfaceFile(Part):
    """A measured surface: NPZ, X3P (ISO 25178-72) or text, made periodic. `thirdbody surface` converts other formats."""

    file: Text
    """NPZ, X3P, CSV or TXT file, relative to the scene. Example: "scan.npz"."""
    unit: Unit | None = None
    """Unit of the heights, for CSV and TXT. Example: "um"."""
    spacing: TwoPositiveLengths | None = None
    """Distance of the points along x and y, for CSV and TXT. Example: ["0.5 um", "0.5 um"]."""
    level: Literal["mean", "plane", "curved"] | None = None
    """What is subtracted: mean, least-squares plane, or polynomial of second order. By default the plane; of a periodic map the
    mean. Example: "curved"."""
    crop: Crop | None = None
    """Part of the file that is used, in its coordinates. Example: {x = ["10 um", "90 um"]}."""
    short: PositiveLength | None = None
    """Shortest wavelength that is left; waves up to 1.5 times as long are weakened, longer ones stay as they are. By default
    four point spacings; a periodic map stays as it is. Example: "2 um"."""
    join: Literal["blend", "mirror", "periodic"] = "blend"
    """How copies meet: "blend" along a cut where they differ least, "mirror" with every second copy reversed, "periodic" for a
    periodic map, such as one of `thirdbody surface SCENE -o map.npz`. Example: "mirror"."""
    missing: Annotated[float, Quantity(ge=0, le=0.5)] = 0.05
    """Largest fraction of missing points, which are filled from their surroundings. Example: 0.1."""
    curvature: Flag = True
    """Whether curvature of the surface changes the radius of contacts (normal law `hertz`). Example: false."""

    def checks(self) -> list[Wrong]:
        text = self.file.lower().endswith(TEXTS)
        faults: list[Wrong] = [
            ((key,), f"missing, such as {example}: text names none" if text else "of CSV and TXT files only: others name it")
            for key, example in (("unit", '"um"'), ("spacing", '["0.5 um", "0.5 um"]')) if (getattr(self, key) is None) is text
        ]  # fmt: skip
        if self.join == "periodic" and self.crop is not None:
            faults.append((("crop",), 'a part of a map that is periodic is not periodic: leave it out, or join = "blend"'))
        if self.join == "periodic" and self.level not in (None, "mean"):
            faults.append((("level",), f"'{self.level}': of a map that is periodic only the mean is subtracted"))
        return faults


_SURFACES: dict[str, type[Part]] = {"rms": SelfAffine, "wave": Waves, "file": SurfaceFile}
_EXAMPLE = '{rms = "0.2 um", long = "20 um", short = "2 um"}'
_READ = WrapValidator(lambda value, handler, info: table_by_leading_key(value, info, _SURFACES, _EXAMPLE))

Surface = Annotated[SelfAffine | Waves | SurfaceFile, _READ]

SIDES = ("lower", "upper")


def faults_in_domain(surface: SelfAffine | Waves | SurfaceFile, size: tuple[float, float]) -> Iterator[Wrong]:
    """Yield faults that depend on the domain: waves that do not fit, too many points of the grid."""
    smaller = units.pretty(min(size), "length")
    if isinstance(surface, SelfAffine) and surface.long > min(size) * (1.0 + 1e-9):
        yield ("long",), f"must be at most the smaller side of the domain, {smaller}"
    if not isinstance(surface, Waves) and surface.short is not None and surface.short > min(size) / 2.0:
        yield ("short",), f"must be at most half the smaller side of the domain, {smaller}"
    waves = surface.wave if isinstance(surface, Waves) else ()
    for k, wave in enumerate(waves):
        nearest = grid.whole_waves(size, wave.wavelength, grid.angle_of(wave.direction))
        if nearest.deviation > grid.FIT:
            number: tuple[int, ...] = () if len(waves) == 1 else (k,)
            wavelength = f'wavelength = "{1e6 * nearest.wavelength:.6g} um"'
            fitting = f"{nearest.along[0]} along x and {nearest.along[1]} along y: {wavelength}"
            angle = "" if isinstance(wave.direction, str) else f', direction = "{math.degrees(nearest.angle):.6g} deg"'
            text = f"{units.pretty(wave.wavelength, 'length')} does not fit the periodic domain; nearest: {fitting}{angle}"
            yield ("wave", *number, "wavelength"), text
    counts = (1, 1) if isinstance(surface, SurfaceFile) else grid.grid_counts(size, spacing_of(surface, size))
    if math.prod(counts) > grid.MAX_POINTS:
        finest = f"a grid of {counts[1]} x {counts[0]} points, at most {grid.MAX_POINTS:.2g} in all"
        yield (), f"needs {finest}: the domain is too large for the shortest wavelength"


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
