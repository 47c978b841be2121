"""The forces that contacts of other groups left for a body, and the closing half kick."""

import numpy as np
from numba import njit

from .bodies import BODIES, GUESTS, MOVE_POWER, spin_body
from .contacts import push_body
from .four import AHEAD, above, fetch, load, spread, store, with_last
from .layout import (
    B_EF,
    B_ET,
    B_F,
    B_L,
    B_MASS,
    B_T,
    B_V,
    B_W,
    F_F,
    F_T,
)  # fmt: skip
from .options import BARE, BARE_CHUNK

RESTING_SPEED, RESTING_MOMENTUM = 1e-60, 1e-90
"""m/s and kg m2/s, some fifty orders below any motion: a ball that a dashpot brings to rest between two plates decays for ever,
and arithmetic on denormal numbers is thirty times slower."""


@njit(**BARE)
def kick_body(b, B, force, torque, dt):
    """Half kick of body b by the three forces from column `force` and torques from column `torque`."""
    kick, half, none = 0.5 * dt / B[b, B_MASS], 0.5 * dt, spread(0.0)
    change, push = spread(kick) * with_last(load(B, b, force), none), spread(half) * with_last(load(B, b, torque), none)
    store(B, b, B_V, above(load(B, b, B_V) + change, RESTING_SPEED))
    store(B, b, B_L, above(load(B, b, B_L) + push, RESTING_MOMENTUM))


@njit(**BARE_CHUNK)
def act(c, first, last, B, dt, time, effects, effect_parameters, moves):
    """Body effects on the bodies of chunk c, which see velocities at the end of the step."""
    effects(B, first, last, time, dt, effect_parameters)
    for b in range(first, last):
        kick_body(b, B, np.int64(B_EF), np.int64(B_ET), dt)
        spin_body(b, B)
        for k in range(3):
            B[b, B_F + k] += B[b, B_EF + k]
            B[b, B_T + k] += B[b, B_ET + k]
            moves[c, MOVE_POWER] += B[b, B_EF + k] * B[b, B_V + k] + B[b, B_ET + k] * B[b, B_W + k]


@njit(**BARE)
def collect(first, last, guests, F, B):
    """Add what the contacts of other groups did to their partners, rows first to last of F, in that order."""
    for f in range(first, last):
        fetch(B, np.uint64(guests[min(f + AHEAD, last - 1)]), np.int64(B_F))
        push_body(np.uint64(guests[f]), B, load(F, f, F_F), load(F, f, F_T))


@njit(**BARE_CHUNK)
def gather_chunk(c, cuts, guests, F, B, dt, time, effects, effect_parameters, has_effects, record, moves):
    """Forces and closing half kick of the bodies of chunk c; their spins where somebody looks (`record`) or acts on them."""
    first, last = c * BODIES, min((c + 1) * BODIES, B.shape[0])
    collect(cuts[GUESTS, c], cuts[GUESTS, c + 1], guests, F, B)
    for b in range(first, last):
        kick_body(b, B, np.int64(B_F), np.int64(B_T), dt)
    moves[c, MOVE_POWER] = 0.0
    if has_effects or record:
        for b in range(first, last):
            spin_body(b, B)
    if has_effects:
        act(c, first, last, B, dt, time, effects, effect_parameters, moves)
