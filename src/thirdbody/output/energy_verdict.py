"""Does the energy balance of a run close, and if not, why: one sentence from the facts of the run."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from typing import Any

CLOSED = 1e-3
"""Largest residual, over the largest energy of the run, of which nothing is said."""

MUCH = 0.05
"""Share of the energy spent from which a line of the ledger is named as the likely reason."""


def energy_verdict(summary: Mapping[str, Any], scene_text: str = "") -> str | None:
    """What is wrong with the energy balance and the likely reason; None where it closes or is not known.

    `summary`: what a run stored at its end. `scene_text`: its scene, which tells whether the time step is a fixed one.
    """
    residual, lines = summary.get("energy_residual"), summary.get("energy") or {}
    if residual is None or residual <= CLOSED:
        return None
    reason = _reason(summary, lines, scene_text)
    return f"energy balance open by {residual:.1e} of the largest energy (above {CLOSED:g}): {reason}"


def _reason(summary: Mapping[str, Any], lines: Mapping[str, float], scene_text: str) -> str:
    if summary.get("integrator") != "explicit":
        return "smaller steps are needed: a smaller solver.tolerance or solver.largest_step"
    step, limit = summary.get("time_step"), summary.get("time_step_limit") or {}
    smallest = limit.get("smallest")
    remedy = "take a smaller solver.time_step"
    if step and smallest:
        remedy = f'run again with solver.time_step = "{0.5 * min(step, smallest):.2g} s"'
    if step and smallest and _fixed_step(scene_text) and step > 1.001 * smallest:
        return f"the time step is {step / smallest:.2g} times the automatic one; {remedy}"
    spent = {name: abs(lines.get(name, 0.0)) for name in ("damping", "friction")}
    share = spent["damping"] / max(sum(spent.values()), 1e-300)
    if share > MUCH:
        return f"dashpots take {100.0 * share:.0f} % of what is lost and a step is too long for them; {remedy}"
    return f"a step is too long for some impact or contact; {remedy}"


def _fixed_step(scene_text: str) -> bool:
    """Whether a scene names its time step."""
    try:
        step = tomllib.loads(scene_text).get("solver", {}).get("time_step", "auto")
    except tomllib.TOMLDecodeError:
        return False
    return bool(step != "auto")
