"""Newton's method for one step of one body: clipped, with a line search. It moves the body; nothing is remembered."""

import math

import numpy as np
from numba import njit

from thirdbody.jit.options import CHUNK, INNER
from thirdbody.kernels.columns import (
    body,
    body_extra,
    geometry,
    law_input,
    law_output,
    patch,
    sphere,
    step_contacts,
    step_memory,
    step_start,
)
from thirdbody.kernels.columns.tile import TILE
from thirdbody.kernels.implicit.jacobian import assemble_jacobian
from thirdbody.kernels.implicit.residual import FREEDOMS, TURN, active_contacts, residual, set_configuration
from thirdbody.kernels.narrow_phase import overlap_and_normal
from thirdbody.kernels.predicates import has_effect_columns, is_upper

CONVERGED, ACCEPTED = 1e-9, 1e-6
"""Largest unbalanced force as a share of all forces; and where the search gets no further: springs have corners.
In a direction in which all slips only inertia resists, so what is left unbalanced there moves the body: 1e-9 keeps that below the
error of a step."""

ROUNDING = 1e-15
"""Rounding of a height, in parts of it: what it changes in the forces of the spots does not count as unbalanced."""

ITERATIONS, HALVINGS, LEAPS = 16, 2, 4
"""Most corrections of a try (a step that needs more is cheaper in two halves), halvings of one correction, and corrections that
are kept although the unbalanced force grows: spots change between sticking and slipping, and Newton's method then has to
overshoot once before it finds the other branch."""

REACH = 0.5
"""Largest growth of an overlap in one iteration, in parts of the deepest one, or of the one that the load lets expect."""

AT_LIMIT, BACK = 1.0 - 1e-9, 0.05
"""A spot whose squared force reaches this share of its limit slips; part of the critical displacement by which it turns back."""

FOUND, LOST, CROWDED = range(3)
"""How `newton` ends: a balance, none, or more loaded spots than the law's tile holds."""


@njit(**CHUNK)
def solve_linear(J, r, n):
    """Overwrite r with the solution x of J x = -r by elimination with row pivots; False for a singular matrix.

    Not `numpy.linalg.solve`, which allocates, calls LAPACK for six unknowns, and raises where the matrix is singular.
    """
    for c in range(n):
        best, row = abs(J[c, c]), c
        for i in range(c + 1, n):
            if abs(J[i, c]) > best:
                best, row = abs(J[i, c]), i
        if not best > 0.0 or not best < 1e300:
            return False
        if row != c:
            for j in range(c, n):
                J[c, j], J[row, j] = J[row, j], J[c, j]
            r[c], r[row] = r[row], r[c]
        inverse = 1.0 / J[c, c]
        for i in range(c + 1, n):
            factor = J[i, c] * inverse
            if factor != 0.0:
                for j in range(c + 1, n):
                    J[i, j] -= factor * J[c, j]
                r[i] -= factor * r[c]
    for c in range(n - 1, -1, -1):
        x = r[c]
        for j in range(c + 1, n):
            x -= J[c, j] * r[j]
        r[c] = x / J[c, c]
    for c in range(n):
        r[c] = -r[c]
    return True


@njit(**INNER)
def residual_norm(r):
    """Euclidean norm of the unbalanced forces, N."""
    total = 0.0
    for k in range(FREEDOMS):
        total += r[k] * r[k]
    return math.sqrt(total)


@njit(**INNER)
def force_scale(b, p, y, dt, Z, B, E, P, diagnostics):
    """Sum of all forces at work, N: what the unbalanced ones are compared with."""
    move = math.sqrt(y[0] * y[0] + y[1] * y[1] + y[2] * y[2]) + math.sqrt(y[3] * y[3] + y[4] * y[4] + y[5] * y[5])
    weight = (
        abs(E[b, body_extra.EFFECT_FORCE]) + abs(E[b, body_extra.EFFECT_FORCE + 1]) + abs(E[b, body_extra.EFFECT_FORCE + 2])
        if has_effect_columns(E)
        else 0.0
    )
    free = P[p, patch.FREE]
    square = 1.0 / (dt * dt)
    # of a patch that touches nothing too: its spring pulls, its dashpot holds; without load, what it was loaded with counts
    patch_number = (
        max(P[p, patch.LOAD], P[p, patch.NOMINAL_LOAD])
        + P[p, patch.MASS] * abs(y[6]) * square
        + P[p, patch.DAMPING] * abs(P[p, patch.VELOCITY])
    )
    patch_number += P[p, patch.SPRING] * abs(P[p, patch.HEIGHT] - Z[step_start.PLATE_HEIGHT])
    return diagnostics[step_contacts.NORMAL_FORCE] + weight + B[b, body.MASS] * move * square + free * patch_number


