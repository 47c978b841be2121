"""Planar self-consistency beyond `theory`: weight, many spots, two frictions, tilt with weight.

Any number of spots per side, one friction per side. Signs of `theory`: x from the centre of mass S, drag toward -x, t = T/N_1
with N_1 the load of the upper side, h the distance of the sides, w = m g/N_1. "Eq. n" is E. Willert, Self-consistency conditions
in static three-body elastic tangential contact. Imports nothing of thirdbody.

Principle: the resultant of a side acts between its outermost spots, wherever elasticity puts it. N_1 p - (N_1 + m g) q = T h
(Eqs. 1 and 2, p above, q below, weight through S) then converts the extent of the spots into an interval of t.
"""

import math
from collections.abc import Sequence

ROUND_OFF = 1e-12  # relative difference of two frictions that are meant to be equal


def lower_resultant(x_upper: float, t: float, h: float, weight_ratio: float = 0.0) -> float:
    """Position q [m] of the lower resultant: (x_1 - t h)/(1 + w) (Eq. 2). The strut leans against the motion."""
    return (x_upper - t * h) / (1.0 + weight_ratio)


def planar_interval(upper: Sequence[float], lower: Sequence[float], h: float, weight_ratio: float = 0.0) -> tuple[float, float]:
    """(t_min, t_max) of T/N_1 in balance: (min p - (1+w) max q)/h, (max p - (1+w) min q)/h.

    Spots at `upper`, `lower` [m]. Outside the interval a spot would have to pull: above t_max the particle tips and T/N_1 stays
    t_max. One spot above, two below and w = 0 is `theory.sliding_interval`; one below, Eq. 16. Raises ValueError without spots,
    for h <= 0 or w < 0.
    """
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
    """Smallest s for which frictions s mu_upper, s mu_lower can hold the particle: min |t|/`friction_limit`.

    min |t| over `planar_interval`. Sticking (static slip) is possible iff s <= 1; s = |tan alpha|/mu on two spots (Eq. 19). inf
    when a side has no friction and t = 0 is out of reach.
    """
    low, high = planar_interval(upper, lower, h, weight_ratio)
    minimum = max(low, -high, 0.0)
    limit = friction_limit(mu_upper, mu_lower, weight_ratio)
    if minimum == 0.0:
        return 0.0
    return minimum / limit if limit > 0.0 else math.inf


def sliding_sides(
    upper: Sequence[float], lower: Sequence[float], h: float, mu_upper: float, mu_lower: float, weight_ratio: float = 0.0
) -> tuple[str, ...]:
    """Sides on which the particle can slide under a drag toward -x: "upper", "lower", both or none.

    The weaker side slides, the other sticks; both only at m g = N_1 (mu_1/mu_2 - 1) (Eq. 20). None: it rolls, since
    `friction_limit` lies outside `planar_interval`.
    """
    low, high = planar_interval(upper, lower, h, weight_ratio)
    above, below = mu_upper, mu_lower * (1.0 + weight_ratio)
    limit = min(above, below)
    if not low <= limit <= high:
        return ()
    sides = (("upper", above), ("lower", below))
    return tuple(name for name, bound in sides if math.isclose(bound, limit, rel_tol=ROUND_OFF))


def dragged_friction(upper: Sequence[float], lower: Sequence[float], h: float, mu: float) -> tuple[float, str]:
    """(T/N_1, state) at the end of a steady drag toward -x that starts stuck; no weight, equal friction.

    (mu, "sliding") up to t_max of `planar_interval`; above it (t_max, "rolling"): the far spot lifts off at the macroscopic
    coefficient t_max < mu, before the friction limit is reached. Raises ValueError where the particle cannot stick initially.
    """
    if required_scale(upper, lower, h, 1.0, 1.0) > mu:
        raise ValueError(f"mu = {mu} cannot hold the particle even at rest")
    high = planar_interval(upper, lower, h)[1]
    return (mu, "sliding") if mu <= high else (high, "rolling")


# -- normal problem with tilt and weight --


def _load_coefficients(x: Sequence[float]) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
    """(b, a): N_i = b_i N_1 + a_i m g from force and moment balance without friction (Eqs. 1, 2)."""
    span = x[2] - x[1]
    return (1.0, (x[2] - x[0]) / span, (x[0] - x[1]) / span), (0.0, x[2] / span, -x[1] / span)


