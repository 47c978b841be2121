"""Files that a scene names and that are spoilt: one clear message each, exit code 3, nothing left behind."""

import io
import pickle
import zipfile
from pathlib import Path

import numpy as np
import pytest
import trimesh
from balls import edited
from thirdbody import input_files

GOOD = "clump,x [um],y [um],z [um],radius [um]\n0,10,10,5,5\n0,14,10,4,4\n7,40,30,5,5\n7,40,35,4,4\n"
TURNED = "clump,x [um],y [um],z [um],radius [um],qw,qx,qy,qz\n0,10,10,5,5,{}\n0,14,10,4,4,{}\n"
ARRAYS = {
    "center": np.array([[10, 10, 5], [14, 10, 4], [40, 30, 5], [40, 35, 4]]) * 1e-6, "radius": np.array([5, 4, 5, 4]) * 1e-6,
    "clump": np.array([0, 0, 7, 7]),
}  # fmt: skip
BIT = ARRAYS["center"].tobytes()


def csv(*changes):
    return edited(GOOD, *changes).encode()


def npz(drop="", **changes):
    file = io.BytesIO()
    np.savez(file, **{name: array for name, array in (ARRAYS | changes).items() if name != drop})
    return file.getvalue()


def changed(name, place, value):
    array = ARRAYS[name].copy()
    array[place] = value
    return array


def torn(name, at):
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w") as archive, zipfile.ZipFile(io.BytesIO(npz())) as sound:
        for entry in sound.namelist():
            data = sound.read(entry)
            archive.writestr(entry, data[:at] if entry == f"{name}.npy" else data)
    return file.getvalue()


def claimed(rows):
    """Headers that promise so many spheres, and nothing after them."""
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w") as archive:
        for name, tail, descr in (("center", (3,), "<f8"), ("radius", (), "<f8"), ("clump", (), "<i8")):
            array = io.BytesIO()
            np.lib.format.write_array_header_1_0(array, {"descr": descr, "fortran_order": False, "shape": (rows, *tail)})
            archive.writestr(f"{name}.npy", array.getvalue())
    return file.getvalue()


