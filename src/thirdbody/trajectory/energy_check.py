"""Check of the energy balance of a run and of the numerical loss of its integrator, with the likely cause."""

import tomllib
from collections.abc import Mapping
from typing import Any

CLOSED = 1e-3
"""Largest residual, relative to the largest energy of the run, that is accepted."""

MAX_NUMERICAL_LOSS = 0.01
"""Largest numerical loss or gain of the implicit integrator, relative to the largest energy of the run, that is accepted."""

MUCH = 0.05
"""Fraction of the spent energy from which a line of the ledger is named as the likely cause."""


def energy_verdict(summary: Mapping[str, Any], scene_text: str = "") -> str | None:
    """Return the error of a run's energy and its likely cause; None where the balance closes or is unknown.

    `summary`: what a run stored at its end. `scene_text`: its scene, for whether the time step is fixed and whether bodies have
    inertia.
    """
    residual, lines = summary.get("energy_residual"), summary.get("energy") or {}
    solver, report = _solver(scene_text), []
    if residual is not None and residual > CLOSED:
        reason = _reason(summary, lines, solver)
        report.append(f"energy balance open by {residual:.1e} of the largest energy (above {CLOSED:g}): {reason}")
    fraction = summary.get("energy_numerical_share") or 0.0
    if abs(fraction) > MAX_NUMERICAL_LOSS:
        done = "lost" if fraction > 0.0 else "made"
        what = f"the implicit integrator itself {done} {100.0 * abs(fraction):.1f} % of the energy (line `numerical`)"
        report.append(f"{what}: {_numerical_reason(fraction, solver)}")
    return "; ".join(report) or None


def _numerical_reason(fraction: float, solver: Mapping[str, Any]) -> str:
    if fraction < 0.0:
        return "steps are too long, or a contact law creates energy; a smaller solver.tolerance or solver.largest_step is needed"
    if solver.get("inertia") is False:
        return (
            "without inertia nothing carries the energy that is set free where a body tips or a spot snaps, and it is lost at "
            "once; with solver.inertia = true dashpots and friction take it, in their own time"
        )
    return (
        "it damps impacts and oscillations that are faster than its steps; a smaller solver.tolerance resolves them, and where "
        'they are the question, solver.integrator = "explicit"'
    )


def _reason(summary: Mapping[str, Any], lines: Mapping[str, float], solver: Mapping[str, Any]) -> str:
    if summary.get("integrator") != "explicit":
        return "smaller steps are needed: a smaller solver.tolerance or solver.largest_step"
    step, limit = summary.get("time_step"), summary.get("time_step_limit") or {}
    smallest = limit.get("smallest")
    remedy = "take a smaller solver.time_step"
    if step and smallest:
        remedy = f'run again with solver.time_step = "{0.5 * min(step, smallest):.2g} s"'
    if step and smallest and solver.get("time_step", "auto") != "auto" and step > 1.001 * smallest:
        return f"the time step is {step / smallest:.2g} times the automatic one; {remedy}"
    spent = {name: abs(lines.get(name, 0.0)) for name in ("damping", "friction")}
    fraction = spent["damping"] / max(sum(spent.values()), 1e-300)
    if fraction > MUCH:
        return f"dashpots take {100.0 * fraction:.0f} % of what is lost and a step is too long for them; {remedy}"
    return f"a step is too long for some impact or contact; {remedy}"


def _solver(scene_text: str) -> Mapping[str, Any]:
    """Return the table `solver` of a scene; empty where it cannot be read."""
    try:
        return dict(tomllib.loads(scene_text).get("solver", {}))
    except tomllib.TOMLDecodeError:
        return {}
