"""Dilute and dense beds, against all pairs with all images and a count of random points; and both kinds in a scene."""

import itertools

import numpy as np
import pytest
from each import each
from steel import scene_text
from thirdbody.assembly.placement import spheres_of
from thirdbody.assembly.populate import populate
from thirdbody.bodies.clump import clump
from thirdbody.bodies.irregular_clumps import population
from thirdbody.bodies.overlap_removal import pack
from thirdbody.bodies.packing import scatter
from thirdbody.errors import InputError
from thirdbody.rotations import matrix_from_quaternion
from thirdbody.scene.model import Scene

SIZE = (45e-6, 40e-6)
WIDE, HEIGHT = (60e-6, 50e-6), 70e-6


@pytest.fixture(scope="module")
def bodies():
    size = {"distribution": "lognormal", "median": 1e-5, "sigma": 0.3, "min": 5e-6, "max": 2e-5}
    return population(1, 0, 50, (3, 6), (1.0, 0.8, 0.6), **size) + [clump([[0, 0, 0]], [3e-6])] * 30


def world(clumps, x, q):
    centres, radii, ids = spheres_of(clumps, x, q)
    return np.column_stack((centres, radii)), ids


def images(spheres, ids, size, periodic):
    shifts = list(itertools.product((0, 1, -1), repeat=2)) if periodic else [(0, 0)]
    many = [spheres + (a * size[0], b * size[1], 0.0, 0.0) for a, b in shifts]
    return np.vstack(many), np.concatenate([ids + k * (ids.max() + 1) for k in range(len(shifts))])


def least_gap(spheres, ids, size, periodic):
    all_spheres, all_ids = images(spheres, ids, size, periodic)
    reach = spheres[:, None, 3] + all_spheres[:, 3]
    gap = (np.linalg.norm(spheres[:, None, :3] - all_spheres[:, :3], axis=2) - reach) / reach
    return gap[ids[:, None] != all_ids].min()


CASES = [(0.3, True), pytest.param(0.5, True, marks=pytest.mark.full(kind="slow")), (0.3, False), (0.5, False)]


@pytest.mark.parametrize("fraction, periodic", CASES)
def test_a_bed_has_no_overlap_and_the_fraction_it_says(bodies, periodic, fraction):
    bed = pack(bodies, fraction, SIZE, periodic, np.random.default_rng(1))
    spheres, ids = world(bodies, bed.positions, bed.quaternions)
    assert least_gap(spheres, ids, SIZE, periodic) >= 5e-4 * (1.0 - 1e-6)  # as promised, to rounding
    low, high = (spheres[:, :3] - spheres[:, 3:]).min(axis=0), (spheres[:, :3] + spheres[:, 3:]).max(axis=0)
    assert (low[2], high[2]) == pytest.approx((0.0, bed.height), rel=1e-12, abs=1e-12 * bed.height)
    if not periodic:
        assert (low[:2] > 0.0).all() and (high[:2] < SIZE).all()
    # the box of the fraction asked for, less the gaps at floor and top
    assert fraction <= bed.solid_fraction < fraction * 1.02
    points = np.random.default_rng(0).random((20_000, 3)) * (*SIZE, bed.height)
    near, _ = images(spheres, ids, SIZE, periodic)
    inside = np.zeros(len(points), bool)
    for x, y, z, r in near:
        inside |= ((points - (x, y, z)) ** 2).sum(axis=1) < r * r
    # counting 20 000 points scatters by sqrt(0.25/20 000) = 0.0035, four times that is allowed
    assert inside.mean() == pytest.approx(bed.solid_fraction, abs=0.014)


def test_beds_are_reproducible_and_one_that_jams_reports_how_far_it_came(bodies):
    first, same, other = (pack(bodies, 0.4, SIZE, True, np.random.default_rng(s)) for s in (1, 1, 2))
    assert np.array_equal(first.positions, same.positions) and np.array_equal(first.quaternions, same.quaternions)
    assert not np.array_equal(first.positions, other.positions)
    # Balls of one size, flat floor and top: random close packing ends at 0.64 (O'Hern et al. 2003), less beside a plate.
    balls = [clump([[0, 0, 0]], [0.5])] * 40
    with pytest.raises(InputError, match=r"jam: a solid fraction of about 0\.[45]\d* is reached, 0\.700 wanted") as caught:
        pack(balls, 0.7, (3.0, 3.0), True, np.random.default_rng(0))
    assert caught.value.faults[0].key == "solid_fraction"


