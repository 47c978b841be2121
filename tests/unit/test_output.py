"""What `output` writes: some bodies in full and series of all; spheres that come back on reading; frames at which stops."""

import csv
import math
from pathlib import Path
from types import SimpleNamespace

import h5py
import numpy as np
import pytest
from ensembles import SCENE
from thirdbody_three_spot import LABELLER
from trajectories import whole_and_resumed
import thirdbody
from thirdbody.errors import InputError
from thirdbody.plugin import NO_FORECAST
from thirdbody.runner.simulate import prepare
from thirdbody.runner.stops import SETTLING, planned_frames, targets
from thirdbody.trajectory.open_file import FILE_NAME
from thirdbody.trajectory.read_blocks import rows_of
from thirdbody.trajectory.sampling import ELSEWHERE, REVERSED, sample_of

BED = Path(__file__).parents[2] / "scenes" / "dense_layer.toml"
SHORT = {
    "debris.0.count": 40, "domain.size": ["40 um", "40 um"], "solver": {"settle": "40 ns"},
    "plates.upper.motion.x.velocity": "1 m/s", "solver.distance": "4 nm", "output.every": "2 nm",
}  # fmt: skip
"""A bed under load before it rests: bodies that meet, in some hundred steps."""

EXPLICIT = {"solver.integrator": "explicit", "solver.settle": "50 ns", "solver.distance": "4 nm", "output.every": "1 nm"}
COUNT = 15
SMALL = {"output.blocks": ["clumps"], "output.precision": "float32", "output.compress": True}
FEW = SMALL | {"output.arrays": ["quaternion", "friction_work"]}


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    folder, scene = tmp_path_factory.mktemp("runs"), thirdbody.Scene.load(BED).with_settings(SHORT)
    whole = thirdbody.run(scene, out=folder / "whole", progress=False, threads=1)
    some = thirdbody.run(scene.with_settings({"output.sample": COUNT}), out=folder / "some", progress=False, threads=1)
    with whole, some:
        yield whole, some


def run(folder, **settings):
    scene = thirdbody.Scene.parse(SCENE).with_settings(EXPLICIT | settings)
    return thirdbody.run(scene, out=folder, progress=False, threads=1)


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    with run(tmp_path_factory.mktemp("whole") / "run") as recorded:
        yield recorded


