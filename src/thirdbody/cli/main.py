"""The command line. Heavy modules are imported inside the commands that need them, so that `--help` stays instant."""

import sys
from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from thirdbody.cli.command_group import Command, Group
from thirdbody.cli.option_groups import Execution, Image, Json, MeshFit, Plugins, Settings, grouped, override_pairs, seconds_of
from thirdbody.cli.starter_files import new
from thirdbody.cli.studies import cost, sweep
from thirdbody.errors import GuardStop, Interrupted, ThirdbodyError, UsageError
from thirdbody.plot import NAMES as PANELS
from thirdbody.system.signals import stop_on_signal
from thirdbody.system.terminal import guarded_streams, print_line, printable_output

app = typer.Typer(
    cls=Group,
    name="thirdbody",
    help="Wear debris between two surfaces: sticking, sliding or rolling, and why.",
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
    no_args_is_help=True,
)

SceneFile = Annotated[Path, typer.Argument(metavar="SCENE", help="scene file (TOML)")]
RunPath = Annotated[Path, typer.Argument(metavar="RUN", help="run folder or its run.vtkhdf")]


@app.callback(invoke_without_command=True)
def top(version: Annotated[bool, typer.Option("--version", "-V", help="print the version and exit")] = False) -> None:
    """Handle options given without a command."""
    if version:
        from thirdbody.version import __version__

        print_line(f"thirdbody {__version__}")
        raise typer.Exit


app.command(cls=Command)(new)


@app.command(cls=Command)
def keys(
    word: Annotated[str | None, typer.Argument(metavar="WORD", help="part of a name, or a word of its meaning [all]")] = None,
    plugin: Plugins = None,
    json: Json = False,
) -> None:
    """Look up keys of a scene file, series and arrays of a run: units, limits, defaults, meanings, examples."""
    from thirdbody.report.reference import keys_report

    keys_report(word, plugin or (), json)


@app.command(cls=Command)
def check(
    scene: SceneFile,
    settings: Settings = None,
    plugin: Plugins = None,
    force: Annotated[bool, typer.Option("--force", help="accept a time step above its bound")] = False,
    json: Json = False,
) -> None:
    """Check a scene and print it with all defaults, laws and their sources, time step and its limit, and run time."""
    from thirdbody.report.scene_check import check_report, print_check
    from thirdbody.report.tables import print_json
    from thirdbody.runner.simulate import prepare

    built = prepare(_load(scene, settings, plugin), plugin or (), force)
    message = check_report(built)
    if json:
        print_json(message)
    else:
        print_check(message)


@app.command(cls=Command)
@grouped
def run(
    scene: SceneFile,
    out: Annotated[Path | None, typer.Option("--out", "-o", help="run folder [runs/<scene name>]")] = None,
    settings: Settings = None,
    plugin: Plugins = None,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="replace an existing run")] = False,
    force: Annotated[bool, typer.Option("--force", help="accept a time step above its bound")] = False,
    *,
    execution: Execution,
) -> None:
    """Run a scene and write its trajectory, labels and series."""
    times = _wall_times(execution)
    from thirdbody.runner.run_folder import refuse_existing
    from thirdbody.runner.simulate import default_folder, prepare

    loaded = _load(scene, settings, plugin)
    folder = out or default_folder(loaded)
    refuse_existing(folder, overwrite)
    built = prepare(loaded, plugin or (), force)
    _execute(built, folder, execution, overwrite=overwrite, times=times)


@app.command(cls=Command)
@grouped
def resume(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="run folder")],
    settings: Settings = None,
    plugin: Plugins = None,
    *,
    execution: Execution,
) -> None:
    """Continue a run that was interrupted or killed, or extend a finished one with --set solver.distance=... ."""
    from thirdbody.runner.resume import prepare_resume

    times = _wall_times(execution)
    built, saved = prepare_resume(run, override_pairs(settings), plugin or ())
    _execute(built, run, execution, checkpoint=saved, times=times)


@app.command(cls=Command)
def states(
    run: RunPath,
    frame: Annotated[int | None, typer.Option("--frame", help="one frame [all: a table over frames]")] = None,
    out: Annotated[Path | None, typer.Option("--out", "-o", help="picture file: forecast against fact")] = None,
    cycles: Annotated[float | None, typer.Option("--cycles", help="maps: of so many cycles of a stroke [1]")] = None,
    slopes: Annotated[bool, typer.Option("--slopes", help="forecast on rough plates, by linear programmes")] = False,
    json: Json = False,
) -> None:
    """Print states and their reasons: fractions of all bodies per frame, or body by body for one frame."""
    from thirdbody.report.slopes import slopes_report
    from thirdbody.report.tables import states_report

    if cycles is not None and (slopes or frame is not None):
        raise UsageError("--cycles: for the table over frames, without --frame and --slopes")
    if slopes:
        if out is not None:
            raise UsageError("--slopes: prints tables, without a picture")
        slopes_report(run, frame, json)
        return
    if out is not None:
        from thirdbody.plot.forecast_plot import check_format
        from thirdbody.report.forecast import draw_forecast

        check_format(out)  # before the tables
    states_report(run, frame, json, cycles)
    if out is not None:
        draw_forecast(run, out)
        print_line(out, err=json)


