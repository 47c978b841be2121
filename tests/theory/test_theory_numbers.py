"""The closed forms of the plug-in against numbers computed elsewhere with 15 digits (mpmath), and against
each other."""

from __future__ import annotations

import math

import closed_forms
import pytest
from thirdbody_three_spot import theory

DIGITS = 1e-13  # the numbers carry 15 digits; a few round-offs of double precision come on top
APPROX = {"rel": DIGITS, "abs": 0.0}

# set A: shear moduli and Poisson ratios of upper body, lower body, particle
E1 = theory.e_star(80e9, 0.3, 120e9, 0.2)
E2 = theory.e_star(60e9, 0.35, 120e9, 0.2)
G1 = theory.g_star(80e9, 0.3, 120e9, 0.2)
G2 = theory.g_star(60e9, 0.35, 120e9, 0.2)
R = (2e-6, 1e-6, 1.5e-6)
CLOSING = 10e-9
MU = 0.3
ALPHA = theory.compliance_ratio(E1, R[0], E2, *R[1:])
D1 = CLOSING * theory.upper_fraction(ALPHA, 0.0)
D2 = CLOSING - D1
N1 = theory.hertz_force(E1, R[0], D1)
TILTED = (0.2e-6, -2e-6, 1.5e-6)


def steel(youngs_modulus, nu, density, radius):
    """(mass, shear modulus) of a sphere."""
    return density * 4.0 / 3.0 * math.pi * radius**3, theory.shear_modulus(youngs_modulus, nu)


def impact_pair(youngs_modulus, nu, density, radius):
    """Reduced mass, reduced radius, E* of two equal spheres."""
    mass, g = steel(youngs_modulus, nu, density, radius)
    return mass / 2.0, radius / 2.0, theory.e_star(g, nu, g, nu)


def impact_plane(youngs_modulus, nu, density, radius):
    """Mass, radius, E* of a sphere against a rigid plane."""
    mass, g = steel(youngs_modulus, nu, density, radius)
    return mass, radius, theory.e_star(g, nu, math.inf, 0.3)


GLASS = impact_pair(48e9, 0.2, 2800.0, 0.01)
LIMESTONE = impact_pair(20e9, 0.25, 2500.0, 0.01)
ALUMINIUM = impact_plane(70e9, 0.3, 2699.0, 0.1)
MAGNESIUM = impact_plane(40e9, 0.35, 1800.0, 0.1)

