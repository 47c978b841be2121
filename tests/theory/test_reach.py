"""A law that acts before touch: a linear attraction of finite reach, in one file, as an effect over Hertz' contact."""

import numpy as np
import pytest
from thirdbody.assembly.simulation import build
from thirdbody.engine.guards import Ledger
from thirdbody.errors import InputError
from thirdbody.kernels.tables import record
from thirdbody.laws.conformance.suite import check, report
from thirdbody.laws.contract import Material, Pair
from thirdbody.laws.hertz import HERTZ
from thirdbody.laws.registry import discover, load_file
from thirdbody.scene.model import Effects, Solver
from thirdbody.statics.contacts import Contacts

REACH, PULL, RADIUS = 50e-9, 2e-8, 5e-6
WAVES = {"wave": {"amplitude": "10 nm", "wavelength": "10 um"}, "curvature": False}
LAW = '''
from typing import NamedTuple
from thirdbody.plugin import Adhesion, Law, Option, Plugin, kernel

class Attraction(NamedTuple):
    pull: float
    reach: float

@kernel
def attraction(c, n, p):
    """F grows linearly from the reach to touch, and is constant in contact; U is its integral."""
    inside = min(max(c.overlap + p.reach, 0.0), p.reach)
    force = p.pull * inside / p.reach
    return Adhesion(-force, -0.5 * force * inside - p.pull * max(c.overlap, 0.0))

@kernel
def attraction_tangent(c, n, p):
    return -p.pull / p.reach if -p.reach < c.overlap < 0.0 else 0.0

def mix(pair, options):
    return Attraction(options["pull"], options["reach"])

ATTRACTION = Law(
    "attraction", "adhesion", attraction, Attraction, mix, source="a straight line", tangent=attraction_tangent,
    options=(Option("pull", "force", None, low=0.0), Option("reach", "length", 1e-9, low=1e-12)),
    reach=lambda pair, options, radius: options["reach"],
)
PLUGIN = Plugin("attraction", effects=(ATTRACTION,))
'''


@pytest.fixture(scope="module")
def plugin(tmp_path_factory):
    path = tmp_path_factory.mktemp("plugin") / "attraction.py"
    path.write_text(LAW)
    return path


def built(make, plugin, gap, speed=0.0, lower=None):
    """Two balls that approach at twice `speed`, or one above a plate, `gap` apart."""
    pull = {"attraction": {"pull": f"{PULL} N", "reach": f"{REACH} m"}}
    if lower:
        debris = [make.ball(RADIUS, (5.0, 5.0, RADIUS + gap), (0.0, 0.0, -speed))]
    else:
        x = RADIUS + 0.5 * gap
        debris = [make.ball(RADIUS, (-x, 0.0, 0.0), (speed, 0.0, 0.0)), make.ball(RADIUS, (x, 0.0, 0.0), (-speed, 0.0, 0.0))]
    return build(make.scene(debris, {"ball": make.STEEL}, lower=lower, effects=Effects(named=pull)), discover([plugin]))


def test_the_law_conforms_and_has_its_force_at_half_the_reach_and_beyond(plugin, make):
    findings = check(load_file(plugin).effects)
    assert all(finding.passed for finding in findings), report(findings)
    for lower in (None, "ball"):
        simulation = built(make, plugin, 0.5 * REACH, lower=lower)
        make.advance(simulation)
        contact = make.contact(simulation)
        # it has moved by less than 1e-6 of the reach in the first step
        assert contact[record.OVERLAP] == pytest.approx(-0.5 * REACH, rel=1e-5)
        assert contact[record.NORMAL_FORCE] == pytest.approx(-0.5 * PULL, rel=1e-5)
        assert contact[record.LOAD] == contact[record.CONTACT_RADIUS] == contact[record.PEAK_PRESSURE] == 0.0
    simulation = built(make, plugin, 1.01 * REACH)
    make.advance(simulation, 3)
    assert not make.touching(simulation).any()
    assert np.all(simulation.state.bodies.force == 0.0)


@pytest.mark.parametrize("lower", [None, "ball"])
def test_an_encounter_conserves_energy(make, plugin, lower):
    """In through the reach, an elastic impact, and out again; faster in between, by the work of the attraction."""
    speed = 0.05
    simulation = built(make, plugin, 1.5 * REACH, speed, lower)
    axis, mass = (2 if lower else 0), make.ball_mass(make.STEEL, RADIUS)
    relative = 1.0 if lower else 2.0  # speed of approach over that of a ball; reduced mass m/1 or m/2
    fastest, met = 0.0, False
    ledger = Ledger(simulation.state)
    while make.touching(simulation).any() or not met:
        make.advance(simulation)
        touches = make.touching(simulation)
        met = met or bool(touches.any())
        overlap = float(make.contact(simulation)[record.OVERLAP]) if touches.any() else -1.0
        fastest = max(fastest, abs(make.velocity(simulation)[axis])) if overlap < 0.0 else fastest
    # truncation of the impact, whose step is some thirtieth of it: 5e-5 of the speed, 1e-4 of the energy
    assert abs(make.velocity(simulation)[axis]) == pytest.approx(speed, rel=2e-4)
    gained = 0.5 * PULL * REACH  # shared by the balls
    expected = np.sqrt(speed**2 + 2.0 * gained / mass / relative)
    assert expected > 1.01 * speed
    assert fastest == pytest.approx(expected, rel=1e-3)
    assert abs(ledger.lines(simulation.state)["residual"]) < 4e-4 * 0.5 * mass * speed**2 * relative


def test_the_implicit_integrator_on_rough_plates_and_a_quasi_static_path_refuse_it(make, plugin):
    upper = make.UpperPlate(material="ball", load=1e-4, surface=WAVES)
    tables = make.scene(
        [make.ball(RADIUS, (5e-6, 5e-6, 1.01 * RADIUS))], {"ball": make.STEEL}, lower="ball", upper=upper, size=20e-6,
        effects=Effects(named={"attraction": {"pull": f"{PULL} N"}}), solver=Solver(duration=make.LONG, integrator="implicit"),
    )  # fmt: skip
    with pytest.raises(InputError, match="attraction acts beyond touch, which an implicit step on rough plates does not have"):
        build(tables, discover([plugin]))
    steel = Material("steel", 80e9, 0.3, 7850.0)
    laws = (HERTZ, *load_file(plugin).effects)
    with pytest.raises(ValueError, match="no law that acts before touch: attraction"):
        Contacts(laws, [Pair(steel, steel, 0.3, 0.6)], np.zeros(1, np.int64), np.full(1, 1e-6), {"pull": 1e-5})
