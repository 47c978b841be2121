"""Hertz, Mindlin and Coulomb one contact at a time: numbers computed elsewhere, and paths done by hand."""

from __future__ import annotations

import math

import pytest

from thirdbody.laws.contract import Material, Pair
from thirdbody.laws.coulomb import COULOMB
from thirdbody.laws.elasticity import e_star, g_star
from thirdbody.laws.hertz import HERTZ, HertzParameters
from thirdbody.laws.kernel_data import Contact, Load
from thirdbody.laws.mindlin import MINDLIN, MindlinParameters

DIGITS = 1e-13  # the numbers carry 15 digits; a few roundings of double precision come on top
EXACT = 1e-14  # sums and products of a handful of numbers; abs=0 because SI numbers here are below its default

UPPER = Material("upper", 80e9, 0.3, 1.0)
LOWER = Material("lower", 60e9, 0.35, 1.0)
PARTICLE = Material("particle", 120e9, 0.2, 1.0)
DELTA = 0.554172679905483  # share of the upper spot in a closing of 10 nm
SPOTS = (  # first body, radius, overlap, force
    (UPPER, 2e-6, DELTA * 1e-8, 1.00916206173428e-4),
    (LOWER, 1e-6, (1.0 - DELTA) * 1e-8, 0.453607995555482e-4),
    (LOWER, 1.5e-6, (1.0 - DELTA) * 1e-8, 0.555554066178795e-4),
)


def plain(function):
    return getattr(function, "py_func", function)


def contact(overlap, radius, slip_x=0.0, slip_y=0.0):
    return Contact(overlap, radius, 1.0, 0.0, slip_x, slip_y, 0.0, 0.0, 0.0, 0.0)


def pressed(body, radius, overlap):
    return plain(HERTZ.kernel)(contact(overlap, radius), HERTZ.mix(Pair(body, PARTICLE, 0.3, 1.0), {}))


def test_moduli():
    assert e_star(UPPER, PARTICLE) == pytest.approx(129729729729.730, rel=DIGITS, abs=0.0)
    assert e_star(LOWER, PARTICLE) == pytest.approx(114285714285.714, rel=DIGITS, abs=0.0)
    assert g_star(UPPER, PARTICLE) == pytest.approx(110344827586.207, rel=DIGITS, abs=0.0)
    assert g_star(LOWER, PARTICLE) == pytest.approx(94117647058.8235, rel=DIGITS, abs=0.0)


@pytest.mark.parametrize("body, radius, overlap, force", SPOTS)
def test_hertz_force(body, radius, overlap, force):
    assert pressed(body, radius, overlap).force == pytest.approx(force, rel=DIGITS, abs=0.0)


def test_hertz_contact_radius_and_pressure():
    n = pressed(*SPOTS[0][:3])
    assert n.contact_radius == pytest.approx(1.05277982494488e-7, rel=DIGITS, abs=0.0)
    assert 1.5 * n.force / (math.pi * n.contact_radius**2) == pytest.approx(4.34737590817e9, rel=1e-11, abs=0.0)  # 12 digits
    assert n.dissipated == 0.0


def test_hertz_energy_and_tangent_are_integral_and_derivative_of_the_force():
    p = HertzParameters(1e11)
    overlap, radius = 3e-9, 2e-6
    force = 4.0 / 3.0 * 1e11 * math.sqrt(radius) * overlap**1.5
    assert plain(HERTZ.kernel)(contact(overlap, radius), p).stored == pytest.approx(force * overlap / 2.5, rel=EXACT, abs=0.0)
    assert plain(HERTZ.tangent)(contact(overlap, radius), p) == pytest.approx(1.5 * force / overlap, rel=EXACT, abs=0.0)


def test_critical_displacement_of_set_a():
    body, radius, overlap, force = SPOTS[0]
    p = MINDLIN.mix(Pair(body, PARTICLE, 0.3, 1.0), {})
    load = Load(force, force, math.sqrt(radius * overlap), 0.0, 0.0)
    t, _ = plain(MINDLIN.kernel)(contact(overlap, radius), load, p, (0.0, 0.0, 0.0))
    assert t.critical == pytest.approx(1.95458201966664e-9, rel=DIGITS, abs=0.0)


