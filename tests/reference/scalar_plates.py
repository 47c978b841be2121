"""The upper plate or its patches in Python floats: driven by a schedule, loaded, moved by velocity Verlet."""

from __future__ import annotations

import math
from collections.abc import Sequence

from scalar_bodies import UPPER_PUSH

from thirdbody.kernels import schedule as motion
from thirdbody.kernels.columns import patch

Schedule = list[list[float]]


class Plan:
    """What is prescribed of the upper plate: rows of a schedule, `first[axis]` to `first[axis + 1]` belong to an axis."""

    def __init__(self, schedule: Schedule, first: Sequence[int]):
        self.rows = [schedule[first[axis] : first[axis + 1]] for axis in range(len(first) - 1)]

    def row(self, axis: int, t: float) -> list[float] | None:
        """The last row that has begun."""
        begun = [row for row in self.rows[axis] if row[motion.START] <= t]
        return begun[-1] if begun else None

    def value(self, axis: int, t: float) -> float:
        """Value of an axis at time t."""
        row = self.row(axis, t)
        if row is None:
            return 0.0
        tau, a, b, c = t - row[motion.START], row[motion.A], row[motion.B], row[motion.C]
        if row[motion.KIND] == motion.SINE:
            return a + 0.5 * b * (1.0 - math.cos(c * tau))
        if row[motion.KIND] == motion.TRIANGLE:
            phase = c * tau - math.floor(c * tau)
            return a + b * (2.0 * phase if phase < 0.5 else 2.0 - 2.0 * phase)
        return a + tau * (b + 0.5 * c * tau)

    def rate(self, axis: int, t: float, dt: float) -> float:
        """Mean rate from t to t + dt."""
        row = self.row(axis, t)
        if row is self.row(axis, t + dt):
            if row is None:
                return 0.0
            if row[motion.KIND] == motion.POLYNOMIAL:
                return row[motion.B] + row[motion.C] * (t - row[motion.START] + 0.5 * dt)
        return (self.value(axis, t + dt) - self.value(axis, t)) / dt


class Patches:
    """The table of patches; `patch[b]` is that of body b. With more than one and a plate they hang on, that plate is the last."""

    def __init__(self, P: list[list[float]], patch: Sequence[int], plan: Plan):
        self.P, self.patch, self.plan = P, patch, plan

    def drive(self, t: float, dt: float) -> None:
        """Velocity of what has a prescribed height."""
        if self.plan.rows[motion.GAP]:
            for p in self.P:
                if p[patch.SPRING] == 0.0 and p[patch.FREE] == 0.0:
                    p[patch.VELOCITY] = self.plan.rate(motion.GAP, t, dt)

    def drift(self, dt: float, v_x: float, v_y: float) -> None:
        """Half kick and drift."""
        for p in self.P:
            if p[patch.FREE] != 0.0:
                force = p[patch.FORCE] - p[patch.LOAD] - p[patch.DAMPING] * p[patch.VELOCITY]
                p[patch.VELOCITY] += 0.5 * dt / p[patch.MASS] * force
            p[patch.HEIGHT] += dt * p[patch.VELOCITY]
            p[patch.DISPLACEMENT] += dt * v_x
            p[patch.DISPLACEMENT + 1] += dt * v_y

    def load(self, t: float) -> None:
        """Loads where a schedule changes them."""
        if self.plan.rows[motion.LOAD]:
            factor = self.plan.value(motion.LOAD, t)
            for p in self.P:
                if p[patch.NOMINAL_LOAD] != 0.0:
                    p[patch.LOAD] = factor * p[patch.NOMINAL_LOAD]

    def press(self, B: list[list[float]], push: float) -> None:
        """Upward forces: `push` of all debris on one patch, else of every body on its own, and of the springs."""
        P = self.P
        if len(P) == 1:
            P[0][patch.FORCE] = push
            return
        for p in P:
            p[patch.FORCE] = 0.0
        for b, body in enumerate(B):
            P[self.patch[b]][patch.FORCE] -= body[UPPER_PUSH]
        for p in P[:-1]:
            spring = p[patch.SPRING] * (p[patch.HEIGHT] - P[-1][patch.HEIGHT])
            p[patch.FORCE] -= spring
            P[-1][patch.FORCE] += spring

    def kick(self, dt: float) -> tuple[float, float, float]:
        """Closing half kick; powers of the loads, of what is prescribed, and of the dashpots, W."""
        load, damping, driven = 0.0, 0.0, 0.0
        for p in self.P:
            if p[patch.FREE] != 0.0:
                half = 0.5 * dt / p[patch.MASS]
                p[patch.VELOCITY] = (p[patch.VELOCITY] + half * (p[patch.FORCE] - p[patch.LOAD])) / (
                    1.0 + half * p[patch.DAMPING]
                )
                load -= p[patch.LOAD] * p[patch.VELOCITY]
                damping += p[patch.DAMPING] * p[patch.VELOCITY] * p[patch.VELOCITY]
            else:
                driven -= p[patch.FORCE] * p[patch.VELOCITY]
        return load, driven, damping