# name of the file, its bytes, the place in it, words of the message
TABLES = {
    # not a table at all
    "empty": ("b.csv", b"", "", ["is empty"]),
    "empty npz": ("b.npz", b"", "", ["is empty"]),
    "blank": ("b.csv", b"\n\n \n", "", ["is empty", "clump,x [um]"]),
    "header only": ("b.csv", csv()[:39], "", ["holds no spheres"]),
    "wrong suffix": ("b.txt", csv(), "", ["'.txt'", ".csv or .npz"]),
    "no suffix": ("b", csv(), "", ["''", ".csv or .npz"]),
    "binary junk": ("b.csv", bytes(range(256)) * 20, "", ["binary data"]),
    "binary junk as npz": ("b.npz", bytes(range(256)) * 20, "", ["no ZIP archive", "numpy.savez"]),
    "pickle as csv": ("b.csv", pickle.dumps(ARRAYS), "", ["is a pickle", "never loaded"]),
    "pickle as npz": ("b.npz", pickle.dumps(ARRAYS), "", ["is a pickle", "never loaded"]),
    "npz as csv": ("b.csv", npz(), "", ["ZIP archive", "expected a CSV"]),
    "csv as npz": ("b.npz", csv(), "", ["no ZIP archive", "expected an NPZ"]),
    "npy as npz": ("b.npz", b"\x93NUMPY\x01\x00", "", ["single array"]),
    "latin-1": ("b.csv", csv(("x [um]", "x [\N{MICRO SIGN}m]")).decode().encode("latin-1"), ":1", ["0xb5", "UTF-8"]),
    "utf-16": ("b.csv", csv().decode().encode("utf-16"), "", ["UTF-16", "UTF-8"]),
    # the header
    "no header": ("b.csv", csv()[39:], ":1: header", ["names of the columns", "clump,x [um]"]),
    "semicolons": ("b.csv", csv().replace(b",", b";"), ":1: header", ["separated by ';'"]),
    "unknown column": ("b.csv", csv(("radius", "raduis")), ":1: raduis [um]", ["did you mean 'radius'"]),
    "missing column": ("b.csv", b"clump,x [um],y [um],radius [um]\n0,1,1,1\n", ":1: header", ["column z is missing"]),
    "column twice": ("b.csv", csv(("y [um]", "center_x [um]")), ":1: center_x [um]", ["x is given twice"]),
    "column without a name": ("b.csv", csv(("y [um]", "")), ":1: header", ["no name"]),
    "no unit": ("b.csv", csv(("radius [um]", "radius")), ":1: radius", ["radius has no unit", "unit of length in brackets"]),
    "wrong dimension": ("b.csv", csv(("radius [um]", "radius [s]")), ":1: radius [s]", ["a time, expected a length"]),
    "unknown unit": ("b.csv", csv(("radius [um]", "radius [mu]")), ":1: radius [mu]", ["unknown unit 'mu'", "'um'"]),
    "unit of an id": ("b.csv", csv(("clump", "clump [um]")), ":1: clump [um]", ["a length, expected a pure number"]),
    "half a quaternion": ("b.csv", TURNED.format("1,0,0,0", "1,0,0,0").replace(",qz", "").replace(",0\n", "\n").encode(),
                          ":1: header", ["qz is missing"]),
    # the rows
    "cut short": ("b.csv", csv()[:-5], ":5: row", ["3 cells", "5 columns", "cut short"]),
    "decimal comma": ("b.csv", csv(("14,10", "14,5,10")), ":3: row", ["6 cells", "comma too many"]),
    "open quote": ("b.csv", csv(("14,10", '"14,10')), ":5", ["is no CSV table"]),
    "text": ("b.csv", csv(("14,10", "l4,10")), ":3: x [um]", ["'l4' is not a number"]),
    "nan": ("b.csv", csv(("14,10", "nan,10")), ":3: x [um]", ["'nan' is not a finite number"]),
    "infinite": ("b.csv", csv(("14,10", "1e999,10")), ":3: x [um]", ["'1e999' is not a finite number"]),
    "empty cell": ("b.csv", csv(("14,10", ",10")), ":3: x [um]", ["cell is empty"]),
    "negative radius": ("b.csv", csv((",4,4", ",4,-4")), ":3: radius [um]", ["'-4' must be greater than 0"]),
    "zero radius": ("b.csv", csv((",4,4", ",4,0")), ":3: radius [um]", ["'0' must be greater than 0"]),
    "id not whole": ("b.csv", csv(("\n7", "\n7.5")), ":4: clump", ["'7.5' is not a whole number from 0"]),
    "id negative": ("b.csv", csv(("\n7", "\n-7")), ":4: clump", ["'-7' is not a whole number from 0"]),
    "id too long": ("b.csv", csv(("\n7", "\n" + "7" * 5000)), ":4: clump", ["is not a whole number from 0"]),
    "out of range": ("b.csv", csv((",4,4", ",4,4e-50")), ":3: sphere", ["4e-56 m", "1e-30 to 1e+30", "unit right"]),
    # the bodies
    "in pieces": ("b.csv", csv(("40,35", "40,45")), ":4: clump 7", ["line 5 not connected to line 4", "one piece"]),
    "no unit quaternion": ("b.csv", TURNED.format("1,0,0,.1", "1,0,0,.1").encode(), ":2: clump 0", ["1.00498756", "1e-06"]),
    "quaternion of zero": ("b.csv", TURNED.format("0,0,0,0", "0,0,0,0").encode(), ":2: clump 0", ["has length 0"]),
    "two quaternions": ("b.csv", TURNED.format("1,0,0,0", "0,1,0,0").encode(), ":3: qw, qx, qy, qz",
                        ["clump 0 differs", "line 2"]),
    "a sphere twice": ("b.csv", GOOD.encode() + b"7,40.0000000005,30,5,5\n", ":6: clump 7", ["line 6 repeats line 4"]),
    "npz a sphere twice": ("b.npz", npz(**{name: ARRAYS[name][[0, 0, 2, 3]] for name in ARRAYS}), ": clump 0",
                           ["sphere 1 repeats sphere 0: the same center and radius"]),
    "powder as one body": ("b.csv", GOOD.encode() + b"7,40,30,5,5\n" * 99, ":4: clump 7", ["101 spheres, at most 100"]),
    # arrays
    "npz cut short": ("b.npz", npz()[:300], "", ["damaged or cut short"]),
    "npz cut inside an array": ("b.npz", torn("radius", 140), ": radius", ["is damaged"]),
    "npz bit flipped": ("b.npz", npz().replace(BIT, b"\xff" + BIT[1:], 1), "", ["damaged or cut short", "CRC"]),
    "npz header of an array lost": ("b.npz", torn("radius", 3), ": radius", ["no array of numbers"]),
    "npz too large": ("b.npz", npz(radius=np.zeros(10**6 + 1, np.int8)), ": radius", ["at most 1000000 spheres"]),
    "npz too wide": ("b.npz", npz(quaternion=np.zeros((4, 10**6))), ": quaternion", ["shape (4, 1000000), expected (2, 4)"]),
    "npz that claims too much": ("b.npz", claimed(10**15), ": center", ["is damaged"]),
    "csv of many columns": ("b.csv", b"x [um]," * 70, ":1: header", ["names 71 columns, at most 30"]),
    "npz pickle inside": ("b.npz", npz(radius=np.array([{}, 1, 2, 3], object)), ": radius", ["Python objects (a pickle)"]),
    "npz unknown array": ("b.npz", npz("center", centre=ARRAYS["center"]), ": centre", ["did you mean 'center'"]),
    "npz missing array": ("b.npz", npz("radius"), ": radius", ["missing"]),
    "npz without arrays": ("b.npz", b"PK\x05\x06" + b"\0" * 18, ": center, radius, clump", ["missing"]),
    "npz text": ("b.npz", npz(radius=np.array(["a"] * 4)), ": radius", ["<U1, expected real numbers"]),
    "npz complex": ("b.npz", npz(radius=ARRAYS["radius"] + 0j), ": radius", ["complex128, expected real numbers"]),
    "npz ids as floats": ("b.npz", npz(clump=ARRAYS["clump"] / 1), ": clump", ["float64, expected whole numbers"]),
    "npz ids of two columns": ("b.npz", npz(clump=np.zeros((4, 2), int)), ": clump", ["shape (4, 2), expected (n,)"]),
    "npz no spheres": ("b.npz", npz(clump=np.zeros(0, int)), ": clump", ["no spheres"]),
    "npz turned over": ("b.npz", npz(center=ARRAYS["center"].T), ": center", ["shape (3, 4), expected (4, 3)"]),
    "npz one radius": ("b.npz", npz(radius=np.array(5e-6)), ": radius", ["shape (), expected (4,)"]),
    "npz quaternion of spheres": ("b.npz", npz(quaternion=np.ones((4, 4))), ": quaternion", ["expected (2, 4)", "2 bodies"]),
    "npz nan": ("b.npz", npz(center=changed("center", (2, 1), np.nan)), ": center[2, 1]", ["nan is not a finite"]),
    "npz infinite": ("b.npz", npz(velocity=[[0, 0, 0], [np.inf, 0, 0]]), ": velocity[1, 0]", ["inf is not a finite"]),
    "npz negative radius": ("b.npz", npz(radius=changed("radius", 3, -4e-6)), ": radius[3]", ["-4e-06 m must be greater"]),
    "npz negative id": ("b.npz", npz(clump=changed("clump", 3, -1)), ": clump[3]", ["-1 must be at least 0"]),
    "npz in pieces": ("b.npz", npz(center=changed("center", (3, 1), 1e-3)), ": clump 7", ["sphere 3 not connected to sphere 2"]),
    "npz no unit quaternion": ("b.npz", npz(quaternion=np.ones((2, 4)) * [[0.5], [0.6]]), ": clump 7", ["has length 1.2"]),
    "npz in the wrong unit": ("b.npz", npz(radius=ARRAYS["radius"] * 1e50), ": sphere[0]",
                              ["5e+44 m", "and 3 more", "is the unit right"]),
}  # fmt: skip

