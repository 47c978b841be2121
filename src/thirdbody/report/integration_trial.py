"""Expected time of the steps of a run: from a short trial of its integrator, and from the ratio of both."""

from __future__ import annotations

import math
import time
from typing import TYPE_CHECKING, Any

import numpy as np

from thirdbody.engine.explicit import Explicit
from thirdbody.engine.islands import expected_islands
from thirdbody.engine.neighbours import update_closest_points
from thirdbody.errors import GuardStop
from thirdbody.kernels.minima import MOVED, MOVED_TOUCHING, update
from thirdbody.kernels.tables import run_totals, sphere, surface_contact
from thirdbody.runner.output_schedule import planned_frames

if TYPE_CHECKING:
    from thirdbody.assembly.simulation import Simulation
    from thirdbody.engine.implicit import Implicit

TRIAL_SECONDS = 0.5
"""Duration of the explicit integration in a trial, for the estimate of the wall time [s]."""

TRIAL_BODIES, TRIAL_PATH, TRIAL_LIMIT = 16, 2e-6, 4.0
"""Bodies and path [m] of such a trial of the implicit integrator, and seconds [s] beyond which they get fewer and shorter."""


def expected_integration(built: Simulation) -> dict[str, Any]:
    """Return the expected steps, their wall time and what limits them. The simulation is not at its start after the trial."""
    integrator = built.integrator
    if not isinstance(integrator, Explicit):
        wall, stopped = _trial_wall_time(built, integrator)
        return {
            "accuracy": vars(integrator.accuracy),
            "common_steps": integrator.together,
            "bodies_meet": integrator.meets,
            "rayleigh": integrator.rayleigh,
            "steps": None,
            "estimated_step_time": wall,
            "trial_stopped": stopped,
        } | _expected(built, wall)
    bound, dt = integrator.bound, built.state.dt
    assert bound is not None
    steps = built.planned_time / dt
    each, stopped = _seconds_per_step(integrator)
    wall = steps * each + (_seconds_of_searches(built) if built.state.world.rough and not stopped else 0.0)
    return {
        "time_step": {
            "step": dt,
            "limited_by": "the scene" if integrator.fixed is not None else bound.mechanism,
            "body": bound.body,
            "rayleigh": bound.rayleigh,
            "stability_limit": bound.stability,
        },
        "steps": steps,
        "estimated_step_time": wall,
        "trial_stopped": stopped,
    } | _expected(built, wall)


def _seconds_per_step(integrator: Explicit) -> tuple[float, str]:
    """Return the seconds per step, and the reason if a guard stopped the trial (then NaN).

    The first call is not counted.
    """
    trial = integrator.state
    try:
        integrator.advance_to(trial.time + 3.0 * trial.dt)
        started, steps, before = time.perf_counter(), 0, trial.A.copy()
        while time.perf_counter() - started < TRIAL_SECONDS:
            integrator.advance_to(trial.time + 100.0 * trial.dt)
        steps = int(trial.A[run_totals.STEPS] - before[run_totals.STEPS])
        return (time.perf_counter() - started) / max(steps, 1), ""
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
        if max(each) > 10.0 * usual and time.perf_counter() - started > 4.0 * TRIAL_SECONDS:
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


def _expected(built: Simulation, measured: float) -> dict[str, dict[str, Any] | None]:
    """Return the `islands` expected of debris that may meet, and wall times of all steps with both integrators [s].

    None where they are not known. `measured`: wall time of the chosen integrator, from a trial (NaN: unknown).
    """
    islands, steps, times = built.plan.islands, built.plan.steps, None
    if steps is not None and not math.isnan(measured):
        scale = steps.gain if built.plan.kind == "implicit" else 1.0 / steps.gain
        times = {built.plan.kind: measured, "explicit" if built.plan.kind == "implicit" else "implicit": scale * measured}
    meeting = islands._asdict() if islands is not None and built.state.world.debris_meets else None
    return {"islands": meeting, "expected_times": times}
