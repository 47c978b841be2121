"""Runs of a study of cost within its budget: its processes, its variants, their timings.

One process runs and times the variants, another compiles their laws beside it. The plan follows from measured times: variants
are run from the cheapest to the dearest, after the scene's own, the finest law and the reference, as long as time is left to time
them.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Sequence
from concurrent.futures import CancelledError, Future
from dataclasses import replace
from pathlib import Path
from typing import Any

from thirdbody.errors import InputError, ThirdbodyError
from thirdbody.scene.model import Scene
from thirdbody.studies.compare import read_outcome
from thirdbody.studies.copies import Copy, StudySource
from thirdbody.studies.cost import Row
from thirdbody.studies.cost_report import LEFT_OUT
from thirdbody.studies.folder import RUNS, Table
from thirdbody.studies.plan import AxisColumn, Plan
from thirdbody.studies.point import DONE, INTERRUPTED, WAITING, Point, PointResult
from thirdbody.studies.results import DEFAULT, STATES
from thirdbody.studies.runner import run_points
from thirdbody.studies.timing import Late, bare, timing
from thirdbody.studies.variants import SPRINGS, UNTIMED, Costs, Variant, variants_of
from thirdbody.studies.workers import LocalWorkers

RUNS_OF_COPY = 400.0
"""Budget over the time of one run of the copy with the scene's own settings: some 20 variants, of which the reference takes as
long as a hundred of these runs, and their timings."""

FINISH, GRACE = 3.0, 3.0
"""Time on an idle machine after the last variant: table, picture and JSON [s]; time for a run to end itself [s]."""

LATE = 3.0
"""A variant is given up after this many times its expected time."""

AFFORDABLE = 0.5
"""Largest fraction of the time left that the finest law and the reference may take together."""

ROUNDS, RESERVED_ROUNDS, DEAR, PRECISE = 25, 3, 0.02, 0.10
"""Largest number of rounds of timings; rounds for which time is reserved while variants are run, but for those that take more
than this fraction of the budget; relative uncertainty of a time below which a variant needs no more of them."""

BATCH, ENOUGH = 3, 0.05
"""Largest number of runs in the batch of a timing, and its duration [s]; the result is the median.

The first runs find the processor's caches cold, which is not part of their cost.
"""

SHORT, MANY, ONLY_TWO = 0.3, 5, 5.0
"""Limit of run times [s] for many repeats, how many these are, and limit for two repeats."""

MEASURED = ("integration_time", *(name for name in DEFAULT if name != STATES))
"""Results of the variants in the table."""


class Overdue(Exception):
    """The budget is over; the process that computed was ended."""


class Bench:
    """Two processes and the time left: one runs and times the variants, the other compiles their laws meanwhile."""

    def __init__(self, budget: float) -> None:
        self.budget, self.began = budget, time.time()
        self.runner, self.compiler = LocalWorkers(1), LocalWorkers(1)
        self.laws: dict[tuple[Any, ...], Future[Any]] = {}
        self.wall = self.cpu = 0.0

    @property
    def pace(self) -> float:
        """Wall seconds per second of a core: 1 on an idle machine, more on a shared one."""
        return max(1.0, self.wall / self.cpu) if self.cpu > 0.1 else 1.0

    @property
    def target(self) -> float:
        """Time of one run of the copy with the scene's own settings on one core [s]."""
        return self.budget / RUNS_OF_COPY

    @property
    def end(self) -> float:
        """Time at which the last variant must be done [s of `time.time`]."""
        return self.began + self.budget - FINISH * min(self.pace, 3.0)

    def left(self) -> float:
        """Return the seconds until then."""
        return self.end - time.time()

    def call(self, function: Callable[..., Any], *arguments: Any) -> Any:
        """Return the answer of a function in the process. Raises Overdue, and what the function raised."""
        began = time.time()
        future = self.runner.submit(with_cpu, function, arguments)
        try:
            answer, cpu = future.result(max(self.left(), 0.0))
        except (TimeoutError, CancelledError):
            raise Overdue from None
        self.wall += time.time() - began
        self.cpu += cpu
        return answer

    def close(self) -> None:
        """End both processes."""
        self.runner.kill()
        self.compiler.kill()


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