# By hand, with G* = 1/2 so that the stiffness 2 G* a is a itself, and mu = 1/2:
# contact radius and load, slip, force, stored energy, slip at the limit
UNIT = MindlinParameters(0.5, 0.5, 1.0, 1.0)
BY_HAND = [
    ("loading sticks", (2.0, 100.0), (1.5, 0.0), (-3.0, 0.0), 9.0 / 4.0, 0.0),
    ("across it", (2.0, 100.0), (0.0, 2.0), (-3.0, -4.0), 25.0 / 4.0, 0.0),
    ("more area keeps force and energy", (4.0, 100.0), (0.0, 0.0), (-3.0, -4.0), 25.0 / 4.0, 0.0),
    ("so a cycle of load takes nothing", (2.0, 100.0), (0.0, 0.0), (-3.0, -4.0), 25.0 / 4.0, 0.0),
    ("half of the area that carries it loses half", (1.0, 100.0), (0.0, 0.0), (-1.5, -2.0), 25.0 / 8.0, 0.0),
    ("back through zero", (1.0, 100.0), (-1.5, -2.0), (0.0, 0.0), 0.0, 0.0),
    ("the limit mu N = 2", (1.0, 4.0), (3.0, -4.0), (-1.2, 1.6), 2.0, 3.0),
    ("more area", (4.0, 4.0), (0.0, 0.0), (-1.2, 1.6), 2.0, 0.0),
    ("half of twice the limit keeps a quarter of 3/2 J", (4.0, 4.0), (0.3, -0.4), (-1.2, 1.6), 0.5 + 0.375, 0.5),
    ("less load, less limit, a quarter of 3/8 J", (4.0, 2.0), (0.0, 0.0), (-0.6, 0.8), 0.125 + 0.09375, 0.25),
    ("no load", (0.0, 0.0), (1.0, 0.0), (0.0, 0.0), 0.0, None),
    ("virgin again", (2.0, 100.0), (0.5, 0.0), (-1.0, 0.0), 0.25, 0.0),
]
RELEASED = [0.0, 0.0, 0.0, 0.0, 3.125, 0.0, 6.0, 0.0, 2.0 - 0.5 - 0.375 + 1.0, 0.375 - 0.09375 + 0.25, 0.21875, 0.0]
"""Half of 25/4; 2 N over 3 m; 3/4 of 3/2 and 2 N over .5 m; 3/4 of 3/8 and 1 N over .25 m; what was stored."""

RESCALED_BY_HAND = [
    ("loading sticks", (2.0, 100.0), (1.5, 0.0), (-3.0, 0.0), 9.0 / 4.0, 0.0),
    ("across it", (2.0, 100.0), (0.0, 2.0), (-3.0, -4.0), 25.0 / 4.0, 0.0),
    ("more area keeps the force", (4.0, 100.0), (0.0, 0.0), (-3.0, -4.0), 25.0 / 8.0, 0.0),
    ("less area loses its share", (1.0, 100.0), (0.0, 0.0), (-0.75, -1.0), 1.5625 / 2.0, 0.0),
    ("back through zero", (1.0, 100.0), (-0.75, -1.0), (0.0, 0.0), 0.0, 0.0),
    ("the limit mu N = 2", (1.0, 4.0), (3.0, -4.0), (-1.2, 1.6), 2.0, 3.0),
    ("less load, less limit", (1.0, 2.0), (0.0, 0.0), (-0.6, 0.8), 0.5, 1.0),
    ("no load", (0.0, 0.0), (1.0, 0.0), (0.0, 0.0), 0.0, None),
    ("virgin again", (2.0, 100.0), (0.5, 0.0), (-1.0, 0.0), 0.25, 0.0),
]


# steps 3, 4: half of 25/4, then 3/4 of 25/8; 6: 2 N over 3 m; 7: 1 N over 1 m; 8: what was stored
RESCALED_RELEASED = [0.0, 0.0, 3.125, 2.34375, 0.0, 6.0, 1.0, 0.5, 0.0]


@pytest.mark.parametrize(
    "keeps, path, expected",
    [(1.0, BY_HAND, RELEASED), (0.0, RESCALED_BY_HAND, RESCALED_RELEASED)],
    ids=["two_number", "rescaled"],
)
def test_mindlin_path_by_hand(keeps, path, expected):
    memory = (0.0, 0.0, 0.0)
    stored, released, p = 0.0, [], UNIT._replace(retained_energy=keeps)
    for name, (a, force), slip, tangential, energy, sliding in path:
        t, memory = plain(MINDLIN.kernel)(contact(1.0, 1.0, *slip), Load(force, force, a, 0.0, 0.0), p, memory)
        assert (t.x, t.y) == pytest.approx(tangential, rel=EXACT, abs=EXACT), name
        assert t.limit == 0.5 * force, name
        assert t.stored == pytest.approx(energy, rel=EXACT, abs=EXACT), name
        if sliding is not None:
            assert t.slip == pytest.approx(sliding, rel=EXACT, abs=EXACT), name
        assert t.dissipated >= 0.0, name
        released.append(t.dissipated)
        stored = t.stored
    assert stored == 0.25
    assert released == pytest.approx(expected, rel=EXACT, abs=EXACT)


