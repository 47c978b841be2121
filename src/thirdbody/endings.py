"""What the end of a run says about its own accuracy: energy that the integrator lost, and a load that is not reached."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

from .kernels import layout as at

if TYPE_CHECKING:
    from .conduct import Conduct
    from .scene.build import Simulation

LOSS = 0.01
"""Energy lost by the integrator that is told of, as a share of the scale of the energy residual."""

LOAD = 0.1
"""Deviation of the mean force on the upper plate from its load that is told of, as a share of the load."""


def endings(simulation: Simulation, conduct: Conduct, lines: Mapping[str, float]) -> dict[str, Any]:
    """`energy_numerical_share`: the loss on the line `numerical`, divided as the residual is, so 0 where there is no energy.
    `load_ratio`: mean force on the upper plate since the last frame over its load; None where no constant load is prescribed."""
    return {
        "energy_numerical_share": conduct.ledger.relative_residual(simulation.state, lines["numerical"]),
        "load_ratio": _load_ratio(simulation, conduct.series.get("upper_force")),
    }


def _load_ratio(simulation: Simulation, force: Any) -> float | None:
    P = simulation.state.P
    load = float((P[:, at.P_FREE] * P[:, at.P_LOAD]).sum())
    if force is None or load <= 0.0 or simulation.schedule.load or (P[:, at.P_SPRING] != 0.0).any():
        return None
    return float(force[2]) / load


def ending_warnings(told: Mapping[str, Any]) -> Iterator[str]:
    """Warnings after a run, from its summary; runs of older versions have none."""
    share, ratio = told.get("energy_numerical_share"), told.get("load_ratio")
    if share is not None and share > LOSS:
        yield (
            f"the implicit integrator itself lost {100.0 * share:.1f} % of the energy (line `numerical`): it damps impacts and "
            "oscillations that are faster than its steps; a smaller solver.tolerance resolves them, and where they are the "
            "question, solver.integrator = \"explicit\""
        )
    if ratio is not None and abs(ratio - 1.0) > LOAD and told.get("finished"):
        yield (
            f"over the last output interval the debris carried {ratio:.2f} times the load on the upper plate: the difference "
            "accelerates the plate's mass, which still bounces; more plates.upper.damping or a slower motion keeps it in contact"
        )


def step_words(told: Mapping[str, Any]) -> str:
    """What limited the steps of an implicit run, such as `error 60 %, growth 25 %`; empty for others."""
    counts = told.get("steps_limited_by") or {}
    whole = sum(counts.values())
    return ", ".join(f"{name.replace('_', ' ')} {100.0 * n / whole:.0f} %" for name, n in list(counts.items())[:3])
