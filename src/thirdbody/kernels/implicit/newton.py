"""Damped Newton's method for one step of one body; writes no history."""

import math

import numpy as np
from numba import njit

from thirdbody.jit.options import CHUNK, INNER
from thirdbody.kernels import first_body
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
from thirdbody.kernels.predicates import has_effect_columns, is_upper

CONVERGED, ACCEPTED = 1e-9, 1e-6
"""Tolerances of the residual over the sum of all forces: for convergence, and where the iteration stagnates at corners of the
laws. Where all contacts slip, only inertia resists, and the remaining residual moves the body: 1e-9 keeps that motion below the
error of a step."""

ROUNDING = 1e-15
"""Relative rounding error of heights; its effect on the contact forces is not counted as residual."""

ITERATIONS, HALVINGS, LEAPS = 16, 2, 4
"""Maximum iterations (beyond that, two half steps are cheaper), halvings of one correction, and corrections accepted although the
residual grows: where contacts change between stick and slip, Newton's method has to overshoot once to reach the other branch."""

REACH = 0.5
"""Largest growth of an overlap in one iteration, as a fraction of the largest overlap or of that expected under the load."""

AT_LIMIT, BACK = 1.0 - 1e-9, 0.05
"""A contact slips if its squared tangential force reaches this fraction of the squared limit; fraction of the critical slip by
which a correction may reverse it."""

FOUND, LOST, CROWDED = range(3)
"""Outcomes of `newton`: converged, not converged, more contacts than a tile holds."""


@njit(**CHUNK)
def solve_linear(J, r, n):
    """Overwrite r with the solution x of J x = -r (Gaussian elimination); False if J is singular.

    Not `numpy.linalg.solve`, which allocates, calls LAPACK for six or seven unknowns, and raises for a singular matrix.
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
    """Return the Euclidean norm of the residual [N]."""
    total = 0.0
    for k in range(FREEDOMS):
        total += r[k] * r[k]
    return math.sqrt(total)


@njit(**INNER)
def force_scale(b, p, y, dt, Z, B, E, P, diagnostics):
    """Return the sum of all acting forces [N], the scale of the residual."""
    move = math.sqrt(y[0] * y[0] + y[1] * y[1] + y[2] * y[2]) + math.sqrt(y[3] * y[3] + y[4] * y[4] + y[5] * y[5])
    weight = (
        abs(E[b, body_extra.EFFECT_FORCE]) + abs(E[b, body_extra.EFFECT_FORCE + 1]) + abs(E[b, body_extra.EFFECT_FORCE + 2])
        if has_effect_columns(E)
        else 0.0
    )
    free = P[p, patch.FREE]
    square = 1.0 / (dt * dt)
    # also of a patch without contacts: forces of its spring and dashpot; when unloaded, its nominal load
    patch_number = (
        max(P[p, patch.LOAD], P[p, patch.NOMINAL_LOAD])
        + P[p, patch.MASS] * abs(y[6]) * square
        + P[p, patch.DAMPING] * abs(P[p, patch.VELOCITY])
    )
    patch_number += P[p, patch.SPRING] * abs(P[p, patch.HEIGHT] - Z[step_start.PLATE_HEIGHT])
    return diagnostics[step_contacts.NORMAL_FORCE] + weight + B[b, body.MASS] * move * square + free * patch_number


@njit(**INNER)
def rounding_force(b, p, B, P, Z, diagnostics):
    """Return the residual [N] caused by rounding: overlaps are small differences of heights."""
    if diagnostics[step_contacts.MAX_OVERLAP] <= 0.0:
        return 0.0
    height = max(abs(B[b, body.POSITION + 2]) + Z[step_start.ARM], abs(P[p, patch.HEIGHT]))
    return (
        ROUNDING * height * 1.5 * diagnostics[step_contacts.NORMAL_FORCE] / diagnostics[step_contacts.MAX_OVERLAP]
    )  # Hertz: dN/dd = 1.5 N/d


@njit(**INNER)
def massless_at_rest(b, dt, share, r, Z, T, B, E, diagnostics, minimum):
    """Return whether the residual on a body without inertia is at most `share` of its own forces.

    Forces on its patch are excluded: otherwise a body that touches neither plate would count as balanced at any velocity. The
    remaining residual moves the body by `share` of a contact radius at most. `minimum`: rounding error [N].
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
    """Return the fraction of the correction x for which overlaps change by at most REACH `deep` [m].

    Limited are contacts that sink in, and the deepest contact of each plate, which must not open.
    """
    (own, partner, _, edges, incidence), S, P = spots, state[0], state[2]
    arm = 1.0 / Z[step_start.ARM]
    rotation = math.sqrt(x[3] * x[3] + x[4] * x[4] + x[5] * x[5]) * arm
    fraction = min(1.0, TURN / rotation) if rotation > 0.0 else 1.0
    most_up, most_low, change_up, change_low = 0.0, 0.0, 0.0, 0.0
    for e in range(edges[b], edges[b + 1]):
        k = incidence[e] >> 1
        i, up = own[k], is_upper(partner[k])
        at = first_body.centre(i, S)
        overlap, n_z = first_body.overlap(partner[k], at, S[i, sphere.RADIUS], P), first_body.normal(partner[k], at, P)[2]
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
    # the deepest contact of each plate stays closed, or the plate would drop out of the next iteration
    for maximum, change in ((most_up, change_up), (most_low, change_low)):
        if -change * fraction > REACH * max(maximum, deep):
            fraction = REACH * max(maximum, deep) / -change
    return fraction


@njit(**INNER)
def limit_slip_reversal(x, m, own, S, work, Z, share):
    """Return the fraction, at most `share`, of the correction x that reverses no slip.

    Between the two slip directions a contact sticks. Where all others slip, that is often the solution, and a full correction
    jumps over it.
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
        # ends just inside the friction limit
        margin = size * (size + BACK * O[law_output.CRITICAL_SLIP * TILE + q])
        if back * share > margin > 0.0:
            share = margin / back
    return share


@njit(**INNER)
def newton(b, p, dt, deep, time, inertial, v_x, v_y, spots, shape, state, known, work, Z, T, law, tangents, effects):
    """Solve for the coordinates y, from a guess in y; return outcome, contacts, iterations."""
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
            # at a stick-slip transition no fraction of the correction helps; the full one changes the branch
            halvings, leaps, part = halvings + 1, leaps + 1, whole
            continue
        better = better or halvings > HALVINGS
        for k in range(FREEDOMS):
            y[k] = tried[k]
        if now <= enough and (inertial != 0.0 or massless_at_rest(b, dt, CONVERGED, r, Z, T, B, E, diagnostics, minimum)):
            return FOUND, m, iterations
        if not better or iterations == ITERATIONS:
            # laws with corners do not converge to the last digits
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
