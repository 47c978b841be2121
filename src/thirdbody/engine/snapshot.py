"""Export and restore the state of a run between two compiled calls, as plain arrays and numbers.

Data that follow from the scene (shapes, laws, schedules) are not stored: the run is built from its scene, then restored.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from thirdbody.engine.candidates import Candidates, ClosedRows
from thirdbody.engine.energy import Ledger
from thirdbody.engine.neighbours import slots_of
from thirdbody.engine.state import Array, State
from thirdbody.kernels.implicit.control import StepLimit
from thirdbody.kernels.implicit.tables import step_memory
from thirdbody.kernels.plates import BASINS

if TYPE_CHECKING:
    from thirdbody.engine.explicit import Explicit
    from thirdbody.engine.implicit import Implicit

FIXED = ("S", "B", "E", "orientations", "P", "A", "M", "X0")
"""Tables of a state whose shape follows from the scene; without S where it is the same array as B, or not kept."""

SLOTS = ("own", "partner", "Q", "H", "R")
"""Arrays that define the candidates: pairs, closest points, histories and records."""

CLOSED = "slots_closed"
"""Numbers of the closed candidates, where only these have histories and records; without it all have."""


@dataclass
class Snapshot:
    """Arrays by name, notes that can be written as JSON, and `pieces` (one or more) that make up further arrays."""

    arrays: dict[str, np.ndarray] = field(default_factory=dict)
    notes: dict[str, Any] = field(default_factory=dict)
    pieces: dict[str, list[np.ndarray]] = field(default_factory=dict)


def snapshot(state: State, integrator: Explicit | Implicit, ledger: Ledger) -> Snapshot:
    """Return all variable data of a run, without copies: write them before the run continues.

    Between two stops of an implicit run with contact between bodies they are those of an earlier instant (`Implicit.earlier`).
    """
    slots, pieces = state.slots, {}
    arrays: dict[str, np.ndarray] = dict(_fixed(state))
    if isinstance(slots.rows, ClosedRows):
        arrays |= {CLOSED: slots.rows.closed(), "slots_own": slots.own, "slots_partner": slots.partner, "slots_Q": slots.Q}
        pieces = dict(zip(("slots_H", "slots_R"), slots.rows.pieces(), strict=True))
    else:
        arrays |= {f"slots_{name}": getattr(slots, name) for name in SLOTS}
    saved, notes = integrator.export_state()
    arrays |= {f"integrator_{name}": array for name, array in saved.items()}
    arrays |= {name: array for name, array in getattr(integrator, "earlier", {}).items() if name in arrays}
    return Snapshot(arrays, {
        "dt": state.dt, "searches": state.searches, "plates": slots.n_plates, "integrator": notes,
        "energy_start": ledger.start, "energy_peak": ledger.peak,
    }, pieces)  # fmt: skip


def restore(captured: Snapshot, state: State, integrator: Explicit | Implicit, ledger: Ledger) -> None:
    """Restore a snapshot into a new run. Raises ValueError, with the run unchanged, on mismatch."""
    captured = Snapshot(captured.arrays | {k: np.concatenate(parts) for k, parts in captured.pieces.items()}, captured.notes)
    own, fixed, notes = integrator.export_state()[0], _fixed(state), captured.notes
    check(captured.arrays, fixed | {f"integrator_{name}": array for name, array in own.items()})
    _refuse_ranges(captured, state)
    slots = _slots(captured, state)
    state.dt, state.searches = float(notes["dt"]), int(notes["searches"])
    for name, array in fixed.items():
        array[:] = captured.arrays[name]
    state.slots = slots
    integrator.restore({name: captured.arrays[f"integrator_{name}"] for name in own}, notes["integrator"])
    ledger.start, ledger.peak = float(notes["energy_start"]), float(notes["energy_peak"])


def check(arrays: Mapping[str, np.ndarray], wanted: Mapping[str, np.ndarray]) -> None:
    """Raise ValueError unless all wanted arrays exist with their shapes and types."""
    for name, array in wanted.items():
        if name not in arrays:
            raise ValueError(f"{name} is missing")
        result = arrays[name]
        if result.shape != array.shape or result.dtype != array.dtype:
            raise ValueError(f"{name} holds {result.dtype} {result.shape}, expected {array.dtype} {array.shape}")


def _refuse_ranges(captured: Snapshot, state: State) -> None:
    """Raise ValueError for numbers that compiled code would use as indices, or as places, and that lie outside their range.

    A file with a right checksum may be a forged one. Histories of laws are not known here.
    """
    arrays, slots, plates = captured.arrays, state.slots, int(captured.notes["plates"])
    own, partner, highest = arrays["slots_own"], arrays["slots_partner"], state.n_spheres - 1
    check(arrays, dict.fromkeys(("slots_own", "slots_partner"), np.empty(own.size, slots.own.dtype)))
    if not 0 <= plates <= len(own):
        raise ValueError(f"notes: plates is {plates}, expected 0 to {len(own)}")
    _within("slots_own", own, 0, highest)
    _within("slots_partner", partner[:plates], -BASINS * (1 + len(state.P)), -1)
    _within("slots_partner", partner[plates:], 0, highest)
    for part in (slice(plates), slice(plates, None)):  # kernels search by owner
        _within("slots_own", np.diff(own[part]), 0, highest, "differences of successive owners")
    rough = np.where(partner[:plates] < -BASINS, len(state.upper_surface), len(state.lower_surface)) > 0
    basins = (-1 - partner[:plates])[rough] % BASINS
    if len(basins) % BASINS or np.any(basins != np.arange(len(basins)) % BASINS):
        raise ValueError(f"slots_partner: a sphere has {BASINS} rows with a rough plate, one after the other")
    if math.isinf(state.skin):  # pairs with plates are those of the whole run
        check({"slots_own": own[:plates]}, {"slots_own": slots.own[: slots.n_plates]})
        if np.any(own[:plates] != slots.own[:plates]) or np.any(partner[:plates] != slots.partner[:plates]):
            raise ValueError("slots_own, slots_partner: pairs with the plates are not those of the scene")
    for name in ("B", "orientations", "X0"):
        if not np.isfinite(arrays[name]).all():
            raise ValueError(f"{name} holds numbers that are not finite")
    if CLOSED in arrays:
        check(arrays, {CLOSED: np.empty(arrays[CLOSED].size, np.int64)})
        _within(CLOSED, arrays[CLOSED], 0, slots.count - 1)
        _within(CLOSED, np.diff(arrays[CLOSED]), 1, slots.count, "differences of successive numbers")
    if (memory := arrays.get("integrator_memory")) is not None:
        candidates = np.bincount(state.body[own[:plates]], minlength=state.n_bodies)
        _within("integrator_memory", memory[:, step_memory.CANDIDATES], 0, candidates, "candidates of body")
        _within("integrator_memory", memory[:, step_memory.LIMIT], 0, max(StepLimit), "limit of body")
        _within("integrator_memory", memory[:, step_memory.SLOT], -1, len(own) - 1, "slot of body")


def _within(name: str, values: np.ndarray, low: int, high: int | np.ndarray, what: str = "") -> None:
    """Raise ValueError for the first value outside a range."""
    outside = np.flatnonzero(~((values >= low) & (values <= high)))
    if len(outside):
        k = outside[0]
        highest = high if isinstance(high, int) else high[k]
        raise ValueError(f"{name}: {what or 'row'} {k} is {values[k]:g}, expected {low} to {highest}")


def _fixed(state: State) -> dict[str, Array]:
    measured = {"W": state.W, "maps": state.maps} if state.physics.measures else {}
    own_table = state.sphere_table is not None and state.sphere_table is not state.B
    return {name: getattr(state, name) for name in FIXED if name != "S" or own_table} | measured


def _slots(captured: Snapshot, state: State) -> Candidates:
    """Return the candidates of a snapshot; index tables that follow from the pairs are computed again.

    Where only closed ones have rows, the pairs are those of the built scene. Raises KeyError or ValueError.
    """
    slots, arrays, rows = state.slots, captured.arrays, state.slots.rows
    if isinstance(rows, ClosedRows):
        closed, H, R = (arrays[name] for name in (CLOSED, "slots_H", "slots_R"))
        wanted = {f"slots_{name}": np.empty((len(closed), width)) for name, width in zip("HR", rows.widths, strict=True)}
        check(arrays, {"slots_own": slots.own, "slots_partner": slots.partner} | wanted)
        return replace(slots, rows=ClosedRows.of(rows.edges, rows.size, closed, (H, R)))
    own, partner, Q, H, R = (arrays[f"slots_{name}"] for name in SLOTS)
    plates = int(captured.notes["plates"])
    counts = dict.fromkeys(SLOTS, len(own)) | {"Q": plates if state.world.rough else 0}
    present = {name: getattr(slots, name) for name in SLOTS}
    wanted = {f"slots_{name}": np.empty((counts[name], *each.shape[1:]), each.dtype) for name, each in present.items()}
    if not len(R):  # not needed, so not stored
        R = np.zeros_like(wanted["slots_R"])
    check(arrays | {"slots_R": R}, wanted)
    return slots_of(state, own, partner, plates, (Q, H, R))
