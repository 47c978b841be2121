"""Implicit integrator (BDF2, backward-Euler starts) for bodies that touch only the plates.

A body between the plates is a small problem with six coordinates and the height of its patch. Solved with the tangents of the
laws, it needs no steps that resolve elastic waves: steps are as long as the motion allows, and their number does not depend on
the speed of the drag. Between two outputs bodies are independent, with individual time steps; results are bit-identical for any
number of threads.
"""

import math
import time as clock
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from thirdbody.engine.accuracy import Accuracy
from thirdbody.engine.candidates import Numbers
from thirdbody.engine.contact_words import loaded_spots, partner_of
from thirdbody.engine.guards import Guards
from thirdbody.engine.implicit_surfaces import find_minima, surface_updates
from thirdbody.engine.labels import labels
from thirdbody.engine.measures import arguments_of, update_measures
from thirdbody.engine.neighbours import search
from thirdbody.engine.numerical_energy_guard import CREATED_ENERGY_GUARD, body_energies, created_fractions
from thirdbody.engine.plate_copies import own_patches
from thirdbody.engine.rayleigh_time import rayleigh_time
from thirdbody.engine.state import Array, State
from thirdbody.engine.step_limits import causes, in_words, limited_by, limiting_body
from thirdbody.engine.upper_plate import Schedule, at_time
from thirdbody.errors import GuardStop
from thirdbody.jit.arguments import Packer, address
from thirdbody.jit.threads import distribute, parts_of
from thirdbody.kernels.implicit.body_driver import advance_bodies
from thirdbody.kernels.implicit.bundles import FREEDOMS, KINDS, ImplicitContext
from thirdbody.kernels.implicit.step_control import Stop
from thirdbody.kernels.implicit.step_limits import StepLimit
from thirdbody.kernels.implicit.tables import body_solution, sphere_path, step_memory, step_settings, step_start
from thirdbody.kernels.signatures import EFFECTS, LAW, OBSERVE
from thirdbody.kernels.tables import domain, loaded_contact, patch, run_totals
from thirdbody.kernels.tile import TILE
from thirdbody.laws.contract import Material

BATCH = 512
"""Bodies per call, or per part of one."""

CALL, PACE, FEW = 1.0, 1e4, 8.0
"""Target wall time [s] of a compiled call, since a stop is handled only after it; trial steps per second assumed before they are
measured; minimum trial steps of each body in a call."""

FIRST, SHORTEST = 0.1, 1e-6
"""Length of the first step and of the shortest trial step, in Rayleigh times."""

WORK = 4.0
"""Tolerance of the friction work of a body in a step over `tolerance`, relative to its scale of energy (`friction_work`). Of 20
rolling bodies the friction work is then right to 1.2 % in the median and 9.4 % at worst, with 5 to 1.3 and 10.6 %
(`tests/theory/test_friction_work_of_rolling.py`)."""

WORK_OF_SPRINGS = 80.0
"""WORK for laws that keep a field of springs (`mdr`, `exact`): the dissipation of each spring is exact in a step, so the
difference between the work of the mean force and of the force at the end overestimates the error. Of 20 rolling bodies the
friction work is then right to 0.5 % in the median and 6 % at worst; with WORK to 0.2 and 2 %, in 45 % more steps."""

ENERGY_FRACTION = 0.1
"""Lower bound of the energy that the springs of a body can store, over load times overlap: half of that at friction 0.3. It
scales errors of the friction work while the load is still being applied."""

UNLOADED = 0.01
"""Assumed radius of the largest contact until a body is loaded, in radii of its smallest sphere."""


