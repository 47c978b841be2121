"""Parts of an implicit step that few scenes need: compiled, and called through pointers, only where one does."""

import math

from thirdbody.engine.neighbours import update_closest_points
from thirdbody.engine.state import State
from thirdbody.jit.function_pointers import address
from thirdbody.kernels.implicit.workspace import PART
from thirdbody.kernels.rough_plates import UPDATE
from thirdbody.kernels.tables import surface_contact

PARTS = ("update_surfaces", "accept_surfaces", "surface_tangents", "pairs_part", "rough_part", "spots_part")


def part_addresses(state: State) -> dict[str, int]:
    """Return the addresses of the parts that a state needs by their names in `workspace.KINDS`; 0 for others."""
    found = dict.fromkeys(PARTS, 0)
    if state.world.debris_meets:
        from thirdbody.kernels.implicit.pairs import pairs_part

        found["pairs_part"] = address(pairs_part, PART)
    if state.world.rough:
        from thirdbody.kernels.implicit.surface_steps import rough_part, update_accepted, update_tangents, update_trial

        found["update_surfaces"], found["accept_surfaces"] = address(update_trial, UPDATE), address(update_accepted, UPDATE)
        found["surface_tangents"], found["rough_part"] = address(update_tangents, UPDATE), address(rough_part, PART)
    if len(state.physics.interaction):
        from thirdbody.kernels.implicit.spots_part import spots_part

        found["spots_part"] = address(spots_part, PART)
    return found


def find_minima(state: State) -> None:
    """Find the contacts that spheres can have with rough plates within the first step."""
    if not state.world.rough:
        return
    from thirdbody.kernels.implicit.surface_steps import update_accepted

    state.slots.Q[:, surface_contact.SEARCHED] = math.inf
    update_closest_points(state, update_accepted)
