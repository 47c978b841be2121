"""Damped Newton's method for one step of an island, from one body to many, and limits on its corrections; writes no history.

Corrections are limited for all bodies by the same fraction. The residual that has to fall is, of one body, its norm; of several,
the root of the sum of squares, each over the forces that act on the body at the first iteration.
"""

import math
from collections import namedtuple
from enum import IntEnum

import numpy as np
from numba import njit

from thirdbody.jit.options import BARE, BARE_CHUNK
from thirdbody.kernels import plates
from thirdbody.kernels.implicit.contact import contact_point, dot, frame_of
from thirdbody.kernels.implicit.jacobian import assemble, factorise_jacobian, solve_correction
from thirdbody.kernels.implicit.residual import MAX_ROTATION, active_contacts, residual, set_configuration
from thirdbody.kernels.implicit.workspace import FREEDOMS, STAGE, body_at, call_part, last_candidate, space_at
from thirdbody.kernels.plates import has_effect_columns, is_upper
from thirdbody.kernels.step_tables import step_contacts, step_memory, step_settings, step_start
from thirdbody.kernels.tables import body, body_extra, height_field, patch, sphere
from thirdbody.kernels.tile import TILE, geometry, law_input, law_output

CONVERGED, ACCEPTED = 1e-9, 1e-6
"""Tolerances of the residual over the sum of all forces: for convergence, and where the iteration stagnates at corners of the
laws. Where all contacts slip, 1e-9 keeps the motion by the remaining residual below the error of a step."""

ROUNDING = 1e-15  # relative rounding error of heights; its effect on the contact forces is not counted as residual

SETTLED, SETTLED_RADII, SETTLED_FORCE = 1e-3, 1e-6, 1e-8
"""With inertia the iteration also ends before a correction of at most SETTLED times the error allowed in a step and SETTLED_RADII
contact radii, where the residual is at most SETTLED_FORCE of all forces: with 1e-7 the energy balance of a flake that tips is off
by 2e-6. Not where body effects change from one iteration to the next: the Jacobian leaves them out."""

CONTRACTS = 0.1
"""Largest ratio of two successive residuals for which the factors of the last Jacobian tell the next correction: what it leaves
out (turning frames) is then small."""

OVERLAP_GROWTH = 0.5
"""Largest growth of an overlap in one iteration, as a fraction of the largest overlap or of that expected under the load."""

AT_LIMIT, BACK = 1.0 - 1e-9, 0.05
"""A contact slips if its squared tangential force reaches this fraction of the squared limit; fraction of the critical slip by
which a correction may reverse it."""

IterationLimits = namedtuple("IterationLimits", "iterations leaps halvings")
"""Maximum iterations, beyond which two half steps are cheaper; corrections accepted although the residual grows, where contacts
change between stick and slip; and halvings of one correction."""

ALONE = IterationLimits(10, 4, 0)
"""Of one body. Halving instead of leaping: of 1000 clumps that slide 100 um half as many steps fail without, in a third fewer
evaluations."""

TOGETHER = IterationLimits(16, 2, 1)  # of several bodies: more iterations, since a shorter step is one of all of them


class NewtonOutcome(IntEnum):
    SOLVED = 0
    UNSOLVED = 1
    CROWDED = 2  # A body has more contacts than a tile holds


@njit(**BARE)
def euclidean_norm(r):
    total = 0.0
    for k in range(FREEDOMS):
        total += r[k] * r[k]
    return math.sqrt(total)


@njit(**BARE)
def effect_size(b, E):
    if not has_effect_columns(E):
        return 0.0
    return abs(E[b, body_extra.EFFECT_FORCE]) + abs(E[b, body_extra.EFFECT_FORCE + 1]) + abs(E[b, body_extra.EFFECT_FORCE + 2])


