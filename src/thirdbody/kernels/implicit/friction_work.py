"""Friction work in an implicit step: error, and work of contacts that open within the step.

A rolling body dissipates only while load passes from one contact to the next: over some nanometres, with work far below that of
a sliding body and too small to show in the position error. Step lengths are therefore also controlled by an energy error.
"""

import math

import numpy as np
from numba import njit

from thirdbody.jit.options import INNER
from thirdbody.kernels.bundles import Motion
from thirdbody.kernels.columns import body, contact_state, law_input, law_output, sphere, step_memory
from thirdbody.kernels.columns.tile import TILE
from thirdbody.kernels.implicit.contact_context import contact_context
from thirdbody.kernels.narrow_phase import plate_overlap
from thirdbody.kernels.predicates import is_closed, is_upper

FLOOR = 0.02
"""Floor of the scale of the friction-work error, as a fraction of friction limit times critical slip summed over the contacts: a
tenth of what is dissipated when the set of loaded contacts changes once."""

LEAST = 1e5
"""Shortest step cut for this error, in units of the shortest step tried."""

GROWN = 0.75
"""Error of the tangential force of a contact whose radius changes within the step, over relative change of radius times friction
limit times slip over critical slip: laws use the stiffness 2 G* a = 1.5 limit/critical at the end of the step, while the mean
over the step would differ by half the change."""

CALM = 0.01
"""Largest dashpot work, as a fraction of the tangential work, for which forces count as continuous at a breakpoint."""


@njit(**INNER)
def weight_of_old(m, dt, last, power, work):
    """Return the weight of the force at the start of a step in its work: 0.5, or 0 where forces jump.

    The work is that of the plate and of friction. Forces jump with the velocity at a breakpoint of the motion (`last` = 0) if the
    dashpots of the m contacts, of `power` [W], dissipate more than CALM of the work of the tangential forces.
    """
    I, O, taken = work[0], work[1], 0.0  # noqa: E741
    for q in range(m):
        taken += abs(O[law_output.TANGENTIAL_X * TILE + q] * I[law_input.SLIP_X * TILE + q]) + abs(
            O[law_output.TANGENTIAL_Y * TILE + q] * I[law_input.SLIP_Y * TILE + q]
        )
    return 0.5 if last > 0.0 or power * dt <= CALM * taken else 0.0


@njit(**INNER)
def dragged_off(k, before, motion, context):
    """Return the slip work [J] of the tangential spring of candidate k, which opens within the step.

    Its force falls to zero. `before`: overlap [m] at the start of the step.
    """
    S, H, force, dt = context.S, context.H, context.force, motion.dt
    i, up = context.own[k], 1.0 if is_upper(context.partner[k]) else 0.0
    n, r = 1.0 - 2.0 * up, S[i, sphere.RADIUS]
    x = S[i, sphere.MID_VELOCITY] - r * n * S[i, sphere.MID_SPIN + 1] - up * motion.v_x
    y = S[i, sphere.MID_VELOCITY + 1] + r * n * S[i, sphere.MID_SPIN] - up * motion.v_y
    f_1 = H[k, contact_state.LAW + force]
    f_2 = H[k, contact_state.LAW + force + 1]
    e_x = H[k, contact_state.AXIS]
    e_y = H[k, contact_state.AXIS + 1]
    fraction = before / max(before - plate_overlap(k, context), 1e-300)
    return -0.5 * fraction * dt * ((f_1 * e_x - f_2 * n * e_y) * x + (f_1 * e_y + f_2 * n * e_x) * y)


@njit(**INNER)
def energy_of_spots(m, I, O):  # noqa: E741
    """Return the sum [J] of friction limit times critical slip, each at most N times overlap."""
    total = 0.0
    for q in range(m):
        pressed = abs(O[q + law_output.NORMAL_FORCE * TILE]) * I[q + law_input.OVERLAP * TILE]
        total += min(O[q + law_output.FRICTION_LIMIT * TILE] * O[q + law_output.CRITICAL_SLIP * TILE], pressed)
    return total


@njit(**INNER)
def differing(m, force, stored, before, b, spots, work):
    """Return the estimated error [J] of the friction work, summed over m contacts.

    It is the difference between the work of the mean force and of the force at the end of the step, plus the effect of a
    changing contact radius (`GROWN`).
    """
    first, I, O, slots = spots[3][b], work[0], work[1], work[4]  # noqa: E741
    total = 0.0
    for q in range(m):
        old, new = (law_input.HISTORY + force) * TILE + q, (law_output.HISTORY + force) * TILE + q
        s_x, s_y = I[q + law_input.SLIP_X * TILE], I[q + law_input.SLIP_Y * TILE]
        taken = (I[old] + O[new]) * s_x + (I[old + TILE] + O[new + TILE]) * s_y
        lost = I[(law_input.HISTORY + stored) * TILE + q] - 0.5 * taken - O[q + law_output.STORED_TANGENTIAL * TILE]
        slip = min(math.sqrt(s_x * s_x + s_y * s_y), O[q + law_output.CRITICAL_SLIP * TILE])
        fraction = math.sqrt(max(before[slots[q] - first], 0.0) / I[q + law_input.OVERLAP * TILE])
        total += (
            abs(lost - O[q + law_output.FRICTION_LOSS * TILE])
            + GROWN * min(abs(1.0 - fraction), 1.0) * O[q + law_output.FRICTION_LIMIT * TILE] * slip
        )
    return total


@njit(**INNER)
def kinetic(b, B, arm):
    """Return the approximate kinetic energy [J] of body b; `arm` [m]: radius of gyration used."""
    total = 0.0
    for k in range(3):
        total += B[b, body.VELOCITY + k] ** 2 + (arm * B[b, body.SPIN + k]) ** 2
    return 0.5 * B[b, body.MASS] * total


@njit(**INNER)
def work_error(b, m, dt, v_x, v_y, allowed, arm, spots, state, known, work, T):
    """Return the error of the friction work of the step over the tolerance.

    The tolerance is `allowed` times a scale of energy: the body's friction work so far, plus FLOOR times its kinetic energy and
    the energy that its contacts can store (largest so far: step_memory.MAX_ENERGY [J]).
    """
    force, edges, incidence, B, H = known[8], spots[3], spots[4], state[1], state[3]
    O, slots, before = work[1], work[4], work[5]  # noqa: E741
    if force < 0:
        return 0.0
    error, q = differing(m, force, known[7], before, b, spots, work), np.int64(0)
    for e in range(edges[b], edges[b + 1]):
        k = incidence[e] >> 1
        if q < m and slots[q] == k:
            q += 1
        elif is_closed(k, H):
            error += abs(dragged_off(k, before[e - edges[b]], Motion(dt, v_x, v_y), contact_context(spots, state, known)))
    held = max(T[step_memory.MAX_ENERGY], energy_of_spots(m, work[0], O))
    return error / max(allowed * (B[b, body.FRICTION_WORK] + FLOOR * (held + kinetic(b, B, arm))), 1e-300)
