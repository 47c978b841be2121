"""Support of a body, for the labeller: sides, lever, drag, rotation.

Tables: what the labeller writes for a body, and its memory of a body and of a loaded contact.
"""

import math

import numpy as np
from numpy.typing import NDArray

from thirdbody.plugin import DEBRIS, LOWER, Table, helper, loaded_contact, number, observed_body, skip, vector

Array = NDArray[np.float64]
Triple = tuple[float, float, float]
Posture = tuple[int, float, float, float, float, float]  # of `support_of`

EPS_ROLL, MIN_TRAVEL = 0.05, 0.02  # rotation over travel; contact radii
LATERAL = 0.3  # |n_z| below which a contact between debris is on neither side
TINY = 1e-300


def is_plain(value: int) -> int:
    """Return the number as a numpy integer: to numba a Python one is a type, and helpers are compiled again for each."""
    return np.int64(value)  # type: ignore[return-value]


# sides are bits: their sum is both
NEITHER, BELOW, ABOVE, BOTH = (is_plain(side) for side in range(4))
POINT, NORMAL, SURFACE = map(is_plain, (loaded_contact.POINT, loaded_contact.NORMAL, loaded_contact.PARTNER_VELOCITY))

# one row; margins and extras in the order of the contract of labellers
output = Table(
    "out",
    "a body",
    state=number("", "code of the state"),
    reason=number("", "code of the reason"),
    friction=number("", "1 - largest utilisation of friction over all spots"),
    friction_upper=number("", "1 - smallest utilisation of the upper spots; 0: all at the limit"),
    friction_lower=number("", "1 - smallest utilisation of the lower spots; 0: all at the limit"),
    force_balance=number("", "distance from static equilibrium of forces; negative: inertia carries the body"),
    moment_balance=number("", "the same of moments about the centre of mass"),
    determinacy=number("", "largest distance along the drag of two spots of one side / contact radius, minus 1"),
    rotation=number("", "distance from rolling; negative or zero: it rolls"),
    sliding_side=number("", "side that slides: 0 none, 1 lower, 2 upper, 3 both"),
    roll_ratio=number("", "rotation times lever / drag, in the last window of the label; 1: rolls without slip"),
    slip_over_travel=number("", "largest slip of a spot / drag, in the last window of the label"),
    rolled_distance=number("m", "length rolled since the start"),
    forecast=number("", "forecast, bits: 1 can stick, 2 can slide along the drag, 4 no forecast"),
    mu_required=number("", "friction needed to stick"),
    t_min=number("", "smallest friction at which it can slide"),
    t_max=number("", "largest friction at which it can slide"),
)
MARGINS = output.names()[output.FRICTION : output.SLIDING_SIDE]
EXTRAS = output.names()[output.SLIDING_SIDE :]
FORECASTS = output.names()[output.FORECAST :]

memory = Table(
    "m",
    "a body",
    reference=vector(4, "", "orientation at the reference"),
    change=vector(4, "", "orientation where the rule for free bodies began"),
    travel=number("m", "path of the drag since the reference"),
    change_drag=vector(2, "m", "drag since the rule for free bodies began"),
    windows=number("", "number of closed windows"),
    roll_ratio=number("", "roll ratio of the last closed window"),
    pivoted=number("", "1: that window turned more about the normal than in plane"),
    slip_over_travel=number("", "largest slip over the path in that window"),
    heading=vector(2, "m", "heading of a one-sided body"),
    reversed_path=number("m", "path against its heading"),
    rest_time=number("s", "time since the last test for rest"),
    rest_path=number("m", "path since then"),
    rolled_distance=number("m", "length rolled"),
    lifted=number("", "1: a spot lifted off since the reference"),
    loaded_count=number("", "number of loaded spots"),
    serial=number("", "number of the last observation with contacts"),
    plate_direction=vector(2, "", "direction of the drag at the last observation"),
    plates_moving=number("", "1: the plates moved then"),
    free_rotation=number("rad", "rotation while the body was free"),
)
memory.REFERENCE, memory.CHANGE = is_plain(memory.REFERENCE), is_plain(memory.CHANGE)

# behind the columns of `loaded_contact`
noted = Table(
    "C",
    "a loaded contact of a body",
    _=skip(loaded_contact.MEMORY),
    slip_at_reference=number("m", "slip at the reference"),
    slip_last_window=number("m", "slip in the last closed window"),
    stamp=number("", "number of the last observation in which it was loaded"),
)


@helper
def side_of(C: Array, i: int) -> int:
    """BELOW, ABOVE or NEITHER: by the plate or, between debris, by the vertical part of the normal."""
    if C[i, loaded_contact.PARTNER] < DEBRIS:
        return BELOW if C[i, loaded_contact.PARTNER] == LOWER else ABOVE
    if abs(C[i, loaded_contact.NORMAL + 2]) < LATERAL:
        return NEITHER
    return BELOW if C[i, loaded_contact.NORMAL + 2] > 0.0 else ABOVE


@helper
def length(x: float, y: float, z: float) -> float:
    """Length of a vector."""
    return math.sqrt(x * x + y * y + z * z)


