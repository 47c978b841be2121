"""One run of a robustness case: its simulations, advanced by one integrator at one law level, and its findings."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from thirdbody.assembly.simulation import Simulation, build
from thirdbody.engine.energy import Ledger
from thirdbody.engine.guards import RESIDUAL_GUARD, EnergyGuard
from thirdbody.engine.orientations import orientations
from thirdbody.kernels.columns import body, body_extra, run_totals
from thirdbody.rotations import rotation_matrices
from thirdbody.scene.model import Scene

RESIDUAL = {"explicit": 2e-2, "implicit": 1e-6}
"""Largest residual of the energy balance with the automatic step.

Explicit steps leave their truncation error (2e-3 in an impact of 16 steps, 5e-3 where a load jumps), implicit ones the force
residual of Newton's method (1e-9, at corners of laws 1e-6).
"""

GAINED = 5e-3
"""Largest energy gain of the implicit integrator, over the plate's work; its truncation error has either sign.

The largest is that of `lost_contact` with `mdr` and `exact`: 3e-3 at the default tolerance and at a quarter of it, 1.2e-3 to
1.7e-3 at a sixteenth. A law that gains energy returns 1e-2 and more.
"""

NORM = 1e-12
"""Deviation of a quaternion's length from 1: it is normalised in every step."""


@dataclass(frozen=True)
class Setting:
    """Settings of the integration of a case.

    `steps`: fixed time steps [s] of its simulations in the order in which they are built, each times `factor`; empty for
    automatic steps. `full`: the long version of the case.
    """

    integrator: str
    level: str
    steps: tuple[float, ...] = ()
    factor: float = 1.0
    full: bool = False


@dataclass(frozen=True)
class Finding:
    """Invariant: a value that must not exceed its limit."""

    name: str
    value: float
    limit: float

    @property
    def passed(self) -> bool:
        """Whether it holds; NaN does not."""
        return self.value <= self.limit

    def __str__(self) -> str:
        return f"{self.name}: {self.value:.3g} (at most {self.limit:.3g})"


class Trial:
    """Builder of the simulations of a case; applies the checks of `thirdbody run`, and collects invariants."""

    def __init__(self, setting: Setting) -> None:
        self.setting, self.findings = setting, list[Finding]()
        self.steps: list[float] = []  # smallest time step of every simulation so far [s]
        self.residual = math.nan  # until something moved freely
        self.built = 0

    @property
    def sweeping(self) -> bool:
        """Whether steps are fixed to find the largest stable one: effects of truncation alone are then not checked."""
        return bool(self.setting.steps)

    def solver(self) -> dict[str, Any]:
        """Keys of the solver for the next simulation."""
        steps = self.setting.steps
        step = {"time_step": self.setting.factor * steps[self.built]} if steps else {}
        return {"integrator": self.setting.integrator} | step

    def start(self, scene: Scene) -> CaseRun:
        """Return a simulation of the scene at time zero."""
        simulation = build(scene, force=self.sweeping)
        self.built += 1
        return CaseRun(self, simulation)

    def check(self, name: str, value: float, limit: float, stable: float | None = None) -> None:
        """Record an invariant.

        `stable`: its limit in a sweep of the time step, by default the same, infinite for truncation alone.
        """
        self.findings.append(Finding(name, float(value), limit if stable is None or not self.sweeping else stable))

    def check_true(self, name: str, sound: bool) -> None:
        """Record an invariant that is not a number: a label, a reason, a message."""
        self.findings.append(Finding(name, 0.0 if sound else 1.0, 0.0))

    def broken(self) -> list[Finding]:
        """Return the invariants that do not hold."""
        return [finding for finding in self.findings if not finding.passed]