def test_scattered_bodies_keep_clear_and_are_reproducible(bodies):
    some = bodies[:35]
    for periodic in (True, False):
        x, q = scatter(some, HEIGHT, WIDE, periodic, np.random.default_rng(3))
        spheres, ids = world(some, x, q)
        assert least_gap(spheres, ids, WIDE, periodic) >= 1e-3 * (1.0 - 1e-9)  # the clearance promised, to rounding
        low, high = spheres[:, :3] - spheres[:, 3:], spheres[:, :3] + spheres[:, 3:]
        for axis, most in enumerate((*WIDE, HEIGHT)):
            if axis == 2 or not periodic:
                assert low[:, axis].min() > 0.0 and high[:, axis].max() < most
        assert (x[:, :2] >= 0.0).all() and (x[:, :2] < WIDE).all()
        assert np.linalg.norm(q, axis=1) == pytest.approx(1.0, rel=1e-14)
    first, same, other = (scatter(some, HEIGHT, WIDE, True, np.random.default_rng(s)) for s in (1, 1, 2))
    assert np.array_equal(first[0], same[0]) and np.array_equal(first[1], same[1])
    assert not np.array_equal(first[0], other[0])
    # a ball that fills the middle of the volume stays free; without it some body would lie there: it takes a sixth of the volume
    standing = np.array([[30e-6, 25e-6, 35e-6, 20e-6]])
    for given, least, below in (((standing,), 1e-3 * (1.0 - 1e-9), np.inf), ((), -np.inf, 0.0)):
        spheres, ids = world(some, *scatter(some, HEIGHT, WIDE, True, np.random.default_rng(4), *given))
        assert least <= least_gap(np.vstack((spheres, standing)), np.append(ids, len(some)), WIDE, True) < below


def test_the_whole_volume_is_used_in_every_turn():
    # 400 small balls with a mark: means of uniform numbers scatter by sqrt(1/12/400) = 0.014, four times that is allowed.
    rod = [clump([[0.0, 0, 0], [0.01, 0, 0]], [0.01, 0.01])] * 400
    x, q = scatter(rod, 3.0, (2.0, 2.0), True, np.random.default_rng(0))
    assert (x / (2.0, 2.0, 3.0)).mean(axis=0) == pytest.approx(0.5, abs=0.06)
    axes = matrix_from_quaternion(q)[:, :, 0]
    # along each direction the mean square of a random unit vector is 1/3, its scatter sqrt(4/45/400) = 0.015
    assert (axes**2).mean(axis=0) == pytest.approx(1.0 / 3.0, abs=0.06)
    # Random addition of balls jams at 0.384 (Torquato, Uche and Stillinger 2006): 0.6 is out of reach.
    height = 30 * np.pi / 6.0 / 0.6 / 9.0
    with pytest.raises(InputError, match=r"\d+ of 30 bodies placed, solid fraction 0\.[1-4]\d* reached of 0\.600 wanted"):
        scatter([clump([[0, 0, 0]], [0.5])] * 30, height, (3.0, 3.0), True, np.random.default_rng(0))
    rod = clump([[0.0, 0, 0], [1.0, 0, 0], [2.0, 0, 0]], [0.6] * 3)
    with pytest.raises(InputError, match="own image"):
        scatter([rod], 10.0, (10.0, 3.0), True, np.random.default_rng(0))
    scatter([rod], 10.0, (10.0, 3.3), True, np.random.default_rng(0))


BALLS = '[[debris]]\nmaterial = "steel"\nkind = "spheres"\nradius = "3 um"\ncount = 30\n'
TWINS = BALLS.replace('radius = "3 um"', 'shape = [{radius = "2 um"}, {center = ["2 um", "0 um", "0 um"], radius = "1.5 um"}]')


