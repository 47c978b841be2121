"""Run files that lead out of themselves, that claim too much, that are still being written, or that were closed."""

from __future__ import annotations

import os
import subprocess
import sys
import tracemalloc

import h5py
import numpy as np
import pytest

from thirdbody.errors import InputError
from thirdbody.trajectory import open_file
from thirdbody.trajectory.reader import open_run
from thirdbody.trajectory.schema import Frame
from thirdbody.trajectory.writer import TrajectoryWriter

HEADER = {
    "scene_text": "scene = 1\n", "title": "", "state_names": ["free", "sticking"], "reason_names": ["none"],
    "units": {"time": "s"}, "domain": {"size": [4e-5, 2e-5], "periodic": True},
}  # fmt: skip
FRAMES = 4


@pytest.fixture
def path(tmp_path):
    """A sound run of some frames."""
    found = tmp_path / "run.vtkhdf"
    with TrajectoryWriter(found, HEADER, {"clumps": {"id": np.arange(3)}}) as writer:
        for number in range(FRAMES):
            codes = {"state": np.ones(3, np.uint8), "state_reason": np.zeros(3, np.uint8)}
            clumps = {"points": np.full((3, 3), float(number)), **codes}
            none = dict.fromkeys(("spheres", "contacts", "plates"))
            writer.append(Frame(time=float(number), clumps=clumps, series={"time": float(number)}, **none))
        writer.finish({})
    return found


def replaced(file, name, make):
    """Another data set in place of one, with its attributes."""
    attributes = dict(file[name].attrs)
    del file[name]
    make()
    file[name].attrs.update(attributes)


def linked(file, pipe):
    del file["VTKHDF/contacts"]
    file["VTKHDF/contacts"] = h5py.ExternalLink(pipe, "/x")


def unused(file, pipe):
    file["more"] = h5py.ExternalLink(pipe, "/x")


def soft(file, pipe):
    linked(file, pipe)
    file["scene/more"] = h5py.SoftLink("/VTKHDF/contacts/x")


def stored(file, pipe):
    outside = [(pipe, 0, h5py.h5f.UNLIMITED)]
    replaced(file, "scene/title", lambda: file.create_dataset("scene/title", (1,), "S10", external=outside))


def virtual(file, pipe):
    name = "VTKHDF/clumps/PointData/state"
    layout = h5py.VirtualLayout((3 * FRAMES,), "u1", maxshape=(None,))
    source = h5py.VirtualSource(pipe, "x", (12,), maxshape=(None,))
    layout[0 : h5py.h5s.UNLIMITED] = source[0 : h5py.h5s.UNLIMITED]
    replaced(file, name, lambda: file.create_virtual_dataset(name, layout))


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes here")
@pytest.mark.parametrize("spoil", [linked, unused, soft, stored, virtual])
def test_a_link_to_a_pipe_is_refused_before_it_is_opened(path, tmp_path, spoil):
    """In a process of its own: a pipe that is opened waits for ever."""
    pipe = str(tmp_path / "pipe")
    os.mkfifo(pipe)
    with h5py.File(path, "r+") as file:
        spoil(file, pipe)
    command = [sys.executable, "-m", "thirdbody", "states", str(path)]
    report = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert report.returncode == 3 and "another file" in report.stderr and len(report.stderr.splitlines()) == 1, report.stderr


def test_a_filter_that_hdf5_would_load_is_refused(path):
    """A registered number (LZ4) whose library HDF5 looks for and runs."""
    with h5py.File(path, "r+") as file:
        plan = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
        plan.set_chunk((8,))
        plan.set_filter(32004, h5py.h5z.FLAG_OPTIONAL, ())
        space = h5py.h5s.create_simple((8,))
        h5py.h5d.create(file["VTKHDF/clumps/PointData"].id, b"more", h5py.h5t.NATIVE_DOUBLE, space, plan)
    with pytest.raises(InputError, match="needs the filter 32004"):
        open_run(path)


def test_a_file_of_too_many_links_is_refused(path):
    with h5py.File(path, "r+") as file:
        group = file.create_group("more")
        for number in range(10_001):
            group[str(number)] = h5py.SoftLink("/scene")
    with pytest.raises(InputError, match="more than 10000 links"):
        open_run(path)


