"""Irregular clumps: reproducible, connected, of the size and shape asked for; meshes that are no body or hard to follow."""

import math
import re
import tomllib
from dataclasses import replace
from statistics import NormalDist

import numpy as np
import pytest
import trimesh
from steel import scene_text
from thirdbody.bodies import mesh_to_clump
from thirdbody.bodies.clump import clump
from thirdbody.bodies.irregular_clumps import diameters, irregular, population
from thirdbody.bodies.mesh import checked_mesh, load_mesh
from thirdbody.bodies.mesh_to_clump import clump_from_mesh
from thirdbody.bodies.resting_poses import resting_poses, settle_all
from thirdbody.errors import InputError
from thirdbody.scene.model import Scene

SIZE = {"distribution": "lognormal", "median": 1e-5, "sigma": 0.2, "min": 5e-6, "max": 2e-5}


def test_a_population_follows_its_seed_and_copies_have_sizes_of_their_own():
    few = population(1, 0, 3, (4, 6), [1, 0.8, 0.6], **SIZE)
    for a, b in zip(few, population(1, 0, 5, (4, 6), [1, 0.8, 0.6], **SIZE), strict=False):
        assert np.array_equal(a.centers, b.centers) and np.array_equal(a.radii, b.radii)
    for seed, index in [(2, 0), (1, 1)]:
        assert not np.array_equal(population(seed, index, 1, (4, 6), [1, 0.8, 0.6], **SIZE)[0].radii, few[0].radii)
    different = population(1, 0, 4, (4, 6), [1, 0.8, 0.6], **SIZE)
    shared = population(1, 0, 40, (4, 6), [1, 0.8, 0.6], shapes=4, **SIZE)
    for a, b in zip(different, shared[:4], strict=True):
        assert np.array_equal(a.centers, b.centers) and b.shape is None
    assert {id(body.shape) for body in shared[4:]} == {id(body) for body in shared[:4]}
    assert len({body.diameter for body in shared}) == 40
    for body in shared[4:10]:
        again = clump(body.centers, body.radii)
        assert again.volume == pytest.approx(body.volume, rel=body.error + again.error)
        assert again.inertia == pytest.approx(body.inertia, rel=body.error + again.error)
    assert population(1, 0, 9, (4, 6), [1, 0.8, 0.6], shapes=4, **SIZE)[8].diameter == shared[8].diameter
    # the poses of a copy are computed from rounded centres: 1e-9 is far above rounding, far below the distance of two poses
    alone = [replace(body, shape=None) for body in shared]
    (q, height), (q_alone, height_alone) = (settle_all(bodies, np.random.default_rng(1)) for bodies in (shared, alone))
    assert q == pytest.approx(q_alone, abs=1e-9) and height == pytest.approx(height_alone, rel=1e-9)


def test_irregular_clumps_are_connected_and_their_aspect_shows():
    for seed, (n, aspect) in enumerate([(2, [1, 1, 1]), (4, [1, 0.8, 0.6]), (8, [1, 1, 0.2]), (12, [1, 0.5, 0.5])]):
        body = irregular(np.random.default_rng(seed), n, aspect, 1e-5)
        assert len(body.radii) == n and len(set(body.radii)) == n
        assert body.diameter == pytest.approx(1e-5, rel=1e-12)  # scaled to it: rounding of a cube root
        # Mass properties survive the scaling; clump() itself refuses parts that are not connected.
        again = clump(body.centers, body.radii)
        assert again.volume == pytest.approx(body.volume, rel=body.error + again.error)
        assert again.inertia == pytest.approx(body.inertia, rel=body.error + again.error)
        # None swallowed: each sphere alone adds volume.
        for i in range(n):
            gap = np.linalg.norm(body.centers - body.centers[i], axis=1) + body.radii[i] - body.radii
            assert (np.delete(gap, i) > 0.0).all()
    rng = np.random.default_rng(0)

    def mean_extent(aspect):
        spans = []
        for _ in range(10):
            body = irregular(rng, 8, aspect, 1.0)
            low, high = body.centers - body.radii[:, None], body.centers + body.radii[:, None]
            spans.append(np.sort(high.max(0) - low.min(0))[::-1])
        spans = np.mean(spans, axis=0)
        return spans / spans[0]

    # Principal axes and unequal spheres blur the envelope: 0.15 is about their spread, not a theory.
    assert mean_extent([1.0, 0.8, 0.6]) == pytest.approx([1.0, 0.8, 0.6], abs=0.15)
    # Eight spheres side by side reach about 3 by 3: no flatter than 1/3 can be asked of them.
    flake, rod = mean_extent([1.0, 1.0, 0.2]), mean_extent([1.0, 0.3, 0.3])
    assert flake[1] > 0.75 and flake[2] < 0.45 and rod[1] < 0.5 and rod[2] < 0.5


