"""Commands that compute many runs of one scene. Heavy modules are imported inside them, as in `main`."""

import os
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import typer

from thirdbody.cli.option_groups import Cluster, Json, Plugins, Quiet, Settings, Study, grouped, override_pairs, seconds_of
from thirdbody.errors import UsageError
from thirdbody.system.terminal import print_line

LONGEST = 30 * 86400.0  # longest wall time of a study [s]


@grouped
def cost(
    scene: Annotated[Path, typer.Argument(metavar="SCENE", help="scene file (TOML)")],
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="folder of the study [runs/<scene>_cost], or a picture: .png, .pdf, .svg")
    ] = None,
    settings: Settings = None,
    *,
    study: Study,
    plugin: Plugins = None,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Compare accuracy and run time of the laws, springs, time steps and integrators that a scene can use."""
    from thirdbody.plot.figures import FORMATS, checked_path
    from thirdbody.studies.copies import StudySource
    from thirdbody.studies.cost_command import StudyOptions, cost_command

    def log(text: str) -> None:
        if not quiet:
            print_line(text, err=True)

    seconds = seconds_of("--budget", study.budget)
    if not 0.0 < seconds <= LONGEST:
        raise UsageError(f"--budget {study.budget}: must be above 0 s and at most {LONGEST / 86400.0:g} days")
    only = tuple(study.only or ())
    if only and not study.effects:
        raise UsageError("--only: goes with --effects")
    if study.resume and study.effects:
        raise UsageError("--resume: goes with a study of accuracy, not with --effects")
    picture = checked_path(out) if out is not None and out.suffix.lower() in FORMATS and not os.path.isdir(out) else None
    folder = out or Path("runs") / f"{scene.stem}_{'effects' if study.effects else 'cost'}"
    source = StudySource(scene, override_pairs(settings), folder, plugin or [])
    options = StudyOptions(study.repeats, study.effects, seconds, only, study.resume, picture)
    cost_command(source, options, study.overwrite, json, log)


class Points(NamedTuple):
    """What the points of a sweep are, and what stays of them: for a scene; a sweep file has these as keys."""

    vary: Annotated[
        list[str] | None, typer.Option("--vary", metavar="KEY=VALUES", help="FROM:TO:COUNT[:log] or A,B,C; may be repeated")
    ] = None
    settings: Settings = None
    design: Annotated[str | None, typer.Option("--design", help="grid, zip, sobol or latin_hypercube [grid]")] = None
    samples: Annotated[int | None, typer.Option("--samples", help="points of a sampled design, FROM:TO without COUNT")] = None
    result: Annotated[list[str] | None, typer.Option("--result", metavar="NAME", help="column of the table; may be repeated")] = (
        None
    )
    keep: Annotated[str | None, typer.Option("--keep", help="all: whole runs; summary: only their results [all]")] = None


class Continuation(NamedTuple):
    """How a sweep is carried out."""

    dry_run: Annotated[bool, typer.Option("--dry-run", help="print points, estimated time, disk and memory; run nothing")] = False
    resume: Annotated[bool, typer.Option("--resume", help="do what is missing, within a point from its checkpoint")] = False
    retry: Annotated[str | None, typer.Option("--retry", metavar="failed", help="resume, and run failed points again")] = None
    workers: Annotated[int | None, typer.Option("--workers", min=1, help="local processes of one thread [cores]")] = None
    quiet: Quiet = False
    json: Json = False


@grouped
def sweep(
    path: Annotated[
        Path, typer.Argument(metavar="SWEEP|SCENE", help="sweep file (TOML), scene with --vary, or folder to resume")
    ],
    out: Annotated[Path | None, typer.Option("--out", "-o", help="folder of the sweep [sweeps/NAME, as the file]")] = None,
    plugin: Plugins = None,
    *,
    points: Points,
    continuation: Continuation,
    cluster: Cluster,
) -> None:
    """Run a scene at many points: a table of results, a folder per point; failed points are rows too."""
    from thirdbody.scene.settings import toml_value
    from thirdbody.studies.sweep import Execution, plan_of_options, sweep_command
    from thirdbody.studies.workers import dask_client

    if continuation.retry not in (None, "failed"):
        raise UsageError(f"--retry {continuation.retry}: write --retry failed")
    given: dict[str, Any] = {"design": points.design, "samples": points.samples, "results": points.result, "keep": points.keep}
    given["settings"] = {key: toml_value(text) for key, text in override_pairs(points.settings).items()} or None
    options = {name: value for name, value in given.items() if value is not None}
    resume, retry = continuation.resume or continuation.retry is not None, continuation.retry is not None
    with dask_client(cluster.dask, cluster.cluster) as client:
        execution = Execution(client, continuation.workers, resume, retry)
        plan, folder = plan_of_options(path, out, points.vary or (), options, plugin or ())
        sweep_command(plan, folder, execution, continuation.dry_run, continuation.quiet, continuation.json)
