"""Implicit integrator (BDF2, backward-Euler starts) of islands of bodies.

A body between the plates is a small problem with six coordinates and the height of its patch. Solved with the tangents of the
laws, it needs no steps that resolve elastic waves: steps are as long as the motion allows, and their number does not depend on
the speed of the drag. Bodies that could meet form islands, which are solved as one system (`engine.meeting`); without contact
between bodies each is an island of its own. Between two outputs islands are independent, with individual time steps, unless all
bodies carry one plate (`engine.common_plate`). Results are bit-identical for any number of threads.
"""

import math
import time as clock
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from thirdbody.engine import implicit_stops as stops
from thirdbody.engine.accuracy import Accuracy
from thirdbody.engine.common_plate import CommonPlate, own_patches
from thirdbody.engine.guards import Guards
from thirdbody.engine.implicit_parts import ThreadScratch, find_minima, part_addresses
from thirdbody.engine.islands import BATCH, Islands, single_bodies
from thirdbody.engine.labels import labels
from thirdbody.engine.measures import arguments_of, update_measures
from thirdbody.engine.meeting import Meeting
from thirdbody.engine.neighbours import search
from thirdbody.engine.state import Array, State, rayleigh_time
from thirdbody.engine.upper_plate import Schedule, at_time
from thirdbody.errors import GuardStop
from thirdbody.jit.arguments import Packer, address
from thirdbody.jit.threads import distribute, parts_of
from thirdbody.kernels.arguments import EFFECTS, LAW, OBSERVE, OBSERVE_BODIES
from thirdbody.kernels.implicit import driver
from thirdbody.kernels.implicit.control import StepLimit, Stop
from thirdbody.kernels.implicit.tables import body_solution, sphere_path, step_memory, step_start
from thirdbody.kernels.implicit.workspace import FREEDOMS, ISLANDS, KINDS, ImplicitContext
from thirdbody.kernels.labels import observe_bodies
from thirdbody.kernels.tables import loaded_contact, patch, run_totals
from thirdbody.laws.contract import Material

CALL, PACE, FEW = 1.0, 1e4, 8.0
"""Target wall time [s] of a compiled call, since a stop is handled only after it; trial steps per second assumed before they are
measured; minimum trial steps of each body in a call."""

FIRST = 0.1
"""Length of the first step, in Rayleigh times."""

ENERGY_FRACTION = 0.1
"""Lower bound of the energy that the springs of a body can store, over load times overlap: half of that at friction 0.3. It
scales errors of the friction work while the load is still being applied."""

UNLOADED = 0.01
"""Assumed radius of the largest contact until a body is loaded, in radii of its smallest sphere."""


