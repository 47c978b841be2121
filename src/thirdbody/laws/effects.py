"""Built-in body effects, inactive unless a scene names them, and the labeller of scenes without labels.

Gravity, viscous damping of the motion, and Cundall's local damping: a force against the motion, proportional to the unbalanced
force, for settling only.
"""

import math
from typing import NamedTuple

from thirdbody.laws.contract import BodyEffect, Labeller, Option, kernel
from thirdbody.laws.data import Wrench


class GravityParameters(NamedTuple):
    """Acceleration [m/s2]."""

    g_x: float
    g_y: float
    g_z: float


@kernel
def gravity(b, p):
    """m g at the centre of mass."""
    return Wrench(b.mass * p.g_x, b.mass * p.g_y, b.mass * p.g_z, 0.0, 0.0, 0.0)


class ViscousParameters(NamedTuple):
    """Decay rate of the velocity [1/s]."""

    rate: float


@kernel
def viscous(b, p):
    """-rate m v and -rate I omega with the mean moment of inertia: a background that slows all motion equally."""
    f, t = -p.rate * b.mass, -p.rate * b.inertia
    return Wrench(f * b.v_x, f * b.v_y, f * b.v_z, t * b.w_x, t * b.w_y, t * b.w_z)


GRAVITY = BodyEffect(
    "gravity", gravity, GravityParameters, lambda options: GravityParameters(*options["acceleration"]), "Newton 1687",
    (Option("acceleration", "acceleration", None, size=3, doc="acceleration vector"),),
)  # fmt: skip

DAMPING = BodyEffect(
    "damping", viscous, ViscousParameters, lambda options: ViscousParameters(options["rate"]),
    "linear (Stokes) drag with a uniform rate",
    (Option("rate", "rate", None, low=0.0, doc='rate at which velocities decay, such as "1e4 1/s"'),),
)  # fmt: skip


class LocalParameters(NamedTuple):
    """Fraction alpha of the unbalanced force."""

    alpha: float


@kernel
def against(alpha, force, velocity):
    """-alpha |F| sign(v); zero at rest."""
    return -alpha * math.fabs(force) * ((1.0 if velocity > 0.0 else 0.0) - (1.0 if velocity < 0.0 else 0.0))


@kernel
def local(b, total, p):
    """-alpha |F_k| sign(v_k) and -alpha |T_k| sign(omega_k), component by component along the world axes: zero in equilibrium,
    but it slows a fall to (1 - alpha) g: between two turning points the potential energy falls to (1 - alpha)/(1 + alpha) of
    it."""
    return Wrench(
        against(p.alpha, total.f_x, b.v_x), against(p.alpha, total.f_y, b.v_y), against(p.alpha, total.f_z, b.v_z),
        against(p.alpha, total.t_x, b.w_x), against(p.alpha, total.t_y, b.w_y), against(p.alpha, total.t_z, b.w_z),
    )  # fmt: skip


LOCAL_DAMPING = BodyEffect(
    "local_damping", local, LocalParameters, lambda options: LocalParameters(options["coefficient"]),
    "Cundall 1987 (local nonviscous damping), as in PFC and YADE",
    (
        Option("coefficient", "dimensionless", None, low=0.0, high=0.9, doc="fraction of the unbalanced force, such as 0.3"),
        Option("until", "dimensionless", "settled", words=("settled",), doc="when it ends: it is for settling only"),
    ), sees_forces=True, settling=True,
)  # fmt: skip


@kernel
def observe_nothing(contacts, n, body, memory):
    memory[0] += 0.0


@kernel
def label_nothing(contacts, n, body, memory, out):
    out[0] = 0.0


NO_LABELS = Labeller("none", observe_nothing, label_nothing, *6 * ((),), source="")
"""Labeller without effect, for scenes without labels or body effects: the target of a function pointer that is never called."""
