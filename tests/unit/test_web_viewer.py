"""The page for a browser holds every frame of a run, in few bytes; a browser plays it and names the particle that is clicked."""

import base64
import html
import json
import re

import numpy as np
import pytest
from browser import CHROMIUM, Browser, box
from layer import hue_share, wavy_surfaces, write_layer
from scipy.spatial.transform import Rotation
from thirdbody.api import open_run
from thirdbody.errors import InputError
from thirdbody.palette import STATE_COLORS, rgb
from thirdbody.render import web_viewer
from thirdbody.render.picture_data import read_picture_data
from thirdbody.render.render import render
from thirdbody.render.web_viewer import FINEST, MANY, page_frames, write_page
from thirdbody.surfaces.surface import Surface

FRAMES = 7


def data_of(text):
    return json.loads(re.search(r"^const data = (.*);$", text, re.MULTILINE).group(1))


def packed(text, kind):
    return np.frombuffer(base64.b64decode(text), kind)


def unpacked(steps):
    return np.array(steps["low"]) + np.array(steps["step"]) * packed(steps["steps"], "<u2").reshape(-1, len(steps["low"]))


def spheres_of(data, frame):
    """Centres and colours of the spheres, as the page places and paints them."""
    shapes, part = packed(data["shapes"], "<f4").reshape(-1, 4), packed(data["parts"] or data["bodies"], "<i4")
    frames = len(data["numbers"])
    arms, places = shapes[:, :3], unpacked(data["places"]).reshape(frames, -1, 3)[frame]
    if data["rotations"]:
        vectors = packed(data["rotations"], "<i2").reshape(frames, -1, 3)[frame] * (np.pi / 32767.0)
        arms = Rotation.from_rotvec(vectors[part]).apply(arms)
    palette = packed(data["palette"], "u1").reshape(-1, 3)
    tones = packed(data["tones"], "u1" if len(palette) <= 256 else "<u2").reshape(-1, data["toned"])
    tones = tones[frame if len(tones) > 1 else 0]
    return places[part] + arms, shapes[:, 3], palette[tones if len(tones) == len(part) else tones[packed(data["bodies"], "<i4")]]


@pytest.fixture(scope="module")
def layer(tmp_path_factory):
    return write_layer(tmp_path_factory.mktemp("layer") / "run.vtkhdf", 200, frames=FRAMES, spin=0.9)


@pytest.fixture(scope="module")
def still(tmp_path_factory):
    """A run without orientations of its bodies."""
    return write_layer(tmp_path_factory.mktemp("still") / "run.vtkhdf", 200)


@pytest.mark.parametrize("color", ["state", "velocity", "friction_work"])  # of codes, of all frames, of more than 256 colours
def test_a_page_holds_every_sphere_its_colour_and_the_states_of_every_frame(layer, still, tmp_path, color):
    for path in (layer, still):
        text = render(path, tmp_path / "a.html", color=color).read_text(encoding="utf-8")
        data = data_of(text)
        with open_run(path) as run:
            assert data["numbers"] == list(range(run.frames))
            legends = [read_picture_data(run, n, color).legend for n in data["numbers"]]
            scale = legends[0]
            for legend in legends[1:]:
                scale |= legend
            pictures = [read_picture_data(run, n, color, scale=scale) for n in data["numbers"]]
            counts = [read_picture_data(run, n, "state").legend.entries for n in data["numbers"]]
            states, reasons, friction = run.states, run.reasons, run.series["friction_coefficient"]
        low, high = np.min([p.low for p in pictures], axis=0), np.max([p.high for p in pictures], axis=0)
        factor = 100.0 / np.max((high - low)[:2])
        for frame, picture in enumerate(pictures):
            centers, radii, colors = spheres_of(data, frame)
            # half a step of each coordinate, and of the rotation vector (pi/32767 along each of three axes) times the arm
            arm = factor * np.abs(picture.centers - picture.bodies[picture.body]).max()
            margin = 0.5 * max(data["places"]["step"]) + 1e-4 * arm
            np.testing.assert_allclose(centers, (picture.centers - 0.5 * (low + high)) * factor, atol=margin + 1e-5)
            np.testing.assert_allclose(radii, picture.radii * factor, rtol=1e-6)
            assert np.array_equal(colors, picture.colors)
            assert data["words"][frame] == [words for words, _ in counts[frame]] and data["facts"][frame] == picture.facts
        assert np.array_equal(packed(data["states"]["codes"], "u1").reshape(states.shape), states)
        assert np.array_equal(packed(data["reasons"]["codes"], "u1").reshape(states.shape), reasons)
        history = data["history"]
        assert packed(history["friction"], "<f4") == pytest.approx(friction) and history["at"] == data["numbers"]
        shares = [packed(part, "<f4") for part in history["fractions"]]
        assert np.array(shares) == pytest.approx(np.array([(states == code).mean(axis=1) for code in range(4)]))
        for words, tone in counts[-1]:
            assert f'<i style="background:{tone}"></i>{html.escape(words)}' in text
        # Nothing is fetched: the page opens from a disk without network.
        assert not re.search(r"https?://|src=|@import|<link", text)
        assert "@" not in re.sub(r"@media", "", text.split("<script>")[0])  # no mark of the template is left


