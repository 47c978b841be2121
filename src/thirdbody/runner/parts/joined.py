"""The run that joins its parts: an integrator that waits for them, and has the state of all bodies at every output."""

from __future__ import annotations

import itertools
import json
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from thirdbody import errors
from thirdbody.atomic_files import write_whole
from thirdbody.engine.energy import Ledger
from thirdbody.engine.independence import coupling
from thirdbody.engine.parts import join, keep_all_rows, ranges
from thirdbody.engine.snapshot import Snapshot, restore
from thirdbody.engine.state import State
from thirdbody.errors import GuardStop, OutputError, ThirdbodyError, UsageError
from thirdbody.runner.output_schedule import targets
from thirdbody.runner.parts import files
from thirdbody.runner.parts.workers import Workers

if TYPE_CHECKING:
    from thirdbody.assembly.simulation import Simulation
    from thirdbody.runner.parts.steps import Bounds

POLL, CALL_EVERY, BEAT_EVERY = 0.02, 0.25, 2.0
"""Wall times [s] between two looks for results, two reports of progress, and two signs of life for the parts."""

ATTEMPTS = 3
"""Number of processes of a part that may die in a row without any progress."""

LEAVE = 30.0
"""Longest wait [s] for the parts to write their checkpoints when a run is interrupted."""


EXPLICIT_MEASURES = "an explicit run adds up its measures at each search, which the fastest of all bodies makes due"
"""Why a run with measures and the explicit integrator is not cut: the last digits of its sums would be others."""


@dataclass(frozen=True)
class Partition:
    """How a run is cut: number of parts, where they are computed, and the files of plug-ins that they need."""

    number: int
    workers: Workers
    plugins: Sequence[str | Path] = ()


class Joined:
    """Stands for the integrator of a whole run whose parts are computed elsewhere; all else is that of the whole."""

    def __init__(self, simulation: Simulation, partition: Partition) -> None:
        self.whole, self.partition, self.state = simulation.integrator, partition, simulation.state
        self.stops = list(targets(simulation))
        self.ledger = Ledger(simulation.state)
        keep_all_rows(simulation.integrator)
        self.at, self.joined, self.saved = 0, -1, -1  # next stop; last stop joined; last stop in a checkpoint

    def begin(self, folder: Path, stop: int) -> None:
        """Have the parts, whose files are in a folder, computed from a stop on."""
        self.parts, self.at = Parts(folder, self.state, self.whole.divisible, self.partition), stop

    def __getattr__(self, name: str) -> Any:
        return getattr(self.whole, name)

    def advance_to(self, time: float, distance: float, watch: Callable[[], None], between: Callable[[], None]) -> None:
        """Wait until all parts have reached a stop, and restore their states into that of the whole run.

        `watch` (of explicit runs, whose ledger is known at outputs only, `between`) is called while it waits. Raises what stopped
        a part.
        """
        meanwhile = between if self.whole.divisible else watch
        while self.stops[self.at][:2] != (time, distance):
            self.at += 1
        if self.stops[self.at][2]:
            captured = join(self.parts.wait(self.at, meanwhile), self.parts.cuts, self.state)
            restore(captured, self.state, self.whole, self.ledger)
            self.whole.sum_up()
            self.joined = self.at
        self.at += 1

    def mean_time(self) -> float:
        """Return the mean time [s] that the parts have reached."""
        return self.parts.mean_time()

    def export_state(self) -> tuple[dict[str, Any], dict[str, Any]]:
        """As that of the whole; called for a checkpoint, after which the states before the last one are not needed any more."""
        self.parts.remove_states(self.saved)
        self.saved = self.joined
        return self.whole.export_state()


