"""Viscous damping of a Hertz contact with a coefficient of restitution independent of speed.

m x'' + K x^1.5 + alpha sqrt(m K) x^0.25 x' = 0 (Tsuji et al. 1992). With y = x^1.25 as the coordinate this is the linear
oscillator (Antypov and Elliott 2011), so the restitution of the *clipped* contact, which cannot pull, is the linear one of
Schwager and Poeschel 2007, and alpha(e) follows from it by bisection.

The coefficient is alpha sqrt((2/3) m k_n) with the stiffness k_n = 2 E* a of any circular elastic contact. Under another elastic
force d^p the restitution is independent of speed, too, and the damping ratio is sqrt(5 p/(3 p + 3)) times that of Hertz.

The tangential dashpot adds its force to that of the spring, and the sum is returned to the friction limit: so it always
dissipates. The spring keeps the limit; LAMMPS and LIGGGHTS leave it what the dashpot leaves.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

from thirdbody.laws.contract import Law, Options, Pair, kernel
from thirdbody.laws.hertz import e_star, g_star


class DampingParameters(NamedTuple):
    """Viscosity scale alpha sqrt((4/3) E*) [Pa^0.5]."""

    scale: float


def restitution_of(alpha: float) -> float:
    """Coefficient of restitution [-] of the clipped contact for the damping number alpha >= 0: linear oscillator with omega_0^2 =
    4/5 and gamma = 2 alpha/5, released where its acceleration vanishes (Schwager and Poeschel 2007, Eqs. 10-12)."""
    omega_0, gamma = math.sqrt(0.8), 0.4 * alpha
    if gamma == 0.0:
        return 1.0
    if gamma < omega_0:
        omega = math.sqrt(omega_0**2 - gamma**2)
        return math.exp(-gamma / omega * math.atan2(2.0 * gamma * omega, 2.0 * gamma**2 - omega_0**2))
    if gamma == omega_0:
        return math.exp(-2.0)
    root = math.sqrt(gamma**2 - omega_0**2)
    # ln((gamma + root)/(gamma - root)), in a form without cancellation near critical damping
    return math.exp(-2.0 * gamma / root * math.atanh(root / gamma))


def damping_number(restitution: float) -> float:
    """Return the alpha of a given restitution in (0, 1], in a contact that cannot pull."""
    low, high = 0.0, 1.0
    while restitution_of(high) > restitution:
        high *= 2.0
    while high - low > 4e-16 * high:
        middle = 0.5 * (low + high)
        if middle in (low, high):
            break
        low, high = (middle, high) if restitution_of(middle) > restitution else (low, middle)
    return 0.5 * (low + high)


@kernel
def hertz_damping(c, n, p):
    """-alpha sqrt(m K) x^0.25 v with K = (4/3) E* sqrt(R): since sqrt(K) x^0.25 = sqrt((4/3) E* a)."""
    return -p.scale * math.sqrt(c.mass * n.contact_radius) * c.v_n


def mix_damping(pair: Pair, _options: Options) -> DampingParameters:
    return DampingParameters(damping_number(pair.restitution) * math.sqrt(4.0 / 3.0 * e_star(pair.a, pair.b)))


@kernel
def tangential_damping(c, load, p):
    """alpha sqrt((2/3) m k_t) [N s/m] with k_t = 2 G* a: the same damping ratio as in the normal direction."""
    return p.scale * math.sqrt(c.mass * load.contact_radius)


def mix_tangential_damping(pair: Pair, _options: Options) -> DampingParameters:
    return DampingParameters(damping_number(pair.restitution) * math.sqrt(4.0 / 3.0 * g_star(pair.a, pair.b)))


def loses_energy(pairs: Sequence[Pair]) -> bool:
    """Return whether any pair has a restitution below one: only then is there a dashpot in the contact."""
    return any(pair.restitution < 1.0 for pair in pairs)


HERTZ_DAMPING = Law(
    "hertz_damping", "damping", hertz_damping, DampingParameters, mix_damping, wanted=loses_energy,
    source="Tsuji et al. 1992; Antypov and Elliott 2011; clipped restitution by Schwager and Poeschel 2007",
)  # fmt: skip

TANGENTIAL_DAMPING = Law(
    "tangential_damping", "tangential_damping", tangential_damping, DampingParameters, mix_tangential_damping,
    wanted=loses_energy, source="Tsuji et al. 1992: the normal dashpot's damping ratio for the tangential spring",
)  # fmt: skip
