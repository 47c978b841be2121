"""Numbers for people: values in a readable unit, and words for one quantity."""

from __future__ import annotations

import math

import numpy as np

PREFIXES = (
    (1e9, "G"), (1e6, "M"), (1e3, "k"), (1.0, ""), (1e-3, "m"), (1e-6, "\N{MICRO SIGN}"), (1e-9, "n"), (1e-12, "p"),
    (1e-15, "f"), (1e-18, "a"),
)  # fmt: skip
MINUS, GLUE = "\N{MINUS SIGN}", "\N{NO-BREAK SPACE}"
"""GLUE keeps a number and its unit on one line."""


def scaled(values: np.ndarray, unit: str) -> tuple[np.ndarray, str]:
    """The values (n,), given in SI, in the prefixed unit that makes the largest 1 to 1000; and that unit."""
    factor, name = unit_for(values, unit)
    return values / factor, name


def unit_for(values: np.ndarray, unit: str) -> tuple[float, str]:
    """Factor and name of the unit of `scaled`."""
    factor, prefix = _prefix(float(np.abs(values[np.isfinite(values)]).max(initial=0.0)))
    return factor, prefix + unit


def told(value: float, unit: str, digits: int = 3) -> str:
    """A quantity given in SI, in words: 4.19e-8 of J as `41.9 nJ`; a pure number without unit; NaN as `unknown`."""
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
    """A pure number with its error, both to two digits of the error; to three places without one."""
    if not math.isfinite(error):
        return f"{value:z.3f}".replace("-", MINUS)
    if error < 5e-7:
        return f"{value:z.4f} (error below 1e{MINUS}6)".replace("-", MINUS)
    places = max(1 - math.floor(math.log10(error)), 0)
    return f"{value:z.{places}f} \N{PLUS-MINUS SIGN} {error:.{places}f}".replace("-", MINUS)


def percent(share: float) -> str:
    """A share from 0 to 1: `41 %`; small and nearly whole ones with a decimal."""
    value = 100.0 * share
    near = 0.0 < value < 1.0 or 99.0 < value < 100.0
    return f"{value:.1f}{GLUE}%" if near else f"{value:.0f}{GLUE}%"


def _prefix(size: float) -> tuple[float, str]:
    if size == 0.0:
        return 1.0, ""
    return next((entry for entry in PREFIXES if size >= entry[0] * (1.0 - 1e-12)), PREFIXES[-1])
