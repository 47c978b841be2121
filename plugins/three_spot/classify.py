"""The labeller: is a body free, sticking, sliding or rolling? Two kernels over flat arrays.

`observe` follows every body at a fixed stride of steps, `label` reads the memory it keeps when a frame is written, so
that nothing depends on the output interval. Motion is judged by travel, never by speed: on the elastic reference path the
body turns with .65 of the drag while every spot still sticks.

Words used below
    drag        upper side relative to the lower one; of a one-sided body: its centre along the partner's surface
    travel W    path length of the drag since the reference; a window closes at W >= 4 a
    rotation    vector since the reference, from quaternions (a sum of increments would drift when the body wobbles)
    lever D     vertical distance of the sides' load centres; one-sided: twice the distance from centre to load centre
    roll ratio  rotation D / W of the last closed window
    patch travel p   R_i times the rotation about in-plane axes or, for pivoting, the distance of the spot from the common
                load centre times the rotation about its normal, whichever is larger, maximum over spots

What ends a history. A stop, a start or a reversal of the plates (of a two-sided body), a reversal of the centre (one-sided;
judged by .02 a of way back) clear windows and roll ratio. So does rest: with plates at rest, or on one side only, travel
below .02 a within REST_SPAN sqrt(m a / N), the time in which N could have moved the body far beyond a. Without it a body that
turned into its seat while it was pressed would be called rolling for ever. First load resets the reference only.
A window also closes after a rotation of 1 rad, before quaternions lose the count of turns.

Margins (positive = satisfied; 1 where a condition does not apply)
    friction         1 - max eta_i, every loaded spot
    friction_upper, friction_lower    1 - min eta_i of the side: it holds while one of its spots does
    force_balance    1 - |sum F - m a| / (.05 sum N)
    moment_balance   1 - |sum M - dL/dt| / (.05 sum N D)
    determinacy      max over sides of (spread of loaded spots along the drag) / a - 1; > 0 is "held"
    rotation         min of 1 - p/a, 1 - r/.05 and, for a body that is not held, 1 - turn/.5; <= 0 is rolling (a one-sided
                     body that skids is sliding whatever this says)

Reasons: sliding -> friction_limit; rolling -> lift_off (a spot was lost since the reference), pivoting, rotation, or
indeterminate while only the two-point rule tells; sticking -> none, one_sided, or indeterminate (not held); a body out of
balance -> unbalanced in place of any of these. force_balance and moment_balance are for forecasts.

Source: E. Willert, Self-consistency conditions in static three-body elastic tangential contact, for the conditions; the
travel rules are our own.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from .columns import (
    CONTACT_COLUMNS,
    CONTACT_RADIUS,
    CRITICAL,
    CURVATURE_RADIUS,
    DEBRIS,
    DRAG_DIRECTION,
    DRAG_SPEED,
    DRAG_STEP,
    ELAPSED,
    FORCE,
    LIMIT,
    LOAD,
    LOWER_PLATE,
    MASS,
    MOMENTUM_RATE,
    NORMAL_FORCE,
    NX,
    NZ,
    ORIENTATION,
    PARTNER,
    PX,
    PY,
    PZ,
    SLIP,
    SPIN_MOMENTUM_RATE,
    TORQUE,
    TX,
    TY,
    TZ,
    VELOCITY,
    VX,
)

Array = NDArray[np.float64]
Triple = tuple[float, float, float]
Posture = tuple[int, float, float, float, float, float]  # of `posture`

STATES = ("free", "sticking", "sliding", "rolling")
FREE, STICKING, SLIDING, ROLLING = range(4)
REASONS = (
    "none",
    "friction_limit",
    "force_balance",
    "moment_balance",
    "lift_off",
    "rotation",
    "pivoting",
    "one_sided",
    "indeterminate",
    "unbalanced",
)
(
    NONE,
    FRICTION_LIMIT,
    FORCE_BALANCE,
    MOMENT_BALANCE,
    LIFT_OFF,
    ROTATION,
    PIVOTING,
    ONE_SIDED,
    INDETERMINATE,
    UNBALANCED,
) = range(10)
MARGINS = (
    "friction",
    "friction_upper",
    "friction_lower",
    "force_balance",
    "moment_balance",
    "determinacy",
    "rotation",
)
EXTRAS = ("sliding_side", "roll_ratio", "slip_over_travel", "rolled_distance")
OUTPUTS = 2 + len(MARGINS) + len(EXTRAS)
OUT_FRICTION, OUT_UPPER, OUT_LOWER, OUT_FORCE, OUT_MOMENT, OUT_DETERMINACY, OUT_ROTATION = range(2, 9)
OUT_SIDE, OUT_ROLL, OUT_SLIP, OUT_ROLLED = range(9, 13)

CONTACT_MEMORY = ("slip_at_reference", "slip_last_window", "stamp")
SLIP_REFERENCE, SLIP_LAST, STAMP = range(CONTACT_COLUMNS, CONTACT_COLUMNS + 3)

MEMORY = (
    "reference_w",
    "reference_x",
    "reference_y",
    "reference_z",
    "change_w",
    "change_x",
    "change_y",
    "change_z",
    "travel",
    "change_drag_x",
    "change_drag_y",
    "windows",
    "roll_ratio",
    "pivoted",
    "slip_over_travel",
    "heading_x",
    "heading_y",
    "way_back",
    "rest_time",
    "rest_path",
    "rolled_distance",
    "lifted",
    "loaded_count",
    "serial",
    "plate_direction_x",
    "plate_direction_y",
    "plates_moving",
)
TRAVEL, CHANGE_X, CHANGE_Y = 8, 9, 10
# from WINDOWS up to ROLLED: what a stop or a reversal wipes out
WINDOWS, ROLL_RATIO, PIVOTED, SLIP_RATIO, HEADING_X, HEADING_Y, WAY_BACK, REST_TIME, REST_PATH = range(11, 20)
ROLLED, LIFTED, COUNT, SERIAL, PLATE_X, PLATE_Y, MOVING = range(20, 27)

# numpy integers: plain ones become literal types, and numba compiles a helper anew for each (both kernels: 7.3 s -> 2.8 s
# together with leaving out the wrappers below)
REFERENCE, CHANGE = np.int64(0), np.int64(4)
ARM, NORMAL, SURFACE = np.int64(PX), np.int64(NX), np.int64(VX)
PUSH, PUSH_RATE, TWIST, TWIST_RATE = np.int64(FORCE), np.int64(MOMENTUM_RATE), np.int64(TORQUE), np.int64(SPIN_MOMENTUM_RATE)
# sides are bits, so that their sum names "both"
NEITHER, LOWER, UPPER, BOTH = np.int64(0), np.int64(1), np.int64(2), np.int64(3)

WINDOW = 4.0  # contact radii of travel
EPS_ROLL = 0.05
EPS_LIMIT = 0.02
TURN = 0.5  # share of the drag that a body which is not held takes up by turning
LEAST_TRAVEL = 0.02  # contact radii
LATERAL = 0.3  # |n_z| below which a contact between debris is on neither side
BALANCE = 0.05
WHOLE_TURN = 1.0  # rad
REST_SPAN = 50.0
ROUND_OFF = 1e-9  # contact radii of slip that are no slip, felt at mu = 0 only
TINY = 1e-300
LOWEST = -1e9  # margins stay finite and fit a float32

helper = njit(error_model="numpy", no_cpython_wrapper=True, no_cfunc_wrapper=True)


@helper
def side_of(C: Array, i: int) -> int:
    """LOWER, UPPER or NEITHER: by the plate or, between debris, by the vertical part of the normal."""
    if C[i, PARTNER] < DEBRIS:
        return LOWER if C[i, PARTNER] == LOWER_PLATE else UPPER
    if abs(C[i, NZ]) < LATERAL:
        return NEITHER
    return LOWER if C[i, NZ] > 0.0 else UPPER


@helper
def length(x: float, y: float, z: float) -> float:
    """Length of a vector."""
    return math.sqrt(x * x + y * y + z * z)


@helper
def load_mean(C: Array, n: int, sides: int, k: int) -> Triple:
    """Load-weighted mean of C[:, k:k+3] over the spots on `sides` (bits; NEITHER: every spot); zero without load."""
    total = x = y = z = 0.0
    for i in range(n):
        if sides == NEITHER or (side_of(C, i) & sides) != 0:
            load = max(C[i, LOAD], 0.0)
            total += load
            x += load * C[i, k]
            y += load * C[i, k + 1]
            z += load * C[i, k + 2]
    if total <= 0.0:
        return 0.0, 0.0, 0.0
    return x / total, y / total, z / total


@helper
def posture(C: Array, n: int) -> Posture:
    """Sides that carry load (bits), largest contact radius a (m, never zero), lever D (m), unit axis of the surfaces."""
    sides = NEITHER
    a = TINY
    for i in range(n):
        sides |= side_of(C, i)
        a = max(a, C[i, CONTACT_RADIUS])
    if sides == BOTH:
        apart = load_mean(C, n, UPPER, ARM)[2] - load_mean(C, n, LOWER, ARM)[2]
        return sides, a, abs(apart), 0.0, 0.0, 1.0
    x, y, z = load_mean(C, n, sides, ARM)
    nx, ny, nz = load_mean(C, n, sides, NORMAL)
    size = length(nx, ny, nz)
    if size < LATERAL:  # pinched from opposite directions: there is no mean normal
        return sides, a, 2.0 * length(x, y, z), 0.0, 0.0, 1.0
    return sides, a, 2.0 * length(x, y, z), nx / size, ny / size, nz / size


@helper
def only_plates(C: Array, n: int) -> bool:
    """Whether no debris takes part in a side."""
    for i in range(n):
        if C[i, PARTNER] >= DEBRIS and side_of(C, i) != NEITHER:
            return False
    return True


@helper
def drag(C: Array, n: int, b: Array, pose: Posture) -> Triple:
    """Drag since the last observation: its x and y parts and the length of its path, m."""
    if pose[0] == BOTH:
        if only_plates(C, n):
            x, y = b[DRAG_STEP], b[DRAG_STEP + 1]
        else:
            up = load_mean(C, n, UPPER, SURFACE)
            low = load_mean(C, n, LOWER, SURFACE)
            x, y = b[ELAPSED] * (up[0] - low[0]), b[ELAPSED] * (up[1] - low[1])
        return x, y, length(x, y, 0.0)
    u, v, w = load_mean(C, n, pose[0], SURFACE)
    u, v, w = b[VELOCITY] - u, b[VELOCITY + 1] - v, b[VELOCITY + 2] - w
    away = u * pose[3] + v * pose[4] + w * pose[5]
    x, y, z = u - away * pose[3], v - away * pose[4], w - away * pose[5]
    return b[ELAPSED] * x, b[ELAPSED] * y, b[ELAPSED] * length(x, y, z)


@helper
def rotation_since(b: Array, m: Array, k: int) -> Triple:
    """Rotation vector (rad, world axes) from the orientation stored at m[k:k+4] to the present one."""
    w, x, y, z = b[ORIENTATION], b[ORIENTATION + 1], b[ORIENTATION + 2], b[ORIENTATION + 3]
    p, q, r, s = m[k], -m[k + 1], -m[k + 2], -m[k + 3]
    real = w * p - x * q - y * r - z * s
    i = w * q + x * p + y * s - z * r
    j = w * r - x * s + y * p + z * q
    h = w * s + x * r - y * q + z * p
    if real < 0.0:  # q and -q are the same orientation
        real, i, j, h = -real, -i, -j, -h
    size = length(i, j, h)
    factor = 2.0 if size < 1e-12 else 2.0 * math.atan2(size, real) / size
    return factor * i, factor * j, factor * h


@helper
def split(turn: Triple, nx: float, ny: float, nz: float) -> tuple[float, float]:
    """Rotation about in-plane axes and about the normal, both as magnitudes, rad."""
    about = turn[0] * nx + turn[1] * ny + turn[2] * nz
    return length(turn[0] - about * nx, turn[1] - about * ny, turn[2] - about * nz), abs(about)


@helper
def patch_travel(C: Array, n: int, turn: Triple) -> float:
    """Largest distance p that a patch has moved over the body's surface by the rotation `turn`, m."""
    cx, cy, cz = load_mean(C, n, NEITHER, ARM)
    p = 0.0
    for i in range(n):
        nx, ny, nz = C[i, NX], C[i, NX + 1], C[i, NX + 2]
        tilt, twist = split(turn, nx, ny, nz)
        x, y, z = C[i, PX] - cx, C[i, PY] - cy, C[i, PZ] - cz
        height = x * nx + y * ny + z * nz
        arm = length(x - height * nx, y - height * ny, z - height * nz)
        p = max(p, C[i, CURVATURE_RADIUS] * tilt, arm * twist)
    return p