class Implicit:
    """Implicit integrator of a state.

    `tangents`: compiled tangents of the laws; `overlap`: expected overlap [m]; `together`: all bodies carry one free plate, the
    last patch. A step ends at every stop, so there are no stops except outputs.
    """

    divisible = False

    def __init__(
        self, state: State, materials: list[Material], tangents: Callable, overlap: float, accuracy: Accuracy | None = None,
        guards: Guards | None = None, together: bool = False,
    ) -> None:  # fmt: skip
        self.meeting = Meeting(self) if state.world.debris_meets else None
        self.plate = CommonPlate(self, state) if together else None
        self.earlier: dict[str, Array] = {}
        """Tables of an earlier instant by their name in a snapshot: a run can go on from there only; empty: from now."""
        self.accuracy = accuracy or Accuracy()
        self.state, self._tangents = state, tangents
        state.inertial = self.accuracy.inertia
        (guards or Guards()).put(state)
        upper = state.world.upper
        self.schedule = Schedule() if upper is None else upper.schedule
        self.drag = np.array(self.schedule.direction())
        times = np.array([rayleigh_time(1.0, m) for m in materials])[state.material] * state.rayleigh_radius
        self.rayleigh = float(times.min())
        own_patches(state)
        self.totals = np.zeros((state.n_bodies, run_totals.WIDTH))
        shared = state.n_bodies if together else 0
        self.starts, self.ends = np.zeros((shared, step_start.WIDTH)), np.zeros((shared, FREEDOMS))
        self.solutions, self.initial_overlaps = np.zeros((shared, body_solution.WIDTH)), np.zeros(0)
        self.paths = np.zeros((state.n_spheres if self.meets else 0, sphere_path.WIDTH))
        self.memory = np.zeros((state.n_bodies, step_memory.WIDTH))
        smallest = np.minimum.reduceat(state.spheres.radius, state.start[:-1])
        self.memory[:, step_memory.NEXT_DT] = FIRST * self.rayleigh
        self.memory[:, step_memory.CONTACT_RADIUS] = UNLOADED * smallest
        self.memory[:, step_memory.LIMIT] = StepLimit.GROWTH
        overlap = overlap if overlap > 0.0 else 1e-4 * float(smallest.min())
        self.memory[:, step_memory.STIFFNESS] = float(state.patches.load.max()) / overlap
        self.memory[:, step_memory.MAX_ENERGY] = ENERGY_FRACTION * float(state.patches.load.max()) * overlap
        self.settings = self.accuracy.settings(state, overlap, self.rayleigh)
        physics = state.physics
        self._law, self._effects, self._observe = (
            address(physics.law, LAW), address(physics.effects, EFFECTS), address(physics.observe, OBSERVE),
        )  # fmt: skip
        self._observe_bodies = address(observe_bodies, OBSERVE_BODIES) if physics.labels else 0
        self._tangent, self._pack, self._parts = address(tangents, LAW), Packer(KINDS), part_addresses(state)
        self.islands: Islands
        self._pack_islands, self.scratch_of_threads = Packer(ISLANDS), ThreadScratch()
        self._measures, self._mapped = arguments_of(state), bool(len(state.maps))
        self.pace = PACE  # trial steps per second in the last call
        self._reported, self._limit = stops.causes(self.memory).copy(), ""  # counters and text of the last `describe_limit`

    @property
    def meets(self) -> bool:
        """Whether bodies have contact with each other."""
        return self.meeting is not None

    @property
    def together(self) -> bool:
        """Whether all bodies share their steps."""
        return self.plate is not None

    def start(self) -> None:
        """Make every sphere a candidate with both plates, for the whole run."""
        state, world = self.state, self.state.world
        state.skin = math.inf
        state.world = replace(world, debris_meets=False)
        search(state)
        state.world = world
        find_minima(state)
        self.max_per_body, self.stride = state.slots.max_per_body, math.inf
        self.edges, self.incidence = state.slots.edges, state.slots.incidence
        if self.plate:
            self.plate.start()
        if self.meeting:
            self.meeting.start()
        else:
            self.connect(single_bodies(state.n_bodies))

    def connect(self, islands: Islands) -> None:
        """Take these islands as those that are advanced."""
        self.islands = islands
        self.initial_overlaps = np.zeros(self.state.slots.count if self.meets or self.together else 0)
        self.scratch_of_threads.fit((*islands.largest(FREEDOMS), self.max_per_body))

    def advance_to(
        self,
        time: float = math.inf,
        distance: float = math.inf,
        watch: Callable[[], None] = lambda: None,
        between: Callable[[], None] = lambda: None,
    ) -> None:
        """Advance all bodies to a time [s] or a sliding distance [m], whichever comes first.

        `watch` is called about every second; if all bodies share their steps, after a fixed number of steps, and `between` after
        all other steps. Raises GuardStop when a body leaves its valid range or no step converges; the bodies then remain at the
        times they have reached.
        """
        state = self.state
        while state.time < time and state.distance < distance:
            stop = min(distance, state.distance + self.stride)
            by_distance = self.schedule.time_of(stop - state.distance, state.time) if math.isfinite(stop) else math.inf
            until = self._until(min(time, by_distance))
            path = self.schedule.path(state.time, until)
            reached = False
            try:
                self._advance_to(until, watch, between)
                reached = True
            finally:
                # also after a guard or an interrupt: bodies are at the times they have reached
                now = until if reached else float(self.totals[:, run_totals.TIME].min())
                self._sum_up(now, self._distance(now, state.distance + path if by_distance > until else stop, reached))
            self.refuse_stopped()

    @property
    def per_call(self) -> int:
        """Largest number of islands in a call."""
        return self.islands.count if self.meeting else BATCH

    def _advance_to(self, until: float, watch: Callable[[], None], between: Callable[[], None]) -> None:
        if self.meeting:
            self.meeting.advance_to(until, watch, between)
        else:
            self.advance_all(until, watch, between)

    def advance_all(self, until: float, watch: Callable[[], None], between: Callable[[], None]) -> None:
        """Advance all islands to a time [s]."""
        if self.plate:
            self.plate.advance_to(until, watch, between)
            return
        for first in range(0, self.islands.count, self.per_call):
            last = min(first + self.per_call, self.islands.count)
            while waiting := self._waiting(first, last, until):
                those = slice(None) if self.meeting else slice(first, last)
                self._call(waiting, partial(self.advance_islands, first, last, until), those)
                watch()
        self.collect()

    def _call(self, bodies: int, advance: Callable[[float], None], those: slice = slice(None)) -> None:
        """Advance so many bodies of `those` by one compiled call; of one trial step, if measures map where they are then."""
        begun, before = clock.perf_counter(), self.memory[those, step_memory.TRIES].sum()
        advance(1.0 if self._mapped else max(FEW, CALL * self.pace / bodies))
        self.pace = float(self.memory[those, step_memory.TRIES].sum() - before) / max(clock.perf_counter() - begun, 1e-9)
        if self._mapped:
            self.collect()

    def collect(self) -> None:
        """Collect what contacts have measured (`engine.measures`), at instants that do not depend on the wall time."""
        if self.meeting:
            self.meeting.collect()
        else:
            update_measures(self.state)

    def _until(self, until: float) -> float:
        """Return the time [s], at most `until`, to which all bodies are advanced next."""
        return self.meeting.until(until) if self.meeting else until

    def _waiting(self, first: int, last: int, until: float) -> int:
        """Return the number of bodies in islands `order[first:last]` that go on and have not reached a time [s]."""
        codes, times = self.memory[:, step_memory.CODE], self.totals[:, run_totals.TIME]
        if not self.meeting:
            return int(np.count_nonzero((codes[first:last] == Stop.NONE) & (times[first:last] < until)))
        return self.islands.waiting(codes != Stop.NONE, times < until)

    def export_state(self) -> tuple[dict[str, Array], dict[str, Any]]:
        """Return arrays and notes with the integrator's own state."""
        arrays = {"totals": self.totals, "memory": self.memory}
        if self.meeting:
            arrays["counts"] = self.meeting.counts
        return (arrays | self.plate.tables() if self.plate else arrays), {}

    def restore(self, arrays: dict[str, Array], notes: dict[str, Any]) -> None:
        """Restore the result of `export_state`, after the state itself was restored. Raises KeyError or TypeError."""
        for name, table in self.export_state()[0].items():
            table[:] = arrays[name]
        self.earlier = {}  # `start` copied the tables that were replaced just now

    def advance_islands(self, first: int, last: int, until: float, tries: float = math.inf) -> None:
        """Advance the islands `order[first:last]`, where bodies meet all, to a time [s], with at most `tries` trial steps each.

        Totals of the run are not updated. Splitting the work into several calls does not change a bit of the result.
        """
        pieces = self.islands.pieces if self.meeting else parts_of(first, last, tries)
        context, tables = self.packed(), self.packed_islands()

        def worker() -> Callable[[tuple[int, int]], None]:
            scratch = self.scratch()
            return lambda piece: driver.advance_islands(*piece, until, tries, context, tables, scratch)

        distribute(pieces, worker)

    def trial(self, bodies: int, until: float) -> None:
        """Advance the first `bodies` bodies, under a common plate all, to a time [s], to measure the cost. Raises GuardStop."""
        if self.plate:
            self.plate.advance_to(until, lambda: None, lambda: None)
            return
        islands = single_bodies(bodies)
        own, meeting = self.islands, self.meeting
        try:
            self.islands, self.meeting = islands, None
            while waiting := self._waiting(0, bodies, until):
                self._call(waiting, partial(self.advance_islands, 0, bodies, until), slice(bodies))
            self.collect()
        finally:
            self.islands, self.meeting = own, meeting
        self.refuse_stopped()

    def scratch(self) -> Array:
        """Return the packed scratch of this thread."""
        return self.scratch_of_threads.of_thread(self._pack.given)

    def packed_islands(self) -> Array:
        """Return the packed tables of the islands."""
        return self._pack_islands(self.islands.tables)

    def packed(self) -> Array:
        """Return the packed kernel arguments."""
        s, slots, physics = self.state, self.state.slots, self.state.physics
        force, moment, twist = physics.force_columns
        begin, size = physics.field
        return self._pack(
            ImplicitContext(  # type: ignore[call-arg]
                own=slots.own, partner=slots.partner, kind=slots.kind, edges=slots.edges, incidence=slots.incidence,
                plate_edges=self.edges, plate_incidence=self.incidence,
                body=s.body, start=s.start, offsets=s.offsets, B=s.B, E=s.E, orientations=s.orientations, P=s.P, Q=slots.Q,
                **self._contact_tables(), M=s.M, pairs=physics.pairs, interaction=physics.interaction,
                effect_parameters=physics.effect_parameters, D=s.D, drag=self.drag, lower=s.lower_surface, upper=s.upper_surface,
                n_history=len(physics.history), field_begin=begin, field_size=size, rolling=physics.rolling,
                force=force, moment=moment, twist=twist, stored=physics.stored, dashpots=physics.dashpots,
                loss_column=physics.loss_column, width=loaded_contact.MEMORY + physics.contact_memory,
                has_effects=int(physics.has_effects), law=self._law, effects=self._effects, observe=self._observe,
                observe_bodies=self._observe_bodies, patch=s.patch,
                settings=self.settings, totals=self.totals, memory=self.memory, schedule=s.schedule, first=s.first,
                starts=self.starts, ends=self.ends, solutions=self.solutions, initial_overlaps=self.initial_overlaps,
                labels=int(physics.labels), tangents=self._tangent,
                paths=self.paths, **self._parts, **self._measures,
            )
        )  # fmt: skip

    def _contact_tables(self) -> dict[str, Array]:
        """Return spheres, histories and records."""
        return {"S": self.state.S, "H": self.state.slots.H, "R": self.state.slots.R}

    def _summed(self) -> Array:
        """Return the totals summed over all bodies, and those of a common plate."""
        summed = self.totals.sum(axis=0)
        return summed + self.plate.totals if self.plate else summed

    def _distance(self, time: float, whole: float, reached: bool) -> float:
        """Return the sliding distance [m] at a time [s]; `whole` if the stop was reached."""
        return whole if reached else self.state.distance + self.schedule.path(self.state.time, time)

    def _sum_up(self, time: float, distance: float) -> None:
        """Update the totals of the run from those of the bodies."""
        A = self.state.A
        summed = self._summed()
        for column in (
            run_totals.FRICTION_WORK, run_totals.DAMPING_WORK, run_totals.PLATE_WORK, run_totals.DRAG_WORK,
            run_totals.PLATE_WORK_SIZE, run_totals.EFFECT_WORK, run_totals.NUMERICAL_LOSS, run_totals.STEPS,
            *range(run_totals.UPPER_IMPULSE, run_totals.UPPER_IMPULSE + 6),
            *range(run_totals.UPPER_FORCE, run_totals.UPPER_FORCE + 6),
            *range(run_totals.DIRECT_WORK, run_totals.DIRECT_FORCE + 3),
        ):  # fmt: skip
            A[column] = summed[column]
        A[run_totals.TIME], A[run_totals.DISTANCE] = time, distance
        ahead = self.totals[int(np.argmax(self.totals[:, run_totals.TIME]))]
        A[run_totals.PLATE_SPEED] = ahead[run_totals.PLATE_SPEED]
        A[run_totals.HEADING2] = ahead[run_totals.HEADING2]
        P = self.state.P
        if len(P) > self.state.n_bodies:  # the last row is the common plate, at the time of the run
            behind = int(np.argmin(self.totals[:, run_totals.TIME]))
            P[-1, patch.DISPLACEMENT2] = P[self.state.patch[behind], patch.DISPLACEMENT2]
        if self.schedule.gap and self.state.world.upper is not None and self.state.world.upper.foundation is not None:
            self.state.patches.height[-1] = at_time(self.schedule.gap, time)

    def refuse_stopped(self) -> None:
        """Raise GuardStop for the first stopped body; with `skip_unsolved`, bodies without a solution are skipped."""
        codes = self.memory[:, step_memory.CODE]
        stopped = np.flatnonzero(codes != Stop.NONE)
        if self.accuracy.skip_unsolved:
            stopped = stopped[codes[stopped] != Stop.UNSOLVED]
        if len(stopped):
            raise GuardStop(stops.explain(self, int(stopped[0])))

    def refuse_created_energy(self) -> None:
        """Raise GuardStop if the integrator has created more than stops.CREATED_ENERGY_GUARD of the exchanged energy."""
        stored = stops.body_energies(self.state, self.memory[:, step_memory.STORED])
        built, whole = stops.created_fractions(self.totals, stored, self._summed())
        body = int(np.argmax(built))
        if built[body] > stops.CREATED_ENERGY_GUARD:
            fraction, who, when = built[body], stops.name_of(body, self.state), self.totals[body, run_totals.TIME]
        elif whole > stops.CREATED_ENERGY_GUARD:
            fraction, who, when = whole, "all bodies and the upper plate together", self.totals[:, run_totals.TIME].min()
        else:
            return
        inertia = "" if self.accuracy.inertia else "solver.inertia = true, or "
        raise GuardStop(
            f"stopped at t = {when:.6g} s: the integrator has created energy: {100.0 * fraction:.0f} % of all that was exchanged "
            f"(guard: {100.0 * stops.CREATED_ENERGY_GUARD:g} %), by {who}; {inertia}a smaller solver.tolerance or "
            f"solver.largest_step is needed, "
            "or a contact law that creates no energy (thirdbody laws --check)"
        )

    def summary(self) -> dict[str, Any]:
        """Return the entries of the run summary about the integration; steps are counted per body."""
        steps, T, state = self.totals[:, run_totals.STEPS], self.memory, self.state
        total = max(float(steps.sum()), 1.0)
        lost = np.flatnonzero(T[:, step_memory.CODE] == Stop.UNSOLVED)
        return {
            "integrator": "implicit",
            "steps": int(steps.sum()),
            "sphere_steps": int(steps @ np.diff(state.start)),
            "steps_per_body": float(steps.mean()),
            "longest_step": float(T[:, step_memory.LONGEST_DRAG].max()),
            "iterations_per_step": float(T[:, step_memory.ITERATIONS].sum()) / total,
            "cuts_per_step": float(T[:, step_memory.CUTS].sum()) / total,
            "hard_steps": float(T[:, step_memory.HARD_STEPS].sum()) / total,
            "steps_limited_by": stops.limited_by(T),
            "limiting_body": stops.limiting_body(T, state.order),
            "unsolved": {int(body): stops.explain(self, int(body)) for body in lost},
        } | ({"islands": self.meeting.summary()} if self.meeting else {})

    def describe_limit(self) -> str:
        """Return, as text, the most frequent step limit since the last call; empty before the first step."""
        before, self._reported = self._reported, stops.causes(self.memory).copy()
        self._limit = stops.in_words(self._reported - before, self.state.order) or self._limit
        return self._limit

    def mean_time(self) -> float:
        """Return the mean time [s] reached by the bodies: between two stops their times differ."""
        return float(self.totals[:, run_totals.TIME].mean())

    def label(self) -> Array:
        """Return state, reason, margins and extras of each body now (columns named by the labeller)."""
        return labels(self.state, self.drag)
