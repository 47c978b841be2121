"""Rough plates under the implicit integrator: what is compiled for them, and their contacts at the start."""

import math

from thirdbody.engine.neighbours import update_closest_points
from thirdbody.engine.state import State
from thirdbody.jit.function_pointers import address
from thirdbody.kernels.columns import surface_contact
from thirdbody.kernels.rough_plates import UPDATE


def surface_updates(state: State) -> tuple[int, int]:
    """Return the addresses of what updates contacts with rough plates, in trials and in accepted steps; 0: both are flat."""
    if not state.world.rough:
        return 0, 0
    from thirdbody.kernels.implicit.surface_steps import update_accepted, update_trial

    return address(update_trial, UPDATE), address(update_accepted, UPDATE)


def find_minima(state: State) -> None:
    """Find the contacts that spheres can have with rough plates within the first step."""
    if not state.world.rough:
        return
    from thirdbody.kernels.implicit.surface_steps import update_accepted

    state.slots.Q[:, surface_contact.SEARCHED] = math.inf
    update_closest_points(state, update_accepted)
