"""The trajectory file, read back by VTK's own reader: a file with a fault in its layout "reads" as empty."""

import shutil
from collections import namedtuple
from dataclasses import replace

import h5py
import numpy as np
import pytest
from trial_run import CONTACT_COUNTS, HEADER, STATIC, assert_same_as_vtk, assert_vtk_frame, make_frame, vtk_blocks, write_frames

from thirdbody.api import open_run
from thirdbody.errors import InputError, OutputError
from thirdbody.export.paraview import write_paraview_files, write_sidecars
from thirdbody.render.picture_data import read_picture_data
from thirdbody.render.web_viewer import write_page
from thirdbody.trajectory import blocks
from thirdbody.trajectory import writer as vtkhdf
from thirdbody.trajectory.names import BLOCKS
from thirdbody.trajectory.writer import TrajectoryWriter


@pytest.fixture
def written(tmp_path):
    path = write_frames(tmp_path / "run.vtkhdf", finish={"seconds": 1.5})
    write_paraview_files(path, HEADER["state_names"])
    return path


def test_vtk_reads_every_block_of_every_frame(written, tmp_path):
    """In the file, and in the plain sidecars of its blocks, which survive a move of the folder."""
    for number in range(5):
        assert_vtk_frame(written, number)
    moved = tmp_path / "elsewhere"
    moved.mkdir()
    for path in tmp_path.glob("run.*"):
        path.rename(moved / path.name)
    for block in BLOCKS:
        for number in range(5):
            (data,) = vtk_blocks(moved / f"run.{block}.vtkhdf", number)
            assert_same_as_vtk(data, block, number)


def test_times_static_arrays_the_script_for_paraview_and_a_scene_without_plates(written, tmp_path):
    vtk = pytest.importorskip("vtk")
    reader = vtk.vtkHDFReader()
    reader.SetFileName(str(written.with_name("run.clumps.vtkhdf")))
    reader.UpdateInformation()
    times = reader.GetOutputInformation(0).Get(vtk.vtkStreamingDemandDrivenPipeline.TIME_STEPS())
    assert list(times) == [number * 1e-6 for number in range(5)]
    # static arrays and topology are stored once and states are bytes
    with h5py.File(written) as file:
        root = file["VTKHDF"]
        assert root["spheres/PointData/radius"].shape == (6,)
        assert root["clumps/PointData/mass"].shape == (3,)
        assert list(root["spheres/Steps/PointDataOffsets/radius"]) == [0] * 5
        assert root["contacts/Vertices/Connectivity"].shape == (max(CONTACT_COUNTS),)
        assert root["contacts/Points"].shape == (sum(CONTACT_COUNTS), 3)
        assert root["clumps/PointData/state"].dtype == root["clumps/PointData/loaded"].dtype == np.uint8
    # the script for paraview is python and knows the states
    text = written.with_name("open_in_paraview.py").read_text(encoding="utf-8")
    compile(text, "open_in_paraview.py", "exec")
    assert '["free", "sticking", "sliding", "rolling"]' in text
    # a scene without plates has no polygons
    path = write_frames(tmp_path / "run.vtkhdf", [1], lambda number: replace(make_frame(number), plates=None))
    plates = vtk_blocks(path, 0)[BLOCKS.index("plates")]
    assert (plates.GetNumberOfPoints(), plates.GetNumberOfCells()) == (0, 0)
    # one without an upper plate has one
    lower = {"points": make_frame(0).plates["points"][:4]}
    path = write_frames(tmp_path / "lower.vtkhdf", [1], lambda number: replace(make_frame(number), plates=lower))
    plates = vtk_blocks(path, 0)[BLOCKS.index("plates")]
    assert (plates.GetNumberOfPoints(), plates.GetNumberOfCells()) == (4, 1)
    with open_run(path) as run:
        assert run.to_pyvista(0)["plates"].n_cells == 1
        read = read_picture_data(run, 0, "state")
    assert read.has_plates and not read.has_upper
    text = write_page(replace(read, title="@DATA@"), tmp_path / "p.html").read_text(encoding="utf-8")
    assert "<title>@DATA@" in text and '"upper": false' in text


def test_vtk_reads_the_file_as_a_kill_between_any_two_flushes_leaves_it(tmp_path, monkeypatch):
    """VTK reads all `Values` into a buffer of `NSteps`: with one more it corrupts its heap."""
    path, copies, flush = tmp_path / "run.vtkhdf", [], TrajectoryWriter._flush

    def flush_and_copy(writer):
        flush(writer)
        copies.append(shutil.copy(path, tmp_path / f"{len(copies)}.vtkhdf"))

    monkeypatch.setattr(TrajectoryWriter, "_flush", flush_and_copy)
    write_frames(path, range(3))
    assert len(copies) == 1 + 3 * 3
    for copy in copies:
        with h5py.File(copy) as file:
            for block in BLOCKS:
                steps = file["VTKHDF"][block]["Steps"]
                assert len(steps["Values"]) <= steps.attrs["NSteps"]
        with open_run(copy) as run:
            frames = run.frames
        # With one frame VTK ignores the steps and shows what is there of the second one too.
        for number in range(frames if frames > 1 else 0):
            assert_vtk_frame(copy, number)


def test_resume_drops_later_frames_and_goes_on(written):
    write_sidecars(written)
    with TrajectoryWriter.resume(written, 2) as writer:
        for number in range(2, 5):
            writer.append(make_frame(number))
    for number in range(5):
        assert_vtk_frame(written, number)
    with open_run(written) as run:
        assert run.series["upper_force"].shape == (5, 3) and run.units["upper_force"] == "N"
        assert not run.summary()["finished"]
    with pytest.raises(InputError, match="5 frames"):
        TrajectoryWriter.resume(written, 6)
    with open_run(written) as run:
        assert run.frames == 5
    assert not list(written.parent.glob("*.part"))
    with TrajectoryWriter.resume(written, 0) as writer:  # from the first frame on
        writer.append(make_frame(4))
    assert_same_as_vtk(vtk_blocks(written, 0)[2], "contacts", 4)


def test_a_full_disk_and_a_failing_write_are_reported_and_keep_what_was_written(tmp_path, monkeypatch):
    path = tmp_path / "run.vtkhdf"
    writer = TrajectoryWriter(path, HEADER, STATIC)
    for number in range(3):
        writer.append(make_frame(number))
    usage = namedtuple("usage", "total used free")
    monkeypatch.setattr(vtkhdf.shutil, "disk_usage", lambda _: usage(10, 10, 1000))
    with pytest.raises(OutputError, match="disk is full.*3 frames written before are kept"):
        writer.append(make_frame(3))
    assert_same_as_vtk(vtk_blocks(path, 2)[1], "clumps", 2)
    monkeypatch.undo()
    with pytest.raises(OutputError, match="cannot be written"):
        TrajectoryWriter(tmp_path / "absent" / "run.vtkhdf", HEADER, STATIC)
    writer = TrajectoryWriter(path, HEADER, STATIC)
    writer.append(make_frame(0))

    def fail(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(blocks.Column, "extend", fail)
    with pytest.raises(OutputError, match="No space left.*the frame written before is kept"):
        writer.append(make_frame(1))
    with open_run(path) as run:
        assert run.frames == 1
