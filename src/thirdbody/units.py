"""Quantities with units: the dimensions, reading of "60 um" or "7850 kg/m3" into SI floats, and writing with prefixes.

Scaling uses exact fractions and rounds once, so "60 um" is the very float 60e-6. (A unit library that multiplies floats gives
5.9999999999999995e-05, imports in a second, and reads "20 mu" as a mass.)
"""

from __future__ import annotations

import difflib
import math
import re
from contextlib import suppress
from dataclasses import dataclass
from decimal import Decimal
from fractions import Fraction
from typing import TYPE_CHECKING

from thirdbody.errors import nearest

if TYPE_CHECKING:
    import numpy as np

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
    "line_load": _dimension("a load per length", (0, 1, -2, 0, 0, 0), "mN/m:-3 N/m:0 kN/m:3", "N/m"),
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

Unit = tuple[Fraction, Powers]

_PI = Fraction(Decimal("3.14159265358979323846264338327950288419716939937510582097494459"))


_PREFIXES = {
    "f": -15, "p": -12, "n": -9, "u": -6, "\N{MICRO SIGN}": -6, "\N{GREEK SMALL LETTER MU}": -6,
    "m": -3, "c": -2, "d": -1, "h": 2, "k": 3, "M": 6, "G": 9, "T": 12,
}  # fmt: skip

_PREFIXED: dict[str, Unit] = {
    "m": (Fraction(1), (1, 0, 0, 0, 0, 0)), "g": (Fraction(1, 1000), (0, 1, 0, 0, 0, 0)), "s": (Fraction(1), (0, 0, 1, 0, 0, 0)),
    "N": (Fraction(1), (1, 1, -2, 0, 0, 0)), "J": (Fraction(1), (2, 1, -2, 0, 0, 0)), "W": (Fraction(1), (2, 1, -3, 0, 0, 0)),
    "Pa": (Fraction(1), (-1, 1, -2, 0, 0, 0)), "bar": (Fraction(100_000), (-1, 1, -2, 0, 0, 0)),
    "Hz": (Fraction(1), (0, 0, -1, 0, 1, 0)), "rad": (Fraction(1), (0, 0, 0, 1, 0, 0)), "K": (Fraction(1), (0, 0, 0, 0, 0, 1)),
}  # fmt: skip

_PLAIN: dict[str, Unit] = {
    "min": (Fraction(60), (0, 0, 1, 0, 0, 0)), "h": (Fraction(3600), (0, 0, 1, 0, 0, 0)),
    "deg": (_PI / 180, (0, 0, 0, 1, 0, 0)), "\N{DEGREE SIGN}": (_PI / 180, (0, 0, 0, 1, 0, 0)),
    "rpm": (_PI / 30, (0, 0, -1, 1, 0, 0)), "angstrom": (Fraction(1, 10**10), (1, 0, 0, 0, 0, 0)), "%": (Fraction(1, 100), PURE),
}  # fmt: skip

# Similar in meaning, not in spelling, so difflib cannot match them.
_MEANT = {
    "mu": "um", "micron": "um", "microns": "um", "micrometer": "um", "micrometre": "um", "meter": "m",
    "metre": "m", "sec": "s", "second": "s", "seconds": "s", "newton": "N", "pascal": "Pa", "joule": "J",
    "hertz": "Hz", "degree": "deg", "degrees": "deg", "psi": "kPa", "inch": "mm", "in": "mm",
}  # fmt: skip

_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?")
_FACTOR = re.compile(r"\s*([*·⋅×/]?)\s*([^\W\d_]+|%|°)(?:(?:\^|\*\*)?([+-]?\d)(?!\d))?")
_HIGH = str.maketrans("⁻¹²³⁴⁵⁶⁷⁸⁹", "-123456789")


def parse(text: str, dimension: str) -> float:
    """Return the SI value of a quantity such as "60 um", correctly rounded.

    `dimension` is a key of DIMENSIONS. Raises ValueError, with the unit that was probably meant, when the text is no quantity,
    has no unit, or is a quantity of another dimension.
    """
    return parse_any(text, (dimension,))[0]