def test_cut_lognormal_normal_uniform_and_constant_have_the_moments_of_theory():
    count, sigma, low, high = 20_000, 0.5, 0.6, 1.8
    drawn = diameters([np.random.default_rng(1)] * count, "lognormal", median=1.0, sigma=sigma, min=low, max=high)
    phi = NormalDist().cdf
    a, b = math.log(low) / sigma, math.log(high) / sigma
    # moments of a truncated lognormal, P(k) = Phi(b - k s) - Phi(a - k s), E x^k = exp(k^2 s^2/2) P(k) / P(0)
    moment = [math.exp(k * k * sigma**2 / 2.0) * (phi(b - k * sigma) - phi(a - k * sigma)) / (phi(b) - phi(a)) for k in (1, 2)]
    spread = math.sqrt(moment[1] - moment[0] ** 2)
    assert drawn.mean() == pytest.approx(moment[0], abs=4.0 * spread / math.sqrt(count))  # four sigma
    assert drawn.std() == pytest.approx(spread, rel=0.03)  # four sigma of a standard deviation is 0.02
    # Cut, not clipped: nothing piles up at the limits.
    assert low < drawn.min() and drawn.max() < high and len(np.unique(drawn)) == count
    count = 20_000
    rngs = [np.random.default_rng(2)] * count
    normal = diameters(rngs, "normal", mean=10.0, sigma=2.0)
    assert normal.mean() == pytest.approx(10.0, abs=4.0 * 2.0 / math.sqrt(count))  # four sigma
    assert normal.std() == pytest.approx(2.0, rel=0.03)
    uniform = diameters(rngs, "uniform", min=2.0, max=5.0)
    assert 2.0 < uniform.min() and uniform.max() < 5.0
    assert uniform.mean() == pytest.approx(3.5, abs=12.0 / math.sqrt(12.0 * count))
    assert diameters(rngs[:3], "constant", value=2.0).tolist() == [2.0, 2.0, 2.0]
    # far tails keep their shape: Mills ratio of the normal tail: phi(8)/Q(8) - 8 = 0.1213 (Abramowitz and Stegun 26.2.12)
    high = diameters([np.random.default_rng(3)] * 4000, "normal", mean=10.0, sigma=1.0, min=18.0, max=30.0)
    assert high.mean() - 18.0 == pytest.approx(0.1213, rel=0.07) and high.min() >= 18.0  # four sigma of 4000


def test_impossible_clumps_and_sizes_are_refused():
    body = irregular(np.random.default_rng(0), 1, [1, 0.5, 0.5], 2.0)
    assert body.radii.tolist() == [1.0] and body.error == 0.0  # one sphere is a sphere
    with pytest.raises(InputError, match="nothing between"):
        diameters([np.random.default_rng(0)], "normal", mean=1.0, sigma=0.01, min=8.0, max=9.0)
    # the scene refuses the others
    sound = {"kind": "irregular", "material": "steel", "count": 1, "size": 1e-5, "spheres": 4, "aspect": [1, 1, 1]}
    for key, value, word in (
        ("spheres", 0, "spheres"), ("spheres", [5, 4], "spheres"), ("aspect", [1, 0, 1], "aspect"), ("aspect", [1, 1], "aspect"),
        ("size", -1e-5, "size"), ("size", {"distribution": "lognormal", "median": 1.0}, "sigma"),
        ("size", {"distribution": "uniform", "min": 2.0, "max": 1.0}, "min"),
        ("size", {"distribution": "constant", "value": -1.0}, "value"), ("size", {"distribution": "log"}, "distribution"),
        ("angularity", -0.1, "angularity"), ("angularity", 1.1, "angularity"), ("angularity", math.nan, "angularity"),
        ("asperities", {"count": 3}, "radius"), ("asperities", {"count": 0, "radius": "0.1 um"}, "count"),
        ("asperities", {"radius": 0.6}, "radius"),
    ):  # fmt: skip
        with pytest.raises(InputError) as caught:
            Scene.of(tomllib.loads(scene_text("", '["50 um", "50 um"]')) | {"debris": [sound | {key: value}]})
        assert word in str(caught.value) and key in caught.value.faults[0].key


def test_bodies_made_together_are_each_as_one_alone():
    size, angularity, aspect = {"distribution": "lognormal", "median": 1e-5, "sigma": 0.2}, 0.8, (1.0, 0.8, 0.6)
    for k, body in enumerate(population(3, 2, 20, (1, 7), aspect, angularity, **size)):
        rng = np.random.default_rng(np.random.SeedSequence(3, spawn_key=(2, k)))
        n, d = int(rng.integers(1, 8)), float(diameters([rng], **size)[0])
        alone = irregular(rng, n, aspect, d, angularity)
        assert len(body.radii) == n
        # the same numbers in the same order; products of matrices may be summed in another
        assert body.volume == pytest.approx(alone.volume, rel=1e-13)
        assert body.centers == pytest.approx(alone.centers, abs=1e-12 * d)
        assert body.radii == pytest.approx(alone.radii, rel=1e-13)


def ball_with(change):
    """A ball of radius 5 whose vertices have other heights."""
    ball = trimesh.creation.icosphere(subdivisions=2, radius=5.0)
    ball.vertices[:, 2] = change(ball.vertices[:, 2])
    return ball