@helper
def keep_orientation(b: Array, m: Array, k: int) -> None:
    """Store the present orientation at m[k:k+4]."""
    for j in range(4):
        m[k + j] = b[ORIENTATION + j]


@helper
def anchor_change(b: Array, m: Array) -> None:
    """Begin here what the rule for bodies that are not held looks at."""
    keep_orientation(b, m, CHANGE)
    m[CHANGE_X] = 0.0
    m[CHANGE_Y] = 0.0


@helper
def note_plates(b: Array, m: Array) -> bool:
    """Whether the plates stopped, started or reversed since the last observation."""
    moving = 1.0 if b[DRAG_SPEED] > 0.0 else 0.0
    along = b[DRAG_DIRECTION] * m[PLATE_X] + b[DRAG_DIRECTION + 1] * m[PLATE_Y]
    broke = moving != m[MOVING] or along < 0.0
    m[MOVING] = moving
    m[PLATE_X] = b[DRAG_DIRECTION]
    m[PLATE_Y] = b[DRAG_DIRECTION + 1]
    return broke


@helper
def note_spots(C: Array, n: int, b: Array, m: Array) -> None:
    """Compare the set of loaded spots with the last one by stamps, whatever their order; note a lift-off."""
    kept = 0
    for i in range(n):
        if m[SERIAL] > 0.0 and C[i, STAMP] == m[SERIAL]:
            kept += 1
        C[i, STAMP] = m[SERIAL] + 1.0
    m[SERIAL] += 1.0
    if kept < m[COUNT]:
        m[LIFTED] = 1.0
    if kept < m[COUNT] or kept < n:
        anchor_change(b, m)
    m[COUNT] = n


