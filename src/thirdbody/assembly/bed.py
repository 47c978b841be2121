"""A bed of debris between two plates, before the run: its height, pressure and bodies, and the inertial number expected of it.

Another speed than the scene asks for: that at which the inertial number of its bed is `solver.inertial_number`.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from thirdbody import units
from thirdbody.assembly.integrator import SLOW as NEGLIGIBLE
from thirdbody.assembly.integrator import shortest_stroke
from thirdbody.assembly.physics import CompiledPhysics
from thirdbody.assembly.schedule import first_load, schedule, smallest_load
from thirdbody.engine.placed import Placed
from thirdbody.errors import InputError
from thirdbody.granular_flow import FAST, LAYERS, SLOW, friction_increase, inertial_number, median_by_mass, softness
from thirdbody.laws.contract import BodyEffect, Law
from thirdbody.laws.hertz import e_star
from thirdbody.scene.checks import ALONE, NO_BED, RESTS
from thirdbody.scene.model import Scene
from thirdbody.scene.speed import at_speed
from thirdbody.schema.parts import Location
from thirdbody.units import DIMENSIONS

KEY: Location = ("solver", "inertial_number")

SECOND = 2
"""Index of the second among the powers of a dimension."""

FARTHEST = 1e12
"""Largest factor between the two speeds, either way: beyond, one of them is a slip of the pen."""

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
    """Return the bed of a scene whose bodies meet; None without an upper plate, or where its pressure has an edge."""
    if scene.plates.upper is None or scene.plates.upper.profile is not None:
        return None
    volumes = np.array([clump.volume for clump in placed.clumps])
    diameters, solid = np.cbrt(6.0 / math.pi * volumes), float(volumes.sum())
    area, debris = scene.domain.size[0] * scene.domain.size[1], {population.material for population in scene.debris}
    median, motion, plate = median_by_mass(diameters, placed.densities * volumes), schedule(scene, 0.0), scene.plates.upper
    load = math.nan  # smallest load of the upper plate during the run [N]
    if plate.gap is None:
        patches = len(volumes) if plate.support == "load_per_particle" else 1
        load = first_load(scene) * smallest_load(motion) * patches + len(volumes) * (plate.preload or 0.0)
    return Bed(
        height=max(solid / (SOLID_FRACTION * area), median),
        pressure=load / area,
        density=float((placed.densities * volumes).sum()) / solid,
        diameter=median,
        largest_diameter=float(diameters.max()),
        modulus=min(e_star(pair.a, pair.b) for pair in choice.pairs if {pair.a.name, pair.b.name} <= debris),
        speed=motion.top_speed(),
        stroke=shortest_stroke(motion),
    )


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


class SpeedScale(NamedTuple):
    """How much faster a scene is computed than it asks for: `factor`; largest speeds of the plate [m/s] both ways.

    `inertial_number`: the estimate at the computed speed; `target`: that of the scene.
    """

    factor: float
    requested: float
    computed: float
    inertial_number: float
    target: float

    def __str__(self) -> str:
        """Return both speeds: `1 mm/s requested, computed at 84 mm/s, x84; I = 9.7e-4`."""
        requested, computed = (units.pretty(speed, "velocity") for speed in (self.requested, self.computed))
        return f"{requested} requested, computed at {computed}, x{self.factor:g}; I = {self.inertial_number:.2g}"

    def report(self) -> dict[str, Any]:
        """Return the numbers by name, and the whole as `text`."""
        return self._asdict() | {"text": str(self)}


def speed_scale(scene: Scene, choice: CompiledPhysics, bed: Bed | None) -> SpeedScale | None:
    """Return the scale of the speed that a scene asks for, None without. Raises InputError where it would change the result.

    The factor has two digits and is rounded down, so that the inertial number stays below its target.
    """
    target = scene.solver.inertial_number
    if target is None:
        return None
    if obstacle := _obstacle(scene, choice, bed):
        raise InputError(scene.fault(KEY, obstacle))
    assert bed is not None
    ratio = target / bed.inertial_number
    if not 1.0 / FARTHEST < ratio < FARTHEST:
        raise InputError(scene.fault(KEY, f"{target:g} would change the speed by a factor of {ratio:.2g}; was it intended?"))
    # two digits, rounded down; a number that misses the next by rounding errors is that one
    step = 10.0 ** (math.floor(math.log10(ratio)) - 1)
    factor = float(f"{math.floor(ratio / step * (1.0 + 1e-9)) * step:.1e}")
    scale = SpeedScale(factor, bed.speed, factor * bed.speed, factor * bed.inertial_number, target)
    if reason := _slow_plate(scene, bed, scale):
        raise InputError(scene.fault(*reason))
    return scale


def refuse_scale(scene: Scene, scale: SpeedScale | None) -> None:
    """Raise InputError for a scaled speed in the implicit integrator."""
    if scale is not None:
        raise InputError(scene.fault(KEY, f"{NO_BED}, and the implicit integrator is chosen here; {ALONE}"))


def at_computed_speed(scene: Scene, scale: SpeedScale | None) -> Scene:
    """Return the scene at the speed at which it is computed."""
    if scale is None:
        return scene
    scaled = at_speed(scene, scale.factor)
    return scaled.model_copy(update={"solver": scaled.solver.model_copy(update={"inertial_number": scale.target})})


def _obstacle(scene: Scene, choice: CompiledPhysics, bed: Bed | None) -> str:
    upper = scene.plates.upper
    if upper is None or bed is None:
        return f"{NO_BED}, and here none do; {ALONE}"
    if bed.speed == 0.0:
        return RESTS
    if upper.gap is not None:
        return "needs a pressure, and a plate at a gap has none before the run: give plates.upper.load or pressure"
    if upper.support != "rigid":
        return (
            f"is for a rigid plate: each patch of support = '{upper.support}' has a mass and a dashpot of its own, and answers "
            "in a time that the speed does not change"
        )
    if bed.layers < LAYERS:
        return (
            f"is for a bed of at least {LAYERS:g} layers, and this debris fills {bed.layers:.1f}: a plate on single bodies rises "
            "and falls with them, in a time that its mass and dashpot give, whatever the speed"
        )
    if bed.pressure == 0.0:
        return "needs a load at all times: where it falls to zero no motion is slow, and bodies fly"
    # forces, pressures and accelerations hold the second squared; a rate, a viscosity, a speed or a relaxation time does not
    parts: list[Law | BodyEffect] = [*choice.chain.laws, *choice.effects]
    timed = [part.name for part in parts if any(DIMENSIONS[option.dimension].powers[SECOND] % 2 for option in part.options)]
    return f"would change what {', '.join(timed)} does, which acts in time and not over distance" if timed else ""


def _slow_plate(scene: Scene, bed: Bed, scale: SpeedScale) -> tuple[Location, str] | None:
    upper = scene.plates.upper
    assert upper is not None
    area, load = scene.domain.size[0] * scene.domain.size[1], first_load(scene)
    rate = scale.factor * bed.shear_rate
    # time in which the load moves the plate by a diameter
    number = rate * math.sqrt((upper.mass or 0.0) * bed.diameter / (bed.pressure * area))
    if number > NEGLIGIBLE:
        return ("plates", "upper", "mass"), (
            f"the plate would follow the bed too slowly at the computed speed ({scale}): shear rate times sqrt(M d/W) is "
            f"{number:.2g}, at most {NEGLIGIBLE:g}"
        )
    fraction = (upper.damping or 0.0) * scale.computed / load
    if fraction > 1.0:
        return ("plates", "upper", "damping"), (
            f"the dashpot would carry {fraction:.2g} times the load at the computed speed ({scale}), since it acts in time: "
            "leave it out"
        )
    return None
