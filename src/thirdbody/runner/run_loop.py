"""Conducting a run from stop to stop: frames, progress, and the checkpoints that it can go on from."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from itertools import islice
from shlex import quote
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from thirdbody.engine.energy import Ledger
from thirdbody.engine.guards import EnergyGuard
from thirdbody.engine.snapshot import put, snapshot
from thirdbody.errors import InputError, Interrupted, OutputError
from thirdbody.runner.checkpoint import Checkpoint, prints_of, write_checkpoint
from thirdbody.runner.output_schedule import targets
from thirdbody.runner.progress import Progress, Reporter
from thirdbody.runner.run_folder import RunFolder
from thirdbody.runner.yield_check import PeakPressure
from thirdbody.trajectory.frame import FrameMaker
from thirdbody.trajectory.writer import TrajectoryWriter

if TYPE_CHECKING:
    from thirdbody.assembly.simulation import Simulation
    from thirdbody.engine.implicit import Implicit

CHECKPOINT_EVERY = 30.0
"""Seconds of wall time between two checkpoints, at least."""

SHARE = 20.0
"""Wall time between two checkpoints, at least, in times that the last one took: they cost no more than a twentieth."""


class Conduct:
    """A built simulation on its way, with what is counted along it."""

    def __init__(
        self, simulation: Simulation, files: RunFolder, report: Reporter | None = None, stop: Callable[[], bool] = lambda: False,
        every: float = CHECKPOINT_EVERY, wall_limit: float = math.inf,
    ) -> None:  # fmt: skip
        self.simulation, self.files, self.report, self.stop = simulation, files, report, stop
        self.folder = files.path
        self.every, self.wall_limit = every, wall_limit
        self.started, self.before, self.reached, self.cost = time.perf_counter(), 0.0, 0, 0.0
        self.written = self.started
        self.series: dict[str, Any] = {}  # those of the last frame
        self.ledger = Ledger(simulation.state)
        self.looks = EnergyGuard(self.ledger, 2 if simulation.integrator.divisible else 1)
        self.pressure = PeakPressure(simulation)
        self.maker = FrameMaker(
            simulation.state, self.ledger, simulation.labeller, simulation.integrator.drag, self.pressure.hertz
        )
        self.text, self.prints = simulation.scene.to_toml(), prints_of(simulation)

    def take_up(self, kept: Checkpoint) -> None:
        """Go on from a checkpoint. Raises InputError where it does not fit, with the simulation as it was."""
        state = self.simulation.state
        try:
            put(kept.snapshot, state, self.simulation.integrator, self.ledger)
        except (ValueError, KeyError, TypeError) as error:
            raise InputError(f"{self.folder}: the checkpoint does not fit this scene ({error})") from error
        self.maker.impulses = kept.impulses.copy()
        self.reached, self.before, self.looks.above = kept.stop, kept.wall_time, kept.looks

    def wall_time(self) -> float:
        """Wall time of the run so far, s, with that before it was taken up."""
        return self.before + time.perf_counter() - self.started

    def integrate(self, writer: TrajectoryWriter) -> None:
        """Bring the simulation to its end, output by output. Raises GuardStop and Interrupted."""
        simulation, integrator = self.simulation, self.simulation.integrator
        self.writer = writer
        if not writer.frames:
            self.keep()  # before the first frame: a run that is killed at once can be taken up too
            self._write()
        for target_time, target_distance, is_output in islice(targets(simulation), self.reached, None):
            if is_output or integrator.divisible:
                integrator.advance_to(target_time, target_distance, self._watch, self._stop_or_save)
            self.reached += 1
            if is_output and self._moved():
                self._write()
            elif integrator.divisible:
                self._tell({})
            self._stop_or_save()
        self.keep()

    def _moved(self) -> bool:
        """Whether time has passed since the last frame: an explicit step may pass several outputs, and they are one frame."""
        return self.simulation.state.time > self.maker.impulses[0]

    def keep(self) -> None:
        """Write a checkpoint."""
        begun = time.perf_counter()
        saved = snapshot(self.simulation.state, self.simulation.integrator, self.ledger)
        self.writer.sync()
        self.files.check()
        folder = str(self.simulation.scene.beside("").absolute())
        write_checkpoint(self.files.place, Checkpoint(
            self.text, folder, self.prints, self.writer.frames, self.reached, self.wall_time(), self.simulation.force,
            self.looks.above, np.array(self.maker.impulses), saved,
        ), self.folder)  # fmt: skip
        self.written = time.perf_counter()
        self.cost = self.written - begun

    def _watch(self) -> None:
        """At instants that do not depend on the wall time: what is judged and noted here belongs to the result."""
        integrator, state = self.simulation.integrator, self.simulation.state
        if integrator.divisible:
            self.looks.look(state, self.ledger.watch(state))
        elif getattr(integrator, "together", False):  # totals are summed up at stops only
            self.ledger.watch(state)
        # bodies that go each at a time of its own have no energy in common but at stops
        if not integrator.divisible:
            self._tell({})
        self._stop_or_save()

    def _stop_or_save(self) -> None:
        """Between compiled calls: stop on a signal or at the limit of wall time, and write a checkpoint when one is due."""
        now = time.perf_counter()
        if now - self.started > self.wall_limit:
            self._leave("stopped by the limit of wall time")
        if self.stop():
            self._leave("interrupted")
        if now - self.written > max(self.every, SHARE * self.cost):
            self.keep()

    def stop_before_going_on(self) -> None:
        """While what an earlier part has written is read and copied: a signal leaves it, and its checkpoint, as they are."""
        if self.stop():
            error = self._interrupted("interrupted before it went on; its checkpoint and frames are as they were")
            error.advanced = False
            raise error

    def _leave(self, why: str) -> None:
        self.keep()
        raise self._interrupted(f"{why} at t = {self.simulation.state.time:.6g} s; {self.writer.frames} frames are kept")

    def _interrupted(self, what: str) -> Interrupted:
        """The error that says how to go on."""
        folder = str(self.folder)
        return Interrupted(
            what,
            python=f"; to go on: thirdbody.resume({folder!r})",
            command=f"; to go on: thirdbody resume {quote(folder)}",
        )

    def _write(self) -> None:
        """A frame of this instant."""
        simulation = self.simulation
        frame = self.maker.frame(simulation.integrator.label() if simulation.labeller else None)
        try:
            self.writer.append(frame)
        except ValueError as error:  # a run that is gone on with, whose file holds other arrays than it wrote
            raise OutputError(f"{self.folder}: the trajectory is damaged, so the run cannot go on: {error}") from error
        if not self.files.usable:
            self.writer.sync()  # what it takes the place of is lost then
            self.files.publish()
        self.pressure.look(frame.contacts)
        self._tell(dict(frame.series))
        # after the frame, which shows what went wrong
        self.looks.look(simulation.state, self.ledger.watch(simulation.state))
        if slow := self._implicit():
            slow.refuse_made_energy()

    def _tell(self, series: dict[str, Any]) -> None:
        """Tell the progress so far."""
        self.series = series or self.series
        if self.report is not None:
            slow = self._implicit()
            simulated = slow.mean_time() if slow else self.simulation.state.time
            fraction = min(simulated / self.simulation.planned_time, 1.0)
            limit = slow.tell_limit() if slow else ""
            self.report(Progress(fraction, simulated, self.wall_time(), self.writer.frames, self.series, limit))

    def _implicit(self) -> Implicit | None:
        """The integrator if it is the implicit one; its class is not imported here, for that compiles the steps."""
        integrator = self.simulation.integrator
        return None if integrator.divisible else cast("Implicit", integrator)