@njit(**BARE)
def rounding_force(context, b, alone, space):
    """Return the residual [N] caused by rounding of coordinates. Contacts with planes feel heights, those with rough plates the
    place by the slope, those between bodies all coordinates."""
    B, diagnostics = context.B, space.diagnostics
    far = abs(B[b, body.POSITION + 2])
    if not alone:
        far = max(far, abs(B[b, body.POSITION]), abs(B[b, body.POSITION + 1]))
    elif plates.is_rough(context):
        slope = 0.0
        for field in (context.lower, context.upper):
            if field.shape[0] > 0:
                slope = max(slope, field[height_field.MAX_SLOPE])
        far = max(far, slope * abs(B[b, body.POSITION]), slope * abs(B[b, body.POSITION + 1]))
    far = max(far + space.start[step_start.ARM], abs(context.P[context.patch[b], patch.HEIGHT]))
    if diagnostics[step_contacts.MAX_OVERLAP] <= 0.0:
        return 0.0
    # Hertz: dN/dd = 1.5 N/d
    return ROUNDING * far * 1.5 * diagnostics[step_contacts.NORMAL_FORCE] / diagnostics[step_contacts.MAX_OVERLAP]


@njit(**BARE)
def is_balanced(context, b, dt, fraction, minimum, space):
    """Return whether the residual on a body without inertia is at most `fraction` of its own forces, without those on its patch:
    else a body that touches neither plate would count as balanced at any velocity. `minimum`: rounding error [N]."""
    if context.settings[step_settings.INERTIAL] != 0.0:
        return True
    Z, square = space.start, 0.0
    for k in range(6):
        square += space.residual[k] * space.residual[k]
    resistance = Z[step_start.TETHER_STIFFNESS] + Z[step_start.MASS_FRACTION] * context.B[b, body.MASS] / (dt * dt)
    stored = resistance * context.memory[b, step_memory.CONTACT_RADIUS]
    forces = space.diagnostics[step_contacts.NORMAL_FORCE] + effect_size(b, context.E) + stored
    return math.sqrt(square) <= max(fraction * forces, minimum)


@njit(**BARE)
def evaluate(part, motion, context, island, scratch):
    """Evaluate the residuals with `part` of the correction; return the number of contacts between bodies, -1 if crowded."""
    n = island.n
    for a in range(n):
        space = space_at(a, scratch)
        for k in range(FREEDOMS):
            space.trial[k] = space.y[k] + part * space.correction[k]
        set_configuration(context, body_at(a, island), space.trial, motion.dt, space)
    for a in range(n):
        space = space_at(a, scratch)
        scratch.counts[a] = active_contacts(a, motion, context, island, scratch)
        if scratch.counts[a] < 0:
            return np.int64(-1)
        residual(a, scratch.counts[a], motion, context, island, scratch)
    if island.n_pairs == 0:
        return np.int64(0)
    call_part(context.pairs_part, STAGE.TRIAL, 0, 0, motion, context, island, scratch)
    return np.int64(scratch.answer[0])


@njit(**BARE)
def measure(first, dt, context, island, scratch):
    """Return the norm of the residuals, the norm that is sufficient, and whether all bodies are solved, or nearly. The forces of
    the `first` ones of a step are the scale."""
    square, smallest, solved, nearly, alone = 0.0, 1e300, True, True, island.n == 1
    P, per_square = context.P, 1.0 / (dt * dt)
    for a in range(island.n):
        b, space = body_at(a, island), space_at(a, scratch)
        now, p, y = euclidean_norm(space.residual), context.patch[b], space.trial
        # the scale: the sum of all acting forces, also of a patch without contacts; when unloaded, its nominal load
        move = math.sqrt(y[0] * y[0] + y[1] * y[1] + y[2] * y[2])
        move += math.sqrt(y[3] * y[3] + y[4] * y[4] + y[5] * y[5])
        patch_force = max(P[p, patch.LOAD], P[p, patch.NOMINAL_LOAD]) + P[p, patch.MASS] * abs(y[6]) * per_square
        patch_force += P[p, patch.DAMPING] * abs(P[p, patch.VELOCITY])
        patch_force += P[p, patch.SPRING] * abs(P[p, patch.HEIGHT] - space.start[step_start.PLATE_HEIGHT])
        scale = space.diagnostics[step_contacts.NORMAL_FORCE] + effect_size(b, context.E)
        scale = scale + context.B[b, body.MASS] * move * per_square + P[p, patch.FREE] * patch_force
        minimum = rounding_force(context, b, alone, space)
        enough = max(CONVERGED * scale, minimum)
        scratch.scales[a, 0] = scale
        if first:
            scratch.scales[a, 1] = 1.0 if alone else 1.0 / max(scale, 1e-300)
        if not (now <= enough and is_balanced(context, b, dt, CONVERGED, minimum, space)):
            solved = False
        if not (now <= max(ACCEPTED * scale, minimum) and is_balanced(context, b, dt, ACCEPTED, minimum, space)):
            nearly = False
        square += (now * scratch.scales[a, 1]) ** 2
        smallest = min(smallest, enough * scratch.scales[a, 1])
    return math.sqrt(square), smallest, solved, nearly


