"""Cundall's local damping: a force against the motion, in proportion to what moves the body. For settling only."""

from __future__ import annotations

import math
from typing import NamedTuple

from thirdbody.laws.contract import BodyEffect, Option, Options, Wrench, kernel


class LocalParameters(NamedTuple):
    """Share alpha of the unbalanced force."""

    alpha: float


@kernel
def against(alpha, force, velocity):
    """-alpha |F| sign(v); zero at rest."""
    return -alpha * math.fabs(force) * ((1.0 if velocity > 0.0 else 0.0) - (1.0 if velocity < 0.0 else 0.0))


@kernel
def local(b, total, p):
    """-alpha |F_k| sign(v_k) and -alpha |T_k| sign(omega_k), component by component along the world's axes.

    It never moves a body at rest and vanishes in equilibrium, so it does not shift where things settle; but it slows a fall
    to (1 - alpha) g and is no physics: between two turning points the potential energy, taken from the equilibrium, falls to
    (1 - alpha)/(1 + alpha) of itself, whatever the frequency.
    """
    return Wrench(
        against(p.alpha, total.f_x, b.v_x), against(p.alpha, total.f_y, b.v_y), against(p.alpha, total.f_z, b.v_z),
        against(p.alpha, total.t_x, b.w_x), against(p.alpha, total.t_y, b.w_y), against(p.alpha, total.t_z, b.w_z),
    )  # fmt: skip


def mix_local(options: Options) -> LocalParameters:
    """The scene's coefficient."""
    return LocalParameters(options["coefficient"])


LOCAL_DAMPING = BodyEffect(
    name="local_damping",
    kernel=local,
    parameters=LocalParameters,
    mix=mix_local,
    options=(
        Option("coefficient", "dimensionless", None, low=0.0, high=0.9, doc="share of the unbalanced force, such as 0.3"),
        Option("until", "dimensionless", "settled", words=("settled",), doc="when it ends: it is for settling only"),
    ),
    sees_forces=True,
    settling=True,
    source="Cundall 1987 (local nonviscous damping), as in PFC and YADE",
)
