"""Implicit integrator with one plate carried by all bodies: rigid, or with a foundation.

All bodies share their time steps. Each body is solved for a trial rise of the plate; one scalar equation remains, the balance
of the plate's load and the sum of the bodies' forces, whose slope is the Schur complement of the whole system. It is solved by
Newton's method inside a bracket, since the force falls with the rise but has corners.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from thirdbody.engine.implicit import BATCH, Implicit
from thirdbody.engine.state import Array, State
from thirdbody.engine.upper_plate import value_before
from thirdbody.errors import GuardStop
from thirdbody.kernels.columns import (
    body_solution,
    contact_state,
    patch,
    record,
    run_totals,
    step_memory,
    step_settings,
    step_start,
)
from thirdbody.kernels.implicit import common_plate as kernel
from thirdbody.kernels.implicit import step_control, step_limits
from thirdbody.kernels.implicit.residual import TURN

CONVERGED, ROUNDS = 1e-8, 30
"""Tolerance of the residual force on the plate over its load and the bodies' forces; maximum corrections of its rise."""


@dataclass
class PlateStep:
    """Step of the plate: rise (`way`) [m], and velocity [m/s] and acceleration [m/s2] at its end."""

    way: float
    velocity: float
    acceleration: float


class Shared(Implicit):
    """`Implicit` for a state whose last patch is a free plate carried by all bodies."""

    def __init__(self, state: State, *arguments, **options) -> None:
        _one_plate(state)
        super().__init__(state, *arguments, **options)
        n = state.n_bodies
        self.starts = np.zeros((n, step_start.WIDTH))
        self.ends = np.zeros((n, 7))
        self.told = np.zeros((n, body_solution.WIDTH))
        self.plate = np.zeros(run_totals.WIDTH)  # totals of the plate itself
        self.length, self.last = float(self.memory[0, step_memory.NEXT_DT]), 0.0
        self.moved, self.change = 0.0, 0.0  # of the plate in its last step: rise [m], change of velocity [m/s]

    together = True

    def trial(self, bodies: int, until: float) -> None:
        """As in `Implicit`, but always for all bodies."""
        self._reach(until, lambda: None, lambda: None)

    def start(self) -> None:
        """As `Implicit.start`."""
        super().start()
        self.gone = np.zeros(self.state.slots.count)

    def keep(self) -> tuple[dict[str, Array], dict[str, Any]]:
        """As `Implicit.keep`; `starts` and `ends` are omitted, since every step computes them."""
        arrays, notes = super().keep()
        plate = {"length": self.length, "last": self.last, "moved": self.moved, "change": self.change}
        return arrays | {"plate": self.plate}, notes | plate

    def restore(self, arrays: dict[str, Array], notes: dict[str, Any]) -> None:
        """As `Implicit.restore`."""
        super().restore(arrays, notes)
        self.plate[:] = arrays["plate"]
        self.length, self.last, self.moved, self.change = (float(notes[name]) for name in ("length", "last", "moved", "change"))

    def _reach(self, until: float, watch: Callable[[], None], between: Callable[[], None]) -> None:
        while self.totals[0, run_totals.TIME] < until:
            self._step(until)
            self._judge()
            # counted from the start of the run, so that a resumed run calls `watch` at the same instants
            noted = int(self.totals[0, run_totals.STEPS]) % max(1, BATCH // self.state.n_bodies) == 0
            (watch if noted else between)()

    def _step(self, until: float) -> None:
        """Make one step, shortened until it is accepted. Raises GuardStop if no step is."""
        time = float(self.totals[0, run_totals.TIME])
        end = self._stretch(time, until)
        if end - time < self.settings[step_settings.SHORTEST]:
            # the interval is shorter than any step: a stop that misses a breakpoint by rounding
            self.totals[:, run_totals.TIME], self.memory[:, step_memory.LAST_DT], self.last = end, 0.0, 0.0
            return
        (dt, cause), cuts, load = self._length(time, end), 0, float(self.state.patches.load[-1])
        requested, body = self.length, 0
        while True:
            whole = dt >= step_control.NEARLY * (end - time)
            dt = end - time if whole else dt
            velocity = self._velocity(time, dt)
            self._load(time, dt)
            rise, result = self._solve(dt, velocity)
            error, rotation = self._error(rise, dt), float(self.told[:, body_solution.TURN].max())
            if result and error <= 1.0 and rotation <= TURN:
                break
            cuts += 1
            body, cause = self._why(result, error, rotation)
            self._stay()
            dt *= 0.5 if not result else max(0.1, min(0.7, 0.9 / math.sqrt(max(error, 1e-30)), 0.9 * TURN / max(rotation, 1e-30)))
            if dt < self.settings[step_settings.SHORTEST] or self.told[:, body_solution.CROWDED].any():
                self._give_up()
        self._take(dt, end, whole, velocity, rise, load)
        body = body if cuts else int(np.argmax(self.told[:, body_solution.ERROR]))
        self.memory[body, step_memory.LIMITED + cause] += 1.0
        self.memory[:, step_memory.CUTS] += cuts
        self.memory[:, step_memory.HARD_STEPS] += float(cuts > step_control.HARD)
        self.memory[:, step_memory.LONGEST_DRAG] = np.maximum(
            self.memory[:, step_memory.LONGEST_DRAG], math.hypot(*velocity) * dt
        )
        grown = min(self.accuracy.growth, 0.9 / math.sqrt(max(error, 1e-30)))
        if cuts or self.told[:, body_solution.ITERATIONS].max() > 2 * step_control.EASY:
            grown = min(grown, 1.0)
        if cuts:
            self.memory[:, step_memory.LIMIT] = cause
        elif grown < 1.0 or dt * grown >= requested:
            self.memory[:, step_memory.LIMIT] = self._why_not_longer(grown)
        self.length = max(dt * grown, requested) if not cuts and grown >= 1.0 else dt * grown
        if whole and kernel.is_breakpoint_at(self.state.schedule, self.state.first, time, end):
            self.memory[:, step_memory.LAST_DT], self.last = 0.0, 0.0

    def _why(self, result: bool, error: float, turn: float) -> tuple[int, int]:
        """Return the body that requires a shorter step, and the cause (as `step_limits.why_cut`)."""
        lost = self.told[:, body_solution.FOUND] == 0.0
        turning = result and not (error > 1.0 and 1.0 / math.sqrt(error) < TURN / max(turn, 1e-30))
        body = int(np.argmax(lost if lost.any() else self.told[:, body_solution.TURN if turning else body_solution.ERROR]))
        if self.told[body, body_solution.LANDS] > 0.0:
            return body, step_limits.LANDING
        return body, step_limits.TURNING if turning else (step_limits.ERROR if result else step_limits.NEWTON)

    def _why_not_longer(self, grown: float) -> int:
        """Return the cause (`step_limits`) that limits the step after an accepted one."""
        if grown == self.accuracy.growth:
            return step_limits.GROWTH
        return (
            step_limits.NEWTON
            if self.told[:, body_solution.ITERATIONS].max() > 2 * step_control.EASY and grown == 1.0
            else step_limits.ERROR
        )

    def _solve(self, dt: float, velocity: tuple[float, float]) -> tuple[PlateStep, bool]:
        """Solve for the rise at equilibrium of the plate; return the plate's step and whether it converged."""
        row, first_iteration = self.state.P[-1], True
        distance, low, high = float(row[patch.VELOCITY]) * dt, -math.inf, math.inf
        for _ in range(ROUNDS):
            self._bodies(first_iteration, dt, distance, velocity)
            first_iteration = False
            rise = self._rise(distance, dt)
            if not self.told[:, body_solution.FOUND].all():
                return rise, False
            push, slope = float(self.told[:, body_solution.PUSH].sum()), float(self.told[:, body_solution.SLOPE].sum())
            rate = self._now(dt) / dt
            force = push - row[patch.LOAD] - row[patch.DAMPING] * rise.velocity - row[patch.MASS] * rise.acceleration
            scale = abs(push) + max(row[patch.LOAD], row[patch.NOMINAL_LOAD]) + row[patch.MASS] * abs(rise.acceleration)
            scale += row[patch.DAMPING] * abs(rise.velocity)
            if abs(force) <= CONVERGED * scale:
                return rise, True
            low, high = (distance, high) if force > 0.0 else (low, distance)
            slope -= row[patch.DAMPING] * rate + float(self.accuracy.inertia) * row[patch.MASS] * rate * rate
            # limited downwards: the force of the bodies grows faster than its slope predicts
            change = max(-force / slope, -self._yielding()) if slope < 0.0 else math.copysign(self._yielding(), force)
            distance = distance + change if low < distance + change < high else 0.5 * (low + high)
            if not math.isfinite(distance) or high - low <= 1e-15 * abs(distance):
                return rise, abs(force) <= 1e-5 * scale
        return rise, False

    def _yielding(self) -> float:
        """Return the largest descent [m] of the plate in one correction: half the largest or expected overlap."""
        H, R = self.state.slots.H, self.state.slots.R
        deepest = float(np.max(R[:, record.OVERLAP], where=H[:, contact_state.SLIP] > 0.0, initial=0.0))
        return 0.5 * max(deepest, float(self.settings[step_settings.DEEP]))

    def _now(self, dt: float) -> float:
        """Return the BDF2 weight of this step's change in its end velocity (`step_control.bdf2_weights`)."""
        if self.last == 0.0 or not self.accuracy.inertia:
            return 1.0
        ratio = dt / self.last
        return (1.0 + 2.0 * ratio) / (1.0 + ratio)

    def _before(self, dt: float) -> float:
        """Return the BDF2 weight of the last step's change."""
        if self.last == 0.0 or not self.accuracy.inertia:
            return 0.0
        ratio = dt / self.last
        return ratio * ratio / (1.0 + ratio)

    def _rise(self, distance: float, dt: float) -> PlateStep:
        now, before = self._now(dt), self._before(dt)
        velocity = (now * distance - before * self.moved) / dt
        change = now * (velocity - self._plate_velocity) - before * self.change
        return PlateStep(distance, velocity, change / dt if self.accuracy.inertia else 0.0)

    @property
    def _plate_velocity(self) -> float:
        return float(self.state.patches.velocity[-1])

    def _error(self, rise: PlateStep, dt: float) -> float:
        """Return the largest error of bodies and plate over the tolerance (`step_control.local_error`)."""
        first = self.last == 0.0 or not self.accuracy.inertia
        ratio = 0.0 if first else dt / self.last
        change = abs(rise.velocity - self._plate_velocity - ratio * self.change)
        radius = float(self.memory[:, step_memory.CONTACT_RADIUS].max())
        allowed = self.accuracy.tolerance if self.accuracy.inertia else min(1.0, step_control.LOOSER * self.accuracy.tolerance)
        own = (0.5 if first else 2.0 / 9.0) * dt * change / (allowed * radius)
        return max(own, float(self.told[:, body_solution.ERROR].max()))

    def _length(self, time: float, end: float) -> tuple[float, int]:
        """Return the length [s] of the next step and its cause (`kernels.implicit.step_limits`)."""
        left = end - time
        dt, cause = min(self.length, left), int(self.memory[0, step_memory.LIMIT])
        loaded = self.memory[:, step_memory.STORED] > 0.0
        radii = self.memory[loaded, step_memory.CONTACT_RADIUS] if loaded.any() else self.memory[:, step_memory.CONTACT_RADIUS]
        longest = min(self.accuracy.largest_step, self.accuracy.radii * float(radii.min()))
        for _ in range(3):
            distance = math.hypot(*self._velocity(time, dt)) * dt
            if distance > longest:
                dt *= longest / distance
                cause = step_limits.LARGEST
        if dt <= 0.5 * left:
            return dt, cause
        ends = (
            step_limits.REVERSAL
            if kernel.is_breakpoint_at(self.state.schedule, self.state.first, time, end)
            else step_limits.OUTPUT
        )
        return (left if dt >= step_control.NEARLY * left else 0.5 * left), ends

    def _load(self, time: float, dt: float) -> None:
        """Set the scheduled load [N] of the plate at the end of a step that crosses no breakpoint."""
        if self.schedule.load:
            row = self.state.P[-1]
            row[patch.LOAD] = row[patch.NOMINAL_LOAD] * value_before(self.schedule.load, time, time + dt)

    def _take(self, dt: float, end: float, whole: bool, velocity: tuple[float, float], rise: PlateStep, load: float) -> None:
        """Accept the step, and book the plate's energy; `load`: load [N] at the start of the step."""
        s, physics, row = self.state, self.state.physics, self.state.P[-1]
        kernel.accept_bodies(
            dt, end, whole, *velocity, *self._groups(), self.most, s.M, s.D, self.settings, self.totals, self.memory, self.starts,
            self.ends, self.gone, self.drag, physics.law, physics.effects, physics.observe,
        )  # fmt: skip
        before = self._plate_velocity
        old = 0.5 if self.last > 0.0 else 0.0
        carried = (1.0 - old) * float(row[patch.LOAD]) + old * load
        mass, work = float(row[patch.MASS]), -carried * rise.way
        kinetic = 0.5 * mass * (rise.velocity**2 - before**2) * float(self.accuracy.inertia)
        self.plate[run_totals.PLATE_WORK] += work
        self.plate[run_totals.PLATE_WORK_SIZE] += abs(work)
        felt = float(row[patch.DAMPING]) * rise.velocity * rise.way
        self.plate[run_totals.DAMPING_WORK] += max(felt, 0.0)
        lost = min(felt, 0.0) + (float(row[patch.LOAD]) - carried) * rise.way
        self.plate[run_totals.NUMERICAL_LOSS] += mass * rise.acceleration * rise.way - kinetic + lost
        self.moved, self.change, self.last = rise.way, rise.velocity - before, dt
        row[patch.HEIGHT] += rise.way
        row[patch.VELOCITY] = rise.velocity

    def _bodies(self, first_iteration: bool, dt: float, rise: float, velocity: tuple[float, float]) -> None:
        s, physics = self.state, self.state.physics
        kernel.solve_bodies(
            first_iteration, dt, rise, float(s.patches.height[-1]), *velocity, *self._groups(), self.most, self.settings,
            self.totals, self.memory, self.starts, self.ends, self.gone, self.told, physics.law, self.tangents, physics.effects,
        )  # fmt: skip

    def _stay(self) -> None:
        groups = self._groups()
        kernel.restore_bodies(groups[1], groups[2], self.memory, self.starts)

    def _give_up(self) -> None:
        """Raise GuardStop for the first body that did not converge, otherwise for the plate."""
        lost = np.flatnonzero(self.told[:, body_solution.FOUND] == 0.0)
        if not len(lost):
            when = f"stopped at t = {self.totals[0, run_totals.TIME]:.6g} s"
            raise GuardStop(f"{when}: no balance was found for the upper plate, which all bodies carry together")
        crowded = self.told[lost[0], body_solution.CROWDED] > 0.0
        self.memory[lost[0], step_memory.CODE] = step_control.TOO_MANY if crowded else step_control.UNSOLVED
        raise GuardStop(self._explain(int(lost[0])))

    def _velocity(self, time: float, dt: float) -> tuple[float, float]:
        """Return the mean lateral velocity (v_x, v_y) [m/s] of the plate over a step."""
        return kernel.plate_velocity_of(self.state.schedule, self.state.first, time, dt)

    def _stretch(self, time: float, until: float) -> float:
        """Return the time [s] of the next breakpoint of the motion, at most `until`."""
        return kernel.next_breakpoint_after(self.state.schedule, self.state.first, time, until)

    def _summed(self) -> Array:
        return super()._summed() + self.plate


def _one_plate(state: State) -> None:
    """Move a rigid plate to the last row of the patches and give every body a copy that follows it."""
    if len(state.P) > 1 or state.world.upper is None or state.world.upper.foundation is not None:
        return
    copies = np.repeat(state.P, state.n_bodies, axis=0)
    for column in (patch.FREE, patch.MASS, patch.DAMPING, patch.LOAD, patch.NOMINAL_LOAD):
        copies[:, column] = 0.0
    state.P = np.concatenate([copies, state.P])
    state.patch = np.arange(state.n_bodies)
