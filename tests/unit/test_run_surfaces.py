"""Surfaces of rough plates in the file of a run, in pyvista, and in pictures; pages that a browser shows from the disk."""

import base64
import html
import json
import re
import shutil
import subprocess
from dataclasses import replace

import h5py
import numpy as np
import pytest
from layer import clump_layer, hue_share, write_layer
from PIL import Image
from portable import PATIENCE
from thirdbody.api import open_run
from thirdbody.errors import InputError
from thirdbody.palette import STATE_COLORS
from thirdbody.render.coloring import Legend
from thirdbody.render.picture_data import read_picture_data
from thirdbody.render.render import render
from thirdbody.render.surfaces import SHADE, skirt, window_mesh
from thirdbody.render.web_viewer import FINEST, write_page
from thirdbody.surfaces.grid import phases, sine_heights
from thirdbody.surfaces.surface import Surface
from thirdbody.trajectory.writer import TrajectoryWriter

COUNT, AMPLITUDE = 12, 2e-6


@pytest.fixture(scope="module")
def surfaces():
    size = tuple(float(length) for length in clump_layer(COUNT)[-1])
    lower = Surface(sine_heights(phases((64, 96), (3, 1), 0.3), AMPLITUDE), size, size[0] / 4, curvature=False, copies=(3, 1))
    return {"lower": lower, "upper": Surface(sine_heights(phases((32, 48), (2, 0), 0.0), AMPLITUDE), size, size[0] / 2)}


@pytest.fixture(scope="module")
def rough(surfaces, tmp_path_factory):
    return write_layer(tmp_path_factory.mktemp("rough") / "run.vtkhdf", COUNT, surfaces=surfaces)


def assert_same(stored, given):
    assert stored.keys() == given.keys()
    for side, surface in given.items():
        np.testing.assert_array_equal(stored[side].heights, surface.heights)
        for name in ("size", "shortest", "curvature", "copies"):
            assert getattr(stored[side], name) == getattr(surface, name), name


def test_a_run_stores_its_surfaces_once_and_gives_them_back(rough, surfaces, tmp_path):
    with open_run(rough) as run:
        assert_same(run.surfaces, surfaces)
        assert run.surface("lower") is run.surfaces["lower"]
        with pytest.raises(ValueError, match="'middle' is not one of 'lower', 'upper'"):
            run.surface("middle")
    path = tmp_path / "run.vtkhdf"
    path.write_bytes(rough.read_bytes())
    with TrajectoryWriter.resume(path, 1), open_run(path) as run:
        assert run.frames == 1
        assert_same(run.surfaces, surfaces)
    # a run between flat plates has no trace of them
    with open_run(write_layer(tmp_path / "flat.vtkhdf", COUNT)) as run:
        assert run.surfaces == {} and run.surface("lower") is None
        assert run.to_pyvista().keys() == ["spheres", "clumps", "contacts", "plates"]
    with h5py.File(tmp_path / "flat.vtkhdf") as file:
        assert "surfaces" not in file


def test_a_damaged_surface_is_one_clear_fault(rough, tmp_path):
    def huge(file):
        del file["surfaces/lower"]
        data = file["surfaces"].create_dataset("lower", (10**6, 10**6), np.float64, chunks=(1000, 1000))
        data.attrs.update({"size": np.ones(2), "copies": np.ones(2), "shortest": 1.0, "curvature": 1})

    path = tmp_path / "run.vtkhdf"
    for spoil in (
        lambda file: file["surfaces"].move("lower", "middle"),
        lambda file: file["surfaces/lower"].attrs.update({"size": np.array([1.0, np.nan])}),
        lambda file: file["surfaces/lower"].attrs.pop("copies"),
        huge,
    ):
        path.write_bytes(rough.read_bytes())
        with h5py.File(path, "r+") as file:
            spoil(file)
        with pytest.raises(InputError, match="not a run of thirdbody, or damaged"):
            open_run(path)


