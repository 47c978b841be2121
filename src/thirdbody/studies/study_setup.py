"""Preparation of a study: the copy of the scene, fitted to a time budget, and its variants."""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

from thirdbody import units
from thirdbody.assembly.simulation import Simulation
from thirdbody.errors import InputError, OutputError, ThirdbodyError, UsageError
from thirdbody.runner.measurements import is_bed
from thirdbody.scene.model import Scene
from thirdbody.scene.output import STORED
from thirdbody.studies.reduced_scene import SECONDS, coarsened, reduce_scene
from thirdbody.studies.time_budget import BUDGET, PROBE, Budget, Costs, Overheads, fitting, measure_costs
from thirdbody.studies.variants import Base, Variant, springs_option, variants_of
from thirdbody.studies.worker_process import RUNS, SCENE_FILE, Overdue, Worker, request

TRIED = 3
"""Approximate number of variants whose laws are compiled by trying the costliest ones."""

RUNNING = 0.3
"""Least planned fraction of that time for integration: where compiling takes it all, a smaller copy is useless."""

SAFE = 0.8
"""Fraction of the remaining time for which variants are planned: their cost is an estimate."""

SAME = 0.1
"""Tolerance on the fitting fraction of the copy about 1 before another copy is built."""


@dataclass(frozen=True)
class StudySetup:
    """Plan of a study.

    `reduction`: what the copy omits, in words; `costs`, `overheads`: expected times of its variants.
    """

    base: Base
    variants: list[Variant]
    reduction: list[str]
    costs: Costs
    overheads: Overheads


class StudySource(NamedTuple):
    """Scene file with changed settings, its plug-ins, and the folder of the study."""

    scene: Path
    settings: Mapping[str, Any]
    folder: Path
    plugins: Sequence[str | Path]


def prepare_study(source: StudySource, repeats: int, budget: Budget, worker: Worker, log: Callable[[str], None]) -> StudySetup:
    """Return the saved copy whose variants fit the budget. Raises UsageError if not even the smallest does."""
    part = min(1.0, budget.seconds / BUDGET)
    maker = _Maker(worker, source, part < 1.0, budget)
    try:
        log("starting the worker")
        worker.start(budget.end(1.0))
        log("building the scene and estimating its time")
        base, variants, reduction = maker.build(part * SECONDS)
        log("timing the costliest variants")
        costs, overheads = measure_costs(
            worker, variants, base, source.folder, source.plugins, part * PROBE, budget.end(worker.pace)
        )
        pace, codes = worker.pace, len({(variant.level, variant.springs, variant.integrator) for variant in variants})
        left = (budget.end(pace) - time.perf_counter()) / pace
        beside = max(0, codes - TRIED) * overheads.first + len(variants) * overheads.others
        fraction = fitting(variants, base, costs, repeats, SAFE * max(left - beside, RUNNING * left))
        if abs(fraction - 1.0) >= SAME and reduction:
            log(f"a copy {fraction:.2g} times as costly")
            base, variants, reduction = maker.build(fraction * part * SECONDS)
            costs = replace(costs, scale=fraction)
    except Overdue:
        why = "it was over before the scene was built and its costliest variants were timed; what was compiled till then is kept"
        raise budget.refuse(why, budget.spent()) from None
    return StudySetup(base, variants, reduction, costs, overheads)


