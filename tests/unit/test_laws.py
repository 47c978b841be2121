"""Hertz, Mindlin and Coulomb one contact at a time: numbers computed elsewhere, and paths done by hand."""

import math
from functools import partial

import numpy as np
import pytest
from thirdbody.kernels.tile import TILE, contact_tangent, law_input, law_output, rolling_input, rolling_output
from thirdbody.laws import tile_law
from thirdbody.laws.compose import compose
from thirdbody.laws.contract import Material, Pair
from thirdbody.laws.data import Contact, Load
from thirdbody.laws.friction import COULOMB, MINDLIN, MindlinParameters
from thirdbody.laws.generated import plain
from thirdbody.laws.hertz import HERTZ, HertzParameters, e_star, g_star

# the numbers carry 15 digits, a few roundings come on top; abs=0 because SI numbers here are below its default
to_digits = partial(pytest.approx, rel=1e-13, abs=0.0)
exact = partial(pytest.approx, rel=1e-14, abs=1e-14)  # sums and products of a handful of numbers

UPPER, LOWER = Material("upper", 80e9, 0.3, 1.0), Material("lower", 60e9, 0.35, 1.0)
PARTICLE = Material("particle", 120e9, 0.2, 1.0)
NO_HISTORY = (0.0, 0.0, 0.0)
DELTA = 0.554172679905483  # share of the upper spot in a closing of 10 nm
SPOTS = (  # first body, radius, overlap, force
    (UPPER, 2e-6, DELTA * 1e-8, 1.00916206173428e-4),
    (LOWER, 1e-6, (1.0 - DELTA) * 1e-8, 0.453607995555482e-4),
    (LOWER, 1.5e-6, (1.0 - DELTA) * 1e-8, 0.555554066178795e-4),
)


def contact(overlap, radius, slip_x=0.0, slip_y=0.0):
    return Contact(overlap, radius, 1.0, 0.0, slip_x, slip_y, 0.0, 0.0, 0.0, 0.0)


def pressed(body, radius, overlap):
    return plain(HERTZ.kernel)(contact(overlap, radius), HERTZ.mix(Pair(body, PARTICLE, 0.3, 1.0), {}))


def test_moduli_hertz_with_its_energy_and_tangent_and_the_critical_displacement():
    assert (e_star(UPPER, PARTICLE), e_star(LOWER, PARTICLE)) == to_digits((129729729729.730, 114285714285.714))
    assert (g_star(UPPER, PARTICLE), g_star(LOWER, PARTICLE)) == to_digits((110344827586.207, 94117647058.8235))
    for *spot, force in SPOTS:
        assert pressed(*spot).force == to_digits(force)
    n = pressed(*SPOTS[0][:3])
    assert n.contact_radius == to_digits(1.05277982494488e-7)
    assert 1.5 * n.force / (math.pi * n.contact_radius**2) == pytest.approx(4.34737590817e9, rel=1e-11, abs=0.0)  # 12 digits
    assert n.dissipated == 0.0
    p, overlap, radius = HertzParameters(1e11), 3e-9, 2e-6
    force = 4.0 / 3.0 * 1e11 * math.sqrt(radius) * overlap**1.5
    assert plain(HERTZ.kernel)(contact(overlap, radius), p).stored == pytest.approx(force * overlap / 2.5, rel=1e-14, abs=0.0)
    assert plain(HERTZ.tangent)(contact(overlap, radius), p) == pytest.approx(1.5 * force / overlap, rel=1e-14, abs=0.0)
    body, radius, overlap, force = SPOTS[0]
    p = MINDLIN.mix(Pair(body, PARTICLE, 0.3, 1.0), {})
    load = Load(force, force, math.sqrt(radius * overlap), 0.0, 0.0)
    t, _ = plain(MINDLIN.kernel)(contact(overlap, radius), load, p, NO_HISTORY)
    assert t.critical == to_digits(1.95458201966664e-9)