def test_pyvista_gets_the_surfaces_where_the_plates_are(rough, surfaces):
    with open_run(rough) as run:
        blocks, corner = run.to_pyvista(-1), run.plates(-1)["position"][4]
    upper, surface = blocks["upper_surface"], surfaces["upper"]
    assert upper.field_data["height_units"][0] == "m"
    x, z, height = upper.points[:, 0], upper.points[:, 2], upper["height"]
    expected = AMPLITUDE * np.cos(4.0 * np.pi * (x - corner[0]) / surface.size[0])
    np.testing.assert_allclose(height, expected, atol=1e-12 * AMPLITUDE)
    np.testing.assert_allclose(z, corner[2] - expected, rtol=1e-12)  # it looks down
    assert np.ptp(x) == pytest.approx(surface.size[0], rel=1e-12)
    assert blocks["lower_surface"].n_points == 65 * 97
    # a drawn surface is the spline moved with its plate
    with open_run(rough) as run:
        first, data = (read_picture_data(run, frame, "state") for frame in (0, -1))
    # the upper plate is drawn clear of the bodies
    plane, over = first.plate_height_over(first.low, first.high), first.surfaces["upper"].heights(*first.centers.T[:2])
    assert np.all(first.centers[:, 2] + first.radii <= plane - over + 1e-15)
    lower, upper = data.surfaces["lower"], data.surfaces["upper"]
    x = upper.position[0] + surfaces["upper"].spacing[0] * np.arange(48)
    np.testing.assert_allclose(upper.heights(x, 0.0 * x), surfaces["upper"].heights[0], atol=1e-12 * AMPLITUDE)
    mesh = window_mesh(lower, data.low, data.high, data.centers, data.radii)
    points, colors = np.asarray(mesh.points)[::31], mesh.point_data["color"][::31].astype(float).sum(axis=1)
    # heights of the formula; the spline of 32 points a wave differs by (2 pi/32)^4/384 of the amplitude
    wave = AMPLITUDE * np.cos(2.0 * np.pi * (3 * points[:, 0] / lower.size[0] + points[:, 1] / lower.size[1]) - 0.3)
    np.testing.assert_allclose(points[:, 2], wave, atol=1e-4 * AMPLITUDE)
    distance = np.hypot(*(points[:, None, :2] - data.centers[None, :, :2]).transpose(2, 0, 1)) / data.radii
    covered, free = (distance < 0.99).any(axis=1), (distance > 1.01).all(axis=1)
    assert np.corrcoef(colors[free], wave[free])[0, 1] > 0.99  # lighter where it is higher
    level = np.abs(wave) < 0.02 * AMPLITUDE
    assert colors[level & covered].mean() == pytest.approx((1.0 - SHADE) * colors[level & free].mean(), rel=0.02)
    walls = skirt(mesh, -1e-5)
    assert walls.bounds[4] == pytest.approx(-1e-5) and walls.n_cells == 2 * (mesh.dimensions[0] + mesh.dimensions[1]) - 4


def data_of(text):
    return json.loads(re.search(r"^const data = (.*);$", text, re.MULTILINE).group(1))


def packed(text, kind):
    return np.frombuffer(base64.b64decode(text), kind)


def test_a_page_holds_heights_of_both_plates_and_the_contacts(rough, tmp_path):
    data = data_of(render(rough, tmp_path / "a.html", frame=0).read_text(encoding="utf-8"))
    with open_run(rough) as run:
        picture = read_picture_data(run, 0, "state")
    middle, extent = 0.5 * (picture.low + picture.high), picture.high - picture.low
    scale, half = 100.0 / extent[:2].max(), np.array(data["half"])
    upper_plane = picture.plate_height_over(picture.low, picture.high)
    for side, plane, sign in (("lower", picture.low[2], 1.0), ("upper", upper_plane, -1.0)):
        grid, surface = data["surfaces"][side], picture.surfaces[side]
        x, y = (at + np.linspace(-h, h, n) / scale for at, h, n in zip(middle, half, grid["n"], strict=False))
        z = plane - middle[2] + sign * surface.heights(*np.meshgrid(x, y))
        found = grid["low"] + packed(grid["z"], "<u2").reshape(z.shape) * (grid["high"] - grid["low"]) / 65535.0
        assert np.abs(found - scale * z).max() <= 0.51 * (grid["high"] - grid["low"]) / 65535.0  # half a step, and rounding
        # a window a little larger than the period, at the spacing of the surface's own grid
        assert np.all(np.array(grid["n"]) >= surface.coefficients.shape[::-1]) and max(grid["n"]) <= FINEST
    spots = packed(data["contacts"], "<f4").reshape(-1, 6)
    np.testing.assert_allclose(spots[:, :3], (picture.touching.points - middle) * scale, atol=1e-4)  # float32 of numbers to 50
    np.testing.assert_allclose(spots[:, 4], picture.surfaces["lower"].slopes(*picture.touching.points.T[:2])[0], rtol=1e-5)


