"""Debris from a table of spheres: what is read, where the bodies lie, what a placement takes of them."""

import math

import numpy as np
import pytest
from steel import scene_text
from thirdbody.assembly.populate import populate, sphere_centres
from thirdbody.assembly.simulation import build
from thirdbody.debris.file import File
from thirdbody.errors import InputError
from thirdbody.rotations import matrix_from_quaternion
from thirdbody.scene.model import Scene

# a dumbbell of unequal balls, a ball, and a crooked body of three; rows of a body need not stand together
SPHERES = [(3, 10, 20, 9, 5), (1, 60, 60, 40, 7), (9, 90, 30, 12, 6), (3, 16, 22, 9, 4), (9, 97, 30, 12, 4), (9, 90, 36, 14, 3)]
PLAIN = "clump,x [um],y [um],z [um],radius [um]\n" + "".join(",".join(map(str, row)) + "\n" for row in SPHERES)


def text_of(name, more=""):
    return scene_text(f'[[debris]]\nmaterial = "steel"\nkind = "file"\nfile = "{name}"\n{more}', '["150 um", "150 um"]')


def arrays(**more):
    table = np.array(SPHERES, float)
    given = {"clump": table[:, 0].astype(int), "center": table[:, 1:4] * 1e-6, "radius": table[:, 4] * 1e-6}
    return given | {name: np.array(value, float) for name, value in more.items()}


@pytest.fixture
def placed(tmp_path):
    def make(table, more=""):
        name = "b.csv" if isinstance(table, str) else "b.npz"
        if isinstance(table, str):
            (tmp_path / name).write_text(table, encoding="utf-8")
        else:
            np.savez(tmp_path / name, **table)
        path = tmp_path / "scene.toml"
        path.write_text(text_of(name, more))
        scene, warnings = Scene.load(path), []
        return populate(scene, warnings), warnings, scene

    return make


def turn(axis, angle: float) -> list[float]:
    axis = np.array(axis, float) / np.linalg.norm(axis)
    return [math.cos(angle / 2.0), *(math.sin(angle / 2.0) * axis)]


@pytest.mark.parametrize("table", [PLAIN, arrays()], ids=["csv", "npz"])
def test_spheres_lie_where_the_file_says(placed, table):
    bodies, warnings, scene = placed(table)
    centres, radii, body = sphere_centres(bodies)
    given = np.array(sorted(SPHERES, key=lambda row: row[0]), float) * 1e-6  # in the order of the bodies
    # into the principal frame and back, at 1e-4 m: rounding
    assert centres == pytest.approx(given[:, 1:4], abs=1e-18)
    assert radii == pytest.approx(given[:, 4], rel=1e-15)  # 4 um and 4 * 1e-6
    assert body.tolist() == [0, 1, 1, 2, 2, 2] and not warnings
    assert not bodies.velocities.any() and not bodies.angular_velocities.any()


def test_mass_is_that_of_the_union(placed):
    bodies, _, scene = placed(PLAIN)
    built = build(scene)
    # lens of two balls, r 5 and 4, d apart (Weisstein, Sphere-Sphere Intersection, eq. 16)
    r, s, d = 5.0, 4.0, math.sqrt(40.0)
    lens = math.pi * (r + s - d) ** 2 * (d * d + 2 * d * (r + s) - 3 * (r * r + s * s) + 6 * r * s) / (12.0 * d)
    volume = 4.0 / 3.0 * math.pi * (r**3 + s**3) - lens
    # the stated error of the union
    assert built.state.bodies.mass[1] == pytest.approx(7850.0 * volume * 1e-18, rel=bodies.clumps[1].error + 1e-14)
    assert built.state.bodies.mass[0] == pytest.approx(7850.0 * 4.0 / 3.0 * math.pi * 343e-18, rel=1e-14)
    assert built.state.bodies.position[0] == pytest.approx([60e-6, 60e-6, 40e-6], rel=1e-15)


def test_units_names_and_order_of_columns_and_rows_are_free(placed):
    rows = [f"{r / 1000},{y}, {c} ,{x * 1000},{z}e-6" for c, x, y, z, r in SPHERES]
    other = "\ufeffRadius (mm),center_y [um], clump,X[nm],z [m]\r\n" + "\r\n\r\n".join(rows)
    (first, _, _), (second, _, _) = placed(PLAIN), placed(other)
    # the same decimal numbers, each rounded once
    assert second.positions.tolist() == first.positions.tolist()
    assert [body.radii.tolist() for body in second.clumps] == [body.radii.tolist() for body in first.clumps]
    head, *rows = PLAIN.splitlines()
    (first, _, _), (other, _, _) = placed(PLAIN), placed("\n".join([head, *rows[::-1]]))
    # a sum over the spheres in another order
    assert other.positions == pytest.approx(first.positions, rel=1e-9)
    assert [body.volume for body in other.clumps] == pytest.approx([body.volume for body in first.clumps], rel=1e-9)


