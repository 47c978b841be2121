"""How the gradient of the effective radius changes as a sphere moves on a rough plate: for the Jacobian of implicit steps.

In hollows nearly as narrow as the sphere the gradient force turns within nanometres; without its change Newton's method fails for
all but the shortest steps.
"""

import math

from numba import njit

from thirdbody.jit.options import BARE, BARE_CHUNK
from thirdbody.kernels.closest_point import Foot, inverse_of, log_radius_gradient, matrix_of
from thirdbody.kernels.height_field import jet_at, rounded_jet, within_period
from thirdbody.kernels.implicit.vector_algebra import cross
from thirdbody.kernels.tables import height_field, surface_contact

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
