"""Running a scene: build, integrate from output to output, write the trajectory, sum up."""

from __future__ import annotations

import math
import os
import platform
import shutil
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from .engine.energy import Ledger
from .errors import GuardStop, Interrupted, OutputError, UsageError
from .output.frames import UNITS, FrameMaker
from .output.paraview import write_paraview_files
from .output.run import FILE_NAME, Run, open_run
from .output.vtkhdf import TrajectoryWriter
from .progress import Progress, Reporter, reporter_for_terminal
from .scene.model import Scene

if TYPE_CHECKING:
    from .scene.build import Simulation

SCENE_FILE = "scene.toml"
SUBTICKS = 8
"""Reports of progress per output interval: a run with few frames still shows that it moves."""


def run(
    scene: Scene,
    out: str | Path | None = None,
    threads: int | None = None,
    progress: bool | Reporter = True,
    *,
    overwrite: bool = False,
    plugins: tuple[str | Path, ...] = (),
    force: bool = False,
) -> Run:
    """Simulate a scene into the folder `out` and return the opened result.

    `threads` is the number of cores (all that numba sees if None); results have the same bits for any number.
    `progress` may be a callable that takes a `Progress`. `plugins` are Python files with a `PLUGIN`.
    Raises UsageError, InputError, OutputError, GuardStop (what was computed is kept and can be opened), Interrupted.
    """
    folder = Path(out) if out is not None else default_folder(scene)
    refuse_existing(folder, overwrite)
    check_threads(threads)
    simulation = prepare(scene, plugins, force)
    reporter: Reporter | None
    if progress is True:
        with reporter_for_terminal(simulation.scene.title) as reporter:
            execute(simulation, folder, threads, reporter, overwrite)
    else:
        execute(simulation, folder, threads, progress or None, overwrite)
    return open_run(folder)


def prepare(scene: Scene, plugins: Iterable[str | Path] = (), force: bool = False) -> Simulation:
    """The simulation of a scene, compiled and in place at time zero. Raises UsageError and InputError."""
    from .laws.registry import discover
    from .warm import warm_up

    registry = discover(tuple(plugins))
    warm_up()
    from .scene.build import build

    return build(scene, registry, force)


def default_folder(scene: Scene) -> Path:
    """`runs/<scene name>`: the name of the scene's file, else its title."""
    title = "".join(c if c.isalnum() else "_" for c in scene.title.lower()).strip("_")
    return Path("runs") / (scene.name or title[:40] or "scene")


def execute(
    simulation: Simulation,
    folder: Path,
    threads: int | None = None,
    report: Reporter | None = None,
    overwrite: bool = False,
    stop: Callable[[], bool] = lambda: False,
) -> dict[str, Any]:
    """Integrate a built simulation into a folder; returns the summary that the file also holds.

    `stop` is asked between compiled calls; when it says so, the run ends with what it has and Interrupted is raised.
    """
    set_threads(threads)
    started = time.perf_counter()
    ledger = Ledger(simulation.state)
    maker = FrameMaker(simulation.state, ledger, simulation.labeller, simulation.integrator.drag)
    header = _header(simulation)
    problem: GuardStop | Interrupted | None = None
    _prepare(folder, overwrite)
    with _opened(folder, header, maker) as writer:
        try:
            _integrate(simulation, ledger, maker, writer, report, started, stop)
        except (GuardStop, Interrupted) as error:
            problem = error
        summary = _summary(simulation, ledger, started, writer.frames, problem)
        writer.finish(summary)
    if problem is not None:
        raise problem
    return summary


@contextmanager
def _opened(folder: Path, header: dict[str, Any], maker: FrameMaker) -> Iterator[TrajectoryWriter]:
    """The writer of a run, with the files beside it. A folder in which nothing could be written does not stay."""
    writer = None
    try:
        with TrajectoryWriter(folder / FILE_NAME, header, maker.static()) as writer:
            try:
                (folder / SCENE_FILE).write_text(header["scene_text"], encoding="utf-8")
                write_paraview_files(folder / FILE_NAME, header["state_names"])
            except OSError as error:
                raise OutputError(f"{folder}: cannot be written ({error.strerror or error})") from error
            yield writer
    finally:
        if writer is None or not writer.frames:
            shutil.rmtree(folder, ignore_errors=True)


