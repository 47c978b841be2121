"""What a run will cost, from a short trial of its steps and of its frames, and what is warned of then."""

from __future__ import annotations

import math
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, cast

import numpy as np

from thirdbody.engine.candidates import AllRows, Candidates
from thirdbody.engine.guards import Ledger
from thirdbody.engine.islands import expected_islands
from thirdbody.engine.neighbours import update_closest_points
from thirdbody.errors import GuardStop, OutputError
from thirdbody.kernels.minima import MOVED, MOVED_TOUCHING, update
from thirdbody.kernels.tables import run_totals, sphere, surface_contact
from thirdbody.runner.measurements import PeakPressure, select_output
from thirdbody.runner.simulate import run_header
from thirdbody.runner.stops import planned_frames, settling_frames
from thirdbody.trajectory.frame import FrameMaker, Selection
from thirdbody.trajectory.names import Frame
from thirdbody.trajectory.open_file import FILE_NAME
from thirdbody.trajectory.writer import TrajectoryWriter
from thirdbody.units import duration, file_size, pretty

if TYPE_CHECKING:
    from thirdbody.assembly.simulation import Simulation
    from thirdbody.engine.explicit import Explicit
    from thirdbody.engine.implicit import Implicit

LONG = 86400.0
"""Wall time of a run that gives a warning [s]: a day."""

LARGE = 10e9
"""Size of a trajectory that gives a warning [bytes]; also the size with the suggested interval."""

TRIAL_SECONDS = 0.2
"""Duration of the explicit integration in a trial, for the estimate of the wall time, and of a search for closest points [s]."""

TRIAL_BODIES, TRIAL_PATH, TRIAL_LIMIT = 16, 2e-6, 0.6
"""Bodies and path [m] of such a trial of the implicit integrator, and seconds [s] beyond which they get fewer and shorter."""

FRAME_SECONDS, LARGEST_NUMBER = 0.03, 32
"""Seconds and largest number of frames of the measurement, without the first, which creates all arrays."""

CONTACTS_PER_BODY, SINGLE = 3, 4
"""Contacts of a body in an estimate; bytes of a number in single precision."""


class FrameCost(NamedTuple):
    """Wall time of a frame [s] (NaN if not measured), bytes of the file with one frame, and of every further frame."""

    seconds: float
    first: int
    bytes: int
    failure: str = ""  # why the time could not be measured


def outlook(built: Simulation) -> dict[str, Any]:
    """Return the expected steps, frames, wall time [s] and bytes on disk of a run, with `warnings`.

    The trials advance the simulation itself, since a copy of a million bodies takes 2 GB: it cannot be run afterwards.
    """
    frames = planned_frames(built)
    if built.integrator.divisible and built.scene.output.every < built.shortest_interval:  # one after every step, and no more
        by_time = built.scene.output.every_kind == "time"
        frames = min(frames, 2 + math.ceil((built.planned_time - (0.0 if by_time else built.settle)) / built.state.dt))
    integration, each = expected_integration(built), frame_cost(built)
    step_time, framing, disk = integration["estimated_step_time"], frames * each.seconds, each.first + (frames - 1) * each.bytes
    wall = step_time + (0.0 if each.failure else framing)
    warnings = list(run_warnings(built, wall, framing, disk, integration["trial_stopped"]))
    if each.failure:
        warnings.append(f"the time of frames is not in the estimate, a trial of some was not written: {each.failure}")
    speed = speed_report(built, wall, step_time)
    result = {"speed_scale": speed, "estimated_wall_time": wall, **integration, "estimated_frame_time": framing}
    return result | {"frames": frames, "disk": disk, "warnings": warnings}


