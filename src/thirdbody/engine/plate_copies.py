"""Copies of a plate: bodies of an implicit run are at different times, so each has its own."""

import numpy as np

from thirdbody.engine.state import State
from thirdbody.kernels.tables import patch


def own_patches(state: State) -> None:
    """Give each body a copy of a plate of prescribed height, since bodies are at different times."""
    if state.world.upper is not None and len(state.P) == 1 and state.patches.free[0] == 0.0:
        state.P = np.repeat(state.P, state.n_bodies, axis=0)
        state.patch = np.arange(state.n_bodies)


def one_plate(state: State) -> None:
    """Move a rigid plate to the last row of the patches and give every body a copy that follows it."""
    if len(state.P) > 1 or state.world.upper is None or state.world.upper.foundation is not None:
        return
    copies = np.repeat(state.P, state.n_bodies, axis=0)
    for column in (patch.FREE, patch.MASS, patch.DAMPING, patch.LOAD, patch.NOMINAL_LOAD, patch.DIRECT_PREFACTOR):
        copies[:, column] = 0.0
    state.P = np.concatenate([copies, state.P])
    state.patch = np.arange(state.n_bodies)
