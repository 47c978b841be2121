"""Files of measured surfaces that are spoilt: one clear message each, at the key of the scene, exit code 3."""

import hashlib
import io
import zipfile

import numpy as np
import pytest
from balls import BALLS, edited
from thirdbody import input_files
from thirdbody.assembly.surfaces import plate_surfaces
from thirdbody.errors import InputError
from thirdbody.scene.model import Scene
from thirdbody.surfaces.reading import read_scan

N_X, N_Y, STEP = 60, 50, 1e-6
LOWER = '[plates.lower]\nmaterial = "steel"'
HEIGHTS = np.random.default_rng(1).normal(scale=1e-7, size=(N_Y, N_X))
SCENE = edited(BALLS, (LOWER, f'{LOWER}\nsurface = {{file = "FILE"}}'), ('["80 um", "60 um"]', '["40 um", "30 um"]'))


def archive(**members):
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as file:
        for name, data in members.items():
            file.writestr(name, data)
    return stream.getvalue()


def archive_of(shape):
    """Heights of a shape that only their header tells."""
    heights = io.BytesIO()
    np.lib.format.write_array_header_1_0(heights, {"descr": "<f8", "fortran_order": False, "shape": shape})
    return archive(**{"heights.npy": heights.getvalue(), "spacing.npy": b"", "unit.npy": b""})


def npz(drop="", **changes):
    arrays = {"heights": HEIGHTS * 1e6, "spacing": STEP * 1e6, "unit": "um"} | changes
    stream = io.BytesIO()
    np.savez(stream, **{name: np.asarray(value) for name, value in arrays.items() if name != drop})
    return stream.getvalue()


def xml(letter="D", extra="", **texts):
    t = dict(feature="SUR", axis="I", dx=STEP, dy=STEP, nx=N_X, ny=N_Y, nz=1, z="", link="bindata/data.bin") | texts
    return f"""<?xml version="1.0" encoding="UTF-8"?>{extra}
<p:ISO5436_2 xmlns:p="http://www.opengps.eu/2008/ISO5436_2"><Record1><Revision>ISO5436 - 2000</Revision>
<FeatureType>{t["feature"]}</FeatureType><Axes>
<CX><AxisType>{t["axis"]}</AxisType><DataType>D</DataType><Increment>{t["dx"]}</Increment><Offset>0</Offset></CX>
<CY><AxisType>I</AxisType><DataType>D</DataType><Increment>{t["dy"]}</Increment><Offset>0</Offset></CY>
<CZ><AxisType>A</AxisType><DataType>{letter}</DataType>{t["z"]}</CZ></Axes></Record1>
<Record3><MatrixDimension><SizeX>{t["nx"]}</SizeX><SizeY>{t["ny"]}</SizeY><SizeZ>{t["nz"]}</SizeZ></MatrixDimension>
<DataLink><PointDataLink>{t["link"]}</PointDataLink>{t.get("more", "")}</DataLink></Record3></p:ISO5436_2>"""


def x3p(main=None, data=None, **members):
    raw = HEIGHTS.astype("<f8").tobytes() if data is None else data
    return archive(**{"main.xml": xml() if main is None else main, "bindata/data.bin": raw} | members)


