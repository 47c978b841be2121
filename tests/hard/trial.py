"""One run of a hard case: its scenes, its simulations, advanced by one integrator at one law level, and what they must keep."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from theory import builders
from theory.builders import LONG, STEEL, ball, stiffened
from thirdbody.assembly.simulation import build
from thirdbody.engine.guards import RESIDUAL_GUARD, EnergyGuard, Ledger
from thirdbody.errors import InputError
from thirdbody.kernels.tables import body_extra, run_totals
from thirdbody.scene.model import ConstantVelocity, Contact, Motion, Scene, Solver, Spheres, UpperPlate

RESIDUAL = {"explicit": 2e-2, "implicit": 1e-6}
"""Largest residual of the energy balance with the automatic step. Explicit steps leave their truncation error (2e-3 in an impact
of 16 steps, 5e-3 where a load jumps), implicit ones the force residual of Newton's method (1e-9, at corners of laws 1e-6)."""
GAINED = 5e-3
"""Largest energy gain of the implicit integrator, over the plate's work; its truncation error has either sign. The largest is
that of `lost_contact` with `mdr` and `exact`: 3e-3 at the default tolerance and at a quarter of it, 1.2e-3 to 1.7e-3 at a
sixteenth. A law that gains energy returns 1e-2 and more."""
MICRON = 1e-6
LOAD, SPEED, BOX = 1e-4, 1.0, 2e-4
"""Load on a body [N], speed of the drag [m/s] and side of the domain [m] of the micrometre scenes."""
TRIPOD = ((-1.9, -1.1, 0.0, 2.0), (1.9, -1.1, 0.0, 2.0), (0.0, 2.2, 0.0, 2.0))
"""Three adjacent spheres (x, y, z, radius; um): three contacts below and three above, a little flatter than wide."""


@dataclass(frozen=True)
class Setting:
    """`steps`: fixed time steps [s] of the simulations, as they are built, each times `factor`; `full`: the long version."""

    integrator: str
    level: str
    steps: tuple[float, ...] = ()
    factor: float = 1.0
    full: bool = False


class Trial:
    """Builder of the simulations of a case; collects invariants, the smallest time step of every simulation so far [s], and the
    residual, NaN until something moved freely."""

    def __init__(self, setting: Setting) -> None:
        self.setting, self.built, self.residual = setting, 0, math.nan
        self.steps: list[float] = []
        self.findings: list[tuple[str, float, float]] = []

    def solver(self, **keys: Any) -> Solver:
        steps = self.setting.steps
        step = {"time_step": self.setting.factor * steps[self.built]} if steps else {}
        return Solver(**({"duration": LONG, "integrator": self.setting.integrator} | step | keys))

    def start(self, scene: Scene) -> "CaseRun":
        simulation = build(scene, force=bool(self.setting.steps))
        self.built += 1
        return CaseRun(self, simulation)

    def check(self, name: str, values: Any, limit: float, stable: float | None = None) -> None:
        """Record that values must not exceed a limit; `stable`: another limit with fixed steps, infinite for truncation alone."""
        fixed = stable is not None and self.setting.steps
        self.findings.append((name, float(np.max(values)), stable if fixed else limit))

    def check_memory(self, values: Any) -> None:
        self.check("memory of open contacts", values, 0.0)

    def check_true(self, name: str, sound: Any) -> None:
        self.check(name, 0.0 if sound else 1.0, 0.0)

    def check_refused(self, name: str, scene: Callable[[], Scene], words: str) -> None:
        try:
            build(scene())
            message = "accepted"
        except InputError as error:
            message = str(error)
        self.check_true(f"{name}: refused ({message})", words in message)

    def broken(self) -> tuple[str, ...]:
        found = sorted((row for row in self.findings if not row[1] <= row[2]), key=lambda row: row[1])
        return tuple({name: f"{name}: {value:.3g} (at most {limit:.3g})" for name, value, limit in found}.values())


