"""Resume of a run from its checkpoint: after an interruption, or to make it longer."""

from __future__ import annotations

import math
import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from thirdbody.errors import Fault, InputError
from thirdbody.runner.checkpoint import FILE as CHECKPOINT
from thirdbody.runner.checkpoint import THE_INTEGRATOR, THE_VERSION, Checkpoint, prints_of, read_checkpoint
from thirdbody.runner.prepare import check_call, check_threads, prepare
from thirdbody.runner.progress import Reporter
from thirdbody.runner.run_folder import SCENE_FILE, refuse_links
from thirdbody.runner.simulate import run_with_warnings
from thirdbody.scene.model import Scene
from thirdbody.scene.tables import Solver
from thirdbody.schema.read import read_text
from thirdbody.trajectory.reader import FILE_NAME, Run, open_run

if TYPE_CHECKING:
    from thirdbody.assembly.simulation import Simulation

LONGER = ("solver.distance", "solver.duration")
"""Keys that may differ from the first part of the run: its length."""


def resume(
    out: str | Path | Run,
    threads: int | None = None,
    progress: bool | Reporter = True,
    *,
    settings: Mapping[str, Any] | None = None,
    plugins: Iterable[str | Path] = (),
) -> Run:
    """Continue a run to its end and return the opened result, bit for bit that of an uninterrupted run.

    Parameters
    ----------
    out : str, Path or Run
        Folder of the run, its file run.vtkhdf, or a `Run`, whose open files stay readable.
    threads, progress
        As for `run`.
    settings : dict, optional
        A longer `solver.distance` or `solver.duration`, with which a finished run goes on. Its old end remains a stop, which ends
        steps of the implicit integrator: where it is an output of the longer scene, the bits are those of that scene.
    plugins : iterable of str or Path
        Python files that the run was started with.

    Returns
    -------
    Run

    Raises
    ------
    InputError
        There is no valid checkpoint, or the scene, a law or an input file has changed.
    UsageError, OutputError, GuardStop, Interrupted
        As for `run`.

    Examples
    --------
    >>> run = thirdbody.resume("runs/example", progress=False, settings={"solver.distance": "0.2 um"})
    >>> run.summary()["distance"] > 0.19e-6
    True
    """
    check_call(plugins, progress)
    folder = _folder_of(out)
    notes = check_threads(threads)
    simulation, saved = prepare_resume(folder, settings or {}, plugins)
    return run_with_warnings(simulation, folder, threads, progress, notes, checkpoint=saved)


def _folder_of(run: str | Path | Run) -> Path:
    path = run.path if isinstance(run, Run) else Path(run)
    return path.parent if path.name == FILE_NAME else path


def prepare_resume(
    folder: Path, settings: Mapping[str, Any] | None = None, plugins: Iterable[str | Path] = ()
) -> tuple[Simulation, Checkpoint]:
    """Return the simulation of a run, built again, and the checkpoint to restore. Raises InputError."""
    if not os.path.isdir(folder):  # unlike Path.is_dir, False for a name that is too long
        raise InputError(f"{folder}: no such folder; give that of a run")
    refuse_links(folder)
    saved = read_checkpoint(folder)
    plugins = tuple(plugins)
    before, scene = _scenes(folder, saved, settings or {}, plugins)
    if saved.frames:
        with open_run(folder) as run:
            if run.frames < saved.frames:
                message = f"has {run.frames} frames, and the checkpoint was written after {saved.frames}"
                raise InputError(f"{folder / FILE_NAME}: {message}")
    simulation = prepare(scene, plugins, saved.force, saved.prints.get(THE_INTEGRATOR, ""))
    now = prints_of(simulation)
    _refuse_other(folder, saved.prints, now)
    if saved.prints.get(THE_VERSION) != now[THE_VERSION]:
        simulation.warnings.append("taken up by another version of thirdbody or numba than before: not bit for bit the same run")
    if extended := saved.settling.get("extended"):
        simulation.extend_settling(extended)
    if before.solver != scene.solver:  # a longer run
        saved.stop = _stops(saved, simulation)
    return simulation, saved


def _scenes(
    folder: Path, checkpoint: Checkpoint, settings: Mapping[str, Any], plugins: Iterable[str | Path] = ()
) -> tuple[Scene, Scene]:
    """Return the scene of the checkpoint, and the one to continue with, which may differ in its length only."""
    path = folder / SCENE_FILE
    before = Scene.parse(checkpoint.scene, str(folder / CHECKPOINT), checkpoint.folder, plugins)
    now = Scene.parse(read_text(path), str(path), checkpoint.folder, plugins) if path.is_file() else before
    now = now.with_settings(settings) if settings else now
    changes = [
        Fault(key, f"was {old}, is {new}")
        for key, old, new in _differences(before.document(), now.document())
        if key not in LONGER
    ]
    if changes:
        what = Fault("", "the scene has changed, so this run cannot go on; run it anew into another folder", str(folder))
        raise InputError([what, *changes])
    _refuse_shorter(folder, before.solver, now.solver)
    return before, now


def _refuse_shorter(folder: Path, before: Solver, solver: Solver) -> None:
    """Raise InputError for a run that would end before its current end, or by duration, not distance."""
    for key, old, new in (("distance", before.distance, solver.distance), ("duration", before.duration, solver.duration)):
        if (old is None) != (new is None):
            raise InputError(f"{folder}: solver.{key}: a run by distance goes on by distance, one by duration by duration")
        if old is not None and new is not None and new < old:
            raise InputError(f"{folder}: solver.{key}: {new:g} is less than the {old:g} of this run (SI); it may only grow")


def _differences(old: Any, new: Any, key: str = "") -> list[tuple[str, Any, Any]]:
    """Return (key, old, new) wherever two documents differ; a missing value is reported as absent."""
    if isinstance(old, Mapping) and isinstance(new, Mapping):
        names = [*old, *(name for name in new if name not in old)]
        paths = {name: f"{key}.{name}" if key else str(name) for name in names}
        return [d for n in names for d in _differences(old.get(n, "absent"), new.get(n, "absent"), paths[n])]
    if isinstance(old, list) and isinstance(new, list) and len(old) == len(new):
        return [d for k, pair in enumerate(zip(old, new, strict=True)) for d in _differences(*pair, f"{key}[{k}]")]
    return [] if old == new else [(key, old, new)]


def _refuse_other(folder: Path, before: Mapping[str, str], now: Mapping[str, str]) -> None:
    """Raise InputError if the run would be built from other inputs than before."""
    names = [name for name in now if name != THE_VERSION and before.get(name) != now[name]]
    changes = [Fault(name, f"was {before.get(name)}, is {now[name]}") for name in names]
    if changes:
        what = Fault("", "built from something else than before, so this run cannot go on bit for bit", str(folder))
        raise InputError([what, *changes])


EVEN = 1.0 + 1e-9
"""Factor for rounding in the test whether the clock has reached a stop."""


def _stops(checkpoint: Checkpoint, simulation: Simulation) -> int:
    """Return how many targets of a longer run are reached; its last output may be at another time."""
    from thirdbody.runner.output_schedule import targets

    longer = list(targets(simulation))
    time, distance = _reached(checkpoint)
    return sum(1 for t, x, _ in longer if t <= time * EVEN or x <= distance * EVEN)


def _reached(checkpoint: Checkpoint) -> tuple[float, float]:
    """Return time [s] and distance [m] of a checkpoint."""
    from thirdbody.kernels.tables import run_totals

    A = checkpoint.snapshot.arrays["A"]
    return float(A[run_totals.TIME]), float(A[run_totals.DISTANCE]) or -math.inf
