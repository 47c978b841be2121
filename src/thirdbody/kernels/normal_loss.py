"""Losses of normal laws, per body: plastic flow, necks. The history has what the law has dissipated since the contact closed.

Kernels run only where `context.loss_column`, the column of the history, is not negative.
"""

import numpy as np
from numba import njit

from thirdbody.jit.options import BARE, BARE_CHUNK
from thirdbody.kernels.predicates import is_plate
from thirdbody.kernels.tables import body, body_extra, remote_force
from thirdbody.kernels.tile import TILE, law_input, law_output

HALF = 0.5
"""Fraction of the loss between two bodies that each of them gets."""


@njit(**BARE)
def normal_loss_of(q, column, tile):
    """Return the loss of contact q in the step [J]; `column` of the history."""
    return tile.outputs[(law_output.HISTORY + column) * TILE + q] - tile.inputs[(law_input.HISTORY + column) * TILE + q]


@njit(**BARE_CHUNK)
def add_normal_losses(n, slots, context, tile):
    """Add the losses of the contacts slots[:n] to their bodies; that of a body of another group to its row of F."""
    E, body_of = context.E, context.body
    for q in range(n):
        k, work = np.int64(slots[q]), normal_loss_of(q, context.loss_column, tile)
        i, j = context.own[k], context.partner[k]
        if is_plate(j):
            E[body_of[i], body_extra.NORMAL_LOSS] += work
            continue
        E[body_of[i], body_extra.NORMAL_LOSS] += HALF * work
        if context.outer[k] >= 0:
            context.F[context.outer[k], remote_force.NORMAL_LOSS] = HALF * work
        else:
            E[body_of[j], body_extra.NORMAL_LOSS] += HALF * work


@njit(**BARE)
def friction_work_of(b, B, E, column):
    """Return the friction work of body b since the start [J], without that loss; `column`: -1 without one."""
    loss = E[b, body_extra.NORMAL_LOSS] if column >= 0 else 0.0
    return B[b, body.FRICTION_WORK] - loss