def test_marks_of_a_scale_stand_at_their_values(layer, tmp_path):
    text = render(layer, tmp_path / "a.html", color="friction_work", frame=0).read_text(encoding="utf-8")
    with open_run(layer) as run:
        low, high = 1e12 * np.array(read_picture_data(run, 0, "friction_work").legend.limits)
    marks = np.array(re.findall(r'left:([\d.]+)%">([\d.]+)<', text), float)
    assert len(marks) > 2 and marks[:, 0] == pytest.approx((marks[:, 1] - low) / (high - low) * 100.0, abs=0.01)
    assert "friction work, pJ" in text and 'class="bar"' in text and "history" not in data_of(text)


def test_many_frames_are_thinned_out_evenly_and_some_can_be_named(layer, tmp_path, monkeypatch):
    with open_run(layer) as run:
        data = read_picture_data(run, 0, "state")
    assert page_frames(range(1000), data)[:2] == [0, 5] and len(page_frames(range(1000), data)) == MANY
    for words, expected in (({"frames": "1:6:2"}, [1, 3, 5]), ({"frames": "::-3"}, [0, 3, 6]), ({"frame": -2}, [5])):
        text = render(layer, tmp_path / "a.html", **words).read_text(encoding="utf-8")
        assert data_of(text)["numbers"] == expected
    monkeypatch.setattr(web_viewer, "BYTES", 1)
    monkeypatch.setattr(web_viewer, "FEW", 3)
    text = render(layer, tmp_path / "a.html").read_text(encoding="utf-8")
    assert data_of(text)["numbers"] == [0, 3, 6] and data_of(text)["frames"] == FRAMES
    assert data_of(text)["history"]["at"] == [0, 3, 6]  # the curves keep all frames
    with pytest.raises(InputError, match="frame, frames: give one of them"):
        render(layer, tmp_path / "a.html", frame=0, frames=":")


def test_two_thousand_bodies_in_forty_frames_are_less_than_3_mb_and_the_same_each_time(tmp_path):
    path = write_layer(tmp_path / "run.vtkhdf", 2000, frames=40, spin=0.3)
    first, again = (render(path, tmp_path / name).read_bytes() for name in ("a.html", "b.html"))
    assert first == again and len(data_of(first.decode())["numbers"]) == 40
    assert len(first) < 3_000_000


def test_a_title_cannot_end_the_script_or_bring_its_own(still, tmp_path):
    bad = "</script><script>alert(1)</script>@FACTS@"
    with open_run(still) as run:
        run.header["title"] = run.reason_names[1] = bad
        text = write_page(run, [0], tmp_path / "a.html").read_text(encoding="utf-8")
    assert text.count("<script>") == text.count("</script>") == 1
    assert data_of(text)["reasons"]["names"][1] == bad and html.escape(bad) in text


@pytest.fixture(scope="module")
def rough(tmp_path_factory):
    return write_layer(tmp_path_factory.mktemp("rough") / "run.vtkhdf", 12, frames=3, surfaces=wavy_surfaces(12))


def test_a_page_holds_heights_of_both_plates_where_they_are_and_the_contacts(rough, tmp_path):
    data = data_of(render(rough, tmp_path / "a.html").read_text(encoding="utf-8"))
    with open_run(rough) as run:
        pictures = [read_picture_data(run, frame, "state") for frame in range(run.frames)]
    low, high = np.min([p.low for p in pictures], axis=0), np.max([p.high for p in pictures], axis=0)
    middle, scale = 0.5 * (low + high), 100.0 / (high - low)[:2].max()
    contacts, counts = unpacked(data["contacts"]), np.cumsum([0, *data["contacts"]["count"]])
    for frame, picture in enumerate(pictures):
        planes = picture.low[2], picture.plate_height_over(picture.low, picture.high)
        for side, plane in zip(("lower", "upper"), planes, strict=True):
            grid, surface, position = data["surfaces"][side], picture.surfaces[side], data["positions"][side][frame]
            # points of one period, from the place of the plate in this frame
            x, y = (at + np.arange(n) * (length / n) for at, n, length in zip(position, grid["n"], grid["size"], strict=False))
            x, y = np.meshgrid(x, y)
            z = plane - middle[2] + surface.sign * surface.heights(x / scale + middle[0], y / scale + middle[1])
            found = position[2] + unpacked(grid["z"]).reshape(z.shape)
            assert np.abs(found - scale * z).max() <= 0.51 * grid["z"]["step"][0]  # half a step, and rounding
        on = picture.touching
        expected = np.column_stack(((on.points - middle)[:, :2], on.radius)) * scale
        assert contacts[slice(*counts[frame : frame + 2])] == pytest.approx(expected, abs=max(data["contacts"]["step"]))
    assert np.ptp(data["positions"]["upper"], axis=0)[0] == pytest.approx(40e-6 * scale)  # it moved, by some two bodies
    assert np.ptp(data["positions"]["lower"], axis=0) == pytest.approx(0.0)


