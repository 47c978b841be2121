"""Contacts with rough plates in an implicit step: called through pointers, as `surface_minima` in explicit steps.

Newton's method tries positions from which there may be no way back, so every trial follows the minima from where they were at the
start of the step, and ends or finds none. An accepted step ends those that met others, and searches for new ones; it finds them
before they can touch, since no sphere moves farther in a step than the margin of the search (`step_control.travel_error`).
"""

import math

from numba import njit

from thirdbody.jit.options import BARE, BARE_CHUNK, NO_COUNTS, OPTIONS, entry
from thirdbody.kernels import first_body
from thirdbody.kernels.height_field import has_heights
from thirdbody.kernels.implicit.gradient_change import write_gradient_change
from thirdbody.kernels.predicates import BASINS, is_upper
from thirdbody.kernels.rough_plates import UPDATE
from thirdbody.kernels.surface_minima import (
    end_minimum,
    follow,
    has_minimum,
    is_same,
    next_rough,
    offset_of,
    reset_ended,
    search_all,
    search_is_due,
)
from thirdbody.kernels.tables import domain, height_field, sphere, surface_contact

MARGIN = 0.15
"""Largest gap of a minimum that is followed, in radii: more than `step_limits.TRAVEL` and `surface_minima.MOVED` together."""

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
    return first_body.to_surface(tables.partner[k], first_body.centre(tables.own[k], tables.S), tables.P)


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
