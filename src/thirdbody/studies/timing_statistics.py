"""Statistics of a few timings: a median and its uncertainty, so that smaller differences are ties."""

import math
import statistics
from collections.abc import Sequence
from typing import NamedTuple

LONE = 0.5
"""Relative uncertainty of a single timing, as the same run varies on a busy machine.

Of n timings, fewer than FEW, it is at least LONE/n: their agreement may be chance.
"""

FLOOR = 0.03
"""Relative uncertainty that repeats do not lower: the layout of memory alone changes times by some per cent."""

FEW = 5
"""Number of timings below which quartiles mean nothing: the whole range is used."""


class Timing(NamedTuple):
    """Seconds, and half the width of the confidence interval of the median."""

    seconds: float
    half: float

    @property
    def relative(self) -> float:
        """Half width over the median."""
        return self.half / self.seconds if self.seconds > 0.0 else math.inf


def timing(values: Sequence[float]) -> Timing:
    """Return the median and its half width; NaN and infinity without values.

    Notches 1.57 IQR/sqrt(n), which overlap for equal medians in 95 % of cases (McGill, Tukey and Larsen, The American
    Statistician 32:12, 1978); of fewer than five values half their range.
    """
    n = len(values)
    if n == 0:
        return Timing(math.nan, math.inf)
    middle = statistics.median(values)
    if n == 1:
        return Timing(middle, LONE * middle)
    if n < FEW:
        half = max(0.5 * (max(values) - min(values)), LONE * middle / n)
    else:
        low, _, high = statistics.quantiles(values, n=4, method="inclusive")
        half = 1.57 * (high - low) / math.sqrt(n)
    return Timing(middle, max(half, FLOOR * middle))


def slower(a: Timing, b: Timing) -> bool:
    """Return whether a takes significantly longer than b: their intervals do not overlap."""
    return a.seconds - a.half > b.seconds + b.half