NUMBERS = {
    "E1*": (E1, 129729729729.730),
    "E2*": (E2, 114285714285.714),
    "G1*": (G1, 110344827586.207),
    "G2*": (G2, 94117647058.8235),
    "elastic similarity of set A": (1.0 + theory.dundurs_beta(80e9, 0.3, 60e9, 0.35), 1.0),
    "alpha": (ALPHA, 0.804491697733194),
    "delta0": (theory.upper_fraction(ALPHA, 0.0), 0.554172679905483),
    "psi": (theory.upper_fraction_slope(ALPHA), -0.399257298069346),
    "delta(1e-3)": (theory.upper_fraction(ALPHA, 1e-3), 0.553773440070735),
    "delta(.01)": (theory.upper_fraction(ALPHA, 0.01), 0.550181841800893),
    "delta(.1)": (theory.upper_fraction(ALPHA, 0.1), 0.514409313560128),
    "delta(.5)": (theory.upper_fraction(ALPHA, 0.5), 0.357486437265024),
    "N1": (N1, 1.00916206173428e-4),
    "N2": (theory.hertz_force(E2, R[1], D2), 0.453607995555482e-4),
    "N3": (theory.hertz_force(E2, R[2], D2), 0.555554066178795e-4),
    "a1": (theory.contact_radius(R[0], D1), 1.05277982494488e-7),
    "s1c": (theory.critical_displacement(MU, E1, G1, D1), 1.95458201966664e-9),
    "T(.25)": (closed_forms.mindlin_loading(0.25, MU * N1, 1.0), 1.06107622570876e-5),
    "T(.5)": (closed_forms.mindlin_loading(0.5, MU * N1, 1.0), 1.95710817945007e-5),
    "T(.75)": (closed_forms.mindlin_loading(0.75, MU * N1, 1.0), 2.64905041205248e-5),
    "Eq. 22": (theory.sliding_moment_weightless((1e-6, -2e-6, 1.5e-6), R[1], R[2]), 1.07321409974112e-6),
    "Eq. 21": (
        theory.sliding_moment_without_tilt((1e-6, -2e-6, 1.5e-6), E1, E2, R, theory.upper_fraction(ALPHA, 0.01)),
        1.0750081530652e-6,
    ),
    "Eq. 20": (theory.sliding_weight_ratio(0.30, 0.25), 0.2),
    "Fig. 2 a": (theory.third_spot_position(0.25, 2.0, 1.0), 0.666666666666667),
    "Fig. 2 b": (theory.third_spot_position(0.3, 0.7, 0.6), 0.871428571428571),
    "N2/N1 sliding": (theory.lower_force_fraction(TILTED, 1.2e-6), 0.714285714285714),
    "t_min": (theory.sliding_interval(TILTED, 4e-6)[0], -0.325),
    "t_max": (theory.sliding_interval(TILTED, 4e-6)[1], 0.55),
    "loop .9": (closed_forms.mindlin_loop_work(0.9), 0.320990646466991),
    "loop 1": (closed_forms.mindlin_loop_work(1.0), 0.8),
    "chi, solid sphere": (closed_forms.maw_chi(0.3), 1.44117647058824),
    "torque-free top": (closed_forms.top_period((1.0, 2.0, 3.0), (0.05, 1.0, 0.05)), 27.9060637581754),
}


@pytest.mark.parametrize("name", NUMBERS)
def test_number(name):
    ours, theirs = NUMBERS[name]
    assert ours == pytest.approx(theirs, **APPROX)


# (ours, printed, relative tolerance: half a unit of the last printed digit, or digits lost by cancellation)
PRINTED = {
    "p0": (theory.peak_pressure(N1, theory.contact_radius(R[0], D1)), 4.34737590817e9, 2e-12),
    "loop .5: differences of order 1 leave .006": (closed_forms.mindlin_loop_work(0.5), 0.0281736902312790, 1e-12),
    "glass d": (closed_forms.impact_overlap(*GLASS, 20.0), 2.74112702089e-4, 2e-12),
    "glass F": (closed_forms.impact_force(*GLASS, 20.0), 10696.888984, 5e-11),
    "glass t": (closed_forms.impact_duration(*GLASS, 20.0), 4.03394556884e-5, 2e-12),
    "limestone F": (closed_forms.impact_force(*LIMESTONE, 20.0), 7108.2412799, 1e-11),
    "aluminium F": (closed_forms.impact_force(*ALUMINIUM, 0.2), 11369.8583113, 5e-12),
    "aluminium t": (closed_forms.impact_duration(*ALUMINIUM, 0.2), 7.31656640619e-4, 2e-12),
    "magnesium F": (closed_forms.impact_force(*MAGNESIUM, 0.2), 7232.68102597, 2e-12),
    "sliding sphere v": (closed_forms.sliding_sphere(0.2, 5.0, 5.0, 1e-3, 5.0005e-3)[0], 0.0200020, 3e-6),
    "sliding sphere spin": (closed_forms.sliding_sphere(0.2, 5.0, 5.0, 1e-3, 5.0005e-3)[1], 12.501, 4e-5),
    "maw rebound at psi 5": (closed_forms.maw_gross_slip(5.0, closed_forms.maw_chi(0.3)), -0.7647059, 1e-7),
    "closed cycle": (closed_forms.closed_cycle_work(0.004, 0.01), 0.3675, 2e-4),
    "alumina on glass": (theory.dundurs_beta(150e9, 0.22, 28e9, 0.22), -0.25, 0.02),
    "rayleigh, steel of 1 um": (closed_forms.rayleigh_time_step(1e-6, 7850.0, 80.77e9, 0.3), 1.1e-9, 0.05),
    "rayleigh, quartz of .5 mm": (closed_forms.rayleigh_time_step(0.5e-3, 2650.0, 40e9, 0.1), 5e-7, 0.1),
}


