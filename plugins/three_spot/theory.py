"""Closed forms: references for every law and solver. Imports nothing of thirdbody, shares no code with a law.

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


def hertz_stiffness(e: float, radius: float, overlap: float) -> float:
    """Tangent stiffness dN/dd = 2 E* a [N/m]."""
    return 2.0 * e * contact_radius(radius, overlap)


def hertz_energy(e: float, radius: float, overlap: float) -> float:
    """Elastic energy (8/15) E* sqrt(R) d^2.5 [J]."""
    return 8.0 / 15.0 * e * math.sqrt(radius) * max(overlap, 0.0) ** 2.5


def peak_pressure(force: float, patch_radius: float) -> float:
    """Peak pressure p0 = 3 N/(2 pi a^2) [Pa]; first yield at p0 = 1.6 Y."""
    return 1.5 * force / (math.pi * patch_radius**2)


# -- tangential, constant N --


def critical_displacement(mu: float, e: float, g: float, overlap: float) -> float:
    """Displacement s_c = mu (E*/G*) d at which the whole contact slides [m] (Eq. 13); independent of R."""
    return mu * e / g * overlap


def mindlin_loading(s: float, limit: float, s_c: float) -> float:
    """First loading at constant N: T = mu N [1 - (1 - s/s_c)^1.5] [N]; `limit` = mu N.

    For s >= 0; mu N beyond s_c. Source: Cattaneo 1938, Mindlin 1949.
    """
    return limit * (1.0 - max(1.0 - s / s_c, 0.0) ** 1.5)


def mindlin_reversal(s: float, s_reversal: float, limit: float, s_c: float) -> float:
    """T [N] after reversal at s*: T = T* - 2 mu N [1 - (1 - (s* - s)/(2 s_c))^1.5].

    For s* - 2 s_c <= s <= s* <= s_c. Source: Mindlin and Deresiewicz 1953.
    """
    return mindlin_loading(s_reversal, limit, s_c) - 2.0 * mindlin_loading((s_reversal - s) / 2.0, limit, s_c)


def stick_ratio(force_ratio: float) -> float:
    """Stick radius over contact radius c/a = (1 - T/(mu N))^(1/3) on first loading (Eq. 18 at dN = 0)."""
    return max(1.0 - force_ratio, 0.0) ** (1.0 / 3.0)


def mindlin_loop_work(force_ratio: float) -> float:
    """Work lost in a loop between +-T* over mu N s_c, for tau = T*/(mu N) in [0, 1].

    (24/5) {1 - (1-tau)^(5/3) - (5 tau/6) [1 + (1-tau)^(2/3)]} (Mindlin and Deresiewicz 1953).
    """
    tau, stick = force_ratio, 1.0 - force_ratio
    return 24.0 / 5.0 * (1.0 - stick ** (5.0 / 3.0) - 5.0 * tau / 6.0 * (1.0 + stick ** (2.0 / 3.0)))


# -- tangential, varying N --


def oblique_loading(mu: float, slope: float, force_from: float, force_to: float) -> float:
    """Increase of T [N] while N grows from `force_from` at ds = D kappa dd with |D| <= 1: mu D (N_1 - N_0).

    Source: memory diagrams, Aleshin et al. 2015; proportional loading of Eqs. 17 to 19 is the case N_0 = 0.
    """
    return mu * slope * (force_to - force_from)


def closed_cycle_work(overlap_low: float, overlap_high: float) -> float:
    """Work over k_1 U^2/2 lost by a contact in a rectangle of overlap and shear, no slip: 1 - sqrt(d_0/d_1).

    Press and lift alternate with shear by U and back; k_1 = 2 G* a_1. The annulus between both contact areas carries (k_1 - k_0)
    U when it loses contact (Elata and Berryman 1996).
    """
    return 1.0 - math.sqrt(overlap_low / overlap_high)


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


# -- impact --


def impact_overlap(mass: float, radius: float, e: float, speed: float) -> float:
    """Maximum overlap of an elastic Hertz impact [m]: (15 m v^2/(16 E* sqrt R))^(2/5); reduced m, R."""
    return (15.0 * mass * speed**2 / (16.0 * e * math.sqrt(radius))) ** 0.4


def impact_force(mass: float, radius: float, e: float, speed: float) -> float:
    """Maximum force of an elastic Hertz impact [N] (Chung and Ooi 2011)."""
    return hertz_force(e, radius, impact_overlap(mass, radius, e, speed))


def impact_duration(mass: float, radius: float, e: float, speed: float) -> float:
    """Contact time t_c [s]: 2 sqrt(pi) Gamma(7/5)/Gamma(9/10) d_max/v = 2.868 (m^2/(R E*^2 v))^(1/5)."""
    shape = 2.0 * math.sqrt(math.pi) * math.gamma(1.4) / math.gamma(0.9)
    return shape * impact_overlap(mass, radius, e, speed) / speed


def damping_with_tension(restitution: float) -> float:
    """alpha of m x'' + K x^1.5 + alpha sqrt(m K) x^0.25 x' = 0 for a given e, if the contact may pull at the end.

    -sqrt(5) ln e/sqrt(ln^2 e + pi^2) (Antypov and Elliott 2011). With the force clipped at zero e is higher.
    """
    log = math.log(restitution)
    return -math.sqrt(5.0) * log / math.sqrt(log**2 + math.pi**2)


def gross_slip_speed_ratio(mu: float, restitution: float, angle: float) -> float:
    """v_t'/v_t of a sphere on a plane in gross slip: 1 - mu (1+e)/tan(angle), `angle` from the normal.

    Source: Chung and Ooi 2011, test 4.
    """
    return 1.0 - mu * (1.0 + restitution) / math.tan(angle)


def gross_slip_spin(mu: float, restitution: float, angle: float, speed: float, radius: float) -> float:
    """Spin after a gross-slip impact, zero before [rad/s]: -(5/2) mu (1+e) V cos(angle)/R.

    Source: Chung and Ooi 2011, test 4.
    """
    return -2.5 * mu * (1.0 + restitution) * speed * math.cos(angle) / radius


def gross_slip_tangential_restitution(mu: float, restitution: float, v_n: float, v_slip: float) -> float:
    """beta = -1 + 3.5 mu (1+e) v_n/v_st of a solid sphere in gross slip (Chung and Ooi 2011, test 6)."""
    return -1.0 + 3.5 * mu * (1.0 + restitution) * v_n / v_slip


def maw_chi(nu: float) -> float:
    """chi = 7 (1-nu)/(2 (2-nu)) of a solid sphere of like material (Maw, Barber and Fawcett 1976)."""
    return 3.5 * (1.0 - nu) / (2.0 - nu)


def maw_gross_slip(psi: float, chi: float) -> float:
    """Rebound angle psi_2 = psi_1 - 4 chi for psi_1 >= 4 chi - 1, where the whole impact slips.

    Raises ValueError below, where there is no closed form.
    """
    if psi < 4.0 * chi - 1.0:
        raise ValueError(f"psi_1 = {psi} is below 4 chi - 1 = {4.0 * chi - 1.0}: the contact sticks for a while")
    return psi - 4.0 * chi


# -- motion --


def slope_sphere_rolls(mu: float, g_t: float, g_n: float) -> bool:
    """Return whether a solid sphere released on a slope rolls without slip: mu >= (2/7) g_t/g_n."""
    return mu >= 2.0 / 7.0 * g_t / g_n


def sliding_sphere(mu: float, g_t: float, g_n: float, radius: float, time: float) -> tuple[float, float]:
    """(speed [m/s], spin [rad/s]) of a sphere slipping down a slope: (g_t - mu g_n) t, (5/2) mu g_n t/R.

    Holds where `slope_sphere_rolls` is false.
    """
    return (g_t - mu * g_n) * time, 2.5 * mu * g_n * time / radius


def pinched_sphere_slip_time(mass: float, mu: float, force: float, plate_speed: float) -> float:
    """Time for which a sphere between plates slips on the upper one, suddenly at V [s]: 7 m V/(20 mu N)."""
    return 7.0 * mass * plate_speed / (20.0 * mu * force)


def pinched_sphere_rolling(plate_speed: float, radius: float) -> tuple[float, float]:
    """(speed V/2, spin V/(2 R)) of a sphere that rolls between a resting plate and one at V; T = 0."""
    return plate_speed / 2.0, plate_speed / (2.0 * radius)


def _arithmetic_geometric_mean(a: float, b: float) -> float:
    """Common limit of the arithmetic and geometric means of a and b."""
    while abs(a - b) > 4e-16 * a:
        a, b = 0.5 * (a + b), math.sqrt(a * b)
    return 0.5 * (a + b)


def top_period(moments: Sequence[float], spin: Sequence[float]) -> float:
    """Period of the body-frame angular velocity of a torque-free top [s] (Landau and Lifshitz I, section 37).

    `moments` I_1 < I_2 < I_3, `spin` in the principal frame at some instant. 4 K(k) divided by the rate, K by the
    arithmetic-geometric mean. Raises ValueError on the separatrix (and for a top at rest), where the period is infinite.
    """
    square = sum((i * o) ** 2 for i, o in zip(moments, spin, strict=True))
    twice_energy = sum(i * o**2 for i, o in zip(moments, spin, strict=True))
    i_1, i_2, i_3 = moments
    if square < twice_energy * i_2:  # circles the axis of least inertia: the formulas hold with 1 and 3 exchanged
        i_1, i_3 = i_3, i_1
    fast = (i_3 - i_2) * (square - twice_energy * i_1)
    slow = (i_2 - i_1) * (twice_energy * i_3 - square)
    if fast * slow < 0.0 or fast == slow:
        raise ValueError("the top is at rest or on its separatrix: no finite period")
    rate = math.sqrt(fast / (i_1 * i_2 * i_3))
    quarter = math.pi / (2.0 * _arithmetic_geometric_mean(1.0, math.sqrt(1.0 - slow / fast)))
    return 4.0 * quarter / rate


def rayleigh_time_step(radius: float, density: float, g: float, nu: float) -> float:
    """Rayleigh time of a sphere [s]: pi R sqrt(rho/G)/(0.1631 nu + 0.8766)."""
    return math.pi * radius * math.sqrt(density / g) / (0.1631 * nu + 0.8766)