@njit(**INNER)
def rounding_force(b, p, B, P, Z, diagnostics):
    """Force, N, below which the unbalanced one is rounding: overlaps are small differences of heights."""
    if diagnostics[step_contacts.MAX_OVERLAP] <= 0.0:
        return 0.0
    height = max(abs(B[b, body.POSITION + 2]) + Z[step_start.ARM], abs(P[p, patch.HEIGHT]))
    return (
        ROUNDING * height * 1.5 * diagnostics[step_contacts.NORMAL_FORCE] / diagnostics[step_contacts.MAX_OVERLAP]
    )  # Hertz: dN/dd = 1.5 N/d


@njit(**INNER)
def massless_at_rest(b, dt, share, r, Z, T, B, E, diagnostics, minimum):
    """Whether the forces on a body without inertia balance to this share of the forces on the body itself.

    Those on its patch do not count: a body that both plates have left carries none of them, and would otherwise be taken for
    balanced at any velocity. What may be left over then moves it by this share of a contact radius. `minimum`: rounding, N.
    """
    square = 0.0
    for k in range(6):
        square += r[k] * r[k]
    weight = (
        abs(E[b, body_extra.EFFECT_FORCE]) + abs(E[b, body_extra.EFFECT_FORCE + 1]) + abs(E[b, body_extra.EFFECT_FORCE + 2])
        if has_effect_columns(E)
        else 0.0
    )
    held = (Z[step_start.PULL] + Z[step_start.MASS_SHARE] * B[b, body.MASS] / (dt * dt)) * T[step_memory.CONTACT_RADIUS]
    return math.sqrt(square) <= max(share * (diagnostics[step_contacts.NORMAL_FORCE] + weight + held), minimum)


@njit(**INNER)
def limit_overlap_change(b, x, deep, spots, state, Z):
    """Share of the change x of the coordinates that lets no spot sink in, or lose its side, by more than REACH of `deep`."""
    (own, partner, _, edges, incidence), S, P = spots, state[0], state[2]
    arm = 1.0 / Z[step_start.ARM]
    rotation = math.sqrt(x[3] * x[3] + x[4] * x[4] + x[5] * x[5]) * arm
    fraction = min(1.0, TURN / rotation) if rotation > 0.0 else 1.0
    most_up, most_low, change_up, change_low = 0.0, 0.0, 0.0, 0.0
    for e in range(edges[b], edges[b + 1]):
        k = incidence[e] >> 1
        i, up = own[k], is_upper(partner[k])
        overlap, _, _, n_z = overlap_and_normal(k, own, partner, S, P, 0.0, 0.0)
        rise = x[2] + (x[3] * S[i, sphere.ARM + 1] - x[4] * S[i, sphere.ARM]) * arm - (x[6] if up else 0.0)
        change = -n_z * rise
        if change > 0.0:
            margin = REACH * deep + max(-overlap, 0.0)
            if change * fraction > margin:
                fraction = margin / change
        if up and overlap > most_up:
            most_up, change_up = overlap, change
        if not up and overlap > most_low:
            most_low, change_low = overlap, change
    # the deepest spot of a side stays closed, or the next iteration would know nothing of the plate
    for maximum, change in ((most_up, change_up), (most_low, change_low)):
        if -change * fraction > REACH * max(maximum, deep):
            fraction = REACH * max(maximum, deep) / -change
    return fraction


