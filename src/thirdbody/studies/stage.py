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

from .budget import BUDGET, PROBE, Budget, Costs, Overheads, fitting, probed
from .ladder import Base, Rung, ladder, springs_option
from .process import RUNGS, SCENE_FILE, Overdue, Worker, request
from .reduce import SECONDS, coarsened, reduced

if TYPE_CHECKING:
    from thirdbody.scene.build import Simulation

TRIED = 3
"""Rungs whose laws are compiled by trying the costliest ones, about."""

RUNNING = 0.3
"""Share of that time that integration is planned to take at least: where compiling takes it all, a smaller copy is of no use."""

SAFE = 0.8
"""Share of the time that is left for which rungs are planned: what they take is an estimate."""

SAME = 0.1
"""How far the share of the copy that fits may be from 1 before another copy is made."""


@dataclass(frozen=True)
class Stage:
    """What is climbed. `reduction`: what the copy leaves out, in words; `alone`: bodies of the scene may meet, those of the copy
    are apart; `costs`, `overheads`: what its rungs are expected to take."""

    base: Base
    rungs: list[Rung]
    reduction: list[str]
    alone: bool
    costs: Costs
    overheads: Overheads


def staged(
    scene: Scene, folder: Path, plugins: Sequence[str | Path], repeats: int, verify: bool, budget: Budget, worker: Worker,
    tell: Callable[[str], None],
) -> Stage:  # fmt: skip
    """The copy, saved in a study's folder, whose ladder fits the budget. Raises UsageError if not even the smallest one does."""
    tell("building the scene and estimating its time")
    part = min(1.0, budget.seconds / BUDGET)
    base, rungs, reduction, alone = _made(scene, folder, plugins, verify, part * SECONDS, worker, part < 1.0)
    tell("timing the costliest rungs")
    try:
        worker.start(budget.end(1.0))
        costs, overheads = probed(worker, rungs, base, folder, plugins, part * PROBE, budget.end(worker.pace))
    except Overdue:
        raise budget.refuse("it was over before any rung was timed", worker.started + budget.spent()) from None
    pace, codes = worker.pace, len({(rung.level, rung.springs, rung.integrator) for rung in rungs})
    left = (budget.end(pace) - time.perf_counter()) / pace
    beside = max(0, codes - TRIED) * overheads.fresh + len(rungs) * overheads.known
    room = max(left - beside, RUNNING * left)
    share = fitting(rungs, base, costs, repeats, SAFE * room)
    if abs(share - 1.0) >= SAME and not (share > 1.0 and not reduction):
        tell(f"a copy {share:.2g} times as costly")
        base, rungs, reduction, alone = _made(scene, folder, plugins, verify, share * part * SECONDS, worker, part < 1.0)
        costs = replace(costs, scale=share)
    return Stage(base, rungs, reduction, alone, costs, overheads)


def _made(
    scene: Scene, folder: Path, plugins: Sequence[str | Path], verify: bool, most: float, worker: Worker, few: bool
) -> tuple[Base, list[Rung], list[str], bool]:
    """A copy that integrates in `most` seconds as the scene asks, saved: its base, its ladder, what it leaves out, `alone`.

    `few`: with few frames, which take longer to write than a short run to integrate.
    """
    copy, built, reduction = reduced(scene, plugins, most)
    changes, words = coarsened(copy, built) if few else ({}, [])
    copy, reduction = copy.with_settings(changes) if changes else copy, [*reduction, *words]
    alone = copy.domain.size != scene.domain.size and built.state.world.debris_meets
    base = base_of(copy, built, plugins)
    save(copy, folder)
    if base.kind == "explicit" and isinstance(copy.solver.time_step, str):
        base = replace(base, step=_smallest_step(worker, folder, plugins, base.step))
        reduction.append(f"the time step held at {units.pretty(base.step, 'time')}, the smallest that `auto` takes")
    return base, ladder(copy, built.choice.family, base, verify), reduction, alone


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


def _smallest_step(worker: Worker, folder: Path, plugins: Sequence[str | Path], first: float) -> float:
    """The smallest time step, s, that a run of the saved scene with an automatic one takes; `first` if it does not end."""
    from thirdbody.output.run import open_run

    place = folder / RUNGS / "automatic_step"
    if not worker.ask({"do": "run", **request(folder / SCENE_FILE, place, {}, plugins)})["stable"]:
        return first
    with open_run(place) as run:
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
