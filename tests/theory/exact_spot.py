"""One contact that is driven straight through the kernel of the law `exact`. Lengths in units of R, E* = 1.

The kernel is interpreted: a step takes 0.1 to 0.5 ms, and compiling it 17 s."""

import closed_forms
import numpy as np
import three_spot_theory as theory
from theory.plain import plain
from thirdbody_three_spot.exact import NODES, exact, exact_tangent
from thirdbody_three_spot.exact_springs import cells_of
from thirdbody_three_spot.mdr import SpringParameters
from thirdbody_three_spot.spring_field import SPARE
from thirdbody.laws.data import Contact, Load

E, G, R, MU = 1.0, 0.8, 1.0, 0.3
D0, D1 = 0.006, 0.01
KAPPA = MU * E / G


PLAIN = {}
run_exact = plain(exact, PLAIN)
run_exact_tangent = plain(exact_tangent, PLAIN)


class Spot:
    """`damped` scales the elastic load, `viscous` adds to it."""

    def __init__(self, mu=MU, renewal=2.0, nodes=NODES.default):
        self.p, self.nodes = SpringParameters(G, mu, mu * E / G, renewal), int(nodes)
        self.reset(0.0)

    def reset(self, overlap):
        self.h, self.w = (overlap,) + (0.0,) * 7, np.zeros(3 * self.nodes)
        self.force, self.stored = np.zeros(2), 0.0

    def evaluate(self, overlap, slip, roll=0.0, damped=1.0, viscous=0.0):
        """A slip that is a number is along x."""
        slip = (slip, 0.0) if np.isscalar(slip) else slip
        a, n = theory.contact_radius(R, overlap), theory.hertz_force(E, R, overlap)
        stiffness = damped * closed_forms.hertz_stiffness(E, R, overlap)
        touch = Contact(overlap, R, 1.0, 0.0, float(slip[0]), float(slip[1]), 0.0, 0.0, roll, 0.0)
        return touch, Load(damped * n + viscous, n, a, stiffness, 0.0)

    def move(self, overlap, slip, roll=0.0, damped=1.0):
        """One step to an overlap. Returns the law's answer, None where there is no touch."""
        if overlap <= 0.0:
            return self.reset(overlap)
        w_new = np.full(3 * self.nodes, np.nan)
        answer, self.h = run_exact(*self.evaluate(overlap, slip, roll, damped), self.p, self.h, self.w, w_new)
        assert np.isfinite(w_new).all()
        assert 2 <= self.h[1] <= self.nodes - SPARE or -1 - cells_of.py_func(w_new) <= self.h[1] < 0
        self.w, self.force, self.stored = w_new, np.array([answer.x, answer.y]), answer.stored
        return answer

    def path(self, overlap, slip, steps):
        """Straight to an overlap in equal steps; the sum of -T_new ds."""
        first, work = max(self.h[0], 0.0), 0.0
        slip = np.array([slip, 0.0]) if np.isscalar(slip) else slip
        for i in range(1, steps + 1):
            assert self.move(first + (overlap - first) * i / steps, slip / steps).dissipated >= 0.0
            work -= float(self.force @ slip) / steps
        return work

    def answer(self, overlap, slip, **more):
        answer, _ = run_exact(*self.evaluate(overlap, slip, **more), self.p, self.h, self.w, np.empty(len(self.w)))
        return np.array([answer.x, answer.y])

    def tangent(self, overlap, slip, **more):
        """Columns: over slip x, slip y, overlap."""
        xx, xy, yx, yy, xd, yd = run_exact_tangent(*self.evaluate(overlap, slip, **more), self.p, self.h, self.w)
        return np.array([[xx, xy, xd], [yx, yy, yd]])


def corners(rng, count, line=True):
    """Random overlaps and slips of all sizes: (overlap, slip) along x, or in the plane."""
    for _ in range(count):
        slip = rng.normal(size=2) * 10.0 ** rng.uniform(-2.0, 0.5) * KAPPA * D1
        yield rng.uniform(0.05, 1.0) * D1, float(slip[0]) if line else slip


def circle(share, steps):
    """Overlaps and slips (steps + 1): out along x by a share of s_c in an eighth of the steps, and once around."""
    t = np.linspace(0.0, 1.0, steps + 1)
    out, angle = np.minimum(8.0 * t, 1.0), 2.0 * np.pi * np.maximum(8.0 * t - 1.0, 0.0) / 7.0
    places = share * KAPPA * D0 * (out * np.array([np.cos(angle), np.sin(angle)])).T
    return np.full(steps + 1, D0), np.diff(places, axis=0, prepend=places[:1])
