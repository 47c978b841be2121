"""The passes of a step over groups of bodies.

The step loop calls them through a pointer, so that both can be compiled at the same time.
"""

import numpy as np
from numba import njit

from thirdbody.jit.function_pointers import function_at
from thirdbody.jit.options import NO_COUNTS, POINTED
from thirdbody.jit.packed_arguments import make_unpacker
from thirdbody.kernels.columns import domain
from thirdbody.kernels.explicit.contact_forces import GROUP, contact_forces
from thirdbody.kernels.explicit.drift import drift_bodies
from thirdbody.kernels.explicit.gather_forces import gather_forces
from thirdbody.kernels.labeller_input import update_memory
from thirdbody.kernels.rigid_body import FLAT, PAIRED, reset_plate_forces
from thirdbody.kernels.signatures import EARLY, EFFECTS, KINDS, LATE, LAW, LOOK, OBSERVE, SWEEP, WORK, Context

context_of, law_at, effects_at, observe_at = (
    make_unpacker(KINDS, Context),
    function_at(LAW),
    function_at(EFFECTS),
    function_at(OBSERVE),
)


@njit(WORK, **POINTED, **NO_COUNTS)
def work(task, part, begin, end, number, record, time, v_x, v_y, dt, left, context):
    """Run one pass of step `number` over groups begin to end; one call for all, since calling through a pointer costs 1.4 us.

    `lowest`: the first group whose contacts act on bodies of this group. `needs`: other groups whose bodies must be drifted
    before this group's contacts.
    """
    k = context_of(context)
    law, effects, observe = law_at(k.law), effects_at(k.effects), observe_at(k.observe)
    l_x, l_y, drag, chunks = (
        max(k.D[domain.LENGTH_X], 0.0),
        max(k.D[domain.LENGTH_Y], 0.0),
        (k.drag[0], k.drag[1]),
        k.moves.shape[0],
    )
    for g in range(begin, end):
        first, last, alone = g * GROUP, min((g + 1) * GROUP, chunks), k.lowest[g] >= begin
        requested = k.needs[g + 1] if task == SWEEP else k.needs[g] if task == EARLY and not alone else k.needs[g] - 1
        for e in range(k.needs[g] - 1, requested):
            h = np.int64(k.needs[e]) if e >= k.needs[g] else g
            if k.moved[h] != number:
                k.moved[h] = number
                for c in range(h * GROUP, min((h + 1) * GROUP, chunks)):
                    drift_bodies(c, k.start, k.near, k.beginning, record, k.offsets, k.S, k.B, k.E, k.D, dt, left, k.moves,
                                k.room[part], k.marks[part])  # fmt: skip
                    reset_plate_forces(k.cuts[FLAT, c], k.cuts[FLAT, c + 1], k.own, k.body, k.E)
        if task == SWEEP:
            for side in range(FLAT, PAIRED + 1):
                contact_forces(2 * g + side, k.cuts[side, first], k.cuts[side, last], side == FLAT, k.own, k.partner, k.kind,
                               k.closed, k.outer, k.body, k.S, k.B, k.E, k.P, k.H, k.F, k.R, k.sums, law, k.pairs, dt, v_x,
                               v_y, l_x, l_y, k.n_history, k.rolling, k.force, k.moment, k.stored, k.dashpots, record,
                               k.room[part], k.marks[part])  # fmt: skip
        if (task == SWEEP and alone) or (task == LATE and not alone):
            for c in range(first, last):
                gather_forces(c, k.cuts, k.guests, k.F, k.B, k.E, dt, time, effects, k.effect_parameters, k.has_effects != 0,
                              record, k.moves)  # fmt: skip
        if task == LOOK:
            speed = (v_x * v_x + v_y * v_y) ** 0.5
            for c in range(first, last):
                update_memory(c, k.edges, k.incidence, k.own, k.partner, k.H, k.R, k.B, k.E, k.A, k.M, drag, speed, k.n_history,
                              k.width, observe, k.room[part], k.rows[part])  # fmt: skip