def test_a_page_thins_out_a_fine_surface(tmp_path):
    lower = wavy_surfaces(12)["lower"]
    fine = Surface(np.tile(lower.heights, (16, 16)), lower.size, lower.shortest)
    sizes = [
        render(write_layer(tmp_path / f"{name}.vtkhdf", 12, surfaces=given), tmp_path / f"{name}.html", frame=0).stat().st_size
        for name, given in (("flat", {}), ("fine", {"lower": fine}))
    ]
    assert 0 < sizes[1] - sizes[0] < 4 / 3 * 2 * FINEST**2 + 10_000  # base64 of two bytes a point, and the contacts


needs_chromium = pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium")


@pytest.mark.full(kind="browser")
@needs_chromium
@pytest.mark.parametrize("view", ["iso", "side", "front", "top"])
def test_a_browser_shows_bodies_and_legend(still, tmp_path, view):
    with Browser(render(still, tmp_path / "a.html", view=view, frame=-1), 800, 500, tmp_path / "profile") as browser:
        assert browser.value("document.body.dataset.drawn") == "1200"
        pixels = np.array(browser.picture(), int)
        foot, stage = (int(browser.value(f"{box(name)}.top")) for name in ("footer", "#stage"))
        hidden = browser.value("element('panel').hidden && element('strip').hidden")
        assert not browser.errors
    assert hidden  # of one frame there is nothing to play
    for state in ("sticking", "sliding", "rolling"):
        assert hue_share(pixels[stage:foot], STATE_COLORS[state]) > 0.001, state  # bodies; along the drag one hides the other
        assert hue_share(pixels[foot:], STATE_COLORS[state]) > 0.001, state  # a disc of 15 pixels is 0.3 % of the foot
    white = np.all(pixels > 250, axis=2)
    assert white[stage:foot, :2].all() and white[stage:foot, -2:].all()  # the whole fits


HIGHEST = """(body => {
  const top = k => spheres[4 * k + 2] + spheres[4 * k + 3];
  const i = [...owner.keys()].filter(k => owner[k] === body).reduce((best, k) => top(k) > top(best) ? k : best);
  const [x, y] = on_page(camera(), [...spheres.slice(4 * i, 4 * i + 3)]), r = canvas.getBoundingClientRect();
  return [x + r.x, y + r.y];
})"""
"""Where the centre of the highest sphere of a body is on the screen."""


