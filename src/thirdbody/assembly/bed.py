"""A bed of debris between two plates, before the run: its height, pressure and bodies, and the inertial number expected of it."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from thirdbody import units
from thirdbody.assembly.inertial_number import shortest_stroke
from thirdbody.assembly.physics import CompiledPhysics
from thirdbody.assembly.schedule import first_load, schedule
from thirdbody.engine.placed import Placed
from thirdbody.engine.upper_plate import Axis, ends_of
from thirdbody.granular_flow import FAST, LAYERS, SLOW, friction_increase, inertial_number, median_by_mass, softness
from thirdbody.laws.hertz import e_star
from thirdbody.scene.model import Scene

SOLID_FRACTION = 0.6
"""Solid fraction that is expected of a settled bed: 0.58 to 0.64 for spheres and compact clumps."""

SHEAR_ZONE = 10.0
"""Height over the median diameter up to which a whole bed is taken to shear.

Shear zones at a wall are 5 to 10 diameters thick (GDR MiDi, Eur. Phys. J. E 14, 2004, 341); a lower bed flows throughout.
"""


class Bed(NamedTuple):
    """Bed of debris between two plates, SI: `height` when settled, mean `density` of the bodies, smallest E* of two of them.

    `pressure`: the smallest of the run; NaN where the plate is held at a gap. `diameter` and `largest_diameter`: the median, by
    mass, and the largest of the volume-equivalent diameters. `speed`, `stroke`: largest speed of the plate, and its shortest
    stroke, infinite without one.
    """

    height: float
    pressure: float
    density: float
    diameter: float
    largest_diameter: float
    modulus: float
    speed: float
    stroke: float

    @property
    def layers(self) -> float:
        """Height over the median diameter."""
        return self.height / self.diameter

    @property
    def shear_rate(self) -> float:
        """Shear rate [1/s]: the plate's speed over the height that shears, or over the stroke if that is shorter.

        A plate that turns back changes the shear rate of the whole bed within the time of a stroke, which bodies must follow too.
        """
        return self.speed / min(self.height, SHEAR_ZONE * self.diameter, self.stroke)

    @property
    def inertial_number(self) -> float:
        """Inertial number of the median diameter; 0 at rest, NaN at a held gap."""
        return inertial_number(self.shear_rate, self.diameter, self.density, self.pressure) if self.speed > 0.0 else 0.0

    @property
    def softness(self) -> float:
        """Softness kappa; NaN at a held gap."""
        return softness(self.modulus, self.pressure)


def bed_of(scene: Scene, choice: CompiledPhysics, placed: Placed) -> Bed | None:
    """Return the bed of a scene whose bodies meet; None without an upper plate."""
    if scene.plates.upper is None:
        return None
    volumes = np.array([clump.volume for clump in placed.clumps])
    diameters, solid = np.cbrt(6.0 / math.pi * volumes), float(volumes.sum())
    area = scene.domain.size[0] * scene.domain.size[1]
    median, plate = median_by_mass(diameters, placed.densities * volumes), schedule(scene, 0.0)
    return Bed(
        height=max(solid / (SOLID_FRACTION * area), median),
        pressure=_smallest_load(scene, len(volumes), plate.load) / area,
        density=float((placed.densities * volumes).sum()) / solid,
        diameter=median,
        largest_diameter=float(diameters.max()),
        modulus=_modulus(scene, choice),
        speed=plate.top_speed(),
        stroke=shortest_stroke(plate),
    )


def _smallest_load(scene: Scene, bodies: int, loads: Axis) -> float:
    """Return the smallest load of the upper plate during the run [N]; NaN where its gap is held."""
    upper = scene.plates.upper
    assert upper is not None
    if upper.gap is not None:
        return math.nan
    smallest = min((min(piece.value(piece.start), piece.value(end)) for piece, end in ends_of(loads)), default=1.0)
    patches = bodies if upper.support == "load_per_particle" else 1
    return first_load(scene) * smallest * patches + bodies * (upper.preload or 0.0)


def _modulus(scene: Scene, choice: CompiledPhysics) -> float:
    """Return the smallest E* of two bodies that can meet [Pa]."""
    debris = {population.material for population in scene.debris}
    return min(e_star(pair.a, pair.b) for pair in choice.pairs if {pair.a.name, pair.b.name} <= debris)


def fast_bed_warnings(scene: Scene, bed: Bed) -> list[str]:
    """Return a warning of a bed that is sheared too fast to be called slow, with the speed that would be slow enough."""
    number = bed.inertial_number
    if scene.solver.inertial_number is not None or bed.layers < LAYERS or not FAST < number < math.inf:
        return []
    slower = number / SLOW
    return [
        f"this bed is not quasi-static: its inertial number is about {number:.2g}, and its friction about "
        f"{friction_increase(number):.1g} above that of slow shear; solver.inertial_number = {SLOW:g} would run at "
        f"{units.pretty(bed.speed / slower, 'velocity')}, in {slower:.2g} times as many steps"
    ]
