"""Adhesion with necks that break at the largest pull, as those of LAMMPS do, at full steps: a plug-in for `neck_bed.py`."""

from dataclasses import replace

from thirdbody_effects.adhesion import ADHESION, cube_root, necks, necks_tangent
from thirdbody.plugin import Plugin, helper, kernel

PULL_OFF = 3.0 ** (1.0 / 3.0)  # length of a neck at its largest pull, y^3 = 3, over a_s^2/R
A_S = 0.39269908169872414  # pi/8: a_s^3 = pi/8 (w/E*) R^2


@helper
def still_joined(c, p, joined):
    scale = cube_root(A_S * p.adhesion * c.radius * c.radius)
    return joined if c.overlap > -PULL_OFF * scale * scale / c.radius else 0.0


@kernel
def pulled(c, p, h):
    return necks(c, p, (still_joined(c, p, h[0]), h[1]))


@kernel
def pulled_tangent(c, p, h):
    return necks_tangent(c, p, (still_joined(c, p, h[0]), h[1]))


PULLED = replace(ADHESION, name="neck_at_pull_off", kernel=pulled, tangent=pulled_tangent, variant=None, in_steps=None)

PLUGIN = Plugin(name="neck_at_pull_off", effects=(PULLED,), source="LAMMPS granular, jkr")