@pytest.mark.parametrize("name", PRINTED)
def test_printed_number(name):
    ours, theirs, tolerance = PRINTED[name]
    assert ours == pytest.approx(theirs, rel=tolerance, abs=0.0)


POSES = {
    "frictionless": (
        0.0,
        4.4383793544298e-9,
        2.68203127740852e-4,
        (9.99958052503446e-5, 3.71412990929851e-5, 6.28545061573595e-5),
    ),
    "sliding": (
        1.2e-6,
        4.42114806928843e-9,
        -9.49317203747459e-4,
        (1.07179546429324e-4, 7.65568188780884e-5, 3.06227276512354e-5),
    ),
}


@pytest.mark.parametrize("name", POSES)
def test_tilted_state(name):
    mu_h, w, phi, forces = POSES[name]
    ours = theory.tilted_state(TILTED, E1, E2, R, CLOSING, mu_h)
    # phi is a difference of indentations some 3 to 30 times larger than itself times the lever
    assert ours[0] == pytest.approx(w, rel=1e-13)
    assert ours[1] == pytest.approx(phi, rel=1e-12)
    assert ours[2] == pytest.approx(forces, rel=1e-13)


@pytest.mark.parametrize("mu_h", [0.0, 0.6e-6, 1.2e-6, 2.1e-6])
def test_tilted_state_is_in_equilibrium(mu_h):
    w, phi, n = theory.tilted_state(TILTED, E1, E2, R, CLOSING, mu_h)
    d = (CLOSING - w - phi * TILTED[0], w + phi * TILTED[1], w + phi * TILTED[2])
    for force, e, radius, overlap in zip(n, (E1, E2, E2), R, d, strict=True):
        assert force == pytest.approx(theory.hertz_force(e, radius, overlap), rel=1e-12)
    moment = n[0] * TILTED[0] - n[1] * TILTED[1] - n[2] * TILTED[2]
    assert moment == pytest.approx(mu_h * n[0], rel=1e-12, abs=1e-13 * n[0] * 1e-6)


def test_outside_the_sliding_interval_a_spot_lifts_off():
    with pytest.raises(ValueError, match="lifts off"):
        theory.tilted_state(TILTED, E1, E2, R, CLOSING, 0.56 * 4e-6)  # t_max = .55
    with pytest.raises(ValueError, match="outside"):
        theory.upper_fraction(ALPHA, 1.001 * ALPHA**-1.5)


def test_share_series_is_of_second_order():
    errors = [abs(theory.upper_fraction_series(ALPHA, m) - theory.upper_fraction(ALPHA, m)) for m in (0.01, 0.02)]
    assert math.log2(errors[1] / errors[0]) == pytest.approx(3.0, abs=0.05)  # the first missing term is m~^3


def test_weight_number_is_what_eq_9_balances():
    weight = 1e-5
    delta = theory.upper_fraction(ALPHA, theory.weight_number(weight, E1, R[0], CLOSING))
    below = sum(theory.hertz_force(E2, r, (1.0 - delta) * CLOSING) for r in R[1:])
    assert below - theory.hertz_force(E1, R[0], delta * CLOSING) == pytest.approx(weight, rel=1e-10)


def test_hertz_force_stiffness_and_energy_belong_together():
    e, r, d, step = 1e11, 1e-6, 1e-9, 1e-13
    slope = (theory.hertz_force(e, r, d + step) - theory.hertz_force(e, r, d - step)) / (2.0 * step)
    work = (closed_forms.hertz_energy(e, r, d + step) - closed_forms.hertz_energy(e, r, d - step)) / (2.0 * step)
    # central difference: relative error (step/d)^2 = 1e-8
    assert closed_forms.hertz_stiffness(e, r, d) == pytest.approx(slope, rel=1e-7)
    assert theory.hertz_force(e, r, d) == pytest.approx(work, rel=1e-7)
    assert theory.hertz_overlap(e, r, theory.hertz_force(e, r, d)) == pytest.approx(d, rel=1e-14)
    assert theory.hertz_force(e, r, -d) == closed_forms.hertz_energy(e, r, -d) == 0.0


