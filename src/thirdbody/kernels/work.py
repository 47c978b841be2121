"""The passes of a step over chunks of bodies or of contacts, apart from the step loop, which calls them through a pointer: so
the two can be compiled at the same time."""

from numba import njit

from .bodies import FLAT, PAIRED, drift_chunk
from .contacts import GROUP, contact_chunk
from .gather import gather_chunk
from .layout import D_LX, D_LY
from .observe import observe_chunk
from .options import NO_COUNTS, POINTED
from .signatures import CONTACTS, DRIFT, GATHER, LOOK, WHOLE, WORK


@njit(WORK, **POINTED, **NO_COUNTS)
def work(task, part, begin, end, record, time, v_x, v_y, dt, own, partner, kind, closed, outer, edges, incidence, near, beginning,
         guests, cuts, body, start, offsets, X0, S, B, P, H, F, R, M, pairs, effect_parameters, D, A, sums, moves, n_history,
         rolling, width, has_effects, drag, law, effects, observe, room, marks, rows):  # fmt: skip
    """Chunks begin to end of one pass of the step. To call it through a pointer takes 1.4 us: hence not chunk by chunk."""
    whole = task == WHOLE
    for c in range(begin, end):
        if task == DRIFT or whole:
            drift_chunk(c, start, near, beginning, record, offsets, S, X0, B, D, dt, moves, room[part],
                        marks[part])  # fmt: skip
        if task == CONTACTS or whole:
            first, last = (c, c + 1) if whole else (c * GROUP, min((c + 1) * GROUP, moves.shape[0]))
            for side in range(FLAT, FLAT + 1 if whole else PAIRED + 1):
                contact_chunk(2 * c + side, cuts[side, first], cuts[side, last], side == FLAT, own, partner, kind, closed, outer,
                              body, S, B, P, H, F, R, sums, law, pairs, dt, v_x, v_y, max(D[D_LX], 0.0), max(D[D_LY], 0.0),
                              n_history, rolling, record, room[part], marks[part])  # fmt: skip
        if task == GATHER or whole:
            gather_chunk(c, cuts, guests, F, B, dt, time, effects, effect_parameters, has_effects, record, moves)
        if task == LOOK:
            speed = (v_x * v_x + v_y * v_y) ** 0.5
            observe_chunk(c, edges, incidence, own, partner, H, R, B, A, M, drag, speed, n_history, width, observe, room[part],
                          rows[part])  # fmt: skip
