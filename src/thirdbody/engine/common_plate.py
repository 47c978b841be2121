"""One plate that all bodies carry in the implicit integrator: rigid, or with a foundation.

All bodies share their time steps. Each island is solved for a trial rise of the plate; one scalar equation remains, the balance
of the plate's load and the sum of the bodies' forces, whose slope is the Schur complement of the whole system. It is solved by
Newton's method inside a bracket, since the force falls with the rise but has corners.
"""

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from thirdbody.engine.spring_drive import SpringDrive
from thirdbody.engine.state import Action, Array, State
from thirdbody.engine.units import BATCH
from thirdbody.engine.upper_plate import direct_reaction, value_before
from thirdbody.errors import GuardStop
from thirdbody.jit.threads import MIN_BODIES, pieces_of
from thirdbody.kernels.arguments import Motion
from thirdbody.kernels.implicit import common_plate as kernel
from thirdbody.kernels.implicit import control
from thirdbody.kernels.implicit.control import EASY, NEARLY, BodyStop, StepLimit
from thirdbody.kernels.implicit.residual import MAX_ROTATION
from thirdbody.kernels.step_tables import body_solution, step_memory, step_settings
from thirdbody.kernels.tables import LOWER, contact_state, patch, record, run_totals

CONVERGED, ROUNDS = 1e-8, 30
"""Tolerance of the residual force on the plate over its load and the bodies' forces; maximum corrections of its rise."""

Step = tuple[float, float, float]  # step of the plate: rise [m]; velocity [m/s] and acceleration [m/s2] at its end


