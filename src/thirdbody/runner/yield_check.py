"""Largest recorded peak pressure against first yield: contacts are computed as elastic beyond it too, unless they flow."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from thirdbody.assembly.load_checks import limit_words, times
from thirdbody.engine.state import World
from thirdbody.laws.hertz import yield_limit
from thirdbody.trajectory.frame_contacts import FrameContacts
from thirdbody.trajectory.names import LOWER_PLATE, UPPER_PLATE
from thirdbody.units import pretty

if TYPE_CHECKING:
    from thirdbody.assembly.simulation import Simulation


class PeakPressure:
    """Contact nearest to first yield, or farthest above it, over the frames of a run."""

    def __init__(self, simulation: Simulation) -> None:
        state, self.materials = simulation.state, simulation.choice.materials
        self.of_body, self.of_plate = state.material[state.given], plate_materials(state.world)
        self.limits = np.array([[yield_limit(a, b).pressure for b in self.materials] for a in self.materials])
        self.ratio, self.pressure, self.pair, self.over = 0.0, 0.0, (0, 0), 0
        self.flows = simulation.state.physics.loss == "plastic"

    def export_state(self) -> dict[str, Any]:
        """Return what a checkpoint holds of it."""
        return {"ratio": self.ratio, "pressure": self.pressure, "pair": list(self.pair), "over": self.over}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Go on from `export_state`. Raises KeyError, TypeError or ValueError."""
        self.ratio, self.pressure, self.over = float(state["ratio"]), float(state["pressure"]), int(state["over"])
        self.pair = (int(state["pair"][0]), int(state["pair"][1]))
        if not 0 <= min(self.pair) <= max(self.pair) < len(self.materials):
            raise ValueError(f"notes: pressure.pair is {self.pair}, expected numbers of {len(self.materials)} materials")

    def update(self, contacts: FrameContacts) -> None:
        """Update with the contacts of one frame."""
        pressure, (own, other) = contacts.peak_pressure, self._sides(contacts)
        if not len(pressure):
            return
        ratio = pressure / self.limits[own, other]
        worst = int(np.argmax(ratio))
        self.over = max(self.over, int(np.count_nonzero(ratio > 1.0)))
        self.pressure = max(self.pressure, float(pressure.max()))
        if ratio[worst] > self.ratio:
            self.ratio, self.pair = float(ratio[worst]), (int(own[worst]), int(other[worst]))

    def _sides(self, contacts: FrameContacts) -> tuple[np.ndarray, np.ndarray]:
        """Return the material codes of each contact's body and of its partner, (n,) and (n,)."""
        partner = contacts.partner
        other = self.of_body[np.maximum(partner, 0)]
        for side, material in self.of_plate.items():
            other = np.where(partner == side, material, other)
        return self.of_body[contacts.body], other

    def summary(self) -> dict[str, Any]:
        """Return largest peak pressure [Pa], largest ratio to first yield, that limit [Pa] or None, materials."""
        a, b = (self.materials[k] for k in self.pair)
        limit = yield_limit(a, b)
        finite = math.isfinite(limit.pressure)
        flows = {"flows": True} if self.flows else {}
        return {
            "peak_pressure": self.pressure,
            "first_yield": {
                "ratio": self.ratio,
                "pressure": limit.pressure if finite else None,
                "between": [a.name, b.name],
                "material": limit.material,
                "yield_strength": limit.strength if finite else None,
                "assumed": limit.assumed,
                "contacts": self.over,
                **flows,
            },
        }


def plate_materials(world: World) -> dict[int, int]:
    """Return the material code of each plate by its partner code in frames."""
    given = {LOWER_PLATE: world.lower, UPPER_PLATE: None if world.upper is None else world.upper.material}
    return {side: material for side, material in given.items() if material is not None}


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


def yield_warning(summary: Mapping[str, Any]) -> str:
    """Return a warning of contacts above first yield, from the summary of a run; empty without such contacts."""
    result = summary.get("first_yield")
    if not result or result.get("flows") or not result["ratio"] > 1.0:
        return ""
    words = f"peak pressure {yield_words(summary)}, in {result['contacts']} contact(s) of one frame"
    remedy = "a lower load stays below, [effects.elastic_plastic] lets them flow"
    return f"{words}: they would flow plastically, and are computed as elastic; {remedy}"