@helper
def turned_back(m: Array, a: float, x: float, y: float) -> bool:
    """Whether a one-sided body has come back by .02 a against its heading; follows the heading."""
    size = length(m[HEADING_X], m[HEADING_Y], 0.0)
    if size > 0.0:
        m[WAY_BACK] = max(0.0, m[WAY_BACK] - (x * m[HEADING_X] + y * m[HEADING_Y]) / size)
    m[HEADING_X] += x
    m[HEADING_Y] += y
    return m[WAY_BACK] > LEAST_TRAVEL * a


@helper
def rested(C: Array, n: int, b: Array, m: Array, a: float, path: float) -> bool:
    """Whether the body did not travel during the span in which its load could have moved it far."""
    m[REST_TIME] += b[ELAPSED]
    m[REST_PATH] += path
    load = 0.0
    for i in range(n):
        load += max(C[i, LOAD], 0.0)
    if m[REST_TIME] * m[REST_TIME] * load < REST_SPAN * REST_SPAN * b[MASS] * a or load <= 0.0:
        return False
    still = m[REST_PATH] < LEAST_TRAVEL * a
    m[REST_TIME] = 0.0
    m[REST_PATH] = 0.0
    return still


@helper
def history_ends(C: Array, n: int, b: Array, m: Array, pose: Posture, step: Triple, broke: bool) -> bool:
    """Whether a stop, a start, a reversal or rest ends what was seen so far."""
    if pose[0] == BOTH:
        m[HEADING_X] = m[HEADING_Y] = m[WAY_BACK] = 0.0
        if broke:
            return True
        if b[DRAG_SPEED] > 0.0:
            m[REST_TIME] = m[REST_PATH] = 0.0
            return False
    elif turned_back(m, pose[1], step[0], step[1]):
        return True
    return rested(C, n, b, m, pose[1], step[2])


