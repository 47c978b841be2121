"""Films have the frames that were asked for, one camera and one legend; a close-up shows the forces on one particle."""

import io
import sys
from types import SimpleNamespace

import numpy as np
import pytest
from layer import R, hue_share, skip_unless_drawable, write_layer
from PIL import Image
from thirdbody.api import open_run
from thirdbody.errors import InputError, MissingLibrary
from thirdbody.palette import STATE_COLORS
from thirdbody.render.film import frame_numbers, gif, mp4
from thirdbody.render.layout import compute_layout
from thirdbody.render.picture_data import force_tubes, nearest_image, read_close_up, read_picture_data, read_spots
from thirdbody.render.render import render


@pytest.fixture(scope="module")
def layer(tmp_path_factory):
    return write_layer(tmp_path_factory.mktemp("layer") / "run.vtkhdf", 60, frames=7)


def flat_pictures(count: int, size: tuple[int, int] = (64, 48)):
    for number in range(count):
        yield np.full((size[1], size[0], 3), (100 + 20 * number, 40, 40), np.uint8)


def gif_pictures(image) -> list[np.ndarray]:
    pictures = []
    for number in range(image.n_frames):
        image.seek(number)
        pictures.append(np.array(image.convert("RGB")))
    return pictures


def test_frames_are_named_as_python_slices_and_options_go_together(layer, tmp_path, monkeypatch):
    slices = {None: [0, 1, 2, 3, 4, 5, 6], "1:6:2": [1, 3, 5], "-3:": [4, 5, 6], "::3": [0, 3, 6], "::-3": [6, 3, 0]}
    assert {text: frame_numbers(text, 7) for text in slices} == slices
    for text in ("3", "a:b", "1:2:3:4", "::0", "9:12", "1.5:3"):
        with pytest.raises(InputError, match="frames: "):
            frame_numbers(text, 7)
    for name, options, message in (
        ("a.mp4", {"size": (801, 450)}, "even numbers"),
        ("a.gif", {"frame": 1}, "takes frames a:b:c"),
        ("a.mp4", {"frames": "5:2"}, "leaves none of the 7 frames"),
        ("a.html", {"forces": True}, "not in .html"),
    ):
        with pytest.raises(InputError, match=message):
            render(layer, tmp_path / name, **options)
    monkeypatch.setitem(sys.modules, "av", None)
    with pytest.raises(MissingLibrary, match=r'MP4 needs PyAV .*: pip install "thirdbody\[film\]", or name a .gif'):
        render(layer, tmp_path / "a.mp4")


@pytest.mark.full(kind="slow")
def test_an_mp4_and_a_gif_keep_count_order_size_and_rate():
    av = pytest.importorskip("av")
    content = mp4(flat_pictures(5), 10)
    with av.open(io.BytesIO(content)) as container:
        red = [frame.to_ndarray(format="rgb24")[:, :, 0].mean() for frame in container.decode(video=0)]
    # Y'CbCr in 8 bits with a limited range: some three of 255.
    assert red == pytest.approx([100, 120, 140, 160, 180], abs=4)
    with av.open(io.BytesIO(content)) as container:
        stream = container.streams.video[0]
        assert (stream.width, stream.height, float(stream.average_rate)) == (64, 48, 10.0)
        assert stream.codec_context.pix_fmt == "yuv420p"  # others do not play everywhere
    image = Image.open(io.BytesIO(gif(flat_pictures(5), 10)))
    assert (image.n_frames, image.size, image.info["duration"]) == (5, (64, 48), 100)
    red = [picture[:, :, 0].mean() for picture in gif_pictures(image)]
    assert red == pytest.approx([100, 120, 140, 160, 180], abs=1)  # five colours fit a palette


def test_one_plan_holds_what_all_frames_need(layer):
    with open_run(layer) as run:
        shots = [read_picture_data(run, number, "state") for number in range(run.frames)]
        layout = compute_layout(iter(shots), "iso", None)
        speeds = [read_picture_data(run, number, "speed").legend for number in range(2)]
    assert np.all([np.all(layout.low <= picture.low) and np.all(layout.high >= picture.high) for picture in shots])
    assert np.allclose(layout.directions, [[1.0, 0.0]])
    # zoom keeps the middle of the domain
    half = compute_layout(iter(shots), "iso", 0.5)
    np.testing.assert_allclose([half.low[:2], half.high[:2]], np.outer([0.25, 0.75], layout.high[:2]), rtol=1e-9)
    assert (speeds[0] | speeds[1]).limits == (min(s.limits[0] for s in speeds), max(s.limits[1] for s in speeds))


