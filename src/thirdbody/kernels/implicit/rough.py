"""Contacts with rough plates in an implicit step: called through pointers, as `minima` in explicit steps.

Newton's method tries positions from which there may be no way back, so every trial follows the minima from where they were at the
start of the step, and ends or finds none. An accepted step ends those that met others, and searches for new ones; it finds them
before they can touch, since no sphere moves farther in a step than the margin of the search (`control.travel_error`).

In hollows nearly as narrow as the sphere the gradient force turns within nanometres; without its change Newton's method fails for
all but the shortest steps.
"""

import math

import numpy as np
from numba import njit

from thirdbody.jit.options import BARE, BARE_CHUNK, NO_COUNTS, OPTIONS, POINTED, entry
from thirdbody.kernels import plates
from thirdbody.kernels.closest_point import Foot, inverse_of, log_radius_gradient, matrix_of
from thirdbody.kernels.height_field import has_heights, jet_at, rounded_jet, within_period
from thirdbody.kernels.implicit.contact import (
    ZERO_TENSOR,
    add_planar,
    add_planar_moments,
    contact_of,
    cross,
    owner_side,
    plate_side,
)
from thirdbody.kernels.implicit.curved import add_curved
from thirdbody.kernels.implicit.workspace import FREEDOMS, PART, body_at, island_at, space_at
from thirdbody.kernels.minima import (
    UPDATE,
    end_minimum,
    follow,
    has_minimum,
    is_same,
    next_rough,
    offset_of,
    reset_ended,
    search_all,
    search_is_due,
    update_by,
)
from thirdbody.kernels.plates import BASINS, is_upper
from thirdbody.kernels.rolling_kinematics import has_moments
from thirdbody.kernels.tables import domain, height_field, sphere, surface_contact

STEP = 1e-4
"""Length of the differences, in units of a cell."""


@njit(**BARE)
def gradient_above(field, p_x, p_y, distance, radius):
    """Return centre (3,) [m] and gradient of ln R_eff (3,) [1/m] of a sphere above a point of the surface, at a distance [m]."""
    jet = jet_at(field, p_x, p_y)
    n_z = 1.0 / math.sqrt(1.0 + jet.x * jet.x + jet.y * jet.y)
    normal, below = (-jet.x * n_z, -jet.y * n_z, n_z), -distance * n_z
    a, b, c = matrix_of(jet, below)
    foot = Foot(0.0, 0.0, distance, normal, jet, inverse_of(a, b, c), 1)
    centre = p_x + distance * normal[0], p_y + distance * normal[1], jet.h + distance * n_z
    return centre, log_radius_gradient(foot, rounded_jet(field, jet, p_x, p_y), radius)