def test_a_page_thins_out_a_fine_surface(surfaces, tmp_path):
    lower = surfaces["lower"]
    fine = Surface(np.tile(lower.heights, (16, 16)), lower.size, lower.shortest)
    sizes = [
        render(write_layer(tmp_path / f"{name}.vtkhdf", COUNT, surfaces=given), tmp_path / f"{name}.html", frame=0).stat().st_size
        for name, given in (("flat", {}), ("fine", {"lower": fine}))
    ]
    assert 0 < sizes[1] - sizes[0] < 4 / 3 * 2 * FINEST**2 + 10_000  # base64 of two bytes a point, and the contacts


BROWSER = next((found for name in ("chromium", "chromium-browser", "google-chrome") if (found := shutil.which(name))), None)


@pytest.fixture(scope="module")
def layer(tmp_path_factory):
    return write_layer(tmp_path_factory.mktemp("layer") / "run.vtkhdf", 200)


def test_a_page_holds_every_sphere_its_colour_and_the_legend(layer, tmp_path):
    text = render(layer, tmp_path / "a.html", frame=0).read_text(encoding="utf-8")
    data = data_of(text)
    with open_run(layer) as run:
        picture = read_picture_data(run, 0, "state")
    spheres = packed(data["spheres"], "<f4").reshape(-1, 4)
    scale = 100.0 / np.max((picture.high - picture.low)[:2])
    expected = np.column_stack(((picture.centers - 0.5 * (picture.low + picture.high)) * scale, picture.radii * scale))
    np.testing.assert_allclose(spheres, expected, atol=1e-5)  # float32 of numbers to 50
    assert np.array_equal(packed(data["colors"], "u1").reshape(-1, 3), picture.colors)
    for words, tone in picture.legend.entries:
        assert f'<i style="background:{tone}"></i>{html.escape(words)}' in text
    # marks of a scale stand at their values
    scale = replace(picture, legend=Legend("speed", limits=(2e-3, 6e-3), unit="m/s"))
    text = write_page(scale, tmp_path / "b.html").read_text(encoding="utf-8")
    marks = np.array(re.findall(r'left:([\d.]+)%">([\d.]+)<', text), float)
    assert len(marks) > 2 and marks[:, 0] == pytest.approx((marks[:, 1] - 2.0) / 4.0 * 100.0) and "speed, mm/s" in text
    # Nothing is fetched: the page opens from a disk without network.
    assert not re.search(r"https?://|src=|@import|<link", text)
    assert "@" not in re.sub(r"@media", "", text.split("<script>")[0])  # no mark of the template is left


def test_a_title_cannot_end_the_script_or_bring_its_own(layer, tmp_path):
    with open_run(layer) as run:
        picture = read_picture_data(run, 0, "friction_work")
    bad = "</script><script>alert(1)</script>"
    text = write_page(replace(picture, title=bad, labels=(bad,)), tmp_path / "a.html").read_text(encoding="utf-8")
    assert text.count("<script>") == text.count("</script>") == 1
    assert data_of(text)["labels"] == [bad]
    assert "friction work, pJ" in text and 'class="bar"' in text


def browse(page, *options):
    start = [BROWSER, "--headless", "--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
    limits = ["--window-size=800,500", "--virtual-time-budget=8000", "--disable-dev-shm-usage"]
    return subprocess.run([*start, *limits, *options, page.as_uri()], capture_output=True, text=True, timeout=PATIENCE).stdout


@pytest.mark.full(kind="browser")
@pytest.mark.skipif(BROWSER is None, reason="needs Chromium")
@pytest.mark.parametrize("view", ["iso", "side", "front", "top"])
def test_a_browser_shows_bodies_and_legend(layer, tmp_path, view):
    page = render(layer, tmp_path / "a.html", view=view)
    browse(page, f"--screenshot={tmp_path / 'a.png'}")
    with Image.open(tmp_path / "a.png") as image:
        pixels = np.array(image.convert("RGB"), int)
    stage, foot = pixels[80:420], pixels[420:]
    for state in ("sticking", "sliding", "rolling"):
        assert hue_share(stage, STATE_COLORS[state]) > 0.001, state  # bodies; along the drag one hides the other
        assert hue_share(foot, STATE_COLORS[state]) > 0.001, state  # a disc of 15 pixels is 0.3 % of the foot
    white = np.all(pixels > 250, axis=2)
    assert white[80:420, :2].all() and white[80:420, -2:].all()  # the whole fits
    drawn = browse(page, "--dump-dom")
    assert 'data-drawn="1200"' in drawn and "rolling" in drawn
