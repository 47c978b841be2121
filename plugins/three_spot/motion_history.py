"""Update of the labeller's memory of a body. The rules are described in `classify`."""

import math

from numba import njit

from thirdbody.plugin import loaded_contact, observed_body

from .body_memory import (
    CHANGE,
    CHANGE_X,
    CHANGE_Y,
    COUNT,
    FREE_ROTATION,
    HEADING_X,
    HEADING_Y,
    LIFTED,
    MOVING,
    PIVOTED,
    PLATE_X,
    PLATE_Y,
    REFERENCE,
    REST_PATH,
    REST_TIME,
    REVERSED_PATH,
    ROLL_RATIO,
    ROLLED,
    SERIAL,
    SLIP_RATIO,
    TRAVEL,
    WINDOWS,
)
from .contact_memory import SLIP_LAST, SLIP_REFERENCE, STAMP
from .support_geometry import (
    BOTH,
    Array,
    Posture,
    Triple,
    contact_travel,
    drag,
    has_rotated,
    helper,
    length,
    rotation_since,
    split,
    support_of,
)

WINDOW = 4.0  # contact radii of travel
EPS_ROLL = 0.05
MIN_TRAVEL = 0.02  # contact radii
MAX_WINDOW_ROTATION = 1.0  # rad
COSINE_OF_HALF = math.cos(0.5 * MAX_WINDOW_ROTATION)
REST_SPAN = 50.0


@helper
def store_orientation(observed: Array, m: Array, k: int) -> None:
    """Store the present orientation at m[k:k+4]."""
    for j in range(4):
        m[k + j] = observed[observed_body.QUATERNION + j]


@helper
def anchor_change(observed: Array, m: Array) -> None:
    """Start the interval that the rule for bodies that are not held evaluates."""
    store_orientation(observed, m, CHANGE)
    m[CHANGE_X] = 0.0
    m[CHANGE_Y] = 0.0


@helper
def note_plates(observed: Array, m: Array) -> bool:
    """Return whether the plates stopped, started or reversed since the last observation."""
    moving = 1.0 if observed[observed_body.PLATE_SPEED] > 0.0 else 0.0
    along = observed[observed_body.DRAG] * m[PLATE_X] + observed[observed_body.DRAG + 1] * m[PLATE_Y]
    broke = moving != m[MOVING] or along < 0.0
    m[MOVING] = moving
    m[PLATE_X] = observed[observed_body.DRAG]
    m[PLATE_Y] = observed[observed_body.DRAG + 1]
    return broke


@helper
def note_spots(C: Array, n: int, observed: Array, m: Array) -> None:
    """Compare the set of loaded spots with the last one by stamps, in any order; record a lift-off."""
    saved = 0
    for i in range(n):
        if m[SERIAL] > 0.0 and C[i, STAMP] == m[SERIAL]:
            saved += 1
        C[i, STAMP] = m[SERIAL] + 1.0
    m[SERIAL] += 1.0
    if saved < m[COUNT]:
        m[LIFTED] = 1.0
    if saved < m[COUNT] or saved < n:
        anchor_change(observed, m)
    m[COUNT] = n


@helper
def is_reversed(m: Array, a: float, x: float, y: float) -> bool:
    """Update the heading of a one-sided body; return whether it has moved back by 0.02 a against it."""
    size = length(m[HEADING_X], m[HEADING_Y], 0.0)
    if size > 0.0:
        m[REVERSED_PATH] = max(0.0, m[REVERSED_PATH] - (x * m[HEADING_X] + y * m[HEADING_Y]) / size)
    m[HEADING_X] += x
    m[HEADING_Y] += y
    return m[REVERSED_PATH] > MIN_TRAVEL * a


@helper
def has_rested(C: Array, n: int, observed: Array, m: Array, a: float, path: float) -> bool:
    """Return whether the body did not travel during the span in which its load could have moved it far."""
    m[REST_TIME] += observed[observed_body.ELAPSED]
    m[REST_PATH] += path
    load = 0.0
    for i in range(n):
        load += max(C[i, loaded_contact.LOAD], 0.0)
    if m[REST_TIME] * m[REST_TIME] * load < REST_SPAN * REST_SPAN * observed[observed_body.MASS] * a or load <= 0.0:
        return False
    still = m[REST_PATH] < MIN_TRAVEL * a
    m[REST_TIME] = 0.0
    m[REST_PATH] = 0.0
    return still


@helper
def was_loaded(m: Array) -> bool:
    """Return whether the body has a reference: it was loaded before, and nothing ended its history since then."""
    return m[REFERENCE] != 0.0 or m[REFERENCE + 1] != 0.0 or m[REFERENCE + 2] != 0.0 or m[REFERENCE + 3] != 0.0


