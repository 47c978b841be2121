"""Explicit time step: bounded by the present contact stiffness and a fraction of the Rayleigh time."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from thirdbody.engine.candidates import Candidates
from thirdbody.engine.state import RAYLEIGH_FRACTION, Array, Ints, State, rayleigh_times
from thirdbody.jit.threads import distribute, pieces_of
from thirdbody.kernels.explicit import critical_time_step
from thirdbody.kernels.tables import patch, run_totals
from thirdbody.laws.contract import Material

STABILITY_FRACTION = 0.2
"""Time step over 2/omega: the frequency error of velocity Verlet is then (omega dt)^2/24 = 0.7 %.
Halving it changes the friction curve of the main scene by less than 1e-5 and doubles its time."""

DAMPING_FRACTION = 0.7
"""Time step over the longest stable step with damping. It is decisive where the dashpots of many contacts, each scaled for its
contact, add up on one body. Such a mode is overdamped: an oscillation at the step itself loses 40 % in each step, so a margin to
the limit is enough."""

FEWEST = 4096
"""Candidates, or bodies, that one thread alone examines as fast as two: some 0.2 ms."""


@dataclass(frozen=True)
class Bound:
    """Time step [s] and what limits it.

    `mechanism`: rayleigh, translation, rotation, damping or patch; `body`: number of the limiting body in the scene.
    """

    step: float
    mechanism: str
    body: int
    stability: float  # longest stable step [s]; infinite without contacts
    rayleigh: float  # Rayleigh time [s]


def bound(state: State, materials: list[Material], steps: int, max_overlap: float, candidates: Candidates | None = None) -> Bound:
    """Return the bound of the time step for the next `steps` steps, for overlaps up to `max_overlap` radii.

    `candidates`: contacts that are or may come; None: those of the last search.
    """
    times = rayleigh_times(state, materials)
    slowest = int(np.argmin(times))
    rayleigh = float(times[slowest])
    best = Bound(RAYLEIGH_FRACTION * rayleigh, "rayleigh", int(state.order[slowest]), math.inf, rayleigh)
    if state.physics.stiffness is None:
        return best
    numbers, bodies, patches = _contact_bounds(state, steps * (state.dt or best.step), max_overlap, candidates)
    of_bodies, of_patches = _steps(bodies), _steps(patches)
    body, patch = int(np.argmin(of_bodies)), int(np.argmin(of_patches))
    limit = float(min(bodies[:, 3].min(), patches[:, 3].min()))
    step = float(min(of_bodies[body], of_patches[patch]))
    if step >= best.step:
        return replace(best, stability=limit)
    if of_patches[patch] < of_bodies[body]:
        return Bound(step, "patch", int(state.order[np.argmax(state.patch == patch)]), limit, rayleigh)
    along, around, by_frequency, _ = bodies[body]
    damped = of_bodies[body] < STABILITY_FRACTION * by_frequency
    mechanism = "damping" if damped else "rotation" if around > along else "translation"
    return Bound(step, mechanism, int(state.order[numbers[body]]), limit, rayleigh)


def _contact_bounds(
    state: State, horizon: float, max_overlap: float, candidates: Candidates | None = None
) -> tuple[Ints, Array, Array]:
    """Return candidates for the shortest step: bodies, their bounds (n, 4), bounds of patches (m, 4)."""
    slots, physics = candidates or state.slots, state.physics
    context = critical_time_step.Assembly(  # type: ignore[call-arg]
        slots.n_plates, slots.own, slots.partner, slots.kind, slots.edges, slots.incidence, state.body, state.S, state.B,
        state.E, state.orientations, _pressed(state, horizon), slots.Q, state.D, physics.pairs,
    )  # fmt: skip
    drag = float(state.A[run_totals.PLATE_SPEED]) * state.A[run_totals.HEADING2]
    tables = critical_time_step.make_tables(state.n_bodies, slots.count, len(state.P))
    ahead = critical_time_step.Horizon(horizon, max_overlap, float(drag[0]), float(drag[1]))
    # contacts with plates in one piece: those of a patch are summed in their order
    flat, pairs = [(0, slots.n_plates)], pieces_of(slots.n_plates, slots.count, FEWEST)
    longest = max(last - first for first, last in flat + pairs)

    def stiffness_worker() -> Callable[[tuple[int, int]], None]:
        scratch, given = critical_time_step.make_scratch(longest), (context, ahead, physics.stiffness_at)
        return lambda piece: critical_time_step.find_stiffnesses(*piece, *given, scratch, tables)

    def bound_worker() -> Callable[[tuple[int, int]], None]:
        near = np.empty(slots.max_per_body + 1, np.int32)
        return lambda piece: critical_time_step.bound_bodies(*piece, context, near, tables)

    distribute(flat, stiffness_worker)
    distribute(pairs, stiffness_worker)
    many = state.n_bodies if slots.count else 0
    distribute(pieces_of(0, many, FEWEST), bound_worker)
    near = np.empty(slots.max_per_body + 1, np.int32)
    result = critical_time_step.shortest_steps(many, context, ahead.time, near, tables)
    return tables.number[:result], tables.bodies[:result], tables.patches


def _pressed(state: State, horizon: float) -> Array:
    """Return the patches under their largest load until the next bound (1.5 horizons, as steps may grow)."""
    upper = state.world.upper
    if upper is None or not upper.schedule.load:
        return state.P
    P = state.P.copy()
    largest = upper.schedule.largest_load(state.time, state.time + 1.5 * horizon)
    P[:, patch.LOAD] = np.maximum(P[:, patch.LOAD], largest * P[:, patch.NOMINAL_LOAD])
    return P


def _steps(result: Array) -> Array:
    """Return the time steps [s] from the stable steps without (column 2) and with damping (column 3)."""
    return np.minimum(STABILITY_FRACTION * result[:, 2], DAMPING_FRACTION * result[:, 3])
