"""Measures in runs change nothing and sum exactly, with the same bits on any threads and in pieces, for all kinds of contacts."""

import functools
import itertools
import re
from pathlib import Path
from types import SimpleNamespace
from xml.etree import ElementTree

import numpy as np
import pytest
import pyvista
from balls import PLATES, edited
from PIL import Image
from slow import slow
from steel import HOT_STEEL, STEEL
from trajectories import contents
import thirdbody
from thirdbody.errors import InputError, Interrupted
from thirdbody.export.tables import export_run
from thirdbody.render.surfaces import plate_map
from thirdbody.runner.resume import prepare_resume
from thirdbody.runner.simulate import execute, prepare

K, ALPHA = 3e-15, 5e-15
LOAD, SIZE = 1e-4, (40e-6, 30e-6)
# Two flat stars of four spheres, near each other, so that they may meet; both slide under their loads.
DEBRIS = """\
[[debris]]
material = "steel"
kind = "spheres"
shape = [
  {center = ["0 um", "0 um", "0 um"], radius = "2 um"}, {center = ["3 um", "0 um", "0 um"], radius = "2 um"},
  {center = ["-1.5 um", "2.6 um", "0 um"], radius = "2 um"}, {center = ["-1.5 um", "-2.6 um", "0 um"], radius = "2 um"},
]
positions = [["10 um", "10 um", "2 um"], ["25 um", "20 um", "2 um"]]
"""
SCENE = (
    HOT_STEEL + DEBRIS + '[domain]\nsize = ["40 um", "30 um"]\n' + edited(PLATES, ('damping = "7e-5 kg/s"\n', ""))
    + '[solver]\nsettle = "0.2 us"\ndistance = "0.2 um"\n[output]\nevery = "0.05 um"\n'
)  # fmt: skip
MEASURES = """
[measures]
cell = "0.5 um"
flash_temperature = true
wear = {plates = "3e-15 m3/J", bodies = "5e-15 m3/J"%s}
"""
ALONE = '[contact]\ndebris_contact = "none"\n'


def scene(integrator, measures="", more=""):
    return thirdbody.Scene.parse(SCENE.replace("[solver]", f'{more}[solver]\nintegrator = "{integrator}"') + measures)


CASES = {"explicit": ("explicit", ""), "implicit alone": ("implicit", ALONE), "implicit islands": ("implicit", "")}


@pytest.fixture(scope="module")
def runs(tmp_path_factory):

    @functools.cache
    def run(case, law="archard"):
        integrator, more = CASES[case]
        text = MEASURES % f', law = "{law}"' if law else ""
        folder = tmp_path_factory.mktemp("measured") / "run"
        return thirdbody.run(scene(integrator, text, more), out=folder, threads=1, progress=False)

    return run


def on_plates(bodies, name):
    return bodies[f"{name}_lower"] + bodies[f"{name}_upper"]


@pytest.mark.parametrize("case", CASES)
def test_measures_change_nothing(runs, case):
    bare, measured = runs(case, ""), runs(case)
    for frame in range(bare.frames):
        for block in ("clumps", "spheres", "contacts"):
            before, after = bare.block(block, frame), measured.block(block, frame)
            assert all(np.array_equal(before[name], after[name], equal_nan=True) for name in before)
    assert all(np.array_equal(values, measured.series[name], equal_nan=True) for name, values in bare.series.items())
    own = {"worn_volume", "plate_wear_lower", "plate_wear_upper", "sliding_work_lower", "sliding_work_upper", "measured_time"}
    heat = {"flash_temperature", "flash_temperature_mean", "peclet_number"}
    assert measured.bodies(0).keys() - bare.bodies(0).keys() == own | heat
    assert measured.contacts(0).keys() - bare.contacts(0).keys() == {"flash_temperature", "peclet_number"}
    assert not bare.maps("lower") and "measures" not in bare.header and "measures" not in bare.summary()


@pytest.mark.parametrize("case", CASES)
def test_wear_of_a_flake(runs, case):
    """Under the load N a flake that slides on both plates wears k N times the drag off them, whichever side slips. Of the last
    interval, in which both sides slip or one does: the patch rides on the flake, so its load is N but for what accelerates it,
    a millionth of it and less in implicit steps, some thousandths in explicit ones."""
    run = runs(case)
    worn = [on_plates(run.bodies(frame), "plate_wear") for frame in (-2, -1)]
    slipped = [run.bodies(frame)["slip_distance"] for frame in (-2, -1)]
    drag = run.series["distance"][-1] - run.series["distance"][-2]
    spots = 4.0  # of a flake on a side; each slips by the whole path of the side
    assert slipped[1] - slipped[0] == pytest.approx(spots * drag, rel=2e-3)
    assert worn[1] - worn[0] == pytest.approx(K * LOAD * drag, rel=3e-3 if case == "explicit" else 1e-4)
    check_energy(runs(case, "energy").bodies(-1))