@helper
def finish_window(C: Array, n: int, b: Array, m: Array, pose: Posture, turn: Triple, complete: bool) -> None:
    """End the window here and begin the next; store its roll ratio and slip if it is complete, else forget all.

    Adds the length rolled in it, rotation about in-plane axes times D/2, unless the rotation was elastic.
    """
    a = pose[1]
    tilt, twist = split(turn, pose[3], pose[4], pose[5])
    travel = max(m[TRAVEL], WINDOW * a)  # shorter only when a whole turn closed it
    ratio = m[ROLL_RATIO]
    if complete:
        ratio = length(tilt, twist, 0.0) * pose[2] / travel
    if ratio >= EPS_ROLL or patch_travel(C, n, turn) >= a:
        m[ROLLED] += 0.5 * pose[2] * tilt
    slip = 0.0
    for i in range(n):
        C[i, SLIP_LAST] = C[i, SLIP] - C[i, SLIP_REFERENCE] if complete else 0.0
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
    if size > 0.0:  # the heading follows a curved path with a memory of about one window
        m[HEADING_X] *= a / size
        m[HEADING_Y] *= a / size


@njit(error_model="numpy")
def observe(C: Array, n: int, b: Array, m: Array) -> None:
    """Follow one body: bring its memory `m` and that of its loaded contacts `C[:n]` to the present instant.

    `C` (n or more, CONTACT_COLUMNS + len(CONTACT_MEMORY)), `b` (BODY_COLUMNS,), `m` (len(MEMORY),) as in `columns`. To be
    called for unloaded bodies too (n = 0). The memory of a contact between two debris must be kept once for each of them.
    """
    fresh = m[COUNT] == 0.0
    broke = note_plates(b, m)
    note_spots(C, n, b, m)
    if n == 0:
        if broke:
            m[WINDOWS] = m[ROLL_RATIO] = 0.0
        return
    pose = posture(C, n)
    step = drag(C, n, b, pose)
    ends = history_ends(C, n, b, m, pose, step, broke)
    closes = False
    if not fresh:
        if not ends:
            m[TRAVEL] += step[2]
            m[CHANGE_X] += step[0]
            m[CHANGE_Y] += step[1]
        turn = rotation_since(b, m, REFERENCE)
        closes = m[TRAVEL] >= WINDOW * pose[1] or length(turn[0], turn[1], turn[2]) > WHOLE_TURN
        if ends or closes:
            finish_window(C, n, b, m, pose, turn, not ends)
    if fresh or ends or closes:
        keep_orientation(b, m, REFERENCE)
        m[TRAVEL] = m[LIFTED] = 0.0
        for i in range(n):
            C[i, SLIP_REFERENCE] = C[i, SLIP]
    turn = rotation_since(b, m, CHANGE)
    if fresh or ends or length(turn[0], turn[1], turn[2]) > WHOLE_TURN:
        anchor_change(b, m)