class Parts:
    """The parts of a run: started, restarted where their process died, and told to stop."""

    def __init__(self, folder: Path, state: State, explicit: bool, partition: Partition) -> None:
        self.folder, self.workers = folder, partition.workers
        self.cuts = ranges(state, partition.number, explicit)
        self.own = [files.part_folder(folder, k) for k in range(len(self.cuts))]
        self.waiting, self.running = list(range(len(self.cuts))), set[int]()
        self.deaths: dict[int, tuple[int, str]] = {}  # of each part: in a row, at which time
        self.called = 0.0  # when `meanwhile` was called [s]
        self.bounds: Bounds | None = None  # of the time step, on which the parts of an explicit run agree
        self.sizes = [cut.last - cut.first for cut in self.cuts]

    def wait(self, stop: int, meanwhile: Callable[[], None]) -> list[Snapshot]:
        """Return the states of all parts at a stop, in order. Raises what stopped a part before it."""
        left = set(range(len(self.own)))
        while True:
            left -= {k for k in left if files.state_file(self.own[k], stop).exists()}
            if not left:
                return [files.read_state(folder, stop) for folder in self.own]
            failed = sorted(k for k in left if (self.own[k] / files.FAILED).exists())
            waiting = self.bounds.waiting if self.bounds else set()
            if failed and left <= waiting.union(failed):  # no other part can still fail before this stop
                raise self._failure(failed[0])
            self._supervise()
            if time.monotonic() - self.called > CALL_EVERY:
                self.called = time.monotonic()
                meanwhile()
            time.sleep(POLL)

    def _failure(self, part: int) -> ThirdbodyError:
        """Return the error that stopped a part."""
        failure = json.loads((self.own[part] / files.FAILED).read_bytes())
        kind: type[ThirdbodyError] = getattr(errors, failure["kind"], ThirdbodyError)
        return kind(failure["message"])

    def _supervise(self) -> None:
        """Start parts that wait, and start those again whose process died."""
        for k in sorted(self.running):
            how = self.workers.ended(k)
            if how is None:
                continue
            self.running.discard(k)
            if how:
                self._count_death(k, how)
                self.waiting.insert(0, k)
        while self.waiting and len(self.running) < self.workers.at_once:
            k = self.waiting.pop(0)
            self.workers.start(self.folder, k)
            self.running.add(k)

    def _count_death(self, k: int, how: str) -> None:
        """Count a death of a part's process. Raises OutputError after several without progress between them."""
        times, before = self.deaths.get(k, (0, ""))
        now = self._sign(k)
        times = times + 1 if now == before else 1
        self.deaths[k] = times, now
        if times >= ATTEMPTS:
            raise OutputError(f"{self.own[k]}: {how}, {times} times in a row without progress; is there enough memory?")

    def _sign(self, k: int) -> str:
        """Return a text that changes as a part makes progress."""
        with suppress(OSError):
            return str(sorted(path.name for path in self.own[k].glob("state_*.npz"))) + (self.own[k] / files.TIME).read_text()
        return ""

    def mean_time(self) -> float:
        """Return the mean time [s] that the bodies have reached."""
        total = 0.0
        for folder, size in zip(self.own, self.sizes, strict=True):
            with suppress(OSError, ValueError):
                total += size * float((folder / files.TIME).read_text())
        return total / sum(self.sizes)

    def remove_states(self, until: int) -> None:
        """Remove the states of all parts up to a stop."""
        if until >= 0:
            for folder in self.own:
                files.remove_states(folder, until)


def cut(simulation: Simulation, number: int, workers: Workers, plugins: Iterable[str | Path] = ()) -> None:
    """Let a run be computed in so many parts; one part is the whole. Raises UsageError where it cannot be cut."""
    if number < 1:
        raise UsageError(f"parts = {number}: must be at least 1")
    if number == 1:
        return
    explicit = simulation.integrator.divisible
    measured = EXPLICIT_MEASURES if explicit and simulation.choice.measures else ""
    if why := measured or coupling(simulation.state, explicit):
        raise UsageError(f"parts = {number}: this scene cannot be cut into parts: {why}")
    simulation.integrator = Joined(simulation, Partition(number, workers, tuple(plugins)))  # type: ignore[assignment]


@contextmanager
def parts_at_work(simulation: Simulation, run: Path, stop: int, prints: dict[str, str]) -> Iterator[None]:
    """Let the parts of a run that was `cut` compute it from a stop on; does nothing for a run as a whole.

    `prints`: fingerprints of its inputs. Parts in the folder of the run go on where they are. Their files are removed at the end,
    but kept where the run is interrupted.
    """
    joined = simulation.integrator
    if not isinstance(joined, Joined):
        yield
        return
    partition = joined.partition
    folder = files.parts_folder(run)
    scene, above = simulation.requested.to_toml(), str(simulation.requested.beside("").absolute())
    plugins = [str(Path(path).absolute()) for path in partition.plugins]
    job = files.Job(scene, above, plugins, simulation.force, partition.number, prints)
    if files.read_job(folder) != job:
        files.write_job(folder, job)
    for path in (folder / files.HALT, *folder.glob(f"part_*/{files.FAILED}")):
        path.unlink(missing_ok=True)
    joined.begin(folder, stop)
    keep = True
    try:
        with _agreeing(joined, folder), _beating(folder):
            yield
        keep = False
    except GuardStop:
        keep = False
        raise
    finally:
        with suppress(OSError):
            (folder / files.HALT).touch()
        partition.workers.close(LEAVE if keep else 0.0)
        if not keep:
            files.remove_parts(folder)


@contextmanager
def _agreeing(joined: Joined, folder: Path) -> Iterator[None]:
    """Let the parts of an explicit run, all at work at the same time, agree on its time step, unless the scene gives one."""
    if not joined.whole.divisible or joined.whole.fixed is not None:  # type: ignore[union-attr]
        yield
        return
    number, workers = len(joined.parts.own), joined.partition.workers
    if workers.local:
        workers.at_once = number
    elif workers.at_once < number:
        raise UsageError(
            f"parts = {number}: the parts of an explicit run work at the same time, and {workers.at_once} can here; fewer parts, "
            "more workers, or a fixed solver.time_step would do"
        )
    from thirdbody.runner.parts.steps import Bounds  # the bounds of explicit steps are compiled

    with Bounds(folder, number, workers.local) as joined.parts.bounds:
        yield


@contextmanager
def _beating(folder: Path) -> Iterator[None]:
    """Show the parts that the run is alive."""
    end = threading.Event()

    def beat() -> None:
        for count in itertools.count():
            with suppress(OSError):
                write_whole(folder / files.BEAT, str(count).encode())
            if end.wait(BEAT_EVERY):
                return

    thread = threading.Thread(target=beat, daemon=True)
    thread.start()
    try:
        yield
    finally:
        end.set()
        thread.join()


def unfinished_parts(run: Path) -> int:
    """Return the number of parts in which an interrupted run was computed; 1 if it was computed as a whole."""
    job = files.read_job(files.parts_folder(run))
    return 1 if job is None else job.parts
