"""Update of the labeller's memory of a body. The rules are described in `classify`."""

import math

from numba import njit

from thirdbody.plugin import helper, loaded_contact, observed_body

from .support import (
    BOTH,
    EPS_ROLL,
    MIN_TRAVEL,
    Array,
    Posture,
    Triple,
    contact_travel,
    drag,
    has_rotated,
    length,
    memory,
    noted,
    rotation_since,
    split,
    support_of,
)

WINDOW = 4.0  # contact radii of travel
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
    store_orientation(observed, m, memory.CHANGE)
    m[memory.CHANGE_DRAG] = m[memory.CHANGE_DRAG + 1] = 0.0


@helper
def note_plates(observed: Array, m: Array) -> bool:
    """Return whether the plates stopped, started or reversed since the last observation."""
    moving = 1.0 if observed[observed_body.PLATE_SPEED] > 0.0 else 0.0
    x, y = observed[observed_body.DRAG], observed[observed_body.DRAG + 1]
    along = x * m[memory.PLATE_DIRECTION] + y * m[memory.PLATE_DIRECTION + 1]
    broke = moving != m[memory.PLATES_MOVING] or along < 0.0
    m[memory.PLATES_MOVING], m[memory.PLATE_DIRECTION], m[memory.PLATE_DIRECTION + 1] = moving, x, y
    return broke


@helper
def note_spots(C: Array, n: int, observed: Array, m: Array) -> None:
    """Compare the set of loaded spots with the last one by stamps, in any order; record a lift-off."""
    saved = 0
    for i in range(n):
        if m[memory.SERIAL] > 0.0 and C[i, noted.STAMP] == m[memory.SERIAL]:
            saved += 1
        C[i, noted.STAMP] = m[memory.SERIAL] + 1.0
    m[memory.SERIAL] += 1.0
    if saved < m[memory.LOADED_COUNT]:
        m[memory.LIFTED] = 1.0
    if saved < m[memory.LOADED_COUNT] or saved < n:
        anchor_change(observed, m)
    m[memory.LOADED_COUNT] = n


@helper
def has_rested(C: Array, n: int, observed: Array, m: Array, a: float, path: float) -> bool:
    """Return whether the body did not travel during the span in which its load could have moved it far."""
    m[memory.REST_TIME] += observed[observed_body.ELAPSED]
    m[memory.REST_PATH] += path
    load = 0.0
    for i in range(n):
        load += max(C[i, loaded_contact.LOAD], 0.0)
    needed = REST_SPAN * REST_SPAN * observed[observed_body.MASS] * a
    if m[memory.REST_TIME] * m[memory.REST_TIME] * load < needed or load <= 0.0:
        return False
    still = m[memory.REST_PATH] < MIN_TRAVEL * a
    m[memory.REST_TIME] = m[memory.REST_PATH] = 0.0
    return still


@helper
def was_loaded(m: Array) -> bool:
    """Return whether the body has a reference: it was loaded before, and nothing ended its history since then."""
    k = memory.REFERENCE
    return m[k] != 0.0 or m[k + 1] != 0.0 or m[k + 2] != 0.0 or m[k + 3] != 0.0


@helper
def follow_free(observed: Array, m: Array, broke: bool) -> None:
    """Add up rotation [rad] and drag of a free body: drag of the plates, or its own path where they rest."""
    if broke:
        for k in range(memory.WINDOWS, memory.ROLLED_DISTANCE):
            m[k] = 0.0
        for k in range(memory.REFERENCE, memory.REFERENCE + 4):
            m[k] = 0.0
        m[memory.TRAVEL] = m[memory.FREE_ROTATION] = 0.0
    elif was_loaded(m):
        elapsed, spin, velocity = observed[observed_body.ELAPSED], observed_body.SPIN, observed_body.VELOCITY
        m[memory.FREE_ROTATION] += length(observed[spin], observed[spin + 1], observed[spin + 2]) * elapsed
        if observed[observed_body.PLATE_SPEED] > 0.0:
            m[memory.TRAVEL] += length(observed[observed_body.PLATE_SHIFT], observed[observed_body.PLATE_SHIFT + 1], 0.0)
        else:
            m[memory.TRAVEL] += length(observed[velocity], observed[velocity + 1], 0.0) * elapsed