@app.command(cls=Command)
@grouped
def render(
    run: RunPath,
    out: Annotated[Path, typer.Option("--out", "-o", help=".png, .html, or a film: .gif, .mp4")] = Path("picture.png"),
    frame: Annotated[int | None, typer.Option("--frame", help="frame number, negative from the end [last; page: all]")] = None,
    *,
    image: Image,
) -> None:
    """Draw the debris between the plates: a picture, a film, or an interactive page for a browser."""
    from thirdbody.render.render import render as draw

    options = image._asdict()
    size = options.pop("width"), options.pop("height")
    print_line(draw(run, out, progress=True, frame=frame, size=size, **options))


@app.command(cls=Command)
def plot(
    run: Annotated[Path, typer.Argument(metavar="RUN|SWEEP", help="run folder or its run.vtkhdf, or folder of a sweep")],
    out: Annotated[Path, typer.Option("--out", "-o", help="picture file: .png, .pdf or .svg")] = Path("plot.png"),
    panel: Annotated[
        list[str] | None,
        typer.Option("--panel", metavar="NAME", help=f"{', '.join(PANELS)}, or a series of the run [all that apply]"),
    ] = None,
    frame: Annotated[int, typer.Option("--frame", help="frame of the contacts, negative from the end")] = -1,
    x: Annotated[str | None, typer.Option("--x", metavar="KEY", help="sweep: axis of the picture")] = None,
    y: Annotated[str | None, typer.Option("--y", metavar="KEY", help="sweep: second axis; above 6 values a map")] = None,
) -> None:
    """Draw the summary page of a run: friction, states, gap or load, energy, contacts; or curves and maps of a sweep."""
    from thirdbody.studies.folder import is_sweep_folder

    if is_sweep_folder(run):
        from thirdbody.sweeps import Sweep

        Sweep(run).plot(out, panel, x, y)
        print_line(out)
        return
    if x or y:
        raise UsageError("--x and --y: axes of the picture of a sweep, and this is a run")
    from thirdbody.api import Run

    with Run(run) as opened:
        opened.plot(out, panel, frame)
    print_line(out)


@app.command(cls=Command)
def compare(
    runs: Annotated[
        list[Path], typer.Argument(metavar="RUN", help="two or more run folders, or their run.vtkhdf; the first is the reference")
    ],
    out: Annotated[Path | None, typer.Option("--out", "-o", help="picture file: .png, .pdf or .svg")] = None,
    bodies: Annotated[int, typer.Option("--bodies", metavar="N", min=0, help="list the N bodies that differ most")] = 5,
    json: Json = False,
) -> None:
    """Compare runs with the first one: friction, states, energy, settings, and the same bodies one by one."""
    from thirdbody.api import compare as compared
    from thirdbody.report.tables import print_json

    report = compared(*runs, bodies=bodies, out=out)
    if json:
        print_json(report)
    else:
        report.show()
    if out is not None:
        print_line(out, err=json)


@app.command(cls=Command)
def export(
    run: RunPath,
    csv: Annotated[Path | None, typer.Option("--csv", metavar="DIR", help="tables with units")] = None,
    pvd: Annotated[Path | None, typer.Option("--pvd", metavar="DIR", help="PVD and VTP, for ParaView before 5.12")] = None,
    frame: Annotated[int | None, typer.Option("--frame", help="one frame, negative from the end [all]")] = None,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="replace what is there")] = False,
) -> None:
    """Export a run: CSV tables, files for older versions of ParaView."""
    from thirdbody.export.tables import export_run

    for path in export_run(run, csv, pvd, frame, overwrite):
        print_line(path)


@app.command(cls=Command)
@grouped
def shapes(
    path: Annotated[
        Path | None,
        typer.Argument(metavar="SCENE|MESH", help="scene (TOML), surface mesh (.stl, .obj, .ply), or folder of meshes"),
    ] = None,
    out: Annotated[Path | None, typer.Option("--out", "-o", help="PNG file: a picture of the bodies")] = None,
    settings: Settings = None,
    plugin: Plugins = None,
    listed: Annotated[bool, typer.Option("--list", help="list the kinds of debris; with a kind as argument, its keys")] = False,
    *,
    mesh: MeshFit,
    json: Json = False,
) -> None:
    """Describe and draw the bodies of a scene or the clump fitted to a mesh, or list the kinds of debris."""
    if listed:
        from thirdbody.report.shapes import kinds_report

        kinds_report(str(path) if path else None, plugin or (), json)
        return
    if path is None:
        raise UsageError("give a scene, a mesh or a folder of meshes, or --list")
    from thirdbody.report.shapes import draw_shapes, read_shapes, shapes_report

    result = read_shapes(path, mesh.unit, mesh.spheres, mesh.seed, override_pairs(settings), plugin or ())
    shapes_report(result, json)
    if out is not None:
        draw_shapes(result, path.name, out)
        print_line(out, err=json)


