"""Contacts with rough plates in an implicit step: called through pointers, as `minima` in explicit steps.

Newton's method tries positions from which there may be no way back, so every trial follows the minima from where they were at the
start of the step, and ends or finds none. An accepted step ends those that met others, and searches for new ones; it finds them
before they can touch, since no sphere moves farther in a step than the margin of the search (`control.TRAVEL`).

In hollows nearly as narrow as the sphere the gradient force turns within nanometres; without its change Newton's method fails for
all but the shortest steps.
"""

import math

import numpy as np
from numba import njit

from thirdbody.jit.options import BARE, BARE_CHUNK, NO_COUNTS, OPTIONS, POINTED, entry
from thirdbody.kernels import minima, plates
from thirdbody.kernels.closest_point import Foot, inverse_of, log_radius_gradient, matrix_of
from thirdbody.kernels.height_field import has_heights, jet_at, rounded_jet, within_period
from thirdbody.kernels.implicit.contact import ZERO_TENSOR, add_plane, cross, difference, plate_contact, scaled_sum
from thirdbody.kernels.implicit.jacobian import add_general
from thirdbody.kernels.implicit.workspace import FREEDOMS, PART, STAGE, UPDATE_MINIMA, body_at, island_at, space_at, update_rough
from thirdbody.kernels.minima import end_minimum, has_minimum, offset_of
from thirdbody.kernels.plates import BASINS, is_upper
from thirdbody.kernels.step_tables import step_memory
from thirdbody.kernels.tables import domain, height_field, sphere, surface_contact

STEP = 1e-4  # length of the differences, in units of a cell


@njit(**BARE)
def gradient_above(field, p_x, p_y, distance, radius):
    jet = jet_at(field, p_x, p_y)
    n_z = 1.0 / math.sqrt(1.0 + jet.x * jet.x + jet.y * jet.y)
    normal, below = (-jet.x * n_z, -jet.y * n_z, n_z), -distance * n_z
    a, b, c = matrix_of(jet, below)
    foot = Foot(0.0, 0.0, distance, normal, jet, inverse_of(a, b, c), 1)
    centre = p_x + distance * normal[0], p_y + distance * normal[1], jet.h + distance * n_z
    return centre, log_radius_gradient(foot, rounded_jet(field, jet, p_x, p_y), radius)


@njit(**BARE_CHUNK)
def write_gradient_change(k, field, x, radius, upper, Q):
    """Write the derivative of the gradient of ln R_eff with the centre x (3,) into row k, by differences along both axes and the
    normal of the point below the sphere. With displacements c_i and changes g_i it is the sum of g_i w_i, w_i dual to c_i."""
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
    inverse = 1.0 / (c_1[0] * w_1[0] + c_1[1] * w_1[1] + c_1[2] * w_1[2])
    up, t = -1.0 if upper else 1.0, surface_contact.GRADIENT_CHANGE
    xx, xy, xz = scaled_sum(g_1[0], w_1, g_2[0], w_2, g_3[0], w_3)
    _, yy, yz = scaled_sum(g_1[1], w_1, g_2[1], w_2, g_3[1], w_3)
    _, _, zz = scaled_sum(g_1[2], w_1, g_2[2], w_2, g_3[2], w_3)
    Q[k, t], Q[k, t + 1], Q[k, t + 2], Q[k, t + 3] = xx * inverse, yy * inverse, zz * inverse, xy * inverse
    Q[k, t + 4], Q[k, t + 5] = up * xz * inverse, up * yz * inverse


MARGIN = 0.15  # largest gap of a minimum that is followed, in radii: more than `control.TRAVEL` and `minima.MOVED` together

FAR = 1.02
"""Distance over the radius beyond which a minimum that cannot touch in a step is not followed: its distance is then a bound."""


@njit(**BARE)
def moved_square(k, Q):
    x, y = offset_of(k, Q)
    x, y = x - Q[k, surface_contact.START], y - Q[k, surface_contact.START + 1]
    return x * x + y * y


@njit(**BARE_CHUNK)
def follow_step(k, field, x, ends, tables):
    """Move all minima of the sphere whose first row is k from the start of the step to where they are for a centre x (3,); of two
    that meet, the one that moved farther is apart, at an infinite distance; with `ends` it ends."""
    Q, (d_x, d_y, d_z) = tables.Q, difference(x, plates.three(tables.Q, k, surface_contact.START_CENTRE))
    path = math.sqrt(d_x * d_x + d_y * d_y + d_z * d_z)
    far = FAR * tables.S[tables.own[k], sphere.RADIUS] + tables.D[domain.REACH] if has_heights(field) else math.inf
    for a in range(BASINS):
        if not has_minimum(k, a, Q):
            continue
        if Q[k + a, surface_contact.START_DISTANCE] - path > far:
            Q[k + a, surface_contact.DISTANCE] = Q[k + a, surface_contact.START_DISTANCE] - path
            continue
        # not from where the last trial left it: where two minima meet, the forces would depend on the trials before
        start = Q[k + a, surface_contact.START], Q[k + a, surface_contact.START + 1]
        minima.follow(k + a, field, x, start, tables)
        for b in range(a):
            same = has_minimum(k, b, Q) and minima.is_same(offset_of(k + a, Q), offset_of(k + b, Q), field)
            if same and Q[k + b, surface_contact.DISTANCE] != math.inf:
                lost = a if moved_square(k + a, Q) > moved_square(k + b, Q) else b
                Q[k + lost, surface_contact.DISTANCE] = math.inf
                break
    for a in range(BASINS if ends else 0):
        if has_minimum(k, a, Q) and Q[k + a, surface_contact.DISTANCE] == math.inf:
            end_minimum(k, a, math.inf, Q)


