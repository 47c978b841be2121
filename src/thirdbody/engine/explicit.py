"""Explicit integrator: velocity Verlet with automatic time step and guards."""

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from thirdbody.engine import state as states
from thirdbody.engine.candidates import AllRows, Candidates, Numbers
from thirdbody.engine.guards import name_of, partner_of, set_guards
from thirdbody.engine.measures import labels, update_measures
from thirdbody.engine.neighbours import force_rows, plate_pairs, remote_rows, search
from thirdbody.engine.state import SUMMED, Action, Array, Ints, State, constant_arguments, refresh_spheres, table, table_arguments
from thirdbody.errors import GuardStop
from thirdbody.jit.arguments import Packer, address
from thirdbody.jit.threads import ThreadTuner, allowed_threads, distribute, helpers, pieces_of, words_of
from thirdbody.kernels import bodies as body_pass
from thirdbody.kernels.arguments import KINDS, RUN_GROUPS, Context
from thirdbody.kernels.explicit import contact_forces as contact_pass
from thirdbody.kernels.explicit import critical_time_step as limits
from thirdbody.kernels.explicit import step_loop
from thirdbody.kernels.explicit.passes import run_groups
from thirdbody.kernels.minima import UPDATE, update
from thirdbody.kernels.step_tables import body_force, chunk_motion, contact_stiffness, contact_sums, drift_scratch
from thirdbody.kernels.tables import domain, loaded_contact, patch, run_totals, sphere, surface_contact
from thirdbody.kernels.tile import TILE, law_input
from thirdbody.laws.contract import Material

BUDGET = 64
"""Steps between two updates of the time step, counted from the start of the run, so that outputs do not shift them."""

CALL = 1.0  # largest wall time [s] of a compiled call: signals are handled only between calls

GROWTH, MIN_BOUNDS = 1.25, 16
"""The automatic step follows its bound down at once. It grows at once to a bound that is larger by GROWTH, and to a smaller one
only after MIN_BOUNDS bounds in a row that allow more: an oscillating step loses energy."""


