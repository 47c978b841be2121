"""Dynamics of the patches of the upper plate by velocity Verlet: driven, loaded, sprung to a plate."""

import numpy as np
from numba import njit

from thirdbody.jit.options import BARE
from thirdbody.kernels.direct_contact import direct_force
from thirdbody.kernels.schedule import GAP, LOAD, mean_rate, value
from thirdbody.kernels.tables import body_extra, patch


@njit(**BARE)
def drive_patches(P, schedule, first, t, dt):
    """Set the velocity from t to t + dt of patches or a plate of prescribed height (neither free nor sprung)."""
    if first[GAP + 1] == first[GAP]:
        return
    for p in range(P.shape[0]):
        if P[p, patch.SPRING] == 0.0 and P[p, patch.FREE] == 0.0:
            P[p, patch.VELOCITY] = mean_rate(schedule, first, np.int64(GAP), t, dt)


@njit(**BARE)
def load_patches(P, schedule, first, t):
    """Set the loads at time t where a schedule changes them."""
    if first[LOAD + 1] == first[LOAD]:
        return
    factor = value(schedule, first, np.int64(LOAD), t)
    for p in range(P.shape[0]):
        if P[p, patch.NOMINAL_LOAD] != 0.0:
            P[p, patch.LOAD] = factor * P[p, patch.NOMINAL_LOAD]


@njit(**BARE)
def drift_patches(P, dt, v_x, v_y):
    """Apply half kick and drift to the patches, which move along x and y with (v_x, v_y) [m/s].

    Returns the largest change of a height since the last search, one step ahead [m].
    """
    path = 0.0
    for p in range(P.shape[0]):
        if P[p, patch.FREE] != 0.0:
            force = P[p, patch.FORCE] - P[p, patch.LOAD] - P[p, patch.DAMPING] * P[p, patch.VELOCITY]
            P[p, patch.VELOCITY] += 0.5 * dt / P[p, patch.MASS] * force
        P[p, patch.HEIGHT] += dt * P[p, patch.VELOCITY]
        P[p, patch.DISPLACEMENT] += dt * v_x
        P[p, patch.DISPLACEMENT + 1] += dt * v_y
        path = max(path, abs(P[p, patch.HEIGHT] - P[p, patch.SEARCH_HEIGHT]) + dt * abs(P[p, patch.VELOCITY]))
    return path


@njit(**BARE)
def press_patches(P, E, patch_of, push):
    """Sum the upward forces on patches and plate, in the order of bodies and patches: of debris, direct contact, springs.

    `push`: force of all debris, sufficient for a single patch [N].
    """
    plate = P.shape[0] - 1
    if plate == 0:
        P[0, patch.FORCE] = push + direct_force(P, np.int64(0))
        return
    for p in range(plate):
        P[p, patch.FORCE] = 0.0
    P[plate, patch.FORCE] = direct_force(P, plate)
    for b in range(E.shape[0]):
        P[patch_of[b], patch.FORCE] -= E[b, body_extra.UPPER_PUSH]
    for p in range(plate):
        spring = P[p, patch.SPRING] * (P[p, patch.HEIGHT] - P[plate, patch.HEIGHT])
        P[p, patch.FORCE] -= spring
        P[plate, patch.FORCE] += spring


@njit(**BARE)
def kick_patches(P, E, patch_of, push, dt):
    """Apply the closing half kick, implicit in the dashpots: no overshoot."""
    press_patches(P, E, patch_of, push)
    for p in range(P.shape[0]):
        if P[p, patch.FREE] != 0.0:
            half = 0.5 * dt / P[p, patch.MASS]
            P[p, patch.VELOCITY] = (P[p, patch.VELOCITY] + half * (P[p, patch.FORCE] - P[p, patch.LOAD])) / (
                1.0 + half * P[p, patch.DAMPING]
            )


@njit(**BARE)
def patch_powers(P, first, last):
    """Return the power that moves patches first to last - 1 and that of their dashpots [W].

    The former is that of the loads of free patches, and minus force times velocity of those of prescribed height.
    """
    load, damping, power = 0.0, 0.0, 0.0
    for p in range(first, last):
        if P[p, patch.FREE] != 0.0:
            load -= P[p, patch.LOAD] * P[p, patch.VELOCITY]
            damping += P[p, patch.DAMPING] * P[p, patch.VELOCITY] * P[p, patch.VELOCITY]
        else:
            power -= P[p, patch.FORCE] * P[p, patch.VELOCITY]
    return load + power, damping
