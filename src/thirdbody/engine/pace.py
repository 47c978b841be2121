"""How many threads to use while others use the cores too.

The threads of a step wait for each other several times. Where something else holds the core of one of them, each of these waits
takes as long as the system lets the other go on: milliseconds, and a step of half a millisecond takes five. One thread alone only
gets its share of a core. The bits of a result are the same for any number of threads, so a run may change it on the way.
"""

from __future__ import annotations

import time

STARVED = 0.6
"""Time of the processor over that of the wall, all threads together: with less, they mostly wait for a core. Two that have one
each come to 1.5 and more."""

LEAST = 0.02
"""Seconds of wall time that tell something."""

PAUSE, LONGEST = 0.5, 8.0
"""Seconds on one thread before all are tried again; after every trial that failed twice as long, up to the longest."""


class Pace:
    """Told of every call of the step loop, it says how many threads the next one shall use."""

    def __init__(self) -> None:
        self.until, self.pause = 0.0, PAUSE
        self.wall = self.busy = 0.0

    def threads(self, allowed: int, now: float) -> int:
        """Of those that are allowed, at a time `now`, s."""
        return 1 if now < self.until else allowed

    def note(self, threads: int, wall: float, busy: float, now: float) -> None:
        """A call on so many threads took so long, s, of the wall's time and of the processor's; it ended `now`."""
        if threads == 1:
            return
        self.wall, self.busy = self.wall + wall, self.busy + busy
        if self.wall < LEAST:
            return
        if self.busy < STARVED * self.wall:
            self.until, self.pause = now + self.pause, min(2.0 * self.pause, LONGEST)
        else:
            self.pause = PAUSE
        self.wall = self.busy = 0.0


def clocks() -> tuple[float, float]:
    """Time of the wall and of the processor, s."""
    return time.perf_counter(), time.process_time()
