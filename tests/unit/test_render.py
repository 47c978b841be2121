"""Pictures show the states in their colours, or say in a sentence why not; states by population, material and size."""

import csv
import json
import re
import sys
from types import SimpleNamespace

import h5py
import numpy as np
import pytest
from layer import R, hue_share, skip_unless_drawable, write_layer
from matplotlib.colors import to_hex
from PIL import Image
from steel import SCENES
import thirdbody
from thirdbody.api import open_run
from thirdbody.errors import InputError, MissingLibrary, OutputError
from thirdbody.export.tables import export_csv
from thirdbody.palette import CATEGORY_COLORS, FORCE_COLORS, STATE_COLORS, category_colors, field_colors, rgb, state_colors
from thirdbody.plot.summary_page import page
from thirdbody.render import elsewhere
from thirdbody.render.coloring import Legend, compute_coloring, scale_colors
from thirdbody.render.layout import close_up_window
from thirdbody.render.picture_data import read_picture_data
from thirdbody.render.render import render
from thirdbody.report.tables import run_report, states_report
from thirdbody.trajectory.names import Frame
from thirdbody.trajectory.states import _load_fractions, _size_classes, states_by_group
from thirdbody.trajectory.writer import TrajectoryWriter
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
    both = plain, render(layer, tmp_path / "b.png", frame=0, size=(800, 450), view=view, forces=True)
    dark = [np.all(np.abs(read_pixels(drawn).astype(int) - rgb(FORCE_COLORS[1])) < 40, axis=2).mean() for drawn in both]
    assert dark[1] > dark[0] + 0.003  # a hundred tubes of some 3 by 20 pixels, half of them hidden


def test_options_that_cannot_be_and_missing_libraries_are_named(layer, tmp_path, monkeypatch):
    for options, message in [
        ({"frame": 2}, "no frame 2"), ({"color": "utilization"}, "did you mean 'utilisation'"), ({"zoom": 0.0}, "zoom"),
        ({"size": (10, 10)}, "outside 200 to 8192"), ({"view": "tpo"}, "did you mean 'top'"),
        ({"camera": "follow"}, "needs the body"), ({"camera": "loose", "body": 3}, "neither fixed nor follow"),
        ({"frames": "0:2"}, "shows one frame"), ({"fps": 0}, "fps"), ({"body": 200}, "no body 200; ids are 0 to 199"),
        ({"body": 3, "forces": True}, "leave out forces"),
    ]:  # fmt: skip
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
    with open_run(write_layer(tmp_path / "run.vtkhdf", 60, frames=12)) as run:
        first, last = read_picture_data(run, 0, "state"), read_picture_data(run, -1, "state")
    assert np.all(last.bodies[:, :2] >= 0.0) and np.all(last.bodies[:, :2] <= last.high[:2])
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
    for value, words in ((1.25e-5, "12.5 µm"), (9.9999e-7, "1 µm"), (0.0, "0 m"), (-2e-9, "\u22122 nm"), (1500.0, "1.5 km")):
        assert with_unit(value, "m") == words
    # colours
    assert state_colors(["sliding", "free"]) == [STATE_COLORS["sliding"], STATE_COLORS["free"]]
    assert len(set(state_colors(["free", "tipping", "locked"]))) == 3
    assert field_colors(np.array([0.0, 1.0, np.nan])).tolist() == [[68, 1, 84], [253, 231, 37], [215, 215, 215]]
    assert len(set(category_colors(10))) == 10 and category_colors(11)[10] == category_colors(10)[1]


SCENE = """
scene = 1
[[debris]]
material = "bronze"
kind = "irregular"
[[debris]]
material = "alumina"
kind = "spheres"
[[debris]]
material = "alumina"
kind = "spheres"
"""
SOFT, HARD, DUST = 10, 6, 4
POPULATION = np.repeat([0, 1, 2], [SOFT, HARD, DUST])
STATE = np.repeat([2, 3, 2, 3, 0], [7, 3, 1, 5, DUST]).astype(np.uint8)  # 7 of 10 soft slide, 5 of 6 hard roll, dust is free
SIZE = 1e-6 * np.concatenate([np.linspace(4.0, 5.0, SOFT), np.linspace(6.0, 7.0, HARD), np.linspace(1.0, 2.0, DUST)])
NAMES = ["soft debris", "hard grains", "dust"]