def curled(turns):
    """A strip of 20 by 6 by 0.5 bent about the axis y, by so many turns."""
    strip = trimesh.creation.box((20.0, 6.0, 0.5)).subdivide_to_size(0.7)
    angle, radius = 2.0 * math.pi * turns * strip.vertices[:, 0] / 20.0, 3.0 + strip.vertices[:, 2]
    strip.vertices = np.column_stack((radius * np.sin(angle), strip.vertices[:, 1], radius * np.cos(angle)))
    return strip


def pair(shift):
    solid = trimesh.creation.box((2.0, 2.0, 2.0))
    return trimesh.util.concatenate([solid, solid.copy().apply_translation(shift)])


def bowl():
    """Half of a hollow ball of radius 5, 0.5 thick."""
    angle = np.linspace(0.0, 0.5 * math.pi, 14)
    arc = np.column_stack((np.sin(angle), -np.cos(angle)))
    return trimesh.creation.revolve(np.vstack((5.0 * arc, 4.5 * arc[::-1])), sections=32)


SHELL = trimesh.util.concatenate([trimesh.creation.icosphere(2, 5.0), trimesh.creation.icosphere(2, 4.0)])
IMPOSSIBLE = {
    "spike": (ball_with(lambda z: np.where(z == z.max(), -30.0, z)), "cuts through itself.*between triangles"),
    "cap": (ball_with(lambda z: np.where(z > 3.5, z - 9.5, z)), "cuts through itself"),
    "overlapping ring": (curled(1.15), "cuts through itself"),
    "joined at a vertex": (pair((2.0, 2.0, 2.0)), "2 separate surfaces"),
    "joined at an edge": (pair((2.0, 2.0, 0.0)), "part bodies that share an edge"), "hollow": (SHELL, "fill cavities"),
}  # fmt: skip


@pytest.mark.parametrize("shift", [0.0, 300.0])  # single precision there: steps of 3e-5, 1.5 % of the leaf's thickness
def test_what_cuts_through_itself_or_is_two_bodies_is_refused_and_thin_bodies_are_not(tmp_path, shift):
    for name, (solid, message) in IMPOSSIBLE.items():
        solid.copy().apply_translation([shift] * 3).export(tmp_path / "bad.stl")
        with pytest.raises(InputError, match=message):
            load_mesh(tmp_path / "bad.stl", 1e-6)
        assert name
    for name, solid in {
        "open ring": curled(0.9), "bowl": bowl(), "flake": trimesh.creation.cylinder(15.0, 1.0, sections=64),
        "leaf": trimesh.creation.cylinder(5.0, 2e-3), "needle": trimesh.creation.box((1.0, 1.0, 60.0)),
        "dent": ball_with(lambda z: np.where(z == z.max(), -4.0, z)),
    }.items():  # fmt: skip
        solid.copy().apply_translation([shift] * 3).export(tmp_path / f"{name}.stl")
        assert load_mesh(tmp_path / f"{name}.stl", 1e-3).name.endswith(f"{name}.stl")


def test_small_spheres_along_a_flake_touch_both_faces(monkeypatch):
    """The thickness is exact, the outline near, the mass the mesh's; too few spheres are refused with the number that fits."""
    monkeypatch.setattr(mesh_to_clump, "_ALL_OVER", 4000)
    flake = trimesh.creation.box((12.0, 10.0, 1.0))
    mesh = checked_mesh(flake.vertices, flake.faces, "flake")
    with pytest.raises(InputError, match=r"60 spheres miss this shape: they do not connect; (\d+) fit") as caught:
        clump_from_mesh(mesh, 60)
    number = int(re.search(r"(\d+) fit", str(caught.value))[1])
    body, fit = clump_from_mesh(mesh, number + 20)
    assert 100 < number < 200 and len(body.radii) == number + 20
    assert body.volume == pytest.approx(120.0, rel=1e-12) and 0.5 < fit.volume_ratio < 0.9 and fit.rms < 0.1
    assert fit.extents == pytest.approx([1.0, 1.0, 1.0], abs=0.05)  # half a sphere of 1 at the rim of 10
    assert fit.extents[2] == pytest.approx(1.0, abs=0.01)  # balls stop within a hundredth of the middle
    assert resting_poses(body)[1].max() == pytest.approx(0.5, abs=0.02)  # it lies


@pytest.mark.full(kind="slow")
def test_a_flake_of_aspect_thirty_works_by_default_and_a_leaf_is_refused():
    flake = trimesh.creation.box((10.0, 8.0, 0.3))
    mesh, leaf = (checked_mesh(flake.vertices * (1.0, 1.0, thin), flake.faces, "flake") for thin in (1.0, 0.03))
    body, fit = clump_from_mesh(mesh, None)
    assert 1000 < len(body.radii) <= 1500 and fit.rms < 0.06 and fit.extents == pytest.approx([1.0, 1.0, 1.0], abs=0.02)
    with pytest.raises(InputError, match="40 spheres miss this shape: they have .* allowed: 0.5 to 1.5 times.* fit"):
        clump_from_mesh(mesh, 40)
    with pytest.raises(InputError, match=r"would be some 1.5e\+06, at most 1500 make a body.*larger thickness"):
        clump_from_mesh(leaf, None)
