"""Measures of a run, what contacts did, collected per body and over the surfaces of the plates; and labels of all bodies.

Contacts sum what they do in columns behind their history. `collect` adds the sums to the bodies and deposits them on the plates,
in the order of the candidates: the same bits for any number of threads. Explicit runs collect every `BUDGET` steps, at searches
and at outputs; implicit ones, whose steps are long, after each step if there are maps.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from thirdbody.engine.candidates import AllRows, Numbers
from thirdbody.engine.state import Array, State
from thirdbody.engine.upper_plate import Zone
from thirdbody.jit.arguments import Packer, address
from thirdbody.jit.threads import distribute
from thirdbody.kernels.arguments import LABEL, OBSERVE, OBSERVED, Observed
from thirdbody.kernels.labels import label_bodies
from thirdbody.kernels.measures import AMOUNTS, Collection, collect, deposit
from thirdbody.kernels.tables import loaded_contact, observed_body, patch
from thirdbody.laws.measures import MEAN


def collect_measures(state: State) -> Array:
    """Add what contacts have measured since the last call to the bodies; return the deposits on the plates, one per row."""
    measures, slots = state.physics.measures, state.slots
    if measures is None:
        return np.zeros((0, 0))
    layout = measures.layout
    deposits = np.zeros((slots.n_plates if measures.mapped else 0, AMOUNTS + len(layout.maps)))
    n = collect(Collection(
        slots.own, slots.partner, state.body, state.S, state.P, slots.Q, slots.H, state.W, layout.targets, layout.sums, deposits
    ))  # fmt: skip
    return deposits[:n].copy()


def deposit_on_maps(state: State, deposits: Array) -> None:
    if len(deposits):
        deposit(np.ascontiguousarray(deposits), state.maps, np.array(state.world.size, float))


def update_measures(state: State) -> None:
    deposit_on_maps(state, collect_measures(state))


def reset_means(state: State) -> None:
    """Let means over time begin now: what was measured before is left out."""
    measures = state.physics.measures
    if measures is not None:
        update_measures(state)
        layout = measures.layout
        means = [k for k, column in enumerate(layout.bodies) if column.kind == MEAN or k == layout.time]
        state.W[:, means] = 0.0


def body_amounts(state: State) -> dict[str, Array]:
    """Return what each body has of the measures, by name (n_bodies,): means are divided by the time of contact, 0 without any."""
    measures = state.physics.measures
    if measures is None:
        return {}
    layout, W = measures.layout, state.W
    result = {column.name: W[:, k].copy() for k, column in enumerate(layout.bodies)}
    for column in layout.bodies:
        if column.kind == MEAN:
            values, time = result[column.name], W[:, layout.time]
            result[column.name] = np.divide(values, time, out=np.zeros_like(values), where=time > 0.0)
    return result


def contact_maxima(state: State, contacts: Array) -> dict[str, Array]:
    """Return the maxima of some contacts (indices of candidates) since they closed, by name."""
    measures = state.physics.measures
    if measures is None:
        return {}
    layout, H = measures.layout, state.slots.H
    first = H.shape[1] - len(layout.maxima)
    return {name: H[contacts, first + k] for k, (name, _, _) in enumerate(layout.maxima)}


def map_densities(state: State) -> dict[str, Array]:
    """Return the maps by name (2, n_y, n_x): lower and upper plate, amounts per area of a cell."""
    measures = state.physics.measures
    if measures is None or not measures.mapped:
        return {}
    (l_x, l_y), (n_x, n_y) = state.world.size, measures.cells
    area = l_x / n_x * l_y / n_y
    return {entry.name: state.maps[k] / area for k, entry in enumerate(measures.layout.maps)}


# -- labels --


def labels(state: State, drag: Array) -> Array:
    """Return one row per body: state, reason, margins and extras (columns named by the labeller). The labeller works on copies of
    its memory. `drag`: unit vector of the prescribed motion of the upper plate. Batches of an ensemble are distributed over the
    threads; bodies do not see each other, so the bits are the same for any number."""
    out, slots, physics = np.zeros((state.n_bodies, state.physics.outputs)), state.slots, state.physics
    rows, labeller = slots.rows, (address(physics.observe, OBSERVE), address(physics.label, LABEL))

    def label(bodies: slice, candidates: tuple[Numbers, ...], H: Array, R: Array) -> None:
        observed: Any = Observed(  # type: ignore[call-arg]
            *candidates, state.B[bodies], state.E[bodies], state.orientations[bodies], H, R, state.M[bodies].copy(), drag,
            len(physics.history), loaded_contact.MEMORY + physics.contact_memory,
        )  # fmt: skip
        table = np.empty((int(np.diff(observed.edges).max(initial=0)), observed.width))
        label_bodies(Packer(OBSERVED)(observed), state.A, *labeller, out[bodies], np.empty(observed_body.WIDTH), table)

    if isinstance(rows, AllRows):
        label(slice(None), (slots.own, slots.partner, slots.edges, slots.incidence), rows.H, rows.R)
        return with_ejected(out, state)

    def label_batch(number: int) -> None:
        bodies, batch = slice(number * rows.size, (number + 1) * rows.size), rows.compact[number]
        edges, n = slots.edges[bodies.start : bodies.stop + 1], len(batch.on)
        closed = batch.on + edges[0]
        own_edges = np.searchsorted(closed, edges).astype(np.int32)
        candidates = slots.own[closed], slots.partner[closed], own_edges, 2 * np.arange(n, dtype=np.int32)
        label(bodies, candidates, batch.H[:n], batch.R[:n])

    distribute(range(len(rows.compact)), lambda: label_batch)
    return with_ejected(out, state)


def with_ejected(out: Array, state: State) -> Array:
    """Return the labels, in which bodies that have left the contact of the first bodies are out."""
    if state.world.zone is not None:
        out[ejected(state, state.world.zone), :2] = state.world.zone.out
    return out


def exits(state: State, zone: Zone) -> Array:
    """Return where bodies that are out left the contact (n, 3): x and y under the upper body, from the middle of the contact, and
    the path of the upper plate at which they did [m]; NaN for all others."""
    P = state.P[state.patch]
    values = np.column_stack([P[:, patch.EDGE2], state.distance - P[:, patch.OUTSIDE_PATH]])
    values[~(ejected(state, zone) & np.isfinite(values[:, 0]))] = np.nan
    return values


def ejected(state: State, zone: Zone) -> NDArray[np.bool_]:
    """Return which bodies have left the contact of the first bodies, (n,)."""
    P = state.P[state.patch]
    return (P[:, patch.INSIDE] < 0.0) | (P[:, patch.OUTSIDE_PATH] >= zone.out_after)
