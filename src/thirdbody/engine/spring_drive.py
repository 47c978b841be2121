"""Drive of the upper plate through springs in the implicit integrator (`kernels.drive` has the equations).

All bodies share their time steps. The displacement of the plate in a step is that at which springs, debris, direct friction and
inertia balance. It is solved by the secant method of Broyden, along one axis inside a bracket: the force of debris falls with the
displacement but has corners, at which contacts begin to slip. Each trial solves all islands, and the rise of a common plate.

Direct friction is set-valued. A plate that it could hold is first tried at rest; otherwise it slips in the direction of the force
that remains. Its limit is that of the last step.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from thirdbody.engine.state import Array
from thirdbody.engine.upper_plate import value_before
from thirdbody.kernels.implicit import control
from thirdbody.kernels.step_tables import body_solution, step_memory
from thirdbody.kernels.tables import drive, patch, run_totals

CONVERGED, ACCEPTED, ROUNDS = 1e-8, 1e-5, 40
"""Tolerances of the residual force over the forces on the plate: for convergence, and where the bracket has closed on a corner;
largest number of trials."""

HALVED = 0.5
"""A trial inside the bracket that leaves more of the residual than this is followed by a bisection."""

Step = tuple[float, float, float]  # see `common_plate.Step`

LAST_MOVE, LAST_CHANGE = (slice(first, first + 2) for first in (step_memory.LAST_COORDINATES, step_memory.LAST_DV))
DIRECT_FORCE, DIRECT_IMPULSE = (slice(first, first + 2) for first in (run_totals.DIRECT_FORCE, run_totals.DIRECT_IMPULSE))


class Trial(NamedTuple):
    """Of a displacement of the plate in the step, along x and y; zero along axes without springs, but for `push`."""

    moved: Array  # [m]
    speed: Array  # at the end of the step [m/s]
    spring: Array  # force of the springs [N]
    push: Array  # of the debris [N]
    inertia: Array  # mass times acceleration [N]
    friction: Array  # of direct contact, against the motion [N]
    scale: float  # of the forces [N]
    lift: Step
    error: float  # of the step over what is allowed
    solved: bool  # whether all islands were

    @property
    def rest(self) -> Array:
        return self.spring + self.push - self.inertia - self.friction


class SpringDrive:
    """Part of a `CommonPlate`, which calls it in every step."""

    def __init__(self, plate: Any, row: Array) -> None:
        self.plate, self.row = plate, row
        self.on = row[drive.STIFFNESS2] > 0.0
        self.last: Trial
        self.base = np.zeros(2)  # displacement of the base at the end of the step [m]

    def solve(self, time: float, dt: float, velocity: tuple[float, float]) -> tuple[Step, float, bool, tuple[float, float]]:
        """Solve a step; return that of the plate's rise, its error, whether it was solved, and the mean velocity of the plate;
        `velocity`: of the base [m/s]."""
        one = self.plate.integrator
        self.base = np.array([value_before(axis, time, time + dt) for axis in (one.schedule.x, one.schedule.y)])
        self.dt, self.velocity, self.first = dt, np.array(velocity), True
        if not np.any(self.row[drive.SLOPE4]):
            self.row[drive.SLOPE4] = -np.eye(2).ravel() * one.memory[:, step_memory.STIFFNESS].sum()
        converged = self._slip(self._limit())
        if not converged:  # forget what was learnt
            self.row[drive.SLOPE4] = 0.0
        trial = self.last
        return trial.lift, trial.error, converged and trial.solved, tuple(self._mean(trial.moved))  # type: ignore[return-value]

    def _limit(self) -> float:
        """Limit of direct friction [N]."""
        one = self.plate.integrator
        pressed = float(one.totals[:, run_totals.DIRECT_FORCE + 2].sum() + self.plate.totals[run_totals.DIRECT_FORCE + 2])
        return float(one.state.P[-1, patch.DIRECT_FRICTION]) * pressed

    def _mean(self, moved: Array) -> Array:
        return np.where(self.on, moved / self.dt, self.velocity)

    def _weights(self) -> tuple[float, float, float]:
        ratio = control.step_ratio.py_func(self.plate.memory, self.plate.integrator.settings, self.dt)
        return (ratio, *control.bdf2_weights.py_func(ratio))

    def _try(self, moved: Array, limit: float) -> Trial:
        one, T, Y, on, dt = self.plate.integrator, self.plate.memory, self.row, self.on, self.dt
        mean = self._mean(moved)
        lift, error, solved = self.plate.solve_height(dt, tuple(mean), self.first)
        self.first = False
        ratio, weight, before = self._weights()
        speed = on * (weight * moved - before * T[LAST_MOVE]) / dt
        change = on * (speed - Y[drive.VELOCITY2])
        acceleration = (weight * change - before * on * T[LAST_CHANGE]) / dt
        spring = Y[drive.STIFFNESS2] * (self.base - Y[drive.DISPLACEMENT2] - moved)
        solutions, size = one.solutions, math.hypot(*mean)
        push = np.array([float(solutions[:, body_solution.PULL + k].sum()) for k in range(2)])
        inertia = float(one.accuracy.inertia) * Y[drive.MASS] * acceleration
        friction = on * (limit / size * mean if size > 0.0 else 0.0)
        scale = float(np.abs(solutions[:, body_solution.PUSH]).sum() + np.abs(spring).sum() + np.abs(inertia).sum() + limit)
        radius = float(one.memory[:, step_memory.CONTACT_RADIUS].max())
        beyond = float(np.linalg.norm(change - ratio * on * T[LAST_CHANGE]))
        error = max(error, control.error_of_change.py_func(beyond, radius, ratio, one.settings, dt))
        self.last = Trial(moved, speed, spring, push, inertia, friction, scale, lift, error, solved)
        return self.last

    def _slip(self, limit: float) -> bool:
        """Find the displacement of the plate; return whether it was found."""
        T, on, dt = self.plate.memory, self.on, self.dt
        ratio, weight, before = self._weights()
        ahead = dt / weight * (self.row[drive.VELOCITY2] + ratio * T[LAST_CHANGE]) + before / weight * T[LAST_MOVE]
        moved, low, high, last = on * ahead, -math.inf, math.inf, None
        if limit > 0.0 and not np.any(self.velocity[~on]):
            last = self._try(np.zeros(2), 0.0)
            size = float(np.linalg.norm(on * last.rest))
            if not last.solved or size <= limit:  # direct friction holds it
                return True
            heading = on * last.rest / size
            last = last._replace(friction=limit * heading)
            low, high = (0.0, math.inf) if heading[on][0] > 0.0 else (-math.inf, 0.0)
            moved = moved if moved @ heading > 0.0 else self._corrected(last)
        for _ in range(ROUNDS):
            trial = self._try(moved, limit)
            size = float(np.abs(on * trial.rest).max())
            if not trial.solved or size <= CONVERGED * trial.scale:
                return True
            if last is not None:
                self._learn(trial, last)
            slow = last is not None and size > HALVED * float(np.abs(on * last.rest).max())
            moved, last = self._corrected(trial), trial
            if on.sum() == 1:  # the residual falls with the displacement
                k = int(np.argmax(on))
                low, high = (trial.moved[k], high) if trial.rest[k] > 0.0 else (low, trial.moved[k])
                middle = 0.5 * (low + high)
                if not low < moved[k] < high or (slow and math.isfinite(middle)):
                    moved = on * middle
                if math.isfinite(middle) and high - low <= 1e-15 * abs(middle):
                    return size <= ACCEPTED * trial.scale
        return False

    def _corrected(self, trial: Trial) -> Array:
        """Return the displacement after the next correction, of limited length."""
        one, Y, on = self.plate.integrator, self.row, self.on
        rate = self._weights()[1] / self.dt
        stiffness = Y[drive.STIFFNESS2] + float(one.accuracy.inertia) * Y[drive.MASS] * rate * rate
        matrix = (np.diag(stiffness) - Y[drive.SLOPE4].reshape(2, 2))[np.ix_(on, on)]
        change = np.zeros(2)
        change[on] = np.linalg.solve(matrix, trial.rest[on])
        longest, size = control.longest_drag.py_func(one.settings, self.plate.memory), float(np.linalg.norm(change))
        return trial.moved + change * min(1.0, longest / max(size, 1e-300))

    def _learn(self, trial: Trial, last: Trial) -> None:
        """Correct the estimated slope so that it explains the last two trials (C. G. Broyden, Math. Comp. 19, 1965, 577)."""
        moved = trial.moved - last.moved
        square = float(moved @ moved)
        if square == 0.0:
            return
        slope = self.row[drive.SLOPE4].reshape(2, 2)
        change = self.on * (trial.push - trial.friction - last.push + last.friction)
        slope += np.outer(change - slope @ moved, moved) / square
        if self.on.sum() == 1:
            np.minimum(slope, 0.0, out=slope)

    def accept(self, dt: float, work: float) -> None:
        """Move the plate, and book its energies; `work`: of the plate on debris and direct contact in the step [J]."""
        one, T, Y, A, on, trial = self.plate.integrator, self.plate.memory, self.row, self.plate.totals, self.on, self.last
        moved, mean = trial.moved, 0.5 * (Y[drive.FORCE2] + trial.spring)
        along = work + 0.5 * dt * float((Y[drive.PUSH2] + trial.push)[~on] @ self.velocity[~on])  # of axes with springs
        gained = float(mean @ (self.base - Y[drive.BASE2])) - along
        for column in (run_totals.DRAG_WORK, run_totals.PLATE_WORK):
            A[column] += gained
        A[run_totals.PLATE_WORK_SIZE] += abs(gained)
        before = on * Y[drive.VELOCITY2]
        kinetic = 0.5 * float(one.accuracy.inertia) * Y[drive.MASS] * float(trial.speed @ trial.speed - before @ before)
        of_end = float((mean - trial.spring - on * trial.push + trial.friction + trial.inertia) @ moved)
        A[run_totals.NUMERICAL_LOSS] += of_end - along - kinetic
        if not self.plate.carried:
            A[DIRECT_IMPULSE] += 0.5 * dt * A[DIRECT_FORCE]
            A[DIRECT_FORCE] = 0.0
        if not np.any(self._mean(moved)) and self._limit() > 0.0:  # direct friction holds the plate
            A[DIRECT_FORCE] -= on * trial.rest
            A[DIRECT_IMPULSE] -= 0.5 * dt * on * trial.rest
        T[LAST_MOVE], T[LAST_CHANGE] = moved, trial.speed - before
        Y[drive.DISPLACEMENT2] = np.where(on, Y[drive.DISPLACEMENT2] + moved, self.base)
        Y[drive.VELOCITY2], Y[drive.BASE_VELOCITY2] = np.where(on, trial.speed, self.velocity), self.velocity
        Y[drive.BASE2], Y[drive.FORCE2], Y[drive.PUSH2] = self.base, trial.spring, trial.push
