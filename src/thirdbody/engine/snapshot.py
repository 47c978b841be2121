"""All that a run holds in memory between two compiled calls, as plain arrays and numbers, and back again.

What follows from the scene (shapes, laws, schedules) is not kept: the run is built from its scene and then put where it was.
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
"""Tables of a state whose shape follows from the scene; of S and B only one where they are the same."""

GIVEN = {
    "B": (sphere.RADIUS, body.MASS, body.SPHERE_INERTIA, sphere.SIDE),
    "E": (body_extra.REACH, body_extra.INERTIA, body_extra.INERTIA + 1, body_extra.INERTIA + 2),
    "S": (sphere.RADIUS, sphere.MASS, sphere.SIDE),
    "P": (patch.MASS, patch.DAMPING, patch.FREE, patch.SPRING, patch.NOMINAL_LOAD),
}
"""Columns that the scene decides on and a run leaves alone; those of spheres are zero in B where S is a table of its own."""

LARGEST = 1e100
"""No number of a run is larger in SI; such ones, and what is no number, would lead compiled loops out of their tables."""

SAME = 1e-9
"""Relative: other versions of libraries may round the last digits of a mass elsewhere."""

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
"""Columns that only grow, from zero; beyond LAST they would not, and a loop that waits for them would wait for ever."""

LAST = 2.0**53

SLOTS = ("own", "partner", "H", "R")
"""What the candidates for contact are and remember."""


@dataclass
class Snapshot:
    """Arrays by name, and notes that JSON can hold."""

    arrays: dict[str, np.ndarray] = field(default_factory=dict)
    notes: dict[str, Any] = field(default_factory=dict)


def snapshot(state: State, integrator: Explicit | Implicit, ledger: Ledger) -> Snapshot:
    """All that changes in a run, between two compiled calls: the tables themselves, to be written before it goes on."""
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
    """Put a freshly built run where the snapshot was taken. Raises ValueError where it does not fit, with the run as it was."""
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
    """Raise ValueError unless all wanted arrays are there with their shapes and types."""
    for name, array in wanted.items():
        if name not in arrays:
            raise ValueError(f"{name} is missing")
        result = arrays[name]
        if result.shape != array.shape or result.dtype != array.dtype:
            raise ValueError(f"{name} holds {result.dtype} {result.shape}, expected {array.dtype} {array.shape}")


def _fixed(state: State) -> dict[str, Array]:
    """The tables `FIXED`."""
    return {name: getattr(state, name) for name in FIXED if name != "S" or state.S is not state.B}


def _refuse_others(arrays: Mapping[str, np.ndarray], state: State) -> None:
    """Raise ValueError for other bodies or plates than those of the scene: a mass of zero would make forces infinite."""
    fixed = _fixed(state)
    for name, columns in GIVEN.items():
        for column in columns if name in fixed else ():
            if not np.allclose(arrays[name][:, column], fixed[name][:, column], rtol=SAME, atol=0.0):
                raise ValueError(f"{name} holds other bodies or plates than the scene")


def _refuse_clocks(arrays: Mapping[str, np.ndarray]) -> None:
    """Raise ValueError for clocks and counters of the run, or of a body, that stand where none can."""
    for name in CLOCKS.keys() & arrays.keys():
        shown = np.atleast_2d(arrays[name])[:, CLOCKS[name]]
        if not np.all((shown >= 0.0) & (shown < LAST)):
            raise ValueError(f"{name} holds times or counts that no run has")


def _refuse_unlike(name: str, report: Any, wanted: Any) -> None:
    """Raise ValueError unless notes have the keys and kinds of those wanted."""
    if isinstance(wanted, dict):
        if not isinstance(report, dict) or report.keys() != wanted.keys():
            raise ValueError(f"{name} has other notes than expected")
        for key in wanted:
            _refuse_unlike(key, report[key], wanted[key])
    elif isinstance(wanted, list):  # of numbers, as many as it may be
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
    """The candidates; everything that follows from who meets whom is found again."""
    arrays, old = {name: kept.arrays.get(f"slots_{name}") for name in SLOTS}, state.slots
    own, partner = arrays["own"], arrays["partner"]
    if own is None or own.ndim != 1:
        raise ValueError("slots_own is missing or no list")
    n, n_plates = len(own), int(kept.notes["plates"])
    rows = {name: np.empty((n, *getattr(old, name).shape[1:]), getattr(old, name).dtype) for name in SLOTS}
    if arrays["R"] is not None and not len(arrays["R"]):  # nobody was going to read it
        arrays["R"] = np.zeros(rows["R"].shape)
    check({name: array for name, array in arrays.items() if array is not None}, rows)
    low = -2 - len(state.P)
    assert partner is not None
    if n and not (0 <= own.min() and own.max() < state.n_spheres and low < partner.min() and partner.max() < state.n_spheres):
        raise ValueError("slots name spheres or plates that are not there")
    if not 0 <= n_plates <= n or np.any(partner[:n_plates] >= 0) or np.any(partner[n_plates:] < 0):
        raise ValueError("contacts with plates do not come first")
    # as the search leaves them: by sphere, then by what it meets, nothing twice
    order = own.astype(np.int64) * (state.n_spheres + 2) + np.where(partner < 0, partner < -1, 2 + partner)
    for part in (order[:n_plates], order[n_plates:]):
        if np.any(np.diff(part) <= 0):
            raise ValueError("slots are not in order")
    H, R = (np.ascontiguousarray(arrays[name]) for name in ("H", "R"))
    return slots_of(state, own, partner, n_plates, H, R)