@njit(**BARE_CHUNK)
def accept_sphere(k, field, x, tables):
    Q, radius, reach = tables.Q, tables.S[tables.own[k], sphere.RADIUS], tables.D[domain.REACH]
    farthest = radius * (1.0 + MARGIN) + reach
    minima.reset_ended(k, Q)
    follow_step(k, field, x, True, tables)
    if not x[2] - field[height_field.MAX_HEIGHT] <= farthest:
        for a in range(BASINS):
            if has_minimum(k, a, Q):
                end_minimum(k, a, math.inf, Q)
        Q[k, surface_contact.SEARCHED] = math.inf
    elif minima.search_is_due(k, field, x, (radius, reach), Q):
        minima.search_all(k, field, x, (farthest, math.inf), tables)
    for a in range(k, k + BASINS):
        Q[a, surface_contact.START], Q[a, surface_contact.START + 1] = offset_of(a, Q)
        Q[a, surface_contact.START_DISTANCE] = Q[a, surface_contact.DISTANCE]
    for d in range(3):
        Q[k, surface_contact.START_CENTRE + d] = x[d]


@entry(UPDATE_MINIMA, **OPTIONS, **NO_COUNTS)
def update_minima(stage, first, last, tables):
    """Update the rows of candidates first to last in a trial (TRIAL), for the Jacobian of the last one (TANGENTS), at the end of
    a step (ACCEPT)."""
    Q, k = tables.Q, minima.next_rough(first, last, tables)
    while k < last:
        upper, i = is_upper(tables.partner[k]), tables.own[k]
        field = tables.upper if upper else tables.lower
        centre, radius = plates.three(tables.S, i, sphere.POSITION), tables.S[i, sphere.RADIUS]
        x = plates.to_surface(tables.partner[k], centre, tables.P)
        if stage == STAGE.ACCEPT:
            accept_sphere(k, field, x, tables)
        elif stage == STAGE.TRIAL and Q[k, surface_contact.MINIMA] != 0.0:
            follow_step(k, field, x, False, tables)
        elif stage == STAGE.TANGENTS and tables.D[domain.CURVED + upper] != 0.0:
            for a in range(BASINS):  # the gradient changes at minima within reach
                if has_minimum(k, a, Q) and Q[k + a, surface_contact.DISTANCE] < radius + tables.D[domain.REACH]:
                    write_gradient_change(k + a, field, x, radius, upper, Q)
        k = minima.next_rough(k + BASINS, last, tables)


@njit(**BARE_CHUNK)
def sort_candidates(b, context):
    """Move the candidates of body b that can touch in this step to the front, and note their number: those of a flat plate, and
    rows that have a minimum or had one at the start of the last step."""
    Q, low, high = context.Q, context.plate_edges[b], context.plate_edges[b + 1]
    e, count = low, 0
    for here in (True, False):
        k = low
        while k < high:
            rows = BASINS if (context.upper if is_upper(context.partner[k]) else context.lower).shape[0] > 0 else 1
            bits = int(Q[k, surface_contact.MINIMA]) | int(Q[k, surface_contact.ENDED])
            for row in range(rows):
                if (rows == 1 or bits >> row & 1 != 0) == here:
                    context.plate_incidence[e] = 2 * (k + row)
                    e += 1
            k += rows
        if here:
            count = e - low
    context.memory[b, step_memory.CANDIDATES] = count


@njit(**BARE)
def tensor_at(k, t, Q):
    return Q[k, t], Q[k, t + 1], Q[k, t + 2], Q[k, t + 3], Q[k, t + 4], Q[k, t + 5]


@entry(PART, **POINTED, **NO_COUNTS)
def rough_part(stage, h, a, m, motion, context, islands, scratch):
    b, space, Q = body_at(a, island_at(h, islands)), space_at(a, scratch), context.Q
    if stage == STAGE.START:
        sort_candidates(b, context)
        return
    update_rough(STAGE.TANGENTS, b, context)
    for q in range(m):
        k = space.slots[q]
        bend, gradient = tensor_at(k, surface_contact.NORMAL_GRADIENT, Q), plates.three(Q, k, surface_contact.GRADIENT)
        shape = bend, gradient, tensor_at(k, surface_contact.GRADIENT_CHANGE, Q)
        contact = plate_contact(q, motion.dt, shape, context, space)
        if bend != ZERO_TENSOR:
            add_general(contact, space.jacobian, np.int64(FREEDOMS), np.int64(0))
        else:
            add_plane(contact, context, space.jacobian)