def claimed(file, name, size):
    """A text of so many bytes, none of which is in the file."""
    kind = h5py.h5t.C_S1.copy()
    kind.set_size(size)
    space = h5py.h5s.create(h5py.h5s.SCALAR)
    replaced(file, name, lambda: h5py.h5d.create(file.id, name.encode(), kind, space))


@pytest.mark.parametrize("name", ["scene/state_names", "scene/scene_text", "scene/summary"])
def test_a_text_that_claims_gigabytes_is_refused_before_it_is_read(path, name):
    with h5py.File(path, "r+") as file:
        claimed(file, name, 2_000_000_000)
    tracemalloc.start()
    try:
        with pytest.raises(InputError, match=f"{name} claims 2e.09 bytes, and the whole file has"):
            open_run(path).summary()
        assert tracemalloc.get_traced_memory()[1] < 10_000_000
    finally:
        tracemalloc.stop()


def test_a_long_json_text_is_refused_before_it_is_read(path):
    """It is there, in a file of 20 MB; read as JSON it would take 30 times as much."""
    with h5py.File(path, "r+") as file:
        text = np.bytes_(b"[" + b"[]," * 7_000_000 + b"[]]")
        replaced(file, "scene/state_names", lambda: file.create_dataset("scene/state_names", data=text))
    with pytest.raises(InputError, match="JSON texts claim 2.1e.07 bytes, at most 1.68e.07 are read"):
        open_run(path)


def test_what_was_half_written_is_read_again(path, monkeypatch):
    """Its writer completes it while the reader waits."""
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2])
    monkeypatch.setattr(open_file.time, "sleep", lambda seconds: path.write_bytes(whole))
    with open_run(path) as run:
        assert run.frames == FRAMES


def test_frames_are_read_again_from_an_open_run(path):
    """What an open file has kept of its index does not fit what was written since: a fresh opening does."""

    class Stale:
        def read(self, frame):
            raise InputError("damaged")

    with open_run(path) as run:
        run._blocks["clumps"] = Stale()
        assert run.bodies(2)["position"].tolist() == [[2.0] * 3] * 3


def test_a_file_that_never_comes_to_rest_is_said_to_be_written(path, monkeypatch):
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2])
    ticks = iter(range(10**9, 10**12, 10**9))
    monkeypatch.setattr(open_file.time, "sleep", lambda seconds: os.utime(path, ns=(0, next(ticks))))
    with pytest.raises(InputError, match="is being written.*try again"):
        open_run(path)


def test_a_damaged_file_is_not_said_to_be_written(path):
    path.write_bytes(path.read_bytes()[:-5000])
    with pytest.raises(InputError, match="cut short"):
        open_run(path)


@pytest.mark.parametrize("name", ["times", "states", "series", "units", "friction", "cycles", "has_states"])
def test_a_closed_run_is_not_damaged(path, name):
    run = open_run(path)
    run.close()
    with pytest.raises(ValueError, match="this run was closed; open it again"):
        getattr(run, name)


@pytest.mark.parametrize("name", ["bodies", "spheres", "contacts", "plates", "summary", "transitions"])
def test_a_closed_run_gives_no_frames(path, name):
    run = open_run(path)
    run.close()
    run.close()
    with pytest.raises(ValueError, match="this run was closed; open it again"):
        getattr(run, name)()


def test_a_frame_is_a_whole_number(path):
    with open_run(path) as run:
        for frame in (1.5, "1", None):
            with pytest.raises(TypeError, match="a frame is a whole number, not"):
                run.bodies(frame)
        assert run.bodies(np.int64(1))["id"].tolist() == [0, 1, 2]
        with pytest.raises(KeyError, match="did you mean 'state'"):
            run.array("clumps", "stat")


def test_a_run_that_is_never_closed_ends_no_process_with_a_crash(path):
    """One in a circle of references, as `Run.drag` makes it, is left over when the interpreter ends."""
    code = "import sys, thirdbody; run = thirdbody.open(sys.argv[1]); run.summary(); run.circle = run"
    report = subprocess.run([sys.executable, "-c", code, str(path)], capture_output=True, text=True, timeout=60)
    assert report.returncode == 0 and not report.stderr
