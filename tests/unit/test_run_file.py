"""The trajectory file, read back by VTK's own reader: a file with a fault in its layout "reads" as empty."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections import namedtuple
from pathlib import Path

import h5py
import numpy as np
import pytest

from thirdbody.errors import InputError, OutputError
from thirdbody.export.paraview import write_paraview_files, write_sidecars
from thirdbody.trajectory import polydata_block
from thirdbody.trajectory import writer as vtkhdf
from thirdbody.trajectory.reader import open_run
from thirdbody.trajectory.schema import BLOCKS, Frame
from thirdbody.trajectory.writer import TrajectoryWriter

CONTACT_COUNTS = (0, 4, 0, 7, 2)
SPHERES_PER_CLUMP = (1, 2, 3)
HEADER = {
    "scene_text": 'scene = 1\ntitle = "three grains, µm"\n',
    "title": "three grains",
    "versions": {"thirdbody": "0.1.0"},
    "state_names": ["free", "sticking", "sliding", "rolling"],
    "reason_names": ["none", "friction_limit"],
    "units": {"time": "s", "upper_force": "N"},
    "domain": {"size": [40e-6, 20e-6], "periodic": True},
}
CLUMP_OF_SPHERE = np.repeat(np.arange(3), SPHERES_PER_CLUMP)
STATIC = {
    "spheres": {"radius": np.linspace(1e-6, 2e-6, 6), "clump": CLUMP_OF_SPHERE},
    "clumps": {"id": np.arange(3), "mass": np.array([1.0, 2.0, 3.0])},
}


def make_frame(number: int) -> Frame:
    """Frame `number` of the trial run; every value tells its frame, so that mixed-up offsets show."""
    rng = np.random.default_rng(number)
    count = CONTACT_COUNTS[number % len(CONTACT_COUNTS)]
    states = np.array([number % 4, 3, 0], np.uint8)
    plates = np.zeros((8, 3))
    plates[4:] = [number * 1e-6, 0.0, 5e-6]
    return Frame(
        time=number * 1e-6,
        spheres={"points": rng.normal(size=(6, 3)), "velocity": rng.normal(size=(6, 3)), "state": states[CLUMP_OF_SPHERE]},
        clumps={
            "points": rng.normal(size=(3, 3)),
            "quaternion": rng.normal(size=(3, 4)),
            "state": states,
            "state_reason": states % 2,
            "loaded": np.array([True, False, True]),
        },
        contacts={
            "points": rng.normal(size=(count, 3)),
            "vector": rng.normal(size=(count, 3)),
            "utilisation": rng.random(count),
            "body": np.arange(count, dtype=np.int64),
        },
        plates={"points": plates},
        series={"time": number * 1e-6, "upper_force": rng.normal(size=3)},
    )


@pytest.fixture
def written(tmp_path: Path) -> Path:
    path = tmp_path / "run.vtkhdf"
    with TrajectoryWriter(path, HEADER, STATIC) as writer:
        for number in range(5):
            writer.append(make_frame(number))
        writer.finish({"seconds": 1.5})
    write_paraview_files(path, HEADER["state_names"])
    return path


def vtk_blocks(path: Path, step: int) -> list:
    """The data sets that VTK's reader gives for one step, the composite ones flattened."""
    vtk = pytest.importorskip("vtk")
    reader = vtk.vtkHDFReader()
    reader.SetFileName(str(path))
    reader.UpdateInformation()
    reader.SetStep(step)
    reader.Update()
    output = reader.GetOutputDataObject(0)
    if output.IsA("vtkPolyData"):
        return [output]
    return [output.GetBlock(i) for i in range(output.GetNumberOfBlocks())]


def expected(block: str, number: int) -> dict[str, np.ndarray]:
    arrays = {**make_frame(number).block(block), **STATIC.get(block, {})}
    narrow = block == "spheres"
    # Spheres keep float32 but for positions and static arrays; the expected value is rounded the same way.
    return {name: np.float32(values) if narrow and name == "velocity" else np.asarray(values) for name, values in arrays.items()}


def assert_same_as_vtk(data, block: str, number: int) -> None:
    from vtkmodules.util.numpy_support import vtk_to_numpy

    wanted = expected(block, number)
    points = wanted.pop("points")
    assert data.GetNumberOfPoints() == len(points)
    assert data.GetNumberOfCells() == (2 if block == "plates" else len(points))
    for i in range(data.GetNumberOfCells()):
        per_cell = 4 if block == "plates" else 1
        ids = data.GetCell(i).GetPointIds()
        numbers = [ids.GetId(k) for k in range(ids.GetNumberOfIds())]
        assert numbers == list(range(i * per_cell, (i + 1) * per_cell))
    if len(points):
        np.testing.assert_array_equal(vtk_to_numpy(data.GetPoints().GetData()), points)
    for name, values in wanted.items():
        array = data.GetPointData().GetArray(name)
        if len(points):
            np.testing.assert_array_equal(vtk_to_numpy(array), values)