def speed_report(built: Simulation, wall_time: float, step_time: float) -> dict[str, Any] | None:
    """Return both speeds of a scene that is computed at another one than it asks for; None for other scenes.

    `wall_time`, `step_time`: wall time of the run and its part for steps [s], of which a run at the speed asked for would take
    `scene_time` over `simulated_time` times as many. `requested_wall_time` is the wall time of that run.
    """
    scale = built.speed_scale
    if scale is None:
        return None
    time = built.scene_time(built.planned_time)
    requested = wall_time + step_time * (time / built.planned_time - 1.0)
    return scale.report() | {"scene_time": time, "requested_wall_time": requested}


def run_warnings(built: Simulation, wall: float, framing: float, disk: float, stopped: str) -> Iterator[str]:
    """Yield warnings from estimates of a trial.

    wall: wall time [s]; framing: its part for frames [s]; disk: trajectory [bytes]; stopped: message of a guard that stopped the
    trial.
    """
    if stopped:
        yield f"a trial of the first steps was stopped by a guard, and so will the run be: {stopped}"
    settling, spacing = settling_frames(built)
    if settling:
        yield (
            f"settling takes {settling} output intervals: one in {spacing} of them ends with a frame, in the drag all do "
            "(all do from the start where solver.settle is a time)"
        )
    if framing > max(LONG, 0.5 * wall):
        yield (
            f"frames would take about {duration(framing)} ({framing:.2g} s) of {duration(wall)}: "
            f'output.every = "{_wider(built, framing / LONG)}" leaves {duration(LONG)} or less'
        )
    elif wall > LONG:
        length = "solver.distance" if built.scene.solver.distance is not None else "solver.duration"
        yield (
            f"a run would take about {duration(wall)} ({wall:.2g} s) on one core: lower {length} or the number of "
            "bodies; thirdbody cost compares cheaper laws, steps and integrators"
        )
    if disk > LARGE:
        every = _wider(built, disk / LARGE)
        yield (
            f'the trajectory would take about {file_size(disk)} on disk: output.every = "{every}" leaves {file_size(LARGE)} '
            f"or less"
        )


def _wider(built: Simulation, times: float) -> str:
    """Return the output interval, with its unit, that leaves one frame out of `times` present ones."""
    output = built.scene.output
    # below a time step the interval makes no difference
    every = max(output.every, built.shortest_interval) * math.ceil(times)
    by_time = output.every_kind == "time"
    return pretty(every * built.time_scale if by_time else every, "time" if by_time else "length")


def expected_integration(built: Simulation) -> dict[str, Any]:
    """Return the expected steps, their wall time and what limits them. The simulation is not at its start after the trial."""
    integrator, planned = built.integrator, dict[str, Any]()
    if integrator.divisible:
        integrator = cast("Explicit", integrator)
        bound, steps = integrator.bound, built.planned_time / built.state.dt
        assert bound is not None
        limit = "the scene" if integrator.fixed is not None else bound.mechanism
        step = {"step": built.state.dt, "limited_by": limit, "body": bound.body, "rayleigh": bound.rayleigh}
        planned["time_step"] = step | {"stability_limit": bound.stability}
        each, stopped = _seconds_per_step(integrator)
        wall = steps * each + (_seconds_of_searches(built) if built.surfaces and not stopped else 0.0)
        planned["steps"] = steps
    else:
        integrator = cast("Implicit", integrator)
        wall, stopped = _trial_wall_time(built, integrator)
        planned = {"accuracy": vars(integrator.accuracy), "common_steps": integrator.together, "bodies_meet": integrator.meets}
        planned |= {"rayleigh": integrator.rayleigh, "steps": None}
    # the islands of debris that may meet, and the steps of both integrators; None where they are not known
    islands, both, times = built.plan.islands, built.plan.steps, None
    if both is not None and not math.isnan(wall):
        explicit, implicit = (wall, wall / both.gain) if integrator.divisible else (both.gain * wall, wall)
        times = {"explicit": explicit, "implicit": implicit}
    meeting = islands._asdict() if islands is not None and built.state.world.debris_meets else None
    return planned | {"estimated_step_time": wall, "trial_stopped": stopped, "islands": meeting, "expected_times": times}


