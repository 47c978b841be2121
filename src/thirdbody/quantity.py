"""Formatting of numbers: readable units, SI prefixes, errors, durations and file sizes."""

import math

import numpy as np

PREFIXES = (
    (1e9, "G"), (1e6, "M"), (1e3, "k"), (1.0, ""), (1e-3, "m"), (1e-6, "\N{MICRO SIGN}"), (1e-9, "n"), (1e-12, "p"),
    (1e-15, "f"), (1e-18, "a"),
)  # fmt: skip
MINUS, GLUE = "\N{MINUS SIGN}", "\N{NO-BREAK SPACE}"
"""Minus sign, and the no-break space between a number and its unit."""


def scale_values(values: np.ndarray, unit: str) -> tuple[np.ndarray, str]:
    """Return SI values (n,) in the prefixed unit that makes the largest 1 to 1000, and that unit."""
    factor, name = unit_for(values, unit)
    return values / factor, name


def unit_for(values: np.ndarray, unit: str) -> tuple[float, str]:
    """Return factor and name of the unit of `scale_values`."""
    factor, prefix = _prefix(float(np.abs(values[np.isfinite(values)]).max(initial=0.0)))
    return factor, prefix + unit


def quantity_text(value: float, unit: str, digits: int = 3) -> str:
    """Format a quantity in SI: 4.19e-8 of J as `41.9 nJ`; a pure number without unit; NaN as `unknown`."""
    if not math.isfinite(value):
        return "unknown"
    value = float(f"{value:.{digits - 1}e}")
    if 0.0 < abs(value) < PREFIXES[-1][0]:
        return f"{value:.{digits - 1}e}{GLUE}{unit}".replace("-", MINUS)
    factor, prefix = _prefix(abs(value)) if unit else (1.0, "")
    # never 6e+02 for 600
    number = np.format_float_positional(value / factor, precision=digits, fractional=False, trim="-")
    return f"{number}{GLUE}{prefix}{unit}".strip().replace("-", MINUS)


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


def with_unit(value: float, unit: str) -> str:
    """Format a number with three figures and an SI prefix: 1.25e-05, "m" -> "12.5 µm"."""
    value = float(value)
    if value == 0.0 or not math.isfinite(value):
        return f"{value:g} {unit}"
    rounded = float(f"{value:.2e}")
    factor, written = prefix_for(rounded, unit)
    return f"{rounded * factor:.3g} {written}"


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
