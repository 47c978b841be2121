"""Rough plates under the implicit integrator: what is compiled for them, and their contacts at the start."""

import math
from typing import NamedTuple

from thirdbody.engine.neighbours import update_closest_points
from thirdbody.engine.state import State
from thirdbody.jit.arguments import address
from thirdbody.kernels.implicit.surface_steps import update_accepted, update_tangents, update_trial
from thirdbody.kernels.rough_plates import UPDATE
from thirdbody.kernels.tables import surface_contact


class SurfaceUpdates(NamedTuple):
    """Addresses of what updates contacts with rough plates; 0: both are flat."""

    update_surfaces: int = 0
    """In each trial of a step."""
    accept_surfaces: int = 0
    """In accepted steps."""
    surface_tangents: int = 0
    """Before each Jacobian."""


def surface_updates(state: State) -> SurfaceUpdates:
    """Return the addresses of what updates contacts with rough plates."""
    if not state.world.rough:
        return SurfaceUpdates()
    return SurfaceUpdates(address(update_trial, UPDATE), address(update_accepted, UPDATE), address(update_tangents, UPDATE))


def find_minima(state: State) -> None:
    """Find the contacts that spheres can have with rough plates within the first step."""
    if not state.world.rough:
        return
    state.slots.Q[:, surface_contact.SEARCHED] = math.inf
    update_closest_points(state, update_accepted)
