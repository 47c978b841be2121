"""Wear that acts back on the plates: volume, grooves by Archard's law, the energy that goes with the worn depth, and what follows.

Flakes of four spheres, side by side, stick to the upper plate by its larger friction and grind the lower one along x. Their tracks
lie nearer to each other than what the worn depth resolves, so that they make one groove.
"""

import functools
from pathlib import Path

import numpy as np
import pytest
from steel import STEEL
import thirdbody
from thirdbody.errors import GuardStop, Interrupted
from thirdbody.runner.resume import prepare_resume
from thirdbody.runner.simulate import execute, prepare
from thirdbody.surfaces.surface import Surface
from thirdbody.surfaces.wear import flat_surface, worn_surface

MICRO = 1e-6
LENGTH, APART, LOAD, K = 40.0, 1.0, 1e-4, 1e-15  # of the domain [um], of tracks [um], load of a flake [N], wear [m3/J]
FLAKES = range(12, 29)  # y [um]


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(("cells", "points"), [((40, 30), (64, 48)), ((64, 48), (40, 30)), ((33, 17), (80, 50)), ((50, 50), (50, 50))])
def test_the_volume_taken_is_that_of_the_map(cells, points, seed):
    """The mean of a spline through periodic heights is theirs, so both volumes are sums; they agree but for rounding."""
    rng, size = np.random.default_rng(seed), (50e-6, 30e-6)
    depth = 1e-9 * rng.random(cells[::-1]) ** 8  # spots
    before = Surface(1e-7 * rng.standard_normal(points[::-1]), size, 8e-6)
    taken = before.coefficients - worn_surface(before, depth).coefficients
    area = size[0] * size[1]
    assert taken.mean() * area == pytest.approx(depth.mean() * area, rel=1e-9)
    # the Gaussian is positive: what it leaves of waves that the points cannot hold is below 6 %
    assert taken.min() > -0.06 * taken.max()


def test_a_worn_wave_keeps_its_place_and_what_the_filter_leaves():
    """ISO 16610-21: a wave of the cut-off is halved, one of three times that keeps 2^(-1/9); both stay where the cells are."""
    n, short = 240, 4e-6
    size = (48e-6, 24e-6)
    flat = Surface(np.zeros((96, 192)), size, short)
    middles = (np.arange(n) + 0.5) * (size[0] / n)
    for wave in (short, 3.0 * short):
        depth = np.broadcast_to(1e-9 * (1.0 + np.cos(2.0 * np.pi * middles / wave)), (n // 2, n))
        x = np.arange(192) * (size[0] / 192)
        left = 2.0 ** -((short / wave) ** 2)
        expected = -1e-9 * (1.0 + left * np.cos(2.0 * np.pi * x / wave))
        assert worn_surface(flat, depth).heights[7] == pytest.approx(expected, abs=1e-9 * 1e-12)


def text(integrator="implicit", flakes=FLAKES, speed="1 mm/s", wear="", distance="160 um", every="40 um", more=""):
    places = ", ".join(f'["{(7 * y) % 40} um", "{y} um", "2 um"]' for y in flakes)
    return f"""
scene = 1
{STEEL_ONLY}
[materials.grip]
youngs_modulus = "210 GPa"
poisson_ratio = 0.3
density = "7850 kg/m3"
[[pairs]]
between = ["steel", "steel"]
friction = 0.2
restitution = 0.6
[[pairs]]
between = ["grip", "steel"]
friction = 0.8
restitution = 0.6
[[debris]]
material = "steel"
kind = "spheres"
shape = [
  {{center = ["0 um", "0 um", "0 um"], radius = "2 um"}}, {{center = ["3 um", "0 um", "0 um"], radius = "2 um"}},
  {{center = ["-1.5 um", "2.6 um", "0 um"], radius = "2 um"}}, {{center = ["-1.5 um", "-2.6 um", "0 um"], radius = "2 um"}},
]
positions = [{places}]
[domain]
size = ["{LENGTH:g} um", "40 um"]
{wear}
[plates.lower]
material = "steel"
[plates.upper]
material = "grip"
support = "load_per_particle"
load = "0.1 mN"
motion = {{x = {{velocity = "{speed}"}}}}
{more}
[contact]
debris_contact = "none"
[measures]
cell = "1 um"
wear = {{plates = "{K} m3/J"}}
[solver]
integrator = "{integrator}"
distance = "{distance}"
[output]
every = "{every}"
"""