def check_energy(bodies, wears=True):
    """Wear by energy is the friction work, the same numbers summed in another order: rounding of some thousand terms."""
    assert on_plates(bodies, "sliding_work") == pytest.approx(bodies["friction_work"], rel=1e-11)
    if wears:
        assert on_plates(bodies, "plate_wear") == pytest.approx(K * bodies["friction_work"], rel=1e-11)
        assert bodies["worn_volume"] == pytest.approx(ALPHA * bodies["friction_work"], rel=1e-11)


def check_maps(run, frames, shape):
    for frame in frames:
        for plate in ("lower", "upper"):
            bodies, maps = run.bodies(frame), run.maps(plate, frame)
            assert maps["wear_depth"].shape == shape
            for name, amount in (("wear_depth", "plate_wear"), ("friction_work_density", "sliding_work")):
                assert maps[name].sum() * 0.25e-12 == pytest.approx(bodies[f"{amount}_{plate}"].sum(), rel=1e-12)
    assert run.map_units == {"wear_depth": "m", "friction_work_density": "J/m2"}


@pytest.mark.parametrize("case", CASES)
def test_maps_lie_where_the_spots_are(runs, case):
    """The cells with wear of the lower plate are within a contact radius and a cell's diagonal of a spot; those of the upper one
    in its own coordinates, so behind the spots by its displacement. The flakes moved by at most the drag."""
    run = runs(case)
    check_maps(run, (1, run.frames - 1), (60, 80))
    drag = float(run.series["displacement"][-1])
    spots, start = (run.spheres(frame)["position"][:, :2] for frame in (-1, 0))
    for plate, shift, ahead in (("lower", 0.0, 0.25e-6), ("upper", drag, -0.25e-6)):
        worn = run.maps(plate)["wear_depth"]
        j, i = np.nonzero(worn)
        centres = np.column_stack([i + 0.5, j + 0.5]) * 0.5e-6
        away = np.abs(centres[:, None] - (spots - [shift, 0.0]))
        assert np.hypot(*np.moveaxis(away, 2, 0)).min(axis=1).max() < 0.36e-6 + drag + 0.1e-6
        # they start at edges of cells: dragged by a part of a cell they rub the next one of the lower, the last one of the upper
        nearest = start[np.hypot(*np.moveaxis(centres[:, None] - start, 2, 0)).argmin(axis=1), 0]
        assert np.average(centres[:, 0] - nearest, weights=worn[j, i]) == pytest.approx(ahead, rel=1e-3)
    assert worn.any()


@pytest.mark.parametrize("case", CASES)
def test_heat_of_a_flake(runs, case):
    """The spots of the side that slides have mu N v/(4 a 2 k) on the mean of the last interval, those that stick nothing. It
    slides at the upper plate only, steadily: to some parts in ten thousand of v."""
    run = runs(case)
    heat = [body["flash_temperature_mean"] * body["measured_time"] for body in (run.bodies(-2), run.bodies(-1))]
    expected = np.zeros(2)
    for contacts in (run.contacts(-2), run.contacts(-1)):
        excess = 0.3 * contacts["normal_force"] * 0.5 / (4.0 * contacts["contact_radius"] * 100.0)
        expected += 0.5 * np.bincount(contacts["body"], excess * (contacts["side"] == 1), 2)
    assert (heat[1] - heat[0]) / (run.times[-1] - run.times[-2]) == pytest.approx(expected, rel=1e-3)
    bodies, contacts = run.bodies(-1), run.contacts(-1)
    assert np.all(bodies["flash_temperature_mean"] < bodies["flash_temperature"])
    for body in range(2):  # all contacts are those of the start
        assert bodies["flash_temperature"][body] == contacts["flash_temperature"][contacts["body"] == body].max()
    assert np.all((bodies["peclet_number"] > 0.0) & (bodies["peclet_number"] < 0.1))


@pytest.mark.parametrize("case", ["explicit", slow("implicit alone"), "implicit islands"])
def test_bits_of_threads_and_pieces(runs, case, tmp_path):
    integrator, more = CASES[case]
    whole, text = runs(case), MEASURES % ', law = "archard"'
    counter = itertools.count(1)
    with pytest.raises(Interrupted):
        execute(prepare(scene(integrator, text, more)), tmp_path / "cut", 2, stop=lambda: next(counter) >= 4)
    simulation, checkpoint = prepare_resume(tmp_path / "cut")
    execute(simulation, tmp_path / "cut", 1, checkpoint=checkpoint)
    first, second = contents(whole.path.parent), contents(tmp_path / "cut")
    assert first.keys() == second.keys() and any("maps/wear_depth" in name for name in first)
    assert [name for name in first if first[name] != second[name]] == []


