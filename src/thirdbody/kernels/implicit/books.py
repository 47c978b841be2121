"""Books of the contacts of an accepted step, with plates and between bodies: what they dissipated, their histories and records.

A step uses the forces at its end. What bodies exchange is, to second order, the work of the mean of the forces at both ends: for
dashpots as for friction (`kernels.books`). Where forces jump (`smooth` is false, `work.weight_of_old`) and without inertia, whose
steps all begin at rest, it is the work of the force at the end. The forces of dashpots are kept in the history, as in explicit
steps. Called through pointers, so that plates and pairs are compiled without.
"""

from numba import njit, types

from thirdbody.jit.arguments import function_at
from thirdbody.jit.options import BARE, NO_COUNTS, POINTED, entry
from thirdbody.kernels.books import book, has_dashpot_moments, pack_triple, unpack_triple
from thirdbody.kernels.explicit.contact_forces import write_record
from thirdbody.kernels.implicit.residual import depth_at
from thirdbody.kernels.implicit.tables import step_settings
from thirdbody.kernels.implicit.work import loss_of_end
from thirdbody.kernels.implicit.workspace import CONTEXT, MOTION, SPACE_TYPE
from thirdbody.kernels.measures import measure_contact, measure_opened
from thirdbody.kernels.memory import reset_history, spring_energy, store_history
from thirdbody.kernels.plates import is_closed
from thirdbody.kernels.rolling_kinematics import has_twist
from thirdbody.kernels.tables import contact_state, record
from thirdbody.kernels.tile import TILE, law_input, law_output, rolling_input, rolling_output

_D, _B, _I, _ROW = types.float64, types.boolean, types.int64, types.Array(types.float64, 1, "C")

BOOK = types.void(_I, _ROW, _I, _B, _D, CONTEXT, SPACE_TYPE)
WRITE = types.void(_I, MOTION, CONTEXT, SPACE_TYPE)
END = types.UniTuple(_D, 2)(_I, _D, _D, _B, CONTEXT)

book_at, write_at, end_at = function_at(BOOK), function_at(WRITE), function_at(END)


@njit(**BARE)
def loss_of_mean(q, before, context, tile):
    """Return the energy [J] that the dashpots of contact q dissipate by the mean of their forces, and keep these; at least 0.

    `before`: overlap plus reach at the start of the step [m]; a contact that closes moves with its dashpots by its overlap.
    """
    I, O = tile.inputs, tile.outputs  # noqa: E741
    n, x, y = unpack_triple(I[(law_input.HISTORY + context.dashpots) * TILE + q])
    new, displaced = (law_output.HISTORY + context.n_history) * TILE + q, (law_input.HISTORY + context.n_history) * TILE + q
    work = (n + O[new + rolling_output.VISCOUS_NORMAL * TILE]) * (max(before, 0.0) - depth_at(q, context, I))
    work += (x + O[new + rolling_output.VISCOUS_X * TILE]) * I[law_input.SLIP_X * TILE + q]
    work += (y + O[new + rolling_output.VISCOUS_Y * TILE]) * I[law_input.SLIP_Y * TILE + q]
    if has_dashpot_moments(context):
        u, v, w = unpack_triple(I[(law_input.HISTORY + context.dashpots + 1) * TILE + q])
        work += (u + O[new + rolling_output.VISCOUS_MOMENT_X * TILE]) * I[displaced + rolling_input.ROTATION_X * TILE]
        work += (v + O[new + rolling_output.VISCOUS_MOMENT_Y * TILE]) * I[displaced + rolling_input.ROTATION_Y * TILE]
        if has_twist(context):
            work += (w + O[new + rolling_output.VISCOUS_TWIST * TILE]) * I[displaced + rolling_input.TWIST * TILE]
    return max(-0.5 * work, 0.0)


