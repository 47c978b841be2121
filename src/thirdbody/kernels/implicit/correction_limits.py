"""Limits on the corrections of Newton's method for a body and its contacts with plates."""

import math

from numba import njit

from thirdbody.jit.options import BARE
from thirdbody.kernels import plates
from thirdbody.kernels.implicit.contact import dot
from thirdbody.kernels.implicit.residual import MAX_ROTATION, contact_point, frame_of
from thirdbody.kernels.implicit.tables import step_start
from thirdbody.kernels.implicit.workspace import last_candidate
from thirdbody.kernels.plates import is_upper
from thirdbody.kernels.tables import sphere
from thirdbody.kernels.tile import TILE, geometry, law_input, law_output

OVERLAP_GROWTH = 0.5
"""Largest growth of an overlap in one iteration, as a fraction of the largest overlap or of that expected under the load."""

AT_LIMIT, BACK = 1.0 - 1e-9, 0.05
"""A contact slips if its squared tangential force reaches this fraction of the squared limit; fraction of the critical slip by
which a correction may reverse it."""


@njit(**BARE)
def displacement(x, per_arm, r, upper):
    """Return the displacement (3,) [m] relative to its plate of a point of the body by the correction x of the coordinates.

    `per_arm`: one over the arm of the body [1/m]; `r`: the point from the centre of mass [m].
    """
    return (
        x[0] + (x[4] * r[2] - x[5] * r[1]) * per_arm,
        x[1] + (x[5] * r[0] - x[3] * r[2]) * per_arm,
        x[2] + (x[3] * r[1] - x[4] * r[0]) * per_arm - (x[6] if upper else 0.0),
    )


@njit(**BARE)
def limit_overlap_change(context, b, expected_overlap, space):
    """Return the fraction of the correction for which overlaps change by at most OVERLAP_GROWTH `expected_overlap` [m].

    Limited are contacts that sink in, and the deepest contact of each plate, which must not open.
    """
    x, S, per_arm = space.correction, context.S, 1.0 / space.start[step_start.ARM]
    arc = math.sqrt(x[3] * x[3] + x[4] * x[4] + x[5] * x[5])
    rotation = arc * per_arm
    fraction = min(1.0, MAX_ROTATION / rotation) if rotation > 0.0 else 1.0
    if math.sqrt(x[0] * x[0] + x[1] * x[1] + x[2] * x[2]) + arc + abs(x[6]) <= OVERLAP_GROWTH * expected_overlap:
        return fraction  # no point of the body moves farther
    max_upper, max_lower, change_up, change_low = 0.0, 0.0, 0.0, 0.0
    for e in range(context.plate_edges[b], last_candidate(b, context)):
        k = context.plate_incidence[e] >> 1
        i, j = context.own[k], context.partner[k]
        up, overlap, n = is_upper(j), plates.overlap(k, context), plates.normal(k, context)
        change = -dot(n, displacement(x, per_arm, (S[i, sphere.ARM], S[i, sphere.ARM + 1], S[i, sphere.ARM + 2]), up))
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
def limit_slip_reversal(context, m, fraction, space):
    """Return the fraction, at most `fraction`, of the correction that reverses no slip.

    Between the two slip directions a contact sticks. Where all others slip, that is often the solution, and a full correction
    jumps over it.
    """
    I, O, G = space.inputs, space.outputs, space.geometry  # noqa: E741
    per_arm = 1.0 / space.start[step_start.ARM]
    for q in range(m):
        limit = O[law_output.FRICTION_LIMIT * TILE + q]
        t_x = O[law_output.TANGENTIAL_X * TILE + q]
        t_y = O[law_output.TANGENTIAL_Y * TILE + q]
        if t_x * t_x + t_y * t_y < AT_LIMIT * limit * limit:
            continue
        if context.spots_part != 0 and G[geometry.RELIEF * TILE + q] >= I[law_input.OVERLAP * TILE + q]:
            continue  # relieved wholly: it holds nothing
        k, (_, e, g) = space.slots[q], frame_of(q, G)
        s_x, s_y = I[law_input.SLIP_X * TILE + q], I[law_input.SLIP_Y * TILE + q]
        point = contact_point(q, context.own[k], context.S, G)
        moved = displacement(space.correction, per_arm, point, is_upper(context.partner[k]))
        size = math.sqrt(s_x * s_x + s_y * s_y)
        back = -(dot(moved, e) * s_x + dot(moved, g) * s_y)
        # ends just inside the friction limit
        margin = size * (size + BACK * O[law_output.CRITICAL_SLIP * TILE + q])
        if back * fraction > margin > 0.0:
            fraction = margin / back
    return fraction