def write(folder, **header):
    """Three populations of two materials; only soft and hard bodies touch the upper plate, hard ones press twice as hard."""
    folder.mkdir()
    bodies = len(POPULATION)
    head = {"scene_text": SCENE, "state_names": ["free", "sticking", "sliding", "rolling"], "reason_names": ["none"],
            "units": {"distance": "m"}, "materials": ["steel", "bronze", "alumina"]} | header  # fmt: skip
    clumps = {"id": np.arange(bodies), "population": POPULATION, "material": np.minimum(POPULATION + 1, 2), "diameter": SIZE}
    static = {"spheres": {"radius": 0.5 * SIZE, "clump": np.arange(bodies)}, "clumps": clumps}
    touching = np.flatnonzero(POPULATION < 2)
    force = np.where(POPULATION[touching] == 1, 2.0, 1.0)
    places = 1e-5 * np.column_stack([np.arange(bodies), np.ones(bodies), np.ones(bodies)])
    with TrajectoryWriter(folder / "run.vtkhdf", head, static) as writer:
        for number in range(3):
            contacts = {"points": places[touching], "body": touching, "partner": np.full(len(touching), -2)}
            contacts |= {"side": np.ones(len(touching), np.uint8), "normal_force": force, "utilisation": np.ones(len(touching))}
            labels = {"state": STATE, "state_reason": np.zeros(bodies, np.uint8)}
            series = {"distance": 1e-6 * number, "friction_coefficient": 0.2, "upper_force": np.array([0.0, 0.0, 1.0])}
            series |= {f"fraction_{name}": np.mean(STATE == k) for k, name in enumerate(head["state_names"])}
            writer.append(Frame(1e-6 * number, {"points": places}, {"points": places} | labels, contacts, None, series))
        writer.finish({"wall_time": 1.0, "steps": 1, "sphere_steps_per_second": 1.0, "energy_residual": 0.0})
    return folder


@pytest.fixture
def folder(tmp_path):
    return write(tmp_path / "run", populations=NAMES)


def test_summary_and_first_screens_report_states_by_population_material_and_size(folder, capsys):
    with thirdbody.open(folder) as run:
        found = run.summary()
    soft, hard, dust = found["populations"]
    assert [row["name"] for row in found["populations"]] == NAMES
    assert soft["fractions"] == {"free": 0.0, "sticking": 0.0, "sliding": 0.7, "rolling": 0.3} and soft["bodies"] == SOFT
    assert hard["fractions"]["rolling"] == 5 / 6 and hard["material"] == "alumina" and dust["fractions"]["free"] == 1.0
    # 10 forces of one, 6 of two
    assert [row["load_share"] for row in found["populations"]] == pytest.approx([10 / 22, 12 / 22, 0.0])
    bronze, alumina = found["materials"]
    assert bronze["name"] == "bronze" and alumina["bodies"] == HARD + DUST and alumina["fractions"]["rolling"] == 0.5
    sizes = found["sizes"]
    assert [row["bodies"] for row in sizes] == [5, 5, 5, 5] and sizes[0]["smallest"] == 1e-6 and sizes[-1]["largest"] == 7e-6
    # of the smallest five four are dust; of the largest five all are hard, and the one that slides is not among them
    assert sizes[0]["fractions"]["free"] == 0.8 and sizes[-1]["fractions"]["rolling"] == 1.0
    # one size within 2 %, at least five bodies in a class; the load is that of the upper plate, side 1
    assert [len(_size_classes(np.linspace(1, *ends))) for ends in ((1.019, 20), (1.021, 20), (1.5, 19), (1.5, 9))] == [0, 4, 3, 0]
    contacts = {"side": np.array([0, 0, 1, 1]), "body": np.array([0, 1, 0, 1]), "normal_force": np.array([5.0, 5.0, 3.0, 1.0])}
    assert _load_fractions(SimpleNamespace(block=lambda *_: contacts), 2).tolist() == [0.75, 0.25]
    # the first screens report it
    run_report(folder, json=False)
    out = capsys.readouterr().out
    assert "hard grains" in out and "83 % rolling, 17 % sliding (of 6, 55 % of the load)" in out and "70 % sliding" in out
    states_report(folder, None, json=False)
    out = capsys.readouterr().out
    assert out.index("by population") < out.index("by material") < out.index("by size") < out.index("frame  time")
    assert out.splitlines()[2].split() == ["soft", "debris", "10", "45.5", "%", "0", "%", "0", "%", "70", "%", "30", "%"]
    states_report(folder, None, json=True)
    assert json.loads(capsys.readouterr().out)["populations"][1]["name"] == "hard grains"
    states_report(folder, -1, json=False)
    assert "hard grains" in capsys.readouterr().out


