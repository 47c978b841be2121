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
from thirdbody.kernels import contact_zone as kernel
from thirdbody.kernels.tables import LOWER, UPPER, patch, record, run_totals, zone
from thirdbody.surfaces.surface import Surface
from thirdbody.surfaces.wear import worn_surfaces

if TYPE_CHECKING:
    from thirdbody.engine.state import Array, State
    from thirdbody.engine.upper_plate import Zone

FRACTION = 0.1
"""Largest depth that is taken at once, over the overlap of the contacts: N, as d^(3/2), and its effect on friction then change by
15 % at most before bodies give way. The overlap is the mean over the contacts with the plate by their load: that of a contact
that is about to open is as small as one likes, and it carries nothing."""

MAP = "wear_depth"  # name of the map that is taken
PLATES = {"lower": LOWER, "upper": UPPER}


class Wear:
    """Worn surfaces of a state, and what was taken from them.

    `volume` (2, 2, n_y, n_x) [m3]: of the cells of the maps of both plates, worn until the last update, and taken in all.
    `totals`: number of updates, and elastic energy that went with them [J]. `surfaces`: at the start; `now`: as they are worn.
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
        self._widen_contact()
        integrator.evaluate()
        update_measures(state)
        self.totals += 1.0, before - self._contents()

    def restore(self) -> None:
        """Let the height fields, and the contact of a worn ball, be those that follow from `volume`."""
        self._shape(worn_surfaces(self.surfaces, self.depth) if self.volume[1].any() else self.surfaces)
        if self.state.world.zone is not None:
            self.state.world.zone.row[:] = self._worn_zone(self.state.world.zone)

    def _shape(self, surfaces: dict[str, Surface]) -> None:
        state, self.now = self.state, surfaces
        for side, surface in surfaces.items():
            (state.lower_surface if side == "lower" else state.upper_surface)[:] = surface.packed
        set_guards(state)

    def series(self) -> dict[str, float]:
        """Return what a frame tells of the surfaces."""
        result, volumes = {}, self.volume[1].sum(axis=(1, 2))
        for side, surface in self.now.items():
            statistics = surface.statistics
            result[f"worn_volume_{side}"] = float(volumes[PLATES[side]])
            result |= {f"rms_height_{side}": statistics.rms_height, f"rms_slope_{side}": statistics.rms_slope}
        if self.state.world.zone is not None:
            result["contact_half_width"] = float(self.state.world.zone.row[zone.HALF_WIDTH])
        return result

    def _worn_zone(self, contact: Zone) -> Array:
        """Return the row of the contact of the first bodies. A ball that lost the volume V has a scar of the radius a_w, with V =
        pi a_w^4/(4 R) (Archard, a flat counter body); once that exceeds Hertz' radius the pressure is uniform in the scar."""
        row, volume = contact.row.copy(), float(self.volume[1, PLATES["upper"]].sum())
        scar = (4.0 * row[zone.RADIUS] * volume / math.pi) ** 0.25
        if row[zone.KIND] in (kernel.BALL, kernel.WORN_BALL) and scar > contact.half_width:
            row[zone.KIND], row[zone.HALF_WIDTH] = kernel.WORN_BALL, scar
            row[zone.SCAR_PRESSURE] = 2.0 / 3.0 * (contact.half_width / scar) ** 2  # mean over largest pressure of Hertz: 2/3
        return row

    def _widen_contact(self) -> None:
        """Let loads follow a worn ball: bodies in the scar share its pressure, scaled down where they would carry more than the
        whole load; patches outside keep to the gap."""
        contact, P, size = self.state.world.zone, self.state.P, np.array(self.state.world.size)
        if contact is None or (row := self._worn_zone(contact))[zone.KIND] != kernel.WORN_BALL:
            return
        at = self.state.bodies.position[:, :2] - P[self.state.patch][:, patch.DISPLACEMENT2] - row[zone.CENTRE2]
        at -= size * np.rint(at / size)
        before, after = (np.array([kernel.gap.py_func(x, y, Z) for x, y in at]) for Z in (contact.row, row))
        parts = np.array([kernel.pressure.py_func(x, y, row) for x, y in at])
        P[self.state.patch, patch.HEIGHT] += np.where(parts > 0.0, 0.0, after - before)
        nominal = contact.nominal * min(1.0, contact.load / max(contact.nominal * parts.sum(), 1e-300))
        P[:, patch.NOMINAL_LOAD], P[self.state.patch, patch.LOAD] = nominal, nominal * parts
        contact.row[:] = row

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
            if deepest > FRACTION * usual:
                j, i = np.unravel_index(int(depth.argmax()), depth.shape)
                x, y = i * surface.spacing[0], j * surface.spacing[1]
                fitting = _rounded_down(self.times * FRACTION * usual / deepest)
                raise GuardStop(
                    f"stopped at t = {self.state.time:.6g} s: wear would take {deepest:.3g} m from the {side} plate at "
                    f"({x:.4g}, {y:.4g}) m of it at once, {deepest / usual:.2g} of the overlap of its contacts, {usual:.3g} m in "
                    f"the mean by load (guard: {FRACTION:g}); plates.wear.times = {fitting:g} would do, or more frequent updates"
                )


def _rounded_down(number: float) -> float:
    """Return a positive number rounded down to two digits."""
    power = 10.0 ** (math.floor(math.log10(number)) - 1)
    return math.floor(number / power) * power
