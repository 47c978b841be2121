"""Damped Newton's method for one step of one body; writes no history."""

import math
from enum import IntEnum

import numpy as np
from numba import njit

from thirdbody.jit.options import BARE, BARE_CHUNK
from thirdbody.kernels import first_body
from thirdbody.kernels.close_spots import interact
from thirdbody.kernels.implicit.bundles import FREEDOMS
from thirdbody.kernels.implicit.candidates import last_candidate
from thirdbody.kernels.implicit.jacobian import assemble_jacobian
from thirdbody.kernels.implicit.residual import (
    MAX_ROTATION,
    active_contacts,
    contact_point,
    frame_of,
    residual,
    set_configuration,
)
from thirdbody.kernels.implicit.tables import step_contacts, step_memory, step_settings, step_start
from thirdbody.kernels.implicit.vector_algebra import dot
from thirdbody.kernels.predicates import has_effect_columns, is_upper
from thirdbody.kernels.tables import body, body_extra, height_field, patch, sphere
from thirdbody.kernels.tile import TILE, geometry, law_input, law_output

CONVERGED, ACCEPTED = 1e-9, 1e-6
"""Tolerances of the residual over the sum of all forces: for convergence, and where the iteration stagnates at corners of the
laws. Where all contacts slip, only inertia resists, and the remaining residual moves the body: 1e-9 keeps that motion below the
error of a step."""

ROUNDING = 1e-15
"""Relative rounding error of heights; its effect on the contact forces is not counted as residual."""

SETTLED, SETTLED_RADII, SETTLED_FORCE = 1e-3, 1e-6, 1e-8
"""With inertia the iteration also ends before a correction of at most SETTLED times the error allowed in a step and SETTLED_RADII
contact radii, where the residual is at most SETTLED_FORCE of all forces: with 1e-7 the energy balance of a flake that tips is off
by 2e-6. Not where body effects change from one iteration to the next: the Jacobian leaves them out."""

CONTRACTS = 0.1
"""Largest ratio of two successive residuals for which the factors of the last Jacobian tell the next correction: what it leaves
out (turning frames) is then small."""

ITERATIONS, LEAPS = 10, 4
"""Maximum iterations (beyond that, two half steps are cheaper), and corrections accepted although the residual grows: where
contacts change between stick and slip, Newton's method has to overshoot to reach the other branch. Corrections are not halved
instead: of 1000 clumps that slide 100 um half as many steps fail without, in a third fewer evaluations."""

OVERLAP_GROWTH = 0.5
"""Largest growth of an overlap in one iteration, as a fraction of the largest overlap or of that expected under the load."""

AT_LIMIT, BACK = 1.0 - 1e-9, 0.05
"""A contact slips if its squared tangential force reaches this fraction of the squared limit; fraction of the critical slip by
which a correction may reverse it."""


class Outcome(IntEnum):
    """Outcomes of `newton`."""

    SOLVED = 0
    UNSOLVED = 1
    CROWDED = 2
    """The body has more contacts than a tile holds."""


@njit(**BARE_CHUNK)
def factorise(J, pivots, n):
    """Overwrite J (n, n) with its triangular factors (Gaussian elimination with row pivots); False if J is singular.

    The diagonal of the upper factor is stored inverted.
    Not `numpy.linalg.solve`, which allocates, calls LAPACK for six or seven unknowns, and raises for a singular matrix.
    """
    for c in range(n):
        best, row = abs(J[c, c]), c
        for i in range(c + 1, n):
            if abs(J[i, c]) > best:
                best, row = abs(J[i, c]), i
        if not best > 0.0 or not best < 1e300:
            return False
        pivots[c] = row
        if row != c:
            for j in range(n):
                J[c, j], J[row, j] = J[row, j], J[c, j]
        inverse = 1.0 / J[c, c]
        J[c, c] = inverse
        for i in range(c + 1, n):
            factor = J[i, c] * inverse
            J[i, c] = factor
            if factor != 0.0:
                for j in range(c + 1, n):
                    J[i, j] -= factor * J[c, j]
    return True


