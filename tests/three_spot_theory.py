"""Equations of the three-spot theory, references for laws and solvers that share no code with a law.

Plain floats in, plain floats out, SI units. "Eq. n" is E. Willert, Self-consistency conditions in static three-body elastic
tangential contact, with its misprints corrected: R_i for R_1 in Eq. 5, the bracket of Eqs. 7 and 8, mu_1/mu_2 in Eq. 20. Its
signs: dh closes the gap, tilt phi about +y (into the page), w down, the drag and u positive toward -x; spot 1 above, 2 and 3
below. `g_star` is the paper's G*, four times the G_eff of most DEM codes: k_t = 2 G* a = 8 G_eff a."""

import math
from collections.abc import Sequence

ROUND_OFF = 1e-12  # relative difference of two frictions that are meant to be equal


def shear_modulus(youngs_modulus: float, nu: float) -> float:
    """G = E/(2 (1 + nu)) [Pa]."""
    return youngs_modulus / (2.0 * (1.0 + nu))


def e_star(g_a: float, nu_a: float, g_b: float, nu_b: float) -> float:
    """Effective normal modulus E* [Pa] (Eq. 4): 1/E* = (1-nu_a)/(2 G_a) + (1-nu_b)/(2 G_b); rigid: G = inf."""
    return 1.0 / ((1.0 - nu_a) / (2.0 * g_a) + (1.0 - nu_b) / (2.0 * g_b))


def g_star(g_a: float, nu_a: float, g_b: float, nu_b: float) -> float:
    """Effective tangential modulus G* [Pa] (Eq. 14): 1/G* = (2-nu_a)/(4 G_a) + (2-nu_b)/(4 G_b)."""
    return 1.0 / ((2.0 - nu_a) / (4.0 * g_a) + (2.0 - nu_b) / (4.0 * g_b))


def dundurs_beta(g_a: float, nu_a: float, g_b: float, nu_b: float) -> float:
    """Elastic mismatch; 0 if (1-2nu)/G are equal (Eq. 3): normal and tangential contact then decouple. beta = [(1-2nu_a)/G_a -
    (1-2nu_b)/G_b] / [2 (1-nu_a)/G_a + 2 (1-nu_b)/G_b] (Johnson 1985, Eq. 5.3)."""
    difference = (1.0 - 2.0 * nu_a) / g_a - (1.0 - 2.0 * nu_b) / g_b
    return difference / (2.0 * (1.0 - nu_a) / g_a + 2.0 * (1.0 - nu_b) / g_b)


def hertz_force(e: float, radius: float, overlap: float) -> float:
    """Normal force N [N] (Eq. 5): N = (4/3) E* sqrt(R) d^1.5; 0 without overlap."""
    return 4.0 / 3.0 * e * math.sqrt(radius) * max(overlap, 0.0) ** 1.5


def hertz_overlap(e: float, radius: float, force: float) -> float:
    """Overlap d [m] under the normal force N: Eq. 5 solved for d."""
    return (0.75 * max(force, 0.0) / (e * math.sqrt(radius))) ** (2.0 / 3.0)


def contact_radius(radius: float, overlap: float) -> float:
    """Contact radius a = sqrt(R d) [m] (Eq. 5)."""
    return math.sqrt(radius * max(overlap, 0.0))


def peak_pressure(force: float, patch_radius: float) -> float:
    """Peak pressure p0 = 3 N/(2 pi a^2) [Pa]; first yield at p0 = 1.6 Y."""
    return 1.5 * force / (math.pi * patch_radius**2)


def critical_displacement(mu: float, e: float, g: float, overlap: float) -> float:
    """Displacement s_c = mu (E*/G*) d at which the whole contact slides [m] (Eq. 13); independent of R."""
    return mu * e / g * overlap


def stick_ratio(force_ratio: float) -> float:
    """Stick radius over contact radius c/a = (1 - T/(mu N))^(1/3) on first loading (Eq. 18 at dN = 0)."""
    return max(1.0 - force_ratio, 0.0) ** (1.0 / 3.0)


def compliance_ratio(e_1: float, r_1: float, e_2: float, r_2: float, r_3: float) -> float:
    """alpha of Eq. 8: alpha^-1.5 = E*_2 (sqrt R_2 + sqrt R_3)/(E*_1 sqrt R_1)."""
    return (e_2 * (math.sqrt(r_2) + math.sqrt(r_3)) / (e_1 * math.sqrt(r_1))) ** (-2.0 / 3.0)


def weight_number(weight: float, e_1: float, r_1: float, closing: float) -> float:
    """m~ = 3 m g/(4 E*_1 sqrt(R_1) dh^1.5) of Eq. 8, with `weight` = m g [N] and `closing` = dh [m]."""
    return 0.75 * weight / (e_1 * math.sqrt(r_1) * closing**1.5)


