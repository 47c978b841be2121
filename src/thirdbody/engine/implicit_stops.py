"""Why a body of an implicit run has stopped, in words."""

from __future__ import annotations

from typing import TYPE_CHECKING

from thirdbody.engine.contact_words import loaded_spots, partner_of
from thirdbody.engine.state import State
from thirdbody.kernels.implicit.control import Stop
from thirdbody.kernels.implicit.tables import step_memory, step_settings
from thirdbody.kernels.tables import domain, run_totals
from thirdbody.kernels.tile import TILE

if TYPE_CHECKING:
    from thirdbody.engine.implicit import Implicit


def name_of(number: int, state: State) -> str:
    """Return text that names a body by its number in the scene and its position."""
    where = ", ".join(f"{x:.4g}" for x in state.bodies.position[number])
    return f"body {state.order[number]} at ({where}) m"


def explain(integrator: Implicit, body: int) -> str:
    """Return what stopped a body, when, and what can be done."""
    s, totals = integrator.state, integrator.totals[body]
    code, when = int(integrator.memory[body, step_memory.CODE]), f"stopped at t = {totals[run_totals.TIME]:.6g} s"
    who = name_of(body, s)
    if code == Stop.OVERLAP:
        slot = int(integrator.memory[body, step_memory.SLOT])
        own, partner = int(s.slots.own[slot]), int(s.slots.partner[slot])
        radius = s.spheres.radius[own] if partner < 0 else min(s.spheres.radius[own], s.spheres.radius[partner])
        ratio, limit = s.slots.records.overlap[slot] / radius, s.D[domain.OVERLAP_GUARD]
        text = f"sinks into {partner_of(s, slot, body)} by {ratio:.2f} of the radius (guard: {limit:g})"
        return f"{when}: {who} {text}; a lower load is needed"
    if code == Stop.LEFT:
        return f"{when}: {who} left the domain"
    if code == Stop.CROWDED:
        return f"{when}: {who} has more than {TILE} loaded spots, which the implicit integrator cannot hold"
    if code == Stop.BAD_BODY:
        return f"{when}: the position of body {s.order[body]} is not a number"
    shortest = integrator.settings[step_settings.SHORTEST]
    return f"{when}: no step of {who} could be solved, down to {shortest:.2g} s; {loaded_spots(s, body)}"