@helper
def follow_free(observed: Array, m: Array, broke: bool) -> None:
    """Add up rotation [rad] and drag of a free body: drag of the plates, or its own path where they rest."""
    if broke:
        for k in range(WINDOWS, ROLLED):
            m[k] = 0.0
        for k in range(REFERENCE, REFERENCE + 4):
            m[k] = 0.0
        m[TRAVEL] = m[FREE_ROTATION] = 0.0
    elif was_loaded(m):
        elapsed, spin, velocity = observed[observed_body.ELAPSED], observed_body.SPIN, observed_body.VELOCITY
        m[FREE_ROTATION] += length(observed[spin], observed[spin + 1], observed[spin + 2]) * elapsed
        if observed[observed_body.PLATE_SPEED] > 0.0:
            m[TRAVEL] += length(observed[observed_body.PLATE_SHIFT], observed[observed_body.PLATE_SHIFT + 1], 0.0)
        else:
            m[TRAVEL] += length(observed[velocity], observed[velocity + 1], 0.0) * elapsed


@helper
def history_ends(C: Array, n: int, observed: Array, m: Array, pose: Posture, step: Triple, broke: bool) -> bool:
    """Return whether a stop, a start, a reversal or rest ends the history."""
    if pose[0] == BOTH:
        m[HEADING_X] = m[HEADING_Y] = m[REVERSED_PATH] = 0.0
        if broke:
            return True
        if observed[observed_body.PLATE_SPEED] > 0.0:
            m[REST_TIME] = m[REST_PATH] = 0.0
            return False
    elif is_reversed(m, pose[1], step[0], step[1]):
        return True
    return has_rested(C, n, observed, m, pose[1], step[2])


@helper
def finish_window(C: Array, n: int, observed: Array, m: Array, pose: Posture, rotation: Triple, complete: bool) -> None:
    """End the window and start the next; store its ratios if it is complete, else clear all.

    Adds the length rolled in it, rotation about in-plane axes times D/2, unless the rotation was elastic; for a body that was
    free for a time the rotation during that time is excluded.
    """
    a = pose[1]
    tilt, twist = split(rotation, pose[3], pose[4], pose[5])
    travel = max(m[TRAVEL], WINDOW * a)  # shorter only if closed by a rotation of 1 rad
    ratio = m[ROLL_RATIO]
    if complete:
        ratio = max(length(tilt, twist, 0.0), m[FREE_ROTATION]) * pose[2] / travel  # quaternions do not count whole revolutions
    if ratio >= EPS_ROLL or contact_travel(C, n, rotation) >= a:
        m[ROLLED] += 0.5 * pose[2] * max(tilt - m[FREE_ROTATION], 0.0)
    slip = 0.0
    for i in range(n):
        C[i, SLIP_LAST] = C[i, loaded_contact.SLIP] - C[i, SLIP_REFERENCE] if complete else 0.0
        slip = max(slip, C[i, SLIP_LAST])
    if not complete:
        for k in range(WINDOWS, ROLLED):
            m[k] = 0.0
        return
    m[WINDOWS] += 1.0
    m[ROLL_RATIO] = ratio
    m[PIVOTED] = 1.0 if twist > tilt else 0.0
    m[SLIP_RATIO] = slip / travel
    size = length(m[HEADING_X], m[HEADING_Y], 0.0)
    if size > 0.0:  # the heading follows a curved path, averaged over about one window
        m[HEADING_X] *= a / size
        m[HEADING_Y] *= a / size


@njit(error_model="numpy")
def update_history(C: Array, n: int, observed: Array, m: Array) -> None:
    """Update the memory `m` of a body and that of its loaded contacts `C[:n]` to the present instant.

    `C` (n or more rows, `loaded_contact` and `contact_memory`), `observed` (`observed_body`), `m` (`body_memory`): as in the
    contract of labellers. Must be called for unloaded bodies, too (n = 0). The memory of a contact between two debris must be
    stored once for each of them.
    """
    landed = m[COUNT] == 0.0
    broke = note_plates(observed, m)
    note_spots(C, n, observed, m)
    if n == 0:
        follow_free(observed, m, broke)
        return
    first = not was_loaded(m)
    pose = support_of(C, n)
    step = drag(C, n, observed, pose)
    ends = history_ends(C, n, observed, m, pose, step, broke)
    closes = False
    if landed:  # spots that have just closed
        for i in range(n):
            C[i, SLIP_REFERENCE], C[i, SLIP_LAST] = C[i, loaded_contact.SLIP], 0.0
    if not first:
        if not ends:
            m[TRAVEL] += step[2]
            m[CHANGE_X] += step[0]
            m[CHANGE_Y] += step[1]
        rotated = m[FREE_ROTATION] > MAX_WINDOW_ROTATION or has_rotated(observed, m, REFERENCE, COSINE_OF_HALF)
        closes = m[TRAVEL] >= WINDOW * pose[1] or rotated
        if ends or closes:
            finish_window(C, n, observed, m, pose, rotation_since(observed, m, REFERENCE), not ends)
    if first or ends or closes:
        store_orientation(observed, m, REFERENCE)
        m[TRAVEL] = m[LIFTED] = m[FREE_ROTATION] = 0.0
        for i in range(n):
            C[i, SLIP_REFERENCE] = C[i, loaded_contact.SLIP]
    if landed or ends or has_rotated(observed, m, CHANGE, COSINE_OF_HALF):
        anchor_change(observed, m)