def upper_fraction(alpha: float, m: float) -> float:
    """delta = d_1/dh without tilt: the root of delta^1.5 + m~ = alpha^-1.5 (1-delta)^1.5 (Eq. 9). Raises ValueError outside 0
    <= m~ <= alpha^-1.5, where spot 1 has lifted off."""
    if not 0.0 <= m <= alpha**-1.5:
        raise ValueError(f"m~ = {m} is outside 0 .. alpha^-1.5 = {alpha**-1.5}")
    low, high = 0.0, 1.0
    while True:
        middle = 0.5 * (low + high)
        if middle in (low, high):
            return middle
        if middle**1.5 + m < alpha**-1.5 * (1.0 - middle) ** 1.5:
            low = middle
        else:
            high = middle


def upper_fraction_slope(alpha: float) -> float:
    """psi = d delta/d m~ at m~ = 0 (Eq. 10): -2 alpha/(3 sqrt(1 + alpha))."""
    return -2.0 * alpha / (3.0 * math.sqrt(1.0 + alpha))


def lower_force_fraction(x: Sequence[float], mu_h: float) -> float:
    """N_2/N_1 of a weightless particle sliding on both sides: (x_3 - x_1 + mu h)/(x_3 - x_2). From N_2 + N_3 = N_1 and Eq. 20;
    mu h = 0: no friction; `x` = (x_1, x_2, x_3) [m]. In [0, 1] where the particle can slide."""
    return (x[2] - x[0] + mu_h) / (x[2] - x[1])


def sliding_interval(x: Sequence[float], h: float) -> tuple[float, float]:
    """(t_min, t_max) = ((x_1 - x_3)/h, (x_1 - x_2)/h) for x_2 < x_3: the particle can slide for mu between. Equal mu, no
    weight, elastic tilt free. Above t_max spot 3 has lifted and the particle tips at T/N = t_max."""
    return (x[0] - x[2]) / h, (x[0] - x[1]) / h


def two_spot_friction(x_upper: float, x_lower: float, h: float) -> float:
    """tan alpha = (x_1 - x_2)/h on two spots (Eq. 16); it can stick iff |tan alpha| <= mu (Eq. 19)."""
    return (x_upper - x_lower) / h


def sliding_weight_ratio(mu_upper: float, mu_lower: float) -> float:
    """m g/N_1 at which both sides slide: mu_1/mu_2 - 1 (Eq. 20, which prints the ratio inverted)."""
    return mu_upper / mu_lower - 1.0


def sliding_moment_without_tilt(x: Sequence[float], e_1: float, e_2: float, radii: Sequence[float], delta: float) -> float:
    """mu h [m] at which an untilted particle slides (Eq. 21). x_1 - (E*_2/E*_1) ((1-delta)/delta)^1.5 [x_2 sqrt(R_2/R_1) + x_3
    sqrt(R_3/R_1)], `delta` from `upper_fraction`."""
    arms = x[1] * math.sqrt(radii[1] / radii[0]) + x[2] * math.sqrt(radii[2] / radii[0])
    return x[0] - e_2 / e_1 * ((1.0 - delta) / delta) ** 1.5 * arms


def sliding_moment_weightless(x: Sequence[float], r_2: float, r_3: float) -> float:
    """mu h [m] at which an untilted weightless particle slides (Eq. 22); 0 for a symmetric one."""
    a, b = math.sqrt(r_2), math.sqrt(r_3)
    return x[0] - (a * x[1] + b * x[2]) / (a + b)


def tilted_state(
    x: Sequence[float], e_1: float, e_2: float, radii: Sequence[float], closing: float, mu_h: float
) -> tuple[float, float, tuple[float, float, float]]:
    """(w, phi, (N_1, N_2, N_3)) of a weightless particle at closing dh, all spots sliding; mu_h = 0: smooth.
    `lower_force_fraction` determines N_i/N_1; then d_i = c_i N_1^(2/3), and Eq. 6, d_1 = dh - w - phi x_1, d_2 = w + phi x_2,
    d_3 = w + phi x_3, is linear in N_1^(2/3), w and phi. Raises ValueError if a spot would have to pull."""
    fraction = lower_force_fraction(x, mu_h)
    fractions = (1.0, fraction, 1.0 - fraction)
    if min(fractions) < 0.0:
        raise ValueError(f"a spot lifts off: force fractions {fractions}")
    moduli = (e_1, e_2, e_2)
    c = [hertz_overlap(e, r, n) for e, r, n in zip(moduli, radii, fractions, strict=True)]
    tilt = (c[2] - c[1]) / (x[2] - x[1])
    sink = c[1] - tilt * x[1]
    scale = closing / (c[0] + sink + tilt * x[0])  # N_1^(2/3)
    force = scale**1.5
    return scale * sink, scale * tilt, (force, fraction * force, (1.0 - fraction) * force)


