"""Pictures show the states in their colours, and what cannot be drawn is told in one sentence."""

import json
import re
import sys

import numpy as np
import pytest
from layer import R, hue_share, skip_unless_drawable, write_layer
from PIL import Image

from thirdbody.api import open_run
from thirdbody.errors import InputError, MissingLibrary, OutputError
from thirdbody.palette import CATEGORY_COLORS, STATE_COLORS, category_colors, field_colors, rgb, state_colors
from thirdbody.render import elsewhere
from thirdbody.render.coloring import Legend, compute_coloring, scale_colors
from thirdbody.render.layout import close_up_window
from thirdbody.render.picture_data import TUBE, read_picture_data
from thirdbody.render.render import render
from thirdbody.units import with_unit


@pytest.fixture(scope="module")
def layer(tmp_path_factory):
    return write_layer(tmp_path_factory.mktemp("layer") / "run.vtkhdf", 200)


def read_pixels(path):
    with Image.open(path) as picture:
        return np.asarray(picture.convert("RGB"))


@pytest.fixture(scope="module")
def picture(layer, tmp_path_factory):
    skip_unless_drawable()
    return render(layer, tmp_path_factory.mktemp("picture") / "a.png", frame=0, size=(800, 450))


def test_a_picture_shows_every_state_in_its_colour_and_what_it_was_drawn_from(picture):
    pixels = read_pixels(picture)
    assert pixels.shape == (450, 800, 3)
    for state in ("sticking", "sliding", "rolling"):
        # The discs of the legend alone are 0.03 % of the picture; bodies of each state cover far more.
        assert hue_share(pixels, STATE_COLORS[state]) > 0.005, state
    # Title and facts stand in the upper, the legend in the lower tenth.
    assert pixels[:45].min() < 100 and pixels[-45:].min() < 100
    with Image.open(picture) as drawn:
        texts = drawn.text
    assert (texts["frame"], texts["time"]) == ("0 of 0 to 1", "0.0 s") and texts["scene"] == "scene = 1\n"
    options = json.loads(texts["options"])
    assert (options["size"], options["view"], options["zoom"]) == ([800, 450], "iso", None)


@pytest.mark.full(kind="slow")
def test_bodies_smaller_than_a_pixel_are_a_map_of_their_colours(tmp_path):
    """Drawn as spheres, 0.03 and 0.0007 of the whole keep the hues of sliding and rolling: shadows make the rest grey."""
    skip_unless_drawable()
    path = write_layer(tmp_path / "run.vtkhdf", 16000, frames=1)
    pixels = read_pixels(render(path, tmp_path / "a.png", size=(260, 200)))[:, :145]
    assert hue_share(pixels, STATE_COLORS["sliding"]) > 0.05 and hue_share(pixels, STATE_COLORS["rolling"]) > 0.01


@pytest.mark.full(kind="slow")
def test_the_same_picture_is_drawn_into_the_same_bytes(layer, tmp_path):
    """With a close-up beside it, tubes, a colour scale and translucent plates."""
    skip_unless_drawable()
    names = [tmp_path / "a.png", tmp_path / "b.png"]
    one, other = (render(layer, name, size=(400, 225), forces=True, color="utilisation").read_bytes() for name in names)
    assert one == other


@pytest.mark.parametrize("view", ["iso", pytest.param("side", marks=pytest.mark.full(kind="slow"))])
def test_forces_are_tubes(layer, picture, tmp_path, view):
    plain = picture if view == "iso" else render(layer, tmp_path / "a.png", frame=0, size=(800, 450), view=view)
    forces = render(layer, tmp_path / "b.png", frame=0, size=(800, 450), view=view, forces=True)
    dark = [np.all(np.abs(read_pixels(drawn).astype(int) - rgb(TUBE)) < 40, axis=2).mean() for drawn in (plain, forces)]
    assert dark[1] > dark[0] + 0.003  # a hundred tubes of some 3 by 20 pixels, half of them hidden


REFUSED = [
    ({"frame": 2}, "no frame 2"), ({"color": "utilization"}, "did you mean 'utilisation'"), ({"zoom": 0.0}, "zoom"),
    ({"size": (10, 10)}, "outside 200 to 8192"), ({"view": "tpo"}, "did you mean 'top'"),
    ({"camera": "follow"}, "needs the body"), ({"camera": "loose", "body": 3}, "neither fixed nor follow"),
    ({"frames": "0:2"}, "shows one frame"), ({"fps": 0}, "fps"), ({"body": 200}, "no body 200; ids are 0 to 199"),
    ({"body": 3, "forces": True}, "leave out forces"),
]  # fmt: skip


def test_options_that_cannot_be_and_missing_libraries_are_named(layer, tmp_path, monkeypatch):
    for options, message in REFUSED:
        with pytest.raises(InputError, match=message):
            render(layer, tmp_path / "a.png", **options)
    with pytest.raises(InputError, match="name it .png, .gif, .mp4 or .html"):
        render(layer, tmp_path / "a.svg")
    with pytest.raises(OutputError, match="does not exist"):
        render(layer, tmp_path / "absent" / "a.png")
    if sys.platform.startswith("linux"):  # only it needs these
        with monkeypatch.context() as patch, pytest.raises(MissingLibrary, match="libegl1.*libosmesa6"):
            patch.setattr(elsewhere, "_loads", lambda library: False)
            render(layer, tmp_path / "a.png")
    monkeypatch.setattr(elsewhere, "usable_windows", lambda: [None])
    monkeypatch.setattr(elsewhere, "find_spec", lambda name: None)
    with pytest.raises(MissingLibrary, match="pip install pyvista"):
        render(layer, tmp_path / "a.png")


