"""Runs of a study of cost within its budget: its processes, its variants, their timings.

One process runs and times the variants, others compile their laws beside it, from the start on. The plan follows from measured
times: after the scene's own variant, the finest law, the reference, the coarsest law and a few springs, variants are run from the
cheapest to the dearest, compiling and timing included. None is run in time that a cheaper one still needs, so those left out are
the dearest.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Sequence
from concurrent.futures import CancelledError, Future
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

from thirdbody.assembly.physics import law_faults
from thirdbody.engine.units import EXPLICIT
from thirdbody.errors import InputError, ThirdbodyError
from thirdbody.laws.registry import discover
from thirdbody.runner.simulate import likely_units
from thirdbody.scene.model import Scene
from thirdbody.studies import copies
from thirdbody.studies.copies import BATCH, ENOUGH, RUNS_OF_COPY, Copy, StudySource, units_are_compiled
from thirdbody.studies.cost import Row, read_outcome
from thirdbody.studies.cost_report import LEFT_OUT
from thirdbody.studies.folder import RUNS, Table
from thirdbody.studies.plan import AxisColumn, Plan
from thirdbody.studies.point import DONE, INTERRUPTED, WAITING, Point, PointResult
from thirdbody.studies.results import DEFAULT, STATES
from thirdbody.studies.runner import run_points
from thirdbody.studies.timing import Late, lone, timing
from thirdbody.studies.variants import SPRINGS, UNTIMED, Code, Costs, code_of, laws_of, springs_option, variants_of
from thirdbody.studies.workers import LocalWorkers
from thirdbody.system.processes import cores
from thirdbody.units import duration

GRACE = 3.0  # time for a run to end itself [s]
# A variant is given up after this many times its expected time; the finest law not before this fraction of the time left.
LATE, PATIENCE = 3.0, 0.25
AFFORDABLE = 0.5  # largest fraction of the time left that the finest law and the reference may take together

# Largest number of timings of a variant; rounds for which time is reserved while variants are run, but for those that take more
# than this fraction of the budget; relative uncertainty of a time below which a variant needs no more of them.
ROUNDS, RESERVED_ROUNDS, DEAR, PRECISE = 25, 3, 0.02, 0.10

SHORT, MANY, ONLY_TWO = 0.3, 5, 5.0  # limit of run times [s] for many repeats, how many these are, and limit for two repeats
MEASURED = ("integration_time", *(name for name in DEFAULT if name != STATES))  # results of the variants in the table
# Largest number of processes that compile laws beside the runs; usual processor time of one law [s].
COMPILERS, COMPILING = 3, 6.0
FINISH = 3.0  # time on an idle machine after the last variant: table, picture and JSON [s]


class Overdue(Exception):
    """The budget is over; the process that computed was ended."""


class Bench:
    """The time left, and processes: one runs and times the variants, the others compile their laws meanwhile."""

    def __init__(self, budget: float) -> None:
        self.budget, self.began = budget, time.time()
        self.runner, self.compilers = LocalWorkers(1), LocalWorkers(max(1, min(cores() - 1, COMPILERS)))
        self.laws, self.wall, self.cpu = dict[Code, Future[Any]](), 0.0, 0.0

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
        try:
            answer, cpu = self.runner.submit(with_cpu, function, arguments).result(max(part * self.left(), 0.0))
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
        units, registry = likely_units(scene), discover(tuple(source.plugins))
        if not units_are_compiled(units):
            return False
        if law_faults(scene, registry):  # building it tells them
            return True
        family, kind = registry.families[scene.contact.law], "explicit" if units is EXPLICIT else "implicit"
        level = scene.contact.level or family.default_level
        default = springs_option(family, level)
        own = level, None if default is None else int(scene.contact.options.get("springs", default))
        first, *others, finest = laws_of(scene, family, own).items()  # the finest compiles longest
        for law, changes in (first, *(other for other in others if other[0][1] == SPRINGS[0]), finest):
            if law != own:
                self.compile(code_of(changes, kind), copies.compile_law, source, changes, kind)
        return True

    def compiling(self, code: Code) -> float:
        """Return the processor seconds that the laws of a code need yet: none once they are compiled or refused."""
        return COMPILING if code in self.laws and not self.laws[code].done() else 0.0

    def close(self) -> None:
        """End all processes."""
        self.runner.kill()
        self.compilers.kill()


def with_cpu(function: Callable[..., Any], arguments: tuple[Any, ...], stop: Callable[[], bool]) -> tuple[Any, float]:
    """Return the result of a function in a worker, and the processor seconds that it took."""
    began = time.process_time()
    return function(*arguments, stop), time.process_time() - began


def repeats_of(seconds: float, wished: int) -> int:
    """Return the least number of timings of a variant of this duration."""
    if seconds > ONLY_TWO:
        return 2
    return max(wished, MANY) if seconds < SHORT else wished


class VariantRuns:
    """The variants of a study: their points, what they cost, and the table of their runs."""

    def __init__(self, bench: Bench, copy: Copy, source: StudySource, log: Callable[[str], None]) -> None:
        self.bench, self.copy, self.source, self.log = bench, copy, source, log
        files = tuple(Path(file).absolute() for file in source.plugins)
        scene = Scene.parse(copy.scene, "scene.toml", Path(), files)
        self.rows, self.points = list[Row](), dict[Row, Point]()
        for number, v in enumerate(variants_of(scene, discover(files).families[scene.contact.law], copy.base), 1):
            row = Row(v, message=LEFT_OUT, integrator=v.integrator, step=v.step(copy.base))
            self.rows.append(row)
            try:
                text = scene.with_settings(v.changes).to_toml()
            except InputError as error:  # a law that this scene cannot have
                row.message = str(error)
                continue
            name = f"{number:02d}_{''.join(c if c.isalnum() else '_' for c in v.name).replace('__', '_')}"
            folder = source.folder.absolute() / RUNS / name
            self.points[row] = Point(len(self.points), folder, text, Path(), MEASURED, files, nudge=v.nudge)
        valid = [row.variant for row in self.points]
        columns = [AxisColumn("variant", "1", tuple(v.name for v in valid), 0),
                   AxisColumn("axis", "1", tuple(v.axis for v in valid), 0)]  # fmt: skip
        settings, target = tuple(dict(v.changes) for v in valid), bench.budget / RUNS_OF_COPY
        plan = Plan(scene.title, copy.scene, "variants", (), tuple(columns), tuple(self.points.values()), settings)
        self.table, self.own = Table(plan, source.folder), next(row for row in self.rows if row.variant.default)
        self.costs = Costs(copy.base, target, self.rows[-1].variant.law, copy.other * target, {})
        self.beside, self.timed = [1.0], [0.3]
        self.again: dict[Row, list[tuple[float, float, float]]] = {row: [] for row in self.rows}

    def run(self, row: Row, seconds: float) -> str:
        """Run a variant, for at most so many wall seconds; return the status of its point."""
        bench, yardsticks = self.bench, [self._timing(self.own)] if self.own.cpu and self.is_dear(row) else []
        results, began = list[PointResult](), time.time()
        point = replace(self.points[row], deadline=min(bench.end, began + seconds))
        last = point.deadline + GRACE
        run_points([point], bench.runner, results.append, lambda: time.time() > last, grace=0.0)
        result = results[0]
        bench.wall += result.seconds if result.processor else 0.0
        bench.cpu += result.processor
        if result.status == WAITING:  # its process did not end by itself
            bench.runner = LocalWorkers(1)
            result = replace(result, status=INTERRUPTED, seconds=time.time() - began)
        self.enter(row, result)
        if row.cpu:
            self.beside.append(max(time.time() - began - bench.pace * row.cpu[0], 0.1))
            if yardsticks:  # its run is a timing, which the scene's own variant before and after it refers to a pace
                own = [yardstick[1] for yardstick in (*yardsticks, self._timing(self.own)) if yardstick]
                self.again[row] += [(row.wall[0], row.cpu[0], statistics.mean(own))] if own else []
        self.log(f"{row.variant.name}: {row.message or f'{row.cpu[0]:.3g} s'}")
        return result.status

    def enter(self, row: Row, result: PointResult) -> None:
        """Use the result of a variant, which a study that goes on has already."""
        self.table.record(result)
        row.stable = result.status == DONE
        if row.stable:
            cpu = result.results["integration_time"]
            row.cpu, row.wall, row.message = [cpu], [cpu], ""
            row.outcome = read_outcome(self.points[row].folder)
            self.costs.learn(row.variant, cpu)
            if row is self.own:
                self.costs.own, self.costs.other = cpu, self.copy.other * cpu
        elif result.status == INTERRUPTED:
            row.message = f"given up after {result.seconds:.3g} s: it takes longer than expected"
            self._expect(row, result.seconds / self.bench.pace)
        else:
            row.message = result.reason

    def predicted(self, row: Row) -> float:
        """Return the expected wall seconds of running a variant once, its law compiled."""
        return self.bench.pace * self.costs.of(row.variant) + statistics.median(self.beside)

    def round(self, row: Row) -> float:
        """Return the wall seconds of timing a variant once more."""
        if row.variant.axis in UNTIMED:
            return 0.0
        seconds = row.cpu[0] if row.cpu else self.costs.of(row.variant)
        return self.bench.pace * max(seconds, min(BATCH * seconds, ENOUGH)) + statistics.median(self.timed)

    def reserved(self, row: Row) -> float:
        """Return the wall seconds to reserve for timing a variant; none for a dear one, whose run tells enough."""
        return 0.0 if self.is_dear(row) else self.round(row) * max(RESERVED_ROUNDS - len(self.again[row]), 0)

    def is_dear(self, row: Row) -> bool:
        """Return whether a variant takes so long that it is timed last."""
        return self.round(row) > DEAR * self.bench.budget

    def price(self, row: Row) -> float:
        """Return the expected processor seconds of all that a variant needs: compiling, and a run."""
        return self.costs.of(row.variant) + self.bench.compiling(row.variant.code)

    def compile_beside(self) -> None:
        """Let other processes compile what the variants need and is not in their queue yet; last the kernels of an integrator."""
        own, units = self.own.variant, {"explicit": EXPLICIT, "implicit": ("driver", "pairs", "books")}
        last = {kind for kind in units if kind != own.integrator and not units_are_compiled(units[kind])}
        rows = sorted(self.points, key=lambda row: (row.variant.integrator in last, max(self._rank(row), 2), self.price(row)))
        for v, point in ((row.variant, self.points[row]) for row in rows if row.variant.code != own.code):
            if v.integrator != own.integrator:
                self.bench.compile(v.code, copies.compile_point, point)
            else:
                changes = {key: value for key, value in v.changes.items() if key.startswith("contact.")}
                self.bench.compile(v.code, copies.compile_law, self.source, changes, v.integrator)

    def run_all(self, repeats: int) -> None:
        """Run the variants for which time is left; while one waits for its law to be compiled, others are timed.

        Those for which none is left tell how large a budget would hold them all.
        """
        waiting = [row for row in self.points if not row.cpu]
        with suppress(Overdue):
            while True:
                row, awaited = self._next(waiting)
                if row is None and not awaited:
                    break
                if row is None:
                    if not self.time_round(repeats, dear=False):
                        time.sleep(0.1)
                elif self.costs.key(row.variant) not in self.costs.laws and self.costs.of(row.variant) > DEAR * self.bench.budget:
                    self._try(row)  # expected to take long, and nothing of its law or integrator is measured
                else:
                    waiting.remove(row)
                    minimum = PATIENCE * self.bench.left() if self._rank(row) == 0 else 0.0  # the others are predicted from it
                    self.run(row, max(LATE * self.predicted(row) + 5.0 * self.bench.pace, minimum))
        needed = duration(self._needed(waiting))
        for row in waiting:
            missing = "its law was not compiled in time" if self.bench.compiling(row.variant.code) else "one of the dearest"
            row.message = f"{LEFT_OUT}, {missing}: a budget of about {needed} has all variants"

    def _next(self, waiting: Sequence[Row]) -> tuple[Row | None, bool]:
        """Return the variant to run now, and whether one that fits waits for its law to be compiled.

        The time that cheaper ones will need is reserved.
        """
        left = self.bench.left() - sum(self.reserved(row) for row in self.rows if row.cpu)
        required, awaited = self._required(waiting, left), False
        for row in sorted(waiting, key=lambda row: (row not in required, self._rank(row), self.price(row))):
            needed = self.predicted(row) + self.reserved(row)
            if row not in required and self._rank(row) < 2:
                continue  # too dear
            if row not in required and needed > left:
                break
            if not self.bench.compiling(row.variant.code):
                return row, True
            left, awaited = left - needed, True
        return None, awaited

    def _try(self, row: Row) -> None:
        """Measure the expected time of a variant in a short trial. Raises Overdue."""
        try:
            seconds = self.bench.call(copies.rate_point, self.points[row], 0.5 * DEAR * self.bench.budget)
        except ThirdbodyError:  # its run tells the reason
            seconds = self.costs.own
        self._expect(row, seconds)

    def _expect(self, row: Row, seconds: float) -> None:
        """Expect at least so many seconds of a variant, and of others with its law accordingly."""
        variant = row.variant
        if seconds > self.costs.of(variant) or self.costs.key(variant) not in self.costs.laws:
            own_step = self.costs.of(replace(variant, factor=1.0)) / self.costs.of(variant)
            self.costs.laws[self.costs.key(variant)] = seconds * own_step

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
        few = variant.axis == "law" and (variant is self.rows[0].variant or variant.springs == SPRINGS[0])
        return 2 if few or variant.nudge == 1 else 3

    def _needed(self, waiting: Sequence[Row]) -> float:
        """Return a budget in which all variants fit [s]: what they still need, and the larger copy that it has."""
        bench, timed = self.bench, [row for row in self.rows if row.cpu]
        compiling = bench.pace * sum(bench.compiling(row.variant.code) for row in waiting) / bench.compilers.count
        rest = sum(self.predicted(row) + self.reserved(row) for row in waiting) + sum(self.reserved(row) for row in timed)
        whole = bench.budget - bench.left() + max(compiling, rest)
        runs = bench.pace * sum(self.costs.of(row.variant) for row in (*timed, *waiting)) if self.copy.reduction else 0.0
        return max(1.2 * bench.budget, (whole - runs) / max(1.0 - runs / bench.budget, 0.25))

    def time_all(self, repeats: int) -> None:
        """Time variants alternately with the scene's own, until each is known well or no time is left.

        Those needed for errors only are not timed. Their seconds are scaled to one pace of the machine, that of its median.
        """
        while self.time_round(repeats):
            pass
        paces = [own for times in self.again.values() for *_, own in times]
        single = lone([cpu / own for _, cpu, own in times] for row, times in self.again.items() if row is not self.own)
        for row, times in self.again.items():
            if times:
                row.single = single
                row.wall, row.cpu, row.beside = (list(column) for column in zip(*times, strict=True))
                row.cpu = [cpu * statistics.median(paces) / own for _, cpu, own in times]

    def time_round(self, repeats: int, dear: bool = True) -> bool:
        """Time once more all variants that are not known well enough, `dear` ones last or not; return whether any was."""
        again, rows = self.again, [row for row in self.rows if row.stable and row.variant.axis not in UNTIMED]
        going = [row for row in rows if row is not self.own and len(again[row]) < ROUNDS and not _is_known(again[row], repeats)]
        going = [row for row in going if not self.is_dear(row)] or (going if dear else [])
        if not going or not self.own.stable or (yardstick := self._timing(self.own)) is None:
            return False
        again[self.own].append((*yardstick, yardstick[1]))
        results = {row: self._timing(row) for row in sorted(going, key=lambda row: row.cpu[0])}
        for row, result in results.items():
            again[row] += [(*result, yardstick[1])] if result is not None else []
        return any(result is not None for result in results.values())

    def _timing(self, row: Row) -> tuple[float, float] | None:
        """Return the seconds (wall, processor) of a variant; None where no time is left."""
        if self.round(row) > self.bench.left():
            return None
        began = time.time()
        try:
            wall, cpu = self.bench.call(copies.time_point, self.points[row], LATE * max(row.cpu[0], 1.0))
        except (Overdue, Late, ThirdbodyError):
            return None
        self.timed.append(max(time.time() - began - self.bench.pace * max(cpu, min(BATCH * cpu, ENOUGH)), 0.0))
        return wall, cpu


def _is_known(again: Sequence[tuple[float, float, float]], repeats: int) -> bool:
    needed = repeats_of(min((cpu for _, cpu, _ in again), default=0.0), repeats)
    return len(again) >= needed and timing([cpu / own for _, cpu, own in again if own > 0.0]).relative <= PRECISE
