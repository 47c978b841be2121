"""Long times and large files in units that people think in: "2.5 days", "50 GB"."""

from __future__ import annotations

import math

_TIMES = ((365.25 * 86400.0, "years"), (86400.0, "days"), (3600.0, "h"), (60.0, "min"), (1.0, "s"))
_SIZES = ((1e12, "TB"), (1e9, "GB"), (1e6, "MB"), (1e3, "kB"), (1.0, "bytes"))


def duration(seconds: float) -> str:
    """A duration with its unit: s, min, h, days, years; two figures from a minute on, for it is an estimate."""
    if not math.isfinite(seconds):
        return "unknown" if math.isnan(seconds) else "for ever"
    return f"{seconds:.3g} s" if seconds < 60.0 else _scaled(seconds, _TIMES)


def size(count: float) -> str:
    """A number of bytes with its unit, powers of 1000, two figures."""
    return _scaled(count, _SIZES)


def _scaled(value: float, units: tuple[tuple[float, str], ...]) -> str:
    scale, unit = next((entry for entry in units if value >= entry[0]), units[-1])
    shown = float(f"{value / scale:.2g}")
    return f"{shown:,.0f} {unit}" if shown >= 10.0 else f"{shown:g} {unit}"