def _seconds_per_step(integrator: Explicit) -> tuple[float, str]:
    """Return the seconds per step, the first call not counted, and the reason if a guard stopped the trial (then NaN).

    Each call takes twice as many steps as the one before, so that a bed of a million bodies is tried for a few steps only.
    """
    trial, steps = integrator.state, 1.0
    try:
        integrator.advance_to(trial.time + trial.dt)
        started, before = time.perf_counter(), float(trial.A[run_totals.STEPS])
        while time.perf_counter() - started < TRIAL_SECONDS:
            integrator.advance_to(trial.time + steps * trial.dt)
            steps *= 2.0
        return (time.perf_counter() - started) / max(trial.A[run_totals.STEPS] - before, 1.0), ""
    except GuardStop as stop:
        return math.nan, str(stop)


def _seconds_of_searches(built: Simulation) -> float:
    """Return the seconds that searches for the closest points of bodies that roll on rough plates take in the drag.

    A trial of the first steps sees none: bodies are at rest. Where the surface is far sharper than spheres one search can take as
    long as thousands of steps. Bodies are pressed onto the lower plate, or onto the upper one where only it is rough, and shifted
    until each has been searched for.
    """
    state, S, Q = built.state, built.state.S, built.state.slots.Q
    radius, nearest = S[:, sphere.RADIUS], np.full(state.n_spheres, np.inf)
    np.minimum.at(nearest, state.slots.own[: len(Q)], Q[:, surface_contact.DISTANCE])
    approach = np.where(np.isfinite(nearest), nearest - (1.0 - built.upper.shared_overlap) * radius, 0.0)
    S[:, sphere.Z] += -approach if len(state.lower_surface) else approach
    S[:, sphere.X] += 1.01 * MOVED * radius
    update_closest_points(state, update)  # searches for all, so that whole distances between searches follow
    started, each, step = time.perf_counter(), [], 0.5 * MOVED_TOUCHING * float(radius.min())
    for _ in range(math.ceil(1.01 * MOVED * float(radius.max()) / step)):
        begun = time.perf_counter()
        S[:, sphere.X] += step
        update_closest_points(state, update)
        each.append(time.perf_counter() - begun)
        usual = float(np.quantile(each, 0.25))  # of an update without a search
        if max(each) > 10.0 * usual and time.perf_counter() - started > 10.0 * TRIAL_SECONDS:
            break
    # a body that rolls moves by half the drag
    return (sum(each) - len(each) * usual) * 0.5 * built.planned_distance / (len(each) * step)


def _trial_wall_time(built: Simulation, integrator: Implicit) -> tuple[float, str]:
    """Return the wall time of all steps [s], and the reason if a guard stopped the trial (then NaN).

    A few bodies, alone, are pressed and dragged a little. The path doubles piece by piece; the last gives the rate of the rest.
    Measured on one core: a machine with more cores is faster by their number. The size of islands is expected; a search for them
    is measured, and there is one at each output and after each stride.
    """
    n = built.state.n_bodies
    bodies = n if integrator.together else 1
    try:
        integrator.trial(bodies, 1e-3 * built.settle)  # compiles if necessary
        started = time.perf_counter()
        integrator.trial(bodies, built.settle)
        if not integrator.together:
            bodies = min(TRIAL_BODIES, n, max(1, int(0.25 * TRIAL_LIMIT / (time.perf_counter() - started))))
            integrator.trial(bodies, built.settle)
        wall = _with_drag(built, integrator, bodies, started) * n / bodies
    except GuardStop as stop:
        return math.nan, str(stop)
    islands = built.plan.islands
    if islands is None or not integrator.meets:
        return wall, ""
    shared = 1.0 if integrator.together else islands.mean  # bodies of one plate were measured as they are, islands included
    started = time.perf_counter()
    expected_islands(built.state)
    search = time.perf_counter() - started
    return wall * shared + (planned_frames(built) + built.planned_distance / islands.stride) * search, ""