ENTITY = '<!DOCTYPE x [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;">]>'
HOLES = np.where(np.random.default_rng(2).random(HEIGHTS.shape) < 0.3, np.nan, HEIGHTS)
BAD = {
    "missing": ("m.npz", None, ["no such file"]),
    "other suffix": ("a.gwy", b"x", ["suffix '.gwy'", "expected .npz or .x3p or .csv or .txt", "thirdbody surface FILE"]),
    "empty": ("a.npz", b"", ["is empty"]),
    "no archive": ("a.npz", b"\x00" * 300, ["is no ZIP archive"]),
    "pickle": ("a.npz", npz(heights=np.array([{}], object)), ["heights", "pickle"]),
    "cut npz": ("a.npz", npz()[:3000], ["damaged or cut short"]),
    "flipped npz": ("a.npz", npz()[:5000] + b"\x7f" + npz()[5001:], ["damaged or cut short"]),
    "no unit": ("a.npz", npz("unit"), ["unit", "is missing"]),
    "unknown array": ("a.npz", npz(hights=HEIGHTS), ["hights", "did you mean 'heights'"]),
    "unit of another dimension": ("a.npz", npz(unit="s"), ["unit", "is a time, expected a length"]),
    "unknown unit": ("a.npz", npz(unit="mu"), ["unknown unit 'mu'"]),
    "complex": ("a.npz", npz(heights=HEIGHTS * 1j), ["holds complex128, expected real numbers"]),
    "three spacings": ("a.npz", npz(spacing=[1, 2, 3]), ["spacing", "expected one number, or those along x and y"]),
    "no spacing": ("a.npz", npz(spacing=[1.0, 0.0]), ["0 m along y must be a positive length"]),
    "few points": ("a.npz", npz(heights=np.zeros((3, 9))), ["9 x 3 points, at least 4 x 4"]),
    "all missing": ("a.npz", npz(heights=HEIGHTS * np.nan), ["every point is missing"]),
    "many missing": ("a.npz", npz(heights=HOLES * 1e6), ["of the points have no height", "at most 5"]),
    "infinite": ("a.npz", npz(heights=np.where(HEIGHTS > 2e-7, np.inf, HEIGHTS)), ["of its points are infinite"]),
    "heights in nm": ("a.npz", npz(heights=HEIGHTS * 1e12), ["from lowest to highest on", "is the unit right?"]),
    "kilometres": ("a.npz", npz(unit="km", heights=HEIGHTS), ["apart", "is the unit right?"]),
    "many points": ("a.npz", npz(heights=np.zeros((1000, 31000), np.int8)), ["3.1e+07 points, at most 3e+07"]),
    "1e15 points": ("a.npz", archive_of((10**5, 10**10)), ["is damaged or cut short: 1000000000000000 values were announced"]),
    "short array": ("a.npz", archive_of((50, 60)), ["cut short"]),
    "cut x3p": ("a.x3p", x3p()[:9000], ["damaged or cut short"]),
    "no main.xml": ("a.x3p", archive(other=b"x"), ["main.xml", "is missing in the archive"]),
    "no data": ("a.x3p", archive(**{"main.xml": xml()}), ["bindata/data.bin", "is missing in the archive"]),
    "short data": ("a.x3p", x3p(data=HEIGHTS.tobytes()[:-8]), ["23992 bytes, expected 24000 for 60 x 50 points"]),
    "torn xml": ("a.x3p", x3p(xml()[:-40]), ["main.xml", "is not valid XML"]),
    "xml bomb": ("a.x3p", x3p(xml(extra=ENTITY, nx="&b;")), ["declares a document type"]),
    "profile": ("a.x3p", x3p(xml(feature="PRF")), ["FeatureType", "'PRF', expected SUR"]),
    "absolute axis": ("a.x3p", x3p(xml(axis="A")), ["CX/AxisType", "'A', expected I"]),
    "no type": ("a.x3p", x3p(xml(letter="Q")), ["CZ/DataType", "'Q', expected I or L or F or D"]),
    "no increment": ("a.x3p", x3p(xml(dx="")), ["CX/Increment", "missing, expected a number"]),
    "negative increment": ("a.x3p", x3p(xml(dx=-1e-6)), ["along x must be a positive length"]),
    "increment in um": ("a.x3p", x3p(xml(dx=1.0, dy=1.0)), ["is the unit right?"]),
    "huge number of points": ("a.x3p", x3p(xml(nx="1e300")), ["SizeX", "1e+300 must be a whole number from 1 to 1e+09"]),
    "layers": ("a.x3p", x3p(xml(nz=3)), ["SizeZ", "3 layers, expected 1"]),
    "no link": ("a.x3p", x3p(xml(link="")), ["PointDataLink", "missing"]),
    "checksum": ("a.x3p", x3p(xml(more=f"<MD5ChecksumPointData>{'0' * 32}</MD5ChecksumPointData>")),
                 ["differs from its checksum"]),
    "short mask": ("a.x3p", x3p(xml(more="<ValidPointsLink>v</ValidPointsLink>"), v=b"\xff"),
                   ["1 bytes, expected 375: a bit per point"]),
}  # fmt: skip


