"""Run a scene: build, compile, integrate from output to output, write the trajectory and the summary."""

from __future__ import annotations

import os
import platform
import threading
import warnings
from collections.abc import Callable, Collection, Iterable
from contextlib import suppress
from dataclasses import asdict
from numbers import Integral
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from thirdbody.atomic_files import write_whole
from thirdbody.engine.units import BATCH, EXPLICIT, report_compilation, start_compiling, warm_up
from thirdbody.errors import GuardStop, Interrupted, OutputError, ThirdbodyWarning, UsageError
from thirdbody.export.paraview import write_paraview_files
from thirdbody.jit.cache import paused
from thirdbody.jit.threads import allow_threads, max_threads
from thirdbody.kernels.contact_zone import BALL, UNIFORM, WORN_BALL
from thirdbody.kernels.tables import zone
from thirdbody.laws.registry import discover
from thirdbody.runner.checkpoint import Checkpoint
from thirdbody.runner.measurements import measured_summary
from thirdbody.runner.progress import Progress, Reporter, line_reporter, reporting, until_closed
from thirdbody.runner.run_folder import SCENE_FILE, RunFolder, new_run_folder, old_run_folder
from thirdbody.runner.run_loop import RunLoop, WallTimes
from thirdbody.runner.verdicts import endings, warnings_at_end
from thirdbody.scene.model import Scene
from thirdbody.system.signals import stop_on_ctrl_c
from thirdbody.trajectory.names import PROFILES, SERIES, SURFACE_WEAR
from thirdbody.trajectory.open_file import FILE_NAME
from thirdbody.trajectory.run_file import RunFile
from thirdbody.trajectory.writer import TrajectoryWriter
from thirdbody.version import __version__

if TYPE_CHECKING:
    from thirdbody.assembly.simulation import Simulation

_preparing = threading.Lock()
"""Lock: one thread at a time compiles, since settings of compilation are process-wide (`engine.units`)."""


def prepare(scene: Scene, plugins: Iterable[str | Path] = (), force: bool = False, before: str = "") -> Simulation:
    """Return the simulation of a scene, compiled and at time zero. Raises UsageError and InputError.

    `before`: the integrator with which a run began, which goes on with it.
    """
    if os.environ.get("NUMBA_DISABLE_JIT", "0") not in ("", "0"):
        raise UsageError("NUMBA_DISABLE_JIT is set: the engine runs compiled only; unset it")
    with _preparing, paused("simulation"):
        start_compiling(likely_units(scene))
        report_compilation()
        registry = discover(tuple(plugins))
        from thirdbody.assembly.simulation import build  # while the units are compiled

        return build(scene, registry, force, warm_up, before)


def likely_units(scene: Scene) -> tuple[str, ...]:
    """Return the units of compiled code (`engine.units`) that a scene needs most likely, before its bodies are made.

    `assembly.integrator.units_of` tells which ones it needs.
    """
    upper, solver = scene.plates.upper, scene.solver
    if upper is None or upper.support != "load_per_particle" or solver.integrator == "explicit" or solver.time_step != "auto":
        return EXPLICIT
    sprung = any(upper.motion.through)
    own, others = "common_plate" if sprung else "driver", ("search", "books", "labels")
    if scene.contact.debris_contact == "auto" and any(hasattr(debris, "placement") for debris in scene.debris):
        return own, "pairs", *others
    many = sum(getattr(debris, "count", None) or 1 for debris in scene.debris) > BATCH
    return (own, "ensemble", *others) if many and not sprung else (own, *others)


def check_call(plugins: object = (), progress: object = True, **flags: object) -> None:
    """Raise UsageError for wrong types among the arguments of `run`, `check`, `resume` and `sweep`."""
    wrong = [f"{name} = {flag!r}: must be True or False" for name, flag in flags.items() if not isinstance(flag, bool)]
    if not isinstance(progress, bool) and not callable(progress):
        wrong.append(f"progress = {progress!r}: must be True, False or a function")
    several = isinstance(plugins, Collection) and not isinstance(plugins, str | bytes)
    if not several or not all(isinstance(path, str | os.PathLike) for path in cast("Collection[object]", plugins)):
        wrong.append(f"plugins = {plugins!r}: must be a tuple of paths, such as ('law.py',)")
    if wrong:
        raise UsageError("; ".join(wrong))


def check_threads(threads: int | None) -> list[str]:
    """Return a warning if `threads` exceeds the number of cores. Raises UsageError for what is no number of at least 1."""
    if threads is None:
        return []
    if not isinstance(threads, Integral) or isinstance(threads, bool) or threads < 1:
        raise UsageError(f"threads = {threads!r}: must be a whole number of at least 1")
    maximum = max_threads()
    return [f"{threads} threads were requested; {maximum} are used, as many as there are cores"] if threads > maximum else []


