"""Work of an ensemble over its time, from a few of its bodies that are computed ahead, alone, and then thrown away.

Pressing and first sliding take many steps in little time, so simulated time tells little about what is left of the work. Nor do
steps: a body that sliding has set rolling needs four iterations a step, one that slides steadily less than one. The processor
time of the few bodies would count too much what a call costs that has few bodies.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterable
from typing import NamedTuple

import numpy as np

from thirdbody.engine.candidates import sides_of
from thirdbody.engine.contact_rows import AllRows, ClosedRows
from thirdbody.engine.implicit_ensemble import ImplicitEnsemble
from thirdbody.engine.neighbours import slots_of
from thirdbody.engine.state import Array, place_some
from thirdbody.engine.step_limits import causes
from thirdbody.errors import GuardStop
from thirdbody.jit.packed_arguments import Packer
from thirdbody.kernels.columns import step_memory
from thirdbody.kernels.columns.sides import UPPER
from thirdbody.kernels.implicit.bundles import KINDS
from thirdbody.kernels.predicates import BASINS

BODIES, EVERY, GROUPS, FEWEST = 32, 5_000, 64, 20_000
"""Bodies of a group; bodies of the run for each group, so that 0.64 % of the work is done twice; largest number of groups; and
fewest bodies of a run. The few that roll on take fifty times the steps of the others: of 128 of 100 000 bodies the work was
distributed over the time as that of all to 20 %."""
STOP = 4.0
"""What a stop costs a body beyond its iterations, in iterations: its rows and spheres, which come from memory, and the time for
which its thread waits (100 000 bodies, two threads, Zen 3)."""


class Work(NamedTuple):
    """Expected fraction of the work that is done at a time [s] of the run."""

    times: Array
    fractions: Array

    def done(self, times: Array) -> float:
        """Return the fraction of the work that is done where the bodies have reached these times [s]."""
        return float(np.interp(times, self.times, self.fractions).mean())


def expected_work(
    integrator: ImplicitEnsemble, stops: Iterable[tuple[float, float]], interrupted: Callable[[], bool] = lambda: False
) -> Work | None:
    """Return the work of a run from its present state to the last stop (time [s], distance [m]); None where it is not known.

    It is known for large ensembles, unless a guard stops one of the few bodies, or `interrupted` returns True before the end: it
    is called after each group of them.
    """
    rows, n = integrator.state.slots.rows, integrator.state.n_bodies
    if n < FEWEST or not isinstance(rows, ClosedRows):
        return None
    number = min(n // EVERY, GROUPS)
    groups = [_alone(integrator, rows, k * (len(rows.compact) - 1) // number) for k in range(number)]
    times, iterations = [integrator.state.time], [_iterations(groups)]
    try:
        for stop in stops:
            for group in groups:
                group.advance_to(*stop)
                if interrupted():
                    return None
            times.append(groups[0].state.time)
            iterations.append(_iterations(groups))
    except GuardStop:
        return None
    work = np.array(iterations) - iterations[0] + STOP * number * BODIES * np.arange(len(times))
    return Work(np.array(times), work / work[-1]) if work[-1] > 0.0 else None


def _iterations(groups: list[ImplicitEnsemble]) -> float:
    return float(sum(group.memory[:, step_memory.ITERATIONS].sum() for group in groups))


def _alone(integrator: ImplicitEnsemble, rows: ClosedRows, number: int) -> ImplicitEnsemble:
    """Return a copy of the integrator with the first bodies of a batch only."""
    whole, state = integrator.state, copy.copy(integrator.state)
    first, n = number * rows.size, BODIES
    bodies, low, high = slice(first, first + n), int(whole.start[first]), int(whole.start[first + n])
    for name in ("B", "E", "orientations", "P", "M", "X0", "material", "population", "rayleigh_radius", "order"):
        setattr(state, name, getattr(whole, name)[bodies].copy())
    state.A, state.D = whole.A.copy(), whole.D.copy()
    state.offsets, state.body, state.patch = whole.offsets[low:high].copy(), whole.body[low:high] - first, np.arange(n)
    state.side = whole.side[low:high]
    state.start = whole.start[first : first + n + 1] - low
    state.S = place_some(whole, first, first + n) if whole.sphere_table is None else state.B
    k = slice(int(whole.slots.edges[first]), int(whole.slots.edges[first + n]))
    H, R = rows.expand(number)
    own, partner = whole.slots.own[k] - np.int32(low), whole.slots.partner[k].copy()
    partner[sides_of(partner) == UPPER] += np.int32(first * BASINS)  # patches are numbered from 0 on
    here = slice(0, k.stop - k.start)
    state.slots = slots_of(state, own, partner, len(own), (whole.slots.Q[:0], H[here].copy(), R[here].copy()))
    assert isinstance(state.slots.rows, AllRows)
    alone = copy.copy(integrator)
    alone.state, alone._pack = state, Packer(KINDS)
    alone.totals, alone.memory = integrator.totals[bodies].copy(), integrator.memory[bodies].copy()
    alone._reported = causes(alone.memory).copy()
    return alone
