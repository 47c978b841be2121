"""Rolling resistance: a moment that opposes relative rolling, elastic up to mu_r R* N. Inactive unless a scene names it."""

import math
from typing import NamedTuple

from thirdbody.laws.contract import Law, Option, kernel
from thirdbody.laws.data import Rolling
from thirdbody.laws.hertz import e_star
from thirdbody.laws.memory import friction_tangent

STIFFNESS = 2.25  # k_r over k_n (mu_r R*)^2 (Iwashita and Oda 1998; Wensrich and Katterfeld 2012, Eq. 10).
INERTIA = 7.0 / 5.0  # moment of inertia of a ball about its contact point over m R^2


class RollingParameters(NamedTuple):
    """Coefficient; k_r over mu_r^2 R*^2 a [Pa]; viscosity over that of critical damping of a ball rolling on a plane."""

    mu_r: float
    scale: float
    ratio: float


@kernel
def rolling_resistance(c, turn, load, p, h):
    """Spring limited to mu_r R* N, k_r = 2.25 k_n (mu_r R*)^2 with k_n = 2 E* a, the normal stiffness of any circular contact. As
    in `coulomb`, a falling stiffness releases its fraction of moment and energy: U = M^2/(2 k_r)."""
    x_old, y_old, k_old = h
    arm = p.mu_r * c.radius
    limit = arm * load.force
    stiffness = p.scale * arm * arm * load.contact_radius
    saved = stiffness / max(max(stiffness, k_old), 1e-300)
    x_scaled, y_scaled = saved * x_old, saved * y_old
    x_try, y_try = x_scaled - stiffness * turn.x, y_scaled - stiffness * turn.y
    size = math.sqrt(x_try * x_try + y_try * y_try)
    back = limit / max(size, max(limit, 1e-300))
    x, y = back * x_try, back * y_try
    compliance = 1.0 / max(stiffness, 1e-300)
    irreversible = (1.0 - back) * size * compliance
    before = 0.5 * (x_old * x_old + y_old * y_old) / max(k_old, 1e-300)
    loaded = 0.5 * (x_scaled * x_scaled + y_scaled * y_scaled) * compliance
    stored = 0.5 * (x * x + y * y) * compliance
    dissipated = before - loaded + back * size * irreversible
    viscosity = p.ratio * c.radius * math.sqrt(c.mass * stiffness)
    return Rolling(x, y, limit, viscosity, irreversible, stored, dissipated), (x, y, stiffness)


@kernel
def rolling_tangent(c, turn, load, p, h):
    """Consistent tangent of one step: dM/d(turn) and dM/d(overlap)."""
    x_old, y_old, k_old = h
    arm = p.mu_r * c.radius
    stiffness = p.scale * arm * arm * load.contact_radius
    rate = p.scale * arm * arm * 0.5 * load.squared_radius_rate / max(load.contact_radius, 1e-300)
    saved = stiffness / max(max(stiffness, k_old), 1e-300)
    scale_rate = rate / k_old if stiffness < k_old else 0.0
    x, y = saved * x_old - stiffness * turn.x, saved * y_old - stiffness * turn.y
    x_rate = scale_rate * x_old - rate * turn.x
    y_rate = scale_rate * y_old - rate * turn.y
    return friction_tangent(x, y, arm * load.force, arm * load.stiffness, stiffness, x_rate, y_rate)


ROLLING_RESISTANCE = Law(
    "rolling_resistance", "rolling", rolling_resistance, RollingParameters,
    lambda pair, options: RollingParameters(
        options["coefficient"], STIFFNESS * 2.0 * e_star(pair.a, pair.b), 2.0 * options["damping"] * math.sqrt(INERTIA),
    ),
    "Ai, Chen, Rotter and Ooi 2011 (type C), Powder Technology 206, 269; stiffness: Iwashita and Oda 1998",
    tangent=rolling_tangent, history=("moment_x", "moment_y", "stiffness"),
    options=(
        Option(
            "coefficient", "dimensionless", None, low=0.0, high=1.0, pair_key="rolling_friction",
            doc="largest moment over R* N, unless a pair has rolling_friction, such as 0.05",
        ),
        Option(
            "damping", "dimensionless", 0.0, low=0.0, high=10.0,
            doc="damping ratio of a ball that rocks on a plane (1: critical)",
        ),
    ),
)  # fmt: skip
