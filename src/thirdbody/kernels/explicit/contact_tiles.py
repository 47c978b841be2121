"""Gather a tile of contacts of either kind, and end contacts that opened."""

import numpy as np
from numba import njit

from thirdbody.jit.options import BARE, BARE_CHUNK
from thirdbody.jit.simd import broadcast, set4, store
from thirdbody.kernels.columns import body, law_output, patch, remote_force
from thirdbody.kernels.columns.tile import TILE
from thirdbody.kernels.contact_geometry import (
    gather_pair_contacts,
    gather_plate_contact,
    pair_geometry,
    slip_increment,
    transport_frames,
)
from thirdbody.kernels.contact_history import reset_history
from thirdbody.kernels.periodic import inverse
from thirdbody.kernels.predicates import is_plate, is_sphere, patch_of_partner
from thirdbody.kernels.rolling_kinematics import gather_rolling

SHARE = 0.5
"""Fraction of the friction work between two bodies that each of them gets."""


@njit(**BARE)
def store_remote_force(f, force, torque, F):
    """Store a force and a torque in row f of F for the group that sums the forces on the body."""
    store(F, f, remote_force.FORCE, force)
    store(F, f, remote_force.TORQUE, torque)


@njit(**BARE)
def gather_plate_contacts(n, slots, first, g, start, own, partner, kind, S, P, H, v_x, v_y, I, G, n_history):  # noqa: E741
    """Gather n contacts with plates, slots[first:first + n], into the first elements. `g`: their overlaps [m]."""
    for q in range(n):
        k = slots[first + q]
        rise = P[patch_of_partner(partner[k]), patch.VELOCITY]
        gather_plate_contact(q, k, g[k - start], own, partner, kind, S, H, v_x, v_y, rise, I, G, n_history)


@njit(**BARE_CHUNK)
def gather_tile(n, slots, first, flat, g, start, own, partner, body, kind, S, B, P, H, dt, v_x, v_y, l_x, l_y, n_history,
          rolling, I, G):  # noqa: E741  # fmt: skip
    """Gather contacts slots[first:first + n] into a tile: geometry, slip, velocities, rotation, history."""
    if flat:
        gather_plate_contacts(n, slots, first, g, start, own, partner, kind, S, P, H, v_x, v_y, I, G, n_history)
    else:
        gather_pair_contacts(n, slots, first, own, partner, body, kind, S, B, H, I, G, n_history)
        pair_geometry(n, dt, l_x, l_y, inverse(l_x), inverse(l_y), I, G)
    transport_frames(n, dt, G)
    slip_increment(n, dt, I, G)
    if rolling > 0:
        for q in range(n):
            gather_rolling(q, slots[first + q], own, partner, S, P, dt, v_x, v_y, I, G, n_history)


@njit(**BARE)
def end_contacts(o, opened, first, booked, stored, own, partner, body_of, outer, H, B, F, O):  # noqa: E741
    """End the contacts opened[first:first + o] that were closed; return the energy that they lost [J].

    The loss is in a tile if it is `booked` there, else in the history (`stored`: `contact_history.spring_energy`). A contact that
    opened one step ago stores no energy, but its remote force row must be cleared.
    """
    total = 0.0
    for e in range(o):
        k = np.int64(opened[first + e])
        saved = reset_history(k, stored, H)
        lost = O[e + law_output.DISSIPATED * TILE] if booked else saved
        total += lost
        fraction = lost if is_plate(partner[k]) else SHARE * lost
        B[body_of[own[k]], body.FRICTION_WORK] += fraction
        if outer[k] >= 0:
            store_remote_force(outer[k], set4(0.0, 0.0, 0.0, fraction), broadcast(0.0), F)
        elif is_sphere(partner[k]):
            B[body_of[partner[k]], body.FRICTION_WORK] += fraction
    return total
