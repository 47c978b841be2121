"""How many threads to use: fewer while others use the cores too, or while a step is too short to be shared.

The threads of a step wait for each other several times. Where something else holds the core of one of them, each of these waits
takes as long as the system lets the other go on: milliseconds, and a step of half a millisecond takes five. One thread alone only
gets its share of a core. And to wake a thread that waits takes some microseconds on one machine and fifty on another, whose cores
are lent out: there a step of .2 ms is faster alone. The bits of a result are the same for any number of threads, so a run may
change it on the way.
"""

from __future__ import annotations

import math
import time

STARVED = 0.6
"""Time of the processor over that of the wall, all threads together: with less, they mostly wait for a core. Two that have one
each come to 1.5 and more."""

LEAST = 0.02
"""Seconds of wall time that tell something."""

SHORT = 1e-3
"""A step that takes longer, s, gains by every thread that has a core: one thread alone is not tried."""

PAUSE, LONGEST = 0.5, 8.0
"""Seconds on one thread before all are tried again; after every trial that failed twice as long, up to the longest. So long, too,
until one thread is tried again."""


class Pace:
    """Told of every call of the step loop, it says how many threads the next one shall use."""

    def __init__(self) -> None:
        self.until, self.pause = 0.0, PAUSE
        self.alone, self.tried = math.inf, -math.inf  # seconds per step on one thread, as it was last tried, and when
        self.used, self.steps, self.wall, self.busy = 0, 0, 0.0, 0.0  # what is being tried, and what it took so far

    def threads(self, allowed: int, now: float) -> int:
        """Of those that are allowed, at a time `now`, s."""
        return 1 if now < self.until else allowed

    def note(self, threads: int, steps: int, wall: float, busy: float, now: float) -> None:
        """A call of so many steps on so many threads took so long, s, by the wall and of the processor; it ended `now`."""
        if threads != self.used:
            self.used, self.steps, self.wall, self.busy = threads, 0, 0.0, 0.0
        self.steps, self.wall, self.busy = self.steps + steps, self.wall + wall, self.busy + busy
        if self.wall < LEAST:
            return
        step, starved = self.wall / max(self.steps, 1), self.busy < STARVED * self.wall
        self.steps, self.wall, self.busy = 0, 0.0, 0.0
        if threads == 1:
            self.alone, self.tried = step, now
        elif starved or step > self.alone:
            self.until, self.pause = now + self.pause, min(2.0 * self.pause, LONGEST)
        else:
            self.pause = PAUSE
            if step < SHORT and now - self.tried > LONGEST:
                self.until = now + LEAST


def clocks() -> tuple[float, float]:
    """Time of the wall and of the processor, s."""
    return time.perf_counter(), time.process_time()