def check_threads(threads: int | None) -> int:
    """The largest number of cores. Raises UsageError for a number of cores outside 1 .. what numba was started with."""
    import numba

    most = int(numba.config.NUMBA_NUM_THREADS)  # type: ignore[attr-defined]
    if threads is not None and not 1 <= threads <= most:
        raise UsageError(f"--threads {threads}: must be at least 1 and at most {most}, the cores of this machine")
    return most


def set_threads(threads: int | None) -> None:
    """Number of cores that the compiled loops use, all of them if None. Raises UsageError as `check_threads` does."""
    import numba

    most = check_threads(threads)
    numba.set_num_threads(most if threads is None else threads)


def _integrate(simulation, ledger, maker, writer, report, started, stop) -> None:
    integrator, state = simulation.integrator, simulation.state

    def watch() -> None:
        ledger.watch(state)
        if stop():
            raise Interrupted(f"interrupted at t = {state.time:.6g} s; {writer.frames} frames are kept")

    def write() -> dict[str, Any]:
        frame = maker.frame(integrator.label() if simulation.labeller else None)
        writer.append(frame)
        return dict(frame.series)

    series = write()
    tick(report, simulation, started, writer.frames, series)
    for target_time, target_distance, is_output in targets(simulation):
        if not (is_output or integrator.divisible):
            continue
        integrator.advance_to(target_time, target_distance, watch)
        if is_output:
            series = write()
        tick(report, simulation, started, writer.frames, series)


def tick(report: Reporter | None, simulation: Simulation, started: float, frame: int, series: dict[str, Any]) -> None:
    """Tell the progress so far."""
    if report is not None:
        simulated = simulation.state.time
        fraction = min(simulated / simulation.planned_time, 1.0)
        report(Progress(fraction, simulated, time.perf_counter() - started, frame, series))


def targets(simulation: Simulation) -> Iterator[tuple[float, float, bool]]:
    """(time, distance, whether to write) of every stop: the end of settling, then output by output to the end.

    A run by distance stops by distance; one by time stops by time. Stops in between only report progress.
    """
    output, settle, infinite = simulation.scene.output, simulation.settle, math.inf
    if output.every_kind == "time":
        end = simulation.planned_time
        for x, write in _ladder(0.0, end, output.every):
            yield x, infinite if x < settle else simulation.end_distance, write
        return
    if settle > 0.0:
        for k in range(1, SUBTICKS + 1):
            yield settle * k / SUBTICKS, infinite, k == SUBTICKS
    by_time = math.isfinite(simulation.end_time)
    for x, write in _ladder(0.0, simulation.planned_distance, output.every):
        # a run by duration may end with a rest: its last stop is its end
        yield simulation.end_time, infinite if by_time and x >= simulation.planned_distance else x, write


def _ladder(start: float, end: float, every: float) -> Iterator[tuple[float, bool]]:
    """Stops from start (excluded) to end: every `every` a written one, with reports between; the end is written."""
    for k in range(1, _rungs(start, end, every) + 1):
        low, high = start + (k - 1) * every, min(start + k * every, end)
        for part in range(1, SUBTICKS):
            yield low + (high - low) * part / SUBTICKS, False
        yield high, True


def _rungs(start: float, end: float, every: float) -> int:
    return max(1, int(np.ceil((end - start) / every - 1e-9)))


def planned_frames(simulation: Simulation) -> int:
    """Frames that a whole run writes: what `targets` yields to write, and the first."""
    output, settle = simulation.scene.output, simulation.settle
    if output.every_kind == "time":
        return 1 + _rungs(0.0, simulation.planned_time, output.every)
    settled = 1 if settle > 0.0 else 0
    return 1 + settled + _rungs(0.0, simulation.planned_distance, output.every)


