"""Command `thirdbody cost`: computes, prints, and writes JSON, picture and runs into a folder."""

import json as json_module
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

from thirdbody.errors import OutputError
from thirdbody.report.tables import as_plain, print_json
from thirdbody.studies.cost import JSON_FILE, PICTURE, as_json, study
from thirdbody.studies.study_folder import new_study_folder
from thirdbody.studies.study_setup import StudySource
from thirdbody.studies.time_budget import BUDGET


class StudyOptions(NamedTuple):
    """Number of timed runs of each variant; study of effects instead of accuracy; wall time [s].

    `only`: effects that are studied; all without any.
    """

    repeats: int
    effects: bool = False
    budget: float = BUDGET
    only: tuple[str, ...] = ()


def cost_command(source: StudySource, options: StudyOptions, overwrite: bool, json: bool, log: Callable[[str], None]) -> None:
    """Run `thirdbody cost`. Raises ThirdbodyError; no partial files remain except the runs of variants."""
    if options.effects:
        _effects(source, options, overwrite, json, log)
        return
    from thirdbody.studies.convergence import convergence, print_convergence, print_reference, reference_error
    from thirdbody.studies.cost_plot import draw_study
    from thirdbody.studies.cost_table import print_study

    began, folder = time.perf_counter(), source.folder
    with new_study_folder(folder, overwrite) as work_folder:
        built = study(source.scene, work_folder, source.settings, source.plugins, options.repeats, log, options.budget)
        draw_study(built, work_folder / PICTURE, (work_folder / PICTURE).with_suffix(".pdf"))
        built.elapsed = time.perf_counter() - began
        report = as_json(built) | {"convergence": convergence(built), "reference_error": reference_error(built)}
        _write(work_folder / JSON_FILE, report)
    if json:
        print_json(report)
        return
    print_study(built)
    print_convergence(report["convergence"])
    print_reference(built)
    print(f"{folder / PICTURE} (and .pdf), {folder / JSON_FILE}, runs of the variants beside them")


def _effects(source: StudySource, options: StudyOptions, overwrite: bool, json: bool, log: Callable[[str], None]) -> None:
    from thirdbody.studies.effects import EFFECTS_PICTURE, effects_study, print_effects
    from thirdbody.studies.effects_plot import draw_effects

    with new_study_folder(source.folder, overwrite) as work_folder:
        report = effects_study(source.scene, work_folder, source.settings, source.plugins, options.repeats, log, options.only)
        draw_effects(report, work_folder / EFFECTS_PICTURE, (work_folder / EFFECTS_PICTURE).with_suffix(".pdf"))
        _write(work_folder / "effects.json", report)
    if json:
        print_json(report)
    else:
        print_effects(report)
        print(f"{source.folder / EFFECTS_PICTURE} (and .pdf), {source.folder / 'effects.json'}")


def _write(path: Path, report: dict[str, Any]) -> None:
    from thirdbody.atomic_files import write_whole

    try:
        write_whole(path, json_module.dumps(as_plain(report), indent=1).encode())
    except OSError as error:
        raise OutputError(f"{path}: cannot be written ({error.strerror or error})") from error
