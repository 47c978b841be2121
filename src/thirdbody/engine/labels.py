"""Labels of all bodies at a synchronised instant."""

from collections.abc import Callable

import numpy as np

from thirdbody.engine.state import Array, State
from thirdbody.jit.function_pointers import address
from thirdbody.jit.threads import distribute
from thirdbody.kernels.columns import loaded_contact, observed_body
from thirdbody.kernels.labeller_input import Observed
from thirdbody.kernels.signatures import LABEL, OBSERVE


def labels(state: State, drag: Array) -> Array:
    """Return one row per body: state, reason, margins and extras (columns named by the labeller).

    The labeller works on copies of its memory. `drag`: unit vector of the prescribed motion of the upper plate. Batches of an
    ensemble are distributed over the threads; bodies do not see each other, so the bits are the same for any number.
    """
    out, rows = np.zeros((state.n_bodies, state.physics.outputs)), state.slots.rows
    labeller = address(state.physics.observe, OBSERVE), address(state.physics.label, LABEL)

    def worker() -> Callable[[int], None]:
        tables = rows.scratch()

        def label(number: int) -> None:
            bodies, H, R = rows.batch(number, *tables)
            _label(labeller, _observed(state, drag, bodies, H, R), state, out[bodies])

        return label

    distribute(range(rows.number), worker)
    return out


def _observed(state: State, drag: Array, batch: slice, H: Array, R: Array) -> Observed:
    """Return the tables of the bodies of a batch; H, R: rows of its candidates."""
    slots, physics = state.slots, state.physics
    first, last, _ = batch.indices(state.n_bodies)
    bodies, low, high = slice(first, last), slots.edges[first], slots.edges[last]
    # in batches the candidates of a body are those with plates, which are sorted by body
    k = slice(low if first else 0, None)
    return Observed(
        slots.own[k], slots.partner[k], slots.edges[first : last + 1] - low, slots.incidence[low:high] - 2 * k.start,
        state.B[bodies], state.E[bodies], state.orientations[bodies], H, R, state.M[bodies].copy(), drag,
        len(physics.history), loaded_contact.MEMORY + physics.contact_memory,
    )  # fmt: skip


def _label(labeller: tuple[int, int], observed: Observed, state: State, out: Array) -> None:
    """Write the labels of the bodies of a batch."""
    from thirdbody.kernels.label_bodies import label_bodies

    table = np.empty((state.slots.max_per_body, observed.width))
    label_bodies(observed, state.A, *labeller, out, np.empty(observed_body.WIDTH), table)
