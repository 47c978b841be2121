"""Measures of a run: what contacts did, collected per body and over the surfaces of the plates.

Contacts sum what they do in columns behind their history, each by itself, so that threads share nothing. `collect` then adds the
sums to the bodies and deposits them on the plates, in the order of the candidates: the same bits for any number of threads. A
deposit lies where the contact is at that time. Explicit runs collect every `BUDGET` steps, at searches and at outputs; implicit
ones, whose steps are long, after each step if there are maps.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from thirdbody.engine.candidates import Array
from thirdbody.kernels.measures import AMOUNTS, Collection, collect, deposit
from thirdbody.laws.measures import MEAN, Layout

if TYPE_CHECKING:
    from thirdbody.engine.state import State


@dataclass(frozen=True)
class Measures:
    """Measures of a scene: the compiled function, its parameters (one row per pair), and where numbers are kept.

    `cells`: number of cells of the maps along x and y; 0: no maps.
    """

    function: Callable
    parameters: Array
    layout: Layout
    cells: tuple[int, int]

    @property
    def mapped(self) -> bool:
        return bool(self.layout.maps) and self.cells[0] > 0

    def tables(self, bodies: int) -> tuple[Array, Array]:
        """Return at the start: W (bodies, `Layout.bodies`), what bodies have; `maps` (maps, 2 plates, n_y, n_x), on cells."""
        n_x, n_y = self.cells if self.mapped else (1, 1)
        return np.zeros((bodies, len(self.layout.bodies))), np.zeros((len(self.layout.maps) if self.mapped else 0, 2, n_y, n_x))


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
    """Add deposits to the maps, in their order."""
    if len(deposits):
        deposit(np.ascontiguousarray(deposits), state.maps, np.array(state.world.size, float))


def update_measures(state: State) -> None:
    """Collect what contacts have measured, and deposit it."""
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