@njit(**BARE)
def effects_on(context, island):
    """Return a number that changes with force or torque of the effects on a body."""
    total, E = 0.0, context.E
    for a in range(island.n if has_effect_columns(E) else 0):
        b = body_at(a, island)
        for k in range(3):
            total += (k + 1) * (E[b, body_extra.EFFECT_FORCE + k] + E[b, body_extra.EFFECT_TORQUE + k])
    return total


@njit(**BARE)
def displacement(x, per_arm, r, upper):
    """Return the displacement (3,) [m] relative to its plate of the point r (3,) of the body by the correction x."""
    u_x, u_y = x[0] + (x[4] * r[2] - x[5] * r[1]) * per_arm, x[1] + (x[5] * r[0] - x[3] * r[2]) * per_arm
    return u_x, u_y, x[2] + (x[3] * r[1] - x[4] * r[0]) * per_arm - (x[6] if upper else 0.0)


@njit(**BARE)
def limit_overlap_change(context, b, expected_overlap, space):
    """Return the fraction of the correction for which overlaps change by at most OVERLAP_GROWTH `expected_overlap` [m]: of
    contacts that sink in, and of the deepest one of each plate, which must not open."""
    x, per_arm = space.correction, 1.0 / space.start[step_start.ARM]
    arc = math.sqrt(x[3] * x[3] + x[4] * x[4] + x[5] * x[5])
    rotation = arc * per_arm
    fraction = min(1.0, MAX_ROTATION / rotation) if rotation > 0.0 else 1.0
    if math.sqrt(x[0] * x[0] + x[1] * x[1] + x[2] * x[2]) + arc + abs(x[6]) <= OVERLAP_GROWTH * expected_overlap:
        return fraction  # no point of the body moves farther
    max_upper, max_lower, change_up, change_low = 0.0, 0.0, 0.0, 0.0
    for e in range(context.plate_edges[b], last_candidate(b, context)):
        k = context.plate_incidence[e] >> 1
        up, overlap = is_upper(context.partner[k]), plates.overlap(k, context)
        centre = plates.three(context.S, context.own[k], sphere.ARM)
        change = -dot(plates.normal(k, context), displacement(x, per_arm, centre, up))
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
def is_slipping(q, O):  # noqa: E741
    limit = O[law_output.FRICTION_LIMIT * TILE + q]
    t_x, t_y = O[law_output.TANGENTIAL_X * TILE + q], O[law_output.TANGENTIAL_Y * TILE + q]
    return not t_x * t_x + t_y * t_y < AT_LIMIT * limit * limit


@njit(**BARE)
def limit_reversal(q, moved, fraction, tile):
    """Return the fraction, at most `fraction`, of the correction, which moves contact q by `moved` (3,) [m], that ends just
    inside the friction limit: between two slip directions a contact sticks. That is often the solution, which a full one jumps
    over."""
    I, (_, e, g) = tile.inputs, frame_of(q, tile.geometry)  # noqa: E741
    s_x, s_y = I[law_input.SLIP_X * TILE + q], I[law_input.SLIP_Y * TILE + q]
    size, back = math.sqrt(s_x * s_x + s_y * s_y), -(dot(moved, e) * s_x + dot(moved, g) * s_y)
    margin = size * (size + BACK * tile.outputs[law_output.CRITICAL_SLIP * TILE + q])
    return margin / back if back * fraction > margin > 0.0 else fraction


