"""The passes of a step over groups of bodies, apart from the step loop, which calls them through a pointer: so
the two can be compiled at the same time."""

import numpy as np
from numba import njit

from .bodies import FLAT, PAIRED, drift_chunk, forget_plates
from .contacts import GROUP, contact_chunk
from .gather import gather_chunk
from .layout import D_LX, D_LY
from .observe import observe_chunk
from .options import NO_COUNTS, POINTED
from .signatures import EARLY, LATE, LOOK, SWEEP, WORK


@njit(WORK, **POINTED, **NO_COUNTS)
def work(task, part, begin, end, number, record, time, v_x, v_y, dt, own, partner, kind, closed, outer, edges, incidence, near,
         beginning, guests, cuts, lowest, needs, body, start, offsets, S, B, P, H, F, R, M, pairs, effect_parameters, D, A, sums,
         moves, n_history, rolling, width, has_effects, drag, law, effects, observe, room, marks, rows, moved):  # fmt: skip
    """Groups begin to end of one pass of step `number`. To call it through a pointer takes 1.4 us: hence not group by group.

    `lowest`: the first group whose contacts act on bodies of a group. `needs`: the groups whose bodies its contacts need besides.
    """
    for g in range(begin, end):
        first, last, alone = g * GROUP, min((g + 1) * GROUP, moves.shape[0]), lowest[g] >= begin
        asked = needs[g + 1] if task == SWEEP else needs[g] if task == EARLY and not alone else needs[g] - 1
        for e in range(needs[g] - 1, asked):
            h = np.int64(needs[e]) if e >= needs[g] else g
            if moved[h] != number:
                moved[h] = number
                for c in range(h * GROUP, min((h + 1) * GROUP, moves.shape[0])):
                    drift_chunk(c, start, near, beginning, record, offsets, S, B, D, dt, moves, room[part],
                                marks[part])  # fmt: skip
                    forget_plates(cuts[FLAT, c], cuts[FLAT, c + 1], own, body, B)
        if task == SWEEP:
            for side in range(FLAT, PAIRED + 1):
                contact_chunk(2 * g + side, cuts[side, first], cuts[side, last], side == FLAT, own, partner, kind, closed, outer,
                              body, S, B, P, H, F, R, sums, law, pairs, dt, v_x, v_y, max(D[D_LX], 0.0), max(D[D_LY], 0.0),
                              n_history, rolling, record, room[part], marks[part])  # fmt: skip
        if (task == SWEEP and alone) or (task == LATE and not alone):
            for c in range(first, last):
                gather_chunk(c, cuts, guests, F, B, dt, time, effects, effect_parameters, has_effects, record, moves)
        if task == LOOK:
            speed = (v_x * v_x + v_y * v_y) ** 0.5
            for c in range(first, last):
                observe_chunk(c, edges, incidence, own, partner, H, R, B, A, M, drag, speed, n_history, width, observe,
                              room[part], rows[part])  # fmt: skip
