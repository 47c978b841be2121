"""The upper plate or its patches in Python floats: driven by a schedule, loaded, moved by velocity Verlet."""

from __future__ import annotations

import math
from collections.abc import Sequence

from scalar_bodies import E_PUSH

from thirdbody.kernels import layout as at
from thirdbody.kernels import schedule as motion

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
                if p[at.P_SPRING] == 0.0 and p[at.P_FREE] == 0.0:
                    p[at.P_V] = self.plan.rate(motion.GAP, t, dt)

    def drift(self, dt: float) -> None:
        """Half kick and drift."""
        for p in self.P:
            if p[at.P_FREE] != 0.0:
                force = p[at.P_F] - p[at.P_LOAD] - p[at.P_DAMPING] * p[at.P_V]
                p[at.P_V] += 0.5 * dt / p[at.P_MASS] * force
            p[at.P_Z] += dt * p[at.P_V]

    def load(self, t: float) -> None:
        """Loads where a schedule changes them."""
        if self.plan.rows[motion.LOAD]:
            factor = self.plan.value(motion.LOAD, t)
            for p in self.P:
                if p[at.P_LOAD0] != 0.0:
                    p[at.P_LOAD] = factor * p[at.P_LOAD0]

    def press(self, B: list[list[float]], push: float) -> None:
        """Upward forces: `push` of all debris on one patch, else of every body on its own, and of the springs."""
        P = self.P
        if len(P) == 1:
            P[0][at.P_F] = push
            return
        for p in P:
            p[at.P_F] = 0.0
        for b, body in enumerate(B):
            P[self.patch[b]][at.P_F] -= body[E_PUSH]
        for p in P[:-1]:
            spring = p[at.P_SPRING] * (p[at.P_Z] - P[-1][at.P_Z])
            p[at.P_F] -= spring
            P[-1][at.P_F] += spring

    def kick(self, dt: float) -> tuple[float, float, float]:
        """Closing half kick; powers of the loads, of what is prescribed, and of the dashpots, W."""
        load, damping, driven = 0.0, 0.0, 0.0
        for p in self.P:
            if p[at.P_FREE] != 0.0:
                half = 0.5 * dt / p[at.P_MASS]
                p[at.P_V] = (p[at.P_V] + half * (p[at.P_F] - p[at.P_LOAD])) / (1.0 + half * p[at.P_DAMPING])
                load -= p[at.P_LOAD] * p[at.P_V]
                damping += p[at.P_DAMPING] * p[at.P_V] * p[at.P_V]
            else:
                driven -= p[at.P_F] * p[at.P_V]
        return load, driven, damping
