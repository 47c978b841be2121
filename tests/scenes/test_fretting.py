"""The friction loop of a short stroke against its closed form, and the shipped fretting scenes."""

import math

import numpy as np
import pytest
from balls import edited
from steel import SCENES, STEEL
import thirdbody
from thirdbody.errors import InputError
from thirdbody.runner.simulate import prepare

MU, LOAD, AMPLITUDE, FREQUENCY = 0.2, 2e-4, 40e-9, 1e5
YOUNG, POISSON, RADIUS = 210e9, 0.3, 2e-6
E_STAR = YOUNG / (2.0 * (1.0 - POISSON**2))
G_STAR = YOUNG / (2.0 * (1.0 + POISSON)) * 2.0 / (2.0 - POISSON)  # two equal bodies: G* = 2 G/(2 - nu)
# A table on four legs above and four below, thirty times as wide as high: the couple of the drag tilts it by next to
# nothing. A high restitution, so that the tangential dashpots add little to the springs.
WIDE = edited(STEEL, ("friction = 0.30", "friction = 0.2"), ("restitution = 0.60", "restitution = 0.9")) + """\
[[debris]]
kind = "spots"
material = "steel"
mass = "2e-12 kg"
inertia = ["1e-20 kg m2", "1e-20 kg m2", "2e-20 kg m2"]
spots = [SPOTS]
[domain]
size = ["300 um", "300 um"]
[plates]
lower = {material = "steel"}
upper = {material = "steel", support = "load_per_particle", load = "0.2 mN", motion.x = {stroke = "80 nm", frequency = "100 kHz"}}
[solver]
duration = "20 us"
[output]
every = "0.04 us"
"""  # fmt: skip
SPOT = '{{side = "{}", x = "{} um", y = "{} um", z = "{} um", radius = "2 um"}}'
LEGS = ", ".join(SPOT.format(side, x, y, z) for side, z in (("lower", -2), ("upper", 2)) for x in (-60, 60) for y in (-60, 60))


@pytest.fixture(scope="module")
def loop(tmp_path_factory):
    """Displacement of the plate (m) and friction force (N) in the middles of outputs of the second cycle."""
    scene = thirdbody.Scene.parse(WIDE.replace("SPOTS", LEGS))
    settle = prepare(scene).settle
    with thirdbody.run(scene, out=tmp_path_factory.mktemp("loop") / "run", progress=False) as run:
        time = run.series["time"] - settle
        time = 0.5 * (time[1:] + time[:-1])
        force = -run.series["upper_force"][1:, 0]
    second = time >= 1.0 / FREQUENCY * (1.0 - 1e-9)
    return AMPLITUDE * (1.0 - np.cos(2.0 * math.pi * FREQUENCY * time[second])), force[second]


def spot():
    """Tangential stiffness (N/m) and critical slip (m) of one of the four spots of a side: k = 2 G* a, s_c = mu N/k."""
    load = LOAD / 4.0
    a = (3.0 * load * RADIUS / (4.0 * E_STAR)) ** (1.0 / 3.0)
    stiffness = 2.0 * G_STAR * a
    return stiffness, MU * load / stiffness


@pytest.mark.full(kind="slow")  # in the default: reversals of a stroke, tests/hard/test_implicit_hard.py
def test_the_loop_has_the_area_of_an_elastic_slider_and_the_slope_of_all_spots(loop):
    x, force = loop
    area = abs(float(np.sum(0.5 * (force[1:] + force[:-1]) * np.diff(x))))
    critical = 2.0 * spot()[1]  # upper and lower side in series
    # The tilt (.1 % of the compliance, which is 4 % of the stroke), the dashpots (1 % of that) and chords of 250 outputs a cycle.
    assert area == pytest.approx(4.0 * MU * LOAD * (AMPLITUDE - critical), rel=1e-3)
    # The load on the patch is constant but for its inertia: (a few nm of tilt) x (2 pi f)^2 x mass is 1e-9 of it.
    assert np.max(np.abs(force)) == pytest.approx(MU * LOAD, rel=1e-3)
    x, force = loop
    turn = int(np.argmax(x))
    side = 4.0 * spot()[0]
    back = (x[turn] - x) < 0.8 * 4.0 * spot()[1]  # from +mu N to -mu N it is 2 x 2 s_c
    part = np.flatnonzero(back & (np.arange(len(x)) >= turn) & (x < x[turn]))
    slope = np.polyfit(x[part], force[part], 1)[0]
    # Two sides in series. The tilt lets the plate move on by h^2/sum(k_n x^2) = 16/(8 x 3600)/k_n, .1 % of 2/(4 k_t); the
    # dashpots carry up to .5 % at the speed reached there.
    assert slope == pytest.approx(0.5 * side, rel=0.01)


def test_the_laboratory_stroke_is_refused_with_its_years():
    rig = thirdbody.Scene.load(SCENES / "fretting_rig.toml")
    with pytest.raises(InputError, match=r"years of explicit integration"):
        prepare(rig.with_settings({"solver.integrator": "explicit", "solver.duration": "10 s"}))