@dataclass(frozen=True)
class _Maker:
    """Requests copies of a scene from the worker: building and compiling them ends with the budget there."""

    worker: Worker
    source: StudySource
    few: bool
    budget: Budget

    def build(self, maximum: float) -> tuple[Base, list[Variant], list[str]]:
        """Return a saved copy that integrates in `maximum` seconds with the scene's settings.

        Its base, its variants, its omissions. Raises Overdue, and ThirdbodyError for a scene that cannot be built.
        """
        from thirdbody.laws.registry import discover

        source, until = self.source, self.budget.end(self.worker.pace)
        job = request(source.scene, source.folder, source.settings, source.plugins)
        report = self.worker.request({"do": "make", "most": maximum, "few": self.few, **job}, until)
        if not report["stable"]:
            raise error_of_reply(report)
        base, reduction, copy = (
            Base(**report["base"]),
            report["reduction"],
            Scene.load(source.folder / SCENE_FILE, source.plugins),
        )
        if base.kind == "explicit" and isinstance(copy.solver.time_step, str):
            base = replace(base, step=self._smallest_step(base.step, until))
            reduction.append(f"the time step held at {units.pretty(base.step, 'time')}, the smallest that `auto` takes")
        family = discover(tuple(source.plugins)).families[copy.contact.law]
        return base, variants_of(copy, family, base), reduction

    def _smallest_step(self, first: float, until: float) -> float:
        """Return the smallest time step [s] of a run of the saved scene with an automatic one; `first` if it does not finish."""
        from thirdbody.trajectory.reader import open_run

        run_folder = self.source.folder / RUNS / "automatic_step"
        job = request(self.source.folder / SCENE_FILE, run_folder, {}, self.source.plugins)
        if not self.worker.request({"do": "run", **job}, until)["stable"]:
            return first
        with open_run(run_folder) as run:
            return min(first, float(run.summary()["time_step_limit"]["smallest"]))


def error_of_reply(report: Mapping[str, Any]) -> ThirdbodyError:
    """Return the error of a failed request, of the class with its exit code."""
    kinds = {kind.exit_code: kind for kind in (UsageError, InputError, OutputError)}
    return kinds.get(report.get("exit_code", 1), ThirdbodyError)(report["message"])


def make_copy(scene: Scene, folder: Path, plugins: Sequence[str | Path], maximum: float, few: bool) -> dict[str, Any]:
    """Reduce a scene until it integrates in `maximum` seconds, and save the copy in a study's folder; called in a worker.

    `few`: with few frames, which take longer to write than a short run to integrate.
    """
    lean = {f"output.{key}": None for key in STORED if key in scene.output.model_fields_set}
    scene = scene.with_settings(lean) if lean else scene  # contacts and orientations are compared
    copy, built, reduction = reduce_scene(scene, plugins, maximum)
    changes, words = coarsened(copy, built) if few else ({}, [])
    base = base_of(copy, built, plugins)
    bed = built.plan.kind == "explicit" and is_bed(built) and scene.plates.moving()
    base = replace(base, sheared_bed=bed, meets=bool(built.state.world.debris_meets))
    save(copy.with_settings(changes) if changes else copy, folder)
    return {"base": vars(base), "reduction": [*reduction, *words]}


def base_of(scene: Scene, built: Simulation, plugins: Sequence[str | Path]) -> Base:
    """Return the settings of the scene itself: its law and springs, its integrator, and the steps of both."""
    from thirdbody.engine.accuracy import Accuracy
    from thirdbody.runner.simulate import prepare
    from thirdbody.scene.tables import IMPLICIT_KEYS

    option = springs_option(built.choice.family, built.choice.level)
    springs = None if option is None else int(scene.contact.options.get("springs", option))
    explicit = built
    if built.plan.kind == "implicit":
        other = {"solver.integrator": "explicit", **{f"solver.{key}": None for key in IMPLICIT_KEYS}}
        explicit = prepare(scene.with_settings(other), plugins, force=True)
    tolerance = scene.solver.tolerance or Accuracy().tolerance
    return Base(built.plan.kind, built.choice.level, springs, explicit.state.dt, tolerance)


def _absolute(scene: Scene, file: str | list[str]) -> str | list[str]:
    """Return the absolute path of a file that the scene names, or those of several."""
    return [str(scene.beside(name).absolute()) for name in file] if isinstance(file, list) else str(scene.beside(file).absolute())


def save(scene: Scene, folder: Path) -> None:
    """Save the scene as it is computed next to the runs; files that it names get absolute paths."""
    changes = {
        f"debris.{k}.{key}": _absolute(scene, getattr(debris, key))
        for k, debris in enumerate(scene.debris)
        for key in debris.file_keys
    }
    for side in ("lower", "upper"):
        file = getattr(getattr(getattr(scene.plates, side), "surface", None), "file", None)
        if file is not None:
            changes[f"plates.{side}.surface.file"] = _absolute(scene, file)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(f"{folder}: cannot be made ({error.strerror or error})") from error
    (scene.with_settings(changes) if changes else scene).save(folder / SCENE_FILE)