def parse_unit(text: str) -> float:
    """Return a unit of length [m] that is named, such as "um", or a length, such as "0.5 um". Raises ValueError like `parse`."""
    return parse(text if text.strip()[:1] in "+-.0123456789" else f"1 {text}", "length")


def parse_any(text: str, dimensions: tuple[str, ...]) -> tuple[float, str]:
    """Return the SI value, and which of the dimensions the text has. Raises ValueError like `parse`."""
    wanted = [DIMENSIONS[name] for name in dimensions]
    match = _NUMBER.match(text.strip())
    if len(text) > 100 or not match:
        example = f': write for example "10 {wanted[0].usual}"' if wanted[0].usual else ""
        raise ValueError(f"cannot read '{text[:40]}' as {wanted[0].phrase}{example}")
    number, unit = Decimal(match[0]), text.strip()[match.end() :].strip()
    if unit.startswith(","):
        raise ValueError(f"cannot read '{text}': the decimal sign is a point, and thousands are not separated")
    if not unit and "dimensionless" not in dimensions:
        raise ValueError(without_unit(text.strip(), dimensions))
    factor, powers = _product(unit, wanted[0])
    for name, entry in zip(dimensions, wanted, strict=True):
        if powers == entry.powers or powers in entry.also:
            return _rounded(number, factor, text), name
    result = " or ".join(entry.phrase for entry in DIMENSIONS.values() if entry.powers == powers)
    expected = " or ".join(entry.phrase for entry in wanted)
    raise ValueError(f"'{text}' is {result or 'a quantity in ' + unit}, expected {expected}")


def without_unit(shown: str, dimensions: tuple[str, ...]) -> str:
    """Return the message about a number without a unit: the accepted units, and no guess of the intended value."""
    shown = shown if len(shown) <= 60 else f"{shown[:57]}..."
    listed = " or ".join(f"{DIMENSIONS[name].phrase} ({', '.join(accepted_units(name))})" for name in dimensions)
    return f"{shown} has no unit, expected a unit of " + re.sub(r"\ban? ", "", listed)


def accepted_units(dimension: str) -> list[str]:
    """Return the units named in messages: those of the ladder, and those without prefixes such as min, h and deg."""
    entry = DIMENSIONS[dimension]
    other = [name for name, (_, powers) in _PLAIN.items() if powers == entry.powers and name.isascii()]
    return [*(unit for unit, _ in entry.ladder if unit), *other]


def format_si(value: float, dimension: str) -> str:
    """Return the value with its unit; `parse` gives the same float bit for bit. Raises ValueError for NaN, infinity."""
    if not math.isfinite(value):
        raise ValueError(f"{value} cannot be written as {DIMENSIONS[dimension].phrase}")
    # Moving the decimal point of the shortest repr is exact, so a readable prefix costs no accuracy.
    return _with_prefix(Decimal(repr(float(value))), DIMENSIONS[dimension])


def pretty(value: float, dimension: str) -> str:
    """Return a quantity for messages: three significant digits and a prefix.

    Parameters
    ----------
    value : float
        In SI.
    dimension : str
        Name in `thirdbody.units.DIMENSIONS`.

    Returns
    -------
    str

    Examples
    --------
    >>> plugin.pretty(1.234e-8, "length")
    '12.3 nm'
    """
    entry = DIMENSIONS[dimension]
    if not math.isfinite(value):
        return f"{value} {entry.si_unit}".strip()
    return _with_prefix(Decimal(f"{value:.3g}"), entry)


_REACH = {"length": 1e30, "dimensionless": 1e60}


def refuse_absurd(value: float, dimension: str, shown: str) -> None:
    """Raise ValueError for a number (SI) that only a wrong unit explains, and whose powers and products overflow a float.

    Lengths other than 0 lie between 1e-30 and 1e30 m (fifth powers, and the squares of these, are normal numbers), all other
    quantities between 1e-60 and 1e60 in SI; pure numbers may be arbitrarily small.
    """
    maximum = _REACH.get(dimension, 1e60)
    small = dimension != "dimensionless" and 0.0 < abs(value) < 1.0 / maximum
    if small or abs(value) > maximum:
        unit = f" {DIMENSIONS[dimension].si_unit}".rstrip()
        minimum = "at most" if dimension == "dimensionless" else f"between {1.0 / maximum:g} and"
        raise ValueError(f"{shown} must be {minimum} {maximum:g}{unit} in size" + ("; is the unit right?" if unit else ""))