@njit(**BARE)
def difference(a, b):
    """Return a - b."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@njit(**BARE_CHUNK)
def write_gradient_change(k, field, x, radius, upper, Q):
    """Write the derivative of the gradient of ln R_eff with the place of the sphere into row k; x (3,): its centre.

    Differences along the two axes of the surface and along the normal: of the point below the sphere, so that no closest point is
    searched for. With displacements c_i and changes g_i the derivative is the sum of g_i w_i, of the vectors w_i dual to c_i.
    """
    p_x = within_period(x[0], field[height_field.LENGTH_X]) + Q[k, surface_contact.OFFSET]
    p_y = within_period(x[1], field[height_field.LENGTH_Y]) + Q[k, surface_contact.OFFSET + 1]
    h, distance = STEP / max(field[height_field.RATE_X], field[height_field.RATE_Y]), Q[k, surface_contact.DISTANCE]
    centre, gradient = gradient_above(field, p_x, p_y, distance, radius)
    c_1, g_1 = gradient_above(field, p_x + h, p_y, distance, radius)
    c_2, g_2 = gradient_above(field, p_x, p_y + h, distance, radius)
    c_3, g_3 = gradient_above(field, p_x, p_y, distance + h, radius)
    c_1, c_2, c_3 = difference(c_1, centre), difference(c_2, centre), difference(c_3, centre)
    g_1, g_2, g_3 = difference(g_1, gradient), difference(g_2, gradient), difference(g_3, gradient)
    w_1, w_2, w_3 = cross(c_2, c_3), cross(c_3, c_1), cross(c_1, c_2)
    inverse, t = c_1[0] * w_1[0] + c_1[1] * w_1[1] + c_1[2] * w_1[2], surface_contact.GRADIENT_CHANGE
    inverse, up = 1.0 / inverse, -1.0 if upper else 1.0
    Q[k, t] = (g_1[0] * w_1[0] + g_2[0] * w_2[0] + g_3[0] * w_3[0]) * inverse
    Q[k, t + 1] = (g_1[1] * w_1[1] + g_2[1] * w_2[1] + g_3[1] * w_3[1]) * inverse
    Q[k, t + 2] = (g_1[2] * w_1[2] + g_2[2] * w_2[2] + g_3[2] * w_3[2]) * inverse
    Q[k, t + 3] = (g_1[0] * w_1[1] + g_2[0] * w_2[1] + g_3[0] * w_3[1]) * inverse
    Q[k, t + 4] = up * (g_1[0] * w_1[2] + g_2[0] * w_2[2] + g_3[0] * w_3[2]) * inverse
    Q[k, t + 5] = up * (g_1[1] * w_1[2] + g_2[1] * w_2[2] + g_3[1] * w_3[2]) * inverse


MARGIN = 0.15
"""Largest gap of a minimum that is followed, in radii: more than `control.TRAVEL` and `minima.MOVED` together."""

FAR = 1.02
"""Distance over the radius beyond which a minimum that cannot touch in a step is not followed: its distance is then a bound."""


@njit(**BARE)
def moved_square(k, Q):
    """Return how far the minimum of row k has moved in the step, squared [m2]."""
    x, y = (
        Q[k, surface_contact.OFFSET] - Q[k, surface_contact.START],
        Q[k, surface_contact.OFFSET + 1] - Q[k, surface_contact.START + 1],
    )
    return x * x + y * y


@njit(**BARE)
def is_apart(k, Q):
    """Return whether row k has met another one in this trial."""
    return Q[k, surface_contact.DISTANCE] == math.inf


@njit(**BARE)
def displacement_in(k, x, Q):
    """Return the displacement [m] in the step of the sphere whose first row is k; x (3,): its centre now."""
    d_x, d_y = x[0] - Q[k, surface_contact.START_CENTRE], x[1] - Q[k, surface_contact.START_CENTRE + 1]
    d_z = x[2] - Q[k, surface_contact.START_CENTRE + 2]
    return math.sqrt(d_x * d_x + d_y * d_y + d_z * d_z)


@njit(**BARE)
def is_bent(k, tables):
    """Return whether the minimum of row k is within reach on a plate whose curvature counts: its force has a gradient."""
    touches = tables.Q[k, surface_contact.DISTANCE] < tables.S[tables.own[k], sphere.RADIUS] + tables.D[domain.REACH]
    return touches and tables.D[domain.CURVED + is_upper(tables.partner[k])] != 0.0


@njit(**BARE_CHUNK)
def follow_step(k, field, x, ends, tables):
    """Move all minima of the sphere whose first row is k from the start of the step to where they are for a centre x (3,).

    Of two that meet, the one that moved farther is apart; with `ends` it ends.
    """
    Q, path = tables.Q, displacement_in(k, x, tables.Q)
    far = FAR * tables.S[tables.own[k], sphere.RADIUS] + tables.D[domain.REACH] if has_heights(field) else math.inf
    for a in range(BASINS):
        if not has_minimum(k, a, Q):
            continue
        if Q[k + a, surface_contact.START_DISTANCE] - path > far:
            Q[k + a, surface_contact.DISTANCE] = Q[k + a, surface_contact.START_DISTANCE] - path
            continue
        # not from where the last trial left it: where two minima meet, the forces would depend on the trials before
        start = Q[k + a, surface_contact.START], Q[k + a, surface_contact.START + 1]
        follow(k + a, field, x, start, tables)
        for b in range(a):
            same = has_minimum(k, b, Q) and is_same(offset_of(k + a, Q), offset_of(k + b, Q), field)
            if same and not is_apart(k + b, Q):
                lost = a if moved_square(k + a, Q) > moved_square(k + b, Q) else b
                Q[k + lost, surface_contact.DISTANCE] = math.inf
                break
    for a in range(BASINS if ends else 0):
        if has_minimum(k, a, Q) and is_apart(k + a, Q):
            end_minimum(k, a, math.inf, Q)


@njit(**BARE)
def centre_of(k, tables):
    """Return the centre of the sphere of row k (3,) in the coordinates of its plate [m]."""
    return plates.to_surface(tables.partner[k], plates.centre(tables.own[k], tables.S), tables.P)


@njit(**BARE_CHUNK)
def write_changes(k, field, tables):
    """Write the changes of the gradients at the minima of the sphere whose first row is k that touch."""
    Q, radius, x = tables.Q, tables.S[tables.own[k], sphere.RADIUS], centre_of(k, tables)
    for a in range(BASINS):
        if has_minimum(k, a, Q) and is_bent(k + a, tables):
            write_gradient_change(k + a, field, x, radius, is_upper(tables.partner[k]), Q)


@njit(**BARE_CHUNK)
def accept_sphere(k, field, tables):
    """Take the minima of the sphere whose first row is k as those at the start of the next step, after a search if one is due."""
    Q, radius = tables.Q, tables.S[tables.own[k], sphere.RADIUS]
    x, farthest = centre_of(k, tables), radius * (1.0 + MARGIN) + tables.D[domain.REACH]
    reset_ended(k, Q)
    follow_step(k, field, x, True, tables)
    if not x[2] - field[height_field.MAX_HEIGHT] <= farthest:
        for a in range(BASINS):
            if has_minimum(k, a, Q):
                end_minimum(k, a, math.inf, Q)
        Q[k, surface_contact.SEARCHED] = math.inf
    elif search_is_due(k, field, x, (radius, tables.D[domain.REACH]), Q):
        search_all(k, field, x, (farthest, math.inf), tables)
    for a in range(k, k + BASINS):
        Q[a, surface_contact.START], Q[a, surface_contact.START + 1] = offset_of(a, Q)
        Q[a, surface_contact.START_DISTANCE] = Q[a, surface_contact.DISTANCE]
    for d in range(3):
        Q[k, surface_contact.START_CENTRE + d] = x[d]


@entry(UPDATE, **OPTIONS, **NO_COUNTS)
def update_trial(first, last, tables):
    """Update the rows of candidates first to last for positions within a step."""
    k = next_rough(first, last, tables)
    while k < last:
        if tables.Q[k, surface_contact.MINIMA] != 0.0:
            field = tables.upper if is_upper(tables.partner[k]) else tables.lower
            follow_step(k, field, centre_of(k, tables), False, tables)
        k = next_rough(k + BASINS, last, tables)


@entry(UPDATE, **OPTIONS, **NO_COUNTS)
def update_accepted(first, last, tables):
    """Update the rows of candidates first to last for positions at the end of a step."""
    k = next_rough(first, last, tables)
    while k < last:
        accept_sphere(k, tables.upper if is_upper(tables.partner[k]) else tables.lower, tables)
        k = next_rough(k + BASINS, last, tables)


@entry(UPDATE, **OPTIONS, **NO_COUNTS)
def update_tangents(first, last, tables):
    """Update what the Jacobian alone needs in the rows of candidates first to last, for the positions of the last trial."""
    k = next_rough(first, last, tables)
    while k < last:
        if tables.Q[k, surface_contact.MINIMA] != 0.0:
            write_changes(k, tables.upper if is_upper(tables.partner[k]) else tables.lower, tables)
        k = next_rough(k + BASINS, last, tables)


@njit(**BARE)
def tensor_at(k, t, Q):
    """Return the six columns from t on of candidate k: a symmetric tensor of `surface_contact`."""
    return Q[k, t], Q[k, t + 1], Q[k, t + 2], Q[k, t + 3], Q[k, t + 4], Q[k, t + 5]


@entry(PART, **POINTED, **NO_COUNTS)
def rough_part(_, h, a, m, motion, context, islands, scratch):
    """Add the m contacts of the body at position a of island h, some of them with rough plates, to its Jacobian."""
    b, space, Q = body_at(a, island_at(h, islands)), space_at(a, scratch), context.Q
    update_by(context.surface_tangents, context.plate_edges[b], context.plate_edges[b + 1], context)
    for q in range(m):
        k = space.slots[q]
        shape = (
            tensor_at(k, surface_contact.NORMAL_GRADIENT, Q), plates.three(Q, k, surface_contact.GRADIENT),
            tensor_at(k, surface_contact.GRADIENT_CHANGE, Q),
        )  # fmt: skip
        sides = (
            owner_side(q, context.own[k], np.int64(0), 1.0, context.S, space.geometry),
            plate_side(np.int64(6) if is_upper(context.partner[k]) else np.int64(-1)),
        )
        contact = contact_of(q, space.before[k - context.plate_edges[b]], motion.dt, sides, shape, context, space)
        if shape[0] != ZERO_TENSOR:
            add_curved(contact, space.jacobian, np.int64(FREEDOMS), np.int64(0))
            continue
        add_planar(contact, space.jacobian)
        if has_moments(context):
            add_planar_moments(contact, space.jacobian)
