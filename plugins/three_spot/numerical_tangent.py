"""Central differences of a law's own step: a tangent consistent with it whatever happens within the step."""

import numpy as np

from thirdbody.plugin import Contact, Load, helper

STEP = 1e-6
"""Relative step: half the digits of the forces remain."""


@helper
def displaced(c, overlap, slip_x, slip_y):
    """Return the same contact at another overlap and after another slip."""
    return Contact(overlap, c.radius, c.mass, c.v_n, slip_x, slip_y, c.v_x, c.v_y, c.roll_x, c.roll_y)


@helper
def risen(load, overlap, increment):
    """Return the load after the overlap has grown by `increment`.

    The part of Hertz goes as d^1.5, the contact radius as d^0.5, the total by its stiffness.
    """
    fraction = increment / overlap
    elastic, radius = load.elastic * (1.0 + 1.5 * fraction), load.contact_radius * (1.0 + 0.5 * fraction)
    return Load(load.force + load.stiffness * increment, elastic, radius, load.stiffness, load.squared_radius_rate)


def central(law):
    """Return the tangent of a tangential kernel with a field by central differences.

    It is compiled and has the arguments of a tangent.
    """

    @helper
    def differences(c, load, p, h, w):
        e_d, e_s = STEP * c.overlap, STEP * max(p.kappa, 1e-3) * c.overlap
        forces, w_new = np.empty((6, 2)), np.empty(len(w))
        for k in range(6):  # one call only: the law is inlined, and six copies take seconds more to compile
            size = 1.0 if k % 2 == 0 else -1.0
            x, y = c.slip_x + (size * e_s if k < 2 else 0.0), c.slip_y + (size * e_s if k // 2 == 1 else 0.0)
            d = c.overlap + (size * e_d if k >= 4 else 0.0)
            answer = law(displaced(c, d, x, y), risen(load, c.overlap, d - c.overlap), p, h, w, w_new)[0]
            forces[k, 0], forces[k, 1] = answer.x, answer.y
        return (
            0.5 * (forces[0, 0] - forces[1, 0]) / e_s,
            0.5 * (forces[2, 0] - forces[3, 0]) / e_s,
            0.5 * (forces[0, 1] - forces[1, 1]) / e_s,
            0.5 * (forces[2, 1] - forces[3, 1]) / e_s,
            0.5 * (forces[4, 0] - forces[5, 0]) / e_d,
            0.5 * (forces[4, 1] - forces[5, 1]) / e_d,
        )

    return differences