def test_a_film_moves_its_bodies_and_nothing_else(layer, tmp_path):
    skip_unless_drawable()
    told: list[tuple[int, int]] = []
    options = {"size": (480, 270), "frames": "0:6:2", "fps": 5}
    film = render(layer, tmp_path / "a.gif", **options, progress=lambda done, total: told.append((done, total)))
    assert told == [(1, 3), (2, 3), (3, 3)]  # each picture when it is drawn
    assert Image.open(film).info["duration"] == 200  # ms, of five pictures a second
    pictures = gif_pictures(Image.open(film))
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


@pytest.mark.full(kind="slow")
def test_a_body_is_followed_or_passes_by(layer, tmp_path):
    skip_unless_drawable()
    moved = {}
    for camera in ("follow", "fixed"):
        film = Image.open(render(layer, tmp_path / f"{camera}.gif", size=(480, 270), frames="0:2", body=30, camera=camera))
        colored = [np.ptp(pixels.astype(int)[45:230, :320], axis=2) > 70 for pixels in gif_pictures(film)]
        places = [np.argwhere(there)[:, 1].mean() for there in colored]
        moved[camera] = places[1] - places[0]
    # The plate's own edges move with a camera that follows, the neighbours by less than a pixel.
    assert abs(moved["follow"]) < 4.0 < moved["fixed"]


def test_the_spots_of_a_body_and_their_cones(layer):
    with open_run(layer) as run:
        one = read_close_up(run, -1, 7, "state")
    spots = one.spots
    assert spots.against == ["lower plate", "upper plate"]
    # 7.5 uN are three quarters, 2.5 uN one quarter of the same limit: a cone with the half angle atan 0.1.
    assert spots.limit == pytest.approx([1e-5, 1e-5], rel=1e-12)
    assert np.einsum("ij,ij->i", spots.force, spots.normal) == pytest.approx([1e-4, 1e-4], rel=1e-12)  # rounding of a product
    assert np.all(np.abs(spots.position - one.center)[:, 2] == pytest.approx(R, rel=1e-9))  # wrapped like its body


def test_the_other_body_of_a_contact_feels_the_opposite_force_at_the_nearest_image():
    contacts = {"position": np.array([[10.0, 5.0, 0.0]]), "body": np.array([1]), "partner": np.array([0]),
                "force": np.array([[3.0, 0.0, 4.0]])}  # fmt: skip
    bodies = {"position": np.array([[9.9, 5.0, 0.0], [0.1, 5.0, 0.0]]), "id": np.array([0, 1])}
    one = {"normal": np.array([[0.6, 0.0, 0.8]]), "normal_force": [5.0], "utilisation": [0.0], "contact_radius": [1.0]}
    run = SimpleNamespace(contacts=lambda frame: contacts | {name: np.array(values) for name, values in one.items()})
    owner, partner = (read_spots(run, 0, body, bodies["position"][body], None) for body in (1, 0))
    assert owner.force.tolist() == [[3.0, 0.0, 4.0]] and partner.force.tolist() == [[-3.0, 0.0, -4.0]]
    tubes = force_tubes(contacts, bodies, np.zeros((2, 3)), np.array([10.0, 10.0]))
    assert tubes.force == pytest.approx([5.0, 5.0], rel=1e-12)
    # One tube from each centre to the contact between them, across the edge of the domain: 0.1 each, not 9.9.
    assert np.linalg.norm(tubes.end - tubes.start, axis=1) == pytest.approx([0.1, 0.1], rel=1e-9)
    assert tubes.full_scale == pytest.approx(5.0, rel=1e-12)
    path = np.array([[9.0, -6.0, 3.0], [4.9, 5.1, -7.0]])
    np.testing.assert_allclose(nearest_image(path, np.array([10.0, 10.0])), [[-1.0, 4.0, 3.0], [4.9, -4.9, -7.0]], atol=1e-12)
    assert nearest_image(path, None) is path


def test_a_close_up_is_drawn_with_spots_in_the_colour_of_sticking(layer, tmp_path):
    skip_unless_drawable()
    with open_run(layer) as run:
        number = int(np.flatnonzero(run.states[0] == 2)[0])  # does not stick: blue are its two spots, their cones and numbers
    pixels = np.array(Image.open(render(layer, tmp_path / "a.png", size=(800, 450), body=number)).convert("RGB"))
    assert pixels.shape == (450, 800, 3)
    scene = pixels[60:380, :540]
    # The numbers of two spots alone are 0.15 % of the scene; the light plates are no blue of 25 steps.
    assert hue_share(scene, STATE_COLORS["sticking"]) > 0.004
    assert hue_share(scene, STATE_COLORS["sliding"]) > 0.01


def test_a_run_without_forces_says_so(layer, tmp_path):
    with open_run(layer) as run:
        with pytest.raises(InputError, match="no body 60; ids are 0 to 59"):
            read_close_up(run, -1, 60, "state")
        contacts = run.contacts(0)
    del contacts["force"]
    with pytest.raises(InputError, match="recorded no forces"):
        force_tubes(contacts, {"position": np.zeros((60, 3))}, np.zeros((60, 3)), None)
