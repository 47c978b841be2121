"""Number of threads: reduced while other processes use the cores, or steps are too short.

The threads of a step synchronise several times. If another process occupies the core of one thread, each synchronisation takes a
scheduler time slice, i.e. milliseconds: a step of 0.5 ms then takes 5 ms, whereas a single thread only loses its share of the
core. Waking a waiting thread takes some microseconds on one machine and 50 on another with virtual cores, where a step of 0.2 ms
is faster on one thread. Results are bit-identical for any number of threads, so it may change during a run.
"""

import math
import time

STARVED = 0.6
"""CPU time of all threads over wall time below which they mostly wait for a core; two threads on two cores reach 1.5 or more."""

MIN_MEASUREMENT = 0.02
"""Shortest wall time [s] of a measurement."""

SHORT = 1e-3
"""Wall time of a step [s] above which more threads are always faster: a single thread is not tried."""

PAUSE, LONGEST = 0.5, 8.0
"""Time [s] on one thread before all are tried again, doubled after each failed trial up to the longest; a single thread is tried
again after the longest, too."""


class ThreadTuner:
    """Chooses the number of threads of the step loop from the timings of its calls."""

    def __init__(self) -> None:
        self.until, self.pause = 0.0, PAUSE
        self.alone, self.tried = math.inf, -math.inf  # last trial of one thread: time per step [s], instant [s]
        self.used, self.steps, self.wall, self.busy = 0, 0, 0.0, 0.0  # present measurement: threads, steps, times

    def threads(self, allowed: int, now: float) -> int:
        """Return the number of threads to use at the instant `now` [s], at most `allowed`."""
        return 1 if now < self.until else allowed

    def note(self, threads: int, steps: int, wall: float, busy: float, now: float) -> None:
        """Record a call that ended at `now` [s]: number of threads and steps, wall time and CPU time [s]."""
        if threads != self.used:
            self.used, self.steps, self.wall, self.busy = threads, 0, 0.0, 0.0
        self.steps, self.wall, self.busy = self.steps + steps, self.wall + wall, self.busy + busy
        if self.wall < MIN_MEASUREMENT:
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
                self.until = now + MIN_MEASUREMENT


def clocks() -> tuple[float, float]:
    """Return wall-clock time and CPU time [s]."""
    return time.perf_counter(), time.process_time()
