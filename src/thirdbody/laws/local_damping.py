"""Cundall's local damping: a force against the motion, proportional to the unbalanced force. For settling only."""

import math
from typing import NamedTuple

from thirdbody.laws.contract import BodyEffect, Option, Options, kernel
from thirdbody.laws.kernel_data import Wrench


class LocalParameters(NamedTuple):
    """Fraction alpha of the unbalanced force."""

    alpha: float


@kernel
def against(alpha, force, velocity):
    """-alpha |F| sign(v); zero at rest."""
    return -alpha * math.fabs(force) * ((1.0 if velocity > 0.0 else 0.0) - (1.0 if velocity < 0.0 else 0.0))


@kernel
def local(b, total, p):
    """-alpha |F_k| sign(v_k) and -alpha |T_k| sign(omega_k), component by component along the world axes.

    It never moves a body at rest and vanishes in equilibrium, so it does not shift equilibrium positions; but it slows a fall to
    (1 - alpha) g and is unphysical: between two turning points the potential energy, measured from the equilibrium, falls to the
    fraction (1 - alpha)/(1 + alpha), whatever the frequency.
    """
    return Wrench(
        against(p.alpha, total.f_x, b.v_x), against(p.alpha, total.f_y, b.v_y), against(p.alpha, total.f_z, b.v_z),
        against(p.alpha, total.t_x, b.w_x), against(p.alpha, total.t_y, b.w_y), against(p.alpha, total.t_z, b.w_z),
    )  # fmt: skip


def mix_local(options: Options) -> LocalParameters:
    """Return the coefficient of the scene."""
    return LocalParameters(options["coefficient"])


LOCAL_DAMPING = BodyEffect(
    name="local_damping",
    kernel=local,
    parameters=LocalParameters,
    mix=mix_local,
    options=(
        Option("coefficient", "dimensionless", None, low=0.0, high=0.9, doc="fraction of the unbalanced force, such as 0.3"),
        Option("until", "dimensionless", "settled", words=("settled",), doc="when it ends: it is for settling only"),
    ),
    sees_forces=True,
    settling=True,
    source="Cundall 1987 (local nonviscous damping), as in PFC and YADE",
)
