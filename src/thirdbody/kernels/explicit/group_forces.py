"""Forces on the bodies of a group while its contacts are summed, in rows that stay in the cache (`body_force`).

The row of a body gets them at the end, when its velocities predicted for the end of the step are no longer needed.
"""

import numpy as np
from numba import njit

from thirdbody.jit.options import BARE
from thirdbody.jit.simd import broadcast, load, store, with_last
from thirdbody.kernels.explicit.tables import body_force
from thirdbody.kernels.tables import body


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