@njit(**BARE)
def keep_dashpot_forces(q, context, O):  # noqa: E741
    """Write the forces and, if any, the moments of the dashpots of contact q into the history."""
    new, to = (law_output.HISTORY + context.n_history) * TILE + q, (law_output.HISTORY + context.dashpots) * TILE + q
    x, y = O[new + rolling_output.VISCOUS_X * TILE], O[new + rolling_output.VISCOUS_Y * TILE]
    O[to] = pack_triple(O[new + rolling_output.VISCOUS_NORMAL * TILE], x, y)
    if has_dashpot_moments(context):
        x, y = O[new + rolling_output.VISCOUS_MOMENT_X * TILE], O[new + rolling_output.VISCOUS_MOMENT_Y * TILE]
        O[to + TILE] = pack_triple(x, y, O[new + rolling_output.VISCOUS_TWIST * TILE] if has_twist(context) else 0.0)


@entry(BOOK, **POINTED, **NO_COUNTS)
def book_contacts(n, before, first, smooth, dt, context, tile):
    """Write what friction and dashpots of the n contacts of a tile dissipate to DISSIPATED and DASHPOT_POWER [J].

    `before`: overlaps plus reach of the candidates from `first` on at the start of the step [m]. Where friction has ended in the
    step without its energy being booked, as the dashpot of a departing sphere cancelled its normal force, no force does work: all
    that was stored is dissipated, as in a contact that opens. So is what a contact without normal force releases that is about to
    open: its dashpot cancels the elastic force.
    """
    O, R, slots, of_mean = tile.outputs, context.R, tile.slots, smooth and context.force >= 0  # noqa: E741
    if of_mean:
        book(n, context, tile)
    for q in range(0 if of_mean else n):
        ended = O[law_output.TANGENTIAL_X * TILE + q] == 0.0 and O[law_output.TANGENTIAL_Y * TILE + q] == 0.0
        if ended and O[law_output.STORED_TANGENTIAL * TILE + q] == 0.0:
            unbooked = spring_energy(slots[q], context) - O[law_output.DISSIPATED * TILE + q]
            O[law_output.DISSIPATED * TILE + q] += max(unbooked, 0.0)
    for q in range(n):
        k = slots[q]
        if context.dashpots >= 0:
            keep_dashpot_forces(q, context, O)
        if is_closed(k, context.H) and R[k, record.NORMAL_FORCE] == 0.0 and O[law_output.NORMAL_FORCE * TILE + q] == 0.0:
            damped = R[k, record.STORED_NORMAL] - O[law_output.STORED_NORMAL * TILE + q]
        elif smooth and context.dashpots >= 0 and context.settings[step_settings.INERTIAL] != 0.0:
            damped = loss_of_mean(q, before[k - first], context, tile)
        else:
            damped = loss_of_end(q, before[k - first], dt, context, tile)
        O[law_output.DASHPOT_POWER * TILE + q] = damped


@entry(WRITE, **POINTED, **NO_COUNTS)
def write_contacts(n, motion, context, tile):
    """Store histories and records of the n contacts of a tile, and what they measure."""
    store_history(n, tile.slots, context, tile)
    for q in range(n):
        write_record(q, tile.slots[q], context, motion, tile)
        if context.measured > 0:
            measure_contact(q, tile.slots[q], motion.dt, context, tile)


@entry(END, **POINTED, **NO_COUNTS)
def end_contact(k, before, dragged, smooth, context):
    """End candidate k, which opens within the step; return what its friction and its dashpots dissipate in it [J].

    `before`: overlap plus reach at the start of the step [m]; `dragged`: work of its tangential spring [J]. Without normal force
    at the start of the step the dashpots dissipate all that was stored: nothing accelerates the body, and one step can lead from
    there to the open contact.
    """
    damped = 0.0
    if context.R[k, record.NORMAL_FORCE] == 0.0:
        damped = context.R[k, record.STORED_NORMAL]
    elif smooth and context.dashpots >= 0 and context.settings[step_settings.INERTIAL] != 0.0:
        n, _, _ = unpack_triple(context.H[k, contact_state.LAW + context.dashpots])
        damped = max(-0.5 * n * max(before, 0.0), 0.0)
    friction = max(reset_history(k, context) + dragged, 0.0)
    if context.measured > 0:
        measure_opened(k, friction, context)
    return friction, damped
