"""Debris from a mesh file, from the scene to bodies in their places."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from steel import STEEL

from thirdbody.bodies.fit import clump_from_mesh
from thirdbody.bodies.mesh import Mesh, load_mesh
from thirdbody.errors import InputError
from thirdbody.kernels import layout as at
from thirdbody.laws.registry import discover
from thirdbody.scene.build import build
from thirdbody.scene.model import Scene

TEXT = STEEL + """\
[[debris]]
material = "steel"
kind = "mesh"
file = "rock.stl"
unit = "1 um"
spheres = 8
count = 5
{more}
[domain]
size = ["150 um", "150 um"]
[plates.lower]
material = "steel"
[solver]
duration = "1 us"
[output]
every = "1 us"
"""


@pytest.fixture
def rock(tmp_path):
    mesh = trimesh.creation.icosphere(subdivisions=3, radius=5.0)
    mesh.apply_scale([1.0, 0.8, 0.6])
    mesh.export(tmp_path / "rock.stl")
    return mesh


def made(tmp_path, more: str = ""):
    path = tmp_path / "scene.toml"
    path.write_text(TEXT.format(more=more))
    return build(Scene.load(path), discover())


def test_bodies_weigh_what_the_mesh_weighs(tmp_path, rock):
    built = made(tmp_path)
    volume = rock.volume * 1e-18
    # STL holds single precision
    assert built.state.B[:, at.B_MASS] == pytest.approx(7850.0 * volume, rel=1e-6, abs=0.0)
    moments = np.sort(np.linalg.eigvalsh(rock.moment_inertia)) * 1e-30 * 7850.0
    assert built.state.E[0, at.E_I : at.E_I + 3] == pytest.approx(moments, rel=1e-5, abs=0.0)
    assert built.state.n_spheres == 40
    assert any("8 spheres follow the mesh to" in warning for warning in built.warnings)


def test_sizes_rescale_each_body(tmp_path, rock):
    built = made(tmp_path, 'size = {distribution = "uniform", min = "6 um", max = "12 um"}')
    diameter = np.cbrt(6.0 * built.state.B[:, at.B_MASS] / 7850.0 / np.pi)
    assert np.all((diameter >= 6e-6) & (diameter <= 12e-6))
    assert len(np.unique(diameter)) == 5


@pytest.mark.parametrize("damage", ["missing", "cut", "open"])
def test_a_bad_file_is_told_at_its_key(tmp_path, rock, damage):
    path = tmp_path / "rock.stl"
    if damage == "missing":
        path.unlink()
    elif damage == "cut":
        path.write_bytes(path.read_bytes()[:1000])
    else:
        rock.update_faces(np.arange(len(rock.faces)) > 3)
        rock.export(path)
    with pytest.raises(InputError, match=r"scene.toml:13:1: debris\[0\].file: .*rock.stl") as caught:
        made(tmp_path)
    assert len(caught.value.faults) == 1


def test_populations_that_share_a_mesh_share_its_fit(tmp_path, rock):
    mesh = load_mesh(tmp_path / "rock.stl", 1e-6)
    again = load_mesh(tmp_path / "rock.stl", 1e-6)
    one, other = clump_from_mesh(mesh, 8, 3), clump_from_mesh(again, 8, 3)
    assert one[0] is other[0] and one[1] is other[1]
    moved = Mesh(mesh.vertices * 1.5, mesh.faces, mesh.name)
    for asked, factor in (((mesh, 8, 4), 1.0), ((mesh, 9, 3), 1.0), ((moved, 8, 3), 1.5)):
        found = clump_from_mesh(*asked)
        assert found[0] is not one[0] and found[0].volume == pytest.approx(factor**3 * one[0].volume, rel=1e-9)
