"""Debris of the kind `spheroid` against the ellipsoid's closed forms; `thirdbody shapes`."""

import json
import math
from functools import partial

import numpy as np
import pytest
from each import each
from PIL import Image
from scipy.integrate import quad
from steel import scene_text
from thirdbody.assembly.populate import populate, shapes_of
from thirdbody.bodies.clump import clump
from thirdbody.bodies.resting_poses import resting_poses
from thirdbody.debris.spheroid import Spheroid, corrugation, layout, spheres_in_rings
from thirdbody.errors import InputError, OutputError
from thirdbody.rotations import matrix_from_quaternion
from thirdbody.scene.model import Scene

DEBRIS = '[[debris]]\nmaterial = "steel"\nkind = "spheroid"\ncount = {count}\nsize = {size}\n{more}'
SCENE = scene_text(DEBRIS, '["200 um", "150 um"]')
SLOW = pytest.mark.full(kind="slow")


def parsed(more: str, size: str = '"10 um"', count: int = 12) -> Scene:
    return Scene.parse(SCENE.format(more=more, size=size, count=count), "s.toml")


def errors(form: str, r: float, n: int) -> np.ndarray:
    """Of volume and principal moments, rising; of the spheroid at unit density the longer semi-axis is 1."""
    across, along = (r, 1.0) if form == "prolate" else (1.0, r)
    volume = 4.0 / 3.0 * math.pi * across**2 * along
    inertia = np.sort([2.0 * across**2, across**2 + along**2, across**2 + along**2]) * volume / 5.0
    body = clump(*layout(form, r, n)[:2])
    return np.abs(np.append(body.volume / volume, body.inertia / inertia) - 1.0)


def slopes(sizes, values) -> np.ndarray:
    return -np.diff(np.log(values), axis=0) / np.diff(np.log(sizes))[:, None]


@pytest.mark.parametrize("r", [0.6, pytest.param(0.35, marks=SLOW), pytest.param(0.9, marks=SLOW)])
def test_moments_of_bodies_converge_with_the_square_of_the_number(r):
    numbers = np.array([21, 41, 81])
    found = np.array([errors("prolate", r, n) for n in numbers])
    # gaps between spheres h apart are of the order h^2; 0.05: the next order, at 20 steps
    assert slopes(numbers - 1.0, found) == pytest.approx(2.0, abs=0.05)
    assert found[-1].max() < 1.2e-3
    if r > 0.5:
        rings = np.array([3.0, 4.0, 5.0])
        found = np.array([errors("oblate", r, spheres_in_rings(int(k))) for k in rings])
        # of three to five rings the outermost, where the spheres are smallest, is a large part: the order is still rising to 2
        assert np.all((slopes(rings, found) > 1.8) & (slopes(rings, found) < 2.1))
        assert found[-1].max() < 0.03


def test_principal_axes_and_the_surface_are_those_of_the_spheroid():
    for form in ("prolate", "oblate"):
        keys = {"material": "steel", "count": 1, "size": 10e-6, "axial_ratio": 0.6, "form": form}
        assert Spheroid(spheres=37, **keys).max_spheres() == 37
        body = clump(*layout(form, 0.6, Spheroid(spheres=40, **keys).max_spheres())[:2])
        first, second, third = body.inertia
        # rounding of the exact moments of the union, stated as `error`
        equal = (second, third) if form == "prolate" else (first, second)
        assert equal[0] == pytest.approx(equal[1], rel=2.0 * body.error + 1e-12)
        across = body.centers[:, 1:] if form == "prolate" else body.centers[:, 2:]
        assert np.abs(across).max() < 1e-9 and np.abs(body.centers).max() > 0.5
    # every sphere touches the spheroid from inside
    away = np.random.default_rng(1).normal(size=(4000, 3))
    away /= np.linalg.norm(away, axis=1)[:, None]
    for form, r, n in (("prolate", 0.35, 30), ("oblate", 0.6, 61)):
        made, axes = layout(form, r, n), np.array([1.0, r, r] if form == "prolate" else [1.0, 1.0, r])
        for center, radius in zip(made.centers, made.radii, strict=True):
            level = np.linalg.norm((center + radius * away) / axes, axis=1)
            # 4000 random points of a sphere miss the point that touches by some 0.02 rad, and by the square of it in level
            assert level.max() < 1.0 + 1e-12 and level.max() > 0.995, form
    # corrugation of flat bodies falls with the square of the rings
    rings = np.array([2.0, 3.0, 4.0, 5.0])
    found = np.array([corrugation("oblate", 0.6, spheres_in_rings(int(k))) for k in rings])
    height, angle = slopes(rings, found).T
    assert np.all((height > 1.7) & (height < 2.1)) and np.all((angle > 0.7) & (angle < 1.2))
    assert found[-1, 0] < 0.02