def _rounded(number: Decimal, factor: Fraction, text: str) -> float:
    value = 0.0
    if number == 0:
        return float(number)  # with its sign
    if abs(number.adjusted()) <= 400:  # bounds the exact integers
        with suppress(OverflowError):
            value = float(Fraction(number) * factor)
    if value == 0.0:
        raise ValueError(f"'{text}' is outside the range of numbers")
    return value


def _product(text: str, wanted: Dimension) -> Unit:
    factor, powers, divided, at = Fraction(1), PURE, False, 0
    plain = re.sub(r"^1\s*(?=/)", "", text.translate(_HIGH))
    while at < len(plain):
        match = _FACTOR.match(plain, at)
        if match is None or (not at and match[1] not in ("", "/")):
            raise ValueError(f"cannot read the unit '{text}'")
        if divided and not match[1]:
            raise ValueError(f"the unit '{text}' can be read in two ways: write / before each unit to divide by")
        unit, own = _symbol(match[2], wanted)
        power = int(match[3] or 1) * (-1 if match[1] == "/" else 1)
        a, b, c, d, e, f = (x + power * y for x, y in zip(powers, own, strict=True))
        factor, powers, divided, at = factor * unit**power, (a, b, c, d, e, f), divided or match[1] == "/", match.end()
    return factor, powers


def _symbol(name: str, wanted: Dimension) -> Unit:
    if name in _PLAIN:
        return _PLAIN[name]
    if name in _PREFIXED:
        return _PREFIXED[name]
    if name[0] in _PREFIXES and name[1:] in _PREFIXED:
        factor, powers = _PREFIXED[name[1:]]
        return factor * Fraction(10) ** _PREFIXES[name[0]], powers
    own = [unit for unit, _ in wanted.ladder if unit]
    close = [_MEANT[name.lower()]] if name.lower() in _MEANT else []
    close += [unit for unit in (*own, *_PREFIXED, *_PLAIN) if unit.lower() == name.lower()]
    close += difflib.get_close_matches(name, own, 1, 0.5)
    hint = f"did you mean '{close[0]}'?" if close else nearest(name, own or [*_PREFIXED, *_PLAIN])
    raise ValueError(f"unknown unit '{name}', {hint}")


def _with_prefix(number: Decimal, entry: Dimension) -> str:
    unit, power = entry.si_unit, 0
    if number:
        fitting = [step for step in entry.ladder if step[1] <= number.adjusted()]
        unit, power = fitting[-1] if fitting else entry.ladder[0]
    scaled = number.scaleb(-power).normalize()
    plain = -5 <= scaled.adjusted() <= 6 and scaled.adjusted() - len(scaled.as_tuple().digits) > -20
    text = format(scaled, "f") if plain else str(scaled).lower()
    return f"{text} {unit}".strip()


# -- formatting for tables and pictures --

PREFIXES = (
    (1e9, "G"), (1e6, "M"), (1e3, "k"), (1.0, ""), (1e-3, "m"), (1e-6, "\N{MICRO SIGN}"), (1e-9, "n"), (1e-12, "p"),
    (1e-15, "f"), (1e-18, "a"),
)  # fmt: skip
MINUS, GLUE = "\N{MINUS SIGN}", "\N{NO-BREAK SPACE}"
"""Minus sign, and the no-break space between a number and its unit."""


def unit_for(values: np.ndarray, unit: str) -> tuple[float, str]:
    """Return factor and name of the prefixed unit in which the largest of SI values (n,) is 1 to 1000."""
    import numpy as np

    factor, prefix = _prefix(float(np.abs(values[np.isfinite(values)]).max(initial=0.0)))
    return factor, prefix + unit


