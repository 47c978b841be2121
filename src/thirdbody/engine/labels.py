"""Labels of all bodies at a synchronised instant."""

from collections.abc import Callable
from typing import Any

import numpy as np

from thirdbody.engine.candidates import Candidates, Numbers
from thirdbody.engine.contact_rows import AllRows
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
    out, rows = np.zeros((state.n_bodies, state.physics.outputs)), state.slots.rows
    labeller = address(state.physics.observe, OBSERVE), address(state.physics.label, LABEL)
    if isinstance(rows, AllRows):
        slots = state.slots
        candidates = slots.own, slots.partner, slots.edges, slots.incidence
        _label(labeller, _observed(state, drag, slice(None), candidates, (rows.H, rows.R)), state.A, out)
        return out

    def worker() -> Callable[[int], None]:
        def label(number: int) -> None:
            bodies = slice(number * rows.size, (number + 1) * rows.size)
            closed = rows.compact[number]
            n, candidates = len(closed.on), _closed_candidates(state.slots, closed.on, bodies)
            _label(labeller, _observed(state, drag, bodies, candidates, (closed.H[:n], closed.R[:n])), state.A, out[bodies])

        return label

    distribute(range(rows.number), worker)
    return out


def _closed_candidates(slots: Candidates, on: Numbers, bodies: slice) -> tuple[Numbers, ...]:
    """Return own, partner, edges and incidence of the closed candidates of a batch; `on`: counted from its first candidate."""
    edges = slots.edges[bodies.start : bodies.stop + 1]
    closed = on + edges[0]
    return (
        slots.own[closed], slots.partner[closed], np.searchsorted(closed, edges).astype(np.int32),
        2 * np.arange(len(on), dtype=np.int32),
    )  # fmt: skip


def _observed(state: State, drag: Array, bodies: slice, candidates: tuple[Numbers, ...], rows: tuple[Array, Array]) -> Any:
    """Return the tables of the bodies of a batch; `candidates`: own, partner, edges and incidence; `rows`: their H and R."""
    (own, partner, edges, incidence), (H, R), physics = candidates, rows, state.physics
    return Observed(  # type: ignore[call-arg]
        own, partner, edges, incidence, state.B[bodies], state.E[bodies], state.orientations[bodies], H, R,
        state.M[bodies].copy(), drag, len(physics.history), loaded_contact.MEMORY + physics.contact_memory,
    )  # fmt: skip


def _label(labeller: tuple[int, int], observed: Any, totals: Array, out: Array) -> None:
    """Write the labels of the bodies of a batch; `totals`: of the run."""
    table = np.empty((int(np.diff(observed.edges).max(initial=0)), observed.width))
    label_bodies(Packer(OBSERVED)(observed), totals, *labeller, out, np.empty(observed_body.WIDTH), table)
