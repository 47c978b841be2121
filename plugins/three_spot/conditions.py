"""Planar conditions of self-consistency in closed form: any number of spots, weight, one friction on each side.

"Eq. n" is E. Willert, Self-consistency conditions in static three-body elastic tangential contact. Signs: x from the centre of
mass S, drag toward -x, t = T/N_1 with N_1 the load of the upper side, h the distance of the sides, w = m g/N_1. Plain floats, SI
units. Imports nothing of thirdbody. The other equations of the paper stand with the tests that need them
(`tests/three_spot_theory.py`).

Principle: the resultant of a side acts between its outermost spots, wherever elasticity puts it. N_1 p - (N_1 + m g) q = T h
(Eqs. 1 and 2, p above, q below, weight through S) then converts the extent of the spots into an interval of t.
"""

import math
from collections.abc import Sequence
from typing import Any

ROUND_OFF = 1e-12  # relative difference of two frictions that are meant to be equal


def planar_interval(upper: Sequence[float], lower: Sequence[float], h: float, weight_ratio: float = 0.0) -> tuple[float, float]:
    """(t_min, t_max) of T/N_1 in balance: (min p - (1+w) max q)/h, (max p - (1+w) min q)/h. Spots at `upper`, `lower` [m].
    Outside the interval a spot would have to pull: above t_max the particle tips and T/N_1 stays t_max. One spot above, two below
    and w = 0 is `theory.sliding_interval`; one below, Eq. 16. Raises ValueError without spots, for h <= 0 or w < 0."""
    if not len(upper) or not len(lower) or not h > 0.0 or not weight_ratio >= 0.0:
        raise ValueError("needs a spot on each side, h > 0 and a weight ratio >= 0")
    press = 1.0 + weight_ratio
    return (min(upper) - press * max(lower)) / h, (max(upper) - press * min(lower)) / h


def friction_limit(mu_upper: float, mu_lower: float, weight_ratio: float = 0.0) -> float:
    """Largest T/N_1 that both sides can transmit: min(mu_upper, mu_lower (1 + w)); both slide at equality (Eq. 20)."""
    return min(mu_upper, mu_lower * (1.0 + weight_ratio))


def required_scale(
    upper: Sequence[float], lower: Sequence[float], h: float, mu_upper: float, mu_lower: float, weight_ratio: float = 0.0
) -> float:
    """Smallest s for which frictions s mu_upper, s mu_lower can hold the particle: min |t|/`friction_limit`. min |t| over
    `planar_interval`. Sticking (static slip) is possible iff s <= 1; s = |tan alpha|/mu on two spots (Eq. 19). inf when a side
    has no friction and t = 0 is out of reach."""
    low, high = planar_interval(upper, lower, h, weight_ratio)
    minimum = max(low, -high, 0.0)
    limit = friction_limit(mu_upper, mu_lower, weight_ratio)
    if minimum == 0.0:
        return 0.0
    return minimum / limit if limit > 0.0 else math.inf


def third_spot_position(n_2: Any, zeta_2: Any, big_h: float) -> Any:
    """zeta_3 = x_3/x_1 at which the particle can slide (Fig. 2): (1 + n_2 zeta_2 - H)/(1 - n_2), of numbers or arrays. n_2 =
    N_2/N_1, zeta_2 = -x_2/x_1, H = mu h/x_1; weightless, equal friction."""
    return (1.0 + n_2 * zeta_2 - big_h) / (1.0 - n_2)