def compile_point(point: Point, _stop: Callable[[], bool] = lambda: False) -> None:
    """Compile the law of a variant into the cache."""
    from thirdbody.runner.simulate import prepare

    prepare(point.parsed(), point.plugins)


def rate_point(point: Point, limit: float, _stop: Callable[[], bool] = lambda: False) -> float:
    """Return the expected seconds of integrating a variant on one core, from a trial of at most `limit` seconds."""
    from thirdbody.runner.simulate import prepare, set_threads

    set_threads(1)
    built = prepare(point.parsed(), point.plugins)
    try:
        return bare(built, limit)[1]
    except Late:
        return limit * built.planned_time / max(built.state.time, 1e-3 * built.planned_time)


def repeats_of(seconds: float, wished: int) -> int:
    """Return the least number of timings of a variant of this duration."""
    if seconds > ONLY_TWO:
        return 2
    return max(wished, MANY) if seconds < SHORT else wished


class VariantRuns:
    """The variants of a study: their points, what they cost, and the table of their runs."""

    def __init__(self, bench: Bench, copy: Copy, source: StudySource, log: Callable[[str], None]) -> None:
        from thirdbody.laws.registry import discover

        self.bench, self.copy, self.base, self.log = bench, copy, copy.base, log
        self.files = tuple(Path(file).absolute() for file in source.plugins)
        scene = Scene.parse(copy.scene, "scene.toml", Path(), self.files)
        self.variants = variants_of(scene, discover(self.files).families[scene.contact.law], copy.base)
        self.rows, self.points = list[Row](), dict[Row, Point]()
        for number, v in enumerate(self.variants, 1):
            name = f"{number:02d}_{''.join(c if c.isalnum() else '_' for c in v.name).replace('__', '_')}"
            row = Row(v, message=LEFT_OUT, integrator=v.integrator, step=v.step(copy.base), folder=name)
            self.rows.append(row)
            try:
                text = scene.with_settings(v.changes).to_toml()
            except InputError as error:  # a law that this scene cannot have
                row.message = str(error)
                continue
            folder = source.folder.absolute() / RUNS / name
            self.points[row] = Point(len(self.points), folder, text, Path(), MEASURED, self.files, nudge=v.nudge)
        valid = [row.variant for row in self.rows if row in self.points]
        columns = (AxisColumn("variant", "1", tuple(v.name for v in valid), 0),
                   AxisColumn("axis", "1", tuple(v.axis for v in valid), 0))  # fmt: skip
        settings = tuple(dict(v.changes) for v in valid)
        plan = Plan(scene.title, copy.scene, "variants", (), columns, tuple(self.points.values()), settings)
        self.table = Table(plan, source.folder)
        own = next(v for v in self.variants if v.default)
        self.costs = Costs(copy.base, bench.target, self.variants[-1].law, copy.other * bench.target, {})
        self.own, self.beside, self.timed = own, [1.0], [0.3]

    def row_of(self, variant: Variant) -> Row:
        """Return the row of a variant."""
        return next(row for row in self.rows if row.variant is variant)

    def run(self, row: Row, seconds: float) -> PointResult:
        """Run a variant, for at most so many wall seconds; return the result. Raises Overdue where its process was ended."""
        bench, results, began = self.bench, list[PointResult](), time.time()
        point = replace(self.points[row], deadline=min(bench.end, began + seconds))
        last = point.deadline + GRACE
        run_points([point], bench.runner, results.append, lambda: time.time() > last, grace=0.0)
        result = results[0]
        bench.wall += result.seconds if result.processor else 0.0
        bench.cpu += result.processor
        self.enter(row, result)
        if row.cpu:
            self.beside.append(max(time.time() - began - bench.pace * row.cpu[0], 0.1))
        if result.status == WAITING:  # its process was ended
            raise Overdue
        return result

    def enter(self, row: Row, result: PointResult) -> None:
        """Use the result of a variant, which a study that goes on has already."""
        self.table.record(result)
        row.stable = result.status == DONE
        if row.stable:
            cpu = result.results["integration_time"]
            row.cpu, row.wall, row.message = [cpu], [cpu], ""
            row.outcome = read_outcome(self.points[row].folder)
            self.costs.learn(row.variant, cpu)
            if row.variant.default:
                self.costs.own, self.costs.other = cpu, self.copy.other * cpu
        elif result.status == INTERRUPTED:
            row.message = f"given up after {result.seconds:.3g} s: it takes longer than expected"
        else:
            row.message = result.reason or "stopped: the budget was over"

    def predicted(self, row: Row) -> float:
        """Return the expected wall seconds of running a variant once, its law compiled."""
        beside = statistics.median(self.beside)
        return self.bench.pace * self.costs.of(row.variant) + beside

    def round(self, row: Row) -> float:
        """Return the wall seconds of timing a variant once more."""
        if row.variant.axis in UNTIMED:
            return 0.0
        seconds = row.cpu[0] if row.cpu else self.costs.of(row.variant)
        return self.bench.pace * max(seconds, min(BATCH * seconds, ENOUGH)) + statistics.median(self.timed)

    def reserved(self, row: Row) -> float:
        """Return the wall seconds to reserve for timing a variant; none for a dear one, whose run tells enough."""
        each = self.round(row)
        return RESERVED_ROUNDS * each if each < DEAR * self.bench.budget else 0.0

    def compile_beside(self) -> None:
        """Let the other process compile the laws, those first that the study needs most."""
        springs = sorted({v.springs for v in self.variants if v.springs is not None})
        first = [self.costs.finest, *((v.level, v.springs) for v in self.variants if v.springs in springs[1:2])]

        def rank(row: Row) -> tuple[bool, int, float]:
            v = row.variant
            return v.integrator != self.base.kind, first.index(v.law) if v.law in first else len(first), self.costs.of(v)

        for row in sorted((row for row in self.rows if row in self.points), key=rank):
            if _code(row.variant) not in self.bench.laws and _code(row.variant) != _code(self.own):
                point = self.points[row]
                self.bench.laws[_code(row.variant)] = self.bench.compiler.submit(compile_point, point)

    def is_compiled(self, row: Row) -> bool:
        """Return whether the law of a variant is compiled, or cannot be."""
        future = self.bench.laws.get(_code(row.variant))
        return future is None or future.done()

    def run_all(self) -> None:
        """Run the variants for which time is left: the reference and what every study has first, then the cheapest ones."""
        waiting = [row for row in self.rows if row in self.points and not row.cpu]
        while waiting:
            left = self.bench.left() - sum(self.reserved(row) for row in self.rows if row.cpu)
            required = self._required(waiting, left)
            needed = sum(self.predicted(row) for row in required)
            ready = [row for row in waiting if self.is_compiled(row)]
            ready.sort(key=lambda row: (row not in required, self._rank(row), self.costs.of(row.variant)))
            fits = [
                row for row in ready
                if row in required
                or (self._rank(row) > 1 and self.predicted(row) + self.reserved(row) + needed <= left)
            ]  # fmt: skip
            if fits and self._is_guess(fits[0]):
                self._try(fits[0])
            elif fits:
                row = fits[0]
                waiting.remove(row)
                self.run(row, LATE * self.predicted(row) + 5.0 * self.bench.pace)
                self.log(f"{row.variant.name}: {row.message or f'{row.cpu[0]:.3g} s'}")
            elif len(ready) < len(waiting) and left > 0.0:
                time.sleep(0.1)  # the other process compiles
            else:
                break

    def _is_guess(self, row: Row) -> bool:
        """Return whether it is expected to take long, and nothing of its law or integrator is measured."""
        return self.costs.key(row.variant) not in self.costs.laws and self.costs.of(row.variant) > DEAR * self.bench.budget

    def _try(self, row: Row) -> None:
        """Measure the expected time of a variant in a short trial. Raises Overdue."""
        variant = row.variant
        try:
            seconds = self.bench.call(rate_point, self.points[row], 0.5 * DEAR * self.bench.budget)
        except ThirdbodyError:  # its run tells the reason
            seconds = self.costs.own
        self.costs.laws[self.costs.key(variant)] = seconds * self.costs.of(replace(variant, factor=1.0)) / self.costs.of(variant)

    def _required(self, waiting: Sequence[Row], left: float) -> list[Row]:
        """Return the finest law and the reference, as far as they have to run yet and take at most half of the time left.

        Where the reference takes longer, the finest law in steps that are less fine becomes the reference.
        """
        finest = [row for row in waiting if self._rank(row) == 0]
        for axis in ("reference", "fine"):
            row = next((row for row in self.rows if row.variant.axis == axis and row.variant.factor < 1.0), None)
            if row is not None and row not in waiting:
                return finest
            if row is not None and sum(self.predicted(one) for one in (*finest, row)) <= AFFORDABLE * left:
                return [*finest, row]
        return [row for row in finest if self.predicted(row) <= AFFORDABLE * left]

    def _rank(self, row: Row) -> int:
        """Return the rank in the order of runs; within a rank the cheapest comes first.

        First what every study has: the scene's own variant, the finest law, the reference, the scatter, the coarsest law and a
        few springs.
        """
        variant = row.variant
        if variant.default or (variant.axis == "law" and variant.law == self.costs.finest):
            return 0
        if variant.reference:
            return 1
        few = variant.axis == "law" and (variant is self.variants[0] or variant.springs == SPRINGS[0])
        return 2 if few or variant.nudge == 1 else 3

    def time_all(self, repeats: int) -> None:
        """Time variants alternately with the scene's own, until each is known well or no time is left.

        Those needed for errors only are not timed.
        """
        own = self.row_of(self.own)
        rows = sorted((row for row in self.rows if row.stable and row.variant.axis not in UNTIMED), key=lambda row: row.cpu[0])
        again: dict[Row, list[tuple[float, float, float]]] = {row: [] for row in rows}
        for _ in range(ROUNDS if own.stable else 0):
            going = [row for row in rows if row is not own and not _is_known(again[row], repeats)]
            going = [row for row in going if self.reserved(row)] or going  # dear ones last
            yardstick = self._timing(own) if going else None
            if yardstick is None:
                break
            again[own].append((*yardstick, yardstick[1]))
            for row in going:
                if (result := self._timing(row)) is not None:
                    again[row].append((*result, yardstick[1]))
        for row in rows:
            if again[row]:
                row.wall, row.cpu, row.beside = (list(column) for column in zip(*again[row], strict=True))

    def _timing(self, row: Row) -> tuple[float, float] | None:
        """Return the seconds (wall, processor) of a variant; None where no time is left."""
        if self.round(row) > self.bench.left():
            return None
        began = time.time()
        try:
            wall, cpu = self.bench.call(time_point, self.points[row], LATE * max(row.cpu[0], 1.0))
        except (Overdue, Late, ThirdbodyError):
            return None
        self.timed.append(max(time.time() - began - self.bench.pace * max(cpu, min(BATCH * cpu, ENOUGH)), 0.0))
        return wall, cpu


def _is_known(again: Sequence[tuple[float, float, float]], repeats: int) -> bool:
    """Return whether the ratio of a variant's seconds to the alternating ones is known well enough."""
    seconds = [cpu for _, cpu, _ in again]
    if not seconds or len(seconds) < repeats_of(min(seconds), repeats):
        return False
    return timing([cpu / own for _, cpu, own in again if own > 0.0]).relative <= PRECISE


def _code(variant: Variant) -> tuple[Any, ...]:
    """Return a key of the code that a variant needs compiled."""
    return variant.level, variant.springs, variant.integrator
