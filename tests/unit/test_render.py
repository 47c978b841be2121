"""Pictures show the states in their colours, and what cannot be drawn is told in one sentence."""

from __future__ import annotations

import re
import subprocess
import sys

import numpy as np
import pytest

from thirdbody.errors import InputError, MissingLibrary, OutputError
from thirdbody.output import render as render_module
from thirdbody.output.palette import STATE_COLORS, field_colors, rgb, state_colors
from thirdbody.output.render import render
from thirdbody.output.run import open_run
from thirdbody.output.schema import Frame
from thirdbody.output.shot import close_up_window, round_length, take_shot, with_unit
from thirdbody.output.vtkhdf import TrajectoryWriter

R = 11e-6


def clump_layer(count: int, per_clump: int = 6):
    """A jittered layer of clumps: sphere centres, radii, clump of each, body centres, states, domain."""
    rng = np.random.default_rng(3)
    nx = int(np.ceil(np.sqrt(count * 1.5)))
    ny = -(-count // nx)
    pitch = 2.6 * R
    grid = np.stack(np.meshgrid(np.arange(nx), np.arange(ny), indexing="ij"), -1).reshape(-1, 2)[:count]
    flat = (grid + 0.5) * pitch + rng.normal(0.0, 0.1 * R, (count, 2))
    bodies = np.column_stack([flat, rng.uniform(1.05, 1.3, count) * R])
    way = rng.normal(size=(count, per_clump, 3))
    way /= np.linalg.norm(way, axis=2, keepdims=True)
    offset = way * rng.uniform(0.25, 0.55, (count, per_clump, 1)) * R
    radii = R * rng.uniform(0.38, 0.62, (count, per_clump))
    wave = np.sin(flat[:, 0] / 95e-6) + np.cos(flat[:, 1] / 120e-6 + 1.0) + rng.normal(0.0, 0.45, count)
    states = (1 + np.digitize(wave, [-0.6, 0.75])).astype(np.uint8)
    states[rng.random(count) < 0.04] = 0
    centers = (bodies[:, None] + offset).reshape(-1, 3)
    owner = np.repeat(np.arange(count), per_clump)
    return centers, radii.ravel(), owner, bodies, states, np.array([nx, ny]) * pitch


def write_layer(path, count: int, frames: int = 2):
    """A run of `count` clumps between plates; from frame to frame all slide along x and leave the domain."""
    centers, radii, owner, bodies, states, size = clump_layer(count)
    rng = np.random.default_rng(5)
    gap = float((centers[:, 2] + radii).max())
    header = {
        "scene_text": "scene = 1\n",
        "title": "Wear debris under a load of 0.1 mN per particle",
        "state_names": list(STATE_COLORS),
        "reason_names": ["none"],
        "units": {"distance": "m"},
        "domain": {"size": size, "periodic": True},
    }
    static = {"spheres": {"radius": radii, "clump": owner}, "clumps": {"id": np.arange(count)}}
    corners = np.array([[0, 0, 0], [size[0], 0, 0], [size[0], size[1], 0], [0, size[1], 0]], float)
    touching = np.repeat(np.arange(count), 2)
    with TrajectoryWriter(path, header, static) as writer:
        for number in range(frames):
            shift = np.array([10e-6 * number, 0.0, 0.0])
            upper = corners + [2 * shift[0], 0.0, gap]
            writer.append(
                Frame(
                    time=10e-6 * number,
                    spheres={"points": centers + shift},
                    clumps={
                        "points": bodies + shift,
                        "state": states,
                        "velocity": rng.normal(size=(count, 3)),
                        "friction_work": np.abs(bodies[:, 0]) * 1e-6,
                    },
                    contacts={
                        "points": bodies[touching],
                        "body": touching,
                        "partner": np.full(2 * count, -1),
                        "utilisation": np.tile([0.25, 0.75], count),
                    },
                    plates={"points": np.concatenate([corners, upper])},
                    series={"distance": 20e-6 * number, "friction_coefficient": 0.31},
                )
            )
    return path


@pytest.fixture(scope="module")
def layer(tmp_path_factory):
    return write_layer(tmp_path_factory.mktemp("layer") / "run.vtkhdf", 200)


def read_pixels(path) -> np.ndarray:
    vtk = pytest.importorskip("vtk")
    from vtkmodules.util.numpy_support import vtk_to_numpy

    reader = vtk.vtkPNGReader()
    reader.SetFileName(str(path))
    reader.Update()
    image = reader.GetOutput()
    width, height, _ = image.GetDimensions()
    return vtk_to_numpy(image.GetPointData().GetScalars()).reshape(height, width, -1)[::-1, :, :3]


def skip_unless_drawable():
    try:
        render_module.usable_windows()
    except MissingLibrary as error:
        pytest.skip(str(error))


def hue_share(pixels: np.ndarray, color: str) -> float:
    """Share of the pixels with the hue of `color`, at any brightness: light changes brightness only."""
    flat = pixels.reshape(-1, 3).astype(float)
    direction = flat - flat.mean(axis=1, keepdims=True)
    aim = np.array(rgb(color), float)
    aim -= aim.mean()
    strength = np.linalg.norm(direction, axis=1)
    cosine = direction @ aim / np.maximum(strength * np.linalg.norm(aim), 1e-9)
    # 25 grey steps of colour: the bluish plates have less; cosine 0.95 is 18 degrees, the hues lie 90 apart.
    return float(np.mean((strength > 25.0) & (cosine > 0.95)))


def test_a_picture_shows_every_state_in_its_colour(layer, tmp_path):
    skip_unless_drawable()
    picture = render(layer, tmp_path / "a.png", size=(800, 450))
    pixels = read_pixels(picture)
    assert pixels.shape == (450, 800, 3)
    for state in ("sticking", "sliding", "rolling"):
        # The discs of the legend alone are 0.03 % of the picture; bodies of each state cover far more.
        assert hue_share(pixels, STATE_COLORS[state]) > 0.005, state
    # Title and facts stand in the upper, the legend in the lower tenth.
    assert pixels[:45].min() < 100 and pixels[-45:].min() < 100


def test_a_zoomed_picture_and_a_field(layer, tmp_path):
    skip_unless_drawable()
    pixels = read_pixels(render(layer, tmp_path / "b.png", color="friction_work", size=(640, 360), zoom=0.3))
    assert pixels.shape == (360, 640, 3)
    assert hue_share(pixels, STATE_COLORS["sliding"]) < 0.005


def test_only_png(layer, tmp_path):
    with pytest.raises(InputError, match="PNG only"):
        render(layer, tmp_path / "a.svg")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"frame": 2}, "no frame 2"),
        ({"color": "utilization"}, "did you mean 'utilisation'"),
        ({"zoom": 0.0}, "zoom"),
        ({"size": (10, 10)}, "too small"),
    ],
)
def test_options_that_cannot_be(layer, tmp_path, options, message):
    with pytest.raises(InputError, match=message):
        render(layer, tmp_path / "a.png", **options)


