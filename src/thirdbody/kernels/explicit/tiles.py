"""Gather a tile of contacts of either kind, and end contacts that opened.

Forces on the bodies of a group while its contacts are summed, in rows that stay in the cache (`body_force`).

The row of a body gets them at the end, when its velocities predicted for the end of the step are no longer needed.
"""

import numpy as np
from numba import njit

from thirdbody.jit.options import BARE, BARE_CHUNK
from thirdbody.jit.simd import LANES, broadcast, load, put, store, with_last
from thirdbody.kernels.books import separation_rate
from thirdbody.kernels.contact_geometry import (
    gather_pair_contacts,
    gather_plate_contact,
    pair_geometry,
    slip_increment,
    transport_frames,
)
from thirdbody.kernels.explicit.tables import body_force
from thirdbody.kernels.measures import measure_opened
from thirdbody.kernels.memory import reset_history
from thirdbody.kernels.plates import is_plate, is_sphere
from thirdbody.kernels.rolling_kinematics import gather_rolling
from thirdbody.kernels.tables import body, remote_force
from thirdbody.kernels.tile import TILE, law_input, law_output, rolling_input


@njit(**BARE)
def reset_forces(first, last, shift, context):
    """Reset the forces on bodies first to last for the contacts of this step; their friction work and slip go on.

    `shift`: row of a body less its number (`engine.remote_rows.force_rows`).
    """
    B, forces, none = context.B, context.forces, broadcast(0.0)
    for b in range(first, last):
        store(forces, b + shift, body_force.FORCE, with_last(none, load(B, b, body.FORCE)))
        store(forces, b + shift, body_force.TORQUE, with_last(none, load(B, b, body.TORQUE)))


@njit(**BARE)
def add_force(row, forces, force, torque):
    """Add a force (4th lane: friction work) and a torque (4th lane: slip) to those in a row."""
    store(forces, row, body_force.FORCE, load(forces, row, body_force.FORCE) + force)
    store(forces, row, body_force.TORQUE, load(forces, row, body_force.TORQUE) + torque)


@njit(**BARE)
def store_forces(first, last, shift, context):
    """Store the forces on bodies first to last in their rows."""
    B, forces = context.B, context.forces
    for b in range(first, last):
        store(B, b, body.FORCE, load(forces, b + shift, body_force.FORCE))
        store(B, b, body.TORQUE, load(forces, b + shift, body_force.TORQUE))


@njit(**BARE)
def shift_of(group, context):
    """Return the row of a body of a group in the table of forces, less the number of the body."""
    return np.int64(context.force_rows[group])


BODY_FRACTION = 0.5
"""Fraction of the friction work between two bodies that each of them gets."""


@njit(**BARE)
def store_remote_force(f, force, torque, F):
    """Store a force and a torque in row f of F for the group that sums the forces on the body."""
    store(F, f, remote_force.FORCE, force)
    store(F, f, remote_force.TORQUE, torque)


@njit(**BARE)
def gather_plate_contacts(n, slots, context, motion, tile):
    """Gather the contacts with plates slots[:n] into the first elements."""
    for q in range(n):
        gather_plate_contact(q, slots[q], context, motion, tile)


@njit(**BARE_CHUNK)
def gather_tile(n, slots, flat, context, motion, box, tile):
    """Gather contacts slots[:n] into a tile: geometry, slip, velocities, rotation, history. `flat`: all are with plates."""
    if flat:
        gather_plate_contacts(n, slots, context, motion, tile)
    else:
        gather_pair_contacts(n, slots, context, tile)
        pair_geometry(n, motion.dt, box, tile)
    transport_frames(n, motion.dt, tile)
    slip_increment(n, motion.dt, tile)
    if context.rolling > 0:
        for q in range(n):
            gather_rolling(q, slots[q], context, motion, tile)


@njit(**BARE_CHUNK)
def gather_moved(n, dt, context, tile):
    """Write the overlap that n contacts gained in the step, and one over its length."""
    behind = (law_input.HISTORY + context.n_history) * TILE
    for q in range(0, n, LANES):
        put(tile.inputs, q + behind + rolling_input.MOVED * TILE, broadcast(-dt) * separation_rate(q, tile.geometry))
        put(tile.inputs, q + behind + rolling_input.INVERSE_DT * TILE, broadcast(1.0 / dt if dt > 0.0 else 0.0))


@njit(**BARE)
def end_contacts(n, shift, opened, context, tile):
    """End the contacts opened[:n] that were closed; return the energy that they lost [J]. `shift`: see `tiles`.

    The loss is in the tile if `books` books it, else in the history (`memory.spring_energy`).
    """
    partner, body_of, outer, forces = context.partner, context.body, context.outer, context.forces
    total = 0.0
    for e in range(n):
        k = np.int64(opened[e])
        saved = reset_history(k, context)
        lost = tile.outputs[e + law_output.DISSIPATED * TILE] if context.force >= 0 else saved
        total += lost
        if context.measured > 0:
            measure_opened(k, lost, context)
        fraction = lost if is_plate(partner[k]) else BODY_FRACTION * lost
        forces[body_of[context.own[k]] + shift, body_force.FRICTION_WORK] += fraction
        if outer[k] >= 0:
            context.F[outer[k], remote_force.FRICTION_WORK] = fraction
        elif is_sphere(partner[k]):
            forces[body_of[partner[k]] + shift, body_force.FRICTION_WORK] += fraction
    return total