@njit(**BARE)
def substitute(J, pivots, r, n):
    """Overwrite r with the solution x of A x = -r, where J and `pivots` are the factors of A (`factorise`).

    Column by column, so that the sums of all rows advance side by side; `n` is a constant where this is inlined.
    """
    for c in range(n):
        row = pivots[c]
        r[c], r[row] = r[row], r[c]
    for c in range(n):
        for i in range(c + 1, n):
            r[i] -= J[i, c] * r[c]
    for c in range(n - 1, -1, -1):
        x = -r[c] * J[c, c]
        r[c] = x
        for i in range(c):
            r[i] += J[i, c] * x


@njit(**BARE)
def euclidean_norm(r):
    """Return the Euclidean norm of a residual or a correction (7,)."""
    total = 0.0
    for k in range(FREEDOMS):
        total += r[k] * r[k]
    return math.sqrt(total)


@njit(**BARE)
def effect_size(b, E):
    """Return the sum of the sizes of the components of the effects' force on body b [N]."""
    if not has_effect_columns(E):
        return 0.0
    return abs(E[b, body_extra.EFFECT_FORCE]) + abs(E[b, body_extra.EFFECT_FORCE + 1]) + abs(E[b, body_extra.EFFECT_FORCE + 2])


@njit(**BARE)
def effects_on(b, E):
    """Return a number that changes with force or torque of the effects on body b."""
    total = 0.0
    if has_effect_columns(E):
        for k in range(3):
            total += (k + 1) * (E[b, body_extra.EFFECT_FORCE + k] + E[b, body_extra.EFFECT_TORQUE + k])
    return total


@njit(**BARE)
def force_scale(context, active, y, dt, diagnostics):
    """Return the sum of all acting forces [N], the scale of the residual."""
    b, p, P = active.number, active.patch, context.P
    move = math.sqrt(y[0] * y[0] + y[1] * y[1] + y[2] * y[2]) + math.sqrt(y[3] * y[3] + y[4] * y[4] + y[5] * y[5])
    square = 1.0 / (dt * dt)
    # also of a patch without contacts: forces of its spring and dashpot; when unloaded, its nominal load
    patch_number = (
        max(P[p, patch.LOAD], P[p, patch.NOMINAL_LOAD])
        + P[p, patch.MASS] * abs(y[6]) * square
        + P[p, patch.DAMPING] * abs(P[p, patch.VELOCITY])
    )
    patch_number += P[p, patch.SPRING] * abs(P[p, patch.HEIGHT] - active.start[step_start.PLATE_HEIGHT])
    forces = diagnostics[step_contacts.NORMAL_FORCE] + effect_size(b, context.E)
    return forces + context.B[b, body.MASS] * move * square + P[p, patch.FREE] * patch_number


@njit(**BARE)
def steepest(field):
    """Return a bound of the slope of a surface."""
    return field[height_field.MAX_SLOPE] if field.shape[0] > 0 else 0.0


@njit(**BARE)
def rounding_force(context, active, diagnostics):
    """Return the residual [N] caused by rounding: overlaps are small differences of coordinates, on planes of heights alone."""
    b, B = active.number, context.B
    radius = abs(B[b, body.POSITION + 2])
    if first_body.is_rough(context):
        slope = max(steepest(context.lower), steepest(context.upper))
        radius = max(radius, slope * abs(B[b, body.POSITION]), slope * abs(B[b, body.POSITION + 1]))
    radius = max(radius + active.start[step_start.ARM], abs(context.P[active.patch, patch.HEIGHT]))
    return rounding_at(radius, diagnostics)


@njit(**BARE)
def rounding_at(coordinate, diagnostics):
    """Return the residual [N] caused by rounding of a coordinate [m]."""
    if diagnostics[step_contacts.MAX_OVERLAP] <= 0.0:
        return 0.0
    # Hertz: dN/dd = 1.5 N/d
    return ROUNDING * coordinate * 1.5 * diagnostics[step_contacts.NORMAL_FORCE] / diagnostics[step_contacts.MAX_OVERLAP]


