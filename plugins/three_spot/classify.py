"""The labeller: classifies a body as free, sticking, sliding or rolling. Two kernels over flat arrays.

Definitions, rules, margins and reasons: README.md, "Labels". `update_history` (in `motion`) follows every body at a fixed stride
of steps; `label` reads its memory when a frame is written, so that nothing depends on the output interval.

Rotations since the reference come from quaternions: a sum of increments drifts when a body wobbles. A reversal of a one-sided
body ends its history once its centre has moved back by 0.02 a. First load resets the reference only. A body that was free in
between keeps its reference: its rotation meanwhile counts in the window in which it lands, so that a snap over to another side is
labelled rolling, however short the flight. The reasons force_balance and moment_balance are for forecasts.

Source: E. Willert, Self-consistency conditions in static three-body elastic tangential contact, for the conditions; the travel
rules are new here.
"""

import math

from numba import njit

from thirdbody.plugin import NO_FORECAST, Labeller, helper, loaded_contact, observed_body

from .forecast import write_forecast, write_plain_forecast
from .motion import update_history
from .support import (
    ABOVE,
    BELOW,
    BOTH,
    EPS_ROLL,
    EXTRAS,
    FORECASTS,
    MARGINS,
    MIN_TRAVEL,
    NEITHER,
    Array,
    Posture,
    Triple,
    contact_travel,
    length,
    memory,
    noted,
    output,
    rotation_since,
    side_of,
    split,
    support_of,
)

MEMORY = tuple(f"{column.name}[{k}]" if column.width > 1 else column.name for column in memory for k in range(column.width))
CONTACT_MEMORY, OUTPUTS = noted.names(), output.WIDTH

STATES = ("free", "sticking", "sliding", "rolling")
FREE, STICKING, SLIDING, ROLLING = range(4)
REASONS = (
    "none", "friction_limit", "force_balance", "moment_balance", "lift_off", "rotation", "pivoting", "one_sided", "indeterminate",
    "unbalanced",
)  # fmt: skip
NONE, FRICTION_LIMIT, _, _, LIFT_OFF, ROTATION, PIVOTING, ONE_SIDED, INDETERMINATE, UNBALANCED = range(10)
WORDS = {
    "free": "carries no load", "sticking": "moves only as its contacts give way",
    "sliding": "all contacts with a plate slip", "rolling": "turns as the plate moves",
    "friction_limit": "all contacts with a plate slip", "lift_off": "a contact is lost", "rotation": "it tilts or turns over",
    "pivoting": "it turns about the normal of the plates", "one_sided": "it touches one plate only",
    "indeterminate": "nothing holds it against tipping", "unbalanced": "its forces are not in balance, inertia carries it",
}  # fmt: skip
EPS_LIMIT = 0.02
MAX_ROTATION_OVER_DRAG = 0.5  # fraction of the drag accommodated by rotation of a body that is not held
BALANCE = 0.05
ROUND_OFF = 1e-9  # slip over the contact radius that counts as zero; matters at mu = 0 only
LOWEST = -1e9  # margins stay finite and fit a float32


@helper
def slipping(C: Array, i: int) -> bool:
    """Return whether a spot slipped by more than its critical displacement in this window or in the last."""
    minimum = max(C[i, loaded_contact.CRITICAL_SLIP], ROUND_OFF * C[i, loaded_contact.CONTACT_RADIUS])
    return max(C[i, loaded_contact.SLIP] - C[i, noted.SLIP_AT_REFERENCE], C[i, noted.SLIP_LAST_WINDOW]) > minimum


@helper
def utilisation(C: Array, i: int) -> float:
    """eta = |T|/(mu N); without friction 1 if slipping, else 0."""
    if C[i, loaded_contact.FRICTION_LIMIT] <= 0.0:
        return 1.0 if slipping(C, i) else 0.0
    k = loaded_contact.TANGENTIAL_FORCE
    return length(C[i, k], C[i, k + 1], C[i, k + 2]) / C[i, loaded_contact.FRICTION_LIMIT]


@helper
def friction(C: Array, n: int, side: int) -> tuple[float, float, bool]:
    """Minimum and maximum eta of a side (inf, 0 without spots); whether all of it is at the limit and slips."""
    minimum, largest, slides = math.inf, 0.0, True
    for i in range(n):
        if side_of(C, i) == side:
            eta = utilisation(C, i)
            minimum = min(minimum, eta)
            largest = max(largest, eta)
            slides = slides and eta >= 1.0 - EPS_LIMIT and slipping(C, i)
    return minimum, largest, slides and minimum < math.inf


