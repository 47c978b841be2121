"""Export and restore the state of a run between two compiled calls, as plain arrays and numbers.

Data that follow from the scene (shapes, laws, schedules) are not stored: the run is built from its scene, then restored.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from thirdbody.engine.candidates import Candidates, ClosedRows
from thirdbody.engine.guards import Ledger
from thirdbody.engine.neighbours import slots_of
from thirdbody.engine.state import Array, State
from thirdbody.kernels.plates import BASINS

FIXED = ("S", "B", "E", "orientations", "P", "A", "M", "X0")
"""Tables of a state whose shape follows from the scene; without S where it is the same array as B, or not kept."""

SLOTS = ("own", "partner", "Q", "H", "R")  # arrays that define the candidates: pairs, closest points, histories and records
CLOSED = "slots_closed"  # numbers of the closed candidates, where only these have histories and records; without it all have


@dataclass
class Snapshot:
    """Arrays by name, notes that can be written as JSON, and `pieces` (one or more) that make up further arrays."""

    arrays: dict[str, np.ndarray] = field(default_factory=dict)
    notes: dict[str, Any] = field(default_factory=dict)
    pieces: dict[str, list[np.ndarray]] = field(default_factory=dict)


def snapshot(state: State, integrator: Any, ledger: Ledger) -> Snapshot:
    """Return all variable data of a run, without copies: write them before the run continues. Between two stops of an implicit
    run with contact between bodies they are those of an earlier instant (`Implicit.earlier`)."""
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


def restore(captured: Snapshot, state: State, integrator: Any, ledger: Ledger) -> None:
    """Restore a snapshot into a new run. Raises ValueError, with the run unchanged, on mismatch."""
    captured = Snapshot(captured.arrays | {k: np.concatenate(parts) for k, parts in captured.pieces.items()}, captured.notes)
    own, fixed, notes = integrator.export_state()[0], _fixed(state), captured.notes
    check(captured.arrays, fixed | {f"integrator_{name}": array for name, array in own.items()})
    _refuse_other_pairs(captured, state)
    slots = _slots(captured, state)
    state.dt, state.searches = float(notes["dt"]), int(notes["searches"])
    for name, array in fixed.items():
        array[:] = captured.arrays[name]
    if state.wear:
        state.wear.restore()
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


def _refuse_other_pairs(captured: Snapshot, state: State) -> None:
    """Raise ValueError for pairs that this scene has not: compiled code would read and write past the ends of tables."""
    arrays, plates, dtype = captured.arrays, int(captured.notes["plates"]), state.slots.own.dtype
    own, partner = arrays["slots_own"], arrays["slots_partner"]
    check(arrays, dict.fromkeys(("slots_own", "slots_partner"), np.empty(own.size, dtype)) | {"B": state.B})
    if not 0 <= plates <= len(own):
        raise ValueError(f"notes: plates is {plates}, expected 0 to {len(own)}")
    of_plate = np.arange(len(own)) < plates
    low, high = np.where(of_plate, -BASINS * (1 + len(state.P)), 0), np.where(of_plate, -1, state.n_spheres - 1)
    if np.any((own < 0) | (own >= state.n_spheres)) or any(np.any(np.diff(own[part]) < 0) for part in (of_plate, ~of_plate)):
        raise ValueError("slots_own holds no sorted owners of pairs of this scene")
    if np.any((partner < low) | (partner > high)):
        raise ValueError("slots_partner holds no partners of this scene")
    if not np.isfinite(arrays["B"]).all():
        raise ValueError("B holds numbers that are not finite")


def _fixed(state: State) -> dict[str, Array]:
    measured = {"W": state.W, "maps": state.maps} if state.physics.measures else {}
    measured |= {"drive": state.drive} if state.sprung else {}
    own_table = state.sphere_table is not None and state.sphere_table is not state.B
    measured |= {"wear": state.wear.volume, "wear_totals": state.wear.totals} if state.wear else {}
    return {name: getattr(state, name) for name in FIXED if name != "S" or own_table} | measured


def _slots(captured: Snapshot, state: State) -> Candidates:
    """Return the candidates of a snapshot; where only closed ones have rows, the pairs are those of the built scene. Raises
    KeyError or ValueError."""
    slots, arrays, rows = state.slots, captured.arrays, state.slots.rows
    if isinstance(rows, ClosedRows):
        closed, H, R = (arrays[name] for name in (CLOSED, "slots_H", "slots_R"))
        wanted = {CLOSED: np.empty(closed.size, np.int64)} | {
            f"slots_{name}": np.empty((len(closed), width)) for name, width in zip("HR", rows.widths, strict=True)
        }
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