def test_mindlin_reversal_closes_the_loop():
    limit, s_c, turn = 2.0, 0.7, 0.4
    up = closed_forms.mindlin_loading(turn, limit, s_c)
    assert closed_forms.mindlin_reversal(turn, turn, limit, s_c) == up
    assert closed_forms.mindlin_reversal(-turn, turn, limit, s_c) == pytest.approx(-up, rel=1e-14)


def test_loop_work_is_the_integral_of_the_two_branches():
    limit, s_c, turn, n = 1.0, 1.0, 1.0 - 0.1 ** (2.0 / 3.0), 2000  # T* = .9 mu N
    s = [-turn + 2.0 * turn * (i + 0.5) / n for i in range(n)]
    area = sum(
        -closed_forms.mindlin_reversal(-x, turn, limit, s_c) - closed_forms.mindlin_reversal(x, turn, limit, s_c) for x in s
    )
    # midpoint rule with an end where the slope is finite: error of order 1/n^2
    assert area * 2.0 * turn / n == pytest.approx(closed_forms.mindlin_loop_work(0.9), rel=1e-5)


def test_stick_ratio_from_the_loading_curve():
    s = 0.3
    # the stick radius is where the springs of the patch just reach their limit: 1 - (c/a)^2 = s/s_c
    assert theory.stick_ratio(closed_forms.mindlin_loading(s, 1.0, 1.0)) ** 2 == pytest.approx(1.0 - s, rel=1e-13)


def test_varying_normal_force():
    e, g, radius, low, high = 1.0, 0.8, 1.0, 0.006, 0.01

    def cattaneo(d, fraction):
        limit, s_c = MU * theory.hertz_force(e, radius, d), theory.critical_displacement(MU, e, g, d)
        return closed_forms.mindlin_loading(fraction * s_c, limit, s_c)

    assert cattaneo(low, 0.5) == pytest.approx(1.20176493717336e-4, **APPROX)
    # lifting at fixed s leaves the state of first loading to that s: .3 s_c at high is .5 s_c at low
    assert cattaneo(low, 0.3 * high / low) == pytest.approx(1.20176493717336e-4, **APPROX)
    forces = (theory.hertz_force(e, radius, d) for d in (low, high))
    assert theory.oblique_loading(MU, 0.6, *forces) == pytest.approx(1.28458079629226e-4, **APPROX)


def test_impact_constant():
    mass, radius, e, v = 0.3, 0.02, 1e10, 1.7
    constant = closed_forms.impact_duration(mass, radius, e, v) / (mass**2 / (radius * e**2 * v)) ** 0.2
    assert constant == pytest.approx(2.86826569919533138, rel=1e-13)
    kinetic = 0.5 * mass * v**2
    assert closed_forms.hertz_energy(e, radius, closed_forms.impact_overlap(mass, radius, e, v)) == pytest.approx(
        kinetic, rel=1e-13
    )


def test_gross_slip_keeps_angular_momentum_about_the_contact():
    mu, e, angle, speed, radius = 0.092, 0.98, 0.9, 3.9, 2.5e-3
    v_t = speed * math.sin(angle)
    after = v_t * closed_forms.gross_slip_speed_ratio(mu, e, angle)
    spin = closed_forms.gross_slip_spin(mu, e, angle, speed, radius)
    # friction acts through the contact point: v_t - (2/5) R omega about it is unchanged (spin counted against
    # v_t)
    assert after - 0.4 * radius * spin == pytest.approx(v_t, rel=1e-13)
    beta = closed_forms.gross_slip_tangential_restitution(mu, e, speed * math.cos(angle), v_t)
    assert after + radius * spin == pytest.approx(-beta * v_t, rel=1e-12)


