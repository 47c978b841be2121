"""The command that runs sweeps. Heavy modules are imported inside it, as in `main`."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import typer

from thirdbody.cli.option_groups import Cluster, Json, Plugins, Quiet, Settings, grouped


@dataclass(frozen=True)
class Points:
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


@dataclass(frozen=True)
class Continuation:
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
    from thirdbody.cli.overrides import override_pairs
    from thirdbody.errors import UsageError
    from thirdbody.studies.sweep.command import SweepArguments, sweep_command
    from thirdbody.studies.sweep.execution import Execution
    from thirdbody.system.dask_client import dask_client

    if continuation.retry not in (None, "failed"):
        raise UsageError(f"--retry {continuation.retry}: write --retry failed")
    given: dict[str, Any] = {
        "design": points.design, "samples": points.samples, "results": points.result, "keep": points.keep,
    }  # fmt: skip
    options = {name: value for name, value in given.items() if value is not None}
    arguments = SweepArguments(path, out, points.vary or (), override_pairs(points.settings), options, plugin or ())
    resume, retry = continuation.resume or continuation.retry is not None, continuation.retry is not None
    with dask_client(cluster.dask, cluster.cluster) as client:
        execution = Execution(client, continuation.workers, resume, retry)
        sweep_command(arguments, execution, continuation.dry_run, continuation.quiet, continuation.json)