def test_check_counts_maps_in_the_disk(runs):
    integrator, more = CASES["implicit alone"]
    disk = thirdbody.check(scene(integrator, MEASURES % "", more))["disk"]
    # two maps of two plates take 150 kB of each frame; contacts are taken to be three of a body
    assert disk == pytest.approx(runs("implicit alone").path.stat().st_size, rel=0.02)


def test_picture_of_a_map(runs, tmp_path: Path, monkeypatch):
    run = runs("explicit")
    with Image.open(run.render(tmp_path / "map.png", plate="upper", color="wear_depth", size=(400, 300))) as image:
        assert image.size == (400, 300) and len(image.convert("RGB").getcolors(400 * 300)) > 20
    assert run.render(tmp_path / "first.png", plate="upper").is_file()  # the first map
    values, words = plate_map(run, "upper", "wear_depth", 1, None)
    assert np.array_equal(values, run.maps("upper", 1)["wear_depth"]) and words.startswith("upper plate, after ")
    # of cycles: the rate of the second and the third, 2 each
    depth = np.array([0.0, 5.0, 7.0, 9.0])[:, None, None] * [[0.0, 1.0], [1.0, 1.0]]
    ends = {"end_time": np.array([1.0, 2.0, 3.0])}
    depth[3, 1, 1] = 11.0
    known = {"map_units": {"wear_depth": "m"}, "cycles": ends, "times": np.arange(4.0)}
    loops = SimpleNamespace(**known, maps=lambda plate, number: {"wear_depth": depth[number]})
    loops.drag = SimpleNamespace(run=loops)
    monkeypatch.setattr("thirdbody.trajectory.summary.friction_cycles", lambda drag: ends)
    values, words = plate_map(loops, "lower", "wear_depth", None, 10.0)
    assert values.tolist() == [[0.0, 20.0], [20.0, 30.0]]
    assert "mean 23.3 m where there is any, largest 30 m" in words.replace("\N{NO-BREAK SPACE}", " ")
    monkeypatch.undo()
    for wrong, message in (
        ({"plate": "uper", "color": "wear_depth"}, "did you mean 'upper'"),
        ({"plate": "upper", "color": "wear_dept"}, "did you mean 'wear_depth'"),
        ({"plate": "upper", "color": "wear_depth", "cycles": 10.0}, "0 whole cycles"),
        ({"plate": "upper", "color": "wear_depth", "zoom": 0.5}, "without body, forces and zoom"),
        ({"color": "state", "cycles": 10.0}, "a number above 0, with plate"),
    ):
        with pytest.raises(InputError, match=message):
            run.render(tmp_path / "map.png", **wrong)


def test_vtk_reads_the_maps_of_an_export(runs, tmp_path: Path):
    """Each cell has the value of the map, and its image lies where the plate is: that of the upper one moves and is high."""
    run = runs("explicit")
    written = list(export_run(run.path, None, tmp_path / "pvd"))
    for plate in ("lower", "upper"):
        collection = tmp_path / "pvd" / f"{plate}_maps.pvd"
        entries = ElementTree.parse(collection).findall("Collection/DataSet")
        assert collection in written and [float(entry.get("timestep")) for entry in entries] == run.times.tolist()
        for frame, entry in enumerate(entries):
            image, maps = pyvista.read(collection.parent / entry.get("file")), run.maps(plate, frame)
            origin = [0.0, 0.0, 0.0] if plate == "lower" else [run.series["displacement"][frame], 0.0, run.series["gap"][frame]]
            assert image.origin == pytest.approx(origin, rel=1e-14)
            assert image.bounds[1] - image.bounds[0] == pytest.approx(SIZE[0], rel=1e-12)
            assert len(image.cell_data) == len(maps) == 2
            for name, values in maps.items():
                assert np.array_equal(image.cell_data[name].reshape(values.shape), values)
    script = (tmp_path / "pvd" / "open_in_paraview.py").read_text()
    compile(script, "open_in_paraview.py", "exec")
    assert 'MAPS = ["lower_maps", "upper_maps"]' in script
    list(export_run(run.path, None, tmp_path / "pvd", frame=1, overwrite=True))  # its own files are known
    assert len(list((tmp_path / "pvd" / "upper_maps").iterdir())) == 1