def set_threads(threads: int | None) -> None:
    """Set the number of threads of the compiled loops: all cores if None, and never more than there are."""
    maximum = max_threads()
    allow_threads(maximum if threads is None else min(threads, maximum))


def run_with_warnings(
    simulation: Simulation, folder: Path, threads: int | None, progress: bool | Reporter, notes: Iterable[str], **options: Any
) -> None:
    """Integrate a simulation for `run` and `resume` of `api`, with Python's warnings before and after it."""
    _warn([*notes, *simulation.warnings])
    before = set(simulation.warnings)
    with reporting(progress, simulation.scene.title, simulation.announcement) as report, stop_on_ctrl_c() as stop:
        try:
            execute(simulation, folder, threads, report, stop=stop, **options)
        except (GuardStop, Interrupted) as problem:
            if getattr(problem, "advanced", True) and (folder / FILE_NAME).exists():
                with RunFile(folder) as stopped:
                    _warn(text for text in stopped.warnings if text not in before)
            raise
    with RunFile(folder) as result:
        _warn(text for text in result.warnings if text not in before)


def _warn(texts: Iterable[str]) -> None:
    """Give Python's warnings at the line that called `run` or `resume`."""
    for text in texts:
        warnings.warn(text, ThirdbodyWarning, stacklevel=4)


def default_folder(scene: Scene) -> Path:
    """Return `runs/<scene name>`: the name of the scene's file, else its title."""
    title = "".join(c if c.isalnum() else "_" for c in scene.title.lower()).strip("_")
    return Path("runs") / (scene.name or title[:40] or "scene")


def execute(
    simulation: Simulation,
    folder: Path,
    threads: int | None = None,
    report: Reporter | None = None,
    overwrite: bool = False,
    stop: Callable[[], bool] = lambda: False,
    *,
    times: WallTimes | None = None,
    checkpoint: Checkpoint | None = None,
) -> dict[str, Any]:
    """Integrate a built simulation into a folder and return the summary, which the file also holds.

    `stop` is called between compiled calls; when it returns True, or when `times.limit` is exceeded, a checkpoint is written
    and Interrupted is raised. Checkpoints are written at least `times.every` apart, and when the run ends. `checkpoint`:
    what to continue from, with its trajectory in the folder.
    """
    set_threads(threads)
    with old_run_folder(folder) if checkpoint else new_run_folder(folder, overwrite) as files:
        log = until_closed(line_reporter(files.log))

        def both(progress: Progress) -> None:
            log(progress)
            if report is not None:
                report(progress)

        loop, header = RunLoop(simulation, files, both, stop, times or WallTimes()), run_header(simulation)
        problem: GuardStop | Interrupted | None = None
        if checkpoint is not None:
            loop.restore(checkpoint)
        with _writer(files, header, loop, checkpoint) as writer:
            _write_other_files(files, header, checkpoint)
            try:
                loop.integrate(writer)
            except (GuardStop, Interrupted) as error:
                problem = error
            summary = _summary(simulation, loop, writer.frames, problem)
            writer.finish(summary)
        with suppress(OSError), RunFile(files.work_folder / FILE_NAME) as run:
            files.log("finished" if problem is None else f"stopped: {problem.message}")
            for text in run.warnings:
                if text not in simulation.warnings:
                    files.log(f"warning: {text}")
        if problem is not None:
            raise problem
        return summary


def _writer(files: RunFolder, header: dict[str, Any], loop: RunLoop, checkpoint: Checkpoint | None) -> TrajectoryWriter:
    path, selection = files.path / FILE_NAME, loop.maker.selection
    if checkpoint is None or not checkpoint.frames:
        static, surfaces = loop.maker.static(), loop.simulation.surfaces
        return TrajectoryWriter(files.work_folder / FILE_NAME, header, static, (path, 0), surfaces, selection)
    with RunFile(path) as before:
        # warnings of an earlier part still hold for it
        report = [text for text in before.header.get("warnings", []) if text not in header["warnings"]]
    header = header | {"warnings": [*report, *header["warnings"]]}
    return TrajectoryWriter.resume(path, checkpoint.frames, header, loop.stop_before_going_on, selection)


def _write_other_files(files: RunFolder, header: dict[str, Any], checkpoint: Checkpoint | None) -> None:
    try:
        write_whole(files.work_folder / SCENE_FILE, header["scene_text"].encode())
        write_paraview_files(files.work_folder / FILE_NAME, header["state_names"])
        what = "begins" if checkpoint is None else f"goes on after {checkpoint.frames} frames"
        files.log(f"thirdbody {header['versions']['thirdbody']}: {header['title'] or 'the run'} {what}")
        for text in header["warnings"]:
            files.log(f"warning: {text}")
    except OSError as error:
        raise OutputError(f"{files.path}: cannot be written ({error.strerror or error})") from error


