"""Particles given by spots: what a scene may say, where they stand, and which plate each spot meets."""

import numpy as np
import pytest
from each import each
from steel import scene_text

from thirdbody.assembly.populate import population_context
from thirdbody.assembly.simulation import build
from thirdbody.errors import InputError
from thirdbody.kernels.plates import BASINS
from thirdbody.scene.model import Scene
from thirdbody.schema.write import toml_text

UPPER = 'support = "load_per_particle"\nload = "0.1 mN"\nmotion = {{x = {{velocity = "-0.01 m/s"}}{motion}}}\n{more}'
DEBRIS = '[[debris]]\nmaterial = "steel"\nkind = "spots"\n{keys}'
SCENE = scene_text(DEBRIS, '["20 um", "20 um"]', UPPER, solver='distance = "20 nm"', every="1 nm")
SPOTS = """spots = [
  {side = "upper", x = "0.2 um", z = "2 um", radius = "2 um"},
  {side = "lower", x = "-2 um", z = "-2 um", radius = "1 um"},
  {side = "lower", x = "1.5 um", z = "-2 um", radius = "1.5 um"},
]
"""
MASS = 'mass = "1e-13 kg"\ninertia = "2e-25 kg m2"\n'
PLANAR = SPOTS + MASS + "planar = true\n"


def scene(keys=SPOTS + MASS, motion="", more=""):
    return Scene.parse(SCENE.format(keys=keys, motion=motion, more=more), "s.toml")


def test_summits_stand_on_the_plates_and_meet_their_own_side_only():
    state = build(scene()).state
    # the clearance at the start is 1e-9 of the height
    assert state.S[:, 2] + np.array([1.0, -1.0, -1.0]) * state.spheres.radius == pytest.approx([4e-6, 0.0, 0.0], abs=1e-14)
    low = SPOTS.replace('radius = "1.5 um"', 'radius = "3 um"')  # a sphere of the lower side that reaches above the upper summit
    assert build(scene(low + MASS)).upper.plate.heights == pytest.approx(4e-6, rel=1e-6)
    # all three spheres are close to both plates, yet each is a candidate of one plate only
    candidates = sorted(zip(state.slots.own.tolist(), state.slots.partner.tolist(), strict=True))
    assert candidates == [(0, -1 - BASINS), (1, -1), (2, -1)]
    assert state.bodies.mass[0] == pytest.approx(1e-13, rel=1e-15)
    assert state.bodies.inertia[0] == pytest.approx([2e-25] * 3, rel=1e-15)
    # spots do not meet other bodies
    built = build(scene(SPOTS + MASS + 'positions = [["10 um", "10 um"], ["11 um", "10 um"]]\n'))
    built.integrator.advance_to(time=0.5 * built.settle)
    assert np.all(built.state.slots.partner < 0) and built.state.slots.count == 6


FAULTS = [
    ({"keys": SPOTS}, "debris[0].mass: required key is missing"),
    ({"keys": SPOTS.replace('side = "lower"', 'side = "upper"') + MASS}, "no spot on the lower side"),
    ({"keys": SPOTS.replace('z = "2 um"', 'z = "-3 um"') + MASS}, "the upper spots are not above the lower ones"),
    ({"keys": SPOTS + MASS.replace("2e-25 kg m2", "2e-25 kg")}, "moment of inertia"),
    ({"keys": SPOTS + MASS.replace('"2e-25 kg m2"', '["1e-25 kg m2", "5e-25 kg m2", "1e-25 kg m2"]')},
     "debris[0].inertia: 5e-25 is above 1e-25 + 1e-25, the sum of the other moments of inertia"),
    ({"keys": PLANAR.replace('x = "0.2 um"', 'x = "0.2 um", y = "1 um"')}, "spots[0].y: must be 0 in a planar particle"),
    ({"keys": PLANAR, "motion": ', y = {velocity = "1 m/s"}'}, "motion.y: drives planar particles"),
    ({"keys": PLANAR, "more": '[effects]\ngravity = ["0 m/s2", "1 m/s2", "0 m/s2"]'}, "gravity[1]: drives planar particles"),
    ({"keys": PLANAR + 'velocity = ["0 m/s", "1 m/s", "0 m/s"]\n'}, "velocity[1]: must be 0 in a"),
]  # fmt: skip


@each(FAULTS, name_of=lambda row: row[1])
def test_faults(row):
    with pytest.raises(InputError) as caught:
        scene(**row[0])
    assert row[1] in str(caught.value)


def test_bodies_of_spots():
    made = scene(PLANAR)
    assert Scene.parse(toml_text(made.document())) == made
    # rows fill the domain
    crowd = scene(SPOTS + MASS.replace('"2e-25 kg m2"', '["1e-25 kg m2", "2e-25 kg m2", "3e-25 kg m2"]') + "count = 7\n")
    made = crowd.debris[0].bodies(population_context(crowd, 0, []))
    places = made.positions[:, :2]
    assert places.shape == (7, 2) and np.all(places > 0.0) and np.all(places < 20e-6)
    assert len(np.unique(places.round(12), axis=0)) == 7
    # the mass and inertia given
    body, density = made.clumps[0], crowd.materials["steel"].density
    assert body.volume * density == pytest.approx(1e-13) and body.inertia * density == pytest.approx([1e-25, 2e-25, 3e-25])
    assert body.centers[0] == pytest.approx([0.2e-6, 0.0, 0.0])