def built(first, second, side="25 um"):
    scene = Scene.parse(scene_text(f"{BALLS}{first}\n{TWINS}{second}", f'["{side}", "{side}"]'))
    warnings: list[str] = []
    return populate(scene, warnings), warnings


def test_dense_populations_are_mixed_and_have_their_heights():
    placed, warnings = built('placement = "dense"\nsolid_fraction = 0.45', 'placement = "dense"')
    centres, radii, _ = spheres_of(placed.clumps, placed.positions, placed.quaternions)
    top = (centres[:, 2] + radii).max()
    assert sum(body.volume for body in placed.clumps) / (625e-12 * top) == pytest.approx(0.45, rel=0.02)  # as above
    assert 0.0 < (centres[:, 2] - radii).min() < 1e-8 * 3e-6  # just clear of the plate
    assert "solid fraction" in warnings[0] and "60 bodies fill 0.45" in warnings[0]
    heights = placed.positions[:, 2] / top
    # of 30 places over the bed the mean scatters by sqrt(1/12/30) = 0.05: two layers one over the other would be 0.5 apart
    assert abs(heights[:30].mean() - heights[30:].mean()) < 0.2
    placed, warnings = built('placement = "dense"\nheight = "18 um"', 'placement = "dense"\nheight = "18 um"')
    centres, radii, _ = spheres_of(placed.clumps, placed.positions, placed.quaternions)
    assert 0.97 * 18e-6 < (centres[:, 2] + radii).max() <= 18e-6
    for key, height in (("", None), ('\nheight = "60 um"', 60e-6), ("\nsolid_fraction = 0.1", None)):
        placed, warnings = built(f'placement = "dilute"{key}', 'placement = "dilute"')
        volume = sum(body.volume for body in placed.clumps)
        height = height or volume / 625e-12 / (0.1 if key else 0.05)
        # 60 bodies: the highest lies in the uppermost tenth but with a probability of 0.9^60 = 0.002
        assert 0.85 * height < placed.positions[:, 2].max() < height
        assert "dilute: 60 bodies fill" in warnings[0]
    # that nothing overlaps populate itself checks
    placed, _ = built('placement = "dilute"\nheight = "40 um"', 'placement = "layer"', side="35 um")
    assert placed.positions[:30, 2].max() > 20e-6 > placed.positions[30:, 2].max()


DENSE, DILUTE = 'placement = "dense"', 'placement = "dilute"'
FAULTS = [
    (DENSE, 'placement = "layer"', r'21:1: debris\[1\].placement: "layer" and the "dense" of debris\[0\]'),
    (DILUTE, DENSE, r'15:1: debris\[0\].placement: "dilute" and the "dense" of debris\[1\]'),
    ('height = "9 um"', "", r"15:1: debris\[0\].height: needs placement = 'dilute' or 'dense'"),
    ("", DENSE + '\nheight = "9 um"\nsolid_fraction = 0.3', r"debris\[1\].solid_fraction: give only one"),
    (DENSE + '\nheight = "30 um"', DENSE + "\nsolid_fraction = 0.3",
     r"23:1: debris\[1\].solid_fraction: all \"dense\" bodies share one volume; debris\[0\] gives a different height"),
    (DENSE + '\nheight = "4 um"', DENSE, r"14:1: debris\[0\].count: .* this height 1.36 times"),
    (DENSE + '\nheight = "6.2 um"', DENSE, r"16:1: debris\[0\].height: .* would fill 1.\d+ times"),
    (DILUTE + '\nheight = "9 um"', DILUTE, r"16:1: debris\[0\].height: no space for body"),
    # of the packing, at the key that asks for it
    (DENSE + "\nsolid_fraction = 0.6", DENSE, r"16:1: debris\[0\].solid_fraction: the bed would be", "60 um"),
    (DENSE, DENSE, r"15:1: debris\[0\].placement: the bed would be", "60 um"),
]  # fmt: skip


@each(FAULTS)
def test_faults_of_beds(row):
    first, second, message, *side = row
    with pytest.raises(InputError, match=message):
        built(first, second, *side)
