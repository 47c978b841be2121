"""The page holds all it needs, and a browser shows bodies and legend from the disk."""

import base64
import html
import json
import re
import shutil
import subprocess
from dataclasses import replace

import numpy as np
import pytest
from layer import clump_layer, hue_share, write_layer
from PIL import Image
from portable import PATIENCE

from thirdbody.palette import STATE_COLORS
from thirdbody.render.picture_data import read_picture_data
from thirdbody.render.render import render
from thirdbody.render.web_viewer import write_page
from thirdbody.surfaces.surface import Surface
from thirdbody.surfaces.waves import phases, sine_heights
from thirdbody.trajectory.reader import open_run

BROWSER = next((found for name in ("chromium", "chromium-browser", "google-chrome") if (found := shutil.which(name))), None)
needs_browser = pytest.mark.skipif(BROWSER is None, reason="needs Chromium")


@pytest.fixture(scope="module")
def layer(tmp_path_factory):
    return write_layer(tmp_path_factory.mktemp("layer") / "run.vtkhdf", 200)


def data_of(text):
    return json.loads(re.search(r"^const data = (.*);$", text, re.MULTILINE).group(1))


def test_a_page_holds_every_sphere_its_colour_and_the_legend(layer, tmp_path):
    text = render(layer, tmp_path / "a.html", frame=0).read_text(encoding="utf-8")
    data = data_of(text)
    with open_run(layer) as run:
        picture = read_picture_data(run, 0, "state")
    spheres = np.frombuffer(base64.b64decode(data["spheres"]), "<f4").reshape(-1, 4)
    scale = 100.0 / np.max((picture.high - picture.low)[:2])
    expected = np.column_stack(((picture.centers - 0.5 * (picture.low + picture.high)) * scale, picture.radii * scale))
    np.testing.assert_allclose(spheres, expected, atol=1e-5)  # float32 of numbers to 50
    colors = np.frombuffer(base64.b64decode(data["colors"]), "u1").reshape(-1, 3)
    assert np.array_equal(colors, picture.colors)
    for words, tone in picture.legend.entries:
        assert f'<i style="background:{tone}"></i>{html.escape(words)}' in text
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


def pixels_of(page, picture):
    browse(page, f"--screenshot={picture}")
    with Image.open(picture) as image:
        return np.array(image.convert("RGB"), int)


@pytest.mark.full(kind="browser")
@needs_browser
@pytest.mark.parametrize("view", ["iso", "side", "front", "top"])
def test_a_browser_shows_bodies_and_legend(layer, tmp_path, view):
    page = render(layer, tmp_path / "a.html", view=view)
    pixels = pixels_of(page, tmp_path / "a.png")
    stage, foot = pixels[80:420], pixels[420:]
    for state in ("sticking", "sliding", "rolling"):
        assert hue_share(stage, STATE_COLORS[state]) > 0.001, state  # bodies; along the drag one hides the other
        assert hue_share(foot, STATE_COLORS[state]) > 0.001, state  # a disc of 15 pixels is 0.3 % of the foot
    white = np.all(pixels > 250, axis=2)
    assert white[80:420, :2].all() and white[80:420, -2:].all()  # the whole fits
    drawn = browse(page, "--dump-dom")
    assert 'data-drawn="1200"' in drawn and "rolling" in drawn


@pytest.mark.full(kind="browser")
@needs_browser
def test_a_browser_shows_heights_of_a_rough_plate(tmp_path):
    size = tuple(float(length) for length in clump_layer(12)[-1])
    rough = Surface(sine_heights(phases((64, 96), (3, 1), 0.3), 2e-6), size, size[0] / 4)
    spread = []
    for name, surfaces in (("flat", {}), ("rough", {"lower": rough})):
        run = write_layer(tmp_path / f"{name}.vtkhdf", 12, surfaces=surfaces)
        pixels = pixels_of(render(run, tmp_path / f"{name}.html", view="top"), tmp_path / f"{name}.png")[80:420]
        grey = np.ptp(pixels, axis=2) < 40  # plates, not bodies in the colours of states
        spread.append(np.ptp(np.percentile(pixels[grey & (pixels.min(axis=2) < 250)], [10, 90])))
    assert spread[1] > 1.5 * spread[0]  # dark valleys and light crests
