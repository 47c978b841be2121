"""Resume of a run from its checkpoint: after an interruption, or to make it longer."""

from __future__ import annotations

import math
import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from thirdbody.errors import Fault, InputError
from thirdbody.kernels.tables import run_totals
from thirdbody.runner.checkpoint import FILE as CHECKPOINT
from thirdbody.runner.checkpoint import THE_INTEGRATOR, THE_VERSION, Checkpoint, prints_of, read_checkpoint
from thirdbody.runner.run_folder import SCENE_FILE, refuse_links
from thirdbody.runner.simulate import prepare
from thirdbody.runner.stops import EVEN, targets
from thirdbody.scene.model import Scene
from thirdbody.schema.parts import differences
from thirdbody.schema.read import read_text
from thirdbody.trajectory.open_file import FILE_NAME
from thirdbody.trajectory.run_file import RunFile

if TYPE_CHECKING:
    from thirdbody.assembly.simulation import Simulation

LONGER = ("solver.distance", "solver.duration")
"""Keys that may differ from the first part of the run: its length."""


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
        with RunFile(folder) as run:
            if run.frames < saved.frames:
                message = f"has {run.frames} frames, and the checkpoint was written after {saved.frames}"
                raise InputError(f"{folder / FILE_NAME}: {message}")
    simulation = prepare(scene, plugins, saved.force, saved.prints.get(THE_INTEGRATOR, ""))
    now = prints_of(simulation)
    names = [name for name in now if name != THE_VERSION and saved.prints.get(name) != now[name]]
    if names:
        what = Fault("", "built from something else than before, so this run cannot go on bit for bit", str(folder))
        raise InputError([what, *(Fault(name, f"was {saved.prints.get(name)}, is {now[name]}") for name in names)])
    if saved.prints.get(THE_VERSION) != now[THE_VERSION]:
        simulation.warnings.append("taken up by another version of thirdbody or numba than before: not bit for bit the same run")
    if extended := saved.settling.get("extended"):
        simulation.extend_settling(extended)
    if before.solver != scene.solver:  # a longer run: its last output may be at another time
        A = saved.snapshot.arrays["A"]
        time, distance = float(A[run_totals.TIME]), float(A[run_totals.DISTANCE]) or -math.inf
        saved.stop = sum(1 for t, x, _ in targets(simulation) if t <= time * EVEN or x <= distance * EVEN)
    return simulation, saved


def _scenes(
    folder: Path, checkpoint: Checkpoint, settings: Mapping[str, Any], plugins: Iterable[str | Path]
) -> tuple[Scene, Scene]:
    path = folder / SCENE_FILE
    before = Scene.parse(checkpoint.scene, str(folder / CHECKPOINT), checkpoint.folder, plugins)
    now = Scene.parse(read_text(path), str(path), checkpoint.folder, plugins) if path.is_file() else before
    now = now.with_settings(settings)
    pairs = differences(before.document(), now.document()).items()
    changes = [Fault(key, f"was {old}, is {new}") for key, (old, new) in pairs if key not in LONGER]
    if changes:
        what = Fault("", "the scene has changed, so this run cannot go on; run it anew into another folder", str(folder))
        raise InputError([what, *changes])
    old, new = before.solver, now.solver
    for key, was, wanted in (("distance", old.distance, new.distance), ("duration", old.duration, new.duration)):
        if (was is None) != (wanted is None):
            raise InputError(f"{folder}: solver.{key}: a run by distance goes on by distance, one by duration by duration")
        if was is not None and wanted is not None and wanted < was:
            raise InputError(f"{folder}: solver.{key}: {wanted:g} is less than the {was:g} of this run (SI); it may only grow")
    return before, now
