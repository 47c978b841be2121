"""Wear that acts back: depth that a measure has mapped is taken from the height fields of the plates, and the run goes on.

Contacts keep their histories and bodies their places, so overlaps shrink by the worn depth; the elastic energy that goes with it
has a line of its own in the ledger.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from thirdbody.engine.guards import set_guards, stored_energies
from thirdbody.engine.measures import update_measures
from thirdbody.errors import GuardStop
from thirdbody.kernels.tables import LOWER, UPPER, record, run_totals
from thirdbody.surfaces.statistics import surface_statistics
from thirdbody.surfaces.surface import Surface
from thirdbody.surfaces.wear import worn_surfaces

if TYPE_CHECKING:
    from thirdbody.engine.state import Array, State

SHARE = 0.1
"""Largest depth that is taken at once, over the overlap of the contacts: N, as d^(3/2), and its effect on friction then change by
15 % at most before bodies give way. The overlap is the mean over the contacts with the plate by their load: that of a contact
that is about to open is as small as one likes, and it carries nothing."""

MAP = "wear_depth"  # name of the map that is taken
PLATES = {"lower": LOWER, "upper": UPPER}


class Wear:
    """Worn surfaces of a state, and what was taken from them.

    `volume` (2, 2, n_y, n_x) [m3]: of the cells of the maps of both plates, worn until the last update, and taken in all; `totals`:
    number of updates, and elastic energy that went with them [J]. `surfaces`: those at the start; `now`: as they are worn.
    """

    def __init__(self, state: State, surfaces: dict[str, Surface], times: float) -> None:
        assert state.physics.measures is not None
        self.state, self.surfaces, self.now, self.times = state, surfaces, surfaces, times
        self.map = [entry.name for entry in state.physics.measures.layout.maps].index(MAP)
        self.volume, self.totals = np.zeros((2, *state.maps.shape[1:])), np.zeros(2)
        n_y, n_x = state.maps.shape[2:]
        self.area = state.world.size[0] / n_x * state.world.size[1] / n_y

    @property
    def depth(self) -> Array:
        """Depth taken from both plates in all (2, n_y, n_x) [m], on the cells of the maps."""
        return self.volume[1] / self.area

    @property
    def energy(self) -> float:
        """Elastic energy [J] of contacts that went with the worn depth."""
        return float(self.totals[1])

    def begin(self) -> None:
        """Leave out what was worn before now."""
        self.volume[0] = self.state.maps[self.map]

    def take(self, integrator: Any) -> None:
        """Take what was worn since the last update, `times` as much, from both surfaces. Raises GuardStop, with all unchanged, if
        that is too much at once."""
        state = self.state
        update_measures(state)
        worn = self.times * (state.maps[self.map] - self.volume[0])
        after = worn_surfaces(self.surfaces, (self.volume[1] + worn) / self.area)
        self._refuse_too_much(after)
        before = self._contents()
        self.volume[0], self.volume[1] = state.maps[self.map], self.volume[1] + worn
        self._shape(after)
        integrator.evaluate()
        update_measures(state)
        self.totals += 1.0, before - self._contents()

    def restore(self) -> None:
        """Let the height fields be those that follow from `volume`."""
        self._shape(worn_surfaces(self.surfaces, self.depth) if self.volume[1].any() else self.surfaces)

    def _shape(self, surfaces: dict[str, Surface]) -> None:
        state, self.now = self.state, surfaces
        for side, surface in surfaces.items():
            (state.lower_surface if side == "lower" else state.upper_surface)[:] = surface.packed
        set_guards(state)

    def series(self) -> dict[str, float]:
        """Return what a frame tells of the surfaces."""
        result, taken = {}, self.volume[1].sum(axis=(1, 2))
        for side, surface in self.now.items():
            statistics = surface.statistics
            result[f"worn_volume_{side}"] = float(taken[0 if side == "lower" else 1])
            result |= {f"rms_height_{side}": statistics.rms_height, f"rms_slope_{side}": statistics.rms_slope}
        return result

    def _contents(self) -> float:
        """Return elastic energy of contacts, and what they have dissipated [J]."""
        _, normal, tangential, *_ = stored_energies(self.state)
        return normal + tangential + float(self.state.A[run_totals.FRICTION_WORK] + self.state.A[run_totals.DAMPING_WORK])

    def _refuse_too_much(self, after: dict[str, Surface]) -> None:
        slots = self.state.slots
        closed = slots.rows.closed()
        force, overlap = slots.rows.records(closed, record.NORMAL_FORCE, record.OVERLAP)
        for side, surface in after.items():
            depth, here = self.now[side].heights - surface.heights, slots.sides[closed] == PLATES[side]
            load = np.maximum(force[here], 0.0)
            if not load.any():
                continue
            usual, deepest = float(load @ overlap[here] / load.sum()), float(depth.max())
            if deepest > SHARE * usual:
                j, i = np.unravel_index(int(depth.argmax()), depth.shape)
                x, y = i * surface.spacing[0], j * surface.spacing[1]
                fitting = _rounded_down(self.times * SHARE * usual / deepest)
                raise GuardStop(
                    f"stopped at t = {self.state.time:.6g} s: wear would take {deepest:.3g} m from the {side} plate at "
                    f"({x:.4g}, {y:.4g}) m of it at once, {deepest / usual:.2g} of the overlap {usual:.3g} m of its contacts, a mean by "
                    f"load (guard: {SHARE:g}); plates.wear.times = {fitting:g} would do, or more frequent updates"
                )


def _rounded_down(number: float) -> float:
    """Return a positive number rounded down to two digits."""
    power = 10.0 ** (math.floor(math.log10(number)) - 1)
    return math.floor(number / power) * power
