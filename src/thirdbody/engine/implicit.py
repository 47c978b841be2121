"""Implicit integrator (BDF2, backward-Euler starts) of islands of bodies.

Solved with the tangents of the laws, a body between the plates needs no steps that resolve elastic waves: steps are as long as
the motion allows. Bodies that could meet form islands, which are solved as one system (`engine.meeting`). Between two outputs
islands are independent, with individual time steps, unless all bodies carry one plate (`engine.common_plate`). Results are
bit-identical for any number of threads.
"""

import math
import time as clock
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from thirdbody.engine import accuracy as limits
from thirdbody.engine.accuracy import CREATED_ENERGY_GUARD, Accuracy
from thirdbody.engine.common_plate import CommonPlate
from thirdbody.engine.guards import name_of, partner_of, set_guards
from thirdbody.engine.islands import Islands, ThreadScratch, island_stride, single_bodies
from thirdbody.engine.measures import labels, update_measures
from thirdbody.engine.meeting import Meeting
from thirdbody.engine.neighbours import search, update_closest_points
from thirdbody.engine.state import SUMMED, Action, Array, State, constant_arguments, rayleigh_times, table_arguments
from thirdbody.engine.units import BATCH
from thirdbody.engine.upper_plate import at_time
from thirdbody.errors import GuardStop
from thirdbody.jit.arguments import Packer, address
from thirdbody.jit.threads import MIN_BODIES, distribute, parts_of, pieces_of
from thirdbody.kernels.arguments import LAW
from thirdbody.kernels.implicit import at_rest, books, driver, pairs, rough, spots_part
from thirdbody.kernels.implicit.control import BodyStop, StepLimit
from thirdbody.kernels.implicit.workspace import FREEDOMS, ISLANDS, KINDS, PART, STAGE, UPDATE_MINIMA, ImplicitContext
from thirdbody.kernels.step_tables import body_solution, sphere_path, step_memory, step_settings, step_start
from thirdbody.kernels.tables import body, domain, patch, run_totals, surface_contact
from thirdbody.kernels.tile import TILE
from thirdbody.laws.contract import Material

CALL, PACE, FEW = 1.0, 1e4, 8.0
"""Target wall time [s] of a compiled call, since a stop is handled only after it; trial steps per second assumed before they are
measured; minimum trial steps of each body in a call."""

FIRST = 0.1  # length of the first step, in Rayleigh times

ENERGY_FRACTION = 0.1
"""Lower bound of the energy that the springs of a body can store, over load times overlap: half of that at friction 0.3. It
scales errors of the friction work while the load is still being applied."""

UNLOADED = 0.01  # assumed radius of the largest contact until a body is loaded, in radii of its smallest sphere


