"""The trajectory file as a kill leaves it, at any write or within one: both readers have the committed frames."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from slow import slow
from trial_run import HEADER, STATIC, assert_same_as_vtk, assert_vtk_frame, make_frame, vtk_blocks

from thirdbody.api import open_run
from thirdbody.trajectory import writer as vtkhdf
from thirdbody.trajectory.blocks import Sink
from thirdbody.trajectory.names import BLOCKS, Frame
from thirdbody.trajectory.writer import TrajectoryWriter

PAGE = 4096
"""Bytes that the system writes at once: SIGKILL may end a longer write at each of their multiples."""

BODIES = 16
"""So many that a chunk holds four frames, and the index of chunks, 64 to a node, grows by a node at frame 256 and at some 490."""


class Journal(Sink):
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
            blocks = vtk_blocks(path, number)
            assert len(blocks) == len(BLOCKS), f"{len(blocks)} blocks in VTK"
            for name, data in zip(BLOCKS, blocks, strict=True):
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
    static = {"spheres": {"radius": np.ones(BODIES)}, "clumps": {"id": np.arange(BODIES)}}
    notes = notes_of(520, static, wide_frame)
    seen, growing = set(), set()
    for report, place, data in notes:
        if data is not None and data[:4] == b"TREE":
            if report > 255 and place not in seen and data[5] == 0 and data[6:8] != b"\1\0":
                growing.add(report)
            seen.add(place)
    assert len(growing) >= 2, "no index grew by a node"
    torn, checked, faults = tmp_path / "torn.vtkhdf", 0, []
    nodes = {
        n + k for n, (report, _, data) in enumerate(notes) if report in growing and data and data[:4] == b"TREE" for k in (0, 1)
    }
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