@njit(**BARE)
def is_balanced(context, active, dt, fraction, minimum, space):
    """Return whether the residual on a body without inertia is at most `fraction` of its own forces; True with inertia.

    Forces on its patch are excluded: otherwise a body that touches neither plate would count as balanced at any velocity. The
    remaining residual moves the body by `fraction` of a contact radius at most. `minimum`: rounding error [N].
    """
    if context.settings[step_settings.INERTIAL] != 0.0:
        return True
    b, Z, square = active.number, active.start, 0.0
    for k in range(6):
        square += space.residual[k] * space.residual[k]
    resistance = Z[step_start.TETHER_STIFFNESS] + Z[step_start.MASS_FRACTION] * context.B[b, body.MASS] / (dt * dt)
    stored = resistance * active.memory[step_memory.CONTACT_RADIUS]
    forces = space.diagnostics[step_contacts.NORMAL_FORCE] + effect_size(b, context.E) + stored
    return math.sqrt(square) <= max(fraction * forces, minimum)


@njit(**BARE)
def displacement(x, arm, r, upper):
    """Return the displacement (3,) [m] relative to its plate of a point of the body by the correction x of the coordinates.

    `arm`: one over the arm of the body [1/m]; `r`: the point from the centre of mass [m].
    """
    return (
        x[0] + (x[4] * r[2] - x[5] * r[1]) * arm,
        x[1] + (x[5] * r[0] - x[3] * r[2]) * arm,
        x[2] + (x[3] * r[1] - x[4] * r[0]) * arm - (x[6] if upper else 0.0),
    )


@njit(**BARE)
def limit_overlap_change(context, active, expected_overlap, space):
    """Return the fraction of the correction for which overlaps change by at most OVERLAP_GROWTH `expected_overlap` [m].

    Limited are contacts that sink in, and the deepest contact of each plate, which must not open.
    """
    b, x, S, arm = active.number, space.correction, context.S, 1.0 / active.start[step_start.ARM]
    arc = math.sqrt(x[3] * x[3] + x[4] * x[4] + x[5] * x[5])
    rotation = arc * arm
    fraction = min(1.0, MAX_ROTATION / rotation) if rotation > 0.0 else 1.0
    if math.sqrt(x[0] * x[0] + x[1] * x[1] + x[2] * x[2]) + arc + abs(x[6]) <= OVERLAP_GROWTH * expected_overlap:
        return fraction  # no point of the body moves farther
    max_upper, max_lower, change_up, change_low = 0.0, 0.0, 0.0, 0.0
    for e in range(context.edges[b], last_candidate(b, context)):
        k = context.incidence[e] >> 1
        i, j = context.own[k], context.partner[k]
        up, overlap, n = is_upper(j), first_body.overlap(k, context), first_body.normal(k, context)
        change = -dot(n, displacement(x, arm, (S[i, sphere.ARM], S[i, sphere.ARM + 1], S[i, sphere.ARM + 2]), up))
        if change > 0.0:
            margin = OVERLAP_GROWTH * expected_overlap + max(-overlap, 0.0)
            if change * fraction > margin:
                fraction = margin / change
        if up and overlap > max_upper:
            max_upper, change_up = overlap, change
        if not up and overlap > max_lower:
            max_lower, change_low = overlap, change
    # the deepest contact of each plate stays closed, or the plate would drop out of the next iteration
    for maximum, change in ((max_upper, change_up), (max_lower, change_low)):
        if -change * fraction > OVERLAP_GROWTH * max(maximum, expected_overlap):
            fraction = OVERLAP_GROWTH * max(maximum, expected_overlap) / -change
    return fraction


@njit(**BARE)
def limit_slip_reversal(context, active, m, fraction, space):
    """Return the fraction, at most `fraction`, of the correction that reverses no slip.

    Between the two slip directions a contact sticks. Where all others slip, that is often the solution, and a full correction
    jumps over it.
    """
    I, O, G = space.tile.inputs, space.tile.outputs, space.tile.geometry  # noqa: E741
    arm = 1.0 / active.start[step_start.ARM]
    for q in range(m):
        limit = O[law_output.FRICTION_LIMIT * TILE + q]
        t_x = O[law_output.TANGENTIAL_X * TILE + q]
        t_y = O[law_output.TANGENTIAL_Y * TILE + q]
        if t_x * t_x + t_y * t_y < AT_LIMIT * limit * limit:
            continue
        if interact(context) and G[geometry.RELIEF * TILE + q] >= I[law_input.OVERLAP * TILE + q]:
            continue  # relieved wholly: it holds nothing
        k, (_, e, g) = space.slots[q], frame_of(q, G)
        s_x, s_y = I[law_input.SLIP_X * TILE + q], I[law_input.SLIP_Y * TILE + q]
        point = contact_point(q, context.own[k], context.S, G)
        moved = displacement(space.correction, arm, point, is_upper(context.partner[k]))
        size = math.sqrt(s_x * s_x + s_y * s_y)
        back = -(dot(moved, e) * s_x + dot(moved, g) * s_y)
        # ends just inside the friction limit
        margin = size * (size + BACK * O[law_output.CRITICAL_SLIP * TILE + q])
        if back * fraction > margin > 0.0:
            fraction = margin / back
    return fraction


