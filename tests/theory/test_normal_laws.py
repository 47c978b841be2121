"""A normal law of a user, in one file, under the built-in friction: a cone, whose contact radius grows as the overlap."""

import math

import pytest
from balls import BALLS, edited
from thirdbody_three_spot.mdr import MDR
import thirdbody
from thirdbody.laws.compose import ordered
from thirdbody.laws.conformance.suite import check, report
from thirdbody.laws.contract import Material
from thirdbody.laws.hertz import e_star
from thirdbody.laws.registry import load_file

SLOPE = 30.0
LAW = f'''
import math
from typing import NamedTuple
from thirdbody.plugin import COULOMB, HERTZ_DAMPING, MINDLIN, Law, LawFamily, Normal, Plugin, TANGENTIAL_DAMPING, e_star, kernel

class Cone(NamedTuple):
    e_star: float

@kernel
def cone(c, p):
    """N = E* a d with a = SLOPE d; the pressure is the mean one, that of the tip is infinite."""
    a = {SLOPE} * c.overlap
    force = p.e_star * a * c.overlap
    return Normal(force, a, force * c.overlap / 3.0, 0.0, p.e_star / (math.pi * {SLOPE}), 2.0 * {SLOPE} * a)

@kernel
def cone_tangent(c, p):
    return 2.0 * p.e_star * {SLOPE} * c.overlap

def mix(pair, options):
    return Cone(e_star(pair.a, pair.b))

CONE = Law("cone", "normal", cone, Cone, mix, source="Sneddon 1965", tangent=cone_tangent)
PLUGIN = Plugin("cones", families=(LawFamily("cones", {{
    "mindlin": (CONE, HERTZ_DAMPING, MINDLIN, TANGENTIAL_DAMPING), "coulomb": (CONE, HERTZ_DAMPING, COULOMB, TANGENTIAL_DAMPING),
}}, "mindlin"),))
'''
SCENE = edited(
    BALLS,
    ("four balls", "cones"), ("count = 4", "count = 3"), ('damping = "7e-5 kg/s"\n', ""), ("0.5 m/s", "10 mm/s"),
    ("[solver]", '[contact]\nlaw = "cones"\ndebris_contact = "none"\n[solver]'),
    ('distance = "0.1 um"\nsettle = "1 us"', 'distance = "5 nm"'),
    ("0.05 um", "5 nm"),
)  # fmt: skip


@pytest.fixture(scope="module")
def plugin(tmp_path_factory):
    path = tmp_path_factory.mktemp("plugin") / "cones.py"
    path.write_text(LAW)
    return path


def test_the_law_conforms(plugin):
    (family,) = load_file(plugin).families
    findings = check([family.levels["mindlin"][0]])
    assert all(finding.passed for finding in findings), report(findings)


@pytest.mark.parametrize("integrator", ["explicit", "implicit"])
def test_a_run_writes_the_peak_pressure_of_the_law(plugin, tmp_path, integrator):
    scene = thirdbody.Scene.parse(SCENE, "cones.toml", plugins=[plugin]).with_settings({"solver.integrator": integrator})
    with thirdbody.run(scene, out=tmp_path / "run", plugins=[plugin], threads=1, progress=False) as run:
        bodies, contacts = run.bodies(-1), run.contacts(-1)
        material = scene.materials["steel"]
        steel = Material("steel", material.shear(), material.poisson_ratio, material.density)
        expected = e_star(steel, steel) / (math.pi * SLOPE)
        assert contacts["contact_radius"] == pytest.approx(SLOPE * contacts["overlap"], rel=1e-12)
        assert contacts["peak_pressure"] == pytest.approx(expected, rel=1e-12)
        assert bodies["peak_pressure"] == pytest.approx(expected, rel=1e-12)
        assert run.summary()["peak_pressure"] == pytest.approx(expected, rel=1e-12)


def test_a_law_derived_for_spheres_is_refused_under_it(plugin):
    (family,) = load_file(plugin).families
    with pytest.raises(ValueError, match="'mdr' assumes the normal law 'hertz', not 'cone'"):
        ordered((family.levels["mindlin"][0], MDR))
