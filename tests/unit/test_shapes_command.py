"""`thirdbody shapes`: what it tells about the bodies of a scene and about a mesh, and the picture."""

import json
from functools import partial

import numpy as np
import pytest
import trimesh
from PIL import Image
from steel import scene_text

from thirdbody.assembly.populate import shapes_of
from thirdbody.errors import OutputError
from thirdbody.scene.model import Scene

DEBRIS = """\
[[debris]]
material = "steel"
kind = "irregular"
count = 15
size = "10 um"
spheres = [5, 7]
aspect = [1.0, 0.8, 0.6]
angularity = 0.5
asperities = {count = 2, radius = "0.5 um"}
[[debris]]
material = "steel"
kind = "spheres"
radius = "4 um"
count = 3
[[debris]]
material = "steel"
kind = "mesh"
file = "rock.stl"
unit = "1 um"
spheres = 6
count = 2
"""


@pytest.fixture
def rock(tmp_path):
    mesh = trimesh.creation.icosphere(subdivisions=3, radius=5.0)
    mesh.apply_scale([1.0, 0.8, 0.6])
    mesh.export(tmp_path / "rock.stl")
    return mesh


@pytest.fixture
def call(command):
    return partial(command, "shapes")


@pytest.fixture
def scene(tmp_path, rock):
    path = tmp_path / "scene.toml"
    path.write_text(scene_text(DEBRIS, '["150 um", "150 um"]'), encoding="utf-8")
    return path


def test_a_mesh_is_reported_by_its_own_volume_and_inertia(call, rock):
    code, out, _ = call("rock.stl", "--unit", "1 um", "--spheres", 8, "--json")
    (entry,) = json.loads(out)["populations"]
    fit = entry["fit"]
    # STL holds single precision
    assert code == 0 and entry["volume"]["mean"] == pytest.approx(rock.volume * 1e-18, rel=1e-6, abs=0.0)
    assert fit["mesh_volume"] == pytest.approx(rock.volume * 1e-18, rel=1e-6, abs=0.0)
    moments = np.sort(np.linalg.eigvalsh(rock.moment_inertia)) * 1e-30
    assert [moment["mean"] for moment in entry["inertia"]] == pytest.approx(moments, rel=1e-5, abs=0.0)
    assert entry["count"] == 1 and entry["spheres"]["max"] == 8
    assert 0.0 < fit["rms"] < fit["maximum"] < 0.3
    assert fit["radius"] == pytest.approx(0.5 * entry["diameter"]["mean"], rel=1e-9, abs=0.0)  # R of the same volume
    assert 0.0 < fit["contact_radius_ratio"]["min"] <= fit["contact_radius_ratio"]["median"] < 1.0


def test_every_population_of_a_scene_is_reported(call, scene):
    code, out, _ = call(scene, "--json")
    rough, balls, rocks = json.loads(out)["populations"]
    found = [(entry["kind"], entry["count"]) for entry in (rough, balls, rocks)]
    assert code == 0 and found == [("irregular", 15), ("spheres", 3), ("mesh", 2)]
    assert rough["diameter"]["mean"] == pytest.approx(1e-5, rel=1e-12, abs=0.0)  # scaled to it
    assert rough["sphere_radius"]["min"] == pytest.approx(5e-7, rel=1e-12, abs=0.0)  # the asperities
    bodies = shapes_of(Scene.load(scene), 0, [])
    assert rough["spheres"]["mean"] == pytest.approx(np.mean([len(body.radii) for body in bodies]))
    mass = 7850.0 * 4.0 / 3.0 * np.pi * 4e-6**3
    # closed forms of the ball, to rounding
    assert [balls["mass"][key] for key in ("mean", "min", "median", "max")] == pytest.approx([mass] * 4, rel=1e-12, abs=0.0)
    assert balls["mass"]["std"] == 0.0
    assert balls["inertia"][2]["mean"] == pytest.approx(0.4 * mass * 4e-6**2, rel=1e-12, abs=0.0)
    assert balls["sharpness"]["mean"] == pytest.approx(1.0, rel=1e-12) and rough["sharpness"]["max"] < 0.7
    assert "fit" in rocks and "fit" not in rough


def test_a_folder_of_meshes_is_reported_mesh_by_mesh(call, scene, tmp_path, rock):
    (tmp_path / "scans").mkdir()
    for name, height in (("a.stl", 1.0), ("b.stl", 0.5)):
        mesh = rock.copy()
        mesh.apply_scale([1.0, 1.0, height])
        mesh.export(tmp_path / "scans" / name)
    code, out, _ = call("scans", "--unit", "1 um", "--spheres", 6, "--json")
    alone = json.loads(out)["populations"]
    assert code == 0 and [entry["name"] for entry in alone] == ["a.stl", "b.stl"]
    code, out, _ = call(scene, "--set", "debris.2.file=scans", "--set", "debris.0.count=1", "--json")
    both = json.loads(out)["populations"][2]
    assert code == 0 and both["count"] == 2 and "fit" not in both
    assert [fit["rms"] for fit in both["fits"]] == pytest.approx([entry["fit"]["rms"] for entry in alone], rel=1e-6)
    (tmp_path / "empty").mkdir()
    code, _, err = call("empty", "--unit", "1 um")
    assert code == 3 and "no mesh file" in err


@pytest.mark.full(kind="slow")
def test_tables_and_a_picture_of_the_bodies_are_made(call, scene, tmp_path):
    code, out, err = call(scene, "--set", "debris.0.count=3", "-o", "shapes.png")
    assert code == 0 and not err and out.rstrip().endswith("shapes.png")
    code, out, err = call(scene, "--set", "debris.0.count=3")
    assert code == 0 and not err
    for words in ("debris[0]: 3 bodies, irregular of steel", "debris[2]: 2 bodies, mesh", "fit to the mesh", "% of R (rms)"):
        assert words in out
    with Image.open(tmp_path / "shapes.png") as picture:
        pixels = np.asarray(picture.convert("RGB"), int)
    height, width, _ = pixels.shape
    assert width == 1600 and height > 900
    # bodies are coloured, words and paper are grey: rows of bodies, one ball and three views fill some of the picture
    coloured = np.ptp(pixels, axis=2) > 40
    assert 0.03 < coloured.mean() < 0.6
    assert (pixels == 255).all(axis=2)[:, :20].all(), "nothing is cut at the edge"


WRONG = [
    (["rock.stl"], 2, "--unit"),
    (["scene.toml", "--unit", "1 um", "--seed", "2"], 2, "--unit, --seed"),
    (["rock.stl", "--unit", "1 um", "--spheres", "3"], 3, "spheres"),
    (["absent.toml"], 3, "absent.toml"),
    (["rock.step"], 3, "neither a scene"),
    (["scene.toml", "--set", "debris.0.asperities.radius=4 um"], 3, "asperities.radius"),
    (["rock.stl", "--unit", "1 um", "-o", "a.jpg"], 3, ".png"),
    (["rock.stl", "--unit", "1 um", "-o", "absent/a.png"], OutputError.exit_code, "does not exist"),
]


def test_what_cannot_be_ends_with_its_code(call, scene):
    for arguments, code, words in WRONG:
        found, _, err = call(*arguments)
        assert found == code and words in err, (arguments, err)