@pytest.mark.full(kind="browser")
@needs_chromium
@pytest.mark.parametrize(("width", "tall"), [(1280, 800), (390, 844)])
def test_a_browser_plays_a_run_and_names_the_particle_that_is_clicked(layer, tmp_path, width, tall):
    with open_run(layer) as run:
        counts = [[words for words, _ in read_picture_data(run, n, "state").legend.entries] for n in range(FRAMES)]
        states, reasons, names = run.states, run.reasons, run.reason_names
        friction = run.series["friction_coefficient"]
    with Browser(render(layer, tmp_path / "a.html"), width, tall, tmp_path / "profile") as browser:
        entries, shown = "[...entries].map(e => e.lastChild.textContent)", "[frame, element('number').textContent]"
        assert browser.value(entries) == counts[-1] and browser.value(shown) == [6, "frame 6 of 0 to 6"]
        before = np.array(browser.picture(), int)
        browser.click_on("#slider", 0.35)
        frame = browser.value("frame")
        assert 0 < frame < FRAMES - 1 and browser.value(entries) == counts[frame] != counts[-1]
        assert browser.value("document.querySelector('#friction b').textContent") == f"{friction[frame]:.3f}"
        stage = slice(*(int(browser.value(f"{box('#stage')}.{side}")) for side in ("top", "bottom")))
        change = np.abs(np.array(browser.picture(), int) - before)[stage].max(axis=2)
        assert np.mean(change > 40) > 0.01  # bodies moved and rolled
        centers, radii, colors = spheres_of(data_of((tmp_path / "a.html").read_text(encoding="utf-8")), frame)
        drawn, painted = browser.value("[[...spheres], [...colors]]")
        assert np.array(drawn).reshape(-1, 4) == pytest.approx(np.column_stack((centers, radii)), abs=1e-4)  # float32 to 50
        assert painted == colors.ravel().tolist()
        # a particle, by the mouse or by a finger
        browser.click_on("[data-view=top]")
        body = int(np.argmax(np.ptp(states, axis=0) > 0))  # one that changes its state
        x, y = browser.value(f"{HIGHEST}({body})")
        browser.click(x, y)
        state, reason = list(STATE_COLORS)[states[frame, body]], names[reasons[frame, body]].replace("_", " ")
        assert browser.value("told.textContent") == f"particle {body} · {state}" + (f" ({reason})" if reason != "none" else "")
        strip = browser.value("element('strip').style.backgroundImage")
        strip = re.findall(r"rgb\((\d+), (\d+), (\d+)\) ([\d.]+)%", strip)  # two stops for each frame
        assert strip[::2] != strip[1::2] and len(strip) == 2 * FRAMES
        for first, last, code in zip(strip[::2], strip[1::2], states[:, body], strict=True):
            assert tuple(map(int, first[:3])) == tuple(map(int, last[:3])) == rgb(list(STATE_COLORS.values())[code])
        edges = np.array(strip, float)[:, 3].reshape(FRAMES, 2)
        assert edges[0, 0] == 0.0 and edges[-1, 1] == 100.0 and np.all(edges[1:, 0] == edges[:-1, 1])
        # the first frame by its place on the strip, then all to the end
        browser.click_on("#strip", 0.01)
        assert browser.value("frame") == 0
        browser.click_on("#play")
        assert browser.value("play.textContent") == "pause"
        browser.until(f"frame === {FRAMES - 1} && !timer")
        assert browser.value(entries) == counts[-1]
        # nothing is covered or cut off
        areas = [browser.value(f"(r => [r.top, r.bottom, r.left, r.right])({box(name)})") for name in
                 ("header", "#stage", "#panel", "footer")]  # fmt: skip
        assert all(first[1] <= second[0] + 0.5 for first, second in zip(areas, areas[1:], strict=False))
        assert areas[-1][1] <= tall + 0.5 and browser.value("document.documentElement.scrollWidth") == width
        assert areas[1][1] - areas[1][0] > 0.35 * tall  # the picture
        if width < 700:
            turn, size = browser.value("[turn, size]")
            middle, half = 195.0, 0.5 * (areas[1][0] + areas[1][1])
            browser.touch("touchStart", (middle, half))
            browser.touch("touchMove", (middle + 40, half))
            browser.touch("touchEnd")
            assert browser.value("turn") == pytest.approx(turn - 16.0) and browser.value("size") == size
            browser.touch("touchStart", (middle - 30, half), (middle + 30, half))
            browser.touch("touchMove", (middle - 60, half), (middle + 60, half))
            browser.touch("touchEnd")
            turned, zoomed = browser.value("[turn, size]")
            assert turned == pytest.approx(turn - 16.0) and zoomed == pytest.approx(0.5 * size, rel=0.05)
        assert not browser.errors


@pytest.mark.full(kind="browser")
@needs_chromium
def test_a_browser_moves_a_rough_plate_with_the_drag(rough, tmp_path):
    with Browser(render(rough, tmp_path / "a.html"), 1280, 800, tmp_path / "profile") as browser:
        data = data_of((tmp_path / "a.html").read_text(encoding="utf-8"))
        for frame in range(3):
            browser.value(f"show({frame})")
            count, upper = browser.value("[spot_count, built]")
            assert count == data["contacts"]["count"][frame]
            assert [float(x) for x in upper.split(",")] == data["positions"]["upper"][frame]
        # heights between the points of the grid are those of its wave; the chord of 24 points a wave lacks (2 pi/24)^2/8 of it
        x = np.linspace(-40.0, 40.0, 37)
        heights = np.array(browser.value(f"{x.tolist()}.map(x => height(rough.upper, x, 0))"))
        surface = data["surfaces"]["upper"]
        wave = -surface["z"]["step"][0] * 32767.5 * np.cos(4.0 * np.pi * x / surface["size"][0])
        assert heights == pytest.approx(wave, abs=0.01 * np.abs(wave).max())
        assert not browser.errors
