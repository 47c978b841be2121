"""Labels of all bodies at a synchronised instant."""

from typing import Any

import numpy as np

from thirdbody.engine.candidates import AllRows, Numbers
from thirdbody.engine.state import Array, State
from thirdbody.jit.arguments import Packer, address
from thirdbody.jit.threads import distribute
from thirdbody.kernels.arguments import LABEL, OBSERVE, OBSERVED, Observed
from thirdbody.kernels.labels import label_bodies
from thirdbody.kernels.tables import loaded_contact, observed_body


def labels(state: State, drag: Array) -> Array:
    """Return one row per body: state, reason, margins and extras (columns named by the labeller).

    The labeller works on copies of its memory. `drag`: unit vector of the prescribed motion of the upper plate. Batches of an
    ensemble are distributed over the threads; bodies do not see each other, so the bits are the same for any number.
    """
    out, slots, physics = np.zeros((state.n_bodies, state.physics.outputs)), state.slots, state.physics
    rows, labeller = slots.rows, (address(physics.observe, OBSERVE), address(physics.label, LABEL))

    def label(bodies: slice, candidates: tuple[Numbers, ...], H: Array, R: Array) -> None:
        """Label a batch of bodies. `candidates`: own, partner, edges and incidence; H, R: their rows."""
        observed: Any = Observed(  # type: ignore[call-arg]
            *candidates, state.B[bodies], state.E[bodies], state.orientations[bodies], H, R, state.M[bodies].copy(), drag,
            len(physics.history), loaded_contact.MEMORY + physics.contact_memory,
        )  # fmt: skip
        table = np.empty((int(np.diff(observed.edges).max(initial=0)), observed.width))
        label_bodies(Packer(OBSERVED)(observed), state.A, *labeller, out[bodies], np.empty(observed_body.WIDTH), table)

    if isinstance(rows, AllRows):
        label(slice(None), (slots.own, slots.partner, slots.edges, slots.incidence), rows.H, rows.R)
        return out

    def label_batch(number: int) -> None:
        bodies, batch = slice(number * rows.size, (number + 1) * rows.size), rows.compact[number]
        edges, n = slots.edges[bodies.start : bodies.stop + 1], len(batch.on)
        closed = batch.on + edges[0]
        own_edges = np.searchsorted(closed, edges).astype(np.int32)
        candidates = slots.own[closed], slots.partner[closed], own_edges, 2 * np.arange(n, dtype=np.int32)
        label(bodies, candidates, batch.H[:n], batch.R[:n])

    distribute(range(len(rows.compact)), lambda: label_batch)
    return out
