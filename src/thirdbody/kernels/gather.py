"""The gather of contact forces into bodies, and the closing half kick.

Every body sums its contacts sphere by sphere, in the order of their slots: the same bits for any number of threads.
"""

import numpy as np
from numba import njit

from .bodies import BODIES, MOVE_LOW, MOVE_POWER, MOVE_UP, spin_body
from .layout import (
    B_EF,
    B_ET,
    B_F,
    B_L,
    B_LOW,
    B_MASS,
    B_SLIP,
    B_T,
    B_UP,
    B_V,
    B_W,
    B_WORK,
    F_F,
    F_HALF,
    F_M,
    F_Q,
    F_SLIP,
    F_WORK,
    S_ARM,
    S_R,
)  # fmt: skip
from .options import BARE, BARE_CHUNK
from .rolling import MOMENTS

RESTING_SPEED, RESTING_MOMENTUM = 1e-60, 1e-90
"""m/s and kg m2/s, some fifty orders below any motion: a ball that a dashpot brings to rest between two plates decays for ever,
and arithmetic on denormal numbers is thirty times slower."""


NOTHING = (0.0, 0.0, 0.0)


@njit(**BARE)
def sum_sphere(s, edges, incidence, row, n_plates, partner, F, S, up, low, lost):
    """Force of the slots of sphere s on it and their torque about its centre, added to the forces of the two plates, `up` and
    `low`, and to the work and slip `lost`."""
    f_x, f_y, f_z, t_x, t_y, t_z = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    work, slip = lost
    radius = S[s, S_R]
    for e in range(edges[s], edges[s + 1]):
        slot = incidence[e] >> 1
        k = np.uint64(row[slot])  # numba asks of every signed index whether it counts from the end
        sign = 1.0 - 2.0 * (incidence[e] & 1)
        x, y, z = sign * F[k, F_F], sign * F[k, F_F + 1], sign * F[k, F_F + 2]
        f_x, f_y, f_z = f_x + x, f_y + y, f_z + z
        arm = F[k, F_HALF] - radius
        t_x, t_y, t_z = t_x + arm * F[k, F_Q], t_y + arm * F[k, F_Q + 1], t_z + arm * F[k, F_Q + 2]
        share = 0.5  # work done between two bodies is shared by them
        if slot < n_plates:
            share = 1.0
            if partner[slot] == -1:
                low = (low[0] + x, low[1] + y, low[2] + z)
            else:
                up = (up[0] + x, up[1] + y, up[2] + z)
        work, slip = work + share * F[k, F_WORK], slip + F[k, F_SLIP]
    return (f_x, f_y, f_z), (t_x, t_y, t_z), up, low, (work, slip)


@njit(**BARE)
def cross(a, b):
    """The cross product of two vectors."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@njit(**BARE)
def plus(a, b):
    """The sum of two vectors."""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


@njit(**BARE)
def sum_moments(b, start, edges, incidence, row, F, B):
    """Add the moments of rolling to the torque of body b."""
    for e in range(edges[start[b]], edges[start[b + 1]]):
        k = row[incidence[e] >> 1]
        for d in range(3):
            B[b, B_T + d] += (1.0 - 2.0 * (incidence[e] & 1)) * F[k, F_M + d]


@njit(**BARE)
def gather_body(b, near, beginning, edges, incidence, row, n_plates, partner, F, S, B):
    """Sum the slots of body b into its force, torque, plate forces, friction work and slip; returns the plate forces."""
    force, torque, up, low = NOTHING, NOTHING, NOTHING, NOTHING
    lost = (B[b, B_WORK], B[b, B_SLIP])
    for e in range(beginning[b], beginning[b + 1]):
        s = near[e]
        f, t, up, low, lost = sum_sphere(s, edges, incidence, row, n_plates, partner, F, S, up, low, lost)
        force = plus(force, f)
        torque = plus(torque, plus(t, cross((S[s, S_ARM], S[s, S_ARM + 1], S[s, S_ARM + 2]), f)))
    B[b, B_WORK], B[b, B_SLIP] = lost
    B[b, B_F], B[b, B_F + 1], B[b, B_F + 2] = force
    B[b, B_T], B[b, B_T + 1], B[b, B_T + 2] = torque
    B[b, B_UP], B[b, B_UP + 1], B[b, B_UP + 2] = up
    B[b, B_LOW], B[b, B_LOW + 1], B[b, B_LOW + 2] = low
    return up, low


@njit(**BARE)
def settled(x, least):
    """x, or zero once it has decayed so far that its square would be a denormal number."""
    return x if abs(x) > least else 0.0


@njit(**BARE)
def kick_body(b, B, force, torque, dt):
    """Half kick of body b by the three forces from column `force` and torques from column `torque`."""
    kick, half = 0.5 * dt / B[b, B_MASS], 0.5 * dt
    for k in range(3):
        B[b, B_V + k] = settled(B[b, B_V + k] + kick * B[b, force + k], RESTING_SPEED)
        B[b, B_L + k] = settled(B[b, B_L + k] + half * B[b, torque + k], RESTING_MOMENTUM)


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


@njit(**BARE_CHUNK)
def gather_chunk(c, start, near, beginning, edges, incidence, row, n_plates, partner, F, S, B, dt, time, effects,
                 effect_parameters, has_effects, record, rolling, moves):  # fmt: skip
    """Forces and closing half kick of the bodies of chunk c; their spins where somebody looks (`record`) or acts on them."""
    first, last = c * BODIES, min((c + 1) * BODIES, B.shape[0])
    push_up, push_low = NOTHING, NOTHING
    for b in range(first, last):
        up, low = gather_body(b, near, beginning, edges, incidence, row, n_plates, partner, F, S, B)
        if rolling == MOMENTS:
            sum_moments(b, start, edges, incidence, row, F, B)
        kick_body(b, B, np.int64(B_F), np.int64(B_T), dt)
        push_up, push_low = plus(push_up, up), plus(push_low, low)
    moves[c, MOVE_UP], moves[c, MOVE_UP + 1], moves[c, MOVE_UP + 2] = push_up
    moves[c, MOVE_LOW], moves[c, MOVE_LOW + 1], moves[c, MOVE_LOW + 2] = push_low
    moves[c, MOVE_POWER] = 0.0
    if has_effects or record:
        for b in range(first, last):
            spin_body(b, B)
    if has_effects:
        act(c, first, last, B, dt, time, effects, effect_parameters, moves)