@helper
def slipping(C: Array, i: int) -> bool:
    """Whether a spot slipped by more than its critical displacement in this window or in the last."""
    least = max(C[i, CRITICAL], ROUND_OFF * C[i, CONTACT_RADIUS])
    return max(C[i, SLIP] - C[i, SLIP_REFERENCE], C[i, SLIP_LAST]) > least


@helper
def utilisation(C: Array, i: int) -> float:
    """eta = |T|/(mu N); without friction 1 if slipping, else 0."""
    if C[i, LIMIT] <= 0.0:
        return 1.0 if slipping(C, i) else 0.0
    return length(C[i, TX], C[i, TY], C[i, TZ]) / C[i, LIMIT]


@helper
def friction(C: Array, n: int, side: int) -> tuple[float, float, bool]:
    """Least and largest eta of a side (inf and 0 without spots), and whether all its spots are at the limit and slip."""
    least, largest, slides = math.inf, 0.0, True
    for i in range(n):
        if side_of(C, i) == side:
            eta = utilisation(C, i)
            least = min(least, eta)
            largest = max(largest, eta)
            slides = slides and eta >= 1.0 - EPS_LIMIT and slipping(C, i)
    return least, largest, slides and least < math.inf


@helper
def friction_margins(C: Array, n: int, pose: Posture, out: Array) -> bool:
    """Write 1 - max eta of all spots, 1 - min eta of each side and the sides that slide; whether the body slides."""
    lower = friction(C, n, LOWER)
    upper = friction(C, n, UPPER)
    lateral = friction(C, n, NEITHER)
    out[OUT_FRICTION] = max(1.0 - max(lower[1], upper[1], lateral[1]), LOWEST)
    if pose[0] & LOWER != 0:
        out[OUT_LOWER] = max(1.0 - lower[0], LOWEST)
    if pose[0] & UPPER != 0:
        out[OUT_UPPER] = max(1.0 - upper[0], LOWEST)
    out[OUT_SIDE] = (1.0 if lower[2] else 0.0) + (2.0 if upper[2] else 0.0)
    return lower[2] or upper[2] or (pose[0] == NEITHER and lateral[2])


