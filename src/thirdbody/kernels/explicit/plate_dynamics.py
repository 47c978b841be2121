"""The patches of the upper body: driven, loaded, sprung to a common plate, and moved by velocity Verlet."""

import numpy as np
from numba import njit

from thirdbody.jit.options import BARE
from thirdbody.kernels.layout import E_PUSH, P_DAMPING, P_F, P_FREE, P_LOAD, P_LOAD0, P_MASS, P_SPRING, P_V, P_Z, P_Z0
from thirdbody.kernels.schedule import GAP, LOAD, mean_rate, value


@njit(**BARE)
def drive_patches(P, schedule, first, t, dt):
    """Velocity from t to t + dt of what has a prescribed height: patches that are neither free nor sprung, or the plate."""
    if first[GAP + 1] == first[GAP]:
        return
    for p in range(P.shape[0]):
        if P[p, P_SPRING] == 0.0 and P[p, P_FREE] == 0.0:
            P[p, P_V] = mean_rate(schedule, first, np.int64(GAP), t, dt)


@njit(**BARE)
def load_patches(P, schedule, first, t):
    """Loads at time t where a schedule changes them."""
    if first[LOAD + 1] == first[LOAD]:
        return
    factor = value(schedule, first, np.int64(LOAD), t)
    for p in range(P.shape[0]):
        if P[p, P_LOAD0] != 0.0:
            P[p, P_LOAD] = factor * P[p, P_LOAD0]


@njit(**BARE)
def drift_patches(P, dt):
    """Half kick and drift of the patches of the upper body; returns the largest way since the last search, one step ahead."""
    far = 0.0
    for p in range(P.shape[0]):
        if P[p, P_FREE] != 0.0:
            force = P[p, P_F] - P[p, P_LOAD] - P[p, P_DAMPING] * P[p, P_V]
            P[p, P_V] += 0.5 * dt / P[p, P_MASS] * force
        P[p, P_Z] += dt * P[p, P_V]
        far = max(far, abs(P[p, P_Z] - P[p, P_Z0]) + dt * abs(P[p, P_V]))
    return far


@njit(**BARE)
def press_patches(P, E, patch, push):
    """Upward forces: of the debris on its patches, of the springs on patches and plate, in the order of bodies and patches.

    `push`: that of all debris, which is all that a single patch needs.
    """
    plate = P.shape[0] - 1
    if plate == 0:
        P[0, P_F] = push
        return
    for p in range(P.shape[0]):
        P[p, P_F] = 0.0
    for b in range(E.shape[0]):
        P[patch[b], P_F] -= E[b, E_PUSH]
    for p in range(plate):
        spring = P[p, P_SPRING] * (P[p, P_Z] - P[plate, P_Z])
        P[p, P_F] -= spring
        P[plate, P_F] += spring


@njit(**BARE)
def kick_patches(P, E, patch, push, dt):
    """Closing half kick of the patches (their dashpot implicit, so it cannot overshoot); returns powers of load and dashpot."""
    press_patches(P, E, patch, push)
    load, damping = 0.0, 0.0
    for p in range(P.shape[0]):
        if P[p, P_FREE] != 0.0:
            half = 0.5 * dt / P[p, P_MASS]
            P[p, P_V] = (P[p, P_V] + half * (P[p, P_F] - P[p, P_LOAD])) / (1.0 + half * P[p, P_DAMPING])
            load -= P[p, P_LOAD] * P[p, P_V]
            damping += P[p, P_DAMPING] * P[p, P_V] * P[p, P_V]
    return load, damping


@njit(**BARE)
def patch_power(P):
    """Power that moves patches or a plate whose height is prescribed, W: minus the force on them times their velocity."""
    power = 0.0
    for p in range(P.shape[0]):
        if P[p, P_FREE] == 0.0:
            power -= P[p, P_F] * P[p, P_V]
    return power
