"""What is wrong with a finished run: energy error, loads that are not carried, dashpot work, contacts above first yield."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from thirdbody.assembly.plate_load import limit_words, times
from thirdbody.engine.measures import body_amounts
from thirdbody.engine.upper_plate import mean_value
from thirdbody.kernels.tables import contact_state, patch, record
from thirdbody.runner.stops import SETTLED, Unrest
from thirdbody.units import pretty

if TYPE_CHECKING:
    from thirdbody.assembly.simulation import Simulation
    from thirdbody.runner.run_loop import RunLoop

LOAD = 0.1
"""Deviation of the mean force on the upper plate from its load, over the load, that gives a warning."""

CARRIED = 0.5
"""Fraction of its load below which a patch counts as not carried."""

DASHPOT_REPORTED = 0.05
"""Dashpot force at the drag speed over the load of a patch above which `damping_share` is reported.

At 0.07 and friction 0.8, where most bodies roll, friction dissipates 0.79 of the plate's work; at 0.7 it dissipates 0.51."""

DAMPED = 0.1
"""Fraction of the plates' work dissipated in dashpots that gives a warning."""

RUBBED = 0.01
"""Friction work over the plates' work below which the work of dashpots gives no warning."""


def endings(simulation: Simulation, loop: RunLoop, lines: Mapping[str, float]) -> dict[str, Any]:
    """Return the accuracy entries of the summary of a run.

    `energy_numerical_share`: the entry `numerical` of the ledger, normalised as the residual is, so 0 where there is no energy;
    negative where energy was gained. `load_ratio`: mean force on the upper plate over its mean load since the last frame; None
    where no load is prescribed. `patches_not_carried`: in a quasi-static run, the number of patches that nothing presses against.
    `histories_shortened`: contacts whose law had no room for its whole history and dropped the smallest part of it.
    `damping_share`: fraction of the plates' work dissipated in dashpots; None where those of the patches are negligible.
    """
    fraction = loop.ledger.relative_residual(simulation.state, lines["numerical"])
    return {
        "energy_numerical_share": math.copysign(fraction, lines["numerical"]),
        "load_ratio": _load_ratio(simulation, loop),
        "damping_share": _damping_fraction(simulation, lines),
        "patches_not_carried": None if simulation.state.inertial else patches_not_carried(simulation),
        "histories_shortened": histories_shortened(simulation),
    }


def histories_shortened(simulation: Simulation) -> int:
    """Return the number of touching contacts whose law dropped part of its history (`dropped` > 0)."""
    slots, names = simulation.state.slots, simulation.choice.chain.history
    columns = [contact_state.LAW + k for k, name in enumerate(names) if name.endswith(".dropped")]
    return int(np.count_nonzero((slots.rows.histories(slots.rows.closed(), columns) > 0.0).any(axis=1))) if columns else 0


def _load_ratio(simulation: Simulation, loop: RunLoop) -> float | None:
    force, P = loop.series.get("upper_force"), simulation.state.P
    loaded = P[-1:] if (P[:, patch.SPRING] != 0.0).any() else P  # patches on a foundation pass on the load of the common plate
    load = float(
        (loaded[:, patch.FREE] * (loaded[:, patch.NOMINAL_LOAD] if simulation.schedule.load else loaded[:, patch.LOAD])).sum()
    )
    if simulation.schedule.load:
        now = simulation.state.time
        load *= mean_value(simulation.schedule.load, now - loop.maker.interval, now)
    if simulation.state.world.zone is not None:
        load = simulation.state.world.zone.load
    direct = loop.series["direct_force"][2] if force is not None and "direct_force" in loop.series else 0.0
    return float(force[2] + direct) / load if force is not None and load > 0.0 else None


def _damping_fraction(simulation: Simulation, lines: Mapping[str, float]) -> float | None:
    P, speed = simulation.state.P, simulation.schedule.top_speed()
    loaded = (P[:, patch.FREE] > 0.0) & (P[:, patch.LOAD] > 0.0)
    relevant = bool((P[loaded, patch.DAMPING] * speed > DASHPOT_REPORTED * P[loaded, patch.LOAD]).any())
    return lines["damping"] / lines["plate_work"] if relevant and lines["plate_work"] > 0.0 else None


def patches_not_carried(simulation: Simulation) -> int:
    """Return the number of patches that carry less than the fraction `CARRIED` of their load."""
    P, slots = simulation.state.P, simulation.state.slots
    closed = slots.rows.closed()
    patches, (force,) = slots.patches[closed], slots.rows.records(closed, record.NORMAL_FORCE)
    carried = np.bincount(patches[patches >= 0], force[patches >= 0], len(P))
    alone = (P[:, patch.FREE] > 0.0) & (P[:, patch.SPRING] == 0.0)
    return int(np.count_nonzero(alone & (carried < CARRIED * P[:, patch.LOAD])))


