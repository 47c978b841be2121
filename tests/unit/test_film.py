"""Films have the frames that were asked for, and one camera and one legend over all of them."""

from __future__ import annotations

import io
import sys

import numpy as np
import pytest
from layer import hue_share, skip_unless_drawable, write_layer

from thirdbody.errors import InputError, MissingLibrary
from thirdbody.palette import STATE_COLORS
from thirdbody.render.coloring import LegendScale
from thirdbody.render.film import frame_numbers, gif, mp4
from thirdbody.render.film_progress import film_bar
from thirdbody.render.layout import compute_layout
from thirdbody.render.picture_data import read_picture_data
from thirdbody.render.render import render
from thirdbody.trajectory.reader import open_run


@pytest.fixture(scope="module")
def layer(tmp_path_factory):
    return write_layer(tmp_path_factory.mktemp("layer") / "run.vtkhdf", 60, frames=7)


def flat_pictures(count: int, size: tuple[int, int] = (64, 48)):
    """Pictures of one colour each, from dark to light red."""
    for number in range(count):
        yield np.full((size[1], size[0], 3), (100 + 20 * number, 40, 40), np.uint8)


def mp4_pictures(content: bytes) -> list[np.ndarray]:
    av = pytest.importorskip("av")
    with av.open(io.BytesIO(content)) as container:
        return [frame.to_ndarray(format="rgb24") for frame in container.decode(video=0)]


@pytest.mark.parametrize(
    ("text", "numbers"),
    [(None, [0, 1, 2, 3, 4, 5, 6]), ("1:6:2", [1, 3, 5]), ("-3:", [4, 5, 6]), ("::3", [0, 3, 6]), ("::-3", [6, 3, 0])],
)
def test_frames_are_named_as_python_slices(text, numbers):
    assert frame_numbers(text, 7) == numbers


@pytest.mark.parametrize("text", ["3", "a:b", "1:2:3:4", "::0", "9:12", "1.5:3"])
def test_frames_that_cannot_be(text):
    with pytest.raises(InputError, match="frames: "):
        frame_numbers(text, 7)


def test_an_mp4_keeps_count_order_size_and_rate():
    av = pytest.importorskip("av")
    content = mp4(flat_pictures(5), 10)
    red = [picture[:, :, 0].mean() for picture in mp4_pictures(content)]
    # Y'CbCr in 8 bits with a limited range: some three of 255.
    assert red == pytest.approx([100, 120, 140, 160, 180], abs=4)
    with av.open(io.BytesIO(content)) as container:
        stream = container.streams.video[0]
        assert (stream.width, stream.height, float(stream.average_rate)) == (64, 48, 10.0)
        assert stream.codec_context.pix_fmt == "yuv420p"  # others do not play everywhere


def test_a_gif_keeps_count_order_size_and_rate():
    image = pytest.importorskip("PIL.Image").open(io.BytesIO(gif(flat_pictures(5), 10)))
    assert (image.n_frames, image.size, image.info["duration"]) == (5, (64, 48), 100)
    red = []
    for number in range(5):
        image.seek(number)
        red.append(np.array(image.convert("RGB"))[:, :, 0].mean())
    assert red == pytest.approx([100, 120, 140, 160, 180], abs=1)  # five colours fit a palette


def test_without_pyav_one_sentence_names_what_to_do(monkeypatch):
    monkeypatch.setitem(sys.modules, "av", None)
    with pytest.raises(MissingLibrary, match="pip install av, or name a .gif"):
        mp4(flat_pictures(1), 10)


def test_one_plan_holds_what_all_frames_need(layer):
    with open_run(layer) as run:
        shots = [read_picture_data(run, number, "state") for number in range(run.frames)]
        layout = compute_layout(iter(shots), (320, 240), "iso", None)
        speeds = [read_picture_data(run, number, "speed").legend.scale for number in range(2)]
    assert np.all([np.all(layout.low <= picture.low) and np.all(layout.high >= picture.high) for picture in shots])
    assert np.allclose(layout.directions, [[1.0, 0.0]])
    both = speeds[0] | speeds[1]
    assert both.limits == (min(s.limits[0] for s in speeds), max(s.limits[1] for s in speeds))
    assert (LegendScale((1.0, 2.0)) | LegendScale(None, frozenset({3}))) == LegendScale((1.0, 2.0), frozenset({3}))