@njit(**BARE)
def limit_slip_reversal(context, m, fraction, space):
    per_arm, G = 1.0 / space.start[step_start.ARM], space.geometry
    for q in range(m):
        relieved = context.spots_part != 0 and G[geometry.RELIEF * TILE + q] >= space.inputs[law_input.OVERLAP * TILE + q]
        if relieved or not is_slipping(q, space.outputs):  # relieved wholly it holds nothing
            continue
        k = space.slots[q]
        point = contact_point(q, context.own[k], context.S, G)
        moved = displacement(space.correction, per_arm, point, is_upper(context.partner[k]))
        fraction = limit_reversal(q, moved, fraction, space)
    return fraction


@njit(**BARE)
def limited_part(m, motion, context, island, scratch):
    fraction = 1.0
    for a in range(island.n):
        space = space_at(a, scratch)
        expected = max(context.settings[step_settings.EXPECTED_OVERLAP], space.diagnostics[step_contacts.MAX_OVERLAP])
        part = limit_overlap_change(context, body_at(a, island), expected, space)
        fraction = min(fraction, limit_slip_reversal(context, scratch.counts[a], part, space))
    if island.n_pairs == 0:
        return fraction
    scratch.answer[0] = fraction
    call_part(context.pairs_part, STAGE.LIMIT, 0, m, motion, context, island, scratch)
    return scratch.answer[0]


@njit(**BARE_CHUNK)
def solve_island(motion, context, island, scratch):
    """Solve for the coordinates of all bodies of an island, from a guess; return outcome, contacts between bodies, iterations.
    Where the residual contracts, the factors of the last Jacobian tell whether the next correction is negligible, or give it."""
    limits = ALONE if island.n == 1 else TOGETHER
    size, part, whole, halvings, leaps, iterations, effects, m = 1e300, 0.0, 0.0, 0, 0, 0, 0.0, np.int64(0)
    for a in range(island.n):
        for k in range(FREEDOMS):
            space_at(a, scratch).correction[k] = 0.0
    while True:
        m = evaluate(part, motion, context, island, scratch)
        if m < 0:
            return NewtonOutcome.CROWDED, m, iterations
        now, enough, solved, nearly = measure(size == 1e300, motion.dt, context, island, scratch)
        if not now < 1e300:
            return NewtonOutcome.UNSOLVED, m, iterations
        better = solved or now < (1.0 - 1e-4 * part) * size
        if not better and halvings < limits.halvings:
            halvings, part = halvings + 1, 0.5 * part
            continue
        if not better and halvings == limits.halvings and leaps < limits.leaps:
            leaps += 1
            better = limits.halvings == 0
            if not better:  # the whole correction, after all
                halvings, part = halvings + 1, whole
                continue
        better = better or halvings > limits.halvings
        for a in range(island.n):
            for k in range(FREEDOMS):
                space_at(a, scratch).y[k] = space_at(a, scratch).trial[k]
        if solved:
            return NewtonOutcome.SOLVED, m, iterations
        if not better or iterations == limits.iterations:
            # laws with corners do not converge to the last digits
            return (NewtonOutcome.SOLVED if nearly else NewtonOutcome.UNSOLVED), m, iterations
        contracts = iterations > 0 and part == 1.0 and now <= CONTRACTS * size
        last = contracts and now * now <= enough * size
        constant, effects = effects == effects_on(context, island), effects_on(context, island)
        if contracts and constant:
            solve_correction(False, island, scratch)
            settled = context.settings[step_settings.INERTIAL] != 0.0
            for a in range(island.n):  # whether the corrections of all bodies are negligible
                space, tolerance = space_at(a, scratch), SETTLED * context.settings[step_settings.TOLERANCE]
                allowed = min(tolerance, SETTLED_RADII) * space.diagnostics[step_contacts.MAX_RADIUS]
                balanced = euclidean_norm(space.residual) <= SETTLED_FORCE * scratch.scales[a, 0]
                settled = settled and balanced and euclidean_norm(space.correction) <= allowed
            if settled:
                return NewtonOutcome.SOLVED, m, iterations
        if not last:
            assemble(m, False, motion, context, island, scratch)
            if not factorise_jacobian(False, island, scratch):
                return NewtonOutcome.UNSOLVED, m, iterations
        solve_correction(False, island, scratch)
        size, halvings, iterations = now, 0, iterations + 1
        part = whole = 1.0 if last else limited_part(m, motion, context, island, scratch)
