"""Who rolls and who slides by population, material and size: in tables, summary, page and pictures, by name."""

import csv
import json
from types import SimpleNamespace

import h5py
import numpy as np
import pytest
from matplotlib.colors import to_hex
from steel import SCENES

import thirdbody
from thirdbody.errors import InputError
from thirdbody.export.tables import export_csv
from thirdbody.palette import STATE_COLORS
from thirdbody.plot.summary_page import page
from thirdbody.render.picture_data import read_picture_data
from thirdbody.report.tables import run_report, states_report
from thirdbody.trajectory.names import Frame
from thirdbody.trajectory.states import _load_fractions, _size_classes, states_by_group
from thirdbody.trajectory.writer import TrajectoryWriter

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
    assert _load_fractions(SimpleNamespace(block=lambda *_: contacts), 0, 2).tolist() == [0.75, 0.25]
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