def test_a_folder_that_is_not_there(layer, tmp_path):
    with pytest.raises(OutputError, match="does not exist"):
        render(layer, tmp_path / "absent" / "a.png")


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="only Linux needs these libraries")
def test_missing_libraries_are_named(layer, tmp_path, monkeypatch):
    monkeypatch.setattr(render_module, "_loads", lambda library: False)
    with pytest.raises(MissingLibrary, match="libegl1.*libosmesa6"):
        render(layer, tmp_path / "a.png")


def test_a_crash_of_vtk_is_one_sentence_after_all_windows_were_tried(layer, tmp_path, monkeypatch):
    tried = []

    def crash(job, kind):
        tried.append(kind)
        return subprocess.CompletedProcess([], -11, "", "")

    monkeypatch.setattr(render_module, "usable_windows", lambda: ["one", "two"])
    monkeypatch.setattr(render_module, "_start", crash)
    with pytest.raises(MissingLibrary, match="two ended with code -11.*libosmesa6"):
        render(layer, tmp_path / "a.png")
    assert tried == ["one", "two"]


def test_a_fault_in_the_drawing_is_not_blamed_on_libraries(layer, tmp_path, monkeypatch):
    fault = subprocess.CompletedProcess([], 1, "", "Traceback ...\nValueError: x")
    monkeypatch.setattr(render_module, "usable_windows", lambda: [None])
    monkeypatch.setattr(render_module, "_start", lambda job, kind: fault)
    with pytest.raises(RuntimeError, match="ValueError: x"):
        render(layer, tmp_path / "a.png")