def _with_drag(built: Simulation, integrator: Implicit, bodies: int, started: float) -> float:
    """Return the seconds of `bodies` bodies since `started` and in all of the drag, of which a piece is measured always.

    Raises GuardStop.
    """
    total = built.planned_distance
    path, reached, rate = min(TRIAL_PATH, total) / 32.0, 0.0, 0.0
    elapsed = time.perf_counter() - started
    while reached < min(TRIAL_PATH, total) and (reached == 0.0 or elapsed < 0.5 * TRIAL_LIMIT):
        integrator.trial(bodies, built.schedule.time_of(path, 0.0))
        now = time.perf_counter() - started
        rate = (now - elapsed) / (path - reached)
        elapsed, reached, path = now, path, 2.0 * path
    return elapsed + rate * (total - reached)


def frame_cost(built: Simulation) -> FrameCost:
    """Measure the cost of frames of a simulation after a trial, in a temporary folder."""
    integrator = built.integrator
    maker = FrameMaker(integrator.state, Ledger(integrator.state), built.labeller, integrator.drag)
    select_output(built.scene, maker)
    maker.watch = PeakPressure(built).update

    def frame() -> Frame:
        return maker.frame(integrator.label() if built.labeller else None)

    first_frame = frame()
    size = frame_bytes(first_frame, maker.selection)
    try:
        with tempfile.TemporaryDirectory(prefix="thirdbody") as folder:
            path, static = Path(folder) / FILE_NAME, maker.static()
            with TrajectoryWriter(path, run_header(built), static, surfaces=built.surfaces, selection=maker.selection) as writer:
                writer.append(first_frame)
                first, started, number = path.stat().st_size, time.perf_counter(), 0
                while number < LARGEST_NUMBER and time.perf_counter() - started < FRAME_SECONDS:
                    writer.append(frame())
                    number += 1
                return FrameCost((time.perf_counter() - started) / number, first, size)
    except (OSError, OutputError) as error:
        return FrameCost(math.nan, 0, size, str(error))


def frame_bytes(frame: Frame, selection: Selection) -> int:
    """Return the bytes of such a frame, with its series, profiles and maps, and three contacts per body where contacts are
    written; before compression.
    """
    bodies, size = len(frame.clumps["points"]), 0
    contacts = CONTACTS_PER_BODY * bodies if selection.has("contacts") else 0
    for block, count in (("spheres", len(frame.spheres["points"])), ("clumps", bodies), ("contacts", contacts)):
        storage = selection.storage(block)
        for name, values in frame.block(block).items():
            single = values.dtype.kind == "f" and (storage.single_points if name == "points" else storage.single)
            size += count * int(np.prod(values.shape[1:])) * (SINGLE if single else values.dtype.itemsize)
    return size + sum(8 * np.size(values) for arrays in (frame.series, frame.profiles, frame.maps) for values in arrays.values())


def memory_of(built: Simulation) -> int:
    """Return the bytes of all tables of a simulation: of its state, its candidates and its integrator; a table counts once.

    Where closed contacts only have rows, these are as many as are expected in a run.
    """
    tables = {}
    for each in (*_tables(built.state), *_tables(built.integrator)):
        while isinstance(each.base, np.ndarray):  # the array whose memory a view shows
            each = each.base
        tables[id(each)] = each.nbytes
    expected = getattr(built.state.slots.rows, "expected_bytes", lambda bodies: 0)  # `ClosedRows` have them
    return sum(tables.values()) + expected(built.state.n_bodies)


def _tables(owner: object) -> Iterator[np.ndarray]:
    for value in owner if isinstance(owner, tuple) else vars(owner).values():
        if isinstance(value, np.ndarray):
            yield value
        elif isinstance(value, tuple | Candidates | AllRows):
            yield from _tables(value)
