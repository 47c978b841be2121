"""Debris from mesh files, from the scene to bodies in their places."""

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

from .test_mesh import coarse  # noqa: F401 - a fixture

pytestmark = pytest.mark.usefixtures("coarse")

DEBRIS = '[[debris]]\nmaterial = "steel"\nkind = "mesh"\nfile = FILE\nunit = "1 um"\nspheres = 4\ncount = COUNT\n'
REST = """[domain]\nsize = ["150 um", "150 um"]\n[plates.lower]\nmaterial = "steel"\n[solver]\nduration = "1 us"
[output]\nevery = "1 us"\n"""
SIZE = 'size = {distribution = "uniform", min = "6 um", max = "12 um"}\n'


@pytest.fixture
def rock(tmp_path):
    mesh = trimesh.creation.icosphere(subdivisions=3, radius=5.0)
    mesh.apply_scale([1.0, 0.8, 0.6])
    mesh.export(tmp_path / "rock.stl")
    return mesh


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


def scene_of(tmp_path, file='"rock.stl"', more="", count=7):
    path = tmp_path / "scene.toml"
    path.write_text(STEEL + DEBRIS.replace("FILE", file).replace("COUNT", str(count)) + more + REST)
    return Scene.load(path)


def volumes_of(scene, warnings=None):
    return [body.volume for body in shapes_of(scene, 0, [] if warnings is None else warnings)]


def test_bodies_weigh_what_the_mesh_weighs(tmp_path, rock):
    built = build(scene_of(tmp_path, count=5), discover())
    # STL holds single precision
    assert built.state.bodies.mass == pytest.approx(7850.0 * rock.volume * 1e-18, rel=1e-6, abs=0.0)
    moments = np.sort(np.linalg.eigvalsh(rock.moment_inertia)) * 1e-30 * 7850.0
    assert built.state.bodies.inertia[0] == pytest.approx(moments, rel=1e-5, abs=0.0)
    assert built.state.n_spheres == 20
    assert any("4 spheres follow the mesh to" in warning for warning in built.warnings)


def test_sizes_rescale_each_body_whichever_mesh_it_has(tmp_path, rock):
    built = build(scene_of(tmp_path, more=SIZE, count=5), discover())
    diameter = np.cbrt(6.0 * built.state.bodies.mass / 7850.0 / np.pi)
    assert np.all((diameter >= 6e-6) & (diameter <= 12e-6)) and len(np.unique(diameter)) == 5
    rocks(tmp_path / "scans", "a.stl", "b.stl")
    one, two = (shapes_of(scene_of(tmp_path, file, SIZE), 0, []) for file in ('"rock.stl"', '"scans"'))
    assert [body.diameter for body in two] == pytest.approx([body.diameter for body in one], rel=1e-12)


def test_populations_that_share_a_mesh_share_its_fit(tmp_path, rock):
    mesh, again = (load_mesh(tmp_path / "rock.stl", 1e-6) for _ in range(2))
    one, other = clump_from_mesh(mesh, 4, 3), clump_from_mesh(again, 4, 3)
    assert one[0] is other[0] and one[1] is other[1]
    moved = Mesh(mesh.vertices * 1.5, mesh.faces, mesh.name)
    for requested, factor in (((mesh, 4, 4), 1.0), ((mesh, 5, 3), 1.0), ((moved, 4, 3), 1.5)):
        found = clump_from_mesh(*requested)
        assert found[0] is not one[0] and found[0].volume == pytest.approx(factor**3 * one[0].volume, rel=1e-9)


def test_bodies_take_several_meshes_in_turn_as_the_scene_that_is_saved(tmp_path):
    b, a, c = rocks(tmp_path / "scans", "b.stl", "a.ply", "c.STL")
    (tmp_path / "scans" / "notes.txt").write_text("no mesh")
    (tmp_path / "scans" / "._a.ply").write_bytes(b"what a file manager leaves behind")
    # of a folder in the order of names
    for file, order in (('["scans/b.stl", "scans/a.ply", "scans/c.STL"]', [b, a, c]), ('"scans"', [a, b, c])):
        warnings = []
        # STL holds single precision
        assert volumes_of(scene_of(tmp_path, file), warnings) == pytest.approx(1e-18 * np.resize(order, 7), rel=1e-6, abs=0.0)
        assert len(warnings) == 1 and "3 meshes in turn" in warnings[0]
    warnings = []
    volumes_of(scene_of(tmp_path, '"scans"', count=2), warnings)
    assert "debris[0]: 2 bodies of 3 meshes: the last ones are not used" in warnings
    scene = scene_of(tmp_path, '["a.stl", "b.stl"]')  # saved as it was
    scene.save(tmp_path / "again.toml")
    again = Scene.load(tmp_path / "again.toml")
    assert again.debris[0].file == ["a.stl", "b.stl"] and again.document() == scene.document()


def test_a_study_finds_the_meshes_from_its_own_folder(tmp_path):
    rocks(tmp_path / "scans", "a.stl", "b.stl")
    for name, file in (("list", '["scans/b.stl", "scans/a.stl"]'), ("folder", '"scans"')):
        scene = scene_of(tmp_path, file)
        save(scene, tmp_path / name)
        assert volumes_of(scene) == volumes_of(Scene.load(tmp_path / name / "scene.toml"))


def test_every_bad_mesh_is_reported_at_its_place(tmp_path):
    rocks(tmp_path, "a.stl")
    (tmp_path / "empty").mkdir()
    for file, keys, words in (
        ('["a.stl", "absent.stl", "b.obj"]', ["file[1]", "file[2]"], "no such file"),
        ('"empty"', ["file"], "holds no mesh file"),
        ("[]", ["file"], "a file, a folder or a list of files"),
        ('["a.stl", 3]', ["file"], "a file, a folder or a list of files"),
    ):
        with pytest.raises(InputError, match=words) as caught:
            shapes_of(scene_of(tmp_path, file), 0, [])
        assert [fault.key for fault in caught.value.faults] == [f"debris[0].{key}" for key in keys]
