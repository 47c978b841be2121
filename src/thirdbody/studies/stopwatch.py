"""Time of the integration of a run alone: the same stops as the run, without the work at them."""

import math
import statistics
import time
from collections.abc import Callable
from typing import Any

from thirdbody.assembly.simulation import Simulation
from thirdbody.runner.stops import Settling, targets

EMPTY = 50
"""Number of timed calls that do nothing, for the cost of a call."""


class Late(Exception):
    """The time limit of one run is exceeded."""


class Clock:
    """Wall and processor seconds between `start` and `stop`, with pauses."""

    def __init__(self) -> None:
        self.wall = self.cpu = 0.0

    def start(self) -> None:
        """Start or continue."""
        self.wall -= time.perf_counter()
        self.cpu -= time.process_time()

    def stop(self) -> None:
        """Stop."""
        self.cpu += time.process_time()
        self.wall += time.perf_counter()

    def aside(self, act: Callable[[], Any]) -> None:
        """Call a function without counting its time."""
        self.stop()
        try:
            act()
        finally:
            self.start()


def attach(integrator: Any) -> Clock:
    """Return a clock that runs while the integrator advances, and pauses while the run is observed."""
    clock, advance = Clock(), integrator.advance_to

    def timed(
        until: float = math.inf,
        distance: float = math.inf,
        watch: Callable[[], None] = lambda: None,
        between: Callable[[], None] = lambda: None,
    ) -> None:
        clock.start()
        try:
            advance(until, distance, lambda: clock.aside(watch), lambda: clock.aside(between))
        finally:
            clock.stop()

    integrator.advance_to = timed
    return clock


def bare(built: Simulation, limit: float) -> tuple[float, float]:
    """Return the seconds (wall, processor) of integrating a built simulation to its end.

    The same stops and steps as in its run, without frames, labels, energies, guards of the run and checkpoints. Body by body,
    each output enters compiled code once for 512 bodies, which takes 0.1 ms for any variant: this is subtracted too, by calls
    that do nothing. Raises GuardStop as the run does, and Late after `limit` seconds of the processor.
    """
    integrator: Any = built.integrator
    calls, end, advance = 0, time.process_time() + limit, getattr(integrator, "advance_islands", None)

    def counted(*arguments: Any) -> None:
        nonlocal calls
        calls += 1
        advance(*arguments)  # type: ignore[misc]

    def watch() -> None:
        if time.process_time() > end:
            raise Late

    if advance is not None:
        integrator.advance_islands = counted
    clock = Clock()
    clock.start()
    settling = Settling(built, lambda: None)
    for target in targets(built):
        settling.advance(target, lambda until, distance: integrator.advance_to(until, distance, watch))
    clock.stop()
    if not calls:
        return clock.wall, clock.cpu
    wall, cpu = _call(lambda: advance(0, 1, built.state.time))  # type: ignore[misc]  # body 0 is there already
    return clock.wall - calls * wall, clock.cpu - calls * cpu


def _call(act: Callable[[], Any]) -> tuple[float, float]:
    """Return the seconds (wall, processor) of a short call: medians, to exclude disturbances."""
    clocks = [Clock() for _ in range(EMPTY)]
    for clock in clocks:
        clock.start()
        act()
        clock.stop()
    return statistics.median(clock.wall for clock in clocks), statistics.median(clock.cpu for clock in clocks)