@pytest.mark.parametrize("number", range(5))
def test_vtk_reads_every_block_of_every_frame(written, number):
    blocks = vtk_blocks(written, number)
    assert len(blocks) == len(BLOCKS)
    for name, data in zip(BLOCKS, blocks, strict=True):
        assert_same_as_vtk(data, name, number)


@pytest.mark.parametrize("block", BLOCKS)
def test_sidecars_are_plain_polydata(written, block):
    path = written.with_name(f"run.{block}.vtkhdf")
    for number in range(5):
        (data,) = vtk_blocks(path, number)
        assert_same_as_vtk(data, block, number)


def test_sidecars_survive_a_move_of_the_folder(written, tmp_path):
    moved = tmp_path / "elsewhere"
    moved.mkdir()
    for path in tmp_path.glob("run.*"):
        path.rename(moved / path.name)
    assert_same_as_vtk(vtk_blocks(moved / "run.clumps.vtkhdf", 3)[0], "clumps", 3)


def test_vtk_sees_the_times(written):
    vtk = pytest.importorskip("vtk")
    reader = vtk.vtkHDFReader()
    reader.SetFileName(str(written.with_name("run.clumps.vtkhdf")))
    reader.UpdateInformation()
    keys = vtk.vtkStreamingDemandDrivenPipeline
    times = reader.GetOutputInformation(0).Get(keys.TIME_STEPS())
    assert list(times) == [number * 1e-6 for number in range(5)]


def test_static_arrays_and_topology_are_stored_once(written):
    with h5py.File(written) as file:
        root = file["VTKHDF"]
        assert root["spheres/PointData/radius"].shape == (6,)
        assert root["clumps/PointData/mass"].shape == (3,)
        assert list(root["spheres/Steps/PointDataOffsets/radius"]) == [0] * 5
        assert root["contacts/Vertices/Connectivity"].shape == (max(CONTACT_COUNTS),)
        assert root["contacts/Points"].shape == (sum(CONTACT_COUNTS), 3)


def test_states_are_bytes_and_booleans_become_bytes(written):
    with h5py.File(written) as file:
        assert file["VTKHDF/clumps/PointData/state"].dtype == np.uint8
        assert file["VTKHDF/clumps/PointData/loaded"].dtype == np.uint8


def test_a_scene_without_plates_has_no_polygons(tmp_path):
    path = tmp_path / "run.vtkhdf"
    with TrajectoryWriter(path, HEADER, STATIC) as writer:
        frame = make_frame(1)
        writer.append(Frame(frame.time, frame.spheres, frame.clumps, frame.contacts, None, frame.series))
    plates = vtk_blocks(path, 0)[BLOCKS.index("plates")]
    assert (plates.GetNumberOfPoints(), plates.GetNumberOfCells()) == (0, 0)


def test_vtk_reads_the_file_as_a_kill_between_any_two_flushes_leaves_it(tmp_path, monkeypatch):
    """VTK reads all `Values` into a buffer of `NSteps`: with one more it corrupts its heap."""
    path, copies = tmp_path / "run.vtkhdf", []
    flush = TrajectoryWriter._flush

    def flush_and_copy(writer):
        flush(writer)
        copies.append(shutil.copy(path, tmp_path / f"{len(copies)}.vtkhdf"))

    monkeypatch.setattr(TrajectoryWriter, "_flush", flush_and_copy)
    with TrajectoryWriter(path, HEADER, STATIC) as writer:
        for number in range(4):
            writer.append(make_frame(number))
    assert len(copies) == 1 + 3 * 4
    for copy in copies:
        with h5py.File(copy) as file:
            for block in BLOCKS:
                steps = file["VTKHDF"][block]["Steps"]
                assert len(steps["Values"]) <= steps.attrs["NSteps"]
        with open_run(copy) as run:
            frames = run.frames
        # With one frame VTK ignores the steps and shows what is there of the second one too.
        for number in range(frames if frames > 1 else 0):
            for name, data in zip(BLOCKS, vtk_blocks(copy, number), strict=True):
                assert_same_as_vtk(data, name, number)


LIMITED = """
import resource, sys
sys.path[:0] = [{tests!r}]
from test_run_file import HEADER, STATIC, make_frame
from thirdbody.errors import OutputError
from thirdbody.trajectory.writer import TrajectoryWriter
resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[2]), resource.RLIM_INFINITY))
try:
    with TrajectoryWriter(sys.argv[1], HEADER, STATIC) as writer:
        for number in range(100000):
            writer.append(make_frame(number))
except OutputError as error:
    print(error)
"""


