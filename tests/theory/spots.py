"""One contact of a law, driven step by step in plain Python."""

import functools

import closed_forms
import numpy as np
import three_spot_theory as theory
from theory.plain import plain
from thirdbody.laws.data import Contact, Load

plain = functools.cache(plain)


class Spot:
    """A sphere of this radius with the modulus E* on a plane; `row`: how many numbers the law keeps of its springs."""

    def __init__(self, law, p, row=0, e_star=1.0, radius=1.0):
        self.law, self.p, self.e_star, self.radius = law, p, e_star, radius
        self.h, self.w = (0.0,) * len(law.history), np.zeros(row)

    def evaluate(self, overlap, x=0.0, y=0.0, roll=0.0, across=0.0, share=0.0, viscous=0.0):
        """Arguments of the law and of its tangent. A dashpot adds a share of the spring's force, and newtons."""
        elastic, a = theory.hertz_force(self.e_star, self.radius, overlap), theory.contact_radius(self.radius, overlap)
        stiffness = (1.0 + share) * closed_forms.hertz_stiffness(self.e_star, self.radius, overlap)
        load = Load((1.0 + share) * elastic + viscous, elastic, a, stiffness, self.radius)
        touch = Contact(overlap, self.radius, 1.0, 0.0, x, y, 0.0, 0.0, roll, across)
        return touch, load, self.p, self.h, *((self.w,) if self.w.size else ())

    def answer(self, *step, **named):
        """What the law returns, and its new springs; nothing moves on."""
        w_new = np.full_like(self.w, np.nan)
        return *plain(self.law.kernel)(*self.evaluate(*step, **named), *((w_new,) if self.w.size else ())), w_new

    def move(self, *step, **named):
        answer, self.h, self.w = self.answer(*step, **named)
        return answer

    def tangent(self, *step, **named):
        return plain(self.law.tangent)(*self.evaluate(*step, **named))
