"""A bed of spheres in slow shear, against the literature and against LAMMPS from the same start; the runs are behind `full`."""

import json
from pathlib import Path

import numpy as np
import pytest
from bed_rheology import REFERENCE, Shear, limit, measure, volume_below
from pages import ROOT

import thirdbody

LAMMPS = json.loads((Path(__file__).parent / "data" / "lammps_sphere_bed.json").read_text(encoding="utf-8"))
CONTACT_FRICTION = 0.3


def test_volume_of_spheres_below_a_height():
    z, radius = np.array([0.0, 2.0, 3.0]), np.array([1.0, 0.5, 2.0])
    whole = 4.0 / 3.0 * np.pi * radius**3
    cap = np.pi * 1.5**2 * (2.0 - 1.5 / 3.0)  # of height 1.5 on a sphere of radius 2
    assert volume_below(0.0, z[:1], radius[:1]) == pytest.approx(0.5 * whole[0], rel=1e-12)
    assert volume_below(2.5, z, radius) == pytest.approx(whole[0] + whole[1] + cap, rel=1e-12)
    assert volume_below(9.0, z, radius) == pytest.approx(whole.sum(), rel=1e-12)


def test_limit_of_slow_shear_is_that_of_a_straight_line():
    states = [Shear(i, 0.3 + i, 0.01, 0.4 + 2.0 * i, 0.02, 0.6 - i, 0.001, 1.0, 5.0, 0.01) for i in (1e-3, 1e-2, 3e-2)]
    states.append(states[0]._replace(inertial_number=0.2, bed_friction=9.0))  # too fast to count
    zero = limit(states)
    assert [zero.bed_friction[0], zero.plate_friction[0], zero.solid_fraction[0]] == pytest.approx([0.4, 0.3, 0.6], rel=1e-9)
    # three points of error 0.02 fix the intercept to between 0.02/sqrt(3) and 0.02
    assert 0.011 < zero.bed_friction[1] < 0.02


@pytest.fixture(scope="module")
def states(tmp_path_factory):
    """States of shear at 50, 15 and 5 m/s: inertial numbers 0.08, 0.03 and 0.01."""
    file = ROOT / "scenes" / "sweeps" / "sphere_bed.toml"
    scene = thirdbody.Scene.load(file).with_settings({"solver.distance": "715 um", "pairs.0.friction": CONTACT_FRICTION})
    with thirdbody.run(scene, out=tmp_path_factory.mktemp("bed") / "run", progress=False) as run:
        return measure(run)


@pytest.mark.full(kind="slow")
def test_friction_and_solid_fraction_are_those_of_homogeneous_shear(states):
    (friction, fraction), slowest = REFERENCE[CONTACT_FRICTION], states[-1]
    assert slowest.inertial_number == pytest.approx(0.01, rel=0.5)
    # 1.6 strains of 980 spheres fix the friction to about 0.013; at I = 0.01 it is 0.006 above its limit
    assert slowest.bed_friction == pytest.approx(friction, abs=0.035)
    # overlaps of 0.5 % of a radius raise it by 0.004, sizes that differ by 20 % by some thousandths
    assert slowest.solid_fraction == pytest.approx(fraction, abs=0.01)
    assert states[0].bed_friction > slowest.bed_friction and states[0].solid_fraction < slowest.solid_fraction


@pytest.mark.full(kind="slow")
def test_a_bed_shears_as_in_lammps(states):
    theirs, ours = LAMMPS["slow"], states[-1]
    error = np.hypot(ours.plate_friction_error, theirs["friction_error"])
    assert ours.plate_friction == pytest.approx(theirs["friction"], abs=3.0 * error)
    assert ours.solid_fraction == pytest.approx(theirs["solid_fraction"], abs=0.01)
