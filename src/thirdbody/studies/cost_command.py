"""Command `thirdbody cost`: computes, prints, and writes JSON, picture, table and runs into a folder."""

import json as json_module
import os
import tempfile
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from typing import NamedTuple

from thirdbody.atomic_files import write_output, write_whole
from thirdbody.errors import InputError, Interrupted, UsageError
from thirdbody.jit.cache import cache_folder
from thirdbody.report.tables import as_plain, print_json
from thirdbody.runner.run_folder import lock_folder
from thirdbody.scene.model import Scene
from thirdbody.studies.copies import RUNS_OF_COPY, Copy, StudySource, make_copy
from thirdbody.studies.cost import Study, compute_errors
from thirdbody.studies.cost_report import as_json, print_study
from thirdbody.studies.cost_runs import Bench, Overdue, VariantRuns
from thirdbody.studies.folder import TABLE, new_study_folder, read_document, save_plan
from thirdbody.studies.point import INTERRUPTED, code_version, point_name, read_result
from thirdbody.units import duration

REPEATS, BUDGET = 3, 420.0  # least number of timings of a variant; wall time of a study [s]
FEW_FRAMES = 420.0  # budget [s] below which the copy has few frames, which take longer to write than a short run to integrate


class StudyOptions(NamedTuple):
    """Number of timed runs of each variant; study of effects instead of accuracy; wall time [s].

    `only`: effects that are studied; all without any. `resume`: go on with the study in the folder. `picture`: a file that is
    all that stays.
    """

    repeats: int
    effects: bool = False
    budget: float = BUDGET
    only: tuple[str, ...] = ()
    resume: bool = False
    picture: Path | None = None


def cost_command(source: StudySource, options: StudyOptions, overwrite: bool, json: bool, log: Callable[[str], None]) -> None:
    """Run `thirdbody cost`. Raises ThirdbodyError; of a study that is refused nothing stays."""
    if options.picture is not None:
        with tempfile.TemporaryDirectory() as folder:
            _compute(source._replace(folder=Path(folder)), options, json, log)
        return
    if options.resume and os.path.isdir(source.folder):
        with lock_folder(source.folder):
            _compute(source, options, json, log)
        return
    with new_study_folder(source.folder, overwrite) as work_folder:
        try:
            _compute(source._replace(folder=work_folder), options, json, log, source.folder)
        except KeyboardInterrupt:
            goes_on = "--resume goes on with the runs that are there"
            raise Interrupted(f"interrupted; {goes_on if work_folder == source.folder else 'the older study stays'}") from None


def _compute(
    source: StudySource, options: StudyOptions, json: bool, log: Callable[[str], None], final: Path | None = None
) -> None:
    from thirdbody.plot.figures import save

    began, folder, name = time.perf_counter(), source.folder, "effects" if options.effects else "cost"
    if options.effects:
        from thirdbody.studies.effects import effects_study, picture, print_effects

        report = effects_study(source, options.repeats, log, options.only)
        figure = picture(report)
    else:
        from thirdbody.studies.pictures import picture_of_study

        built = study(source, options.repeats, log, options.budget, options.resume)
        figure = picture_of_study(built)
    for path in [options.picture] if options.picture is not None else [folder / f"{name}.png", folder / f"{name}.pdf"]:
        save(figure, path)
    if not options.effects:
        built.elapsed = time.perf_counter() - began
        report = as_json(built)
    write_output(folder / f"{name}.json", json_module.dumps(as_plain(report), indent=1).encode())
    if json:
        print_json(report)
        return
    where, runs = final or folder, ""
    if options.effects:
        print_effects(report)
    else:
        print_study(built)
        runs = f", {where / TABLE}, runs of the variants beside them"
    print(options.picture or f"{where / f'{name}.png'} (and .pdf), {where / f'{name}.json'}{runs}")


def study(
    source: StudySource, repeats: int = REPEATS, log: Callable[[str], None] = lambda text: None, budget: float = BUDGET,
    resume: bool = False,
) -> Study:  # fmt: skip
    """Compute the variants of a scene file within a budget [s]; runs remain in `folder`/variants.

    The scene is reduced until its variants should finish; variants without time are omitted and marked. Errors are relative to
    the finest variant that finished. Raises UsageError where not even the scene's own variant finished, and ThirdbodyError for an
    invalid scene.
    """
    from thirdbody.studies.timing import machine

    bench = Bench(budget)  # its processes start meanwhile
    try:
        report, scene = machine(), source.read()
        try:
            runs = _begin(bench, source, scene, resume, log)
        except Overdue:
            raise UsageError(
                f"--budget {duration(budget)}: too short to build the scene and run it once with its own settings; what was "
                "compiled till now is kept, so a second try gets farther"
            ) from None
        runs.compile_beside()
        runs.run_all(repeats)
        runs.time_all(repeats)
    finally:
        bench.close()
    built = Study(str(source.scene), scene.title, runs.copy.reduction, report, runs.rows, budget=budget)
    compute_errors(built)
    return built


def _begin(bench: Bench, source: StudySource, scene: Scene, resume: bool, log: Callable[[str], None]) -> VariantRuns:
    """Return the variants of a copy, the own one of the scene already run. Raises Overdue.

    Raises InputError for a study that should go on and is one of another scene or version.
    """
    version, compiled = code_version(tuple(Path(file).absolute() for file in source.plugins)), bench.compile_laws(source, scene)
    name = point_name(scene.to_toml(), scene.document(), scene, version)
    saved = cache_folder() / f"cost-{name}-{bench.budget:g}.json"  # so that a second study computes the same copy
    if resume:
        document = read_document(source.folder)
        if document.get("study", {}).get("name") != name:
            raise InputError(f"{source.folder}: is a study of another scene or version; --overwrite computes it anew")
        copy = Copy.of(document["study"]["copy"])
    else:
        try:
            copy = Copy.of(json_module.loads(saved.read_bytes()))
        except (OSError, ValueError, TypeError, KeyError):
            log("building the scene and estimating its time")
            few, part = bench.budget < FEW_FRAMES, 0.5 if compiled else 1.0
            copy = bench.call(make_copy, source, bench.budget / RUNS_OF_COPY, few, part=part)
            with suppress(OSError):
                write_whole(saved, json_module.dumps(asdict(copy)).encode())
    runs = VariantRuns(bench, copy, source, log)
    save_plan(runs.table.plan, source.folder, {"study": {"name": name, "copy": asdict(copy)}})
    for row, point in runs.points.items():
        if (result := read_result(point)) is not None:
            runs.enter(row, result)
    if runs.own.cpu:
        log(f"{runs.own.variant.name}: {runs.own.cpu[0]:.3g} s")
    elif runs.run(runs.own, bench.left()) == INTERRUPTED:
        raise Overdue
    return runs