class Implicit:
    """Implicit integrator of a state.

    `tangents`: compiled tangents of the laws; `overlap`: expected overlap [m]; `together`: all bodies carry one free plate, the
    last patch. A step ends at every stop, so there are no stops except outputs."""

    divisible = False

    def __init__(
        self, state: State, materials: list[Material], tangents: Callable, overlap: float, accuracy: Accuracy | None = None,
        together: bool = False,
    ) -> None:  # fmt: skip
        self.meeting = Meeting(self) if state.world.debris_meets else None
        self.plate = CommonPlate(self, state, together) if together or state.sprung else None
        self.earlier: dict[str, Array] = {}
        """Tables of an earlier instant by their name in a snapshot: a run can go on from there only; empty: from now."""
        self.accuracy = accuracy or Accuracy()
        self.state, self._tangents = state, tangents
        state.inertial = self.accuracy.inertia
        set_guards(state)
        self.schedule = state.world.schedule
        self.drag = np.array(self.schedule.direction())
        self.rayleigh = float(rayleigh_times(state, materials).min())
        if state.world.upper is not None and len(state.P) == 1 and state.patches.free[0] == 0.0:
            # a copy of a plate of prescribed height for each body, since bodies are at different times
            state.P, state.patch = np.repeat(state.P, state.n_bodies, axis=0), np.arange(state.n_bodies)
        self.totals = np.zeros((state.n_bodies, run_totals.WIDTH))
        shared = state.n_bodies if self.plate else 0
        self.starts, self.ends = np.zeros((shared, step_start.WIDTH)), np.zeros((shared, FREEDOMS))
        self.solutions = np.zeros((shared, body_solution.WIDTH))
        self.paths = np.zeros((state.n_spheres if self.meets else 0, sphere_path.WIDTH))
        self.memory = np.zeros((state.n_bodies, step_memory.WIDTH))
        smallest = np.minimum.reduceat(state.spheres.radius, state.start[:-1])
        self.memory[:, step_memory.NEXT_DT] = FIRST * self.rayleigh
        self.memory[:, step_memory.CONTACT_RADIUS] = self.memory[:, step_memory.DRAG_RADIUS] = UNLOADED * smallest
        self.memory[:, step_memory.LIMIT] = StepLimit.GROWTH
        overlap = overlap if overlap > 0.0 else 1e-4 * float(smallest.min())
        self.memory[:, step_memory.STIFFNESS] = float(state.patches.load.max()) / overlap
        self.memory[:, step_memory.MAX_ENERGY] = ENERGY_FRACTION * float(state.patches.load.max()) * overlap
        self.settings = self.accuracy.settings(state, overlap, self.rayleigh)
        self._constant = constant_arguments(state, self.drag) | part_addresses(state, tangents) | {
            "settings": self.settings, "totals": self.totals, "memory": self.memory, "starts": self.starts, "ends": self.ends,
            "solutions": self.solutions, "paths": self.paths,
        }  # fmt: skip
        self._pack, self.pack_islands, self.scratch_of_threads = Packer(KINDS), Packer(ISLANDS), ThreadScratch()
        self.islands: Islands
        self._mapped = bool(len(state.maps))
        self.pace = PACE  # trial steps per second in the last call
        self._reported, self._limit = limits.causes(self.memory).copy(), ""  # counters and text of the last `describe_limit`

    @property
    def meets(self) -> bool:
        return self.meeting is not None

    @property
    def together(self) -> bool:
        return self.plate is not None

    def start(self) -> None:
        """Make every sphere a candidate with both plates, for the whole run."""
        state, world = self.state, self.state.world
        state.skin = math.inf
        state.world = replace(world, debris_meets=False)
        search(state)
        state.world = world
        if world.rough:  # the contacts that spheres can have with rough plates within the first step
            state.slots.Q[:, surface_contact.SEARCHED] = math.inf
            update_closest_points(state, partial(rough.update_minima, STAGE.ACCEPT))
        self.max_per_body, self.stride = state.slots.max_per_body, island_stride(state)
        self.edges, self.incidence = state.slots.edges, state.slots.incidence
        if self.plate:
            self.plate.start()
        if self.meeting:
            self.meeting.search()
        else:
            self.connect(single_bodies(state.n_bodies))

    def connect(self, islands: Islands) -> None:
        self.islands = islands
        self.start_depths = np.zeros(self.state.slots.count)
        self.scratch_of_threads.fit((*islands.largest(), self.max_per_body))

    def advance_to(
        self, time: float = math.inf, distance: float = math.inf, watch: Action = lambda: None, between: Action = lambda: None
    ) -> None:
        """Advance all bodies to a time [s] or a sliding distance [m], whichever comes first. `watch` is called about every
        second; if all bodies share their steps, after a fixed number of steps, and `between` after all others. Raises GuardStop
        when a body leaves its valid range or no step converges; bodies stay at the times reached."""
        state, advance = self.state, self.meeting.advance_to if self.meeting else self.advance_all
        while state.time < time and state.distance < distance:
            stop = min(distance, state.distance + self.stride)
            by_distance = self.schedule.time_of(stop - state.distance, state.time) if math.isfinite(stop) else math.inf
            until = min(time, by_distance)
            if self.meeting:
                until = self.meeting.until(until)
            try:
                advance(until, watch, between)
            except BaseException:  # a guard or an interrupt: bodies are at the times they have reached
                now = float(self.totals[:, run_totals.TIME].min())
                self._sum_up(now, state.distance + self.schedule.path(state.time, now))
                raise
            path = self.schedule.path(state.time, until)
            self._sum_up(until, state.distance + path if by_distance > until else stop)
            self.refuse_stopped()

    @property
    def per_call(self) -> int:
        return self.islands.count if self.meeting else BATCH

    def advance_all(self, until: float, watch: Action, between: Action) -> None:
        if self.plate:
            self.plate.advance_to(until, watch, between)
            return
        for first in range(0, self.islands.count, self.per_call):
            last = min(first + self.per_call, self.islands.count)
            tries = self.memory[slice(None) if self.meeting else slice(first, last), step_memory.TRIES]
            while waiting := self._waiting(first, last, until):
                begun, before = clock.perf_counter(), tries.sum()
                # a call is of one trial step, if measures map where bodies are then
                self.advance_islands(first, last, until, 1.0 if self._mapped else max(FEW, CALL * self.pace / waiting))
                self.pace = float(tries.sum() - before) / max(clock.perf_counter() - begun, 1e-9)
                if self._mapped:
                    self.collect()
                watch()
        self.collect()

    def collect(self) -> None:
        """Collect what contacts have measured, at instants that do not depend on the wall time."""
        if self.meeting:
            self.meeting.collect()
        else:
            update_measures(self.state)

    def _waiting(self, first: int, last: int, until: float) -> int:
        codes, times = self.memory[:, step_memory.CODE], self.totals[:, run_totals.TIME]
        if not self.meeting:
            return int(np.count_nonzero((codes[first:last] == BodyStop.NONE) & (times[first:last] < until)))
        return self.islands.waiting(codes != BodyStop.NONE, times < until)

    def export_state(self) -> tuple[dict[str, Array], dict[str, Any]]:
        arrays = {"totals": self.totals, "memory": self.memory}
        if self.meeting:
            arrays["counts"] = self.meeting.counts
        return (arrays | self.plate.tables() if self.plate else arrays), {}

    def restore(self, arrays: dict[str, Array], notes: dict[str, Any]) -> None:
        for name, table in self.export_state()[0].items():
            table[:] = arrays[name]
        self.earlier = {}  # `start` copied the tables that were replaced just now

    def advance_islands(self, first: int, last: int, until: float, tries: float = math.inf) -> None:
        """Advance the islands `order[first:last]`, where bodies meet all, to a time [s], with at most `tries` trial steps each.
        Totals of the run are not updated. Splitting the work into several calls does not change a bit of the result."""
        pieces = self.islands.pieces if self.meeting else parts_of(first, last, tries)
        self.each_island(pieces, driver.advance_islands, until, tries)

    def each_island(self, pieces: list[tuple[int, int]], kernel: Callable[..., None], *step: Any) -> None:
        context, tables = self.packed(), self.pack_islands(self.islands.tables)

        def worker() -> Callable[[tuple[int, int]], None]:
            scratch = self.scratch()
            return lambda piece: kernel(*piece, *step, context, tables, scratch)

        distribute(pieces, worker)

    def trial(self, bodies: int, until: float) -> None:
        """Advance the first `bodies` bodies, under a common plate all, to a time [s], to measure the cost. Raises GuardStop."""
        own, meeting = self.islands, self.meeting
        try:
            if not self.plate:
                self.islands, self.meeting = single_bodies(bodies), None
            self.advance_all(until, lambda: None, lambda: None)
        finally:
            self.islands, self.meeting = own, meeting
        self.refuse_stopped()

    def scratch(self) -> Array:
        return self.scratch_of_threads.of_thread(self._pack.given)

    def packed(self) -> Array:
        return self._pack(
            ImplicitContext(  # type: ignore[call-arg]
                **self._constant, **table_arguments(self.state), kind=self.state.slots.kind, plate_edges=self.edges,
                plate_incidence=self.incidence, start_depths=self.start_depths,
            )
        )  # fmt: skip

    def _summed(self) -> Array:
        summed = self.totals.sum(axis=0)
        return summed + self.plate.totals if self.plate else summed

    def _sum_up(self, time: float, distance: float) -> None:
        A, P, summed, upper = self.state.A, self.state.P, self._summed(), self.state.world.upper
        for column in (*SUMMED, run_totals.NUMERICAL_LOSS, run_totals.STEPS):
            A[column] = summed[column]
        A[run_totals.TIME], A[run_totals.DISTANCE] = time, distance
        ahead = self.totals[int(np.argmax(self.totals[:, run_totals.TIME]))]
        A[run_totals.PLATE_SPEED], A[run_totals.HEADING2] = ahead[run_totals.PLATE_SPEED], ahead[run_totals.HEADING2]
        if len(P) > self.state.n_bodies:  # the last row is the common plate, at the time of the run
            behind = int(np.argmin(self.totals[:, run_totals.TIME]))
            P[-1, patch.DISPLACEMENT2] = P[self.state.patch[behind], patch.DISPLACEMENT2]
        if self.schedule.gap and upper and upper.foundation:
            P[-1, patch.HEIGHT] = at_time(self.schedule.gap, time)

    def refuse_stopped(self) -> None:
        """Raise GuardStop for the first stopped body; with `skip_unsolved`, bodies without a solution are skipped."""
        codes = self.memory[:, step_memory.CODE]
        stopped = np.flatnonzero(codes != BodyStop.NONE)
        if self.accuracy.skip_unsolved:
            stopped = stopped[codes[stopped] != BodyStop.UNSOLVED]
        if len(stopped):
            raise GuardStop(self.explain(int(stopped[0])))

    def refuse_created_energy(self) -> None:
        """Raise GuardStop if the integrator has created more than CREATED_ENERGY_GUARD of the exchanged energy."""
        stored = limits.body_energies(self.state, self.memory[:, step_memory.STORED])
        built, whole = limits.created_fractions(self.totals, stored, self._summed())
        body = int(np.argmax(built))
        if built[body] > CREATED_ENERGY_GUARD:
            fraction, who, when = built[body], name_of(body, self.state), self.totals[body, run_totals.TIME]
        elif whole > CREATED_ENERGY_GUARD:
            fraction, who, when = whole, "all bodies and the upper plate together", self.totals[:, run_totals.TIME].min()
        else:
            return
        inertia = "" if self.accuracy.inertia else "solver.inertia = true, or "
        raise GuardStop(
            f"stopped at t = {when:.6g} s: the integrator has created energy: {100.0 * fraction:.0f} % of all that was exchanged "
            f"(guard: {100.0 * CREATED_ENERGY_GUARD:g} %), by {who}; {inertia}a smaller solver.tolerance or solver.largest_step "
            "is needed, or a contact law that creates no energy (thirdbody laws --check)"
        )

    def summary(self) -> dict[str, Any]:
        steps, T, state = self.totals[:, run_totals.STEPS], self.memory, self.state
        total = max(float(steps.sum()), 1.0)
        lost = np.flatnonzero(T[:, step_memory.CODE] == BodyStop.UNSOLVED)
        return {
            "integrator": "implicit", "steps": int(steps.sum()), "sphere_steps": int(steps @ np.diff(state.start)),
            "steps_per_body": float(steps.mean()), "longest_step": float(T[:, step_memory.LONGEST_DRAG].max()),
            "iterations_per_step": float(T[:, step_memory.ITERATIONS].sum()) / total,
            "cuts_per_step": float(T[:, step_memory.CUTS].sum()) / total,
            "hard_steps": float(T[:, step_memory.HARD_STEPS].sum()) / total,
            "steps_limited_by": limits.limited_by(T), "limiting_body": limits.limiting_body(T, state.order),
            "unsolved": {int(body): self.explain(int(body)) for body in lost},
        } | ({"islands": self.meeting.summary()} if self.meeting else {})  # fmt: skip

    def explain(self, body: int) -> str:
        s, totals = self.state, self.totals[body]
        code, when = int(self.memory[body, step_memory.CODE]), f"stopped at t = {totals[run_totals.TIME]:.6g} s"
        who = name_of(body, s)
        if code == BodyStop.OVERLAP:
            slot = int(self.memory[body, step_memory.SLOT])
            own, partner = int(s.slots.own[slot]), int(s.slots.partner[slot])
            radius = s.spheres.radius[own] if partner < 0 else min(s.spheres.radius[own], s.spheres.radius[partner])
            ratio, limit = s.slots.records.overlap[slot] / radius, s.D[domain.OVERLAP_GUARD]
            text = f"sinks into {partner_of(s, slot, body)} by {ratio:.2f} of the radius (guard: {limit:g})"
            return f"{when}: {who} {text}; a lower load is needed"
        if code == BodyStop.LEFT:
            return f"{when}: {who} left the domain"
        if code == BodyStop.CROWDED:
            return f"{when}: {who} has more than {TILE} loaded spots, which the implicit integrator cannot hold"
        if code == BodyStop.BAD_BODY:
            return f"{when}: the position of body {s.order[body]} is not a number"
        slots, loaded = s.slots, []
        for entry in slots.incidence[slots.edges[body] : slots.edges[body + 1]]:
            k = entry >> 1
            if slots.histories.slip[k] > 0.0:
                sphere = int((slots.partner[k] if entry & 1 else slots.own[k]) - s.start[body])
                force, shear = slots.records.normal_force[k], float(np.linalg.norm(slots.records.tangential_force[k]))
                loaded.append(f"sphere {sphere} on {partner_of(s, k, body)} with N = {force:.3g} N, T = {shear:.3g} N")
        shortest, spots = self.settings[step_settings.SHORTEST], "; ".join(loaded) or "none"
        return f"{when}: no step of {who} could be solved, down to {shortest:.2g} s; its loaded spots: {spots}"

    def describe_limit(self) -> str:
        """Return, as text, the most frequent step limit since the last call; empty before the first step."""
        before, self._reported = self._reported, limits.causes(self.memory).copy()
        self._limit = limits.in_words(self._reported - before, self.state.order) or self._limit
        return self._limit

    def mean_time(self) -> float:
        return float(self.totals[:, run_totals.TIME].mean())

    def evaluate(self) -> None:
        """Evaluate the contacts with the plates anew where all bodies are, at a stop: the plates have changed their surfaces."""
        state = self.state
        forces = [state.B[:, columns] for columns in (body.FORCE3, body.TORQUE3)]
        before = [each.copy() for each in forces]  # those of the last step, with contacts between bodies
        state.slots.Q[:, surface_contact.SEARCHED] = math.inf
        update_closest_points(state, partial(rough.update_minima, STAGE.ACCEPT))
        self.each_island(pieces_of(0, self.islands.count, MIN_BODIES), at_rest.evaluate_islands)
        for each, old in zip(forces, before, strict=True):
            each[:] = old
        if self.plate:
            self.plate.memory[step_memory.LAST_DT] = 0.0
        self._sum_up(state.time, state.distance)

    def label(self) -> Array:
        return labels(self.state, self.drag)


def part_addresses(state: State, tangents: Callable) -> dict[str, int]:
    """Return the addresses of the functions by their names in `workspace.KINDS`; 0 for parts that a state does not need."""
    pairs_meet, rough_plates = state.world.debris_meets, state.world.rough
    parts: dict[str, tuple[bool, Any, Any]] = {
        "tangents": (True, tangents, LAW), "book_contacts": (True, books.book_contacts, books.BOOK),
        "write_contacts": (True, books.write_contacts, books.WRITE),
        "end_contact": (True, books.end_contact, books.END), "pairs_part": (pairs_meet, pairs.pairs_part, PART),
        "update_minima": (rough_plates, rough.update_minima, UPDATE_MINIMA),
        "rough_part": (rough_plates, rough.rough_part, PART),
        "spots_part": (len(state.physics.interaction) > 0, spots_part.spots_part, PART),
    }  # fmt: skip
    return {name: address(function, kind) if needed else 0 for name, (needed, function, kind) in parts.items()}