@njit(**BARE)
def is_settled(context, now, scale, space):
    """Return whether `space.correction`, of coordinates where the residual is `now` [N], is negligible."""
    V = context.settings
    allowed = min(SETTLED * V[step_settings.TOLERANCE], SETTLED_RADII) * space.diagnostics[step_contacts.MAX_RADIUS]
    inertial = V[step_settings.INERTIAL] != 0.0
    return inertial and now <= SETTLED_FORCE * scale and euclidean_norm(space.correction) <= allowed


@njit(**BARE)
def limit_correction(context, active, m, space):
    """Return the fraction of `space.correction` that is tried first."""
    expected_overlap = max(context.settings[step_settings.EXPECTED_OVERLAP], space.diagnostics[step_contacts.MAX_OVERLAP])
    fraction = limit_overlap_change(context, active, expected_overlap, space)
    return limit_slip_reversal(context, active, m, fraction, space)


@njit(**BARE)
def solve_with_factors(space):
    """Solve for the correction at the residual with the factors of a Jacobian."""
    for k in range(FREEDOMS):
        space.correction[k] = space.residual[k]
    substitute(space.jacobian, space.pivots, space.correction, FREEDOMS)


@njit(**BARE)
def newton(context, active, motion, space):
    """Solve for the coordinates, from a guess in `space.y`; return outcome, contacts, iterations.

    Where the residual contracts, the factors of the last Jacobian tell whether the next correction is negligible; where it is
    expected to be the last one, they also give it.
    """
    y, r, dt = space.y, space.residual, motion.dt
    size, part, leaps, iterations, m, effects = 1e300, 0.0, 0, 0, np.int64(0), 0.0
    for k in range(FREEDOMS):
        space.correction[k] = 0.0
    while True:
        for k in range(FREEDOMS):
            y[k] += part * space.correction[k]
        set_configuration(context, active, y, dt)
        m = active_contacts(context, active, y, motion, space)
        if m < 0:
            return Outcome.CROWDED, m, iterations
        residual(context, active, m, y, motion, space)
        now, scale = euclidean_norm(r), force_scale(context, active, y, dt, space.diagnostics)
        minimum = rounding_force(context, active, space.diagnostics)
        enough = max(CONVERGED * scale, minimum)
        if not now < 1e300:
            return Outcome.UNSOLVED, m, iterations
        if now <= enough and is_balanced(context, active, dt, CONVERGED, minimum, space):
            return Outcome.SOLVED, m, iterations
        better = now < (1.0 - 1e-4 * part) * size
        if (not better and leaps == LEAPS) or iterations == ITERATIONS:
            # laws with corners do not converge to the last digits
            converged = now <= ACCEPTED * scale and is_balanced(context, active, dt, ACCEPTED, minimum, space)
            return (Outcome.SOLVED if converged else Outcome.UNSOLVED), m, iterations
        leaps += 0 if better else 1
        contracts = iterations > 0 and part == 1.0 and now <= CONTRACTS * size
        last = contracts and now * now <= enough * size
        constant, effects = effects == effects_on(active.number, context.E), effects_on(active.number, context.E)
        if contracts and constant:
            solve_with_factors(space)
            if is_settled(context, now, scale, space):
                return Outcome.SOLVED, m, iterations
        if not last:
            assemble_jacobian(context, active, m, dt, False, space)
            if not factorise(space.jacobian, space.pivots, FREEDOMS):
                return Outcome.UNSOLVED, m, iterations
        solve_with_factors(space)
        size, iterations = now, iterations + 1
        part = 1.0 if last else limit_correction(context, active, m, space)