def quantity_text(value: float, unit: str, digits: int = 3) -> str:
    """Format a quantity in SI: 4.19e-8 of J as `41.9 nJ`; a pure number without unit; NaN as `unknown`."""
    import numpy as np

    if not math.isfinite(value):
        return "unknown"
    value = float(f"{value:.{digits - 1}e}")
    if 0.0 < abs(value) < PREFIXES[-1][0]:
        return f"{value:.{digits - 1}e}{GLUE}{unit}".replace("-", MINUS)
    factor, prefix = _prefix(abs(value)) if unit else (1.0, "")
    # never 6e+02 for 600
    number = np.format_float_positional(value / factor, precision=digits, fractional=False, trim="-")
    return f"{number}{GLUE}{prefix}{unit}".strip().replace("-", MINUS)


def with_unit(value: float, unit: str, digits: int = 3) -> str:
    """Format a quantity like `quantity_text`, with a plain blank: 1.25e-05, "m" -> "12.5 µm"."""
    return quantity_text(value, unit, digits).replace(GLUE, " ")


def with_error(value: float, error: float) -> str:
    """Format a pure number with its error, to two digits of the error; three decimals without one."""
    if not math.isfinite(error):
        return f"{value:z.3f}".replace("-", MINUS)
    if error < 5e-7:
        return f"{value:z.4f} (error below 1e{MINUS}6)".replace("-", MINUS)
    decimals = max(1 - math.floor(math.log10(error)), 0)
    return f"{value:z.{decimals}f} \N{PLUS-MINUS SIGN} {error:.{decimals}f}".replace("-", MINUS)


def percent(fraction: float) -> str:
    """Format a fraction from 0 to 1: `41 %`; with a decimal below 1 % and above 99 %."""
    value = 100.0 * fraction
    near = 0.0 < value < 1.0 or 99.0 < value < 100.0
    return f"{value:.1f}{GLUE}%" if near else f"{value:.0f}{GLUE}%"


def _prefix(size: float) -> tuple[float, str]:
    if size == 0.0:
        return 1.0, ""
    return next((entry for entry in PREFIXES if size >= entry[0] * (1.0 - 1e-12)), PREFIXES[-1])


def prefix_for(size: float, unit: str) -> tuple[float, str]:
    """Return factor and prefixed unit for a number of this size: 3e-5, "m" -> 1e6, "µm".

    Masses are in grams, and a number without unit stays unchanged.
    """
    if not unit or unit == "1":
        return 1.0, ""
    base, written = (1e3, "g") if unit == "kg" else (1.0, unit)
    scale, prefix = _prefix(abs(size) * base) if math.isfinite(size) else (1.0, "")
    return base / scale, prefix + written


def round_length(longest: float) -> float:
    """Return the largest of 1, 2, 5 times a power of ten that is at most `longest`."""
    power = 10.0 ** math.floor(math.log10(longest))
    return max(step * power for step in (1.0, 2.0, 5.0) if step * power <= longest * (1.0 + 1e-9))


def ticks(low: float, high: float) -> list[float]:
    """Return three to seven round numbers from `low` to `high`, or the one value if both are equal."""
    if not high > low:
        return [low]
    step = round_length((high - low) / 3.0)
    first, last = math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9)
    return [number * step for number in range(first, last + 1)]


_TIMES = ((365.25 * 86400.0, "years"), (86400.0, "days"), (3600.0, "h"), (60.0, "min"), (1.0, "s"))
_SIZES = ((1e12, "TB"), (1e9, "GB"), (1e6, "MB"), (1e3, "kB"), (1.0, "bytes"))


def duration(seconds: float) -> str:
    """Format a duration with its unit: s, min, h, days, years; two figures from a minute on, since it is an estimate."""
    if not math.isfinite(seconds):
        return "unknown" if math.isnan(seconds) else "for ever"
    return f"{seconds:.3g} s" if seconds < 60.0 else _scaled(seconds, _TIMES)


def file_size(count: float) -> str:
    """Format a number of bytes with its unit, powers of 1000, two figures."""
    return _scaled(count, _SIZES)


def _scaled(value: float, units: tuple[tuple[float, str], ...]) -> str:
    scale, unit = next((entry for entry in units if value >= entry[0]), units[-1])
    shown = float(f"{value / scale:.2g}")
    return f"{shown:,.0f} {unit}" if shown >= 10.0 else f"{shown:g} {unit}"