@njit(**INNER)
def limit_slip_reversal(x, m, own, S, work, Z, share):
    """Share of the change x, at most `fraction`, that brings no spot from slipping one way to slipping the other.

    In between it sticks. Where all other spots slip, that is often the answer, and a whole step jumps over it.
    """
    I, O, G, slots = work[0], work[1], work[3], work[4]  # noqa: E741
    arm = 1.0 / Z[step_start.ARM]
    for q in range(m):
        limit = O[law_output.FRICTION_LIMIT * TILE + q]
        t_x = O[law_output.TANGENTIAL_X * TILE + q]
        t_y = O[law_output.TANGENTIAL_Y * TILE + q]
        if t_x * t_x + t_y * t_y < AT_LIMIT * limit * limit:
            continue
        i = own[slots[q]]
        s_x, s_y = I[law_input.SLIP_X * TILE + q], I[law_input.SLIP_Y * TILE + q]
        r_x = S[i, sphere.ARM]
        r_y = S[i, sphere.ARM + 1]
        r_z = S[i, sphere.ARM + 2] - G[q + geometry.ARM * TILE] * G[q + (geometry.NORMAL + 2) * TILE]
        d_x = x[0] + (x[4] * r_z - x[5] * r_y) * arm
        d_y = x[1] + (x[5] * r_x - x[3] * r_z) * arm
        along_1 = d_x * G[q + geometry.AXIS * TILE] + d_y * G[q + (geometry.AXIS + 1) * TILE]
        along_2 = d_x * G[q + geometry.CROSS_AXIS * TILE] + d_y * G[q + (geometry.CROSS_AXIS + 1) * TILE]
        size = math.sqrt(s_x * s_x + s_y * s_y)
        back = -(along_1 * s_x + along_2 * s_y)
        # just inside what it can bear
        margin = size * (size + BACK * O[law_output.CRITICAL_SLIP * TILE + q])
        if back * share > margin > 0.0:
            share = margin / back
    return share


@njit(**INNER)
def newton(b, p, dt, deep, time, inertial, v_x, v_y, spots, shape, state, known, work, Z, T, law, tangents, effects):
    """Find the end y of a step from the guess that it holds; (how it ended, number of staged spots, iterations)."""
    y, r, x, tried, J, diagnostics = work[6], work[7], work[8], work[9], work[10], work[11]
    S, B, P, _, _, E = state
    size, part, whole, halvings, leaps, iterations, m = 1e300, 0.0, 0.0, 0, 0, 0, np.int64(0)
    for k in range(FREEDOMS):
        x[k] = 0.0
    while True:
        for k in range(FREEDOMS):
            tried[k] = y[k] + part * x[k]
        set_configuration(b, p, tried, dt, Z, T, shape, state)
        m = active_contacts(b, dt, Z[step_start.NOW] / dt, v_x, v_y, spots, shape, state, known, work)
        if m < 0:
            return CROWDED, m, iterations
        residual(b, p, m, tried, dt, time, inertial, spots, state, known, work, Z, T, law, effects, r, diagnostics)
        now, scale = residual_norm(r), force_scale(b, p, tried, dt, Z, B, E, P, diagnostics)
        minimum = rounding_force(b, p, B, P, Z, diagnostics)
        enough = max(CONVERGED * scale, minimum)
        if not now < 1e300:
            return LOST, m, iterations
        better = now < (1.0 - 1e-4 * part) * size
        if not better and halvings < HALVINGS:
            halvings, part = halvings + 1, 0.5 * part
            continue
        if not better and halvings == HALVINGS and leaps < LEAPS and now > enough:
            # at the border between stick and slip no part of the step helps, and the whole one changes sides
            halvings, leaps, part = halvings + 1, leaps + 1, whole
            continue
        better = better or halvings > HALVINGS
        for k in range(FREEDOMS):
            y[k] = tried[k]
        if now <= enough and (inertial != 0.0 or massless_at_rest(b, dt, CONVERGED, r, Z, T, B, E, diagnostics, minimum)):
            return FOUND, m, iterations
        if not better or iterations == ITERATIONS:
            # the last digits of a law with corners do not settle
            result = now <= ACCEPTED * scale
            result = result and (inertial != 0.0 or massless_at_rest(b, dt, ACCEPTED, r, Z, T, B, E, diagnostics, minimum))
            return (FOUND if result else LOST), m, iterations
        size, halvings, iterations = now, 0, iterations + 1
        assemble_jacobian(b, p, m, dt, spots, state, known, work, Z, tangents, False, J)
        for k in range(FREEDOMS):
            x[k] = r[k]
        if not solve_linear(J, x, FREEDOMS):
            return LOST, m, iterations
        part = limit_overlap_change(b, x, max(deep, diagnostics[step_contacts.MAX_OVERLAP]), spots, state, Z)
        part = whole = limit_slip_reversal(x, m, spots[0], S, work, Z, part)