# -- planar conditions with weight, many spots, two frictions --
#
# x from the centre of mass S, drag toward -x, t = T/N_1 with N_1 the load of the upper side, h the distance of the sides,
# w = m g/N_1. The resultant of a side acts between its outermost spots, wherever elasticity puts it. N_1 p - (N_1 + m g) q = T h
# (Eqs. 1 and 2, p above, q below, weight through S) then converts the extent of the spots into an interval of t.


def planar_interval(upper: Sequence[float], lower: Sequence[float], h: float, weight_ratio: float = 0.0) -> tuple[float, float]:
    """(t_min, t_max) of T/N_1 in balance: (min p - (1+w) max q)/h, (max p - (1+w) min q)/h. Spots at `upper`, `lower` [m].

    Outside the interval a spot would have to pull: above t_max the particle tips and T/N_1 stays t_max. One spot above, two below
    and w = 0 is `sliding_interval`; one below, Eq. 16.
    """
    press = 1.0 + weight_ratio
    return (min(upper) - press * max(lower)) / h, (max(upper) - press * min(lower)) / h


def required_scale(
    upper: Sequence[float], lower: Sequence[float], h: float, mu_upper: float, mu_lower: float, weight_ratio: float = 0.0
) -> float:
    """Smallest s for which frictions s mu_upper, s mu_lower can hold the particle: min |t| over what both sides can transmit.

    That is min(mu_upper, mu_lower (1 + w)); both slide at equality (Eq. 20). Sticking (static slip) is possible iff s <= 1; s =
    |tan alpha|/mu on two spots (Eq. 19). inf when a side has no friction and t = 0 is out of reach.
    """
    low, high = planar_interval(upper, lower, h, weight_ratio)
    minimum = max(low, -high, 0.0)
    limit = min(mu_upper, mu_lower * (1.0 + weight_ratio))
    if minimum == 0.0:
        return 0.0
    return minimum / limit if limit > 0.0 else math.inf


def lower_resultant(x_upper: float, t: float, h: float, weight_ratio: float = 0.0) -> float:
    """Position q [m] of the lower resultant: (x_1 - t h)/(1 + w) (Eq. 2). The strut leans against the motion."""
    return (x_upper - t * h) / (1.0 + weight_ratio)


def sliding_sides(
    upper: Sequence[float], lower: Sequence[float], h: float, mu_upper: float, mu_lower: float, weight_ratio: float = 0.0
) -> tuple[str, ...]:
    """Sides on which the particle can slide under a drag toward -x: "upper", "lower", both or none. The weaker side slides, the
    other sticks; both only at m g = N_1 (mu_1/mu_2 - 1) (Eq. 20). None: it rolls, since the limit of friction lies outside
    `planar_interval`."""
    low, high = planar_interval(upper, lower, h, weight_ratio)
    above, below = mu_upper, mu_lower * (1.0 + weight_ratio)
    limit = min(above, below)
    if not low <= limit <= high:
        return ()
    sides = (("upper", above), ("lower", below))
    return tuple(name for name, bound in sides if math.isclose(bound, limit, rel_tol=ROUND_OFF))


def dragged_friction(upper: Sequence[float], lower: Sequence[float], h: float, mu: float) -> tuple[float, str]:
    """(T/N_1, state) at the end of a steady drag toward -x that starts stuck; no weight, equal friction. (mu, "sliding") up to
    t_max of `planar_interval`; above it (t_max, "rolling"): the far spot lifts off at the macroscopic coefficient t_max < mu,
    before the friction limit is reached. Raises ValueError where the particle cannot stick initially."""
    if required_scale(upper, lower, h, 1.0, 1.0) > mu:
        raise ValueError(f"mu = {mu} cannot hold the particle even at rest")
    high = planar_interval(upper, lower, h)[1]
    return (mu, "sliding") if mu <= high else (high, "rolling")


def regime(x_1: float, half_width: float, mu: float) -> str:
    """State of a dragged particle with the upper spot at x_1/h and the lower ones at -+`half_width`, all in units of h."""
    try:
        state = dragged_friction((x_1,), (-half_width, half_width), 1.0, mu)[1]
    except ValueError:  # it cannot stick even at rest
        return "rolling"
    return "sliding" if state == "sliding" else "sticking"


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
    """(N_1, N_2, N_3) [N] of the frictionless particle that may tilt, at closing dh (Eqs. 1, 5, 6; section 3). `weight` = m g;
    `x` = (x_1, x_2, x_3) with x_2 < x_3 [m]. No closed form: bisection in N_1. Without weight, `tilted_state` at mu h = 0.
    Raises ValueError where a spot lifts off: dh too small for the weight, or x_1 outside the lower spots."""
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

    Needs x_2 < x_1 < x_3; raises ValueError elsewhere."""
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
