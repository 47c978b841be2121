"""End of a settling of automatic length: when load, gap and kinetic energy are steady, else at a limit, with a warning."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from thirdbody.engine.guards import stored_energies
from thirdbody.engine.state import State
from thirdbody.kernels.tables import body, patch, run_totals
from thirdbody.units import pretty

if TYPE_CHECKING:
    from thirdbody.assembly.simulation import Simulation

LOAD, GAP, BOUNCE, KINETIC = 0.01, 0.01, 0.01, 0.02
"""Largest `Unrest` of a settled scene.

The first three are a half of the 2 % by which load on debris and gap may still change: what is left of a decay is less than its
rate times the expected settling time. Loose bodies hop between rough plates for ever: their energy is steady."""

LONGEST, PERIODS = 3.0, 20.0
"""Latest end of settling, in expected times, or so many periods of the plate on its bed after the expected one if that is later:
a plate with critical dashpots on springs of which one in 200 carries load needs as many."""

LEAD, TINY = 0.25, 1e-300
"""Time before the end of settling at which an explicit run is looked at, in parts of the expected time (`EXTENSIONS`); guard of
divisions."""


class Unrest(NamedTuple):
    """What still changes, as fractions.

    `load`: load that nothing carries yet, over the load, or what debris takes of it, over the load on debris, if that is larger;
    `gap`: its change at the present speed in the expected settling time; `bounce`: change of the load by a common rise and fall
    of plate and debris at their present speed; `kinetic`: change of the kinetic energy since the last look, or all of it if that
    is less, over the elastic energy.
    """

    load: float
    gap: float
    bounce: float
    kinetic: float

    @property
    def steady(self) -> bool:
        """Whether the scene has settled."""
        return all(now <= limit for now, limit in zip(self, (LOAD, GAP, BOUNCE, KINETIC), strict=True))


def unrest(state: State, time: float, before: float) -> tuple[Unrest, float]:
    """Return what still changes under an upper plate, and the period of the plate on its bed [s], at a synchronised instant.

    `time`: expected settling time [s]; `before`: kinetic energy at the last look, 0 at the first [J].
    """
    P, A, B = state.P, state.A, state.B
    free, plate = P[:, patch.FREE], P[-1]
    load = float(free @ P[:, patch.LOAD])
    if not plate[patch.FREE]:  # springs below a held plate press the patches
        load += float(np.sum(P[:, patch.SPRING] * (plate[patch.HEIGHT] - P[:, patch.HEIGHT])))
    debris, direct = float(A[run_totals.UPPER_FORCE + 2]), float(A[run_totals.DIRECT_FORCE + 2])
    kinetic, *stored, shared = stored_energies(state)
    springs = max(sum(map(abs, stored)), TINY)  # that of adhesion is negative
    load, elastic, mass = max(abs(load), TINY), springs + shared, float(free @ P[:, patch.MASS])
    left = abs(debris + direct - load)
    # what debris takes of it, by the stiffness of springs that hold the energies; that of Hertz's contacts is 1.2 times as large
    own, other = debris * debris / (2.0 * springs), direct * direct / max(shared, TINY)
    on_debris = left * own / max(own + other, TINY) / debris if debris > 0.0 else 0.0
    own_loads = state.world.upper is not None and state.world.upper.foundation is None and len(state.world.upper.heights) > 1
    height, speed = P[:, (patch.HEIGHT, patch.VELOCITY)].mean(axis=0) if own_loads else plate[[patch.HEIGHT, patch.VELOCITY]]
    common = 0.0
    if state.inertial:
        momentum = float(free @ (P[:, patch.MASS] * P[:, patch.VELOCITY])) + float(B[:, body.MASS] @ B[:, body.VELOCITY + 2])
        common = 0.5 * momentum**2 / (mass + float(B[:, body.MASS].sum()))
    change = min(kinetic, abs(kinetic - before))
    gap_change = abs(speed) * time / max(abs(height), TINY)
    now = Unrest(max(left / load, on_debris), gap_change, math.sqrt(common / elastic), change / elastic)
    return now, 2.0 * math.pi * math.sqrt(2.0 * elastic * mass) / load


class Settling:
    """Looks at a scene that settles, and lets settling last longer until it is steady.

    The expected time is the shortest. The explicit integrator passes a stop by part of a step, so it is looked at `LEAD` before
    the end; steps of the implicit one end there. `begin_drag` is called at the end of settling, once.
    """

    def __init__(self, simulation: Simulation, begin_drag: Callable[[], None]) -> None:
        self.simulation, self.begin_drag, self.dragged = simulation, begin_drag, False
        upper, self.expected = simulation.scene.plates.upper, simulation.upper.settle
        self.sought = simulation.scene.solver.settle == "auto" and self.expected > 0.0 and upper is not None and not upper.closing
        self.last: Unrest | None = None
        self.period, self.kinetic = math.nan, 0.0

    def advance(self, target: tuple[float, float, bool], advance_to: Callable[[float, float], None]) -> None:
        """Advance to a stop of `output_schedule.targets`, with looks on the way there."""
        (time, distance, is_output), integrator = target, self.simulation.integrator
        for instant in self._instants(time):
            advance_to(instant, math.inf)
        if is_output or integrator.divisible or time == self.simulation.settle:
            advance_to(time, distance)

    def _instants(self, until: float) -> Iterator[float]:
        """Yield the instants up to `until` [s] at which the scene is judged."""
        simulation = self.simulation
        while self.sought:
            instant = simulation.settle_after(simulation.extended - (LEAD if simulation.integrator.divisible else 0.0))
            if instant > until:
                return
            yield instant
            self.last, self.period = unrest(simulation.state, self.expected, self.kinetic)
            self.kinetic = stored_energies(simulation.state)[0]
            longest = max(LONGEST * self.expected, self.expected + PERIODS * self.period)
            in_time = simulation.state.time <= simulation.settle and simulation.settle_after(simulation.extended + 1) <= longest
            self.sought = not self.last.steady and in_time
            if self.sought:
                simulation.extend_settling(simulation.extended + 1)
        if until > simulation.settle and not self.dragged:
            self.dragged = True
            self.begin_drag()

    def export_state(self) -> dict[str, Any]:
        """Return what goes on with a run, as plain numbers."""
        names = ("sought", "dragged", "last", "period", "kinetic")
        return {"extended": self.simulation.extended, **{name: getattr(self, name) for name in names}}

    def restore(self, saved: dict[str, Any]) -> None:
        """Restore the result of `export_state`."""
        if saved["extended"]:
            self.simulation.extend_settling(saved["extended"])
        self.sought, self.dragged, self.period, self.kinetic = (saved[k] for k in ("sought", "dragged", "period", "kinetic"))
        self.last = None if saved["last"] is None else Unrest(*saved["last"])

    def summary(self) -> dict[str, Any]:
        """Return the entry of the summary of a run; empty without settling of automatic length, or before its end."""
        if self.last is None or self.sought:
            return {}
        time = self.simulation.settle
        return {"settling": {"time": time, "steady": self.last.steady, "periods": time / self.period, **self.last._asdict()}}


def settling_warning(settling: Mapping[str, Any] | None) -> Iterator[str]:
    """Yield a warning of a drag that began before the scene had settled; `settling`: the entry of the summary."""
    if settling is None or settling["steady"]:
        return
    load, gap, bounce, kinetic = (f"{100.0 * settling[name]:.2g} %" for name in Unrest._fields)
    after = f"{pretty(settling['time'], 'time')} ({settling['periods']:.2g} periods of the plate on its bed)"
    yield (
        f"the drag began before the debris had settled, after {after}: {load} of the load was not carried, "
        f"the gap changed by {gap} in the expected time, the load by {bounce} as plate and debris bounced, "
        f"and kinetic energy by {kinetic} of the elastic energy "
        f"(settled: at most {100.0 * LOAD:g}, {100.0 * GAP:g}, {100.0 * BOUNCE:g} and {100.0 * KINETIC:g} %); "
        f'solver.settle = "{pretty(2.0 * settling["time"], "time")}" would settle for longer, more plates.upper.damping calms a '
        "plate that bounces"
    )