class Implicit:
    """Implicit integrator of a state whose bodies touch only the plates.

    `tangents`: compiled tangents of the laws; `overlap`: expected overlap [m]. A step ends at every stop, so there are no stops
    except outputs.
    """

    divisible, together = False, False
    meets = False
    """Whether bodies have contact with each other."""
    earlier: dict[str, Array] = {}
    """Tables of an earlier instant by their name in a snapshot: a run can go on from there only; empty: from now."""

    def __init__(
        self, state: State, materials: list[Material], tangents: Callable, overlap: float, accuracy: Accuracy | None = None,
        guards: Guards | None = None,
    ) -> None:  # fmt: skip
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
        # of bodies under a common plate (`implicit_common_plate`)
        self.starts, self.ends = np.zeros((0, step_start.WIDTH)), np.zeros((0, FREEDOMS))
        self.solutions, self.initial_overlaps = np.zeros((0, body_solution.WIDTH)), np.zeros(0)
        self.paths = np.zeros((0, sphere_path.WIDTH))  # where bodies meet
        self.memory = np.zeros((state.n_bodies, step_memory.WIDTH))
        smallest = np.minimum.reduceat(state.spheres.radius, state.start[:-1])
        self.memory[:, step_memory.NEXT_DT] = FIRST * self.rayleigh
        self.memory[:, step_memory.CONTACT_RADIUS] = UNLOADED * smallest
        self.memory[:, step_memory.LIMIT] = StepLimit.GROWTH
        overlap = overlap if overlap > 0.0 else 1e-4 * float(smallest.min())
        self.memory[:, step_memory.STIFFNESS] = float(state.patches.load.max()) / overlap
        self.memory[:, step_memory.MAX_ENERGY] = ENERGY_FRACTION * float(state.patches.load.max()) * overlap
        self.settings = self._settings(overlap)
        physics = state.physics
        self._law, self._effects, self._observe = (
            address(physics.law, LAW), address(physics.effects, EFFECTS), address(physics.observe, OBSERVE),
        )  # fmt: skip
        self._tangent, self._pack, self._surface_updates = address(tangents, LAW), Packer(KINDS), surface_updates(state)
        self._measures, self._mapped = arguments_of(state), bool(len(state.maps))
        self.pace = PACE  # trial steps per second in the last call
        self._reported, self._limit = causes(self.memory).copy(), ""  # counters and text of the last `describe_limit`

    def _settings(self, overlap: float) -> Array:
        V, chosen = np.zeros(step_settings.WIDTH), self.accuracy
        V[step_settings.TOLERANCE] = chosen.tolerance
        V[step_settings.LONGEST] = chosen.largest_step
        V[step_settings.RADII] = chosen.radii
        V[step_settings.SHORTEST], V[step_settings.INERTIAL] = SHORTEST * self.rayleigh, float(chosen.inertia)
        V[step_settings.EXPECTED_OVERLAP], V[step_settings.GROWTH] = overlap, chosen.growth
        springs = any(name.endswith(".field[0]") for name in self.state.physics.history)
        V[step_settings.WORK] = (WORK_OF_SPRINGS if springs else WORK) * chosen.tolerance
        return V

    def start(self) -> None:
        """Make every sphere a candidate with both plates, for the whole run."""
        state, world = self.state, self.state.world
        state.skin = math.inf
        state.world = replace(world, debris_meets=False)
        search(state)
        state.world = world
        find_minima(state)
        self.max_per_body = state.slots.max_per_body
        self.stride = math.inf

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
            self._refuse_stopped()

    @property
    def per_call(self) -> int:
        """Largest number of bodies in a call."""
        return BATCH

    def _advance_to(self, until: float, watch: Callable[[], None], _between: Callable[[], None]) -> None:
        for first in range(0, self.state.n_bodies, self.per_call):
            last = min(first + self.per_call, self.state.n_bodies)
            while waiting := self._waiting(first, last, until):
                self._call(waiting, partial(self.advance_bodies, first, last, until), slice(first, last))
                watch()
        self._collect()

    def _call(self, bodies: int, advance: Callable[[float], None], those: slice = slice(None)) -> None:
        """Advance so many bodies of `those` by one compiled call; of one trial step, if measures map where they are then."""
        begun, before = clock.perf_counter(), self.memory[those, step_memory.TRIES].sum()
        advance(1.0 if self._mapped else max(FEW, CALL * self.pace / bodies))
        self.pace = float(self.memory[those, step_memory.TRIES].sum() - before) / max(clock.perf_counter() - begun, 1e-9)
        if self._mapped:
            self._collect()

    def _collect(self) -> None:
        """Collect what contacts have measured (`engine.measures`), at instants that do not depend on the wall time."""
        update_measures(self.state)

    def _until(self, until: float) -> float:
        """Return the time [s], at most `until`, to which all bodies are advanced next."""
        return until

    def _waiting(self, first: int, last: int, until: float) -> int:
        """Return the number of running bodies that have not reached a time [s] (relevant after resume)."""
        going = self.memory[first:last, step_memory.CODE] == Stop.NONE
        return int(np.count_nonzero(going & (self.totals[first:last, run_totals.TIME] < until)))

    def export_state(self) -> tuple[dict[str, Array], dict[str, Any]]:
        """Return arrays and notes with the integrator's own state."""
        return {"totals": self.totals, "memory": self.memory}, {}

    def restore(self, arrays: dict[str, Array], notes: dict[str, Any]) -> None:
        """Restore the result of `export_state`, after the state itself was restored. Raises KeyError or TypeError."""
        for name, table in Implicit.export_state(self)[0].items():
            table[:] = arrays[name]

    def advance_bodies(self, first: int, last: int, until: float, tries: float = math.inf) -> None:
        """Advance bodies `first` to `last` - 1 to a time [s], with at most `tries` trial steps each.

        Totals of the run are not updated. Splitting the work into several calls does not change a bit of the result.
        """
        context = self._context()
        distribute(parts_of(first, last, tries), lambda: lambda part: advance_bodies(*part, until, tries, context))

    def trial(self, bodies: int, until: float) -> None:
        """Advance the first `bodies` bodies to a time [s], with what measures collect, to measure the cost. Raises GuardStop."""
        while waiting := self._waiting(0, bodies, until):
            self._call(waiting, partial(self.advance_bodies, 0, bodies, until), slice(bodies))
        self._collect()
        self._refuse_stopped()

    def _context(self) -> Array:
        """Return the packed kernel arguments."""
        s, slots, physics = self.state, self.state.slots, self.state.physics
        (force, moment, twist), (edges, incidence) = physics.force_columns, self._plate_candidates()
        begin, size = physics.field
        return self._pack(
            ImplicitContext(  # type: ignore[call-arg]
                own=slots.own, partner=slots.partner, kind=slots.kind, edges=edges, incidence=incidence,
                body=s.body, start=s.start, offsets=s.offsets, B=s.B, E=s.E, orientations=s.orientations, P=s.P, Q=slots.Q,
                **self._contact_tables(), M=s.M, pairs=physics.pairs, interaction=physics.interaction,
                effect_parameters=physics.effect_parameters, D=s.D, drag=self.drag, lower=s.lower_surface, upper=s.upper_surface,
                n_history=len(physics.history), field_begin=begin, field_size=size, rolling=physics.rolling,
                force=force, moment=moment, twist=twist, stored=physics.stored, dashpots=physics.dashpots,
                loss_column=physics.loss_column, width=loaded_contact.MEMORY + physics.contact_memory,
                has_effects=int(physics.has_effects), law=self._law, effects=self._effects, observe=self._observe, patch=s.patch,
                settings=self.settings, totals=self.totals, memory=self.memory, schedule=s.schedule, first=s.first,
                starts=self.starts, ends=self.ends, solutions=self.solutions, initial_overlaps=self.initial_overlaps,
                max_per_body=self.max_per_body, labels=int(physics.labels), tangents=self._tangent,
                paths=self.paths, **self._surface_updates._asdict(), **self._measures,
            )
        )  # fmt: skip

    def _contact_tables(self) -> dict[str, Array]:
        """Return spheres, histories and records."""
        return {"S": self.state.S, "H": self.state.slots.H, "R": self.state.slots.R}

    def _plate_candidates(self) -> tuple[Numbers, Numbers]:
        """Return `edges` and `incidence` of the candidates with plates (`engine.state.Candidates`)."""
        return self.state.slots.edges, self.state.slots.incidence

    def _summed(self) -> Array:
        """Return the totals summed over all bodies."""
        return self.totals.sum(axis=0)

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

    def _refuse_stopped(self) -> None:
        """Raise GuardStop for the first stopped body; with `skip_unsolved`, bodies without a solution are skipped."""
        codes = self.memory[:, step_memory.CODE]
        stopped = np.flatnonzero(codes != Stop.NONE)
        if self.accuracy.skip_unsolved:
            stopped = stopped[codes[stopped] != Stop.UNSOLVED]
        if len(stopped):
            raise GuardStop(self._explain(int(stopped[0])))

    def refuse_created_energy(self) -> None:
        """Raise GuardStop if the integrator has created more than CREATED_ENERGY_GUARD of the exchanged energy."""
        stored = body_energies(self.state, self.memory[:, step_memory.STORED])
        built, whole = created_fractions(self.totals, stored, self._summed())
        body = int(np.argmax(built))
        if built[body] > CREATED_ENERGY_GUARD:
            fraction, who, when = built[body], self._who(body), self.totals[body, run_totals.TIME]
        elif whole > CREATED_ENERGY_GUARD:
            fraction, who, when = whole, "all bodies and the upper plate together", self.totals[:, run_totals.TIME].min()
        else:
            return
        inertia = "" if self.accuracy.inertia else "solver.inertia = true, or "
        raise GuardStop(
            f"stopped at t = {when:.6g} s: the integrator has created energy: {100.0 * fraction:.0f} % of all that was exchanged "
            f"(guard: {100.0 * CREATED_ENERGY_GUARD:g} %), by {who}; {inertia}a smaller solver.tolerance or "
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
            "steps_limited_by": limited_by(T),
            "limiting_body": limiting_body(T, state.order),
            "unsolved": {int(body): self._explain(int(body)) for body in lost},
        }

    def describe_limit(self) -> str:
        """Return, as text, the most frequent step limit since the last call; empty before the first step."""
        before, self._reported = self._reported, causes(self.memory).copy()
        self._limit = in_words(self._reported - before, self.state.order) or self._limit
        return self._limit

    def mean_time(self) -> float:
        """Return the mean time [s] reached by the bodies: between two stops their times differ."""
        return float(self.totals[:, run_totals.TIME].mean())

    def label(self) -> Array:
        """Return state, reason, margins and extras of each body now (columns named by the labeller)."""
        return labels(self.state, self.drag)

    def _explain(self, body: int) -> str:
        s, totals = self.state, self.totals[body]
        code, when = int(self.memory[body, step_memory.CODE]), f"stopped at t = {totals[run_totals.TIME]:.6g} s"
        who = self._who(body)
        if code == Stop.OVERLAP:
            slot = int(self.memory[body, step_memory.SLOT])
            own, partner = int(s.slots.own[slot]), int(s.slots.partner[slot])
            radius = s.spheres.radius[own] if partner < 0 else min(s.spheres.radius[own], s.spheres.radius[partner])
            ratio, limit = s.slots.records.overlap[slot] / radius, s.D[domain.OVERLAP_GUARD]
            text = f"sinks into {partner_of(s, slot, body)} by {ratio:.2f} of the radius (guard: {limit:g})"
            return f"{when}: {who} {text}; a lower load is needed"
        if code == Stop.LEFT:
            return f"{when}: {who} left the domain"
        if code == Stop.CROWDED:
            return f"{when}: {who} has more than {TILE} loaded spots, which the implicit integrator cannot hold"
        if code == Stop.BAD_BODY:
            return f"{when}: the position of body {s.order[body]} is not a number"
        shortest = self.settings[step_settings.SHORTEST]
        return f"{when}: no step of {who} could be solved, down to {shortest:.2g} s; {loaded_spots(s, body)}"

    def _who(self, number: int) -> str:
        """Return text that names a body by its number in the scene and its position."""
        where = ", ".join(f"{x:.4g}" for x in self.state.bodies.position[number])
        return f"body {self.state.order[number]} at ({where}) m"
