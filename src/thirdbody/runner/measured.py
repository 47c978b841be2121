"""What measures found, in the summary of a run."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from thirdbody.engine.measures import body_amounts
from thirdbody.laws.measures import SUM

if TYPE_CHECKING:
    from thirdbody.assembly.simulation import Simulation


def measured_summary(simulation: Simulation) -> dict[str, Any]:
    """Return the entry `measures` of the summary: sums over the bodies, largest values of means and maxima, and `warnings`.

    Empty without measures.
    """
    measures = simulation.state.physics.measures
    if measures is None:
        return {}
    amounts = body_amounts(simulation.state)
    largest = {name: float(values.max(initial=0.0)) for name, values in amounts.items()}
    totals = {c.name: float(amounts[c.name].sum()) if c.kind == SUM else largest[c.name] for c in measures.layout.bodies}
    warnings = [text for measure in simulation.choice.measures if measure.warnings for text in measure.warnings(largest)]
    return {"measures": totals, "measure_warnings": warnings}