@helper
def balance_margin(b: Array, k: int, rate: int, scale: float) -> float:
    """1 - |b[k:k+3] - b[rate:rate+3]| / (.05 scale); 1 without a scale."""
    if scale <= 0.0:
        return 1.0
    rest = length(b[k] - b[rate], b[k + 1] - b[rate + 1], b[k + 2] - b[rate + 2])
    return max(1.0 - rest / scale / BALANCE, LOWEST)


@helper
def determinacy(C: Array, n: int, b: Array, a: float) -> float:
    """Largest spread of a side's loaded spots along the drag, over a, less 1: positive if the body is held.

    Where nothing drags the spread is taken in any horizontal direction.
    """
    ex, ey = b[DRAG_DIRECTION], b[DRAG_DIRECTION + 1]
    widest = 0.0
    for i in range(n):
        for j in range(i):
            if side_of(C, i) == side_of(C, j) and side_of(C, i) != NEITHER:
                x, y = C[i, PX] - C[j, PX], C[i, PY] - C[j, PY]
                apart = length(x, y, 0.0) if ex == 0.0 and ey == 0.0 else abs(x * ex + y * ey)
                widest = max(widest, apart)
    return min(widest / a - 1.0, -LOWEST)


@helper
def turn_with_drag(b: Array, m: Array, pose: Posture) -> float:
    """Share of the drag taken up by turning since the set of loaded spots last changed; 0 below .02 a of drag."""
    x, y = m[CHANGE_X], m[CHANGE_Y]
    size = length(x, y, 0.0)
    if size < LEAST_TRAVEL * pose[1] or size <= 0.0:
        return 0.0
    turn = rotation_since(b, m, CHANGE)
    return pose[2] * (turn[1] * (x / size) - turn[0] * (y / size)) / size


@helper
def rotation_margin(b: Array, m: Array, pose: Posture, p: float, held: bool) -> float:
    """Positive unless the body rolls: min of 1 - p/a, 1 - r/.05 once a window closed, 1 - turn/.5 if it is not held."""
    margin = 1.0 - p / pose[1]
    if m[WINDOWS] > 0.0:
        margin = min(margin, 1.0 - m[ROLL_RATIO] / EPS_ROLL)
    if pose[0] == BOTH and not held:
        margin = min(margin, 1.0 - turn_with_drag(b, m, pose) / TURN)
    return max(margin, LOWEST)


