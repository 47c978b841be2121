"""The trajectory file: read back by VTK's own reader, also as a kill leaves it at any write or within one."""

import os
import shutil
import signal
import subprocess
import sys
import time
from collections import namedtuple
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest
from slow import slow
from trial_run import CONTACT_COUNTS, HEADER, STATIC, assert_same_as_vtk, assert_vtk_frame, make_frame, vtk_blocks, write_frames
from thirdbody.api import open_run
from thirdbody.errors import InputError, OutputError
from thirdbody.export.paraview import write_paraview_files, write_sidecars
from thirdbody.render.picture_data import read_picture_data
from thirdbody.render.web_viewer import write_page
from thirdbody.trajectory import blocks
from thirdbody.trajectory import writer as vtkhdf
from thirdbody.trajectory.names import BLOCKS, Frame
from thirdbody.trajectory.writer import TrajectoryWriter

PAGE = 4096  # bytes that the system writes at once: SIGKILL may end a longer write at each of their multiples
BODIES = 16
"""So many that a chunk holds four frames, and the index of chunks, 64 to a node, grows by a node at frame 256 and at some 490."""


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
        run.header["title"] = "@DATA@"
        text = write_page(run, range(run.frames), tmp_path / "p.html").read_text(encoding="utf-8")
    assert "<title>@DATA@" in text and '"positions": {}' in text


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


class Journal(blocks.Sink):
    """Notes every write and every change of size with the number of frames that were committed by then."""

    notes: list[tuple] = []
    writer: TrajectoryWriter | None = None

    def put(self, place, data):
        self.notes.append((Journal.writer.frames if Journal.writer else 0, place, bytes(data)))
        super().put(place, data)

    def truncate(self, size=None):
        self.notes.append((Journal.writer.frames if Journal.writer else 0, size, None))
        return super().truncate(size)


@pytest.fixture
def notes_of(tmp_path, monkeypatch) -> Callable:
    monkeypatch.setattr(vtkhdf, "Sink", Journal)

    def notes(frames: int, static: dict, frame: Callable[[int], Frame]) -> list[tuple]:
        monkeypatch.setattr(Journal, "notes", [])
        monkeypatch.setattr(Journal, "writer", None)
        with TrajectoryWriter(tmp_path / "run.vtkhdf", HEADER, static) as writer:
            Journal.writer = writer
            for number in range(frames):
                writer.append(frame(number))
            return list(Journal.notes)

    return notes


