"""Text that names the contacts of a body, for messages of guards."""

import numpy as np

from thirdbody.engine.state import State
from thirdbody.kernels.tables import LOWER


def loaded_spots(state: State, body: int) -> str:
    """Return text that lists the contacts of a body with their forces."""
    slots, report = state.slots, []
    for entry in slots.incidence[slots.edges[body] : slots.edges[body + 1]]:
        k = entry >> 1
        if slots.histories.slip[k] > 0.0:
            sphere = int((slots.partner[k] if entry & 1 else slots.own[k]) - state.start[body])
            force, shear = slots.records.normal_force[k], float(np.linalg.norm(slots.records.tangential_force[k]))
            report.append(f"sphere {sphere} on {partner_of(state, k, body)} with N = {force:.3g} N, T = {shear:.3g} N")
    return "its loaded spots: " + ("; ".join(report) or "none")


def partner_of(state: State, slot: int, body: int) -> str:
    """Return text that names what a body touches in a contact."""
    slots = state.slots
    if slots.partner[slot] < 0:
        return f"the {'lower' if slots.sides[slot] == LOWER else 'upper'} plate"
    owner, partner = state.body[slots.own[slot]], state.body[slots.partner[slot]]
    return f"body {state.order[partner if owner == body else owner]}"
