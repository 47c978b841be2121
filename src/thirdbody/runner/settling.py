"""End of a settling of automatic length: when load, gap and kinetic energy are steady, else at a limit, with a warning."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from thirdbody.engine.energy import stored_energies
from thirdbody.engine.state import State
from thirdbody.kernels.columns import body, patch, run_totals
from thirdbody.units import pretty

if TYPE_CHECKING:
    from thirdbody.assembly.simulation import Simulation

LOAD, GAP, BOUNCE, KINETIC = 0.01, 0.01, 0.01, 0.02
"""Largest `Unrest` of a settled scene.

The first three are a half of the 2 % by which load on debris and gap may still change: what is left of a decay is less than its
rate times the expected settling time. Loose bodies hop between rough plates with some 0.3 % of the elastic energy for ever."""

LONGEST, PERIODS = 3.0, 20.0
"""Latest end of settling, in expected times, or so many periods of the plate on its bed after the expected one if that is later:
a plate with critical dashpots on springs of which one in 200 carries load needs as many."""

LEAD = 0.25
"""Time before the end of settling at which an explicit run is looked at, in parts of the expected time (`EXTENSIONS`)."""


class Unrest(NamedTuple):
    """What still changes, as fractions.

    `load`: load that nothing carries yet, over the load; `gap`: its change at the present speed in the expected settling time;
    `bounce`: change of the load by a common rise and fall of plate and debris at their present speed; `kinetic`: kinetic over
    elastic energy.
    """

    load: float
    gap: float
    bounce: float
    kinetic: float

    @property
    def steady(self) -> bool:
        """Whether the scene has settled."""
        return all(now <= limit for now, limit in zip(self, (LOAD, GAP, BOUNCE, KINETIC), strict=True))


def unrest(state: State, time: float) -> tuple[Unrest, float]:
    """Return what still changes under an upper plate, and the period of the plate on its bed [s], at a synchronised instant.

    `time`: expected settling time [s].
    """
    P, A, B = state.P, state.A, state.B
    free, plate = P[:, patch.FREE], P[-1]
    load = float(free @ P[:, patch.LOAD])
    if not plate[patch.FREE]:  # springs below a held plate press the patches
        load += float(np.sum(P[:, patch.SPRING] * (plate[patch.HEIGHT] - P[:, patch.HEIGHT])))
    carried = float(A[run_totals.UPPER_FORCE + 2] + A[run_totals.DIRECT_FORCE + 2])
    own_loads = state.world.upper is not None and state.world.upper.foundation is None and len(state.world.upper.heights) > 1
    height, speed = P[:, (patch.HEIGHT, patch.VELOCITY)].mean(axis=0) if own_loads else plate[[patch.HEIGHT, patch.VELOCITY]]
    kinetic, *stored = stored_energies(state)
    elastic, mass = max(sum(stored), 1e-300), float(free @ P[:, patch.MASS])
    momentum, moved = float(free @ (P[:, patch.MASS] * P[:, patch.VELOCITY])), mass
    if state.inertial:
        momentum, moved = momentum + float(B[:, body.MASS] @ B[:, body.VELOCITY + 2]), mass + float(B[:, body.MASS].sum())
    common = 0.5 * momentum**2 / max(moved, 1e-300) if state.inertial else 0.0
    load = max(abs(load), 1e-300)
    now = Unrest(
        abs(carried - load) / load, abs(speed) * time / max(abs(height), 1e-300), math.sqrt(common / elastic), kinetic / elastic
    )
    # stiffness of a spring that holds the elastic energy under the load; that of Hertz's contacts is 1.2 times as large
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
        self.period = math.nan

    def advance(self, target: tuple[float, float, bool], advance_to: Callable[[float, float], None]) -> None:
        """Advance to a stop of `output_schedule.targets`, with looks on the way there."""
        (time, distance, is_output), integrator = target, self.simulation.integrator
        for look in self._looks(time):
            advance_to(look, math.inf)
        if is_output or integrator.divisible or time == self.simulation.settle:
            advance_to(time, distance)

    def _looks(self, until: float) -> Iterator[float]:
        """Yield the instants up to `until` [s] at which the scene is judged."""
        simulation = self.simulation
        while self.sought:
            look = simulation.settle_after(simulation.extended - (LEAD if simulation.integrator.divisible else 0.0))
            if look > until:
                return
            yield look
            self.last, self.period = unrest(simulation.state, self.expected)
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
        extended = self.simulation.extended
        return {"extended": extended, "sought": self.sought, "dragged": self.dragged, "last": self.last, "period": self.period}

    def restore(self, saved: dict[str, Any]) -> None:
        """Restore the result of `export_state`."""
        if saved["extended"]:
            self.simulation.extend_settling(saved["extended"])
        self.sought, self.dragged, self.period = saved["sought"], saved["dragged"], saved["period"]
        self.last = None if saved["last"] is None else Unrest(*saved["last"])

    def summary(self) -> dict[str, Any]:
        """Return the entry of the summary of a run; empty without settling of automatic length, or before its end."""
        if self.last is None or self.sought:
            return {}
        time = self.simulation.settle
        return {"settling": {"time": time, "steady": self.last.steady, "periods": time / self.period, **self.last._asdict()}}


def settling_warning(found: Mapping[str, Any] | None) -> Iterator[str]:
    """Yield a warning of a drag that began before the scene had settled; `found`: the entry of the summary."""
    if found is None or found["steady"]:
        return
    load, gap, bounce, kinetic = (f"{100.0 * found[name]:.2g} %" for name in Unrest._fields)
    yield (
        f"the drag began before the debris had settled, after {pretty(found['time'], 'time')} ({found['periods']:.2g} periods of "
        f"the plate on its bed): {load} of the load was not carried, the gap still changed by {gap} in the expected time, the "
        f"load by {bounce} as plate and debris bounced, and kinetic energy was {kinetic} of the elastic energy (settled: at most "
        f'{100.0 * LOAD:g}, {100.0 * GAP:g}, {100.0 * BOUNCE:g} and {100.0 * KINETIC:g} %); solver.settle = "'
        f'{pretty(2.0 * found["time"], "time")}" would settle for longer, more plates.upper.damping calms a plate that bounces'
    )
