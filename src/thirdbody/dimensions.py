"""The kinds of quantities in scenes and plug-ins, and their units. Imports nothing, so every package may use it."""

from dataclasses import dataclass

# Powers of metre, kilogram, second, radian, cycle, kelvin. Radian and cycle differ from pure numbers because
# "10 Hz" as an angular velocity could mean 10 or 62.8 rad/s: that is refused instead of guessed.
Powers = tuple[int, int, int, int, int, int]

PURE: Powers = (0, 0, 0, 0, 0, 0)


@dataclass(frozen=True)
class Dimension:
    """A kind of quantity: its phrase in messages, and its units in ascending order with powers of ten."""

    phrase: str
    powers: Powers
    ladder: tuple[tuple[str, int], ...]
    usual: str
    also: tuple[Powers, ...] = ()

    @property
    def si_unit(self) -> str:
        """The unit whose factor is 1."""
        return next(unit for unit, power in self.ladder if power == 0)


def _dimension(phrase: str, powers: Powers, ladder: str, usual: str = "", *also: Powers) -> Dimension:
    """Return a dimension from a ladder such as "nm:-9 um:-6 m:0"; a blank inside a unit is written "_"."""
    steps = [step.split(":") for step in ladder.split()]
    units = tuple((unit.replace("_", " "), int(power)) for unit, power in steps)
    return Dimension(phrase, powers, units, usual or units[0][0], also)


DIMENSIONS: dict[str, Dimension] = {
    "dimensionless": Dimension("a pure number", PURE, (("", 0),), ""),
    "length": _dimension("a length", (1, 0, 0, 0, 0, 0), "pm:-12 nm:-9 um:-6 mm:-3 m:0", "um"),
    "area": _dimension("an area", (2, 0, 0, 0, 0, 0), "nm2:-18 um2:-12 mm2:-6 m2:0", "um2"),
    "volume": _dimension("a volume", (3, 0, 0, 0, 0, 0), "nm3:-27 um3:-18 mm3:-9 m3:0", "um3"),
    "time": _dimension("a time", (0, 0, 1, 0, 0, 0), "ps:-12 ns:-9 us:-6 ms:-3 s:0", "ms"),
    "mass": _dimension("a mass", (0, 1, 0, 0, 0, 0), "pg:-15 ng:-12 ug:-9 mg:-6 g:-3 kg:0", "kg"),
    "velocity": _dimension("a velocity", (1, 0, -1, 0, 0, 0), "nm/s:-9 um/s:-6 mm/s:-3 m/s:0", "m/s"),
    "acceleration": _dimension("an acceleration", (1, 0, -2, 0, 0, 0), "m/s2:0"),
    "force": _dimension("a force", (1, 1, -2, 0, 0, 0), "pN:-12 nN:-9 uN:-6 mN:-3 N:0 kN:3", "mN"),
    "pressure": _dimension("a pressure", (-1, 1, -2, 0, 0, 0), "Pa:0 kPa:3 MPa:6 GPa:9", "MPa"),
    "density": _dimension("a density", (-3, 1, 0, 0, 0, 0), "kg/m3:0"),
    "stiffness": _dimension("a stiffness", (0, 1, -2, 0, 0, 0), "mN/m:-3 N/m:0 kN/m:3 N/um:6", "N/m"),
    "energy_per_area": _dimension("an energy per area", (0, 1, -2, 0, 0, 0), "uJ/m2:-6 mJ/m2:-3 J/m2:0", "mJ/m2"),
    "damping": _dimension("a damping", (0, 1, -1, 0, 0, 0), "kg/s:0"),
    "energy": _dimension("an energy", (2, 1, -2, 0, 0, 0), "fJ:-15 pJ:-12 nJ:-9 uJ:-6 mJ:-3 J:0", "nJ"),
    "torque": _dimension("a torque", (2, 1, -2, 0, 0, 0), "pN_m:-12 nN_m:-9 uN_m:-6 mN_m:-3 N_m:0", "nN m"),
    "power": _dimension("a power", (2, 1, -3, 0, 0, 0), "pW:-12 nW:-9 uW:-6 mW:-3 W:0 kW:3", "mW"),
    "viscosity": _dimension("a viscosity", (-1, 1, -1, 0, 0, 0), "mPa_s:-3 Pa_s:0", "mPa s"),
    "inertia": _dimension("a moment of inertia", (2, 1, 0, 0, 0, 0), "kg_m2:0"),
    "rate": _dimension("a rate", (0, 0, -1, 0, 0, 0), "1/s:0", "", (0, 0, -1, 0, 1, 0)),
    "frequency": _dimension("a frequency", (0, 0, -1, 0, 1, 0), "Hz:0 kHz:3 MHz:6 GHz:9", "", (0, 0, -1, 0, 0, 0)),
    "angular_velocity": _dimension("an angular velocity", (0, 0, -1, 1, 0, 0), "rad/s:0", "", (0, 0, -1, 0, 0, 0)),
    "angle": _dimension("an angle", (0, 0, 0, 1, 0, 0), "rad:0", "deg"),
    "thermal_conductivity": _dimension("a thermal conductivity", (1, 1, -3, 0, 0, -1), "W/m/K:0"),
    "heat_capacity": _dimension("a specific heat capacity", (2, 0, -2, 0, 0, -1), "J/kg/K:0"),
    "wear_coefficient": _dimension("a wear coefficient (volume per energy)", (1, -1, 2, 0, 0, 0), "m3/J:0"),
}