def warnings_at_end(simulation: Simulation, report: Mapping[str, Any]) -> list[str]:
    """Return the warnings at the end of a run: those of its summary, then those of its measures."""
    chosen = [measure for measure in simulation.choice.measures if measure.warnings]
    largest = {name: float(values.max(initial=0.0)) for name, values in body_amounts(simulation.state).items()} if chosen else {}
    return [*ending_warnings(report), *(text for measure in chosen if measure.warnings for text in measure.warnings(largest))]


def ending_warnings(report: Mapping[str, Any]) -> Iterator[str]:
    """Yield warnings at the end of a run, from its summary; those of its frames: `trajectory.run_summary`."""
    yielded = report.get("first_yield")
    if yielded and not yielded.get("flows") and yielded["ratio"] > 1.0:
        yield (
            f"peak pressure {yield_words(report)}, in {yielded['contacts']} contact(s) of one frame: they would flow "
            "plastically, and are computed as elastic; a lower load stays below, [effects.elastic_plastic] lets them flow"
        )
    ratio, left = report.get("load_ratio"), report.get("patches_not_carried")
    if ratio is not None and abs(ratio - 1.0) > LOAD and report.get("finished"):
        yield (
            f"over the last output interval the debris carried {ratio:.2f} times the load on the upper plate: the difference "
            "accelerates the plate's mass, which still bounces; more plates.upper.damping or a slower motion keeps it in contact"
        )
    settling = report.get("settling")
    if settling is not None and not settling["steady"]:
        yield _settling_warning(settling)
    damped, energy = report.get("damping_share"), report.get("energy") or {}
    friction = energy.get("friction", 0.0) / max(energy.get("plate_work", 0.0), 1e-300)
    if damped is not None and damped > DAMPED and friction > RUBBED:
        yield (
            f"dashpots took {100.0 * damped:.0f} % of the work of the plates, friction {100.0 * friction:.0f} %: patches of the "
            "upper plate that rise and fall with bodies that roll lose it, so friction work depends on plates.upper.damping; "
            "a lower one or a slower motion leaves more of it to friction"
        )
    short = report.get("histories_shortened")
    if short:
        yield (
            f"{short} contacts bent their history more often than contact.nodes allows, and dropped the least of it: an "
            "error of some 1e-4 of mu N with 48 nodes, which falls with the square of their number"
        )
    if left:
        yield (
            f"at the end {left} of {report['bodies']} patches of the upper plate carry less than {CARRIED:g} of their load: "
            "their dashpots do, or their bodies are gone; lower plates.upper.damping or the speed, or leave solver.inertia out"
        )


def step_words(report: Mapping[str, Any]) -> str:
    """Describe what limited the steps of an implicit run, such as `error 60 %, growth 25 %`; empty for others."""
    counts = report.get("steps_limited_by") or {}
    whole = sum(counts.values())
    return ", ".join(f"{name.replace('_', ' ')} {100.0 * n / whole:.0f} %" for name, n in list(counts.items())[:3])


def yield_words(summary: Mapping[str, Any]) -> str:
    """Describe the largest peak pressure of a run, from its summary; empty for a run without one."""
    result, pressure = summary.get("first_yield"), summary.get("peak_pressure")
    if not result or not pressure:
        return ""
    words = pretty(pressure, "pressure")
    if result["pressure"] is None:
        return f"{words}; no yield strength is known or assumed"
    where = limit_words(result["material"], result["pressure"], result["yield_strength"], result["assumed"])
    return f"{words}; {result['between'][0]}/{result['between'][1]}: {times(result['ratio'])} {where}"


def _settling_warning(settling: Mapping[str, Any]) -> str:
    load, gap, bounce, kinetic = (f"{100.0 * settling[name]:.2g} %" for name in Unrest._fields)
    after = f"{pretty(settling['time'], 'time')} ({settling['periods']:.2g} periods of the plate on its bed)"
    *first, last = (f"{100.0 * limit:g}" for limit in SETTLED)
    return (
        f"the drag began before the debris had settled, after {after}: {load} of the load was not carried, "
        f"the gap changed by {gap} in the expected time, the load by {bounce} as plate and debris bounced, "
        f"and kinetic energy by {kinetic} of the elastic energy (settled: at most {', '.join(first)} and {last} %); "
        f'solver.settle = "{pretty(2.0 * settling["time"], "time")}" would settle for longer, more plates.upper.damping calms a '
        "plate that bounces"
    )