def test_a_quaternion_and_an_orientation_turn_a_body_about_its_centre_of_mass(placed):
    q = [turn((0, 0, 1), 0.3), turn((0, 0, 1), math.pi / 2.0), turn((1, 2, 3), 0.4)]
    plain, _, _ = placed(arrays())
    turned, _, _ = placed(arrays(quaternion=q))
    assert turned.positions == pytest.approx(plain.positions, abs=1e-19)
    x, _, body = sphere_centres(plain)
    y, _, _ = sphere_centres(turned)
    for b in range(3):
        arms = (x - plain.positions[b])[body == b]
        # rounding at 1e-4 m
        assert (y - plain.positions[b])[body == b] == pytest.approx(arms @ matrix_from_quaternion(q[b]).T, abs=1e-18)
    # clump 3: the arm (6, 2, 0) um between its balls, a quarter turn to the left
    assert np.diff(y[body == 1], axis=0)[0] == pytest.approx([-2e-6, 6e-6, 0.0], abs=1e-18)
    shape = '[{radius = "5 um"}, {center = ["4 um", "3 um", "0 m"], radius = "3 um"}]'  # oblique principal axes
    text = f'[[debris]]\nmaterial = "steel"\nkind = "spheres"\nshape = {shape}\npositions = [["9 um", "9 um", "9 um"]]\n'
    q = turn((1, 2, 3), 0.4)
    scenes = [Scene.parse(scene_text(text + more, '["50 um", "50 um"]')) for more in ("", f"orientation = {[*map(float, q)]}\n")]
    plain, turned = (np.diff(sphere_centres(populate(scene, []))[0], axis=0)[0] for scene in scenes)
    assert plain == pytest.approx([4e-6, 3e-6, 0.0], abs=1e-18) and turned == pytest.approx(matrix_from_quaternion(q) @ plain)


def test_csv_and_npz_say_the_same_and_a_layer_takes_the_shapes_alone(placed):
    extra = {1: "1,0,0,0,1,2,3,-1,0,5", 3: "0.6,0,0.8,0,4,5,6,7,8,9", 9: "0,1,0,0,0,0,0,0,0,2"}
    head = PLAIN.splitlines()[0] + ",qw,qx,qy,qz,vx [mm/s],vy [mm/s],vz [mm/s],wx [1/s],wy [rad/s],wz [1/s]\n"
    lift = [(c, x, y, z + 20, r) for c, x, y, z, r in SPHERES]
    text = head + "".join(",".join(map(str, row)) + f",{extra[row[0]]}\n" for row in lift)
    table = np.array([[float(v) for v in extra[i].split(",")] for i in [1, 3, 9]])
    same = arrays(quaternion=table[:, :4], velocity=table[:, 4:7] * 1e-3, angular_velocity=table[:, 7:])
    same["center"][:, 2] += 20e-6
    (a, _, _), (b, _, _) = placed(text), placed(same)
    for name in ("positions", "quaternions", "velocities", "angular_velocities"):
        # text is rounded once, the arrays above twice
        assert getattr(a, name) == pytest.approx(getattr(b, name), rel=1e-14, abs=1e-18)
    assert a.velocities[1] == pytest.approx([4e-3, 5e-3, 6e-3], rel=1e-15) and a.angular_velocities[0].tolist() == [-1, 0, 5]
    bodies, warnings, _ = placed(PLAIN, 'placement = "layer"\ncount = 5\nseed = 4')
    assert [len(body.radii) for body in bodies.clumps] == [1, 2, 3, 1, 2] and not warnings
    centres, radii, body = sphere_centres(bodies)
    lowest = [(centres[:, 2] - radii)[body == b].min() for b in range(5)]
    # resting on the plate with a clearance of 1e-9 diameters
    assert lowest == pytest.approx([0.0] * 5, abs=1.1e-9 * 14e-6)
    # as many as the file has, unless told
    assert len(placed(PLAIN, 'placement = "layer"')[0].clumps) == 3
    size = 'size = {distribution = "uniform", min = "6 um", max = "9 um"}'
    bodies, _, _ = placed(PLAIN, f'placement = "layer"\ncount = 6\n{size}')
    diameters = [body.diameter for body in bodies.clumps]
    assert min(diameters) >= 6e-6 and max(diameters) <= 9e-6 and len(set(diameters)) == 6
    assert [len(body.radii) for body in bodies.clumps] == [1, 2, 3] * 2
    q = [turn((0, 0, 1), 0.3)] * 3
    bodies, warnings, _ = placed(arrays(quaternion=q, velocity=np.ones((3, 3))), 'placement = "layer"')
    assert warnings == ['b.npz: its quaternions and velocities are not used: placement = "layer" takes the shapes only']
    assert not bodies.velocities.any()
    given, _, _ = placed(PLAIN, 'velocity = ["1 m/s", "0 m/s", "0 m/s"]')  # by the scene, where the file has none
    assert given.velocities.tolist() == [[1.0, 0.0, 0.0]] * 3


@pytest.mark.parametrize("more", ["", 'placement = "layer"\ncount = 5\nsize = "5 um"\nvelocity = ["1 m/s", "0 m/s", "0 m/s"]'])
def test_saved_and_read_the_scene_is_the_same(placed, tmp_path, more):
    _, _, scene = placed(PLAIN, more)
    scene.save(tmp_path / "again.toml")
    again = Scene.load(tmp_path / "again.toml")
    assert again == scene and isinstance(again.debris[0], File)
    assert populate(again, []).positions.tolist() == populate(scene, []).positions.tolist()


def test_bodies_of_a_table_can_meet_each_other(tmp_path):
    text = text_of("b.csv").replace('material = "steel"\nkind', 'material = "glass"\nkind')
    glass = '[materials.glass]\nyoungs_modulus = "70 GPa"\npoisson_ratio = 0.2\ndensity = "2500 kg/m3"\n'
    pair = '[[pairs]]\nbetween = ["steel", "glass"]\nfriction = 0.3\nrestitution = 0.6\n'
    with pytest.raises(InputError, match=r"no pair for 'glass' and 'glass', which can meet \(the bodies of debris"):
        Scene.parse(text + glass + pair)
