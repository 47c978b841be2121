"""The damping number alpha(e): known values, an integrated impact, the kernels' forces."""

import math

import pytest
from scipy.integrate import solve_ivp

from thirdbody.laws import damping as law
from thirdbody.laws.contract import Material, Pair
from thirdbody.laws.damping import damping_number, restitution_of
from thirdbody.laws.data import Contact, Load, Normal
from thirdbody.laws.generated import plain

STEEL = Material("steel", 80e9, 0.3, 7850.0)

# clipped contact, seven decimals (root of an impact integrated with 15 digits)
TABLE = {0.98: 0.0144386, 0.9: 0.0766193, 0.8: 0.1662631, 0.7: 0.2732805, 0.5: 0.5708137, 0.3: 1.1118611, 0.1: 2.7798526}


def integrated_restitution(alpha: float) -> float:
    """Impact x'' = -x^1.5 - alpha x^0.25 x' at speed 1, released where the contact would begin to pull."""

    def rates(_t, y):
        x = max(y[0], 0.0)
        return [y[1], -(x**1.5) - alpha * x**0.25 * y[1]]

    def pull(_t, y):
        return max(y[0], 0.0) ** 1.25 + alpha * y[1]  # force over x^0.25, which is regular at x = 0

    pull.terminal, pull.direction = True, -1.0
    # one step of free flight, from which on x^0.25 has a derivative
    start = 1e-12
    impact = solve_ivp(rates, (0.0, 1e4), [start, 1.0], "DOP853", events=pull, rtol=1e-11, atol=1e-16)
    assert impact.status == 1, "the contact never opened"
    return -float(impact.y_events[0][0][1])


def test_published_values_and_integrated_impacts():
    # half of the last decimal of the table
    assert {e: damping_number(e) for e in TABLE} == pytest.approx(TABLE, abs=0.6e-7)
    for e in (0.05, 0.1, 0.2, 0.35, 0.5, 0.65, 0.8, 0.9, 0.95, 0.99):
        # the integrator's tolerance is 1e-11 a step; the root at x -> 0 costs it some digits
        assert integrated_restitution(damping_number(e)) == pytest.approx(e, rel=1e-7, abs=0.0)


def test_restitution_is_the_inverse_smooth_and_of_a_contact_that_does_not_pull():
    for restitution in (1e-3, 0.02, math.exp(-2.0), 0.4, 0.999, 1.0 - 1e-9):
        # the bisection ends within two roundings of alpha, and e changes by less than alpha does
        assert restitution_of(damping_number(restitution)) == pytest.approx(restitution, rel=1e-12, abs=0.0)
    # 0 is the lower end of the bracket: the elastic limit costs no damping at all
    assert damping_number(1.0) < 1e-14
    critical = 2.5 * math.sqrt(0.8)
    values = [restitution_of(critical * (1.0 + shift)) for shift in (-1e-6, 0.0, 1e-6)]
    assert values[0] > values[1] > values[2]
    # steps of a millionth: a smooth curve bends by 1e-6 of its slope; the differences keep nine digits
    assert values[0] - values[1] == pytest.approx(values[1] - values[2], rel=1e-5, abs=0.0)
    # the formula for a contact that may pull gives e = .5503 instead of .5 when clipped (four decimals)
    alpha = -math.sqrt(5.0) * math.log(0.5) / math.hypot(math.log(0.5), math.pi)
    assert restitution_of(alpha) == pytest.approx(0.5503, abs=0.6e-4)


def test_force_of_the_dashpots():
    pair = Pair(STEEL, STEEL, 0.3, 0.5)
    radius, mass, overlap, v_n = 5e-6, 3e-12, 2e-9, -0.4
    e, g = 80e9 / 0.7, 2.0 * 80e9 / 1.7  # E* = G/(1 - nu), G* = 2 G/(2 - nu) of like materials
    a = math.sqrt(radius * overlap)
    c = Contact(overlap, radius, mass, v_n, 0.0, 0.0, 0.3, 0.0, 0.0, 0.0)
    force = plain(law.HERTZ_DAMPING.kernel)(c, Normal(1.0, a, 0.0, 0.0, 0.0, 0.0), law.mix_damping(pair, {}))
    # the definition: alpha sqrt(m K) x^(1/4) v with K = 4/3 E* sqrt(R), against the approach
    expected = TABLE[0.5] * math.sqrt(mass * 4.0 / 3.0 * e * math.sqrt(radius)) * overlap**0.25 * 0.4
    assert force == pytest.approx(expected, rel=1e-6, abs=0.0)  # seven decimals of the table
    viscosity = plain(law.TANGENTIAL_DAMPING.kernel)(c, Load(1.0, 1.0, a, 0.0, 0.0), law.mix_tangential_damping(pair, {}))
    # the normal dashpot is alpha sqrt(2/3 m k_n) with k_n = 2 E* a; here with k_t = 2 G* a
    assert viscosity == pytest.approx(TABLE[0.5] * math.sqrt(2.0 / 3.0 * mass * 2.0 * g * a), rel=1e-6, abs=0.0)
    elastic, lossy = Pair(STEEL, STEEL, 0.3, 1.0), Pair(STEEL, STEEL, 0.3, 0.9)
    assert not law.loses_energy([elastic]) and law.loses_energy([elastic, lossy])
    assert law.mix_damping(lossy, {}) > law.DampingParameters(0.0)
