"""Debris from a mesh file, from the scene to bodies in their places."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from steel import STEEL

from thirdbody.assembly.clumps import shapes_of
from thirdbody.assembly.simulation import build
from thirdbody.bodies.mesh import Mesh, load_mesh
from thirdbody.bodies.mesh_to_clump import clump_from_mesh
from thirdbody.errors import InputError
from thirdbody.laws.registry import discover
from thirdbody.scene.model import Scene
from thirdbody.studies.study_setup import save

TEXT = (
    STEEL
    + """\
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
)


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
    assert built.state.bodies.mass == pytest.approx(7850.0 * volume, rel=1e-6, abs=0.0)
    moments = np.sort(np.linalg.eigvalsh(rock.moment_inertia)) * 1e-30 * 7850.0
    assert built.state.bodies.inertia[0] == pytest.approx(moments, rel=1e-5, abs=0.0)
    assert built.state.n_spheres == 40
    assert any("8 spheres follow the mesh to" in warning for warning in built.warnings)


def test_sizes_rescale_each_body(tmp_path, rock):
    built = made(tmp_path, 'size = {distribution = "uniform", min = "6 um", max = "12 um"}')
    diameter = np.cbrt(6.0 * built.state.bodies.mass / 7850.0 / np.pi)
    assert np.all((diameter >= 6e-6) & (diameter <= 12e-6))
    assert len(np.unique(diameter)) == 5


@pytest.mark.parametrize("damage", ["missing", "cut", "open"])
def test_a_bad_file_is_reported_at_its_key(tmp_path, rock, damage):
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
    for requested, factor in (((mesh, 8, 4), 1.0), ((mesh, 9, 3), 1.0), ((moved, 8, 3), 1.5)):
        found = clump_from_mesh(*requested)
        assert found[0] is not one[0] and found[0].volume == pytest.approx(factor**3 * one[0].volume, rel=1e-9)


def rocks(folder, *names):
    """Mesh files of different shapes, each flatter than the one before; their volumes in units of the files."""
    folder.mkdir(exist_ok=True)
    volumes = []
    for k, name in enumerate(names):
        mesh = trimesh.creation.icosphere(subdivisions=2, radius=5.0)
        mesh.apply_scale([1.0, 0.9 - 0.1 * k, 0.8 - 0.2 * k])
        mesh.export(folder / name)
        volumes.append(float(mesh.volume))
    return np.array(volumes)


def several(tmp_path, file: str, more: str = ""):
    path = tmp_path / "scene.toml"
    path.write_text(TEXT.format(more=more).replace('"rock.stl"', file).replace("count = 5", "count = 7"))
    return Scene.load(path)


@pytest.mark.parametrize("file", ['["scans/b.stl", "scans/a.ply", "scans/c.STL"]', '"scans"'])
def test_bodies_take_several_meshes_in_turn(tmp_path, file):
    b, a, c = rocks(tmp_path / "scans", "b.stl", "a.ply", "c.STL")
    (tmp_path / "scans" / "notes.txt").write_text("no mesh")
    (tmp_path / "scans" / "._a.ply").write_bytes(b"what a file manager leaves behind")
    warnings: list[str] = []
    bodies = shapes_of(several(tmp_path, file), 0, warnings)
    order = [b, a, c] if file.startswith("[") else [a, b, c]  # of a folder in the order of names
    # STL holds single precision
    assert [body.volume for body in bodies] == pytest.approx(1e-18 * np.resize(order, 7), rel=1e-6, abs=0.0)
    assert len(warnings) == 1 and "3 meshes in turn" in warnings[0]


def test_several_meshes_share_sizes_with_one(tmp_path, rock):
    """Which mesh a body has changes nothing of the size that is drawn for it."""
    rocks(tmp_path / "scans", "a.stl", "b.stl")
    size = 'size = {distribution = "uniform", min = "6 um", max = "12 um"}'
    one, two = (shapes_of(several(tmp_path, file, size), 0, []) for file in ('"rock.stl"', '"scans"'))
    assert [body.diameter for body in two] == pytest.approx([body.diameter for body in one], rel=1e-12)


def test_meshes_beyond_the_last_body_are_reported(tmp_path):
    names = [f"{k}.stl" for k in range(8)]
    rocks(tmp_path / "scans", *names[:3])
    for name in names[3:]:
        (tmp_path / "scans" / name).write_bytes((tmp_path / "scans" / "0.stl").read_bytes())
    warnings: list[str] = []
    shapes_of(several(tmp_path, '"scans"'), 0, warnings)
    assert "debris[0]: 7 bodies of 8 meshes: the last ones are not used" in warnings


def test_a_scene_of_several_meshes_is_saved_as_it_was(tmp_path):
    scene = several(tmp_path, '["a.stl", "b.stl"]')
    scene.save(tmp_path / "again.toml")
    again = Scene.load(tmp_path / "again.toml")
    assert again.debris[0].file == ["a.stl", "b.stl"] and again.document() == scene.document()


@pytest.mark.parametrize("file", ['["scans/b.stl", "scans/a.stl"]', '"scans"'])
def test_a_study_finds_the_meshes_from_its_own_folder(tmp_path, file):
    rocks(tmp_path / "scans", "a.stl", "b.stl")
    scene = several(tmp_path, file)
    save(scene, tmp_path / "study")
    elsewhere = Scene.load(tmp_path / "study" / "scene.toml")
    volumes = [[body.volume for body in shapes_of(one, 0, [])] for one in (scene, elsewhere)]
    assert volumes[0] == volumes[1]


@pytest.mark.parametrize(
    "file, key, words",
    [
        ('["a.stl", "absent.stl", "b.obj"]', ["file[1]", "file[2]"], "no such file"),
        ('"empty"', ["file"], "holds no mesh file"),
        ("[]", ["file"], "a file, a folder or a list of files"),
        ('["a.stl", 3]', ["file"], "a file, a folder or a list of files"),
    ],
)
def test_every_bad_mesh_is_reported_at_its_place(tmp_path, file, key, words):
    rocks(tmp_path, "a.stl")
    (tmp_path / "empty").mkdir()
    with pytest.raises(InputError, match=words) as caught:
        shapes_of(several(tmp_path, file), 0, [])
    assert [fault.key for fault in caught.value.faults] == [f"debris[0].{k}" for k in key]
