"""Export and restore the state of a run between two compiled calls, as plain arrays and numbers.

Data that follow from the scene (shapes, laws, schedules) are not stored: the run is built from its scene, then restored.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from thirdbody.engine.energy import Ledger
from thirdbody.engine.neighbours import slots_of
from thirdbody.engine.state import Array, Candidates, State
from thirdbody.kernels.columns import body, body_extra, patch, run_totals, sphere, step_memory

if TYPE_CHECKING:
    from thirdbody.engine.explicit import Explicit
    from thirdbody.engine.implicit import Implicit

FIXED = ("S", "B", "E", "P", "A", "M", "X0")
"""Tables of a state whose shape follows from the scene; without S where it is the same array as B."""

GIVEN = {
    "B": (sphere.RADIUS, body.MASS, body.SPHERE_INERTIA, sphere.SIDE),
    "E": (body_extra.REACH, body_extra.INERTIA, body_extra.INERTIA + 1, body_extra.INERTIA + 2),
    "S": (sphere.RADIUS, sphere.MASS, sphere.SIDE),
    "P": (patch.MASS, patch.DAMPING, patch.FREE, patch.SPRING, patch.NOMINAL_LOAD),
}
"""Columns set by the scene and constant in a run; sphere columns of B are zero where S is a separate table."""

LARGEST = 1e100
"""Upper bound of all numbers of a run in SI; larger ones, or NaN, would make compiled loops index out of bounds."""

SAME = 1e-9
"""Relative tolerance: other library versions may round the last digits of a mass differently."""

CLOCKS = {
    "A": (run_totals.TIME, run_totals.DISTANCE, run_totals.STEPS),
    "integrator_totals": (run_totals.TIME, run_totals.DISTANCE, run_totals.STEPS),
    "integrator_memory": (
        step_memory.CUTS,
        step_memory.HARD_STEPS,
        step_memory.TRIES,
        step_memory.ITERATIONS,
        *range(step_memory.LIMITED, step_memory.WIDTH),
    ),
}
"""Columns that only grow, from zero; beyond LAST they would stop growing, and a loop that waits for them would not end."""

LAST = 2.0**53
"""Largest float64 up to which integers are exact."""

SLOTS = ("own", "partner", "H", "R")
"""Arrays that define the candidates: pairs, histories and records."""


@dataclass
class Snapshot:
    """Arrays by name, and notes that can be written as JSON."""

    arrays: dict[str, np.ndarray] = field(default_factory=dict)
    notes: dict[str, Any] = field(default_factory=dict)


def snapshot(state: State, integrator: Explicit | Implicit, ledger: Ledger) -> Snapshot:
    """Return all variable data of a run, without copies: write them before the run continues."""
    slots = state.slots
    arrays = _fixed(state)
    arrays |= {f"slots_{name}": getattr(slots, name) for name in SLOTS}
    saved, notes = integrator.keep()
    arrays |= {f"integrator_{name}": array for name, array in saved.items()}
    return Snapshot(arrays, {
        "dt": state.dt, "searches": state.searches, "plates": slots.n_plates, "integrator": notes,
        "energy_start": ledger.start, "energy_peak": ledger.peak,
    })  # fmt: skip


def put(kept: Snapshot, state: State, integrator: Explicit | Implicit, ledger: Ledger) -> None:
    """Restore a snapshot into a new run. Raises ValueError, with the run unchanged, on mismatch."""
    own, remembered = integrator.keep()
    fixed = _fixed(state)
    check(kept.arrays, fixed | {f"integrator_{name}": array for name, array in own.items()})
    _refuse_others(kept.arrays, state)
    _refuse_clocks(kept.arrays)
    slots = _slots(kept, state)
    notes = kept.notes
    _refuse_unlike("integrator", notes["integrator"], remembered)
    state.dt, state.searches = float(notes["dt"]), int(notes["searches"])
    for name, array in fixed.items():
        array[:] = kept.arrays[name]
    state.slots = slots
    integrator.restore({name: kept.arrays[f"integrator_{name}"] for name in own}, notes["integrator"])
    ledger.start, ledger.peak = float(notes["energy_start"]), float(notes["energy_peak"])


def check(arrays: Mapping[str, np.ndarray], wanted: Mapping[str, np.ndarray]) -> None:
    """Raise ValueError unless all wanted arrays exist with their shapes and types."""
    for name, array in wanted.items():
        if name not in arrays:
            raise ValueError(f"{name} is missing")
        result = arrays[name]
        if result.shape != array.shape or result.dtype != array.dtype:
            raise ValueError(f"{name} holds {result.dtype} {result.shape}, expected {array.dtype} {array.shape}")


def _fixed(state: State) -> dict[str, Array]:
    """Return the tables `FIXED` by name."""
    return {name: getattr(state, name) for name in FIXED if name != "S" or state.S is not state.B}


def _refuse_others(arrays: Mapping[str, np.ndarray], state: State) -> None:
    """Raise ValueError unless bodies and plates are those of the scene; a zero mass gives infinite forces."""
    fixed = _fixed(state)
    for name, columns in GIVEN.items():
        for column in columns if name in fixed else ():
            if not np.allclose(arrays[name][:, column], fixed[name][:, column], rtol=SAME, atol=0.0):
                raise ValueError(f"{name} holds other bodies or plates than the scene")


def _refuse_clocks(arrays: Mapping[str, np.ndarray]) -> None:
    """Raise ValueError for impossible times or counters of the run or of a body."""
    for name in CLOCKS.keys() & arrays.keys():
        shown = np.atleast_2d(arrays[name])[:, CLOCKS[name]]
        if not np.all((shown >= 0.0) & (shown < LAST)):
            raise ValueError(f"{name} holds times or counts that no run has")


def _refuse_unlike(name: str, report: Any, wanted: Any) -> None:
    """Raise ValueError unless the notes have the keys and types of those wanted."""
    if isinstance(wanted, dict):
        if not isinstance(report, dict) or report.keys() != wanted.keys():
            raise ValueError(f"{name} has other notes than expected")
        for key in wanted:
            _refuse_unlike(key, report[key], wanted[key])
    elif isinstance(wanted, list):  # of numbers, of any length
        if not isinstance(report, list):
            raise ValueError(f"{name} is no list")
        for one in report:
            _refuse_unlike(name, one, 0.0)
    elif isinstance(wanted, int | float) and not isinstance(wanted, bool):
        if isinstance(report, bool) or not isinstance(report, int | float) or not (abs(report) <= LARGEST or report == math.inf):
            raise ValueError(f"{name} is no number of a run")
    elif type(report) is not type(wanted):
        raise ValueError(f"{name} is no {type(wanted).__name__}")


def _slots(kept: Snapshot, state: State) -> Candidates:
    """Return the candidates of a snapshot; index tables that follow from the pairs are computed again."""
    arrays, old = {name: kept.arrays.get(f"slots_{name}") for name in SLOTS}, state.slots
    own, partner = arrays["own"], arrays["partner"]
    if own is None or own.ndim != 1:
        raise ValueError("slots_own is missing or no list")
    n, n_plates = len(own), int(kept.notes["plates"])
    rows = {name: np.empty((n, *getattr(old, name).shape[1:]), getattr(old, name).dtype) for name in SLOTS}
    if arrays["R"] is not None and not len(arrays["R"]):  # not needed, so not stored
        arrays["R"] = np.zeros(rows["R"].shape)
    check({name: array for name, array in arrays.items() if array is not None}, rows)
    low = -2 - len(state.P)
    assert partner is not None
    if n and not (0 <= own.min() and own.max() < state.n_spheres and low < partner.min() and partner.max() < state.n_spheres):
        raise ValueError("slots name spheres or plates that are not there")
    if not 0 <= n_plates <= n or np.any(partner[:n_plates] >= 0) or np.any(partner[n_plates:] < 0):
        raise ValueError("contacts with plates do not come first")
    # sorted as by the search: by sphere, then by partner, without duplicates
    order = own.astype(np.int64) * (state.n_spheres + 2) + np.where(partner < 0, partner < -1, 2 + partner)
    for part in (order[:n_plates], order[n_plates:]):
        if np.any(np.diff(part) <= 0):
            raise ValueError("slots are not in order")
    H, R = (np.ascontiguousarray(arrays[name]) for name in ("H", "R"))
    return slots_of(state, own, partner, n_plates, H, R)
