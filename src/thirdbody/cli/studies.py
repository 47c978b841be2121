"""Commands that compute many runs of one scene. Heavy modules are imported inside them, as in `main`."""

from pathlib import Path
from typing import Annotated

import typer

from thirdbody.cli.option_groups import Json, Plugins, Quiet, Settings, Study, grouped
from thirdbody.system.terminal import print_line

LONGEST = 30 * 86400.0
"""Longest wall time of a study [s]."""


@grouped
def cost(
    scene: Annotated[Path, typer.Argument(metavar="SCENE", help="scene file (TOML)")],
    out: Annotated[Path | None, typer.Option("--out", "-o", help="folder of the study [runs/<scene>_cost]")] = None,
    settings: Settings = None,
    *,
    study: Study,
    plugin: Plugins = None,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="replace an existing study")] = False,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Compare accuracy and run time of the laws, springs, time steps and integrators that a scene can use."""
    from thirdbody import units
    from thirdbody.cli.overrides import override_pairs
    from thirdbody.errors import UsageError
    from thirdbody.studies.cost_command import StudyOptions, cost_command
    from thirdbody.studies.study_setup import StudySource

    def log(text: str) -> None:
        if not quiet:
            print_line(text, err=True)

    try:
        seconds = units.parse(study.budget, "time")
    except ValueError as error:
        raise UsageError(f"--budget: {error}") from None
    if not 0.0 < seconds <= LONGEST:
        raise UsageError(f"--budget {study.budget}: must be above 0 s and at most {LONGEST / 86400.0:g} days")
    only = tuple(study.only or ())
    if only and not study.effects:
        raise UsageError("--only: goes with --effects")
    folder = out or Path("runs") / f"{scene.stem}_{'effects' if study.effects else 'cost'}"
    source = StudySource(scene, override_pairs(settings), folder, plugin or [])
    cost_command(source, StudyOptions(study.repeats, study.effects, seconds, only), overwrite, json, log)
