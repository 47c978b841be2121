"""Processes of a study of cost: one runs and times the variants, the others compile laws beside it; and what runs in them."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from concurrent.futures import CancelledError, Future
from typing import Any

from thirdbody.scene.model import Scene
from thirdbody.studies.copies import StudySource, units_are_compiled
from thirdbody.studies.point import Point
from thirdbody.studies.timing import bare, rate
from thirdbody.studies.variants import SPRINGS, Code, code_of, laws_of, springs_option
from thirdbody.studies.workers import LocalWorkers
from thirdbody.system.processes import cores

COMPILERS, COMPILING = 3, 6.0
"""Largest number of processes that compile laws beside the runs; processor time of one law [s] while none is known."""

FINISH = 3.0
"""Time on an idle machine after the last variant: table, picture and JSON [s]."""

BATCH, ENOUGH = 3, 0.05
"""Largest number of runs in the batch of a timing, and its duration [s]; the result is the median.

The first runs find the processor's caches cold, which is not part of their cost.
"""


class Overdue(Exception):
    """The budget is over; the process that computed was ended."""


class Bench:
    """The time left, and processes: one runs and times the variants, the others compile their laws meanwhile."""

    def __init__(self, budget: float) -> None:
        self.budget, self.began = budget, time.time()
        self.runner, self.compilers = LocalWorkers(1), LocalWorkers(max(1, min(cores() - 1, COMPILERS)))
        self.laws: dict[Code, Future[Any]] = {}
        self.wall = self.cpu = 0.0

    @property
    def pace(self) -> float:
        """Wall seconds per second of a core: 1 on an idle machine, more on a shared one."""
        return max(1.0, self.wall / self.cpu) if self.cpu > 0.1 else 1.0

    @property
    def end(self) -> float:
        """Time at which the last variant must be done [s of `time.time`]."""
        return self.began + self.budget - FINISH * min(self.pace, 3.0)

    def left(self) -> float:
        """Return the seconds until then."""
        return self.end - time.time()

    def call(self, function: Callable[..., Any], *arguments: Any, part: float = 1.0) -> Any:
        """Return the answer of a function in the process, in a part of the time left.

        Raises Overdue, and what the function raised.
        """
        began = time.time()
        future = self.runner.submit(with_cpu, function, arguments)
        try:
            answer, cpu = future.result(max(part * self.left(), 0.0))
        except (TimeoutError, CancelledError):
            raise Overdue from None
        self.wall += time.time() - began
        self.cpu += cpu
        return answer

    def compile(self, code: Code, function: Callable[..., Any], *arguments: Any) -> None:
        """Let another process compile the laws of a code, once."""
        if code not in self.laws:
            self.laws[code] = self.compilers.submit(with_cpu, function, arguments)

    def compile_laws(self, source: StudySource, scene: Scene) -> bool:
        """Let other processes compile the laws that every study needs: the coarsest, a few springs, the finest.

        Return False, and compile none, where the kernels have to be compiled first: that needs all cores.
        """
        from thirdbody.assembly.physics import law_faults
        from thirdbody.engine.units import EXPLICIT
        from thirdbody.laws.registry import discover
        from thirdbody.runner.simulate import likely_units

        units, registry = likely_units(scene), discover(tuple(source.plugins))
        if not units_are_compiled(units):
            return False
        if law_faults(scene, registry):  # building it tells them
            return True
        family = registry.families[scene.contact.law]
        level = scene.contact.level or family.default_level
        default, kind = springs_option(family, level), "explicit" if units is EXPLICIT else "implicit"
        own = level, None if default is None else int(scene.contact.options.get("springs", default))
        laws = laws_of(scene, family, own)
        first, *_, finest = laws
        for law in dict.fromkeys([first, *(law for law in laws if law[1] == SPRINGS[0]), finest]):  # it compiles longest
            if law != own:
                self.compile(code_of(laws[law], kind), compile_law, source, laws[law], kind)
        return True

    def ready_in(self, code: Code) -> float:
        """Return the expected seconds until the laws of a code are compiled, or cannot be."""
        if code not in self.laws or self.laws[code].done():
            return 0.0
        codes = list(self.laws)
        waiting = sum(not self.laws[other].done() for other in codes[: codes.index(code) + 1])
        return self.pace * self.compiling() * -(-waiting // self.compilers.count)

    def compiling(self) -> float:
        """Return the usual processor seconds of compiling one law; what was compiled before is no measure."""
        done = [future.result()[1] for future in self.laws.values() if future.done() and future.exception() is None]
        return statistics.median([COMPILING, *(seconds for seconds in done if seconds > 1.0)])

    def close(self) -> None:
        """End all processes."""
        self.runner.kill()
        self.compilers.kill()


def with_cpu(function: Callable[..., Any], arguments: tuple[Any, ...], stop: Callable[[], bool]) -> tuple[Any, float]:
    """Return the result of a function in a worker, and the processor seconds that it took."""
    began = time.process_time()
    return function(*arguments, stop), time.process_time() - began


def time_point(point: Point, limit: float, stop: Callable[[], bool] = lambda: False) -> tuple[float, float]:
    """Return the seconds (wall, processor) of integrating a variant: medians of a batch. Raises GuardStop and Late."""
    from thirdbody.runner.simulate import prepare, set_threads

    set_threads(1)
    times: list[tuple[float, float]] = []
    while len(times) < BATCH and (not times or sum(cpu for _, cpu in times) < ENOUGH) and not stop():
        times.append(bare(prepare(point.parsed(), point.plugins), limit))
    wall, cpu = (statistics.median(column) for column in zip(*times, strict=True))
    return wall, cpu


def compile_law(source: StudySource, changes: dict[str, Any], kind: str, _stop: Callable[[], bool] = lambda: False) -> None:
    """Compile the laws of a scene with these changes into the cache."""
    from thirdbody.assembly.physics import compile_physics
    from thirdbody.laws.registry import discover

    physics = compile_physics(source.read().with_settings(changes), discover(tuple(source.plugins))).physics
    if kind == "implicit":
        _ = physics.tangents  # compiled where it is named first


def compile_point(point: Point, _stop: Callable[[], bool] = lambda: False) -> None:
    """Compile all that a variant needs into the cache."""
    from thirdbody.runner.simulate import prepare

    prepare(point.parsed(), point.plugins)


def rate_point(point: Point, limit: float, _stop: Callable[[], bool] = lambda: False) -> float:
    """Return the expected seconds of integrating a variant on one core, from a trial of at most `limit` seconds."""
    from thirdbody.runner.simulate import prepare, set_threads

    set_threads(1)
    return rate(prepare(point.parsed(), point.plugins), limit)
