"""The closed forms of the plug-in against numbers computed elsewhere with 15 digits (mpmath), and against each other.

Those of `closed_forms`, by which tests judge runs, are compared with published numbers."""

import closed_forms
import pytest
import three_spot_theory as theory
from each import each
from thirdbody_three_spot.regime_map import third_spot_position

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
    "Fig. 2 a": (third_spot_position(0.25, 2.0, 1.0), 0.666666666666667),
    "Fig. 2 b": (third_spot_position(0.3, 0.7, 0.6), 0.871428571428571),
    "N2/N1 sliding": (theory.lower_force_fraction(TILTED, 1.2e-6), 0.714285714285714),
    "t_min": (theory.sliding_interval(TILTED, 4e-6)[0], -0.325),
    "t_max": (theory.sliding_interval(TILTED, 4e-6)[1], 0.55),
}


@each(NUMBERS)
def test_numbers(name):
    ours, theirs = NUMBERS[name]
    assert ours == pytest.approx(theirs, **APPROX)


def test_printed_numbers():
    assert theory.peak_pressure(N1, theory.contact_radius(R[0], D1)) == pytest.approx(4.34737590817e9, rel=2e-12)
    assert theory.dundurs_beta(150e9, 0.22, 28e9, 0.22) == pytest.approx(-0.25, rel=0.02)
    assert closed_forms.maw_gross_slip(5.0, closed_forms.maw_chi(0.3)) == pytest.approx(-0.7647059, abs=1e-7)


POSES = {
    0.0: (4.4383793544298e-9, 2.68203127740852e-4, (9.99958052503446e-5, 3.71412990929851e-5, 6.28545061573595e-5)),
    1.2e-6: (4.42114806928843e-9, -9.49317203747459e-4, (1.07179546429324e-4, 7.65568188780884e-5, 3.06227275512354e-5)),
}


@each(POSES)
def test_tilted_state(mu_h):
    w, phi, forces = POSES[mu_h]
    ours = theory.tilted_state(TILTED, E1, E2, R, CLOSING, mu_h)
    # phi is a difference of indentations some 3 to 30 times larger than itself times the lever
    assert ours[0] == pytest.approx(w, rel=1e-13) and ours[1] == pytest.approx(phi, rel=1e-12)
    assert ours[2] == pytest.approx(forces, rel=1e-13)


def test_states_that_lift_off_are_refused():
    with pytest.raises(ValueError, match="lifts off"):
        theory.tilted_state(TILTED, E1, E2, R, CLOSING, 0.56 * 4e-6)  # t_max = .55
    with pytest.raises(ValueError, match="outside"):
        theory.upper_fraction(ALPHA, 1.001 * ALPHA**-1.5)
    assert theory.hertz_force(E1, R[0], -D1) == 0.0 and theory.hertz_overlap(E1, R[0], N1) == pytest.approx(D1, rel=1e-14)