# By hand, with G* = 1/2 so that the stiffness 2 G* a is a itself, and mu = 1/2:
# contact radius and load, slip, force, stored energy, slip at the limit, what was released
MINDLIN_BY_HAND = {
    1.0: [
        ("loading sticks", (2.0, 100.0), (1.5, 0.0), (-3.0, 0.0), 9.0 / 4.0, 0.0, 0.0),
        ("across it", (2.0, 100.0), (0.0, 2.0), (-3.0, -4.0), 25.0 / 4.0, 0.0, 0.0),
        ("more area keeps force and energy", (4.0, 100.0), (0.0, 0.0), (-3.0, -4.0), 25.0 / 4.0, 0.0, 0.0),
        ("so a cycle of load takes nothing", (2.0, 100.0), (0.0, 0.0), (-3.0, -4.0), 25.0 / 4.0, 0.0, 0.0),
        ("half of the area that carries it loses half", (1.0, 100.0), (0.0, 0.0), (-1.5, -2.0), 25.0 / 8.0, 0.0, 3.125),
        ("back through zero", (1.0, 100.0), (-1.5, -2.0), (0.0, 0.0), 0.0, 0.0, 0.0),
        ("the limit mu N = 2, over 3 m", (1.0, 4.0), (3.0, -4.0), (-1.2, 1.6), 2.0, 3.0, 6.0),
        ("more area", (4.0, 4.0), (0.0, 0.0), (-1.2, 1.6), 2.0, 0.0, 0.0),
        ("half of twice the limit keeps a quarter of 3/2 J, 2 N over 1/2 m", (4.0, 4.0), (0.3, -0.4), (-1.2, 1.6), 0.5 + 0.375,
         0.5, 2.0 - 0.5 - 0.375 + 1.0),
        ("less load, less limit, a quarter of 3/8 J, 1 N over 1/4 m", (4.0, 2.0), (0.0, 0.0), (-0.6, 0.8), 0.125 + 0.09375, 0.25,
         0.375 - 0.09375 + 0.25),
        ("no load: what was stored", (0.0, 0.0), (1.0, 0.0), (0.0, 0.0), 0.0, None, 0.21875),
        ("virgin again", (2.0, 100.0), (0.5, 0.0), (-1.0, 0.0), 0.25, 0.0, 0.0),
    ],
    0.0: [  # rescaled
        ("loading sticks", (2.0, 100.0), (1.5, 0.0), (-3.0, 0.0), 9.0 / 4.0, 0.0, 0.0),
        ("across it", (2.0, 100.0), (0.0, 2.0), (-3.0, -4.0), 25.0 / 4.0, 0.0, 0.0),
        ("more area keeps the force: half of 25/4", (4.0, 100.0), (0.0, 0.0), (-3.0, -4.0), 25.0 / 8.0, 0.0, 3.125),
        ("less area loses its share: 3/4 of 25/8", (1.0, 100.0), (0.0, 0.0), (-0.75, -1.0), 1.5625 / 2.0, 0.0, 2.34375),
        ("back through zero", (1.0, 100.0), (-0.75, -1.0), (0.0, 0.0), 0.0, 0.0, 0.0),
        ("the limit mu N = 2, over 3 m", (1.0, 4.0), (3.0, -4.0), (-1.2, 1.6), 2.0, 3.0, 6.0),
        ("less load, less limit: 1 N over 1 m", (1.0, 2.0), (0.0, 0.0), (-0.6, 0.8), 0.5, 1.0, 1.0),
        ("no load: what was stored", (0.0, 0.0), (1.0, 0.0), (0.0, 0.0), 0.0, None, 0.5),
        ("virgin again", (2.0, 100.0), (0.5, 0.0), (-1.0, 0.0), 0.25, 0.0, 0.0),
    ],
}  # fmt: skip


@pytest.mark.parametrize("keeps", MINDLIN_BY_HAND)
def test_mindlin_path_by_hand(keeps):
    memory, p = NO_HISTORY, MindlinParameters(0.5, 0.5, 1.0, keeps)
    for name, (a, force), slip, tangential, energy, sliding, released in MINDLIN_BY_HAND[keeps]:
        t, memory = plain(MINDLIN.kernel)(contact(1.0, 1.0, *slip), Load(force, force, a, 0.0, 0.0), p, memory)
        assert (t.x, t.y) == exact(tangential), name
        assert t.limit == 0.5 * force, name
        assert (t.stored, t.dissipated) == exact((energy, released)) and t.dissipated >= 0.0, name
        if sliding is not None:
            assert t.slip == exact(sliding), name
    assert t.stored == 0.25