@dataclass
class CaseRun:
    """Simulation of a case in progress."""

    trial: Trial
    simulation: Simulation
    ledger: Ledger = field(init=False)
    energy_guard: EnergyGuard = field(init=False)

    def __post_init__(self) -> None:
        self.state, self.integrator = self.simulation.state, self.simulation.integrator
        self.ledger = Ledger(self.state)
        self.energy_guard = EnergyGuard(self.ledger, 2 if self.integrator.divisible else 1)

    def _watch(self) -> None:
        self.ledger.watch(self.state)
        if self.integrator.divisible:
            self.energy_guard.check(self.state)

    def to(self, time: float = math.inf, distance: float = math.inf) -> None:
        """Advance to a time [s] or a distance of the drag [m], and check what must hold in every run. Raises GuardStop."""
        self.integrator.advance_to(time=time, distance=distance, watch=self._watch)
        self._watch()
        trial, state = self.trial, self.state
        kind = trial.setting.integrator
        residual = self.ledger.relative_residual(state, self.ledger.lines(state)["residual"])
        trial.residual = residual if math.isnan(trial.residual) else max(trial.residual, residual)
        trial.check("energy residual", residual, RESIDUAL[kind], RESIDUAL_GUARD)
        finite = all(bool(np.all(np.isfinite(table))) for table in (state.S, state.B, state.E, state.P, state.A, state.slots.H))
        trial.check_true("finite numbers", finite)
        norms = np.linalg.norm(state.bodies.quaternion, axis=1)
        trial.check("length of quaternions - 1", np.abs(norms - 1.0).max(), NORM)
        if kind == "implicit":
            built = -state.A[run_totals.NUMERICAL_LOSS] / max(state.A[run_totals.PLATE_WORK_SIZE], self.ledger.peak, 1e-300)
            trial.check("energy created by the integrator", built, GAINED)
            trial.check_true("every step solved", not self.integrator.summary()["unsolved"])

    def follow(self, stops: Sequence[float], kind: str = "distance", at_stop: Callable[[], None] = lambda: None) -> None:
        """Settle, then advance from stop to stop ([m] of drag, or [s] after settling), calling `at_stop` at each."""
        self.to(time=self.simulation.settle)
        for stop in stops:
            if kind == "distance":
                self.to(distance=stop)
            else:
                self.to(time=self.simulation.settle + stop)
            at_stop()
        self.end()

    def end(self) -> None:
        """Record the limits of the time step during the run."""
        limit = self.integrator.summary().get("time_step_limit")
        self.trial.steps.append(limit["smallest"] if limit else math.nan)

    def steps(self, count: int = 1) -> None:
        """Make `count` steps of the explicit integrator, the last one recorded."""
        for _ in range(count):
            self.integrator.advance_to(time=self.state.time + 0.5 * self.state.dt, watch=self._watch)

    # ---- observed quantities --------------------------------------------------------------------------------------------------

    def label(self, body: int = 0) -> tuple[str, str]:
        """Return the state of a body, and its reason."""
        labeller = self.simulation.labeller
        assert labeller is not None
        row = self.integrator.label()[body]
        return labeller.states[int(row[0])], labeller.reasons[int(row[1])]

    def friction(self) -> float:
        """Return the present force on the upper plate along x over its normal force."""
        A = self.state.A
        return -float(A[run_totals.UPPER_FORCE]) / float(A[run_totals.UPPER_FORCE + 2])

    def loaded(self) -> np.ndarray:
        """Return which candidates are closed (n,), bool."""
        return self.state.slots.histories.slip > 0.0

    def largest_history(self) -> float:
        """Return the largest entry of the history of open contacts, which must be zero."""
        return float(np.abs(self.state.slots.H[~self.loaded()]).max(initial=0.0))

    def shear(self) -> np.ndarray:
        """Return the tangential forces of the candidates (n, 3) [N]; zero where open."""
        return np.where(self.loaded()[:, None], self.state.slots.records.tangential_force, 0.0)

    def velocity(self, number: int = 0) -> np.ndarray:
        """Return the velocity of a body (3,) [m/s]."""
        return self.state.bodies.velocity[number].copy()

    def kinetic(self) -> float:
        """Return the kinetic energy of all bodies [J]."""
        B, E = self.state.B, self.state.E
        moving = np.sum(B[:, body.MASS, None] * B[:, body.VELOCITY3] ** 2)
        return 0.5 * float(moving + np.sum(E[:, body_extra.ANGULAR_MOMENTUM3] * B[:, body.SPIN3]))

    def momentum(self) -> np.ndarray:
        """Return the linear momentum of all bodies (3,) [kg m/s]."""
        return np.sum(self.state.B[:, body.MASS, None] * self.state.bodies.velocity, axis=0)

    def leave(self, period: float) -> None:
        """Advance, in intervals of `period` [s], until bodies that have touched are apart."""
        touched = False
        for _ in range(200):
            self.to(time=self.state.time + period)
            touched = touched or bool(self.loaded().any())
            if touched and not self.loaded().any():
                break
        else:
            self.trial.check_true("the bodies part", False)
        self.end()


def rotation_of(run: CaseRun, number: int = 0) -> np.ndarray:
    """Return the rotation matrix of a body (3, 3), body to world."""
    return rotation_matrices(orientations(run.state)[number : number + 1])[0]