BALL = trimesh.creation.icosphere(subdivisions=1, radius=5.0)
STL, TEXT = BALL.export(file_type="stl"), BALL.export(file_type="stl_ascii")
FIRST = TEXT.split("vertex ")[1].split("\n")[0]


def spoilt(value):
    return STL[:96] + np.float32(value).tobytes() + STL[100:]


def saved(vertices, faces, kind="stl"):
    data = trimesh.Trimesh(vertices, faces, process=False).export(file_type=kind)
    return data if isinstance(data, bytes) else data.encode()


MESHES = {
    "binary cut": ("m.stl", STL[:900], ["80 triangles announced, 16 held", "cut short"]),
    "binary cut in its header": ("m.stl", STL[:60], ["cut short"]),
    "text cut": ("m.stl", TEXT[: len(TEXT) // 2].encode(), ["cut short", "endsolid"]),
    "text cut in a number": ("m.stl", TEXT.replace(FIRST, FIRST.split()[0], 1).encode(), ["line 4", "not three finite numbers"]),
    "text with nan": ("m.stl", TEXT.replace(FIRST, "nan 0 0", 1).encode(), ["1 of 240 vertices are not finite"]),
    "nan": ("m.stl", spoilt(np.nan), ["1 of 240 vertices are not finite"]),
    "infinite": ("m.stl", spoilt(np.inf), ["1 of 240 vertices are not finite"]),
    "far corner": ("m.stl", spoilt(3e38), ["3e+32 m across", "is the unit right"]),
    "empty": ("m.stl", b"", ["is empty"]),
    "no triangles": ("m.stl", b"\0" * 84, ["holds no triangles"]),
    "pickle": ("m.stl", pickle.dumps(ARRAYS), ["no STL file"]),
    "web page": ("m.stl", b"<html>" + b"not found " * 50, ["no STL file"]),
    "hole": ("m.stl", saved(BALL.vertices, BALL.faces[1:]), ["not watertight", "3 edges"]),
    "flat": ("m.stl", saved(BALL.vertices * [1, 1, 0], BALL.faces), ["encloses no volume"]),
    "inside out": ("m.stl", saved(BALL.vertices, BALL.faces[:, ::-1]), ["inside out"]),
    "two bodies": ("m.stl", saved(np.vstack((BALL.vertices, BALL.vertices + 20)),
                                  np.vstack((BALL.faces, BALL.faces + len(BALL.vertices)))), ["2 separate surfaces"]),
    "ply cut": ("m.ply", saved(BALL.vertices, BALL.faces, "ply")[:-20], ["damaged or cut short"]),
    "obj cut": ("m.obj", saved(BALL.vertices, BALL.faces, "obj")[:-20], ["m.obj"]),
    "obj of bytes": ("m.obj", bytes(range(256)) * 4, ["m.obj"]),
    "wrong suffix": ("m.step", STL, ["'.step'", ".stl, .obj, .ply"]),
}  # fmt: skip


@pytest.fixture
def scene(balls):
    def write(file, kind="file", more="", unit="1 um"):
        mesh = f'unit = "{unit}"\ncount = 1\n' if kind == "mesh" else ""
        balls(('kind = "spheres"', f'kind = "{kind}"'), ('radius = "5 um"', f'file = "{file}"'), ("count = 4\n", mesh),
              ("seed = 1\n", f"seed = 1\n{more}\n"))  # fmt: skip

    return write


@pytest.fixture
def refused(command, tmp_path):
    """Commands that say one line, which names the place and holds the words, end with 3 and leave nothing behind."""

    def call(place, words, *arguments):
        before = sorted(tmp_path.rglob("*"))
        report = command(*(arguments or ("check", "scene.toml")))
        assert report.code == 3 and len(report.err.strip().splitlines()) == 1 and not report.out, report
        assert report.err.startswith(f"thirdbody: scene.toml:14:1: debris[0].{place}"), report.err
        assert all(word in report.err for word in words), (words, report.err)
        assert sorted(tmp_path.rglob("*")) == before

    return call


def test_a_bad_table_or_mesh_is_reported_in_one_line(scene, refused, tmp_path):
    rows = [*TABLES.values(), *((file, data, ": mesh", words) for file, data, words in MESHES.values())]
    for file, data, place, words in rows:
        (tmp_path / file).write_bytes(data)
        scene(file, "mesh" if place == ": mesh" else "file")
        refused(f"file: {file}{place}: ", words)
    refused(f"file: {file}{place}: ", words, "run", "scene.toml", "--quiet")


@pytest.mark.parametrize(("kind", "suffix"), [("file", "csv"), ("file", "npz"), ("mesh", "stl")])
def test_a_file_that_cannot_be_read(kind, suffix, scene, refused, tmp_path, monkeypatch):
    (tmp_path / f"folder.{suffix}").mkdir()
    (tmp_path / f"locked.{suffix}").write_bytes(b"x")
    (tmp_path / f"device.{suffix}").symlink_to("/dev/zero")

    def locked(path, mode):  # root may read what is locked, so the system's answer is played
        if Path(path).name == f"locked.{suffix}":
            raise PermissionError(13, "Permission denied")
        return open(path, mode)

    monkeypatch.setattr(input_files, "open", locked, raising=False)
    for name, words in [
        ("missing.{}", "no such file"), ("folder.{}", "is a folder"), ("scene.toml/a.{}", "no such file"),
        ("locked.{}", "cannot be read: Permission denied"), ("device.{}", "is a device"),
        ("a" * 300 + ".{}", "cannot be read: File name too long"),
    ]:  # fmt: skip
        file = name.format(suffix)
        scene(file, kind)
        place = file if len(file) < 200 else f"{file[:200]}..."
        refused(f"file: {place}{': mesh' if kind == 'mesh' else ''}: ", [words])


def test_all_faults_of_tables_are_reported_at_once_and_counted(scene, command, tmp_path):
    rows = "".join(f"{k},{k},x{k},5,5\n" for k in range(25))
    (tmp_path / "b.csv").write_text(f"clump,x [um],y [um],z [um],radius [um]\n{rows}")
    scene("b.csv", more='[[debris]]\nmaterial = "steel"\nkind = "file"\nfile = "none.csv"')
    report = command("check", "scene.toml")
    lines = report.err.splitlines()
    assert report.code == 3 and len(lines) == 12
    assert [line.split("b.csv:")[1].split(":")[0] for line in lines[:10]] == [str(k) for k in range(2, 12)]
    assert lines[10].endswith("b.csv: and 15 more faults") and "debris[1].file" in lines[11]


def test_keys_that_do_not_go_together_and_places_that_cannot_be(scene, command, tmp_path):
    """A velocity in the file and a placement give a warning besides, in `check` only."""
    (tmp_path / "b.npz").write_bytes(npz(velocity=np.zeros((2, 3))))
    for more, *words in (
        ("count = 3", "debris[0].count", "needs placement"), ('size = "3 um"', "debris[0].size", "needs placement"),
        ('placement = "layr"', "debris[0].placement", "'layr' is not one of"),
        ('velocity = ["1 m/s", "0 m/s", "0 m/s"]', "debris[0].velocity", "give only one", "b.npz"),
        ('placement = "layer"\ncount = 10000000', "debris[0].count", "would cover the domain"),
        ('radius = "1 um"', "debris[0].radius", "unknown key"),
    ):  # fmt: skip
        scene("b.npz", more=more)
        report = command("check", "scene.toml")
        assert report.code == 3 and len(report.err.strip().splitlines()) == 1
        assert all(word in report.err for word in words), (words, report.err)
    # places are those of the file, so the fault is told at its key
    for changes, *words in (
        ([("40,30", "12,10"), ("40,35", "12,15")], "bodies 0 and 1 overlap", "initial_overlap"),
        ([("0,14,10,4,4", "0,14,10,4,5")], "body 0 starts 1 um deep in the lower plate"),
        ([("radius [um]", "radius [mm]")], "overlap"),
    ):
        (tmp_path / "b.csv").write_bytes(csv(*changes))
        scene("b.csv")
        report = command("check", "scene.toml")
        assert report.code == 3 and all(word in report.err for word in ("debris[0].file: ", *words)), report


@pytest.mark.parametrize(
    ("unit", "place"),
    [("1 m", "debris[0].unit: 1 m per unit of m.stl"), ("1e300 m", "debris[0].unit"), ("1e-300 m", "debris[0].unit"),
     pytest.param("1e-20 m", "debris[0]: a sphere of body 0", marks=pytest.mark.full(kind="slow"))],
)  # fmt: skip
def test_a_mesh_in_the_wrong_unit(unit, place, scene, command, tmp_path):
    (tmp_path / "m.stl").write_bytes(STL)
    scene("m.stl", "mesh", unit=unit)
    report = command("check", "scene.toml")
    assert report.code == 3 and place in report.err and len(report.err.strip().splitlines()) == 1, report


def test_a_shape_with_a_sphere_twice_is_named(balls, command):
    """Nearer than a billionth of the radius; spheres of other radii about one center may stay, they lie inside."""
    ball = '{center = ["0 m", "0 m", "%s"], radius = "%s"}'
    shapes = [ball % given for given in (("0 m", "5 um"), ("3 um", "5 um"), ("3.000000001 um", "5 um"), ("0 m", "4 um"))]
    balls(('radius = "5 um"', f"shape = [{', '.join(shapes)}]"))
    report = command("check", "scene.toml")
    assert report.code == 3 and len(report.err.splitlines()) == 1
    assert "debris[0].shape[2]: repeats debris[0].shape[1]: the same center and radius; remove one" in report.err
    balls(('radius = "5 um"', f"shape = [{', '.join([*shapes[:2], shapes[3]])}]"))
    assert command("check", "scene.toml").code == 0
