"""The copy of a scene that a ladder is climbed with, fitted to a budget of time, and the ladder."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from thirdbody.errors import OutputError
from thirdbody.scene import units
from thirdbody.scene.model import File, Mesh, Scene

from .budget import fitting, probed
from .ladder import Base, Rung, ladder, springs_option
from .process import RUNGS, SCENE_FILE, in_process
from .reduce import SECONDS, reduced, seconds_of

if TYPE_CHECKING:
    from thirdbody.scene.build import Simulation

SAME = 0.1
"""How far the share of the copy that fits may be from 1 before another copy is made."""


@dataclass(frozen=True)
class Stage:
    """What is climbed. `reduction`: what the copy leaves out, in words; `seconds`: what a run of it takes as the scene asks;
    `alone`: bodies of the scene may meet, those of the copy are apart."""

    base: Base
    rungs: list[Rung]
    reduction: list[str]
    seconds: float
    alone: bool


def staged(
    scene: Scene, folder: Path, plugins: Sequence[str | Path], repeats: int, verify: bool, end: float, tell: Callable[[str], None]
) -> Stage:  # fmt: skip
    """The copy, saved in a study's folder, whose ladder ends at `end` (s of `time.perf_counter`)."""
    tell("building the scene and estimating its time")
    stage = _made(scene, folder, plugins, verify, SECONDS)
    tell("timing the costliest rungs")
    costs = probed(stage.rungs, stage.base, folder, plugins)
    share = fitting(stage.rungs, stage.base, costs, repeats, end - time.perf_counter())
    if abs(share - 1.0) < SAME or (share > 1.0 and not stage.reduction):
        return stage
    tell(f"a copy {share:.2g} times as costly")
    return _made(scene, folder, plugins, verify, share * SECONDS)


def _made(scene: Scene, folder: Path, plugins: Sequence[str | Path], verify: bool, most: float) -> Stage:
    copy, built, reduction = reduced(scene, plugins, most)
    alone = copy.domain.size != scene.domain.size and built.state.world.debris_meets
    base = base_of(copy, built, plugins)
    save(copy, folder)
    if base.kind == "explicit" and isinstance(copy.solver.time_step, str):
        base = replace(base, step=_smallest_step(folder, plugins, base.step))
        reduction.append(f"the time step held at {units.pretty(base.step, 'time')}, the smallest that `auto` takes")
    rungs = ladder(copy, built.choice.family, base, verify)
    return Stage(base, rungs, reduction, seconds_of(built), alone)


def base_of(scene: Scene, built: Simulation, plugins: Sequence[str | Path]) -> Base:
    """What the scene itself says: its law and springs, its integrator, and the steps of both."""
    from thirdbody.engine.implicit import Accuracy
    from thirdbody.scene.tables import IMPLICIT_KEYS
    from thirdbody.simulate import prepare

    option = springs_option(built.choice.family, built.choice.level)
    springs = None if option is None else int(scene.contact.options.get("springs", option))
    explicit = built
    if built.plan.kind == "implicit":
        other = {"solver.integrator": "explicit", **{f"solver.{key}": None for key in IMPLICIT_KEYS}}
        explicit = prepare(scene.with_settings(other), plugins, force=True)
    tolerance = scene.solver.tolerance or Accuracy().tolerance
    return Base(built.plan.kind, built.choice.level, springs, explicit.state.dt, tolerance)


def _smallest_step(folder: Path, plugins: Sequence[str | Path], first: float) -> float:
    """The smallest time step, s, that a run of the saved scene with an automatic one takes; `first` if it does not end."""
    from thirdbody.output.run import open_run

    place = folder / RUNGS / "automatic_step"
    if not in_process(folder / SCENE_FILE, place, [{}], plugins, 0)[0]["stable"]:
        return first
    with open_run(place / "0") as run:
        return min(first, float(run.summary()["time_step_limit"]["smallest"]))


def _absolute(scene: Scene, file: str | list[str]) -> str | list[str]:
    """The absolute path of a file that the scene names, or those of several."""
    return [str(scene.beside(name).absolute()) for name in file] if isinstance(file, list) else str(scene.beside(file).absolute())


def save(scene: Scene, folder: Path) -> None:
    """The scene as it is climbed, beside the rungs; files that it names are told by their absolute paths."""
    changes = {
        f"debris.{k}.file": _absolute(scene, debris.file)
        for k, debris in enumerate(scene.debris)
        if isinstance(debris, File | Mesh)
    }
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(f"{folder}: cannot be made ({error.strerror or error})") from error
    (scene.with_settings(changes) if changes else scene).save(folder / SCENE_FILE)
