"""Results of measures, in the summary of a run."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from thirdbody.engine.measures import body_amounts
from thirdbody.laws.measures import SUM

if TYPE_CHECKING:
    from thirdbody.assembly.simulation import Simulation


def measured_summary(simulation: Simulation) -> dict[str, Any]:
    """Return the entry `measures` of the summary: sums over the bodies, largest values of means and maxima; empty without any."""
    measures = simulation.state.physics.measures
    if measures is None:
        return {}
    amounts = body_amounts(simulation.state)
    return {"measures": {c.name: float(amounts[c.name].sum() if c.kind == SUM else amounts[c.name].max(initial=0.0))
                         for c in measures.layout.bodies}}  # fmt: skip


def measure_warnings(simulation: Simulation) -> list[str]:
    """Return the warnings of measures at the end of a run, from the largest value of each amount over the bodies."""
    chosen = [measure for measure in simulation.choice.measures if measure.warnings]
    largest = {name: float(values.max(initial=0.0)) for name, values in body_amounts(simulation.state).items()} if chosen else {}
    return [text for measure in chosen if measure.warnings for text in measure.warnings(largest)]