@app.command(cls=Command)
def surface(
    path: Annotated[Path, typer.Argument(metavar="FILE|SCENE|RUN", help="measured surface, or scene or run with a rough plate")],
    out: Annotated[
        list[Path] | None,
        typer.Option("--out", "-o", metavar="FILE", help="height map (.npz) or picture (.png, .pdf, .svg); may be repeated"),
    ] = None,
    plate: Annotated[Literal["lower", "upper"] | None, typer.Option("--plate", help="plate of a scene [the rough one]")] = None,
    unit: Annotated[str | None, typer.Option("--unit", help="unit of a file that names none, such as um")] = None,
    spacing: Annotated[
        str | None, typer.Option("--spacing", metavar="LENGTH", help="text: distance of points, or 'x, y'")
    ] = None,
    settings: Settings = None,
    plugin: Plugins = None,
    json: Json = False,
) -> None:
    """Describe a measured surface or that of a plate, of a run at its end; convert it to NPZ, draw it."""
    from thirdbody.report.surface import surface_report

    surface_report(path, out or [], plate, (unit, spacing), override_pairs(settings), plugin or (), json)


app.command(cls=Command)(sweep)
app.command(cls=Command)(cost)


@app.command(cls=Command)
def laws(
    check: Annotated[list[Path] | None, typer.Option("--check", help="plug-in file to put through the conformance suite")] = None,
    code: Annotated[Path | None, typer.Option("--show-code", help="scene whose generated code is printed")] = None,
    plugin: Plugins = None,
    json: Json = False,
) -> None:
    """List laws, levels and effects with their sources, run the conformance suite on a file, or print the code of a scene."""
    from thirdbody.laws.registry import discover
    from thirdbody.report.reference import conformance_report, laws_report, print_code

    if code and check:
        raise UsageError("give --check or --show-code, not both")
    if code:
        print_code(_load(code, None, plugin), discover(plugin or ()), json)
    elif check:
        conformance_report(check, json)
    else:
        laws_report(discover(plugin or ()), json)


def _wall_times(execution: Execution) -> Any:
    from thirdbody.runner.run_loop import WallTimes

    given = {"every": ("--checkpoint-every", execution.every), "limit": ("--wall-limit", execution.wall_limit)}
    return WallTimes(**{key: seconds_of(option, text) for key, (option, text) in given.items() if text is not None})


def _execute(built: Any, folder: Path, execution: Execution, **options: Any) -> None:
    from thirdbody.report.tables import print_warnings, run_report
    from thirdbody.runner.progress import reporting
    from thirdbody.runner.simulate import check_threads, execute

    print_warnings([*check_threads(execution.threads), *built.warnings])
    problem: GuardStop | Interrupted | None = None
    with stop_on_signal() as stop:
        try:
            with reporting(not execution.quiet, built.scene.title, built.announcement) as report:
                execute(built, folder, execution.threads, report, stop=stop, **options)
        except (GuardStop, Interrupted) as error:
            problem = error
        if getattr(problem, "advanced", True):
            run_report(folder, execution.json)
        if problem is not None:
            raise problem


def _load(path: Path, settings: list[str] | None, plugins: list[Path] | None) -> Any:
    from thirdbody.scene.model import Scene

    return Scene.load(path, plugins or ()).with_settings(override_pairs(settings))


def main() -> None:
    """Entry point: turn every error into one message and its exit code; escape control sequences in texts."""
    with guarded_streams(), printable_output():
        try:
            app(prog_name="thirdbody")
        except ThirdbodyError as error:
            text = error.for_command_line()
            print(text if "\n" in text else f"thirdbody: {text}", file=sys.stderr)
            sys.exit(error.exit_code)
        except KeyboardInterrupt:
            sys.exit(130)
        except MemoryError as error:
            print(f"thirdbody: not enough memory{f' ({error})' if str(error) else ''}", file=sys.stderr)
            sys.exit(5)
        except Exception:
            import traceback

            traceback.print_exc()
            print("thirdbody: this is a bug in thirdbody; please report it with the lines above and the scene", file=sys.stderr)
            sys.exit(1)


if __name__ == "__main__":
    main()
