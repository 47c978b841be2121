"""Rate test: whether a scene can have one, where its changeover is, and the simulation with the slower plate."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Any

from thirdbody import units
from thirdbody.assembly.schedule import slowed
from thirdbody.assembly.simulation import Simulation
from thirdbody.errors import InputError
from thirdbody.scene.cross_checks import ALONE, NO_BED

SLOWER_FROM = 2.0 / 3.0
"""Fraction of the sliding distance, or of the time of a run by duration, after which the plate is slower."""

MIN_OUTPUTS = 15
"""Least number of output intervals in the last third: with fewer no error of a mean can be given."""


@dataclass(kw_only=True)
class SlowedSimulation(Simulation):
    """Simulation whose plate is `factor` times slower from the time `changeover` [s] on; `whole` is that of the scene."""

    whole: Simulation
    factor: float
    changeover: float

    def later(self, time: float) -> float:
        """Return the time [s] at which the slower plate is where it is at a time of the whole run."""
        return self.changeover + (time - self.changeover) * self.factor

    @property
    def settle(self) -> float:
        """Time at which the motion of its schedule starts [s]; its path from there is that of the whole run."""
        return self.later(self.whole.settle)

    @property
    def end_time(self) -> float:
        """Time at which a run by duration ends [s]; infinite for a run by distance."""
        return self.later(self.whole.end_time)

    def scene_time(self, time: float) -> float:
        """Return the time [s] in the scene as it was given at which its plate is at the same position."""
        return self.whole.scene_time(self.changeover + (time - self.changeover) / self.factor)


def slow_down(whole: Simulation, changeover: float, factor: float) -> SlowedSimulation:
    """Return a simulation with the state and the integrator of another, whose plate moves slower from a time [s] on.

    The other one cannot be integrated any more; a state at the changeover must be restored before the first step.
    """
    state, plate = whole.state, whole.upper.plate
    assert plate is not None
    plate = replace(plate, schedule=slowed(plate.schedule, changeover, factor))
    state.world = replace(state.world, upper=plate)
    state.schedule, state.first = plate.schedule.tables()
    given: dict[str, Any] = {field.name: getattr(whole, field.name) for field in fields(Simulation)}
    given["upper"] = replace(whole.upper, plate=plate)
    return SlowedSimulation(**given, whole=whole, factor=factor, changeover=changeover)


def two_thirds(simulation: Simulation) -> tuple[float, float]:
    """Return time [s] and sliding distance [m] after two thirds of the distance, or of the time of a run by duration."""
    settle, schedule, duration = simulation.settle, simulation.schedule, simulation.scene.solver.duration
    if duration is not None:
        time = settle + SLOWER_FROM * duration
        return time, schedule.path(settle, time)
    distance = SLOWER_FROM * simulation.end_distance
    return schedule.time_of(distance, settle), distance


def added_time(simulation: Simulation) -> float:
    """Return the simulated time [s] that the rate test of a scene adds to its run; 0 without one."""
    factor = simulation.scene.solver.rate_test
    return 0.0 if factor is None else factor * (simulation.planned_time - two_thirds(simulation)[0])


def examine_rate_test(simulation: Simulation) -> None:
    """Raise InputError for a rate test of a scene that has no bed, that is at rest in its last third, or has few outputs."""
    scene = simulation.scene
    if scene.solver.rate_test is None:
        return
    if reason := _obstacle(simulation):
        raise InputError(scene.fault(("solver", "rate_test"), reason))


def _obstacle(simulation: Simulation) -> str:
    """Return why a scene can have no rate test, empty if it can."""
    if not simulation.state.world.debris_meets:
        return f"{NO_BED}, and here none do; {ALONE['rate_test']}"
    if simulation.plan.kind != "explicit":
        return f"{NO_BED}, which needs the explicit integrator; {ALONE['rate_test']}"
    time, distance = two_thirds(simulation)
    if simulation.planned_distance - distance <= 1e-9 * simulation.planned_distance:
        return "compares two speeds of the upper plate, which rests in the last third of this run"
    output = simulation.scene.output
    by_time = output.every_kind == "time"
    left = simulation.planned_time - time if by_time else simulation.planned_distance - distance
    if left >= (MIN_OUTPUTS - 1e-6) * output.every:
        return ""
    longest = units.pretty(left / MIN_OUTPUTS, "time" if by_time else "length")
    return (
        f"needs at least {MIN_OUTPUTS} outputs in the last third of the run, here {int(left / output.every + 1e-6)}: with fewer "
        f"no error can be given; allowed: output.every of at most {longest}"
    )
