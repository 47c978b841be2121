"""Meshes that are no body or hard to follow: cut through themselves, joined, folded; flakes, needles, shells."""

import math
import re

import numpy as np
import pytest
import trimesh

from thirdbody.bodies import mesh_to_clump
from thirdbody.bodies.mesh import checked_mesh, load_mesh
from thirdbody.bodies.mesh_to_clump import clump_from_mesh
from thirdbody.bodies.resting_poses import resting_poses
from thirdbody.errors import InputError


def ball_with(change):
    ball = trimesh.creation.icosphere(subdivisions=2, radius=5.0)
    change(ball.vertices)
    return ball


def to_spike(x):
    x[x[:, 2].argmax(), 2] = -30.0


def to_cap(x):
    x[x[:, 2] > 3.5, 2] -= 9.5


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
    "spike": (ball_with(to_spike), "cuts through itself.*between triangles"), "cap": (ball_with(to_cap), "cuts through itself"),
    "overlapping ring": (curled(1.15), "cuts through itself"),
    "joined at a vertex": (pair((2.0, 2.0, 2.0)), "2 separate surfaces"),
    "joined at an edge": (pair((2.0, 2.0, 0.0)), "part bodies that share an edge"), "hollow": (SHELL, "fill cavities"),
}  # fmt: skip
THIN = {
    "open ring": curled(0.9), "bowl": bowl(), "flake": trimesh.creation.cylinder(15.0, 1.0, sections=64),
    "leaf": trimesh.creation.cylinder(5.0, 2e-3), "needle": trimesh.creation.box((1.0, 1.0, 60.0)),
    "dent": ball_with(lambda x: x.__setitem__((x[:, 2].argmax(), 2), -4.0)),
}  # fmt: skip


@pytest.mark.parametrize("shift", [0.0, 300.0])  # single precision there: steps of 3e-5, 1.5 % of the leaf's thickness
def test_what_cuts_through_itself_or_is_two_bodies_is_refused_and_thin_bodies_are_not(tmp_path, shift):
    for name, (solid, message) in IMPOSSIBLE.items():
        solid.copy().apply_translation([shift] * 3).export(tmp_path / "bad.stl")
        with pytest.raises(InputError, match=message):
            load_mesh(tmp_path / "bad.stl", 1e-6)
        assert name
    for name, solid in THIN.items():
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
