"""First bodies, between which the debris is: codes of partners, surfaces, velocities, direct contact.

The plane of the lower one is z = 0 and at rest, that of a patch of the upper one is at its height and looks down. Where both
plates are flat, answers come from these planes, otherwise from the table of closest points, which must be up to date.

The partner of a candidate is the number of a sphere, or a negative code of a first body and of the basin in which the sphere
touches it: -1 - basin, the lower plate; -1 - (1 + p) BASINS - basin, patch p of the upper plate. A flat plate has basin 0 only;
side walls, at y = 0 and at the far end, belong to a flat lower plate: basins 1 and 2.
"""

import math

import numpy as np
from numba import njit

from thirdbody.jit.options import BARE
from thirdbody.kernels.tables import body_extra, contact_state, patch, record, run_totals, sphere, surface_contact

BASINS = 8  # most contacts of a sphere with one plate
NEAR_WALL, FAR_WALL = 1, 2  # basins of side walls


@njit(**BARE)
def is_sphere(partner):
    return partner >= 0


@njit(**BARE)
def is_plate(partner):
    return partner < 0


@njit(**BARE)
def is_lower(partner):
    return -1 - BASINS < partner < 0


@njit(**BARE)
def is_upper(partner):
    return partner < -BASINS


@njit(**BARE)
def patch_of_partner(partner):
    """Return the row of the patch that is the partner; 0 for any other partner, to be read without a branch."""
    return max((-1 - partner) // BASINS - 1, 0)


@njit(**BARE)
def partner_code(p, basin):
    """Return the partner code of a basin of patch p of the upper plate, or with p = -1 of the lower plate."""
    return -1 - (1 + p) * BASINS - basin


@njit(**BARE)
def order_on_sphere(partner):
    """Return the order of a contact with a plate among those of its sphere: by plate, the lower one first, then by basin."""
    return (-1 - partner) % BASINS + (0 if is_lower(partner) else BASINS)


@njit(**BARE)
def kind_of(k, context):
    return np.int64(context.kind[k]) if context.kind.shape[0] > 0 else np.int64(0)


@njit(**BARE)
def is_closed(k, H):
    return H[k, contact_state.SLIP] != 0.0


@njit(**BARE)
def is_touching(k, H, R):
    """Return whether candidate k was closed with an overlap at the last record, not only within the reach of a law."""
    return is_closed(k, H) and R[k, record.OVERLAP] >= 0.0


@njit(**BARE)
def has_effect_columns(E):
    return E.shape[1] > body_extra.WIDTH_WITHOUT_EFFECTS


@njit(**BARE)
def is_rough(context):
    """Return whether a plate is rough; then all contacts with plates are in the table Q."""
    return context.Q.shape[0] > 0


@njit(**BARE)
def to_surface(partner, x, P):
    """Return a point in the coordinates of a first body: x and y move with it, z is the height above its plane [m]."""
    if not is_upper(partner):
        return x
    p = patch_of_partner(partner)
    return x[0] - P[p, patch.DISPLACEMENT], x[1] - P[p, patch.DISPLACEMENT + 1], P[p, patch.HEIGHT] - x[2]


@njit(**BARE)
def height_above(partner, i, S, P):
    """Return the height of the centre of sphere i above the plane of a first body, on the side of the debris [m]."""
    z, top = S[i, sphere.Z], P[patch_of_partner(partner), patch.HEIGHT]
    return top - z if is_upper(partner) else z


@njit(**BARE)
def distance_to_wall(basin, i, S, width):
    """Return the distance of the centre of sphere i from a side wall [m]; `width`: between the walls."""
    return S[i, sphere.Y] if basin == NEAR_WALL else width - S[i, sphere.Y]


@njit(**BARE)
def overlap(k, context):
    i, S = context.own[k], context.S
    if is_rough(context):
        return S[i, sphere.RADIUS] - context.Q[k, surface_contact.DISTANCE]
    return S[i, sphere.RADIUS] - height_above(context.partner[k], i, S, context.P)


@njit(**BARE)
def three(Q, k, column):
    return Q[k, column], Q[k, column + 1], Q[k, column + 2]


@njit(**BARE)
def normal(k, context):
    if is_rough(context):
        return three(context.Q, k, surface_contact.NORMAL)
    return 0.0, 0.0, -1.0 if is_upper(context.partner[k]) else 1.0


@njit(**BARE)
def normal_before(k, move, context):
    """Return the unit normal of candidate k before its sphere moved by `move` (3,) relative to the first body [m]."""
    Q, t, (n_x, n_y, n_z), (x, y, z) = context.Q, surface_contact.NORMAL_GRADIENT, normal(k, context), move
    if not is_rough(context):
        return n_x, n_y, n_z
    n_x = n_x - (Q[k, t] * x + Q[k, t + 3] * y + Q[k, t + 4] * z)
    n_y = n_y - (Q[k, t + 3] * x + Q[k, t + 1] * y + Q[k, t + 5] * z)
    n_z = n_z - (Q[k, t + 4] * x + Q[k, t + 5] * y + Q[k, t + 2] * z)
    inverse = 1.0 / math.sqrt(n_x * n_x + n_y * n_y + n_z * n_z)
    return n_x * inverse, n_y * inverse, n_z * inverse


@njit(**BARE)
def effective_radius(k, context):
    return context.Q[k, surface_contact.RADIUS] if is_rough(context) else context.S[context.own[k], sphere.RADIUS]


@njit(**BARE)
def radius_of_curvature(k, context):
    """Return the radius of curvature of a first body at candidate k [m], that of a sphere of the same effect; 0: flat."""
    if not is_rough(context):
        return 0.0
    bend = 1.0 / context.Q[k, surface_contact.RADIUS] - 1.0 / context.S[context.own[k], sphere.RADIUS]
    return 1.0 / bend if bend != 0.0 else 0.0


@njit(**BARE)
def velocity(partner, P, motion):
    if is_upper(partner):
        return motion.v_x, motion.v_y, P[patch_of_partner(partner), patch.VELOCITY]
    return 0.0, 0.0, 0.0


@njit(**BARE)
def surface_velocity(i, S, columns, arm):
    v, w = columns
    (o_x, o_y, o_z), (r_x, r_y, r_z) = three(S, i, w), arm
    return S[i, v] + o_y * r_z - o_z * r_y, S[i, v + 1] + o_z * r_x - o_x * r_z, S[i, v + 2] + o_x * r_y - o_y * r_x


@njit(**BARE)
def partner_velocity(j, context, columns, arm, motion):
    return velocity(j, context.P, motion) if is_plate(j) else surface_velocity(j, context.S, columns, arm)


@njit(**BARE)
def direct_force(P, p):
    if P[p, patch.DIRECT_PREFACTOR] == 0.0:
        return 0.0
    return P[p, patch.DIRECT_PREFACTOR] * math.exp(-P[p, patch.HEIGHT] / P[p, patch.DIRECT_LENGTH])


@njit(**BARE)
def max_stiffness(P, p, time):
    """Return the largest stiffness [N/m] of direct contact within a time [s]: the energy of the approach limits the depth, and
    the force that stops it grows with the depth."""
    v, a = P[p, patch.VELOCITY], (P[p, patch.FORCE] - P[p, patch.LOAD]) / P[p, patch.MASS]
    t = min(time, -v / a) if a > 0.0 and v < 0.0 else time
    deeper, now, length = max(-v * t - 0.5 * a * t * t, 0.0), direct_force(P, p), P[p, patch.DIRECT_LENGTH]
    energy = 0.5 * P[p, patch.MASS] * v * v + P[p, patch.LOAD] * deeper
    return min(now * math.exp(min(deeper / length, 700.0)), now + energy / length) / length


@njit(**BARE)
def book_direct_contact(A, force, motion, old):
    """Add a step to the totals A: impulses, and the work of friction, which the drive of the plate supplies. `force`: normal
    force at the end of the step [N], and friction coefficient; `old`: weight of the force at its start."""
    normal, mu = force
    speed = math.sqrt(motion.v_x * motion.v_x + motion.v_y * motion.v_y)
    drag = mu * normal / speed if speed > 0.0 else 0.0
    work = mu * speed * motion.dt * (old * A[run_totals.DIRECT_FORCE + 2] + (1.0 - old) * normal)
    A[run_totals.DIRECT_WORK] += work
    A[run_totals.DRAG_WORK] += work
    A[run_totals.PLATE_WORK] += work
    A[run_totals.PLATE_WORK_SIZE] += work
    now = (-drag * motion.v_x, -drag * motion.v_y, normal)
    for k in range(3):
        A[run_totals.DIRECT_IMPULSE + k] += motion.dt * (old * A[run_totals.DIRECT_FORCE + k] + (1.0 - old) * now[k])
        A[run_totals.DIRECT_FORCE + k] = now[k]