@helper
def static_margin(x: float, y: float, z: float, scale: float) -> float:
    """Distance from static equilibrium, 1 - |(x, y, z)|/(0.05 scale), of a sum of forces or of moments; 1 without a scale."""
    if scale <= 0.0:
        return 1.0
    return max(1.0 - length(x, y, z) / scale / BALANCE, LOWEST)


@helper
def determinacy(C: Array, n: int, observed: Array, a: float) -> float:
    """Largest spread of a side's loaded spots along the drag over a, minus 1: positive if the body is held. Without drag the
    spread in any horizontal direction counts."""
    ex, ey = observed[observed_body.DRAG], observed[observed_body.DRAG + 1]
    widest = 0.0
    for i in range(n):
        for j in range(i):
            if side_of(C, i) == side_of(C, j) and side_of(C, i) != NEITHER:
                x = C[i, loaded_contact.POINT] - C[j, loaded_contact.POINT]
                y = C[i, loaded_contact.POINT + 1] - C[j, loaded_contact.POINT + 1]
                apart = length(x, y, 0.0) if ex == 0.0 and ey == 0.0 else abs(x * ex + y * ey)
                widest = max(widest, apart)
    return min(widest / a - 1.0, -LOWEST)


@helper
def rotation_margin(observed: Array, m: Array, pose: Posture, p: float, determinate: bool) -> float:
    """Min of 1 - p/a, 1 - r/0.05 once a window closed, 1 - turn/0.5 if it is not held: <= 0 is rolling. turn: fraction of the
    drag accommodated by rotation since the set of loaded spots last changed; 0 below 0.02 a."""
    margin = 1.0 - p / pose[1]
    if m[memory.WINDOWS] > 0.0:
        margin = min(margin, 1.0 - m[memory.ROLL_RATIO] / EPS_ROLL)
    x, y = m[memory.CHANGE_DRAG], m[memory.CHANGE_DRAG + 1]
    size = length(x, y, 0.0)
    if pose[0] == BOTH and not determinate:
        by_rotation = 0.0
        if not (size < MIN_TRAVEL * pose[1] or size <= 0.0):
            rotation = rotation_since(observed, m, memory.CHANGE)
            by_rotation = pose[2] * (rotation[1] * (x / size) - rotation[0] * (y / size)) / size
        margin = min(margin, 1.0 - by_rotation / MAX_ROTATION_OVER_DRAG)
    return max(margin, LOWEST)


@helper
def rolling_reason(m: Array, pose: Posture, rotation: Triple, p: float) -> int:
    """Reason of the label rolling: lift_off, pivoting, rotation, indeterminate (rotation still elastic)."""
    if m[memory.LIFTED] > 0.0:
        return LIFT_OFF
    if p >= pose[1]:
        tilt, twist = split(rotation, pose[3], pose[4], pose[5])
        return PIVOTING if twist > tilt else ROTATION
    if m[memory.WINDOWS] > 0.0 and m[memory.ROLL_RATIO] >= EPS_ROLL:
        return PIVOTING if m[memory.PIVOTED] > 0.0 else ROTATION
    return INDETERMINATE


@helper
def write_ratios(C: Array, n: int, m: Array, pose: Posture, rotation: Triple, out: Array) -> None:
    """Write roll ratio and slip over travel of the last window, or of the first one so far."""
    if m[memory.WINDOWS] > 0.0:
        out[output.ROLL_RATIO] = m[memory.ROLL_RATIO]
        out[output.SLIP_OVER_TRAVEL] = m[memory.SLIP_OVER_TRAVEL]
    elif m[memory.TRAVEL] >= MIN_TRAVEL * pose[1] and m[memory.TRAVEL] > 0.0:
        out[output.ROLL_RATIO] = length(rotation[0], rotation[1], rotation[2]) * pose[2] / m[memory.TRAVEL]
        for i in range(n):
            out[output.SLIP_OVER_TRAVEL] = max(
                out[output.SLIP_OVER_TRAVEL], (C[i, loaded_contact.SLIP] - C[i, noted.SLIP_AT_REFERENCE]) / m[memory.TRAVEL]
            )