@pytest.mark.parametrize("suffix", [".gif", ".mp4"])
def test_a_film_moves_its_bodies_and_nothing_else(layer, tmp_path, suffix):
    skip_unless_drawable()
    film = render(layer, tmp_path / f"a{suffix}", size=(480, 270), frames="0:6:2", fps=5)
    if suffix == ".mp4":
        pictures = mp4_pictures(film.read_bytes())
    else:
        image = pytest.importorskip("PIL.Image").open(film)
        pictures = []
        for number in range(image.n_frames):
            image.seek(number)
            pictures.append(np.array(image.convert("RGB")))
    assert len(pictures) == 3 and pictures[0].shape == (270, 480, 3)
    for state in ("sticking", "sliding", "rolling"):
        assert hue_share(pictures[2], STATE_COLORS[state]) > 0.005, state
    change = np.abs(pictures[2].astype(int) - pictures[0]).max(axis=2)
    middle = change[60:210]
    # Bodies that moved by two radii change a good part of the scene; the legend (its counts stay) changes nowhere by more
    # than the encoder's own noise at the edges of letters, a figure that changed by two hundred.
    assert np.mean(middle > 40) > 0.01
    assert change[-25:].max() < 80
    assert sorted(path.name for path in tmp_path.iterdir()) == [film.name]


def test_a_film_reports_how_far_it_is(layer, tmp_path):
    """Each picture is told when it is drawn; without a terminal no bar is drawn."""
    report: list[tuple[int, int]] = []
    skip_unless_drawable()
    render(layer, tmp_path / "a.gif", size=(320, 200), progress=lambda done, total: report.append((done, total)))
    with open_run(layer) as run:
        assert report == [(k + 1, run.frames) for k in range(run.frames)]


def test_a_bar_is_drawn_at_a_terminal_only(monkeypatch, capsys):
    class Terminal(io.StringIO):
        def isatty(self):
            return True

    with film_bar("a.mp4") as report:
        assert report is None
    screen = Terminal()
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setattr("sys.stderr", screen)
    with film_bar("a.mp4") as report:
        for done in range(1, 4):
            report(done, 3)
    assert "a.mp4" in screen.getvalue() and "3/3" in screen.getvalue()


def test_a_body_is_followed_or_passes_by(layer, tmp_path):
    """Followed, the particle stays where it is in the picture; before a fixed camera it goes along."""
    skip_unless_drawable()
    image = pytest.importorskip("PIL.Image")
    moved = {}
    for camera in ("follow", "fixed"):
        film = image.open(render(layer, tmp_path / f"{camera}.gif", size=(480, 270), frames="0:2", body=30, camera=camera))
        places = []
        for number in range(2):
            film.seek(number)
            pixels = np.array(film.convert("RGB")).astype(int)[45:230, :320]
            colored = np.ptp(pixels, axis=2) > 70
            places.append(np.argwhere(colored)[:, 1].mean())
        moved[camera] = places[1] - places[0]
    # The plate's own edges move with a camera that follows, the neighbours by less than a pixel.
    assert abs(moved["follow"]) < 4.0 < moved["fixed"]


@pytest.mark.parametrize(
    ("name", "options", "message"),
    [
        ("a.mp4", {"size": (801, 450)}, "even numbers"),
        ("a.gif", {"frame": 1}, "takes frames a:b:c"),
        ("a.mp4", {"frames": "5:2"}, "leaves none of the 7 frames"),
        ("a.html", {"forces": True}, "not in .html"),
    ],
)
def test_options_that_do_not_go_together(layer, tmp_path, name, options, message):
    with pytest.raises(InputError, match=message):
        render(layer, tmp_path / name, **options)
