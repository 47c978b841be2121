"""Labels of all bodies at a synchronised instant."""

from concurrent.futures import ThreadPoolExecutor

import numba
import numpy as np

from thirdbody.engine.state import Array, State
from thirdbody.kernels.columns import loaded_contact, observed_body


def labels(state: State, drag: Array) -> Array:
    """Return one row per body: state, reason, margins and extras (columns named by the labeller).

    The labeller works on copies of its memory. `drag`: unit vector of the prescribed motion of the upper plate. Batches of an
    ensemble are distributed over the threads; bodies do not see each other, so the bits are the same for any number.
    """
    out, number = np.zeros((state.n_bodies, state.physics.outputs)), state.slots.rows.number
    parts = min(numba.get_num_threads(), number)
    edges = [number * k // parts for k in range(parts + 1)]
    if parts == 1:
        _label(state, drag, out, 0, number)
        return out
    with ThreadPoolExecutor(parts) as pool:
        list(pool.map(lambda first, last: _label(state, drag, out, first, last), edges[:-1], edges[1:]))
    return out


def _label(state: State, drag: Array, out: Array, begin: int, end: int) -> None:
    """Write the labels of the bodies of some batches."""
    from thirdbody.kernels.label_bodies import label_bodies
    from thirdbody.kernels.labeller_input import Observed

    slots, physics = state.slots, state.physics
    width = loaded_contact.MEMORY + physics.contact_memory
    scratch = np.empty(observed_body.WIDTH), np.empty((slots.max_per_body, width))
    for first, last, H, R in slots.rows.batches(state.n_bodies, begin, end):
        bodies, low, high = slice(first, last), slots.edges[first], slots.edges[last]
        # in batches the candidates of a body are those with plates, which are sorted by body
        k = slice(low if first else 0, None)
        observed = Observed(
            slots.own[k], slots.partner[k], slots.edges[first : last + 1] - low, slots.incidence[low:high] - 2 * k.start,
            state.B[bodies], state.E[bodies], state.orientations[bodies], H, R, state.M[bodies].copy(), drag,
            len(physics.history), width,
        )  # fmt: skip
        label_bodies(observed, state.A, physics.observe, physics.label, out[bodies], *scratch)