def test_without_friction_all_slides_freely_and_no_contact_answers_zero():
    free = COULOMB.mix(Pair(UPPER, PARTICLE, 0.0, 1.0), {"slip_scale": 0.25})
    for law, parameters in ((MINDLIN, MindlinParameters(0.5, 0.0, 0.0, 1.0)), (COULOMB, free)):
        t, _ = plain(law.kernel)(contact(1.0, 2.0, 3.0, 4.0), Load(10.0, 10.0, 1.0, 0.0, 0.0), parameters, NO_HISTORY)
        assert (t.x, t.y, t.stored, t.dissipated) == (0.0, 0.0, 0.0, 0.0), law.name
        assert t.slip == exact(5.0), law.name
        p = law.mix(Pair(UPPER, PARTICLE, 0.3, 1.0), {"slip_scale": 1e-3})
        t, memory = plain(law.kernel)(contact(0.0, 1e-6, 1e-9), Load(0.0, 0.0, 0.0, 0.0, 0.0), p, NO_HISTORY)
        assert (t.x, t.y, t.limit, t.stored, t.dissipated) == (0.0, 0.0, 0.0, 0.0, 0.0) and memory == NO_HISTORY


COULOMB_BY_HAND = {  # N, slip, T, stored, slip at the limit, dissipated
    "two_number": [
        (8.0, 0.25, -2.0, 0.25, 0.0, 0.0),
        (8.0, 0.75, -4.0, 1.0, 0.5, 2.0),
        (4.0, 0.0, -2.0, 0.5, 0.0, 0.5),  # half the load: half the force, half the energy
        (8.0, 0.0, -2.0, 0.5, 0.0, 0.0),  # more load: same force, same energy
        (4.0, 0.0, -2.0, 0.5, 0.0, 0.0),  # and less again
        (8.0, -0.25, 0.0, 0.25, 0.0, 0.0),  # a uniform field of 2 N holds 1/4 J, the other 1/4 stays
        (8.0, -1.5, 4.0, 1.0 + 0.25 / 9.0, 1.0, 4.0 + 0.25 * 8.0 / 9.0),  # the limit is a third of the trial force
    ],
    "rescaled": [
        (8.0, 0.25, -2.0, 0.25, 0.0, 0.0),
        (8.0, 0.75, -4.0, 1.0, 0.5, 2.0),
        (4.0, 0.0, -2.0, 0.5, 0.0, 0.5),  # half the load: half the force, half the energy
        (8.0, 0.0, -2.0, 0.25, 0.0, 0.25),  # more load: same force on a stiffer spring
        (8.0, -0.25, 0.0, 0.0, 0.0, 0.0),
        (8.0, -1.5, 4.0, 1.0, 1.0, 4.0),
    ],
}


@pytest.mark.parametrize("kind", COULOMB_BY_HAND)
def test_coulomb_path_by_hand(kind):
    # R 2 and slip scale 1/4: the limit is reached after s_0 = 1/2; with mu 1/2 the stiffness is mu N/s_0 = N
    memory, p = NO_HISTORY, COULOMB.mix(Pair(UPPER, PARTICLE, 0.5, 1.0), {"slip_scale": 0.25, "memory": kind})
    for load, slip, force, stored, sliding, dissipated in COULOMB_BY_HAND[kind]:
        t, memory = plain(COULOMB.kernel)(contact(0.1, 2.0, slip), Load(load, load, 0.1, 0.0, 0.0), p, memory)
        assert (t.x, t.y, t.limit, t.stored, t.slip, t.dissipated) == exact((force, 0.0, 0.5 * load, stored, sliding, dissipated))
        assert t.critical == 0.5


def test_the_module_of_laws_as_it_stands_is_hertz_alone():
    inputs = np.zeros((law_input.HISTORY + rolling_input.WIDTH, TILE))
    inputs[law_input.OVERLAP], inputs[law_input.RADIUS], inputs[law_input.SLIP_X] = np.geomspace(1e-12, 1e-8, TILE), 1e-6, 1e-9
    chain, e_stars = compose((HERTZ,)), np.array([110e9])
    for name, width in (
        ("law", law_output.HISTORY + rolling_output.WIDTH),
        ("stiffness", 8),
        ("tangents", contact_tangent.WIDTH),
    ):
        generated, own = (np.zeros((width, TILE)) for _ in range(2))
        getattr(chain, name)(inputs.ravel(), generated.ravel(), TILE, e_stars)
        getattr(tile_law, name)(inputs.ravel(), own.ravel(), TILE, e_stars)
        assert np.array_equal(generated, own) and generated[0].all()