def states(path: Path, notes: list[tuple]) -> Iterator[tuple[int, int, bool]]:
    """Makes the file at `path` as it is after every write and at every page's end within one: which write, frames told, torn."""
    with open(path, "wb", buffering=0) as file:
        for n, (report, place, data) in enumerate(notes):
            if data is None:
                file.truncate(place)
            else:
                for end in range((place // PAGE + 1) * PAGE, place + len(data), PAGE):
                    file.seek(place)
                    file.write(data[: end - place])
                    yield n, report, True
                file.seek(place)
                file.write(data)
            yield n, report, False


def fault_of(path: Path, message: int, frame: Callable[[int], Frame]) -> str:
    """What is wrong with the file of which `report` frames were told, by our reader or by VTK's; nothing: empty."""
    try:
        with open_run(path) as run:
            frames = run.frames
            assert frames in (message, message + 1), f"{frames} frames"
            np.testing.assert_array_equal(run.times, [number * 1e-6 for number in range(frames)])
            for number in {0, frames // 2, frames - 1}:
                np.testing.assert_array_equal(run.bodies(number)["quaternion"], frame(number).clumps["quaternion"])
        # With one frame VTK ignores the steps and shows what is there of the second one too.
        for number in {0, frames - 1} if frames > 1 else ():
            read = vtk_blocks(path, number)
            assert len(read) == len(BLOCKS), f"{len(read)} blocks in VTK"
            for name, data in zip(BLOCKS, read, strict=True):
                points = np.array([data.GetPoint(i) for i in range(data.GetNumberOfPoints())]).reshape(-1, 3)
                np.testing.assert_array_equal(points, frame(number).block(name)["points"])
                cells = data.GetNumberOfCells()
                assert cells == len(points) // (4 if name == "plates" else 1), f"{cells} cells in VTK"
    except Exception as error:  # whatever a torn file makes a reader raise
        return f"{type(error).__name__}: {error}"[:200]
    return ""


@pytest.mark.parametrize(("frames", "apart"), [((2, 21, 256), 499), slow((1, 2, 20, 21, 255, 256), 97)])
def test_a_kill_at_any_single_write_leaves_the_committed_frames(tmp_path, notes_of, frames, apart):
    """The file as it is after the first n writes: around every header and change of size, now and then between, and torn."""
    notes = notes_of(258, STATIC, make_frame)  # counts and times begin their second chunk at 256, arrays at 21 and later
    edges = {n + k for n, (_, place, data) in enumerate(notes) if data is None or place == 0 for k in (0, 1)}
    torn, checked, faults = tmp_path / "torn.vtkhdf", 0, []
    for n, report, cut in states(torn, notes):
        # Before the first frame stands there is none to lose. In between all is as in the first frames.
        if report not in frames or not (cut or n in edges or n % apart == 0):
            continue
        checked += 1
        if fault := fault_of(torn, report, make_frame):
            faults.append((n, report, cut, fault))
    assert checked > 8 * len(frames)
    assert not faults, f"{len(faults)} of {checked}: {faults[:4]}"


def wide_frame(number: int) -> Frame:
    points = np.random.default_rng(number).normal(size=(BODIES, 3))
    bodies = {"points": points, "quaternion": np.tile(points[:, :1], 4)}
    few = {"points": points[:2]}
    return Frame(number * 1e-6, {"points": points}, bodies, few, {"points": points[:8]}, {"time": number * 1e-6})


@pytest.mark.full(kind="slow")
def test_a_kill_while_an_index_grows_by_a_node_leaves_the_committed_frames(tmp_path, notes_of):
    """A node is split: half of its entries, of frames committed long ago, move to a new one that the one above names first."""
    notes = notes_of(520, {"spheres": {"radius": np.ones(BODIES)}, "clumps": {"id": np.arange(BODIES)}}, wide_frame)
    seen, growing = set(), set()
    for report, place, data in notes:
        if data is not None and data[:4] == b"TREE":
            if report > 255 and place not in seen and data[5] == 0 and data[6:8] != b"\1\0":
                growing.add(report)
            seen.add(place)
    assert len(growing) >= 2, "no index grew by a node"
    torn, checked, faults = tmp_path / "torn.vtkhdf", 0, []
    trees = [n for n, (report, _, data) in enumerate(notes) if report in growing and data and data[:4] == b"TREE"]
    nodes = {n + k for n in trees for k in (0, 1)}
    for n, report, cut in states(torn, notes):
        if n in nodes or cut and report in growing:
            checked += 1
            if fault := fault_of(torn, report, wide_frame):
                faults.append((n, report, cut, fault))
    assert checked > 20
    assert not faults, f"{len(faults)} of {checked}: {faults[:4]}"


WRITE_FOR_EVER = """
import sys
sys.path[:0] = [{tests!r}]
from thirdbody.trajectory.writer import TrajectoryWriter
from slow import slow
from trial_run import HEADER, STATIC, make_frame
writer = TrajectoryWriter(sys.argv[1], HEADER, STATIC)
for number in range(100000):
    writer.append(make_frame(number))
    print(writer.frames, flush=True)
"""


@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="no SIGKILL on this system")
@pytest.mark.parametrize("delay", [0.013, *(pytest.param(delay, marks=pytest.mark.full(kind="slow")) for delay in (0.0, 0.05))])
def test_a_killed_writer_leaves_its_committed_frames(tmp_path, delay):
    path = tmp_path / "run.vtkhdf"
    code = WRITE_FOR_EVER.format(tests=str(Path(__file__).parents[1]))
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(p for p in sys.path if p)}
    with subprocess.Popen([sys.executable, "-c", code, str(path)], stdout=subprocess.PIPE, env=environment) as process:
        assert process.stdout is not None
        for _ in range(10):
            process.stdout.readline()
        time.sleep(delay)
        process.send_signal(signal.SIGKILL)
        lines = process.stdout.read().split()
    report = int(lines[-1]) if lines else 10
    with open_run(path) as run:
        # The frame being written when the signal came may have been committed, but not yet told.
        assert run.frames in (report, report + 1)
        last = run.frames - 1
        np.testing.assert_array_equal(run.bodies(last)["quaternion"], make_frame(last).clumps["quaternion"])
        frames = run.frames
    # As small as the frames are, all of them lie in one chunk: the reader must still see these frames only.
    assert_same_as_vtk(vtk_blocks(path, frames - 1)[1], "clumps", frames - 1)
    with TrajectoryWriter.resume(path, 7) as writer:
        assert writer.frames == 7
        writer.append(make_frame(7))
    with open_run(path) as run:
        assert run.frames == 8
    for number in (0, 6, 7):
        assert_vtk_frame(path, number)