class CaseRun:
    def __init__(self, trial: Trial, simulation: Any) -> None:
        self.trial, self.simulation = trial, simulation
        self.state, self.integrator = simulation.state, simulation.integrator
        self.ledger = Ledger(self.state)
        self.energy_guard = EnergyGuard(self.ledger, 2 if self.integrator.divisible else 1)

    def _watch(self) -> None:
        self.ledger.watch(self.state)
        if self.integrator.divisible:
            self.energy_guard.check(self.state)

    def to(self, time: float = math.inf, distance: float = math.inf) -> None:
        """Advance to a time [s] or a distance of the drag [m], and check what must hold in every run."""
        self.integrator.advance_to(time=time, distance=distance, watch=self._watch)
        self._watch()
        trial, state = self.trial, self.state
        kind = trial.setting.integrator
        residual = self.ledger.relative_residual(state, self.ledger.lines(state)["residual"])
        trial.residual = residual if math.isnan(trial.residual) else max(trial.residual, residual)
        trial.check("energy residual", residual, RESIDUAL[kind], RESIDUAL_GUARD)
        finite = all(np.all(np.isfinite(table)) for table in (state.S, state.B, state.E, state.P, state.A, state.slots.H))
        trial.check_true("finite numbers", finite)
        norms = np.linalg.norm(state.bodies.quaternion, axis=1)
        trial.check("length of quaternions - 1", np.abs(norms - 1.0), 1e-12)  # they are normalised in every step
        if kind == "implicit":
            built = -state.A[run_totals.NUMERICAL_LOSS] / max(state.A[run_totals.PLATE_WORK_SIZE], self.ledger.peak, 1e-300)
            trial.check("energy created by the integrator", built, GAINED)
            trial.check_true("every step solved", not self.integrator.summary()["unsolved"])

    def follow(self, stops: Sequence[float], *observed: Callable[[], Any], kind: str = "distance") -> list[list[Any]]:
        start = self.simulation.settle
        self.to(time=start)
        rows = []
        for stop in stops:
            self.to(**({"distance": stop} if kind == "distance" else {"time": start + stop}))
            rows.append([observe() for observe in observed])
        self.end()
        return [list(column) for column in zip(*rows, strict=True)]

    def end(self) -> None:
        limit = self.integrator.summary().get("time_step_limit")
        self.trial.steps.append(limit["smallest"] if limit else math.nan)

    def one_step(self) -> None:
        self.integrator.advance_to(time=self.state.time + 0.5 * self.state.dt, watch=self._watch)

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

    def label(self, number: int = 0) -> tuple[str, str]:
        labeller, row = self.simulation.labeller, self.integrator.label()[number]
        return labeller.states[int(row[0])], labeller.reasons[int(row[1])]

    def state_name(self) -> str:
        return self.label()[0]

    def friction(self) -> float:
        return -float(self.force()) / float(self.force(2))

    def force(self, axis: int = 0) -> Any:
        return self.state.A[run_totals.UPPER_FORCE + axis]

    def friction_work(self) -> Any:
        return self.state.A[run_totals.FRICTION_WORK]

    def loaded(self) -> np.ndarray:
        return self.state.slots.histories.slip > 0.0

    def memory(self) -> float:
        return float(np.abs(self.state.slots.H[~self.loaded()]).max(initial=0.0))

    def shear(self) -> float:
        return float(np.abs(np.where(self.loaded()[:, None], self.state.slots.records.tangential_force, 0.0)).max())

    def position(self, number: int = 0) -> np.ndarray:
        return self.state.bodies.position[number].copy()

    def velocity(self, number: int = 0) -> np.ndarray:
        return self.state.bodies.velocity[number].copy()

    def kinetic(self) -> float:
        return builders.kinetic(self.simulation)

    def normal_loss(self) -> float:
        """Return what flow and necks have taken from all bodies since the start [J]; 0 without the column for it."""
        return float(self.state.E[:, body_extra.NORMAL_LOSS : body_extra.NORMAL_LOSS + 1].sum())


def every(step: float, count: int) -> list[float]:
    return [step * k for k in range(1, count + 1)]


def clump(balls: Sequence[Sequence[float]], x: float = 0.5 * BOX, y: float = 0.5 * BOX, gap: float = 1e-8) -> Spheres:
    shape = [{"center": (MICRON * b[0], MICRON * b[1], MICRON * b[2]), "radius": MICRON * b[3]} for b in balls]
    return builders.clump(shape, x, y, gap)


def drag(speed: float = SPEED, axis: str = "x") -> Motion:
    return Motion(**{axis: (ConstantVelocity(velocity=speed),)})


def scene(trial: Trial, debris: Sequence[Any], materials: dict[str, Any], friction: float, *, restitution: float = 1.0,
          size: float = 10.0, upper: UpperPlate | None = None, **tables: Any) -> Scene:  # fmt: skip
    contact = Contact(level=trial.setting.level, debris_contact="auto" if upper is None else "none")
    tables = {"contact": contact, "solver": trial.solver(settle=tables.pop("settle", "auto"))} | tables
    return builders.scene(debris, materials, friction, restitution, size=size, upper=upper, **tables)


def on_plane(trial: Trial, material: Any, radius: float, velocity: Sequence[float], friction: float, **keys: Any) -> Scene:
    """Return a sphere that touches a rigid plane of the same Poisson's ratio at time zero, without overlap."""
    materials = {"ball": material, "plane": stiffened(material)}
    return scene(trial, [ball(radius, (5.0, 5.0, radius), velocity)], materials, friction, lower="plane", **keys)


def pressed(trial: Trial, debris: Any, friction: float, motion: Motion | None = None, restitution: float = 0.5,
            materials: dict[str, Any] | None = None, plate: dict[str, Any] | None = None, **tables: Any) -> Scene:  # fmt: skip
    known = materials or {"ball": STEEL}
    last = list(known)[-1]
    keys = {"support": "load_per_particle", "load": LOAD, "motion": motion or drag()} | (plate or {})
    upper = UpperPlate(material=last, **{key: value for key, value in keys.items() if value is not None})
    return scene(trial, [debris], known, friction, restitution=restitution, size=BOX, lower=last, upper=upper, **tables)