def test_tables_of_a_run_have_units(runs, tmp_path: Path):
    run = runs("explicit")
    units = run.to_pandas("bodies", -1).attrs["units"]
    assert units["worn_volume"] == "m3" and units["flash_temperature"] == "K" and units["peclet_number"] == "1"
    blocks = run.to_pyvista(-1)
    assert blocks["lower_maps"].n_cells == 60 * 80
    assert blocks["upper_maps"].cell_data["wear_depth"].sum() == pytest.approx(run.maps("upper")["wear_depth"].sum(), rel=1e-14)
    summary = run.summary()["measures"]
    assert summary["plate_wear_lower"] == pytest.approx(run.bodies(-1)["plate_wear_lower"].sum(), rel=1e-14)


def test_a_measure_of_ones_own_is_one_file(tmp_path: Path, command):
    """The measure of the page on plug-ins, loaded by its path: both flakes rub, and the map of the plate has it all."""
    page = (Path(__file__).parents[2] / "plugins" / "README.md").read_text(encoding="utf-8")
    (code,) = [block for block in re.findall(r"```python\n(.*?)```", page, re.DOTALL) if "Measure(" in block]
    (tmp_path / "rubbed.py").write_text(code, encoding="utf-8")
    (tmp_path / "scene.toml").write_text(scene("explicit", '[measures]\ncell = "0.5 um"\n').to_toml(), encoding="utf-8")
    settings = ["--set", "solver.distance=0.1 um", "--set", "measures.rubbed.threshold=100 MPa"]
    given = ["run", "scene.toml", "-q", "-o", "out", *settings]
    assert command(*given, "--plugin", "rubbed.py").code == 0
    with thirdbody.open(tmp_path / "out") as run:
        bodies, map_ = run.bodies(-1), run.maps("upper")["rubbed_distance"]
        assert np.all(bodies["rubbed_upper"] > 0.0) and np.all(bodies["severity"] > 0.0)
        assert map_.sum() * 0.25e-12 == pytest.approx(bodies["rubbed_upper"].sum(), rel=1e-12)
    refused = command(*given, "--overwrite")
    assert refused.code != 0 and "rubbed" in refused.err


PLASTIC = edited(STEEL, ('"7850 kg/m3"\n', '"7850 kg/m3"\nyield_strength = "0.4 GPa"\n'))
OTHER = PLASTIC + DEBRIS + '[domain]\nsize = ["40 um", "20 um"]\n' + PLATES + ALONE + """\
[measures]
cell = "0.5 um"
wear = {law = "energy", plates = "3e-15 m3/J", bodies = "5e-15 m3/J"}
[solver]
settle = "0.1 us"
distance = "0.1 um"
[output]
every = "0.05 um"
"""  # fmt: skip
SURFACE = {"rms": "20 nm", "long": "20 um", "short": "5 um", "seed": 3}
KINDS = {
    "rough": {
        "plates.lower.surface": SURFACE, "plates.upper.surface": SURFACE | {"seed": 4},
        "debris.0.positions": [["10 um", "10 um", "2.05 um"], ["25 um", "20 um", "2.05 um"]],
    },
    "common": {"plates.upper.support": "rigid", "plates.upper.load": "0.2 mN", "measures.wear.law": "archard"},
    "plastic": {"effects.elastic_plastic": {}},
}  # fmt: skip


@pytest.mark.parametrize("integrator, kind", [
    ("explicit", "rough"), ("implicit", "common"), ("explicit", "plastic"), slow("implicit", "rough"),
    slow("explicit", "common"), slow("implicit", "plastic"),
])  # fmt: skip
def test_sums_where_contacts_are_of_another_kind(integrator, kind, tmp_path):
    scene = thirdbody.Scene.parse(OTHER).with_settings(KINDS[kind] | {"solver.integrator": integrator})
    run = thirdbody.run(scene, out=tmp_path / kind, threads=1, progress=False)
    check_maps(run, (-1,), (40, 80))
    bodies = run.bodies(-1)
    assert np.all(bodies["friction_work"] > 0.0)
    check_energy(bodies, wears=kind != "common")  # what flow takes is no friction, and wears nothing by energy
    if kind == "plastic":
        assert np.all(bodies["plastic_work"] > 1e-3 * bodies["friction_work"])
    if kind == "common":  # Archard's sum over plates and bodies is k N s of the last interval, however they share the load
        worn = [on_plates(run.bodies(frame), "plate_wear").sum() for frame in (-2, -1)]
        path = run.series["distance"][-1] - run.series["distance"][-2]
        assert worn[1] - worn[0] == pytest.approx(K * 2e-4 * path, rel=3e-3)