@njit(error_model="numpy")
def label(C: Array, n: int, observed: Array, m: Array, out: Array) -> None:
    """Write state, reason, MARGINS and EXTRAS of one body into `out` (OUTPUTS,), after `update_history` at the same instant.
    `sliding_side` is 0 none, 1 lower, 2 upper, 3 both; `rolled_distance` [m] grows when a window closes; `forecast` is 0 for a
    body that can only roll, 1 can stick, 3 can stick or slide, 4 none (`forecast`), followed by its ratios. Read-only for the
    memories. Every number is finite."""
    write_label(C, n, observed, m, out)
    write_forecast(C, n, observed, out)


@njit(error_model="numpy")
def label_without_effects(C: Array, n: int, observed: Array, m: Array, out: Array) -> None:
    """`label` of a body without effects, to the same bits: without the linear programmes, slow to compile."""
    write_label(C, n, observed, m, out)
    write_plain_forecast(C, n, observed, out)


@njit(error_model="numpy")
def label_without_forecasts(C: Array, n: int, observed: Array, m: Array, out: Array) -> None:
    """`label` of a body that has no forecast (NO_FORECAST): half the time."""
    write_label(C, n, observed, m, out)


@helper
def write_label(C: Array, n: int, observed: Array, m: Array, out: Array) -> None:
    """Write state, reason, margins, no forecast and the other extras: margins first, then the rules in order."""
    for k in range(OUTPUTS):
        out[k] = 1.0 if output.FRICTION <= k < output.SLIDING_SIDE else 0.0
    out[output.ROLLED_DISTANCE], out[output.FORECAST] = m[memory.ROLLED_DISTANCE], NO_FORECAST
    if n == 0:
        return
    pose = support_of(C, n)
    rotation = rotation_since(observed, m, memory.REFERENCE)
    p = contact_travel(C, n, rotation)
    total, f, t = 0.0, observed_body.FORCE, observed_body.TORQUE
    for i in range(n):
        total += abs(C[i, loaded_contact.NORMAL_FORCE])
    out[output.FORCE_BALANCE] = static_margin(observed[f], observed[f + 1], observed[f + 2], total)
    out[output.MOMENT_BALANCE] = static_margin(observed[t], observed[t + 1], observed[t + 2], total * pose[2])
    out[output.DETERMINACY] = determinacy(C, n, observed, pose[1])
    determinate = out[output.DETERMINACY] > 0.0
    out[output.ROTATION] = rotation_margin(observed, m, pose, p, determinate)
    write_ratios(C, n, m, pose, rotation, out)
    lower, upper, lateral = friction(C, n, BELOW), friction(C, n, ABOVE), friction(C, n, NEITHER)
    out[output.FRICTION] = max(1.0 - max(lower[1], upper[1], lateral[1]), LOWEST)
    if pose[0] & BELOW != 0:
        out[output.FRICTION_LOWER] = max(1.0 - lower[0], LOWEST)
    if pose[0] & ABOVE != 0:
        out[output.FRICTION_UPPER] = max(1.0 - upper[0], LOWEST)
    out[output.SLIDING_SIDE] = (1.0 if lower[2] else 0.0) + (2.0 if upper[2] else 0.0)
    slides = lower[2] or upper[2] or (pose[0] == NEITHER and lateral[2])
    if slides and (pose[0] != BOTH or out[output.ROTATION] > 0.0):
        out[output.STATE], out[output.REASON] = SLIDING, FRICTION_LIMIT
    elif out[output.ROTATION] <= 0.0:
        out[output.STATE], out[output.REASON] = ROLLING, rolling_reason(m, pose, rotation, p)
    else:
        out[output.STATE] = STICKING
        out[output.REASON] = ONE_SIDED if pose[0] != BOTH else (NONE if determinate else INDETERMINATE)
    if out[output.FORCE_BALANCE] < 0.0 or out[output.MOMENT_BALANCE] < 0.0:
        out[output.REASON] = UNBALANCED


LABELLER = Labeller(
    name="three_spot", observe=update_history, label=label, label_without_effects=label_without_effects,
    label_without_forecasts=label_without_forecasts, states=STATES, reasons=REASONS, margins=MARGINS, extras=EXTRAS,
    codes=("sliding_side", "forecast"), forecasts=FORECASTS, outputs=output, words=WORDS, memory=MEMORY,
    contact_memory=CONTACT_MEMORY,
    source="Willert, Self-consistency conditions in static three-body elastic tangential contact; labels by travel",
)  # fmt: skip
