"""What a handful of timings tells: a median and how far it may be off, so that differences below that are ties."""

from __future__ import annotations

import math
import statistics
from collections.abc import Sequence
from typing import NamedTuple

LONE = 0.5
"""Relative uncertainty of a single timing: the same run on a busy machine varies by that much. Of n of them, fewer than FEW, it
is at least LONE/n: that they agree may be chance."""

FLOOR = 0.03
"""Relative uncertainty that repeats do not lower: the layout of memory alone changes times by some per cent."""

FEW = 5
"""Timings below which quartiles mean nothing: the whole range is taken."""


class Timing(NamedTuple):
    """Seconds, and half the width of the interval that the median may lie in."""

    seconds: float
    half: float

    @property
    def relative(self) -> float:
        """The half width over the median."""
        return self.half / self.seconds if self.seconds > 0.0 else math.inf


def timing(values: Sequence[float]) -> Timing:
    """Median and half width: notches 1.57 IQR/sqrt(n), which overlap for equal medians in 95 % of cases (McGill, Tukey and
    Larsen, The American Statistician 32:12, 1978); of fewer than five values half their range. NaN and infinity without any."""
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
    """Whether a is told to take longer than b: their intervals do not touch."""
    return a.seconds - a.half > b.seconds + b.half