class Explicit:
    """Explicit integrator. `time_step=None`: automatic. Stops between outputs do not change the steps."""

    divisible = True

    def __init__(self, state: State, materials: list[Material], time_step: float | None = None, force: bool = False):
        self.state, self.materials, self.fixed, self.force = state, materials, time_step, force
        set_guards(state)
        state.summed = True
        if state.n_spheres == state.n_bodies and not state.offsets.any():
            # all bodies are single centred spheres: one table for both halves the memory traffic
            state.B[:, sphere.RADIUS], state.sphere_table = state.S[:, sphere.RADIUS], state.B
            refresh_spheres(state)
        self.bound: Bound | None = None
        self.tightest: Bound | None = None
        self.waiting: list[float] = []  # bounds since the last change of the step, all larger than the step
        self.drag = np.array(state.world.schedule.direction())
        self.pace, self.seconds = ThreadTuner(), CALL / BUDGET  # last measured wall time of a step
        self.packer, self.announced = Packer(KINDS), np.zeros(step_loop.ANNOUNCED)
        upper = state.world.upper
        common = upper is not None and (upper.foundation is not None or (upper.free and len(upper.heights) == 1))
        # whether no body influences another, neither by contact nor by a plate that they carry or pull together
        self.independent = not state.world.debris_meets and not (common and state.n_bodies > 1)
        self.independent = self.independent and not state.sprung
        if self.independent and state.world.rough:
            # all spheres are candidates: what a body does must not depend on when others make a search due
            state.skin = state.D[domain.SKIN] = math.inf
        groups = -(-state.n_bodies // (body_pass.BODIES * contact_pass.GROUP)) if self.independent else 0
        self.ledgers = np.zeros((groups, run_totals.WIDTH))
        self.constant = constant_arguments(state, self.drag) | {
            "X0": state.X0, "A": state.A, "ledgers": self.ledgers, "announced": self.announced, "jumps": int(state.physics.jumps),
            "stride": state.physics.stride, "run_groups": address(run_groups, RUN_GROUPS),
            "update_surfaces": address(update, UPDATE) if state.world.rough else 0,
        }  # fmt: skip

    def start(self) -> None:
        search(self.state)
        self._tables()
        # those that bound the time step; None: the present candidates
        self.pairs = plate_pairs(self.state) if self.independent and not self.state.world.rough else None
        self._advance(1, math.inf, math.inf, 0.0)
        self.state.A[run_totals.STEPS] = self.state.A[run_totals.ELAPSED] = 0.0
        self._choose_step()

    def advance_to(
        self, time: float = math.inf, distance: float = math.inf, watch: Action = lambda: None, between: Action = lambda: None
    ) -> None:
        """Advance to the first step at or after a time [s] or a sliding distance [m]. `watch` is called every `BUDGET` steps of
        the run, `between` after other compiled calls. Raises GuardStop, with the state that violated the guard."""
        state = self.state
        while state.time < time and state.distance < distance:
            budget = min(BUDGET - int(state.A[run_totals.STEPS]) % BUDGET, max(1, int(CALL / self.seconds)))
            code, number = self._advance(budget, time, distance, state.dt)
            if code == step_loop.Stop.RECORD:  # no step was done
                state.slots.rows = AllRows(state.slots.H, table(state.slots.count, state.slots.R.shape[1]))
                continue
            if code != step_loop.Stop.BUDGET or int(state.A[run_totals.STEPS]) % BUDGET == 0:
                update_measures(state)  # at instants that do not depend on the wall time
            if code in (step_loop.Stop.SEARCH, step_loop.Stop.DONE) and number == 1:
                search(state, code == step_loop.Stop.DONE)
                self._tables()
            elif code not in (step_loop.Stop.SEARCH, step_loop.Stop.BUDGET, step_loop.Stop.DONE):
                raise GuardStop(self._explain(code, number))
            if int(state.A[run_totals.STEPS]) % BUDGET == 0:
                self._choose_step()
            if code == step_loop.Stop.BUDGET:  # the run can be saved here
                (watch if int(state.A[run_totals.STEPS]) % BUDGET == 0 else between)()
            if code == step_loop.Stop.DONE:
                return

    def export_state(self) -> tuple[dict[str, Array], dict[str, Any]]:
        bound, tightest = (None if bound is None else dict(vars(bound)) for bound in (self.bound, self.tightest))
        return {"ledgers": self.ledgers}, {"bound": bound, "tightest": tightest, "waiting": list(self.waiting)}

    def restore(self, arrays: dict[str, Array], notes: dict[str, Any]) -> None:
        self.ledgers[:] = arrays["ledgers"]
        self.bound, self.tightest = (None if notes[name] is None else Bound(**notes[name]) for name in ("bound", "tightest"))
        self.waiting = [float(x) for x in notes["waiting"]]
        self._tables()

    def _tables(self) -> None:
        chunks = -(-self.state.n_bodies // body_pass.BODIES)
        self.sums = np.zeros((2 * -(-chunks // contact_pass.GROUP), contact_sums.WIDTH))
        self.moved = np.zeros(len(self.sums) // 2, np.int32)
        self.moves = np.zeros((chunks, chunk_motion.WIDTH))
        self.rows_of_parts: dict[int, tuple[Numbers, Numbers, Numbers]] = {}
        self.forces = table(0, body_force.WIDTH)
        self.kinds = self.state.slots.kind[: 0 if self.state.physics.kinds.size == 1 else None]  # not read where all are equal
        self._scratch(allowed_threads())

    def _scratch(self, threads: int) -> None:
        slots, physics, parts = self.state.slots, self.state.physics, step_loop.PARTS_PER_THREAD * threads
        chunks = slots.cuts.shape[1] - 1
        ends = np.minimum(np.arange(0, chunks + contact_pass.GROUP, contact_pass.GROUP), chunks)
        longest = int(np.diff(slots.cuts[: body_pass.REMOTE, ends], axis=1).max(initial=0))
        floats, marks = contact_pass.scratch_sizes(len(physics.history), longest, len(physics.interaction) > 0)
        self.team = table(1, words_of(threads))[0].view(np.int64)
        self.scratch = table(parts, max(floats, drift_scratch.WIDTH * body_pass.BODIES))
        self.marks = np.empty((parts, max(marks, body_pass.BODIES)), np.int32)
        maximum = slots.max_per_body if physics.labels else 0
        self.rows = np.empty((parts, maximum, loaded_contact.MEMORY + physics.contact_memory))

    def _advance(self, budget: int, until: float, distance: float, dt: float) -> tuple[int, int]:
        s, began, worked = self.state, time.perf_counter(), time.process_time()
        before = s.A[run_totals.STEPS]
        threads = self.pace.threads(allowed_threads(), began)
        if len(self.scratch) < step_loop.PARTS_PER_THREAD * threads:
            self._scratch(threads)
        context = self._context(threads)
        members = threads if self._parts(threads) > 1 else 1
        with helpers(members, self.team, lambda member: step_loop.help_out(member, threads, context)):
            answer = step_loop.advance(budget, until, distance, dt, threads, context)
        for column in SUMMED if len(self.ledgers) else ():
            s.A[column] = self.ledgers[:, column].sum()
        now, busy = time.perf_counter(), time.process_time()
        done = int(s.A[run_totals.STEPS] - before)
        self.pace.note(threads, done, now - began, busy - worked, now)
        self.seconds = max(now - began, 1e-9) / max(done, 1)
        refresh_spheres(s)  # the kernel updates only spheres with candidates
        return answer

    def _parts(self, threads: int) -> int:
        return int(step_loop.parts_of.py_func(len(self.moved), threads))

    def _context(self, threads: int = 1) -> Array:
        slots, parts = self.state.slots, self._parts(threads)
        if parts not in self.rows_of_parts:
            rows = remote_rows(slots, self.state.body, parts)
            shifts, count = force_rows(slots.lowest, parts)
            self.forces = self.forces if count <= len(self.forces) else table(count, body_force.WIDTH)
            # rows of F by candidate (-1: none) and by remote force, and of `forces` by group
            self.rows_of_parts[parts] = np.append(rows, np.int32(-1))[slots.outer], rows, shifts
        outer, rows, shifts = self.rows_of_parts[parts]
        return self.packer(
            Context(  # type: ignore[call-arg]
                **self.constant, **table_arguments(self.state), kind=self.kinds, outer=outer, near=slots.near,
                beginning=slots.beginning, remote_body=slots.remote_body, remote_row=rows, closed=slots.closed, cuts=slots.cuts,
                lowest=slots.lowest, needs=slots.needs, force_rows=shifts, forces=self.forces, F=slots.F, sums=self.sums,
                moves=self.moves, moved=self.moved, scratch=self.scratch, marks=self.marks, rows=self.rows, team=self.team,
            )
        )  # fmt: skip

    def _choose_step(self) -> None:
        s, now = self.state, self.state.dt
        # a fixed step is compared with the bound of the present contacts
        steps, largest = BUDGET if self.fixed is None else 0, float(s.D[domain.OVERLAP_GUARD])
        limit = self.bound = bound(s, self.materials, steps, largest, self.pairs)
        if self.tightest is None or limit.step < self.tightest.step:
            self.tightest = limit
        if self.fixed is not None:
            s.dt = self.fixed
            if self.fixed > limit.stability and not self.force and s.time > 0.0:
                raise GuardStop(
                    f"stopped at t = {s.time:.6g} s (step {int(s.A[run_totals.STEPS])}): the time step {s.dt:.3g} s exceeds the "
                    f"stability limit {limit.stability:.3g} s of body {limit.body}, whose contacts have become stiffer"
                )
            return
        s.dt = self._next_step(limit.step, now)
        if 0.0 < now < s.dt:
            # longer steps come to contacts that shorter ones did not foresee: one that these would make unstable grows by less
            ahead = bound(s, self.materials, steps, largest, self.pairs)
            refused = s.dt > ahead.stability
            while refused and now < s.dt > ahead.step:
                s.dt = max(0.5 * s.dt, now)
                ahead = bound(s, self.materials, steps, largest, self.pairs)

    def _next_step(self, allowed: float, now: float) -> float:
        """Return the automatic time step [s] for a bound of `allowed` [s]; `now`: the present step [s]."""
        if now == 0.0 or allowed <= now or allowed > GROWTH * now:
            self.waiting.clear()
            return allowed
        self.waiting.append(allowed)
        if len(self.waiting) < MIN_BOUNDS:
            return now
        minimum = min(self.waiting)
        self.waiting.clear()
        return minimum

    def summary(self) -> dict[str, Any]:
        limit, steps = self.tightest, int(self.state.A[run_totals.STEPS])
        assert limit is not None
        return {
            "integrator": "explicit", "steps": steps, "sphere_steps": steps * self.state.n_spheres,
            "searches": self.state.searches, "time_step": self.state.dt,
            "time_step_limit": {"mechanism": limit.mechanism, "body": limit.body, "smallest": limit.step},
        }  # fmt: skip

    def evaluate(self) -> None:
        """Evaluate all contacts anew where they are, at a stop, as the plates have changed their surfaces: a step of no length,
        which is not counted."""
        A = self.state.A
        columns = [run_totals.STEPS, run_totals.BEHIND, run_totals.PLATE_SPEED, run_totals.HEADING, run_totals.HEADING + 1]
        before = A[columns]
        self.state.slots.Q[:, surface_contact.SEARCHED] = math.inf
        self._advance(1, math.inf, math.inf, 0.0)
        A[columns] = before

    def label(self) -> np.ndarray:
        return labels(self.state, self.drag)

    def _explain(self, code: int, number: int) -> str:
        s, slots = self.state, self.state.slots
        contact = code in (step_loop.Stop.OVERLAP, step_loop.Stop.BAD_CONTACT)
        b = int(s.body[slots.own[number]]) if contact else number
        who = name_of(b, s)
        when = f"stopped at t = {s.time:.6g} s (step {int(s.A[run_totals.STEPS])}, time step {s.dt:.3g} s)"
        laws = ", ".join(sorted({name.split(".")[0] for name in s.physics.history})) or "contact laws"
        if contact:
            partner = partner_of(s, number, b)
            if code == step_loop.Stop.BAD_CONTACT:
                return f"{when}: the force between {who} and {partner} is not a number ({laws})"
            ratio = float(self.sums[:, contact_sums.MAX_OVERLAP].max())
            return (
                f"{when}: {who} and {partner} overlap by {ratio:.2f} of the smaller radius "
                f"(guard: {s.D[domain.OVERLAP_GUARD]:g}); a smaller time step, a lower load or a stiffer material is needed"
            )
        if code == step_loop.Stop.BAD_BODY:
            return f"{when}: the position of body {s.order[number]} is not a number; the time step is too large"
        if code == step_loop.Stop.LEFT:
            return f"{when}: {who} left the domain"
        return (
            f"{when}: {who} moves more than {s.D[domain.TRAVEL_GUARD]:g} of a radius in one step; a smaller time step is needed"
        )


# -- the time step: bounded by the present contact stiffness and a fraction of the Rayleigh time --

DAMPING_FRACTION = 0.7
"""Time step over the longest stable step with damping, decisive where the dashpots of many contacts add up on one body. Such a
mode is overdamped: an oscillation at the step itself loses 40 % in each step, so a margin to the limit is enough."""

MIN_CANDIDATES = 4096  # candidates, or bodies, that one thread alone examines as fast as two: some 0.2 ms


@dataclass(frozen=True)
class Bound:
    """Time step [s] and what limits it."""

    step: float
    mechanism: str  # rayleigh, translation, rotation, damping or patch
    body: int  # number of the limiting body in the scene
    stability: float  # longest stable step [s]; infinite without contacts
    rayleigh: float  # Rayleigh time [s]


def bound(state: State, materials: list[Material], steps: int, max_overlap: float, candidates: Candidates | None = None) -> Bound:
    """Return the bound of the time step for the next `steps` steps, for overlaps up to `max_overlap` radii. `candidates`:
    contacts that are or may come; None: those of the last search."""
    times = states.rayleigh_times(state, materials)
    slowest = int(np.argmin(times))
    rayleigh = float(times[slowest])
    best = Bound(states.RAYLEIGH_FRACTION * rayleigh, "rayleigh", int(state.order[slowest]), math.inf, rayleigh)
    if state.physics.stiffness is None:
        return best
    numbers, bodies, patches = _contact_bounds(state, steps * (state.dt or best.step), max_overlap, candidates)
    fractions = np.array((states.STABILITY_FRACTION, DAMPING_FRACTION))  # of the stable steps without and with damping
    of_bodies, of_patches = (fractions * bodies[:, 2:]).min(axis=1), (fractions * patches[:, 2:]).min(axis=1)
    body, patch = int(np.argmin(of_bodies)), int(np.argmin(of_patches))
    limit = float(min(bodies[:, 3].min(), patches[:, 3].min()))
    step = float(min(of_bodies[body], of_patches[patch]))
    if step >= best.step:
        return replace(best, stability=limit)
    if of_patches[patch] < of_bodies[body]:
        return Bound(step, "patch", int(state.order[np.argmax(state.patch == patch)]), limit, rayleigh)
    along, around, by_frequency, _ = bodies[body]
    damped = of_bodies[body] < states.STABILITY_FRACTION * by_frequency
    mechanism = "damping" if damped else "rotation" if around > along else "translation"
    return Bound(step, mechanism, int(state.order[numbers[body]]), limit, rayleigh)


def _contact_bounds(
    state: State, horizon: float, max_overlap: float, candidates: Candidates | None = None
) -> tuple[Ints, Array, Array]:
    """Return candidates for the shortest step: bodies, their bounds (n, 4), bounds of patches (m, 4)."""
    slots, physics = candidates or state.slots, state.physics
    context = limits.Assembly(  # type: ignore[call-arg]
        slots.n_plates, slots.own, slots.partner, slots.kind, slots.edges, slots.incidence, state.body, state.S, state.B,
        state.E, state.orientations, _pressed(state, horizon), slots.Q, state.D, physics.pairs, state.drive,
    )  # fmt: skip
    drag = float(state.A[run_totals.PLATE_SPEED]) * state.A[run_totals.HEADING2]
    tables = limits.Tables(  # each allocation in a kernel would cost 0.1 s of compilation
        np.empty((slots.count, contact_stiffness.WIDTH)), np.empty(slots.count, np.int32), np.empty((state.n_bodies, 2)),
        np.zeros((len(state.P) + state.sprung, 4)), np.empty(state.n_bodies, np.int64), np.empty((state.n_bodies, 4)),
        np.empty((4, 6, 8)),
    )  # fmt: skip
    ahead = limits.Horizon(horizon, max_overlap, float(drag[0]), float(drag[1]))
    # contacts with plates in one piece: those of a patch are summed in their order
    flat, pairs = [(0, slots.n_plates)], pieces_of(slots.n_plates, slots.count, MIN_CANDIDATES)
    longest = max(last - first for first, last in flat + pairs)

    def stiffness_worker() -> Callable[[tuple[int, int]], None]:
        scratch = limits.Scratch(np.zeros((law_input.HISTORY + 1) * TILE), np.zeros(8 * TILE), np.empty(longest + 1, np.int32))
        return lambda piece: limits.find_stiffnesses(*piece, context, ahead, physics.stiffness_at, scratch, tables)

    distribute(flat, stiffness_worker)
    distribute(pairs, stiffness_worker)
    many, width = state.n_bodies if slots.count else 0, slots.max_per_body + 1
    bodies = pieces_of(0, many, MIN_CANDIDATES)
    distribute(bodies, lambda: lambda piece: limits.bound_bodies(*piece, context, np.empty(width, np.int32), tables))
    result = limits.shortest_steps(many, context, ahead.time, np.empty(width, np.int32), tables)
    return tables.number[:result], tables.bodies[:result], tables.patches


def _pressed(state: State, horizon: float) -> Array:
    """Return the patches under their largest load until the next bound (1.5 horizons, as steps may grow)."""
    P, upper = state.P, state.world.upper
    if upper is not None and upper.schedule.load:
        largest, P = upper.schedule.largest_load(state.time, state.time + 1.5 * horizon), P.copy()
        P[:, patch.LOAD] = np.maximum(P[:, patch.LOAD], largest * P[:, patch.NOMINAL_LOAD])
    return P