def test_restitution_with_pull():
    # exact for a contact that may pull: e = .5 needs less than .5708137, the value for a force clipped at
    # zero
    assert closed_forms.damping_with_tension(0.5) == pytest.approx(
        math.sqrt(5.0) * math.log(2.0) / math.hypot(math.log(2.0), math.pi)
    )
    assert closed_forms.damping_with_tension(0.5) < 0.5708137
    assert closed_forms.damping_with_tension(1.0) == 0.0


def test_slope_sphere_changes_from_sliding_to_rolling_at_two_sevenths():
    assert closed_forms.slope_sphere_rolls(0.2858, 5.0, 5.0)
    assert not closed_forms.slope_sphere_rolls(0.2856, 5.0, 5.0)
    # at the change sliding and rolling move alike
    speed, spin = closed_forms.sliding_sphere(2.0 / 7.0, 5.0, 5.0, 1e-3, 0.01)
    assert spin * 1e-3 == pytest.approx(speed, rel=1e-13)


def test_pinched_sphere_reaches_half_the_plate_speed_when_slip_ends():
    mass, mu, force, speed, radius = 2.0, 0.3, 5.0, 1.2, 0.1
    time = closed_forms.pinched_sphere_slip_time(mass, mu, force, speed)
    v, omega = closed_forms.pinched_sphere_rolling(speed, radius)
    # momentum and spin with mu N above and F below: m v = (mu N + F) t, (2/5) m R omega = (mu N - F) t
    assert mass * v + 0.4 * mass * radius * omega == pytest.approx(2.0 * mu * force * time, rel=1e-13)
    assert v + radius * omega == speed


def test_two_spots_are_the_limit_of_three():
    assert theory.two_spot_friction(0.2e-6, -2e-6, 4e-6) == theory.sliding_interval(TILTED, 4e-6)[1]


def test_symmetric_particle_slides_only_without_friction():
    assert theory.sliding_moment_weightless((0.0, -1e-6, 1e-6), 1e-6, 1e-6) == 0.0
    # Fig. 2: another H shifts zeta_2 by dH/n_2
    assert theory.third_spot_position(0.3, 0.7 + 0.2 / 0.3, 0.8) == pytest.approx(theory.third_spot_position(0.3, 0.7, 0.6))


def test_eq_21_becomes_eq_22_without_weight():
    x = (1e-6, -2e-6, 1.5e-6)
    ours = theory.sliding_moment_without_tilt(x, E1, E2, R, theory.upper_fraction(ALPHA, 0.0))
    assert ours == pytest.approx(theory.sliding_moment_weightless(x, R[1], R[2]), rel=1e-13)


def test_top_near_its_stable_axes_nods_like_an_oscillator():
    # small oscillation about axis 3 (and 1): omega^2 = Omega^2 (I3-I1)(I3-I2)/(I1 I2); error of order
    # (.001)^2
    rate = math.sqrt((3.0 - 1.0) * (3.0 - 2.0) / (1.0 * 2.0))
    assert closed_forms.top_period((1.0, 2.0, 3.0), (1e-3, 1e-3, 1.0)) == pytest.approx(2.0 * math.pi / rate, rel=1e-5)
    rate = math.sqrt((2.0 - 1.0) * (3.0 - 1.0) / (2.0 * 3.0))
    assert closed_forms.top_period((1.0, 2.0, 3.0), (1.0, 1e-3, 1e-3)) == pytest.approx(2.0 * math.pi / rate, rel=1e-5)
    with pytest.raises(ValueError, match="separatrix"):
        closed_forms.top_period((1.0, 2.0, 3.0), (0.0, 1.0, 0.0))


def test_rolling_rebound_is_refused():
    with pytest.raises(ValueError, match="sticks"):
        closed_forms.maw_gross_slip(4.7, closed_forms.maw_chi(0.3))