@helper
def history_ends(C: Array, n: int, observed: Array, m: Array, pose: Posture, step: Triple, broke: bool) -> bool:
    """Return whether a stop, a start, a reversal or rest ends the history."""
    a, (x, y, path) = pose[1], step
    if pose[0] == BOTH:
        m[memory.HEADING] = m[memory.HEADING + 1] = m[memory.REVERSED_PATH] = 0.0
        if broke:
            return True
        if observed[observed_body.PLATE_SPEED] > 0.0:
            m[memory.REST_TIME] = m[memory.REST_PATH] = 0.0
            return False
    else:  # has a one-sided body moved back by 0.02 a against its heading?
        size = length(m[memory.HEADING], m[memory.HEADING + 1], 0.0)
        if size > 0.0:
            along = (x * m[memory.HEADING] + y * m[memory.HEADING + 1]) / size
            m[memory.REVERSED_PATH] = max(0.0, m[memory.REVERSED_PATH] - along)
        m[memory.HEADING] += x
        m[memory.HEADING + 1] += y
        if m[memory.REVERSED_PATH] > MIN_TRAVEL * a:
            return True
    return has_rested(C, n, observed, m, a, path)


@helper
def finish_window(C: Array, n: int, observed: Array, m: Array, pose: Posture, rotation: Triple, complete: bool) -> None:
    """End the window and start the next; store its ratios if it is complete, else clear all. Adds the length rolled in it,
    rotation about in-plane axes times D/2, unless the rotation was elastic; for a body that was free for a time the rotation
    during that time is excluded."""
    a = pose[1]
    tilt, twist = split(rotation, pose[3], pose[4], pose[5])
    travel = max(m[memory.TRAVEL], WINDOW * a)  # shorter only if closed by a rotation of 1 rad
    ratio = m[memory.ROLL_RATIO]
    if complete:
        # quaternions do not count whole revolutions
        ratio = max(length(tilt, twist, 0.0), m[memory.FREE_ROTATION]) * pose[2] / travel
    if ratio >= EPS_ROLL or contact_travel(C, n, rotation) >= a:
        m[memory.ROLLED_DISTANCE] += 0.5 * pose[2] * max(tilt - m[memory.FREE_ROTATION], 0.0)
    slip = 0.0
    for i in range(n):
        C[i, noted.SLIP_LAST_WINDOW] = C[i, loaded_contact.SLIP] - C[i, noted.SLIP_AT_REFERENCE] if complete else 0.0
        slip = max(slip, C[i, noted.SLIP_LAST_WINDOW])
    if not complete:
        for k in range(memory.WINDOWS, memory.ROLLED_DISTANCE):
            m[k] = 0.0
        return
    m[memory.WINDOWS] += 1.0
    m[memory.ROLL_RATIO], m[memory.SLIP_OVER_TRAVEL], m[memory.PIVOTED] = ratio, slip / travel, 1.0 if twist > tilt else 0.0
    size = length(m[memory.HEADING], m[memory.HEADING + 1], 0.0)
    if size > 0.0:  # the heading follows a curved path, averaged over about one window
        m[memory.HEADING] *= a / size
        m[memory.HEADING + 1] *= a / size


@njit(error_model="numpy")
def update_history(C: Array, n: int, observed: Array, m: Array) -> None:
    """Update the memory `m` of a body and that of its loaded contacts `C[:n]` to the present instant. `C` (n or more rows,
    `loaded_contact` and `noted`), `observed` (`observed_body`), `m` (`memory`): as in the contract of labellers. Must be called
    for unloaded bodies, too (n = 0). The memory of a contact between two debris must be stored once for each of them."""
    landed = m[memory.LOADED_COUNT] == 0.0
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
            C[i, noted.SLIP_AT_REFERENCE], C[i, noted.SLIP_LAST_WINDOW] = C[i, loaded_contact.SLIP], 0.0
    if not first:
        if not ends:
            m[memory.TRAVEL] += step[2]
            m[memory.CHANGE_DRAG] += step[0]
            m[memory.CHANGE_DRAG + 1] += step[1]
        rotated = m[memory.FREE_ROTATION] > MAX_WINDOW_ROTATION or has_rotated(observed, m, memory.REFERENCE, COSINE_OF_HALF)
        closes = m[memory.TRAVEL] >= WINDOW * pose[1] or rotated
        if ends or closes:
            finish_window(C, n, observed, m, pose, rotation_since(observed, m, memory.REFERENCE), not ends)
    if first or ends or closes:
        store_orientation(observed, m, memory.REFERENCE)
        m[memory.TRAVEL] = m[memory.LIFTED] = m[memory.FREE_ROTATION] = 0.0
        for i in range(n):
            C[i, noted.SLIP_AT_REFERENCE] = C[i, loaded_contact.SLIP]
    if landed or ends or has_rotated(observed, m, memory.CHANGE, COSINE_OF_HALF):
        anchor_change(observed, m)
