"""Labels of all bodies at a synchronised instant."""

import numpy as np

from thirdbody.engine.state import Array, State
from thirdbody.kernels.columns import loaded_contact, observed_body, run_totals


def labels(state: State, drag: tuple[float, float]) -> Array:
    """Return one row per body: state, reason, margins and extras (columns named by the labeller).

    The labeller works on copies of its memory. `drag`: unit vector of the prescribed motion of the upper plate.
    """
    from thirdbody.kernels.label_bodies import label_bodies

    slots, physics = state.slots, state.physics
    out = np.zeros((state.n_bodies, physics.outputs))
    width = loaded_contact.MEMORY + physics.contact_memory
    label_bodies(
        slots.edges, slots.incidence, slots.own, slots.partner, slots.H, slots.R, state.B, state.E, state.A, state.M.copy(),
        drag, float(state.A[run_totals.PLATE_SPEED]), len(physics.history), width, physics.observe, physics.label, out,
        np.empty(observed_body.WIDTH), np.empty((slots.most, width)),
    )  # fmt: skip
    return out