@helper
def rolling_reason(m: Array, pose: Posture, turn: Triple, p: float) -> int:
    """Why a body counts as rolling: lift_off, pivoting, rotation, or indeterminate while its rotation is still elastic."""
    if m[LIFTED] > 0.0:
        return LIFT_OFF
    if p >= pose[1]:
        tilt, twist = split(turn, pose[3], pose[4], pose[5])
        return PIVOTING if twist > tilt else ROTATION
    if m[WINDOWS] > 0.0 and m[ROLL_RATIO] >= EPS_ROLL:
        return PIVOTING if m[PIVOTED] > 0.0 else ROTATION
    return INDETERMINATE


@helper
def ratios_so_far(C: Array, n: int, m: Array, pose: Posture, turn: Triple, out: Array) -> None:
    """Write roll ratio and slip over travel of the last window, or of the first one as far as it goes."""
    if m[WINDOWS] > 0.0:
        out[OUT_ROLL] = m[ROLL_RATIO]
        out[OUT_SLIP] = m[SLIP_RATIO]
    elif m[TRAVEL] >= LEAST_TRAVEL * pose[1] and m[TRAVEL] > 0.0:
        out[OUT_ROLL] = length(turn[0], turn[1], turn[2]) * pose[2] / m[TRAVEL]
        for i in range(n):
            out[OUT_SLIP] = max(out[OUT_SLIP], (C[i, SLIP] - C[i, SLIP_REFERENCE]) / m[TRAVEL])


@helper
def normal_sum(C: Array, n: int) -> float:
    """Sum of |N| over the loaded spots, N."""
    total = 0.0
    for i in range(n):
        total += abs(C[i, NORMAL_FORCE])
    return total


@njit(error_model="numpy")
def label(C: Array, n: int, b: Array, m: Array, out: Array) -> None:
    """Write state, reason, MARGINS and EXTRAS of one body into `out` (OUTPUTS,), after `observe` at the same instant.

    `sliding_side` is 0 none, 1 lower, 2 upper, 3 both; `rolled_distance` (m) grows when a window closes. Reads only: the
    memories stay as they are. Every number is finite. Margins come first, then the rules in their order.
    """
    for k in range(OUTPUTS):
        out[k] = 1.0 if OUT_FRICTION <= k < OUT_SIDE else 0.0
    out[OUT_ROLLED] = m[ROLLED]
    if n == 0:
        return
    pose = posture(C, n)
    turn = rotation_since(b, m, REFERENCE)
    p = patch_travel(C, n, turn)
    total = normal_sum(C, n)
    out[OUT_FORCE] = balance_margin(b, PUSH, PUSH_RATE, total)
    out[OUT_MOMENT] = balance_margin(b, TWIST, TWIST_RATE, total * pose[2])
    out[OUT_DETERMINACY] = determinacy(C, n, b, pose[1])
    held = out[OUT_DETERMINACY] > 0.0
    out[OUT_ROTATION] = rotation_margin(b, m, pose, p, held)
    ratios_so_far(C, n, m, pose, turn, out)
    slides = friction_margins(C, n, pose, out)
    if slides and (pose[0] != BOTH or out[OUT_ROTATION] > 0.0):
        out[0], out[1] = SLIDING, FRICTION_LIMIT
    elif out[OUT_ROTATION] <= 0.0:
        out[0], out[1] = ROLLING, rolling_reason(m, pose, turn, p)
    else:
        out[0] = STICKING
        out[1] = ONE_SIDED if pose[0] != BOTH else (NONE if held else INDETERMINATE)
    if out[OUT_FORCE] < 0.0 or out[OUT_MOMENT] < 0.0:
        out[1] = UNBALANCED
