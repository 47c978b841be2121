"""Conversion between SI floats and quantities with units, such as "60 um" or "7850 kg/m3".

Scaling uses exact fractions and rounds once, so "60 um" is the very float 60e-6. (A unit library that multiplies floats gives
5.9999999999999995e-05, imports in a second, and reads "20 mu" as a mass.)
"""

import difflib
import math
import re
from decimal import Decimal
from fractions import Fraction

from thirdbody.dimensions import DIMENSIONS, PURE, Dimension, Powers
from thirdbody.errors import nearest

Unit = tuple[Fraction, Powers]

_PI = Fraction(Decimal("3.14159265358979323846264338327950288419716939937510582097494459"))


_PREFIXES = {
    "f": -15, "p": -12, "n": -9, "u": -6, "\N{MICRO SIGN}": -6, "\N{GREEK SMALL LETTER MU}": -6,
    "m": -3, "c": -2, "d": -1, "h": 2, "k": 3, "M": 6, "G": 9, "T": 12,
}  # fmt: skip

_PREFIXED: dict[str, Unit] = {
    "m": (Fraction(1), (1, 0, 0, 0, 0, 0)),
    "g": (Fraction(1, 1000), (0, 1, 0, 0, 0, 0)),
    "s": (Fraction(1), (0, 0, 1, 0, 0, 0)),
    "N": (Fraction(1), (1, 1, -2, 0, 0, 0)),
    "Pa": (Fraction(1), (-1, 1, -2, 0, 0, 0)),
    "bar": (Fraction(100_000), (-1, 1, -2, 0, 0, 0)),
    "J": (Fraction(1), (2, 1, -2, 0, 0, 0)),
    "W": (Fraction(1), (2, 1, -3, 0, 0, 0)),
    "Hz": (Fraction(1), (0, 0, -1, 0, 1, 0)),
    "rad": (Fraction(1), (0, 0, 0, 1, 0, 0)),
    "K": (Fraction(1), (0, 0, 0, 0, 0, 1)),
}

_PLAIN: dict[str, Unit] = {
    "min": (Fraction(60), (0, 0, 1, 0, 0, 0)),
    "h": (Fraction(3600), (0, 0, 1, 0, 0, 0)),
    "deg": (_PI / 180, (0, 0, 0, 1, 0, 0)),
    "\N{DEGREE SIGN}": (_PI / 180, (0, 0, 0, 1, 0, 0)),
    "rpm": (_PI / 30, (0, 0, -1, 1, 0, 0)),
    "angstrom": (Fraction(1, 10**10), (1, 0, 0, 0, 0, 0)),
    "%": (Fraction(1, 100), PURE),
}

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


def parse_any(text: str, dimensions: tuple[str, ...]) -> tuple[float, str]:
    """Return the SI value, and which of the dimensions the text has. Raises ValueError like `parse`."""
    wanted = [DIMENSIONS[name] for name in dimensions]
    number, unit = _split(text, wanted[0])
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
    listed = " or ".join(f"{_bare(DIMENSIONS[name].phrase)} ({', '.join(accepted_units(name))})" for name in dimensions)
    return f"{shown} has no unit, expected a unit of {listed}"


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
        Name in `thirdbody.dimensions.DIMENSIONS`.

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


def _bare(phrase: str) -> str:
    return re.sub(r"\ban? ", "", phrase)


def _split(text: str, wanted: Dimension) -> tuple[Decimal, str]:
    """Return number and unit text. Raises ValueError when the text does not begin with a number."""
    match = _NUMBER.match(text.strip())
    if len(text) > 100 or not match:
        example = f': write for example "10 {wanted.usual}"' if wanted.usual else ""
        raise ValueError(f"cannot read '{text[:40]}' as {wanted.phrase}{example}")
    unit_text = text.strip()[match.end() :]
    if unit_text.startswith(","):
        raise ValueError(f"cannot read '{text}': the decimal sign is a point, and thousands are not separated")
    return Decimal(match[0]), unit_text.strip()


def _rounded(number: Decimal, factor: Fraction, text: str) -> float:
    """Return number * factor as the nearest float. Raises ValueError outside the range of floats."""
    if number == 0:
        return float(number)
    if abs(number.adjusted()) > 400:  # bounds the exact integers below
        raise ValueError(f"'{text}' is outside the range of numbers")
    try:
        value = float(Fraction(number) * factor)
    except OverflowError:
        value = 0.0
    if value == 0.0:
        raise ValueError(f"'{text}' is outside the range of numbers")
    return value


def _product(text: str, wanted: Dimension) -> Unit:
    """Return factor and powers of a unit such as "kg/m3" or "N s/m". Raises ValueError."""
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
    """Return one unit with or without prefix. Raises ValueError with the nearest known unit."""
    if name in _PLAIN:
        return _PLAIN[name]
    if name in _PREFIXED:
        return _PREFIXED[name]
    if name[0] in _PREFIXES and name[1:] in _PREFIXED:
        factor, powers = _PREFIXED[name[1:]]
        return factor * Fraction(10) ** _PREFIXES[name[0]], powers
    raise ValueError(f"unknown unit '{name}', {nearest_unit(name, wanted)}")


def nearest_unit(name: str, wanted: Dimension) -> str:
    """Return a phrase that suggests the unit probably meant, those of the wanted dimension first."""
    own = [unit for unit, _ in wanted.ladder if unit]
    if name.lower() in _MEANT:
        return f"did you mean '{_MEANT[name.lower()]}'?"
    same_letters = [unit for unit in (*own, *_PREFIXED, *_PLAIN) if unit.lower() == name.lower()]
    close = same_letters or difflib.get_close_matches(name, own, 1, 0.5)
    if close:
        return f"did you mean '{close[0]}'?"
    return nearest(name, own or [*_PREFIXED, *_PLAIN])


def _with_prefix(number: Decimal, entry: Dimension) -> str:
    """Return the decimal number with the unit of the ladder that leaves 1 to 999 before the point."""
    unit, power = entry.si_unit, 0
    if number:
        fitting = [step for step in entry.ladder if step[1] <= number.adjusted()]
        unit, power = fitting[-1] if fitting else entry.ladder[0]
    scaled = number.scaleb(-power).normalize()
    plain = -5 <= scaled.adjusted() <= 6 and scaled.adjusted() - len(scaled.as_tuple().digits) > -20
    text = format(scaled, "f") if plain else str(scaled).lower()
    return f"{text} {unit}".strip()