def test_a_spoilt_file_or_one_that_would_fill_the_memory_gives_one_clear_message(tmp_path, monkeypatch):
    for case, (name, data, words) in BAD.items():
        if data is not None:
            (tmp_path / name).write_bytes(data)
        (tmp_path / "scene.toml").write_text(SCENE.replace("FILE", name), encoding="utf-8")
        with pytest.raises(InputError) as error:
            plate_surfaces(Scene.load(tmp_path / "scene.toml"))
        text = str(error.value)
        assert all(word in text for word in (*words, "scene.toml:21:", "plates.lower.surface.", name)), (case, text)
        assert len(error.value.faults) == 1 and error.value.exit_code == 3
    np.savez_compressed(tmp_path / "a.npz", heights=np.zeros((N_Y, N_X)), spacing=1.0, unit="um")
    monkeypatch.setattr(input_files, "MAX_BYTES", 20_000)
    with pytest.raises(InputError, match=r"a\.npz: heights\.npy: has 0\.0241 MB unpacked, at most 0\.02 MB are read"):
        read_scan(tmp_path / "a.npz")


def test_bodies_between_rough_plates_are_not_pushed_apart():
    waves = '{rms = "0.1 um", hurst = 0.8, long = "20 um", short = "5 um", seed = 1}'
    for plate in (LOWER, LOWER.replace("lower", "upper")):
        text = edited(BALLS, (plate, f"{plate}\nsurface = {waves}"))
        Scene.parse(text)
        with pytest.raises(InputError, match="solver.initial_overlap: 'relax' pushes bodies apart between flat plates only"):
            Scene.parse(text.replace("[solver]", '[solver]\ninitial_overlap = "relax"'))


def test_all_faults_of_one_file_come_at_once(tmp_path):
    (tmp_path / "a.x3p").write_bytes(x3p(xml(feature="PRF", dx="", nz=2, letter="Q")))
    with pytest.raises(InputError) as error:
        read_scan(tmp_path / "a.x3p")
    assert len(error.value.faults) == 4


@pytest.mark.parametrize(("letter", "kind"), [("I", "<u2"), ("L", "<u4")])
def test_whole_numbers_that_a_writer_wrote_unsigned(letter, kind, tmp_path):
    half = np.iinfo(kind).max // 2
    raw = np.rint(half * (1.0 + 0.2 * HEIGHTS / np.abs(HEIGHTS).max())).astype(kind)  # about the middle: signed, they wrap
    (tmp_path / "a.x3p").write_bytes(x3p(xml(letter, z=f"<Increment>{1e-6 / half}</Increment>"), raw.tobytes()))
    scan = read_scan(tmp_path / "a.x3p")
    np.testing.assert_allclose(scan.heights, raw * (1e-6 / half), rtol=1e-15)
    assert "read as unsigned" in scan.notes[0]
    signed = (raw.astype(np.int64) - half).astype(kind.replace("u", "i"))
    (tmp_path / "a.x3p").write_bytes(x3p(xml(letter, z=f"<Increment>{1e-6 / half}</Increment>"), signed.tobytes()))
    scan = read_scan(tmp_path / "a.x3p")
    assert not scan.notes and scan.heights.min() < 0.0


TEXT = {"unit": 1e-6, "spacing": (5e-7, 1e-6)}


@pytest.mark.parametrize(("sign", "end"), [(",", ""), (";", ""), ("\t", ""), (" ", ""), (", ", ","), (";", ";")])
def test_rows_of_numbers_are_a_height_map(sign, end, tmp_path):
    heights = HEIGHTS * 1e6
    heights[3, 4] = np.nan
    rows = [sign.join(f"{value:.17g}" for value in row) + end for row in heights]
    if sign.strip() and not end:
        rows[3] = rows[3].replace("nan", "")
    (tmp_path / "a.csv").write_text("\n".join(["Topography", "# of a disc, 60 points", *rows, ""]), encoding="utf-8")
    scan = read_scan(tmp_path / "a.csv", **TEXT)
    np.testing.assert_allclose(scan.heights, heights * 1e-6, rtol=1e-15)
    assert scan.spacing == (5e-7, 1e-6)
    if sign == ";":
        (tmp_path / "a.csv").write_text("\n".join(rows).replace(".", ","), encoding="utf-8")
        np.testing.assert_allclose(read_scan(tmp_path / "a.csv", **TEXT).heights, heights * 1e-6, rtol=1e-15)


