"""Numbers with units as pictures write them, and the units of the arrays of a run."""

from __future__ import annotations

import math

_PREFIXES = {-15: "f", -12: "p", -9: "n", -6: "µ", -3: "m", 0: "", 3: "k", 6: "M", 9: "G"}

# Arrays of bodies, spheres and contacts as `frames` writes them; those of plug-ins that are not here go without.
ARRAY_UNITS = {
    "radius": "m", "diameter": "m", "mass": "kg", "velocity": "m/s", "speed": "m/s", "angular_velocity": "rad/s",
    "force": "N", "torque": "N·m", "friction_work": "J", "slip_distance": "m", "peak_pressure": "Pa",
    "normal_force": "N", "tangential_force": "N", "slip": "m", "overlap": "m", "contact_radius": "m",
    "critical_slip": "m", "moment": "N·m", "rolled_distance": "m",
}  # fmt: skip


def with_unit(value: float, unit: str) -> str:
    """A number with three figures and an SI prefix: 1.25e-05, "m" -> "12.5 µm"."""
    value = float(value)
    if value == 0.0 or not math.isfinite(value):
        return f"{value:g} {unit}"
    rounded = float(f"{value:.2e}")
    factor, written = prefixed(rounded, unit)
    return f"{rounded * factor:.3g} {written}"


def prefixed(size: float, unit: str) -> tuple[float, str]:
    """Factor and unit with its prefix in which a number of this size is easy to read: 3e-5, "m" -> 1e6, "µm".

    Masses come in grams, and a number without unit stays as it is.
    """
    if not unit or unit == "1":
        return 1.0, ""
    base, written = (1e3, "g") if unit == "kg" else (1.0, unit)
    size = abs(size) * base
    if size == 0.0 or not math.isfinite(size):
        return base, written
    # A thousandth of the last figure for the rounding of the logarithm at powers of ten.
    power = min(9, max(-15, 3 * math.floor(math.log10(size) / 3 + 1e-6)))
    return base / 10.0**power, f"{_PREFIXES[power]}{written}"


def round_length(longest: float) -> float:
    """The largest of 1, 2, 5 times a power of ten that is not above `longest`."""
    power = 10.0 ** math.floor(math.log10(longest))
    return max(step * power for step in (1.0, 2.0, 5.0) if step * power <= longest * (1.0 + 1e-9))


def ticks(low: float, high: float) -> list[float]:
    """Three to seven round numbers from `low` to `high`, or the one value that both are."""
    if not high > low:
        return [low]
    step = round_length((high - low) / 3.0)
    first, last = math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9)
    return [number * step for number in range(first, last + 1)]
