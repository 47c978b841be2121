"""Central differences of a law's own step: a tangent that is consistent with it whatever happens within the step."""

from __future__ import annotations

import numpy as np
from numba import njit

from thirdbody.plugin import Contact, Load

STEP = 1e-6
"""Relative step: half the digits of the forces are left."""

helper = njit(error_model="numpy")


@helper
def moved(c, overlap, slip_x, slip_y):
    """The same contact at another overlap and after another slip."""
    return Contact(overlap, c.radius, c.mass, c.v_n, slip_x, slip_y, c.v_x, c.v_y, c.roll_x, c.roll_y)


@helper
def risen(load, overlap, rise):
    """The load when the overlap grows by `rise`: Hertz' part goes as d^1.5, the patch as d^0.5, all of it by its stiffness."""
    share = rise / overlap
    elastic = load.elastic * (1.0 + 1.5 * share)
    return Load(load.force + load.stiffness * rise, elastic, load.contact_radius * (1.0 + 0.5 * share), load.stiffness)


def central(law):
    """The tangent of a tangential kernel with a field by central differences: compiled, with the arguments of a tangent."""

    @helper
    def force(c, load, p, h, w, overlap, slip_x, slip_y):
        answer = law(moved(c, overlap, slip_x, slip_y), risen(load, c.overlap, overlap - c.overlap), p, h, w, np.empty(len(w)))[0]
        return answer.x, answer.y

    @helper
    def differences(c, load, p, h, w):
        e_d, e_s = STEP * c.overlap, STEP * max(p.kappa, 1e-3) * c.overlap
        right = force(c, load, p, h, w, c.overlap, c.slip_x + e_s, c.slip_y)
        left = force(c, load, p, h, w, c.overlap, c.slip_x - e_s, c.slip_y)
        back = force(c, load, p, h, w, c.overlap, c.slip_x, c.slip_y + e_s)
        front = force(c, load, p, h, w, c.overlap, c.slip_x, c.slip_y - e_s)
        deep = force(c, load, p, h, w, c.overlap + e_d, c.slip_x, c.slip_y)
        high = force(c, load, p, h, w, c.overlap - e_d, c.slip_x, c.slip_y)
        return (
            0.5 * (right[0] - left[0]) / e_s,
            0.5 * (back[0] - front[0]) / e_s,
            0.5 * (right[1] - left[1]) / e_s,
            0.5 * (back[1] - front[1]) / e_s,
            0.5 * (deep[0] - high[0]) / e_d,
            0.5 * (deep[1] - high[1]) / e_d,
        )

    return differences