@helper
def load_mean(C: Array, n: int, sides: int, k: int) -> Triple:
    """Load-weighted mean of C[:, k:k+3] over the spots on `sides` (bits; NEITHER: all); zero without load."""
    total = x = y = z = 0.0
    for i in range(n):
        if sides == NEITHER or (side_of(C, i) & sides) != 0:
            load = max(C[i, loaded_contact.LOAD], 0.0)
            total += load
            x += load * C[i, k]
            y += load * C[i, k + 1]
            z += load * C[i, k + 2]
    if total <= 0.0:
        return 0.0, 0.0, 0.0
    return x / total, y / total, z / total


@helper
def support_of(C: Array, n: int) -> Posture:
    """Loaded sides (bits), largest contact radius a [m] (never zero), lever D [m], unit axis."""
    sides = NEITHER
    a = TINY
    for i in range(n):
        sides |= side_of(C, i)
        a = max(a, C[i, loaded_contact.CONTACT_RADIUS])
    if sides == BOTH:
        apart = load_mean(C, n, ABOVE, POINT)[2] - load_mean(C, n, BELOW, POINT)[2]
        return sides, a, abs(apart), 0.0, 0.0, 1.0
    x, y, z = load_mean(C, n, sides, POINT)
    nx, ny, nz = load_mean(C, n, sides, NORMAL)
    size = length(nx, ny, nz)
    if size < LATERAL:  # loaded from opposite directions: no mean normal
        return sides, a, 2.0 * length(x, y, z), 0.0, 0.0, 1.0
    return sides, a, 2.0 * length(x, y, z), nx / size, ny / size, nz / size


@helper
def only_plates(C: Array, n: int) -> bool:
    """Return whether no debris is part of a side."""
    for i in range(n):
        if C[i, loaded_contact.PARTNER] >= DEBRIS and side_of(C, i) != NEITHER:
            return False
    return True


@helper
def drag(C: Array, n: int, observed: Array, pose: Posture) -> Triple:
    """Drag since the last observation: its x and y parts and the length of its path [m]."""
    elapsed = observed[observed_body.ELAPSED]
    if pose[0] == BOTH:
        if only_plates(C, n):
            x, y = observed[observed_body.PLATE_SHIFT], observed[observed_body.PLATE_SHIFT + 1]
        else:
            up = load_mean(C, n, ABOVE, SURFACE)
            low = load_mean(C, n, BELOW, SURFACE)
            x, y = elapsed * (up[0] - low[0]), elapsed * (up[1] - low[1])
        return x, y, length(x, y, 0.0)
    u, v, w = load_mean(C, n, pose[0], SURFACE)
    velocity = observed_body.VELOCITY
    u, v, w = observed[velocity] - u, observed[velocity + 1] - v, observed[velocity + 2] - w
    away = u * pose[3] + v * pose[4] + w * pose[5]
    x, y, z = u - away * pose[3], v - away * pose[4], w - away * pose[5]
    return elapsed * x, elapsed * y, elapsed * length(x, y, z)


@helper
def rotation_since(observed: Array, m: Array, k: int) -> Triple:
    """Rotation vector [rad], world axes, from the orientation stored at m[k:k+4] to the present one."""
    w = observed[observed_body.QUATERNION]
    x = observed[observed_body.QUATERNION + 1]
    y = observed[observed_body.QUATERNION + 2]
    z = observed[observed_body.QUATERNION + 3]
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
def has_rotated(observed: Array, m: Array, k: int, cosine_of_half: float) -> bool:
    """Return whether the body has rotated beyond an angle since the orientation stored at m[k:k+4]. `cosine_of_half`: cosine of
    half that angle, which the scalar part of the rotation between two unit quaternions is."""
    product = 0.0
    for i in range(4):
        product += observed[observed_body.QUATERNION + i] * m[k + i]
    return abs(product) < cosine_of_half


@helper
def split(rotation: Triple, nx: float, ny: float, nz: float) -> tuple[float, float]:
    """Rotation about in-plane axes and about the normal, both as magnitudes [rad]."""
    about = rotation[0] * nx + rotation[1] * ny + rotation[2] * nz
    return length(rotation[0] - about * nx, rotation[1] - about * ny, rotation[2] - about * nz), abs(about)


@helper
def contact_travel(C: Array, n: int, rotation: Triple) -> float:
    """Largest distance p [m] of a contact area over the body's surface by the rotation `rotation`."""
    cx, cy, cz = load_mean(C, n, NEITHER, POINT)
    p = 0.0
    for i in range(n):
        nx, ny, nz = C[i, loaded_contact.NORMAL], C[i, loaded_contact.NORMAL + 1], C[i, loaded_contact.NORMAL + 2]
        tilt, twist = split(rotation, nx, ny, nz)
        x, y, z = C[i, loaded_contact.POINT] - cx, C[i, loaded_contact.POINT + 1] - cy, C[i, loaded_contact.POINT + 2] - cz
        height = x * nx + y * ny + z * nz
        arm = length(x - height * nx, y - height * ny, z - height * nz)
        p = max(p, C[i, loaded_contact.SPHERE_RADIUS] * tilt, arm * twist)
    return p