def _compliances(e_1: float, e_2: float, radii: Sequence[float]) -> list[float]:
    """c_i of d_i = c_i N_i^(2/3) [m/N^(2/3)] (Eq. 5 solved for d)."""
    moduli = (e_1, e_2, e_2)
    return [(0.75 / (e * math.sqrt(r))) ** (2.0 / 3.0) for e, r in zip(moduli, radii, strict=True)]


def _closing(x: Sequence[float], c: Sequence[float], force: float, weight: float) -> float:
    """dh = sum b_i d_i (Eq. 6 without w and phi) [m], with N_1 = `force` [N]. Grows with `force`: each term has b_i^2."""
    b, a = _load_coefficients(x)
    return sum(bi * ci * max(bi * force + ai * weight, 0.0) ** (2.0 / 3.0) for bi, ai, ci in zip(b, a, c, strict=True))


def tilted_normal_forces(
    x: Sequence[float], e_1: float, e_2: float, radii: Sequence[float], closing: float, weight: float
) -> tuple[float, float, float]:
    """(N_1, N_2, N_3) [N] of the frictionless particle that may tilt, at closing dh (Eqs. 1, 5, 6; section 3).

    `weight` = m g; `x` = (x_1, x_2, x_3) with x_2 < x_3 [m]. No closed form: bisection in N_1. Without weight,
    `theory.tilted_state` at mu h = 0. Raises ValueError where a spot lifts off: dh too small for the weight, or x_1 outside the
    lower spots.
    """
    b, a = _load_coefficients(x)
    c = _compliances(e_1, e_2, radii)
    # N_i >= 0 bounds N_1 from below where b_i > 0 and from above where b_i < 0
    low = max([0.0, *(-ai * weight / bi for bi, ai in zip(b, a, strict=True) if bi > 0.0)])
    high = min([math.inf, *(-ai * weight / bi for bi, ai in zip(b, a, strict=True) if bi < 0.0)])
    high = min(high, (closing / c[0]) ** 1.5 + low)  # the sum of the other terms of dh is positive above `low`
    stuck = any(bi == 0.0 and ai * weight < 0.0 for bi, ai in zip(b, a, strict=True))
    if stuck or high < low or not _closing(x, c, low, weight) <= closing <= _closing(x, c, high, weight):
        raise ValueError("a spot lifts off")
    while True:
        force = 0.5 * (low + high)
        if force in (low, high):
            break
        if _closing(x, c, force, weight) < closing:
            low = force
        else:
            high = force
    n = [bi * force + ai * weight for bi, ai in zip(b, a, strict=True)]
    return n[0], n[1], n[2]


def tilted_force_series(
    x: Sequence[float], e_1: float, e_2: float, radii: Sequence[float], closing: float, weight: float
) -> float:
    """N_1 [N] of `tilted_normal_forces` to second order in m g: Eq. 10 for a particle that tilts.

    sum b_i c_i N_i^(2/3) = dh, N_i = b_i N_1 + a_i m g, twice differentiated at m g = 0 with n_i = dN_i/d(m g):

        sum b_i c_i N_i^(-1/3) n_i = 0,  N_1'' sum b_i^2 c_i N_i^(-1/3) = sum b_i c_i N_i^(-4/3) n_i^2/3.

    Needs x_2 < x_1 < x_3; raises ValueError elsewhere.
    """
    b, a = _load_coefficients(x)
    if min(b) <= 0.0:
        raise ValueError("x_1 must lie between x_2 and x_3")
    c = _compliances(e_1, e_2, radii)
    force = (closing / sum(ci * bi ** (5.0 / 3.0) for bi, ci in zip(b, c, strict=True))) ** 1.5
    stiff = [bi * ci * (bi * force) ** (-1.0 / 3.0) for bi, ci in zip(b, c, strict=True)]
    total = sum(si * bi for si, bi in zip(stiff, b, strict=True))
    slope = -sum(si * ai for si, ai in zip(stiff, a, strict=True)) / total
    bend = sum(si * (bi * slope + ai) ** 2 / (3.0 * bi * force) for si, bi, ai in zip(stiff, b, a, strict=True)) / total
    return force + slope * weight + 0.5 * bend * weight**2