class CommonPlate:
    """A plate that all bodies carry, the last patch, or that springs drive, or both: it makes the steps of an `Implicit`, which
    builds on this module. `carried`: whether the bodies carry it, else their patches move for themselves."""

    def __init__(self, integrator: Any, state: State, carried: bool) -> None:
        self.integrator, self.carried, self.lift, upper = integrator, carried, 0.0, state.world.upper
        self.spring = SpringDrive(self, state.drive) if state.sprung else None
        if carried and len(state.P) == 1 and upper and not upper.foundation:
            # a rigid plate becomes the last row of the patches, and every body gets a copy that follows it
            copies = np.repeat(state.P, state.n_bodies, axis=0)
            for column in (patch.FREE, patch.MASS, patch.DAMPING, patch.LOAD, patch.NOMINAL_LOAD, patch.DIRECT_PREFACTOR):
                copies[:, column] = 0.0
            state.P = np.concatenate([copies, state.P])
            state.patch = np.arange(state.n_bodies)
        self.totals = np.zeros(run_totals.WIDTH)  # of the plate itself
        self.memory = np.zeros(step_memory.WIDTH)  # of the common steps and of the plate in the last one

    def start(self) -> None:
        for column in (step_memory.NEXT_DT, step_memory.LIMIT):
            self.memory[column] = self.integrator.memory[0, column]
        self.integrator.settings[step_settings.COMMON] = float(self.carried)
        if self.carried:
            kernel.book_direct(self.totals, self.integrator.state.P, 0.0, 0.0, 0.0, 0.0)  # the force at the start

    def tables(self) -> dict[str, Array]:
        return {"plate": self.totals, "plate_memory": self.memory}

    def advance_to(self, until: float, watch: Action, between: Action) -> None:
        one = self.integrator
        while one.totals[0, run_totals.TIME] < until:
            self._step(until)
            one.collect()
            one.refuse_stopped()
            # counted from the start of the run, so that a resumed run calls `watch` at the same instants
            noted = int(one.totals[0, run_totals.STEPS]) % max(1, BATCH // one.state.n_bodies) == 0
            (watch if noted else between)()

    def _step(self, until: float) -> None:
        one = self.integrator
        time, T, context = float(one.totals[0, run_totals.TIME]), self.memory, one.packed()
        end = kernel.next_breakpoint_after(time, context, until)
        if end - time < one.settings[step_settings.SHORTEST]:
            # the interval is shorter than any step: a stop that misses a breakpoint by rounding
            one.totals[:, run_totals.TIME] = end
            one.memory[:, step_memory.LAST_DT] = T[step_memory.LAST_DT] = 0.0
            return
        row, ends = one.state.P[-1], one.solutions
        (dt, cause), cuts, load, body = self._length(time, end), 0, float(row[patch.LOAD]), 0
        while True:
            whole = dt >= NEARLY * (end - time)
            dt = end - time if whole else dt
            velocity = kernel.plate_velocity_of(time, context, dt)
            if one.schedule.load and self.carried:  # at the end of a step that crosses no breakpoint
                row[patch.LOAD] = row[patch.NOMINAL_LOAD] * value_before(one.schedule.load, time, time + dt)
            if self.spring:
                step, error, converged, velocity = self.spring.solve(time, dt, velocity)
            else:
                step, error, converged = self.solve_height(dt, velocity)
            error = max(error, float(ends[:, body_solution.ERROR].max()))
            rotation = float(ends[:, body_solution.ROTATION].max())
            if converged and error <= 1.0 and rotation <= MAX_ROTATION:
                break
            cuts += 1
            # the body that requires a shorter step, and why
            cause, lost = control.why_cut.py_func(False, converged, error, rotation), ends[:, body_solution.SOLVED] == 0.0
            worst = ends[:, body_solution.ROTATION if cause == StepLimit.ROTATION else body_solution.ERROR]
            body = int(np.argmax(lost if lost.any() else worst))
            cause = StepLimit.LANDING if ends[body, body_solution.LANDS] > 0.0 else cause
            self.each_island(kernel.restore_islands)
            dt *= control.reduction_factor.py_func(converged, error, rotation)
            if dt < one.settings[step_settings.SHORTEST] or ends[:, body_solution.CROWDED].any():
                if not lost.any():
                    raise GuardStop(
                        f"stopped at t = {time:.6g} s: no balance was found for the upper plate, which all bodies share"
                    )
                body = int(np.argmax(lost))
                crowded = ends[body, body_solution.CROWDED] > 0.0
                one.memory[body, step_memory.CODE] = BodyStop.CROWDED if crowded else BodyStop.UNSOLVED
                raise GuardStop(one.explain(body))
        before = self._drag_work() if self.spring else 0.0
        self.each_island(kernel.accept_at, (end, whole, cuts), Motion(dt, *velocity))
        if self.carried:
            self._accept(dt, step, load, velocity)
        if self.spring:
            self.spring.accept(dt, self._drag_work() - before)
        T[step_memory.LAST_DT] = dt
        body = body if cuts else int(np.argmax(ends[:, body_solution.ERROR]))
        one.memory[body, step_memory.LIMITED + cause] += 1.0
        easy = ends[:, body_solution.ITERATIONS].max() <= 2 * EASY
        control.set_next_dt.py_func(T, one.accuracy.growth, dt, error, easy, cuts > 0, cause)
        if whole and kernel.next_breakpoint_after(time, context, math.inf) <= end:
            one.memory[:, step_memory.LAST_DT] = T[step_memory.LAST_DT] = 0.0

    def _drag_work(self) -> float:
        return float(self.integrator.totals[:, run_totals.DRAG_WORK].sum() + self.totals[run_totals.DRAG_WORK])

    def solve_height(self, dt: float, velocity: tuple[float, float], first_iteration: bool = True) -> tuple[Step, float, bool]:
        """Return the step of the plate to its equilibrium, its error over the tolerance, and whether it was found; unless in the
        `first_iteration`, begin at the last solution, of another `velocity` [m/s]."""
        one, T = self.integrator, self.memory
        if not self.carried:
            self.each_island(kernel.solve_at, first_iteration, 0.0, Motion(dt, *velocity))
            return (0.0, 0.0, 0.0), 0.0, bool(one.solutions[:, body_solution.SOLVED].all())
        row, now = one.state.P[-1], float(one.state.P[-1, patch.VELOCITY])
        displacement, low, high = now * dt if first_iteration else self.lift, -math.inf, math.inf
        for _ in range(ROUNDS):
            self.each_island(kernel.solve_at, first_iteration, displacement, Motion(dt, *velocity))
            first_iteration, self.lift, radius = False, displacement, float(one.memory[:, step_memory.CONTACT_RADIUS].max())
            ratio, last_change = control.step_ratio.py_func(T, one.settings, dt), T[step_memory.LAST_DRISE]
            weight, before = control.bdf2_weights.py_func(ratio)
            speed = (weight * displacement - before * T[step_memory.LAST_COORDINATES + 6]) / dt
            acceleration = (weight * (speed - now) - before * last_change) / dt if one.accuracy.inertia else 0.0
            error = control.error_of_change.py_func(abs(speed - now - ratio * last_change), radius, ratio, one.settings, dt)
            step, rate = (displacement, speed, acceleration), weight / dt  # and the change of the speed with the rise [1/s]
            if not one.solutions[:, body_solution.SOLVED].all():
                return step, error, False
            push, slope = (float(one.solutions[:, column].sum()) for column in (body_solution.PUSH, body_solution.SLOPE))
            direct, direct_stiffness = direct_reaction(row, displacement)
            push, slope = push + direct, slope - direct_stiffness
            force = push - row[patch.LOAD] - row[patch.DAMPING] * speed - row[patch.MASS] * acceleration
            scale = abs(push) + max(row[patch.LOAD], row[patch.NOMINAL_LOAD]) + row[patch.MASS] * abs(acceleration)
            scale += row[patch.DAMPING] * abs(speed)
            if abs(force) <= CONVERGED * scale:
                return step, error, True
            low, high = (displacement, high) if force > 0.0 else (low, displacement)
            slope -= row[patch.DAMPING] * rate + float(one.accuracy.inertia) * row[patch.MASS] * rate * rate
            # limited downwards: the force of the bodies grows faster than its slope predicts
            change = max(-force / slope, -self._yielding()) if slope < 0.0 else math.copysign(self._yielding(), force)
            displacement = displacement + change if low < displacement + change < high else 0.5 * (low + high)
            if not math.isfinite(displacement) or high - low <= 1e-15 * abs(displacement):
                return step, error, abs(force) <= 1e-5 * scale
        return step, error, False

    def each_island(self, kernel_of_pieces: Callable[..., None], *step: Any) -> None:
        islands = self.integrator.islands
        self.integrator.each_island(islands.pieces or pieces_of(0, islands.count, MIN_BODIES), kernel_of_pieces, *step)

    def _yielding(self) -> float:
        """Largest descent [m] of the plate in one correction: half the largest or expected overlap."""
        one = self.integrator
        H, R = one.state.slots.H, one.state.slots.R
        max_overlap = float(np.max(R[:, record.OVERLAP], where=H[:, contact_state.SLIP] > 0.0, initial=0.0))
        return 0.5 * max(max_overlap, float(one.settings[step_settings.EXPECTED_OVERLAP]))

    def _length(self, time: float, end: float) -> tuple[float, int]:
        one, state, slots = self.integrator, self.integrator.state, self.integrator.state.slots
        # bodies that touch neither the upper plate nor others do not count: their weight presses them on the lower plate by less
        # than a nanometre, and no drag slides over that
        carrying = np.zeros(state.n_bodies, bool)
        carrying[state.body[slots.own[(slots.sides != LOWER) & (slots.H[:, contact_state.SLIP] > 0.0)]]] = True
        radii = one.memory[carrying if carrying.any() else slice(None), step_memory.CONTACT_RADIUS]
        self.memory[step_memory.DRAG_RADIUS] = radii.min()
        return kernel.common_step_length(self.memory, time, one.packed(), end)

    def _accept(self, dt: float, step: Step, load: float, velocity: tuple[float, float]) -> None:
        """Move the plate, and book its energy; `load`: load [N] at the start of the step."""
        one = self.integrator
        T, row, (displacement, velocity_after, acceleration) = self.memory, one.state.P[-1], step
        before = float(row[patch.VELOCITY])
        old = 0.5 if T[step_memory.LAST_DT] > 0.0 else 0.0
        carried = (1.0 - old) * float(row[patch.LOAD]) + old * load
        mass, work = float(row[patch.MASS]), -carried * displacement
        kinetic = 0.5 * mass * (velocity_after**2 - before**2) * float(one.accuracy.inertia)
        self.totals[run_totals.PLATE_WORK] += work
        self.totals[run_totals.PLATE_WORK_SIZE] += abs(work)
        dashpot_work = float(row[patch.DAMPING]) * displacement**2 / dt
        self.totals[run_totals.DAMPING_WORK] += dashpot_work
        lost = float(row[patch.DAMPING]) * velocity_after * displacement - dashpot_work
        lost += (float(row[patch.LOAD]) - carried) * displacement
        self.totals[run_totals.NUMERICAL_LOSS] += mass * acceleration * displacement - kinetic + lost
        T[step_memory.LAST_COORDINATES + 6], T[step_memory.LAST_DRISE] = displacement, velocity_after - before
        row[patch.HEIGHT] += displacement
        row[patch.VELOCITY] = velocity_after
        if row[patch.DIRECT_PREFACTOR] > 0.0:
            kernel.book_direct(self.totals, one.state.P, dt, *velocity, old)
            # the force at the end of the step acts all along
            first, last = direct_reaction(row, -displacement)[0], direct_reaction(row, 0.0)[0]
            self.totals[run_totals.NUMERICAL_LOSS] += (first - last) * float(row[patch.DIRECT_LENGTH]) - last * displacement