def test_a_crash_of_vtk_is_one_sentence_after_all_windows_were_tried(layer, tmp_path, monkeypatch):
    tried = []

    def crash(module, job, kind, report):
        tried.append(kind)
        return -11, ""

    monkeypatch.setattr(elsewhere, "usable_windows", lambda: ["one", "two"])
    monkeypatch.setattr(elsewhere, "_start", crash)
    with pytest.raises(MissingLibrary, match="two ended with code -11.*libosmesa6"):
        render(layer, tmp_path / "a.png")
    assert tried == ["one", "two"]
    # a fault in the drawing is not blamed on libraries
    monkeypatch.setattr(elsewhere, "usable_windows", lambda: [None])
    monkeypatch.setattr(elsewhere, "_start", lambda *words: (1, "Traceback ...\nValueError: x"))
    with pytest.raises(RuntimeError, match="ValueError: x"):
        render(layer, tmp_path / "a.png")


def test_bodies_are_wrapped_whole_into_the_domain(tmp_path):
    path = write_layer(tmp_path / "run.vtkhdf", 60, frames=12)
    with open_run(path) as run:
        first, last = read_picture_data(run, 0, "state"), read_picture_data(run, -1, "state")
    size = last.high[:2]
    assert np.all(last.bodies[:, :2] >= 0.0) and np.all(last.bodies[:, :2] <= size)
    # Spheres keep their place in their body; rel 1e-9 of a radius: two subtractions of 1e-4 m in float64.
    np.testing.assert_allclose(last.centers - last.bodies[last.body], first.centers - first.bodies[first.body], atol=1e-9 * R)
    assert np.any(last.bodies[:, 0] < first.bodies[:, 0]), "some bodies must have come round"
    np.testing.assert_allclose(last.drag, [1.0, 0.0], atol=1e-12)
    # the close up holds about sixty bodies
    with open_run(write_layer(tmp_path / "run.vtkhdf", 900)) as run:
        picture = read_picture_data(run, 0, "state")
    low, high = close_up_window(picture)
    inside = np.all((picture.bodies[:, :2] >= low) & (picture.bodies[:, :2] <= high), axis=1).sum()
    # A window of the mean density holds 60; its edges cut a lattice of 28 um pitch: half a row either way.
    assert 40 <= inside <= 80


def test_fields_reasons_and_counts_in_the_legend(layer):
    with open_run(layer) as run:
        speed, utilisation, reasons = (read_picture_data(run, 0, color) for color in ("speed", "utilisation", "reason"))
        kept = read_picture_data(run, 0, "state_reason", scale=Legend(codes=(0, 1, 2)))
        gap = {"state_reason": np.array([0, 2], np.uint8)}
        gapped_colors, gapped, _ = compute_coloring(run, 0, "reason", gap, {}, np.arange(2), Legend())
        states, counts = read_picture_data(run, -1, "state"), np.bincount(run.states[-1], minlength=4)
        lengths, across = np.linalg.norm(run.bodies(0)["velocity"], axis=1), read_picture_data(run, 0, "velocity_y")
        assert across.legend.limits == (run.bodies(0)["velocity"][:, 1].min(), run.bodies(0)["velocity"][:, 1].max())
        assert across.legend.unit == "m/s"
        for name in ("quaternion_x", "state_x"):  # four components, of which the first is w; none
            with pytest.raises(InputError, match=f"no array '{name}'"):
                read_picture_data(run, 0, name)
    assert speed.legend.limits == (lengths.min(), lengths.max()) and speed.legend.unit == "m/s"
    ends = scale_colors(np.array(speed.legend.limits), speed.legend)
    assert ends.tolist() == field_colors(np.array([0.0, 1.0])).tolist()
    with open_run(layer) as run:
        film = read_picture_data(run, 0, "speed", scale=Legend(limits=(0.0, 9.0)))
    assert film.legend.limits == (0.0, 9.0)  # common to all frames
    # A body takes the larger of its two contacts; the scale holds for the tubes of both.
    assert utilisation.legend.limits == (0.75, 0.75)
    # categories with those that occur
    assert [words.split("  ")[0] for words, _ in reasons.legend.entries] == ["none", "friction limit", "rotation"]
    assert [tone for _, tone in reasons.legend.entries] == list(CATEGORY_COLORS[:3])
    assert kept.legend.entries == reasons.legend.entries
    # where a code does not occur the others keep the colours of their bodies
    assert [rgb(tone) for _, tone in gapped.entries] == [tuple(tone) for tone in gapped_colors]
    assert [tone for _, tone in gapped.entries] == [CATEGORY_COLORS[0], CATEGORY_COLORS[2]]
    assert [int(re.findall(r"  (\d+)  ", words)[0]) for words, _ in states.legend.entries] == list(counts)
    assert "10 µs" in states.facts and "20 µm" in states.facts and "0.31" in states.facts


def test_numbers_with_units_and_colours():
    for value, words in ((1.25e-5, "12.5 µm"), (9.9999e-7, "1 µm"), (0.0, "0 m"), (-2e-9, "-2 nm"), (1500.0, "1.5 km")):
        assert with_unit(value, "m") == words
    # colours
    assert state_colors(["sliding", "free"]) == [STATE_COLORS["sliding"], STATE_COLORS["free"]]
    assert len(set(state_colors(["free", "tipping", "locked"]))) == 3
    ends = field_colors(np.array([0.0, 1.0, np.nan]))
    assert ends.tolist() == [[68, 1, 84], [253, 231, 37], [215, 215, 215]]
    assert len(set(category_colors(10))) == 10 and category_colors(11)[10] == category_colors(10)[1]
