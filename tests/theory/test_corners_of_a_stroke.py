"""What the implicit integrator loses where a triangular stroke turns at once: its first step after a corner is of first order."""

from __future__ import annotations

import math

import numpy as np

from thirdbody.kernels import layout as at
from thirdbody.scene.build import build
from thirdbody.scene.model import Scene

LOSS = 0.03
"""Share of the work. A first step as long as those before it loses .032 here by the corners alone, .052 in all; a tenth of that
length leaves .02, which is what the oscillation that they start loses in steps of second order."""

SCENE = """
scene = 1
title = "soft rosettes that a stroke shakes after their load is gone"
[materials.a]
youngs_modulus = "1.1785 MPa"
poisson_ratio = 0.499
density = "255.87 kg/m3"
[[pairs]]
between = ["a", "a"]
friction = 1000.0
restitution = 0.9
[[debris]]
material = "a"
kind = "spheres"
count = 2
seed = 0
shape = [{shape}]
[domain]
size = ["180 um", "140 um"]
[plates.lower]
material = "a"
[plates.upper]
material = "a"
support = "load_per_particle"
load = "76.75 nN"
motion = {{x = {{stroke = "196.88 nm", frequency = "2.53958 MHz", shape = "triangle"}}}}
loading = {{load = "0 N"}}
[contact]
debris_contact = "none"
[effects]
gravity = ["0 m/s2", "0 m/s2", "-9.81 m/s2"]
[solver]
integrator = "implicit"
duration = "7.8753 us"
[output]
every = "0.98442 us"
"""


def rosette() -> str:
    """A ball of 5 um with eight of its size around it."""
    places = [(0.0, 0.0), *((7.5 * math.cos(k * math.pi / 4.0), 7.5 * math.sin(k * math.pi / 4.0)) for k in range(8))]
    return ", ".join(f'{{center = ["{x:.6f} um", "{y:.6f} um", "0 um"], radius = "5 um"}}' for x, y in places)


def test_corners_of_a_stroke_lose_little(tmp_path):
    path = tmp_path / "shaken.toml"
    path.write_text(SCENE.format(shape=rosette()))
    simulation = build(Scene.load(path))
    for time in simulation.settle + 0.98442e-6 * np.arange(1, 9):
        simulation.integrator.advance_to(time=float(time))
    totals = simulation.integrator.totals
    lost = totals[:, at.A_NUMERICAL] / totals[:, at.A_PLATE_ABS]
    assert -0.01 < lost.min() and lost.max() < LOSS
    # what it costs: 18 steps between two corners become some 21
    assert totals[:, at.A_STEPS].max() < 1200
