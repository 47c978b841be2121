"""Energy that the dashpots of contacts dissipate in an accepted implicit step.

A step uses the forces at its end. What bodies exchange is, to second order, the work of the mean of the forces at both ends: for
dashpots as for friction (`explicit.contact_dissipation`). Where forces jump (`friction_work.weight_of_old`) and without inertia,
whose steps all begin at rest, it is the work of the force at the end. The forces are kept in the history, as in explicit steps.
"""

from numba import njit

from thirdbody.jit.options import BARE
from thirdbody.kernels.explicit.contact_dissipation import has_dashpot_moments
from thirdbody.kernels.implicit.residual import depth_at
from thirdbody.kernels.implicit.tables import step_settings
from thirdbody.kernels.packed_triple import pack_triple, unpack_triple
from thirdbody.kernels.predicates import is_closed
from thirdbody.kernels.rolling_kinematics import has_twist
from thirdbody.kernels.tables import contact_state, record
from thirdbody.kernels.tile import TILE, law_input, law_output, rolling_input, rolling_output


@njit(**BARE)
def mean_velocity_factor(q, dt, before, context, I):  # noqa: E741
    """Return the mean velocity of contact q in the step over that at its end, in [0, 2]."""
    n = I[law_input.NORMAL_VELOCITY * TILE + q]
    x = I[law_input.VELOCITY_X * TILE + q]
    y = I[law_input.VELOCITY_Y * TILE + q]
    square = n * n + x * x + y * y
    along = -n * (depth_at(q, context, I) - before) + x * I[law_input.SLIP_X * TILE + q] + y * I[law_input.SLIP_Y * TILE + q]
    return min(max(along / (dt * square), 0.0), 2.0) if square > 0.0 else 1.0


@njit(**BARE)
def loss_of_end(q, before, dt, context, tile):
    """Return the energy [J] that the dashpots of contact q dissipate by their forces at the end of the step."""
    return tile.outputs[law_output.DASHPOT_POWER * TILE + q] * mean_velocity_factor(q, dt, before, context, tile.inputs) * dt


@njit(**BARE)
def loss_of_mean(q, before, context, tile):
    """Return the energy [J] that the dashpots of contact q dissipate by the mean of their forces; at least 0.

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
    O[to] = pack_triple(
        O[new + rolling_output.VISCOUS_NORMAL * TILE],
        O[new + rolling_output.VISCOUS_X * TILE],
        O[new + rolling_output.VISCOUS_Y * TILE],
    )
    if has_dashpot_moments(context):
        x, y = O[new + rolling_output.VISCOUS_MOMENT_X * TILE], O[new + rolling_output.VISCOUS_MOMENT_Y * TILE]
        O[to + TILE] = pack_triple(x, y, O[new + rolling_output.VISCOUS_TWIST * TILE] if has_twist(context) else 0.0)


@njit(**BARE)
def has_forces(context):
    """Return whether the history has the forces of the dashpots at the start of the step; without inertia they begin at rest."""
    return context.dashpots >= 0 and context.settings[step_settings.INERTIAL] != 0.0


@njit(**BARE)
def dashpot_loss(q, k, before, of_mean, dt, context, tile):
    """Return the energy [J] that the dashpots of contact q, candidate k, dissipate in the step; keep their forces.

    `before`: overlap plus reach at the start of the step [m]; `of_mean`: whether forces are continuous in the step. A contact
    without normal force is about to open: its dashpot cancels the elastic force and dissipates what that releases. To be called
    before the history and the record of the contact are overwritten.
    """
    R, O = context.R, tile.outputs  # noqa: E741
    if context.dashpots >= 0:
        keep_dashpot_forces(q, context, O)
    if is_closed(k, context.H) and R[k, record.NORMAL_FORCE] == 0.0 and O[law_output.NORMAL_FORCE * TILE + q] == 0.0:
        return R[k, record.STORED_NORMAL] - O[law_output.STORED_NORMAL * TILE + q]
    if of_mean and has_forces(context):
        return loss_of_mean(q, before, context, tile)
    return loss_of_end(q, before, dt, context, tile)


@njit(**BARE)
def opening_loss(k, before, of_mean, context):
    """Return the energy [J] that the dashpots of candidate k dissipate in the step in which it opens.

    Without normal force at the start of the step it is all that was stored: nothing accelerates the body, and one step can lead
    from there to the open contact. To be called before the history is cleared.
    """
    if context.R[k, record.NORMAL_FORCE] == 0.0:
        return context.R[k, record.STORED_NORMAL]
    if not (of_mean and has_forces(context)):
        return 0.0
    n, _, _ = unpack_triple(context.H[k, contact_state.LAW + context.dashpots])
    return max(-0.5 * n * max(before, 0.0), 0.0)
