"""Labels of all bodies at a synchronised instant."""

import numpy as np

from thirdbody.engine.state import Array, State
from thirdbody.kernels.columns import loaded_contact, observed_body


def labels(state: State, drag: Array) -> Array:
    """Return one row per body: state, reason, margins and extras (columns named by the labeller).

    The labeller works on copies of its memory. `drag`: unit vector of the prescribed motion of the upper plate.
    """
    from thirdbody.kernels.label_bodies import label_bodies
    from thirdbody.kernels.labeller_input import Observed

    slots, physics = state.slots, state.physics
    out = np.zeros((state.n_bodies, physics.outputs))
    width = loaded_contact.MEMORY + physics.contact_memory
    observed = Observed(
        slots.own, slots.partner, slots.edges, slots.incidence, state.B, state.E, state.orientations,
        slots.H, slots.R, state.M.copy(), drag, len(physics.history), width,
    )  # fmt: skip
    scratch = np.empty(observed_body.WIDTH), np.empty((slots.max_per_body, width))
    label_bodies(observed, state.A, physics.observe, physics.label, out, *scratch)
    return out
