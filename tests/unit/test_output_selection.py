"""What `output` leaves out of a run file: spheres come back on reading, contacts do not, and nothing else changes."""

from __future__ import annotations

import math

import h5py
import numpy as np
import pytest
from ensembles import SCENE
from thirdbody_three_spot import LABELLER
from trajectories import whole_and_resumed

import thirdbody
from thirdbody.errors import InputError
from thirdbody.plugin import NO_FORECAST
from thirdbody.runner.prepare import prepare
from thirdbody.trajectory import validate
from thirdbody.trajectory.reader import FILE_NAME

EXPLICIT = {"solver.integrator": "explicit", "solver.settle": "50 ns", "solver.distance": "4 nm", "output.every": "1 nm"}
SMALL = {"output.blocks": ["clumps"], "output.precision": "float32", "output.compress": True}
LABELS = (*LABELLER.margins, *LABELLER.extras)
FEW = SMALL | {"output.arrays": ["quaternion", "friction_work"]}


def run(folder, **settings):
    scene = thirdbody.Scene.parse(SCENE).with_settings(EXPLICIT | settings)
    return thirdbody.run(scene, out=folder, progress=False, threads=1)


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    with run(tmp_path_factory.mktemp("whole") / "run") as recorded:
        yield recorded


def test_spheres_come_from_their_bodies(whole, tmp_path):
    with run(tmp_path / "run", **{"output.blocks": ["clumps", "contacts"]}) as lean:
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
    scene = thirdbody.Scene.parse(SCENE).with_settings(EXPLICIT | {"output.arrays": others})
    simulation = prepare(scene)
    simulation.integrator.advance_to(time=simulation.settle)
    assert np.all(simulation.integrator.label()[:, 2 + LABELS.index("forecast")] == NO_FORECAST)


def test_a_chunk_of_what_is_not_written_may_be_of_any_size(tmp_path):
    """Of a million bodies a frame of the spheres is larger than what is read unasked, and none is in the file."""
    with h5py.File(tmp_path / "points.h5", "w") as file:
        points = file.create_dataset("Points", (0, 3), np.float32, maxshape=(None, 3), chunks=(6_000_000, 3))
        assert validate.sound(file.filename, points, 0) is points
        points.resize(1, axis=0)
        with pytest.raises(ValueError, match="has chunks of"):
            validate.sound(file.filename, points, 1)


def test_vtk_reads_a_file_without_spheres(tmp_path):
    from vtkmodules.vtkIOHDF import vtkHDFReader

    with run(tmp_path / "run", **SMALL) as lean:
        reader = vtkHDFReader()
        reader.SetFileName(str(tmp_path / "run" / FILE_NAME))
        reader.UpdateInformation()
        assert reader.GetNumberOfSteps() == lean.frames
        reader.SetStep(lean.frames - 1)
        reader.Update()
        blocks = reader.GetOutputDataObject(0)
        points = [blocks.GetBlock(k).GetNumberOfPoints() for k in range(4)]
        assert points == [0, lean.rows("clumps"), 0, 8]
        exported = lean.to_pyvista(-1)["spheres"]
        assert exported.n_points == lean.rows("spheres")


def test_contacts_that_are_left_out_raise(tmp_path, command):
    with run(tmp_path / "run", **SMALL) as lean:
        with pytest.raises(InputError, match="holds no contacts: output.blocks of its scene leaves them out"):
            lean.contacts(-1)
    code, _, errors = command("render", tmp_path / "run", "--forces", "-o", tmp_path / "a.png")
    assert code == 3 and "holds no contacts" in errors
    for words in (("states", tmp_path / "run"), ("export", tmp_path / "run", "--csv", tmp_path / "csv")):
        code, _, errors = command(*words)
        assert code == 0, errors
    assert not (tmp_path / "csv" / "contacts.csv").exists()


def test_spheres_need_orientations(tmp_path):
    with run(tmp_path / "run", **SMALL | {"output.arrays": []}) as lean:
        assert lean.has_states
        with pytest.raises(InputError, match="no `quaternion` of the bodies from which they could be computed"):
            lean.spheres(-1)


@pytest.mark.parametrize(
    "settings, message",
    [
        ({"output.arrays": ["friction_wrok"]}, "bodies of this run have no array 'friction_wrok'; did you mean 'friction_work'"),
        ({"output.blocks": ["contacts"]}, "output.blocks: the bodies are always written: add 'clumps'"),
        ({"output.blocks": ["clumps", "grains"]}, "output.blocks.*'grains' is not one of 'spheres', 'clumps', 'contacts'"),
        ({"output.precision": "float16"}, "output.precision: 'float16' is not one of 'float64', 'float32'"),
    ],
)  # fmt: skip
def test_faults(tmp_path, settings, message):
    with pytest.raises(InputError, match=message):
        run(tmp_path / "run", **settings)
    assert not (tmp_path / "run").exists()


def test_a_resumed_run_has_the_bits_of_the_whole_one(tmp_path):
    scene = thirdbody.Scene.parse(SCENE).with_settings(EXPLICIT | FEW)
    whole_and_resumed(scene, tmp_path)
    with thirdbody.open(tmp_path / "whole") as one, thirdbody.open(tmp_path / "cut") as other:
        # the largest peak pressure of all frames, which the file does not hold
        assert one.summary()["peak_pressure"] == other.summary()["peak_pressure"] > 0.0
        assert math.isfinite(one.summary()["first_yield"]["ratio"])


def test_a_scene_that_names_none_is_written_as_before(whole, tmp_path):
    assert thirdbody.Scene.parse(SCENE).to_toml().count("output") == 1 and "blocks" not in whole.header
    text = thirdbody.Scene.parse(SCENE).with_settings(FEW).to_toml()
    for line in ('blocks = ["clumps"]', 'precision = "float32"', "compress = true", 'arrays = ["quaternion", "friction_work"]'):
        assert line in text
