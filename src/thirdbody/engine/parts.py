"""A run whose bodies do not influence each other, cut into ranges of bodies, and put together again, bit for bit.

A part is the whole simulation, restricted to its bodies before the first step: all that depends on all bodies (time step, skin,
settings of the step control) is that of the whole. Snapshots of the parts at one instant, joined in the order of the bodies, are
the snapshot of the whole.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from thirdbody.engine.candidates import sides_of
from thirdbody.engine.part_deposits import ROWS, STEPS, PartDeposits, joined_maps
from thirdbody.engine.snapshot import Snapshot, restore, snapshot
from thirdbody.engine.state import State, table
from thirdbody.kernels.columns import run_totals
from thirdbody.kernels.columns.sides import UPPER
from thirdbody.kernels.predicates import BASINS

if TYPE_CHECKING:
    from thirdbody.engine.energy import Ledger
    from thirdbody.engine.explicit import Explicit
    from thirdbody.engine.implicit import Implicit

OF_BODIES = ("B", "E", "orientations", "M", "X0", "W", "integrator_totals", "integrator_memory")
"""Arrays of a snapshot with a row per body."""

LEDGERS = "integrator_ledgers"
"""Array with a row per group of bodies of an explicit run."""


@dataclass(frozen=True)
class Range:
    """Bodies `first` to `last` - 1 of a run, and their spheres."""

    first: int
    last: int
    first_sphere: int
    last_sphere: int


def ranges(state: State, parts: int, explicit: bool) -> list[Range]:
    """Return at most `parts` ranges of nearly the same number of bodies.

    The explicit integrator sums over groups of bodies, so its parts consist of whole groups.
    """
    unit = _group_size() if explicit else 1
    units = -(-state.n_bodies // unit)
    parts = min(parts, units)
    cuts = [min(unit * (k * units // parts), state.n_bodies) for k in range(parts + 1)]
    return [Range(a, b, int(state.start[a]), int(state.start[b])) for a, b in zip(cuts, cuts[1:], strict=False)]


def _group_size() -> int:
    """Return the number of bodies in a group; imported here, since an implicit run would compile explicit steps."""
    from thirdbody.kernels.explicit.contact_forces import GROUP
    from thirdbody.kernels.rigid_body import BODIES

    return BODIES * GROUP


def restrict(state: State, integrator: Explicit | Implicit, ledger: Ledger, part: Range) -> None:
    """Restrict a simulation that has not started to the bodies of a part."""
    keep_all_rows(integrator)
    begun = _cut(snapshot(state, integrator, ledger), state, part)
    n, shared = part.last - part.first, not has_own_patches(state)
    bodies, spheres = slice(part.first, part.last), slice(part.first_sphere, part.last_sphere)
    united = state.S is state.B
    state.offsets = np.ascontiguousarray(state.offsets[spheres])
    state.start = state.start[part.first : part.last + 1] - part.first_sphere
    state.body, state.side = state.body[spheres] - part.first, state.side[spheres]
    state.patch = np.zeros(n, np.int64) if shared else np.arange(n)
    state.material, state.population = state.material[bodies], state.population[bodies]
    state.rayleigh_radius, state.order = state.rayleigh_radius[bodies], state.order[bodies]
    for name in ("B", "E", "orientations", "P", "M", "X0", *(() if united else ("S",))):
        rows = begun.arrays[name]
        setattr(state, name, table(*rows.shape) if name in ("B", "E", "orientations", "S") else np.empty_like(rows))
        getattr(state, name)[:] = rows  # the integrator may list its candidates
    state.S = state.B if united else state.S
    state.W = begun.arrays.get("W", state.W).copy()
    integrator.restrict(part.first, part.last)
    if len(state.maps):
        from thirdbody.engine.implicit import BATCH, Implicit  # explicit runs with measures are not cut

        assert isinstance(integrator, Implicit)
        state.part_deposits = PartDeposits(part.first, BATCH, integrator.totals[:, run_totals.STEPS], len(state.maps))
        begun.arrays |= state.part_deposits.arrays()
    restore(begun, state, integrator, ledger)


def keep_all_rows(integrator: Explicit | Implicit) -> None:
    """Have an integrator that keeps rows of closed contacts only keep all: snapshots of parts, and of their whole, hold all."""
    getattr(integrator, "keep_all_rows", lambda: None)()


def has_own_patches(state: State) -> bool:
    """Return whether each body has a patch of the upper plate of its own."""
    return len(state.P) >= state.n_bodies and np.array_equal(state.patch, np.arange(state.n_bodies))


def _cut(captured: Snapshot, state: State, part: Range) -> Snapshot:
    """Return the part of a snapshot of the whole `state`."""
    arrays, bodies, spheres = dict(captured.arrays), slice(part.first, part.last), slice(part.first_sphere, part.last_sphere)
    for name in OF_BODIES:
        if name in arrays:
            arrays[name] = arrays[name][bodies].copy()
    if LEDGERS in arrays:
        size = _group_size()
        arrays[LEDGERS] = arrays[LEDGERS][part.first // size : -(-part.last // size)].copy()
    if "S" in arrays:
        arrays["S"] = arrays["S"][spheres].copy()
    own_patches = has_own_patches(state)
    if own_patches:
        arrays["P"] = np.concatenate((arrays["P"][bodies], arrays["P"][state.n_bodies :]))
    own, partner = arrays["slots_own"], arrays["slots_partner"]
    mine = np.flatnonzero((own >= part.first_sphere) & (own < part.last_sphere))
    arrays["slots_own"] = own[mine] - np.int32(part.first_sphere)
    arrays["slots_partner"] = moved(partner[mine], part.first if own_patches else 0)
    for name in ("slots_H", "slots_R"):
        arrays[name] = arrays[name][mine]
    arrays["slots_Q"] = arrays["slots_Q"][mine[mine < len(arrays["slots_Q"])]]
    return Snapshot(arrays, captured.notes | {"plates": int(np.count_nonzero(mine < captured.notes["plates"]))})


def moved(partner: np.ndarray, patches: int) -> np.ndarray:
    """Return the partner codes after the patches were numbered from `patches` (negative: before 0) on."""
    return np.where(sides_of(partner) == UPPER, partner + np.int32(patches * BASINS), partner).astype(np.int32)


def join(parts: Sequence[Snapshot], cuts: Sequence[Range], state: State) -> Snapshot:
    """Return the snapshot of the whole `state` from those of its parts at the same instant."""
    first, arrays = parts[0], dict(parts[0].arrays)
    for name in (name for name in (*OF_BODIES, "S", LEDGERS) if name in arrays):
        arrays[name] = np.concatenate([part.arrays[name] for part in parts])
    own_patches = has_own_patches(state)
    if own_patches:
        counts = [cut.last - cut.first for cut in cuts]
        patches = [part.arrays["P"][:n] for part, n in zip(parts, counts, strict=True)]
        arrays["P"] = np.concatenate([*patches, first.arrays["P"][counts[0] :]])
    both = list(zip(parts, cuts, strict=True))
    arrays["slots_own"] = np.concatenate([part.arrays["slots_own"] + np.int32(cut.first_sphere) for part, cut in both])
    arrays["slots_partner"] = np.concatenate(
        [moved(part.arrays["slots_partner"], -cut.first if own_patches else 0) for part, cut in both]
    )
    for name in ("slots_Q", "slots_H", "slots_R"):
        arrays[name] = np.concatenate([part.arrays[name] for part in parts])
    if ROWS in arrays:
        del arrays[ROWS], arrays[STEPS]
        arrays["maps"] = joined_maps(state.maps, [part.arrays[ROWS] for part in parts], state.world.size)
    searches, plates = (([part.notes[name] for part in parts]) for name in ("searches", "plates"))
    return Snapshot(arrays, first.notes | {"searches": max(searches), "plates": sum(plates)})