def test_mindlin_without_friction_slides_freely():
    p = MindlinParameters(0.5, 0.0, 0.0, 1.0)
    t, _ = plain(MINDLIN.kernel)(contact(1.0, 1.0, 3.0, 4.0), Load(10.0, 10.0, 1.0, 0.0, 0.0), p, (0.0, 0.0, 0.0))
    assert (t.x, t.y, t.stored, t.dissipated) == (0.0, 0.0, 0.0, 0.0)
    assert t.slip == pytest.approx(5.0, rel=EXACT, abs=0.0)


@pytest.mark.parametrize("law", [MINDLIN, COULOMB], ids=lambda law: law.name)
def test_no_contact_without_history_answers_zero(law):
    p = law.mix(Pair(UPPER, PARTICLE, 0.3, 1.0), {"slip_scale": 1e-3})
    t, memory = plain(law.kernel)(contact(0.0, 1e-6, 1e-9), Load(0.0, 0.0, 0.0, 0.0, 0.0), p, (0.0, 0.0, 0.0))
    assert (t.x, t.y, t.limit, t.stored, t.dissipated) == (0.0, 0.0, 0.0, 0.0, 0.0)
    assert memory == (0.0, 0.0, 0.0)


@pytest.mark.parametrize("memory", ["two_number", "rescaled"])
def test_coulomb_path_by_hand(memory):
    # R 2 and slip scale 1/4: the limit is reached after s_0 = 1/2; with mu 1/2 the stiffness is mu N/s_0 = N
    p = COULOMB.mix(Pair(UPPER, PARTICLE, 0.5, 1.0), {"slip_scale": 0.25, "memory": memory})
    steps = (
        [  # N, slip, T, stored, slip at the limit, dissipated
            (8.0, 0.25, -2.0, 0.25, 0.0, 0.0),
            (8.0, 0.75, -4.0, 1.0, 0.5, 2.0),
            (4.0, 0.0, -2.0, 0.5, 0.0, 0.5),  # half the load: half the force, half the energy
            (8.0, 0.0, -2.0, 0.5, 0.0, 0.0),  # more load: same force, same energy
            (4.0, 0.0, -2.0, 0.5, 0.0, 0.0),  # and less again
            (8.0, -0.25, 0.0, 0.25, 0.0, 0.0),  # a uniform field of 2 N holds 1/4 J, the other 1/4 stays
            (8.0, -1.5, 4.0, 1.0 + 0.25 / 9.0, 1.0, 4.0 + 0.25 * 8.0 / 9.0),  # the limit is a third of the trial force
        ]
        if memory == "two_number"
        else [
            (8.0, 0.25, -2.0, 0.25, 0.0, 0.0),
            (8.0, 0.75, -4.0, 1.0, 0.5, 2.0),
            (4.0, 0.0, -2.0, 0.5, 0.0, 0.5),  # half the load: half the force, half the energy
            (8.0, 0.0, -2.0, 0.25, 0.0, 0.25),  # more load: same force on a stiffer spring
            (8.0, -0.25, 0.0, 0.0, 0.0, 0.0),
            (8.0, -1.5, 4.0, 1.0, 1.0, 4.0),
        ]
    )
    memory = (0.0, 0.0, 0.0)
    for load, slip, force, stored, sliding, dissipated in steps:
        t, memory = plain(COULOMB.kernel)(contact(0.1, 2.0, slip), Load(load, load, 0.1, 0.0, 0.0), p, memory)
        got = (t.x, t.y, t.limit, t.stored, t.slip, t.dissipated)
        assert got == pytest.approx((force, 0.0, 0.5 * load, stored, sliding, dissipated), rel=EXACT, abs=EXACT)
        assert t.critical == 0.5


def test_coulomb_without_friction_slides_freely():
    p = COULOMB.mix(Pair(UPPER, PARTICLE, 0.0, 1.0), {"slip_scale": 0.25})
    t, _ = plain(COULOMB.kernel)(contact(0.1, 2.0, 3.0, 4.0), Load(8.0, 8.0, 0.1, 0.0, 0.0), p, (0.0, 0.0, 0.0))
    assert (t.x, t.y, t.stored, t.dissipated, t.slip) == (0.0, 0.0, 0.0, 0.0, 5.0)
