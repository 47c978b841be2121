"""Rate test of a run: its last third once more with a slower plate, a run of its own in a folder inside that of the run."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from thirdbody.assembly.rate_test import SlowedSimulation, added_time, slow_down
from thirdbody.errors import InputError
from thirdbody.kernels.columns import run_totals
from thirdbody.runner.checkpoint import THE_RATE_TEST, THE_VERSION, Checkpoint, read_checkpoint
from thirdbody.runner.progress import Progress, Reporter
from thirdbody.runner.run_folder import old_run_folder
from thirdbody.runner.run_loop import RunLoop, WallTimes
from thirdbody.trajectory.open_file import RATE_TEST
from thirdbody.trajectory.reader import open_run

if TYPE_CHECKING:
    from thirdbody.assembly.simulation import Simulation


@contextmanager
def rate_test_loop(
    simulation: Simulation, run: RunLoop, report: Reporter | None
) -> Iterator[tuple[SlowedSimulation, RunLoop, Checkpoint]]:
    """Yield the slowed simulation of a finished run, its loop, and the checkpoint from which its rate test begins or goes on.

    `report`: of run and rate test together. Raises InputError without a checkpoint that fits.
    """
    factor = simulation.scene.solver.rate_test
    assert factor is not None
    folder = run.folder / RATE_TEST
    with old_run_folder(folder) as files:
        checkpoint = read_checkpoint(folder)
        prints = run.prints | {THE_RATE_TEST: f"{factor:g}", THE_VERSION: checkpoint.prints[THE_VERSION]}
        if checkpoint.prints != prints or checkpoint.scene != run.text:  # of another version it may be, as the run
            raise InputError(f"{folder}: this is the rate test of another run; run the scene again")
        slowed = slow_down(simulation, _changeover(checkpoint, folder), factor)
        times = WallTimes(run.every, run.wall_limit - (run.wall_time() - run.before))
        loop = RunLoop(slowed, files, _second_part(report, slowed), run.stop, times)
        loop.prints, loop.resumed_as = prints, run.folder
        yield slowed, loop, checkpoint


def _changeover(checkpoint: Checkpoint, folder: Path) -> float:
    """Return the time [s] at which the plate becomes slower: that of the first frame of the rate test."""
    if not checkpoint.frames:
        return float(checkpoint.snapshot.arrays["A"][run_totals.TIME])
    with open_run(folder) as run:
        return float(run.times[0])


def first_part(report: Reporter | None, simulation: Simulation) -> Reporter | None:
    """Return the reporter of a run: where a rate test follows, the run is the first part of the whole."""
    if report is None or simulation.scene.solver.rate_test is None:
        return report
    fraction = _fraction_of_run(simulation)
    return lambda progress: report(replace(progress, fraction=fraction * progress.fraction))


def _second_part(report: Reporter | None, slowed: SlowedSimulation) -> Reporter | None:
    """Return the reporter of a rate test: the second part of the whole."""
    if report is None:
        return None
    fraction, start, end = _fraction_of_run(slowed.whole), slowed.changeover, slowed.planned_time

    def second(progress: Progress) -> None:
        done = min((progress.simulated - start) / (end - start), 1.0)
        report(replace(progress, fraction=fraction + (1.0 - fraction) * done))

    return second


def _fraction_of_run(simulation: Simulation) -> float:
    """Return the fraction of the run in the simulated time of run and rate test."""
    return simulation.planned_time / (simulation.planned_time + added_time(simulation))