def refuse_existing(folder: Path, overwrite: bool) -> None:
    """Raise OutputError if the folder exists, unless it is that of a run and may be overwritten, or cannot be made."""
    if not folder.exists():
        above = next((path for path in folder.absolute().parents if path.exists()), None)
        if above is None or not above.is_dir() or not os.access(above, os.W_OK | os.X_OK):
            raise OutputError(f"{folder}: cannot be made: {above} is {_why_not(above)}")
        return
    if not overwrite:
        raise OutputError(f"{folder}: exists already; --overwrite replaces it, -o names another folder")
    if not folder.is_dir() or (any(folder.iterdir()) and not (folder / FILE_NAME).exists()):
        raise OutputError(f"{folder}: is not the folder of a run and will not be overwritten")


def _why_not(above: Path | None) -> str:
    return "not a folder" if above is not None and not above.is_dir() else "read-only for you"


def _prepare(folder: Path, overwrite: bool) -> None:
    """Make the run's folder. Raises OutputError if it exists (unless told to overwrite a run) or cannot be made."""
    refuse_existing(folder, overwrite)
    try:
        if folder.exists():
            shutil.rmtree(folder)
        folder.mkdir(parents=True)
    except OSError as error:
        raise OutputError(f"{folder}: cannot be made ({error.strerror or error})") from error


def _header(simulation: Simulation) -> dict[str, Any]:
    import h5py
    import numba

    from . import __version__

    scene, labeller = simulation.scene, simulation.labeller
    units = dict(UNITS)
    if labeller is not None:
        units |= {f"fraction_{name}": "1" for name in labeller.states}
    return {
        "scene_text": scene.to_toml(),
        "title": scene.title,
        "state_names": list(labeller.states) if labeller else ["unlabelled"],
        "reason_names": list(labeller.reasons) if labeller else ["none"],
        "units": units,
        "domain": {"size": list(scene.domain.size), "periodic": scene.domain.periodic},
        "materials": list(scene.materials),
        "laws": [{"name": law.name, "stage": law.stage, "source": law.source} for law in simulation.choice.chain.laws],
        "law": {"family": simulation.choice.family.name, "level": simulation.choice.level},
        "effects": [effect.name for effect in simulation.choice.effects],
        "integrator": {"name": simulation.plan.kind, "reason": simulation.plan.reason},
        "debris_contact": debris_contact(simulation),
        "warnings": simulation.warnings,
        "versions": {
            "thirdbody": __version__,
            "numba": numba.__version__,
            "numpy": np.__version__,
            "h5py": h5py.__version__,
            "python": platform.python_version(),
        },
    }


def debris_contact(simulation: Simulation) -> str:
    """What bodies do to each other in this run."""
    if simulation.state.world.debris_meets:
        return "searched" if simulation.plan.kind == "explicit" else "watched: the run stops where two bodies come near"
    return "none: bodies do not see each other"


def _summary(simulation: Simulation, ledger: Ledger, started: float, frames: int, problem: Exception | None) -> dict[str, Any]:
    state = simulation.state
    wall = time.perf_counter() - started
    lines, integration = ledger.lines(state), simulation.integrator.summary()
    return {
        "finished": problem is None,
        "stopped": None if problem is None else str(problem),
        "wall_time": wall,
        "frames": frames,
        "bodies": state.n_bodies,
        "spheres": state.n_spheres,
        **integration,
        "sphere_steps_per_second": integration["sphere_steps"] / wall if wall > 0.0 else 0.0,
        "simulated_time": state.time,
        "distance": state.distance,
        "energy": lines,
        # a guard trips in a step that was not recorded: what is stored in its contacts is not known
        "energy_residual": None if isinstance(problem, GuardStop) else ledger.relative_residual(state, lines["residual"]),
    }