def test_one_body_of_each_stretch():
    sample = sample_of(1000, 50_000)
    assert np.array_equal(sample.bodies // 50, np.arange(1000))
    assert np.array_equal(np.flatnonzero(sample.row >= 0), sample.bodies)
    assert np.array_equal(sample_of(1000, 50_000).row, sample.row)
    # not every fiftieth: shapes of a library follow each other at such a distance
    assert len(np.unique(sample.bodies % 50)) == 50
    assert np.array_equal(sample_of(7, 7).bodies, np.arange(7))


def test_a_sample_is_part_of_the_whole_run(runs):
    whole, some = runs
    ids = some.bodies(0)["scene_id"]
    assert len(ids) == COUNT and some.scene_bodies == 40 and "scene_id" not in whole.bodies(0)
    for frame in range(whole.frames):
        every, mine = whole.bodies(frame), some.bodies(frame)
        assert np.array_equal(mine["id"], np.arange(COUNT))
        for name in set(every) - {"id"}:
            assert np.array_equal(mine[name], every[name][ids]), name
        spheres, own = whole.spheres(frame), some.spheres(frame)
        chosen = np.isin(spheres["clump"], ids)
        assert np.array_equal(ids[own["clump"]], spheres["clump"][chosen])
        for name in ("position", "velocity", "radius", "state"):
            assert np.array_equal(own[name], spheres[name][chosen]), name
    assert np.array_equal(rows_of(some.bodies(0), some.spheres(0)["clump"]), some.spheres(0)["clump"])
    # series and summary are those of all bodies
    for name, values in whole.series.items():
        assert np.array_equal(some.series[name], values, equal_nan=True), name
    for code, name in enumerate(whole.reason_names):
        assert np.array_equal(some.series[f"count_{name}"], np.count_nonzero(whole.reasons == code, axis=1)), name
    every, mine = whole.summary(), some.summary()
    assert mine["bodies"] == 40 and mine["bodies_in_file"] == COUNT and "bodies_in_file" not in every
    assert mine["fractions"] == every["fractions"] and mine["peak_pressure"] == every["peak_pressure"] > 0.0


def test_contacts_are_those_of_the_bodies_in_the_file(runs):
    """A contact of which the file holds the partner alone is seen from there: force and normal turn, nothing else changes."""
    whole, some = runs
    ids = some.bodies(0)["scene_id"]
    every, mine = whole.contacts(-1), some.contacts(-1)
    in_file = np.isin(every["body"], ids), np.isin(every["partner"], ids)
    chosen = in_file[0] | in_file[1]
    from_partner = ~in_file[0][chosen]
    assert from_partner.any() and (~from_partner).any() and (mine["partner"] == ELSEWHERE).any()
    one, other = every["body"][chosen], every["partner"][chosen]
    assert np.array_equal(ids[mine["body"]], np.where(from_partner, other, one))
    far = np.where(from_partner, one, other)
    here = mine["partner"] >= 0
    assert np.array_equal(ids[mine["partner"][here]], far[here])
    assert np.array_equal(mine["partner"] == ELSEWHERE, (far >= 0) & ~np.isin(far, ids))
    for name in set(every) - {"body", "partner"}:
        signs = np.where(from_partner, -1.0, 1.0) if name in REVERSED else np.ones(len(from_partner))
        assert np.array_equal((mine[name].T * signs).T, every[name][chosen]), name
    parts = mine["normal_force"][:, None] * mine["normal"] + mine["tangential_force"]
    assert np.any(mine["tangential_force"][from_partner] != 0.0)
    assert mine["force"] == pytest.approx(parts, rel=1e-12, abs=1e-12 * np.abs(parts).max())  # rounding of a sum
    bodies, steel = whole.bodies(-1), (2.0 - 0.3) / (2.0 * (1.0 - 0.3))  # E*/G* of like materials
    friction = np.where(every["partner"] >= 0, 0.3, 0.8)
    assert every["critical_slip"] == pytest.approx(friction * steel * every["overlap"], rel=1e-12)
    for name in ("utilisation", "peak_pressure"):  # of a body: the largest of its contacts, from either side
        largest = np.zeros(len(bodies["id"]))
        for ends in (every["body"], every["partner"]):
            np.maximum.at(largest, rows_of(bodies, ends[ends >= 0]), every[name][ends >= 0])
        assert np.array_equal(bodies[name], largest), name


def test_what_reads_a_run_reads_a_sampled_one(runs, tmp_path, command):
    folder = runs[1].path.parent
    code, out, errors = command("states", folder)
    assert code == 0 and f"{COUNT} of 40 bodies are in the file" in out and "reasons of all bodies" in out, errors
    for words in (("plot", folder, "--panel", "states", "-o", "a.png"), ("render", folder, "-o", "b.html"),
                  ("export", folder, "--csv", "csv")):  # fmt: skip
        code, _, errors = command(*words)
        assert code == 0, errors
    rows = list(csv.DictReader((tmp_path / "csv" / "bodies.csv").open()))[-COUNT:]
    assert "scene_id" in rows[0]
    frame = runs[1].to_pandas("bodies", -1)
    for k, letter in enumerate("wxyz"):
        expected = runs[1].bodies(-1)["quaternion"][:, k]
        assert [float(row[f"quaternion_{letter}"]) for row in rows] == expected.tolist() == frame[f"quaternion_{letter}"].tolist()


def test_spheres_come_from_their_bodies(whole, tmp_path):
    with run(tmp_path / "run", **{"output.blocks": ["clumps", "contacts"], "output.sample": 7}) as lean:
        # a sample of all is no sample
        assert "scene_id" not in lean.bodies(0) and "count_none" not in lean.series and "bodies_in_file" not in lean.summary()
        assert lean.stored["spheres"].rows(0) == 0 and lean.rows("spheres") == whole.rows("spheres")
        for frame in range(whole.frames):
            recorded, computed = whole.spheres(frame), lean.spheres(frame)
            assert set(computed) == set(recorded)
            # positions lie at some 1e-4 m: round-off of a rotation and a sum
            assert np.allclose(computed["position"], recorded["position"], rtol=0.0, atol=1e-18)
            # recorded in single precision
            size = np.abs(recorded["velocity"]).max()
            assert np.allclose(computed["velocity"], recorded["velocity"], rtol=1e-6, atol=1e-6 * size)
            for name in ("state", "state_reason", "radius", "clump", "id"):
                assert np.array_equal(computed[name], recorded[name])
            for name, values in whole.contacts(frame).items():
                assert np.array_equal(lean.contacts(frame)[name], values)
        assert np.array_equal(lean.array("spheres", "radius"), whole.array("spheres", "radius"))


def test_single_precision_and_few_arrays(whole, tmp_path):
    with run(tmp_path / "run", **FEW) as lean:
        assert np.array_equal(lean.states, whole.states) and np.array_equal(lean.reasons, whole.reasons)
        for name, values in whole.series.items():
            assert np.array_equal(lean.series[name], values, equal_nan=True), name
        bodies, recorded = lean.bodies(-1), whole.bodies(-1)
        assert bodies["quaternion"].dtype == bodies["position"].dtype == np.float32 and "velocity" not in bodies
        # single precision of the positions in a domain of 300 um
        assert np.allclose(lean.spheres(-1)["position"], whole.spheres(-1)["position"], rtol=0.0, atol=300e-6 * 2.0**-23)
        assert np.array_equal(bodies["friction_work"], recorded["friction_work"].astype(np.float32))
        with h5py.File(tmp_path / "run" / FILE_NAME) as file:
            stored = file["VTKHDF/clumps/PointData/quaternion"]
            assert stored.compression == "gzip" and stored.chunks[0] == len(bodies["id"])


def test_forecasts_are_computed_where_they_are_written(whole, tmp_path):
    recorded = whole.bodies(-1)
    assert np.any(recorded["forecast"] != NO_FORECAST)
    others = ["margin_rotation", "roll_ratio"]
    for arrays in (["forecast", "mu_required"], others):
        with run(tmp_path / arrays[0], **{"output.arrays": arrays}) as lean:
            assert np.array_equal(lean.states, whole.states) and np.array_equal(lean.reasons, whole.reasons)
            for name in arrays:
                assert np.array_equal(lean.bodies(-1)[name], recorded[name])
    simulation = prepare(thirdbody.Scene.parse(SCENE).with_settings(EXPLICIT | {"output.arrays": others}))
    simulation.integrator.advance_to(time=simulation.settle)
    assert np.all(simulation.integrator.label()[:, 2 + (*LABELLER.margins, *LABELLER.extras).index("forecast")] == NO_FORECAST)


def test_a_file_without_spheres_and_contacts(tmp_path, command):
    from vtkmodules.vtkIOHDF import vtkHDFReader

    with run(tmp_path / "run", **SMALL) as lean:
        reader = vtkHDFReader()
        reader.SetFileName(str(tmp_path / "run" / FILE_NAME))
        reader.UpdateInformation()
        assert reader.GetNumberOfSteps() == lean.frames
        reader.SetStep(lean.frames - 1)
        reader.Update()
        blocks = reader.GetOutputDataObject(0)
        assert [blocks.GetBlock(k).GetNumberOfPoints() for k in range(4)] == [0, lean.rows("clumps"), 0, 8]
        assert lean.to_pyvista(-1)["spheres"].n_points == lean.rows("spheres")
        with pytest.raises(InputError, match="holds no contacts: output.blocks of its scene leaves them out"):
            lean.contacts(-1)
    code, _, errors = command("render", "run", "--forces", "-o", "a.png")
    assert code == 3 and "holds no contacts" in errors
    with run(tmp_path / "bare", **SMALL | {"output.arrays": []}) as lean:
        assert lean.has_states
        with pytest.raises(InputError, match="no `quaternion` of the bodies from which they could be computed"):
            lean.spheres(-1)
    for words in (("states", "run"), ("export", "run", "--csv", "csv")):
        code, _, errors = command(*words)
        assert code == 0, errors
    assert not (tmp_path / "csv" / "contacts.csv").exists()


def test_faults(tmp_path):
    for settings, message in (
        ({"output.arrays": ["friction_wrok"]}, "bodies of this run have no array 'friction_wrok'; did you mean 'friction_work'"),
        ({"output.blocks": ["contacts"]}, "output.blocks: the bodies are always written: add 'clumps'"),
        ({"output.blocks": ["clumps", "grains"]}, "output.blocks.*'grains' is not one of 'spheres', 'clumps', 'contacts'"),
        ({"output.precision": "float16"}, "output.precision: 'float16' is not one of 'float64', 'float32'"),
        ({"output.sample": 0}, "output.sample: 0 must be at least 1"),
    ):
        with pytest.raises(InputError, match=message):
            run(tmp_path / "run", **settings)
        assert not (tmp_path / "run").exists()


def test_a_resumed_run_has_the_bits_of_the_whole_one(tmp_path):
    whole_and_resumed(thirdbody.Scene.parse(SCENE).with_settings(EXPLICIT | FEW | {"output.sample": 3}), tmp_path)
    with thirdbody.open(tmp_path / "whole") as one, thirdbody.open(tmp_path / "cut") as other:
        # the largest peak pressure of all frames, which the file does not hold
        assert one.summary()["peak_pressure"] == other.summary()["peak_pressure"] > 0.0
        assert math.isfinite(one.summary()["first_yield"]["ratio"])
        assert np.array_equal(one.spheres(-1)["clump"][[0, -1]], [0, 2])


def test_a_scene_that_names_none_is_written_as_before(whole):
    assert thirdbody.Scene.parse(SCENE).to_toml().count("output") == 1 and "blocks" not in whole.header
    text = thirdbody.Scene.parse(SCENE).with_settings(FEW).to_toml()
    for line in ('blocks = ["clumps"]', 'precision = "float32"', "compress = true", 'arrays = ["quaternion", "friction_work"]'):
        assert line in text


def test_settling_by_itself_does_not_drown_the_drag_in_frames():
    # a drag of 1 us, every 0.1 us; of a settling time of the scene and of a short one all frames are kept
    for settle, wish, thinned in (
        (8e-3, "auto", True), (1.001e-5, "auto", True), (1.99e-5, "auto", True), (8e-5, 8e-5, False), (9e-6, "auto", False),
    ):  # fmt: skip
        output, solver = SimpleNamespace(every_kind="time", every=1e-7), SimpleNamespace(settle=wish)
        scene, end = SimpleNamespace(output=output, solver=solver, plates=SimpleNamespace(wear=None)), settle + 1e-6
        simulation = SimpleNamespace(scene=scene, settle=settle, planned_time=end, end_time=end, end_distance=1.0, extended=0)
        simulation.settle_after = {0: settle}.get
        times = [time for time, _, write in targets(simulation) if write]
        if not thinned:
            assert len([time for time in times if time < settle - 1e-12]) == round(settle / 1e-7) - 1
            continue
        assert len([time for time in times if time < settle]) <= SETTLING + 1
        assert planned_frames(simulation) == 1 + len(times)
        late = [time for time in times if time >= settle]
        assert 10 <= len(late) <= 11 and times == sorted(times) and times[-1] == pytest.approx(end)
        # (a last stop that is the end but for rounding stays where it is: `course`)
        # the frames of the drag are where they would be without the thinning: at multiples of the interval
        assert all(abs(time / 1e-7 - round(time / 1e-7)) < 1e-4 for time in times[:-1])