@pytest.mark.skipif(sys.platform == "win32", reason="no limit on the size of files")
@pytest.mark.parametrize("limit", [9_000_851, 9_352_888, 9_646_605])
def test_a_write_that_the_system_refuses_keeps_what_it_says(tmp_path, limit):
    """A fault of the system that a look at the free space cannot foresee; the limits leave room for the hole and some frames."""
    path = tmp_path / "run.vtkhdf"
    code = LIMITED.format(tests=os.path.dirname(__file__))
    done = subprocess.run([sys.executable, "-c", code, str(path), str(limit)], capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")
    number = done.stdout.split("the ")[-1].split()[0]
    report = 1 if number == "frame" else int(number)
    with open_run(path) as run:
        assert run.frames in (report, report + 1)
        wanted = make_frame(run.frames - 1).clumps["quaternion"]
        np.testing.assert_array_equal(run.bodies(-1)["quaternion"], wanted)


def test_resume_drops_later_frames_and_goes_on(written):
    write_sidecars(written)
    with TrajectoryWriter.resume(written, 2) as writer:
        for number in range(2, 5):
            writer.append(make_frame(number))
    for number in range(5):
        for name, data in zip(BLOCKS, vtk_blocks(written, number), strict=True):
            assert_same_as_vtk(data, name, number)
    with open_run(written) as run:
        assert run.series["upper_force"].shape == (5, 3)
        assert run.units["upper_force"] == "N"
        assert not run.summary()["finished"]


def test_resume_from_the_first_frame_on(written):
    with TrajectoryWriter.resume(written, 0) as writer:
        writer.append(make_frame(4))
    assert_same_as_vtk(vtk_blocks(written, 0)[2], "contacts", 4)


def test_resume_beyond_the_file_is_refused(written):
    with pytest.raises(InputError, match="5 frames"):
        TrajectoryWriter.resume(written, 6)
    with open_run(written) as run:
        assert run.frames == 5
    assert not list(written.parent.glob("*.part"))


def test_a_full_disk_is_reported_once_and_keeps_what_was_written(tmp_path, monkeypatch):
    path = tmp_path / "run.vtkhdf"
    writer = TrajectoryWriter(path, HEADER, STATIC)
    for number in range(3):
        writer.append(make_frame(number))
    usage = namedtuple("usage", "total used free")
    monkeypatch.setattr(vtkhdf.shutil, "disk_usage", lambda _: usage(10, 10, 1000))
    with pytest.raises(OutputError, match="disk is full.*3 frames written before are kept"):
        writer.append(make_frame(3))
    assert_same_as_vtk(vtk_blocks(path, 2)[1], "clumps", 2)


def test_a_failing_write_becomes_an_output_error(tmp_path, monkeypatch):
    path = tmp_path / "run.vtkhdf"
    writer = TrajectoryWriter(path, HEADER, STATIC)
    writer.append(make_frame(0))

    def fail(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(polydata_block.Column, "extend", fail)
    with pytest.raises(OutputError, match="No space left.*the frame written before is kept"):
        writer.append(make_frame(1))
    with open_run(path) as run:
        assert run.frames == 1


def test_a_folder_that_is_not_there_is_an_output_error(tmp_path):
    with pytest.raises(OutputError, match="cannot be written"):
        TrajectoryWriter(tmp_path / "absent" / "run.vtkhdf", HEADER, STATIC)


def test_texts_among_the_arrays_are_refused(tmp_path):
    frame = make_frame(0)
    wrong = Frame(0.0, frame.spheres, {**frame.clumps, "name": ["a", "b", "c"]}, frame.contacts)
    with TrajectoryWriter(tmp_path / "run.vtkhdf", HEADER, STATIC) as writer:
        with pytest.raises(TypeError, match="'name'"):
            writer.append(wrong)


@pytest.mark.parametrize("change", ["missing", "extra", "short"])
def test_arrays_that_differ_from_the_first_frame_are_refused(tmp_path, change):
    with TrajectoryWriter(tmp_path / "run.vtkhdf", HEADER, STATIC) as writer:
        writer.append(make_frame(0))
        frame = make_frame(1)
        clumps = dict(frame.clumps)
        if change == "missing":
            del clumps["state"]
        elif change == "extra":
            clumps["heat"] = np.zeros(3)
        else:
            clumps["state"] = clumps["state"][:2]
        with pytest.raises(ValueError, match="clumps"):
            writer.append(Frame(1.0, frame.spheres, clumps, frame.contacts, frame.plates, frame.series))
        # A refused frame leaves nothing behind.
        writer.append(frame)
    assert_same_as_vtk(vtk_blocks(tmp_path / "run.vtkhdf", 1)[1], "clumps", 1)


def test_the_script_for_paraview_is_python_and_knows_the_states(written):
    text = written.with_name("open_in_paraview.py").read_text(encoding="utf-8")
    compile(text, "open_in_paraview.py", "exec")
    assert '["free", "sticking", "sliding", "rolling"]' in text