def test_a_text_that_is_no_map_is_told_by_its_lines(tmp_path):
    rows = ["1,2,3,4"] * 6
    bad = {
        "line 3 and 4": (
            [*rows[:2], "1,2,3", "1,two,3,4", *rows],
            ["a.txt:3: has 3 values, expected 4", "a.txt:4: column 2: 'two'"],
        ),
        "words": (["a b c"] * 5, ["holds no row of numbers"]),
        "a word before": (["0 um, 1", *rows], ["a.txt:1: column 1: '0 um'"]),
        "few": (rows[:2], ["4 x 2 points, at least 4 x 4"]),
    }
    for case, (lines, words) in bad.items():
        (tmp_path / "a.txt").write_text("\n".join(lines), encoding="utf-8")
        with pytest.raises(InputError) as error:
            read_scan(tmp_path / "a.txt", **TEXT)
        assert all(word in str(error.value) for word in words), (case, str(error.value))
    # a scene says what text does not, and only of text
    keys = SCENE.replace('"FILE"', '"a.txt", unit = "um", spacing = ["1 um", "1 um"]')
    Scene.parse(keys)
    for text, wrong in ((SCENE.replace("FILE", "a.txt"), "missing, such as"), (keys.replace("a.txt", "a.npz"), "of CSV and TXT")):
        with pytest.raises(InputError) as error:
            Scene.parse(text)
        assert [fault.key.rpartition(".")[2] for fault in error.value.faults] == ["unit", "spacing"] and wrong in str(error.value)


@pytest.mark.parametrize("letter", ["I", "L", "F", "D"])
def test_every_type_of_x3p_is_read_with_its_increment_offset_and_mask(letter, tmp_path):
    step, offset = (1e-10, 2e-6) if letter in "IL" else (1.0, 0.0)
    kind = {"I": "<i2", "L": "<i4", "F": "<f4", "D": "<f8"}[letter]
    raw = (np.rint(HEIGHTS / step) if letter in "IL" else HEIGHTS).astype(kind)
    valid = np.ones(raw.size, np.uint8)
    valid[[0, 7, 1234]] = 0
    bits = np.packbits(valid, bitorder="little").tobytes()
    scale = f"<Increment>{step}</Increment><Offset>{offset}</Offset>" if letter in "IL" else ""
    sums = f"<MD5ChecksumPointData>{hashlib.md5(raw.tobytes()).hexdigest().upper()}</MD5ChecksumPointData>"
    main = xml(letter, z=scale, more=f"{sums}<ValidPointsLink>bindata/valid.bin</ValidPointsLink>", dy=2e-6)
    (tmp_path / "a.x3p").write_bytes(x3p(main, raw.tobytes(), **{"bindata/valid.bin": bits}))
    scan = read_scan(tmp_path / "a.x3p")
    assert scan.heights.shape == (N_Y, N_X) and scan.spacing == (1e-6, 2e-6)  # x changes fastest
    assert np.flatnonzero(np.isnan(scan.heights)).tolist() == [0, 7, 1234]
    rounding = {"I": 0.51e-10, "L": 0.51e-10, "F": 1e-13, "D": 0.0}[letter]
    assert np.nanmax(np.abs(scan.heights - HEIGHTS - offset)) <= rounding + 1e-20


def test_npz_units_of_heights_and_spacing_may_differ(tmp_path):
    (tmp_path / "a.npz").write_bytes(npz(heights=HEIGHTS * 1e9, height_unit="nm", spacing=[0.5, 2.0]))
    scan = read_scan(tmp_path / "a.npz")
    assert scan.spacing == pytest.approx((0.5e-6, 2e-6), rel=1e-15)
    np.testing.assert_allclose(scan.heights, HEIGHTS, rtol=1e-15)


def test_the_readers_agree_with_surface_topography(tmp_path):
    topography = pytest.importorskip("SurfaceTopography")
    from SurfaceTopography.IO.X3P import write_x3p
    from thirdbody.surfaces.reading import read_any_scan

    theirs = topography.Topography(HEIGHTS.T * 1e6, (N_X * 1.0, N_Y * 2.0), unit="um")
    write_x3p(theirs, str(tmp_path / "a.x3p"), dtype="I")
    theirs.to_netcdf(str(tmp_path / "a.nc"))
    for name, error in (("a.x3p", np.ptp(HEIGHTS) / 65000.0), ("a.nc", 1e-20)):
        scan = read_any_scan(tmp_path / name)
        assert scan.spacing == pytest.approx((1e-6, 2e-6), rel=1e-12)
        assert np.abs(scan.heights - HEIGHTS).max() <= error