@pytest.mark.parametrize("r", [0.35, 0.6, 0.9])
def test_corrugation_and_normals_of_long_bodies_are_those_of_the_closed_form(r):
    squared = 1.0 - r * r
    integral = quad(lambda u: (1.0 - squared * u * u) ** -0.25, -1.0, 1.0)[0]
    for n in (20, 40, 80):
        found, closed = corrugation("prolate", r, n), squared * integral**2 / (8.0 * r * (n - 1) ** 2) / r ** (2.0 / 3.0)
        # the closed form is the leading order; the next is smaller by 1/n^2 times the square of the slenderness 1/r
        assert found[0] == pytest.approx(closed, rel=2.0 / (r * n) ** 2 + 1e-3)
        # half a step E^2 I/(n - 1) between the middle spheres, over their radius r: the largest angle where E^2 < 2/3
        closed = squared * integral / (2.0 * r * (n - 1))
        # the middle of an odd number is a sphere, of an even number a gap: their angles differ by 1/n^2, as does the next order
        assert r < 0.5 or found[1] == pytest.approx(closed, rel=6.0 / (r * n) ** 2 + 1e-2)


@pytest.mark.parametrize(("form", "r", "n"), [("prolate", 0.5, 20), ("prolate", 0.5, 21), ("oblate", 0.6, 19)])
def test_bodies_rest_on_their_flat_side(form, r, n):
    made = layout(form, r, n)
    quaternions, heights = resting_poses(clump(made.centers, made.radii))
    # the shorter semi-axis, less the gap between two spheres
    deep = corrugation(form, r, n)[0] * made.equivalent_radius
    assert np.all((heights <= r * (1.0 + 1e-12)) & (heights >= r - deep))
    axis = np.array([1.0, 0.0, 0.0] if form == "prolate" else [0.0, 0.0, 1.0])
    up = np.abs([matrix_from_quaternion(q)[2] @ axis for q in quaternions])
    # a middle sphere carries the body level until its neighbour touches: a tilt of (r - radius)/distance of the centres
    near = np.sort(np.linalg.norm(made.centers - made.centers[n // 2] * (form == "prolate"), axis=1))[1]
    tilt = near / r + 1e-6
    assert np.all(up < tilt) if form == "prolate" else np.all(up > math.cos(tilt))


def test_sizes_are_those_of_the_spheroid():
    (one, *_) = populate(parsed("axial_ratio = 1.0\nspheres = 50"), []).clumps
    assert len(one.radii) == 1 and 2.0 * one.radii[0] == pytest.approx(10e-6, rel=1e-12)
    warnings: list[str] = []
    size = '{distribution = "lognormal", median = "10 um", sigma = 0.2}'
    placed = populate(parsed('axial_ratio = 0.5\nform = "prolate"\nspheres = 40', size, 4), warnings)
    longest = np.array([2.0 * (body.centers[:, 0] + body.radii).max() for body in placed.clumps])
    # a body of volume pi d^3/6 has the longer axis d / r^(2/3); inscribed spheres lose 4e-4 of the diameter at 40
    expected = np.array([body.diameter for body in placed.clumps]) / 0.5 ** (2.0 / 3.0)
    assert longest == pytest.approx(expected, rel=2e-3) and longest.std() > 1e-7
    twice = populate(parsed("axial_ratio = 0.5\nspheres = 40", size.replace("10 um", "20 um"), 4), []).clumps
    diameters = np.array([[body.diameter for body in bodies] for bodies in (placed.clumps, twice)])
    assert diameters[1] == pytest.approx(2.0 * diameters[0], rel=1e-12)
    near = "0.094 % of its equivalent radius and 2.4 deg of its normals"
    assert warnings == [f"debris[0]: 40 spheres follow the spheroid to {near} at most (corrugation)"]


def test_a_heading_lays_the_long_axis_in_one_direction():
    for spheres in (20, 21):
        placed = populate(parsed(f'axial_ratio = 0.5\nspheres = {spheres}\nheading = "30 deg"', count=4), [])
        axes = np.array([matrix_from_quaternion(q)[:, 0] for q in placed.quaternions])
        assert np.degrees(np.arctan2(axes[:, 1], axes[:, 0])) == pytest.approx(30.0, abs=1e-9)
        free = populate(parsed(f"axial_ratio = 0.5\nspheres = {spheres}", count=4), [])
        # only the rotation about z differs: same height, same inclination of the axis
        assert np.array_equal(free.positions[:, 2], placed.positions[:, 2])
        assert axes[:, 2] == pytest.approx([matrix_from_quaternion(q)[2, 0] for q in free.quaternions], abs=1e-12)


FAULTS = [
    ("axial_ratio = 1.2", "debris[0].axial_ratio: 1.2 must be at least 0.1 and at most 1"),
    ('axial_ratio = 0.5\nform = "flat"', "debris[0].form: 'flat' is not one of 'prolate', 'oblate'"),
    ("axial_ratio = 0.5\nspheres = 101", "debris[0].spheres: 101 must be at least 2 and at most 100"),
    ("axial_ratio = 0.2\nspheres = 6", "spheres: 6 spheres of a prolate spheroid of axial_ratio 0.2 do not hang together:"),
    ('axial_ratio = 0.6\nform = "oblate"\nspheres = 6', "debris[0].spheres: 6 must be at least 7 in an oblate body"),
    ('axial_ratio = 0.35\nform = "oblate"\nspheres = 20',
     "19 spheres of an oblate spheroid of axial_ratio 0.35 do not hang together: at least 37"),
    ("axial_ratio = 0.5\nheading = 0", "debris[0].heading: 0 has no unit, expected a unit of angle (rad, deg)"),
    ('axial_ratio = 0.5\nheading = "0 deg"\nplacement = "dilute"', "debris[0].heading: needs placement = 'layer'"),
    ('axial_ratio = 0.5\nheading = "0 deg"\nform = "oblate"', "debris[0].heading: needs form = 'prolate': an oblate body has"),
    ('axial_ratio = 0.5\nheight = "1 um"', "debris[0].height: needs placement = 'dilute' or 'dense'"),
]  # fmt: skip


@each(FAULTS, name_of=lambda row: row[0])
def test_faults(row):
    with pytest.raises(InputError) as caught:
        parsed(row[0])
    assert row[1] in str(caught.value) and len(caught.value.faults) == 1


SHAPED = """\
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
unit = "um"
spheres = 6
count = 2
"""


@pytest.fixture
def call(command):
    return partial(command, "shapes")


@pytest.fixture
def scene(tmp_path, stone):
    path = tmp_path / "scene.toml"
    path.write_text(scene_text(SHAPED, '["150 um", "150 um"]'), encoding="utf-8")
    return path


def test_a_mesh_is_reported_by_its_own_volume_and_inertia(call, stone):
    code, out, _ = call("rock.stl", "--unit", "um", "--spheres", 8, "--json")
    (entry,) = json.loads(out)["populations"]
    fit = entry["fit"]
    # STL holds single precision
    assert code == 0 and entry["volume"]["mean"] == pytest.approx(stone.volume * 1e-18, rel=1e-6, abs=0.0)
    assert fit["mesh_volume"] == pytest.approx(stone.volume * 1e-18, rel=1e-6, abs=0.0)
    moments = np.sort(np.linalg.eigvalsh(stone.moment_inertia)) * 1e-30
    assert [moment["mean"] for moment in entry["inertia"]] == pytest.approx(moments, rel=1e-5, abs=0.0)
    assert entry["count"] == 1 and entry["spheres"]["max"] == 8
    assert 0.0 < fit["rms"] < fit["maximum"] < 0.3
    assert fit["radius"] == pytest.approx(0.5 * entry["diameter"]["mean"], rel=1e-9, abs=0.0)  # R of the same volume
    assert 0.0 < fit["contact_radius_ratio"]["min"] <= fit["contact_radius_ratio"]["median"] < 1.0


def test_every_population_of_a_scene_and_mesh_of_a_folder_is_reported(call, scene, tmp_path, stone):
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
    (tmp_path / "scans").mkdir()
    for name, height in (("a.stl", 1.0), ("b.stl", 0.5)):
        mesh = stone.copy()
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
    assert 0.03 < (np.ptp(pixels, axis=2) > 40).mean() < 0.6
    assert (pixels == 255).all(axis=2)[:, :20].all(), "nothing is cut at the edge"


def test_what_cannot_be_ends_with_its_code(call, scene):
    for arguments, code, words in [
        (["rock.stl"], 2, "--unit"),
        (["scene.toml", "--unit", "1 um", "--seed", "2"], 2, "--unit, --seed"),
        (["rock.stl", "--unit", "1 um", "--spheres", "3"], 3, "spheres"),
        (["absent.toml"], 3, "absent.toml"),
        (["rock.step"], 3, "neither a scene"),
        (["scene.toml", "--set", "debris.0.asperities.radius=4 um"], 3, "asperities.radius"),
        (["rock.stl", "--unit", "1 um", "-o", "a.jpg"], 3, ".png"),
        (["rock.stl", "--unit", "1 um", "-o", "absent/a.png"], OutputError.exit_code, "does not exist"),
    ]:
        found, _, err = call(*arguments)
        assert found == code and words in err, (arguments, err)
