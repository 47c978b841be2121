"""The loop of a run over its stops: frames, progress, checkpoints."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from itertools import islice
from shlex import quote
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from thirdbody.engine.guards import EnergyGuard, Ledger, stored_energies
from thirdbody.engine.measures import reset_means
from thirdbody.engine.snapshot import check, restore, snapshot
from thirdbody.errors import InputError, Interrupted, OutputError
from thirdbody.runner.checkpoint import FILE as CHECKPOINT
from thirdbody.runner.checkpoint import THE_VERSION, Checkpoint, prints_of, write_checkpoint
from thirdbody.runner.measurements import PeakPressure, frame_maker
from thirdbody.runner.progress import Progress, Reporter
from thirdbody.runner.run_folder import RunFolder
from thirdbody.runner.stops import Settling, targets
from thirdbody.system.processes import keep_freed_memory
from thirdbody.trajectory.frame import impulses_of
from thirdbody.trajectory.writer import TrajectoryWriter

if TYPE_CHECKING:
    from thirdbody.assembly.simulation import Simulation
    from thirdbody.engine.implicit import Implicit

CHECKPOINT_EVERY = 30.0
"""Shortest wall time between two checkpoints [s]."""

MIN_INTERVAL_OVER_COST = 20.0
"""Shortest wall time between checkpoints over the cost of the last one: at most a twentieth is spent."""

REPORT_EVERY = 0.5
"""Shortest wall time between two reports of progress, but for those of a frame [s]: one goes through all bodies."""

LARGE = 20_000
"""Bodies of a run whose frames make tables that the C library would return to the system."""


@dataclass(frozen=True)
class WallTimes:
    """Shortest wall time between two checkpoints, and that after which a run stops with one [s]."""

    every: float = CHECKPOINT_EVERY
    limit: float = math.inf


class RunLoop:
    """Run loop of a built simulation, with its counters."""

    def __init__(
        self, simulation: Simulation, files: RunFolder, report: Reporter | None = None, stop: Callable[[], bool] = lambda: False,
        times: WallTimes = WallTimes(),
    ) -> None:  # fmt: skip
        self.simulation, self.files, self.report, self.stop = simulation, files, report, stop
        self.folder = files.path
        self.every, self.wall_limit = times.every, times.limit
        self.started, self.before, self.reached, self.cost = time.perf_counter(), 0.0, 0, 0.0
        self.written = self.reported = self.started
        self.limit = ""
        self.series: dict[str, Any] = {}  # those of the last frame
        self.ledger = Ledger(simulation.state)
        self.settling = Settling(simulation, self._begin_drag)
        self.energy_guard = EnergyGuard(self.ledger, 2 if simulation.integrator.divisible else 1)
        self.pressure = PeakPressure(simulation)
        self.maker = frame_maker(simulation, self.ledger)
        self.maker.watch, self.means = self.pressure.update, self.maker.means
        self.text, self.prints = simulation.requested.to_toml(), prints_of(simulation)

    def restore(self, checkpoint: Checkpoint) -> None:
        """Restore a checkpoint. Raises InputError where it does not fit."""
        state = self.simulation.state
        try:
            restore(checkpoint.snapshot, state, self.simulation.integrator, self.ledger)
            if self.means:
                self.means.restore(checkpoint.means)
            check({"impulses": checkpoint.impulses}, {"impulses": self.maker.impulses})
            self.settling.restore(checkpoint.settling)
            self.pressure.restore(checkpoint.pressure)
        except (ValueError, KeyError, TypeError, IndexError) as error:
            raise InputError(f"{self.folder / CHECKPOINT}: does not fit this scene ({error})") from error
        # those of the scene as it was built, before its settling was extended
        self.prints = checkpoint.prints | {THE_VERSION: self.prints[THE_VERSION]}
        self.maker.impulses = checkpoint.impulses.copy()
        self.series, self.maker.interval = checkpoint.series, checkpoint.interval
        self.reached, self.before, self.energy_guard.above = checkpoint.stop, checkpoint.wall_time, checkpoint.violations

    def wall_time(self) -> float:
        """Return the wall time of the run so far [s], including that before a resume."""
        return self.before + time.perf_counter() - self.started

    def integrate(self, writer: TrajectoryWriter) -> None:
        """Integrate to the end, output by output. Raises GuardStop and Interrupted."""
        simulation, integrator = self.simulation, self.simulation.integrator
        self.writer = writer
        if simulation.state.n_bodies >= LARGE:
            keep_freed_memory()
        if not writer.frames:
            self.export_state()  # before the first frame: a run that is killed at once can be resumed too
            self._write()
        for target in islice(targets(simulation), self.reached, None):
            self.settling.advance(target, lambda time, path: integrator.advance_to(time, path, self._watch, self._stop_or_save))
            if self.settling.wears(target):  # before its frame, which shows the plates as they are then
                simulation.state.wear.take(integrator)
            self.reached += 1
            # one explicit step may pass several outputs
            if target[2] and simulation.state.time > self.series["time"]:
                self._write()
            elif integrator.divisible:
                self._report_progress({})
            self._stop_or_save()
        self.export_state()

    def _begin_drag(self) -> None:
        """Have means over time, and over the output interval, begin with the drag, and wear that changes the plates."""
        reset_means(self.simulation.state)
        if self.simulation.state.wear:
            self.simulation.state.wear.begin()
        self.maker.impulses = impulses_of(self.simulation.state)
        if self.means:
            self.means.finish()

    def export_state(self) -> None:
        """Write a checkpoint of the present state, without copies."""
        begun = time.perf_counter()
        saved = snapshot(self.simulation.state, self.simulation.integrator, self.ledger)
        folder = str(self.simulation.scene.beside("").absolute())
        checkpoint = Checkpoint(
            self.text, folder, self.prints, self.writer.frames, self.reached, self.wall_time(), self.simulation.force,
            self.energy_guard.above, np.array(self.maker.impulses), saved, self.means.export_state() if self.means else {},
            self.pressure.export_state(), {name: np.asarray(value).tolist() for name, value in self.series.items()},
            self.maker.interval, self.settling.export_state(),
        )  # fmt: skip
        self.writer.sync()
        self.files.check()
        write_checkpoint(self.files.work_folder, checkpoint, self.folder)
        self.written = time.perf_counter()
        self.cost = self.written - begun

    def _watch(self) -> None:
        """Check the energy and sample, at instants independent of the wall time since both belong to the result."""
        integrator, state = self.simulation.integrator, self.simulation.state
        if integrator.divisible and getattr(integrator, "independent", False):  # its ledger takes in outputs only
            self.energy_guard.check(state, stored_energies(state))
        elif integrator.divisible:
            self.energy_guard.check(state, self.ledger.watch(state))
        elif getattr(integrator, "together", False):  # totals are summed at stops only
            self.ledger.watch(state)
        # bodies with their own step lengths have a common energy at stops only
        if not integrator.divisible and time.perf_counter() - self.reported > REPORT_EVERY:
            self._report_progress({})
        if self.means:
            self.means.watch()
        self._stop_or_save()

    def _stop_or_save(self) -> None:
        """Stop on a signal or at the limit of wall time, or write a checkpoint, between compiled calls."""
        now = time.perf_counter()
        if now - self.started > self.wall_limit:
            self._leave("stopped by the limit of wall time")
        if self.stop():
            self._leave("interrupted")
        if now - self.written > max(self.every, MIN_INTERVAL_OVER_COST * self.cost):
            self.export_state()

    def stop_before_going_on(self) -> None:
        """Stop on a signal while the earlier part of a run is read; it and its checkpoint stay unchanged."""
        if self.stop():
            error = self._interrupted("interrupted before it went on; its checkpoint and frames are as they were")
            error.advanced = False
            raise error

    def _leave(self, why: str) -> None:
        self.export_state()
        raise self._interrupted(f"{why} at t = {self.simulation.state.time:.6g} s; {self.writer.frames} frames are kept")

    def _interrupted(self, what: str) -> Interrupted:
        folder = str(self.folder)
        return Interrupted(
            what, python=f"; to go on: thirdbody.resume({folder!r})", command=f"; to go on: thirdbody resume {quote(folder)}"
        )

    def _write(self) -> None:
        simulation = self.simulation
        stored = self.ledger.watch(simulation.state)
        frame = self.maker.frame(simulation.integrator.label() if simulation.labeller else None, stored)
        try:
            self.writer.append(frame)
        except ValueError as error:  # a resumed run whose file holds other arrays than it wrote
            raise OutputError(f"{self.folder}: the trajectory is damaged, so the run cannot go on: {error}") from error
        if not self.files.usable:
            self.writer.sync()  # the run that it replaces is lost then
            self.files.publish()
        self._report_progress(dict(frame.series))
        # after the frame, which shows what went wrong
        self.energy_guard.check(simulation.state, stored)
        if slow := self._implicit():
            slow.refuse_created_energy()

    def _report_progress(self, series: dict[str, Any]) -> None:
        self.series = series or self.series
        if self.report is not None:
            slow = self._implicit()
            simulated = slow.mean_time() if slow else self.simulation.state.time
            fraction = min(simulated / self.simulation.planned_time, 1.0)
            if slow and series:  # it goes through all steps of all bodies
                self.limit = slow.describe_limit()
            self.report(Progress(fraction, simulated, self.wall_time(), self.writer.frames, self.series, self.limit))
            self.reported = time.perf_counter()

    def _implicit(self) -> Implicit | None:
        integrator = self.simulation.integrator
        return None if integrator.divisible else cast("Implicit", integrator)