def run_header(simulation: Simulation) -> dict[str, Any]:
    """Return the metadata of the trajectory: scene, names, units, laws, versions."""
    import h5py
    import numba

    scene, labeller = simulation.scene, simulation.labeller
    units = {name: entry.unit for name, entry in SERIES.items()}
    profiles = scene.output.profiles
    if profiles is not None:
        units |= {name: entry.unit for name, entry in PROFILES.items()}
    if labeller is not None:
        units |= {f"fraction_{name}": "1" for name in labeller.states} | {f"count_{name}": "1" for name in labeller.reasons}
    measures = simulation.state.physics.measures
    units |= measures.layout.units() if measures else {}
    units |= {SURFACE_WEAR: "m"} if simulation.state.wear else {}
    meanings = labeller.meanings() if labeller else {}
    meanings |= {column.name: column.doc for column in measures.layout.bodies} if measures else {}
    return {
        "scene_text": simulation.requested.to_toml(),
        "title": scene.title,
        "state_names": list(labeller.states) if labeller else ["unlabelled"],
        "reason_names": list(labeller.reasons) if labeller else ["none"],
        "units": units,
        "meanings": meanings,
        "domain": {
            "size": list(scene.domain.size),
            "periodic": scene.domain.periodic if scene.domain.ends != "open_x" else [False, True],
        },
        "materials": list(scene.materials),
        "populations": scene.population_names,
        "laws": [{"name": law.name, "stage": law.stage, "source": law.source} for law in simulation.choice.chain.laws],
        "law": {"family": simulation.choice.family.name, "level": simulation.choice.level},
        "effects": [effect.name for effect in simulation.choice.other_effects],
        **({"measures": [measure.name for measure in simulation.choice.measures]} if measures else {}),
        "integrator": {"name": simulation.plan.kind, "reason": simulation.plan.reason},
        "debris_contact": debris_contact(simulation),
        **({"speed_scale": simulation.speed_scale.report()} if simulation.speed_scale else {}),
        **({} if scene.output.blocks is None else {"blocks": scene.output.blocks}),
        **({} if scene.output.sample is None else {"scene_bodies": simulation.state.n_bodies}),
        "warnings": simulation.warnings,
        **({} if simulation.schedule.straight else {"closed_paths": simulation.schedule.closed_paths(simulation.settle)}),
        **({} if profiles is None else {"profiles": {"bins": profiles.bins, "axis": profiles.axis}}),
        **contact_outline(simulation),
        "versions": {
            "thirdbody": __version__,
            "numba": numba.__version__,
            "numpy": np.__version__,
            "h5py": h5py.__version__,
            "python": platform.python_version(),
        },
    }


def contact_outline(simulation: Simulation) -> dict[str, Any]:
    """Return the outline of a contact with an edge at the start; empty without."""
    contact, size = simulation.state.world.zone, simulation.scene.domain.size
    if contact is None or contact.row[zone.KIND] == UNIFORM:
        return {}
    circle = bool(contact.row[zone.KIND] in (BALL, WORN_BALL))
    widths = [float(a) or 0.5 * length for a, length in zip(contact.row[zone.HALF_WIDTH2], size, strict=True)]
    half = [contact.half_width, contact.half_width] if circle else widths
    return {"contact_outline": {"circle": circle, "half_widths": half, "centre": contact.row[zone.CENTRE2].tolist()}}


def debris_contact(simulation: Simulation) -> str:
    """Describe the contact between bodies in this run."""
    return "searched" if simulation.state.world.debris_meets else "none: no contact between bodies"


def _summary(simulation: Simulation, loop: RunLoop, frames: int, problem: GuardStop | Interrupted | None) -> dict[str, Any]:
    state, ledger, wall = simulation.state, loop.ledger, loop.wall_time()
    lines, integration = ledger.lines(state), simulation.integrator.summary()
    result = {
        "finished": problem is None,
        "stopped": None if problem is None else problem.message,
        "wall_time": wall,
        "frames": frames,
        "bodies": state.n_bodies,
        "spheres": state.n_spheres,
        **({"initial_overlap": asdict(simulation.relaxed)} if simulation.relaxed else {}),
        **integration,
        "sphere_steps_per_second": integration["sphere_steps"] / wall if wall > 0.0 else 0.0,
        "simulated_time": state.time,
        "distance": state.distance,
        **loop.settling.summary(),
        **loop.pressure.summary(),
        "energy": lines,
        **endings(simulation, loop, lines),
        **measured_summary(simulation),
        # a guard trips in a step that was not recorded: the energy stored in its contacts is not known
        "energy_residual": None if isinstance(problem, GuardStop) else ledger.relative_residual(state, lines["residual"]),
    }
    return result | {"warnings": warnings_at_end(simulation, result)}
