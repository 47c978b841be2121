"""One part of a run, in a process of its own: `python -m thirdbody.runner.parts.part FOLDER NUMBER`.

It builds the scene, keeps its bodies, and writes its state at every output. It leaves a checkpoint every half minute, and stops
with one when it is told to, when the process that started it ends, or when the run that joins the parts is gone.
"""

from __future__ import annotations

import json
import os
import sys
import time
from collections.abc import Callable
from contextlib import ExitStack, suppress
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from thirdbody.atomic_files import write_whole
from thirdbody.engine.energy import Ledger
from thirdbody.engine.parts import ranges, restrict
from thirdbody.engine.snapshot import Snapshot, restore, snapshot
from thirdbody.errors import InputError, OutputError, ThirdbodyError
from thirdbody.kernels.columns import run_totals
from thirdbody.runner.checkpoint import FILE as CHECKPOINT
from thirdbody.runner.checkpoint import Checkpoint, prints_of, read_checkpoint, write_checkpoint
from thirdbody.runner.folder_lock import lock_folder
from thirdbody.runner.output_schedule import targets
from thirdbody.runner.parts import files
from thirdbody.runner.prepare import prepare, set_threads
from thirdbody.scene.model import Scene

if TYPE_CHECKING:
    from thirdbody.engine.time_step import Bound

CHECKPOINT_EVERY, CHECK_EVERY = 30.0, 0.5
"""Wall times [s] between two checkpoints, and between two looks at whether to stop."""

LOST = 60.0
"""Wall time [s] without a sign of the run that joins the parts after which a part stops."""

PATIENCE = 90.0
"""Longest wait [s] for an earlier process of the same part to end."""


class Halted(Exception):
    """The part was told to stop."""


class Watch:
    """Tells whether the part has to stop: on demand, or because nobody is left to join its results."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.parent = folder, os.getppid()
        self.checked, self.beat, self.beat_at = -1.0, b"", time.monotonic()

    def due(self) -> bool:
        """Return whether half a second has passed since the last look."""
        return time.monotonic() - self.checked > CHECK_EVERY

    def halted(self) -> bool:
        """Look, and return whether the part has to stop."""
        self.checked = time.monotonic()
        beat = b""
        with suppress(OSError):
            beat = (self.folder / files.BEAT).read_bytes()
        if beat != self.beat:
            self.beat, self.beat_at = beat, self.checked
        return (self.folder / files.HALT).exists() or os.getppid() != self.parent or self.checked - self.beat_at > LOST


class Part:
    """One part of a run: the restricted simulation, and its files."""

    def __init__(self, folder: Path, number: int) -> None:
        job = files.read_job(folder)
        if job is None:
            raise InputError(f"{folder}: is not the folder of the parts of a run")
        self.job, self.own, self.watch = job, files.part_folder(folder, number), Watch(folder)
        set_threads(1)
        scene = Scene.parse(job.scene, str(folder / files.JOB), job.folder, job.plugins)
        self.simulation = prepare(scene, job.plugins, job.force)
        state, integrator = self.simulation.state, self.simulation.integrator
        self.ledger = Ledger(state)
        restrict(state, integrator, self.ledger, ranges(state, job.parts, integrator.divisible)[number])
        self.prints, self.reached, self.written = prints_of(self.simulation), 0, time.monotonic()
        if integrator.divisible and integrator.fixed is None:  # type: ignore[union-attr]
            integrator.agree = self._agreement(folder, number)  # type: ignore[union-attr]

    def go_on(self) -> None:
        """Restore the checkpoint of an earlier process, if there is one. Raises InputError."""
        if not (self.own / CHECKPOINT).exists():
            return
        saved = read_checkpoint(self.own)
        if saved.prints != self.prints:
            raise InputError(f"{self.own}: built from something else than before, so this part cannot go on bit for bit")
        restore(saved.snapshot, self.simulation.state, self.simulation.integrator, self.ledger)
        self.reached = saved.stop

    def integrate(self) -> None:
        """Integrate to the end, and write the state at every output. Raises ThirdbodyError and Halted."""
        integrator = self.simulation.integrator
        for end, distance, is_output in islice(targets(self.simulation), self.reached, None):
            if is_output or integrator.divisible:
                integrator.advance_to(end, distance, self._between, self._between)
            if is_output and not files.state_file(self.own, self.reached).exists():
                files.write_state(self.own, self.reached, self._snapshot())
            if is_output and self.simulation.state.part_deposits:
                self.simulation.state.part_deposits.clear(integrator.totals[:, run_totals.STEPS])  # type: ignore[union-attr]
            self.reached += 1
            self._between()
        self._save()

    def _agreement(self, folder: Path, number: int) -> Callable[[Bound], Bound]:
        """Return the function that agrees with the other parts on the bound of the time step."""
        from thirdbody.engine.explicit import BUDGET  # imported here: an implicit run would compile explicit steps
        from thirdbody.runner.parts.steps import CommonBound

        common, state = CommonBound(folder, number, self._check), self.simulation.state

        def agree(own: Bound) -> Bound:
            try:
                return common.agree(int(state.A[run_totals.STEPS]) // BUDGET - 1, own)
            except (OSError, EOFError):  # the run that joins the parts is gone
                raise Halted from None

        return agree

    def _check(self) -> None:
        """Stop if the part has to, without a checkpoint: its step is not chosen."""
        if self.watch.halted():
            raise Halted

    def _snapshot(self) -> Snapshot:
        return snapshot(self.simulation.state, self.simulation.integrator, self.ledger)

    def _between(self) -> None:
        """Stop if the part has to, and write the time it has reached and a checkpoint now and then."""
        if not self.watch.due():
            return
        integrator, state = self.simulation.integrator, self.simulation.state
        reached = state.time if integrator.divisible else integrator.mean_time()  # type: ignore[union-attr]
        with suppress(OSError):
            write_whole(self.own / files.TIME, f"{reached:.17g}".encode())
        halted = self.watch.halted()
        if halted or time.monotonic() - self.written > CHECKPOINT_EVERY:
            self._save()
        if halted:
            raise Halted

    def _save(self) -> None:
        write_checkpoint(self.own, Checkpoint(
            self.job.scene, self.job.folder, self.prints, 0, self.reached, 0.0, self.job.force, 0, np.zeros(7), self._snapshot()
        ))  # fmt: skip
        self.written = time.monotonic()


def run_part(folder: Path, number: int) -> None:
    """Run a part to its end; a ThirdbodyError is written to its file `failed.json`."""
    own = files.part_folder(folder, number)
    with suppress(FileExistsError):
        own.mkdir()
    with _locked(own):
        part = None
        try:
            part = Part(folder, number)
            part.go_on()
            part.integrate()
        except Halted:
            pass
        except ThirdbodyError as error:
            failure = {"stop": part.reached if part else 0, "kind": type(error).__name__, "message": str(error)}
            write_whole(own / files.FAILED, json.dumps(failure).encode())


def _locked(own: Path) -> ExitStack:
    """Lock the folder of a part, once an earlier process of it has ended. Raises OutputError if it does not end."""
    until = time.monotonic() + PATIENCE
    while True:
        lock = ExitStack()
        try:
            lock.enter_context(lock_folder(own))
            return lock
        except OutputError:
            if time.monotonic() > until:
                raise
            time.sleep(CHECK_EVERY)


if __name__ == "__main__":
    run_part(Path(sys.argv[1]), int(sys.argv[2]))