def test_bodies_are_wrapped_whole_into_the_domain(tmp_path):
    path = write_layer(tmp_path / "run.vtkhdf", 60, frames=12)
    with open_run(path) as run:
        first, last = take_shot(run, 0, "state"), take_shot(run, -1, "state")
    size = last.high[:2]
    assert np.all(last.bodies[:, :2] >= 0.0) and np.all(last.bodies[:, :2] <= size)
    # Spheres keep their place in their body; rel 1e-9 of a radius: two subtractions of 1e-4 m in float64.
    np.testing.assert_allclose(
        last.centers - last.bodies[last.body], first.centers - first.bodies[first.body], atol=1e-9 * R
    )
    assert np.any(last.bodies[:, 0] < first.bodies[:, 0]), "some bodies must have come round"
    np.testing.assert_allclose(last.drag, [1.0, 0.0], atol=1e-12)


def test_fields_of_bodies_and_contacts(layer):
    with open_run(layer) as run:
        speed = take_shot(run, 0, "speed")
        utilisation = take_shot(run, 0, "utilisation")
        velocity = run.bodies(0)["velocity"]
    lengths = np.linalg.norm(velocity, axis=1)
    assert speed.legend.limits == (lengths.min(), lengths.max())
    assert utilisation.legend.limits == (0.75, 0.75)  # the larger of a body's two contacts


def test_the_legend_counts_the_states(layer):
    with open_run(layer) as run:
        shot = take_shot(run, -1, "state")
        counts = np.bincount(run.states[-1], minlength=4)
    numbers = [int(re.findall(r"  (\d+)  ", words)[0]) for words, _ in shot.legend.entries]
    assert numbers == list(counts)
    assert "10 µs" in shot.facts and "20 µm" in shot.facts and "0.31" in shot.facts


def test_the_close_up_holds_about_sixty_bodies(tmp_path):
    with open_run(write_layer(tmp_path / "run.vtkhdf", 900)) as run:
        shot = take_shot(run, 0, "state")
    low, high = close_up_window(shot)
    inside = np.all((shot.bodies[:, :2] >= low) & (shot.bodies[:, :2] <= high), axis=1).sum()
    # A window of the mean density holds 60; its edges cut a lattice of 28 um pitch: half a row either way.
    assert 40 <= inside <= 80


@pytest.mark.parametrize(
    ("value", "words"),
    [(1.25e-5, "12.5 µm"), (9.9999e-7, "1 µm"), (0.0, "0 m"), (-2e-9, "-2 nm"), (1500.0, "1.5 km")],
)
def test_numbers_with_units(value, words):
    assert with_unit(value, "m") == words


@pytest.mark.parametrize(("longest", "length"), [(1.0, 1.0), (4.9, 2.0), (7.3e-5, 5e-5), (1e-4, 1e-4)])
def test_round_lengths(longest, length):
    assert round_length(longest) == pytest.approx(length, rel=1e-12)  # one product of two floats


def test_colours():
    assert state_colors(["sliding", "free"]) == [STATE_COLORS["sliding"], STATE_COLORS["free"]]
    assert len(set(state_colors(["free", "tipping", "locked"]))) == 3
    ends = field_colors(np.array([0.0, 1.0, np.nan]))
    assert ends.tolist() == [[68, 1, 84], [253, 231, 37], [215, 215, 215]]
