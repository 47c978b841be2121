"""Equations of the three-spot theory, references for laws and solvers. Imports nothing of thirdbody, shares no code with a law.

Plain floats in, plain floats out, SI units. "Eq. n" is E. Willert, Self-consistency conditions in static three-body elastic
tangential contact, with its misprints corrected: R_i for R_1 in Eq. 5, the bracket of Eqs. 7 and 8, mu_1/mu_2 in Eq. 20. Its
signs: dh closes the gap, tilt phi about +y (into the page), w down, the drag and u positive toward -x; spot 1 above, 2 and 3
below. `g_star` is the paper's G*, four times the G_eff of most DEM codes: k_t = 2 G* a = 8 G_eff a.
"""

import math
from collections.abc import Sequence

# -- moduli --


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
    """Elastic mismatch; 0 if (1-2nu)/G are equal (Eq. 3): normal and tangential contact then decouple.

    beta = [(1-2nu_a)/G_a - (1-2nu_b)/G_b] / [2 (1-nu_a)/G_a + 2 (1-nu_b)/G_b] (Johnson 1985, Eq. 5.3).
    """
    difference = (1.0 - 2.0 * nu_a) / g_a - (1.0 - 2.0 * nu_b) / g_b
    return difference / (2.0 * (1.0 - nu_a) / g_a + 2.0 * (1.0 - nu_b) / g_b)


# -- Hertz --


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


# -- tangential --


def critical_displacement(mu: float, e: float, g: float, overlap: float) -> float:
    """Displacement s_c = mu (E*/G*) d at which the whole contact slides [m] (Eq. 13); independent of R."""
    return mu * e / g * overlap


def stick_ratio(force_ratio: float) -> float:
    """Stick radius over contact radius c/a = (1 - T/(mu N))^(1/3) on first loading (Eq. 18 at dN = 0)."""
    return max(1.0 - force_ratio, 0.0) ** (1.0 / 3.0)


def oblique_loading(mu: float, slope: float, force_from: float, force_to: float) -> float:
    """Increase of T [N] while N grows from `force_from` at ds = D kappa dd with |D| <= 1: mu D (N_1 - N_0).

    Source: memory diagrams, Aleshin et al. 2015; proportional loading of Eqs. 17 to 19 is the case N_0 = 0.
    """
    return mu * slope * (force_to - force_from)


# -- three spots, normal load --


def compliance_ratio(e_1: float, r_1: float, e_2: float, r_2: float, r_3: float) -> float:
    """alpha of Eq. 8: alpha^-1.5 = E*_2 (sqrt R_2 + sqrt R_3)/(E*_1 sqrt R_1)."""
    return (e_2 * (math.sqrt(r_2) + math.sqrt(r_3)) / (e_1 * math.sqrt(r_1))) ** (-2.0 / 3.0)


def weight_number(weight: float, e_1: float, r_1: float, closing: float) -> float:
    """m~ = 3 m g/(4 E*_1 sqrt(R_1) dh^1.5) of Eq. 8, with `weight` = m g [N] and `closing` = dh [m]."""
    return 0.75 * weight / (e_1 * math.sqrt(r_1) * closing**1.5)


def upper_fraction(alpha: float, m: float) -> float:
    """delta = d_1/dh without tilt: the root of delta^1.5 + m~ = alpha^-1.5 (1-delta)^1.5 (Eq. 9).

    Raises ValueError outside 0 <= m~ <= alpha^-1.5, where spot 1 has lifted off.
    """
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


def upper_fraction_series(alpha: float, m: float) -> float:
    """delta to second order in m~: Eq. 10 and its next term, alpha (1-alpha)/9 m~^2."""
    return 1.0 / (1.0 + alpha) + upper_fraction_slope(alpha) * m + alpha * (1.0 - alpha) / 9.0 * m**2


# -- self-consistency --


def lower_force_fraction(x: Sequence[float], mu_h: float) -> float:
    """N_2/N_1 of a weightless particle sliding on both sides: (x_3 - x_1 + mu h)/(x_3 - x_2).

    From N_2 + N_3 = N_1 and Eq. 20; mu h = 0: no friction; `x` = (x_1, x_2, x_3) [m]. In [0, 1] where the particle can slide.
    """
    return (x[2] - x[0] + mu_h) / (x[2] - x[1])


def sliding_interval(x: Sequence[float], h: float) -> tuple[float, float]:
    """(t_min, t_max) = ((x_1 - x_3)/h, (x_1 - x_2)/h) for x_2 < x_3: the particle can slide for mu between.

    Equal mu, no weight, elastic tilt free. Above t_max spot 3 has lifted and the particle tips at T/N = t_max.
    """
    return (x[0] - x[2]) / h, (x[0] - x[1]) / h


def two_spot_friction(x_upper: float, x_lower: float, h: float) -> float:
    """tan alpha = (x_1 - x_2)/h on two spots (Eq. 16); it can stick iff |tan alpha| <= mu (Eq. 19)."""
    return (x_upper - x_lower) / h


def sliding_weight_ratio(mu_upper: float, mu_lower: float) -> float:
    """m g/N_1 at which both sides slide: mu_1/mu_2 - 1 (Eq. 20, which prints the ratio inverted)."""
    return mu_upper / mu_lower - 1.0


def sliding_moment_without_tilt(x: Sequence[float], e_1: float, e_2: float, radii: Sequence[float], delta: float) -> float:
    """mu h [m] at which an untilted particle slides (Eq. 21).

    x_1 - (E*_2/E*_1) ((1-delta)/delta)^1.5 [x_2 sqrt(R_2/R_1) + x_3 sqrt(R_3/R_1)], `delta` from `upper_fraction`.
    """
    arms = x[1] * math.sqrt(radii[1] / radii[0]) + x[2] * math.sqrt(radii[2] / radii[0])
    return x[0] - e_2 / e_1 * ((1.0 - delta) / delta) ** 1.5 * arms


def sliding_moment_weightless(x: Sequence[float], r_2: float, r_3: float) -> float:
    """mu h [m] at which an untilted weightless particle slides (Eq. 22); 0 for a symmetric one."""
    a, b = math.sqrt(r_2), math.sqrt(r_3)
    return x[0] - (a * x[1] + b * x[2]) / (a + b)


def third_spot_position(n_2: float, zeta_2: float, big_h: float) -> float:
    """zeta_3 = x_3/x_1 at which the particle can slide (Fig. 2): (1 + n_2 zeta_2 - H)/(1 - n_2).

    n_2 = N_2/N_1, zeta_2 = -x_2/x_1, H = mu h/x_1; weightless, equal friction. Raises ZeroDivisionError at n_2 = 1.
    """
    return (1.0 + n_2 * zeta_2 - big_h) / (1.0 - n_2)


def tilted_state(
    x: Sequence[float], e_1: float, e_2: float, radii: Sequence[float], closing: float, mu_h: float
) -> tuple[float, float, tuple[float, float, float]]:
    """(w, phi, (N_1, N_2, N_3)) of a weightless particle at closing dh, all spots sliding; mu_h = 0: smooth.

    `lower_force_fraction` determines N_i/N_1; then d_i = c_i N_1^(2/3), and Eq. 6, d_1 = dh - w - phi x_1, d_2 = w + phi x_2,
    d_3 = w + phi x_3, is linear in N_1^(2/3), w and phi. Raises ValueError if a spot would have to pull.
    """
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