def test_page_pictures_and_tables_name_them(folder, tmp_path):
    with thirdbody.open(folder) as run:
        axes = next(axes for axes in page(run).axes if axes.get_label() == "groups")
        title = axes.get_title(loc="left").replace("\N{NO-BREAK SPACE}", " ")
        assert title == "At the last frame: soft debris 70 % sliding; hard grains 83 % rolling; dust 100 % free"
        bars = [patch.get_width() for patch in axes.patches]
        assert bars[:8] == pytest.approx([0.0, 0.0, 0.7, 0.3, 0.0, 0.0, 1 / 6, 5 / 6])
        assert [to_hex(patch.get_facecolor()).upper() for patch in axes.patches[:4]] == list(STATE_COLORS.values())
        rows = [text.get_text().replace("\N{NO-BREAK SPACE}", " ") for text in axes.get_yticklabels()]
        assert rows[:2] == ["soft debris: 10, 45 % of load", "hard grains: 6, 55 % of load"] and axes.yaxis_inverted()
        legends = {color: read_picture_data(run, -1, color).legend.entries for color in ("population", "material")}
        assert [words for words, _ in legends["population"]] == [
            "soft debris  10  (50 %)", "hard grains  6  (30 %)", "dust  4  (20 %)",
        ]  # fmt: skip
        assert [words.split()[0] for words, _ in legends["material"]] == ["bronze", "alumina"]
        assert read_picture_data(run, -1, "state").labels[SOFT] == "sliding, hard grains"
        export_csv(run, tmp_path / "csv")
        row = list(csv.DictReader((tmp_path / "csv" / "bodies.csv").open()))[-1]
        assert (row["population_name"], row["material_name"]) == ("dust", "alumina")


def test_runs_of_earlier_versions_and_damaged_ones(folder, tmp_path):
    with thirdbody.open(write(tmp_path / "old")) as run:
        assert run.population_names == ["bronze (irregular)", "alumina (spheres)", "alumina (spheres) 2"]
    with thirdbody.open(write(tmp_path / "none", scene_text="[nonsense")) as run:  # no names at all: numbers, and no failure
        assert [row["name"] for row in states_by_group(run)["population"]] == ["0", "1", "2"]
    with h5py.File(folder / "run.vtkhdf", "r+") as file:
        file["VTKHDF/contacts/PointData/body"][...] = 10**6
    with thirdbody.open(folder) as run, pytest.raises(InputError, match="damaged at bodies and contacts"):
        run.summary()


def test_a_scene_names_its_populations():
    scene = thirdbody.Scene.load(SCENES / "mixed_population.toml")
    assert scene.population_names == ["soft debris", "hard grains"]
    assert thirdbody.Scene.parse(scene.to_toml()) == scene
    unnamed = scene.with_settings({"debris.0.name": None, "debris.1.name": None, "debris.1.material": '"bronze"'})
    assert unnamed.population_names == ["bronze (irregular)", "bronze (irregular) 2"]
    with pytest.raises(InputError, match=r"debris\[1\]\.name: 'soft debris' is the name of debris\[0\] too"):
        scene.with_settings({"debris.1.name": '"soft debris"'})
