"""The reader gives back what the writer was given, and says what it cannot read."""

import os
import subprocess
import sys
import tracemalloc
from dataclasses import replace

import h5py
import numpy as np
import pytest
from trial_run import HEADER, STATIC, expected, make_frame, write_frames
from thirdbody.api import open_run
from thirdbody.errors import InputError
from thirdbody.trajectory import open_file
from thirdbody.trajectory.writer import TrajectoryWriter

UNITS = {"time": "s", "distance": "m", "displacement": "m", "upper_force": "N", "friction_coefficient": "1"}
FRAMES = 5


def frame_with(number: int, **more):
    frame = make_frame(number)
    friction = np.nan if number == 4 else 0.1 * number
    series = {"distance": number * 2.0, "displacement": number * 2.0, "friction_coefficient": friction}
    return replace(frame, series=frame.series | series, clumps=frame.clumps | more)


def write(folder, frames: int = FRAMES, **options):
    options = {"frame": frame_with, "header": HEADER | {"units": UNITS}} | options
    return write_frames(folder / "run.vtkhdf", range(frames), **options)


@pytest.fixture
def path(tmp_path):
    return write(tmp_path, finish={})


@pytest.fixture
def run(path):
    with open_run(path.parent) as run:
        yield run


def test_every_array_history_name_series_and_unit_comes_back(run, tmp_path):
    readers = {"spheres": run.spheres, "clumps": run.bodies, "contacts": run.contacts, "plates": run.plates}
    for number in range(FRAMES):
        for block, read in readers.items():
            arrays = read(number)
            written = {"position" if name == "points" else name: values for name, values in expected(block, number).items()}
            assert set(arrays) == set(written)
            for name, values in written.items():
                np.testing.assert_array_equal(arrays[name], values)
    frames = [frame_with(number) for number in range(FRAMES)]
    np.testing.assert_array_equal(run.times, [frame.time for frame in frames])
    np.testing.assert_array_equal(run.states, [frame.clumps["state"] for frame in frames])
    np.testing.assert_array_equal(run.reasons, [frame.clumps["state_reason"] for frame in frames])
    assert run.states.dtype == np.uint8
    for name in ("state_names", "reason_names", "scene_text"):
        assert getattr(run, name) == HEADER[name]
    np.testing.assert_array_equal(run.series["upper_force"], [frame.series["upper_force"] for frame in frames])
    assert run.series["distance"].shape == (5,) and run.units == UNITS
    # forecast only where it was recorded
    with pytest.raises(AttributeError, match="recorded no 'forecast'"):
        _ = run.forecast
    assert not hasattr(run, "forecast")
    (tmp_path / "with").mkdir()
    with open_run(
        write(tmp_path / "with", frame=lambda number: frame_with(number, forecast=np.full(3, number % 4, np.uint8)))
    ) as other:
        np.testing.assert_array_equal(other.forecast[:, 0], [0, 1, 2, 3, 0])


def test_frames_are_whole_numbers_also_from_the_end(run):
    np.testing.assert_array_equal(run.bodies(-2)["quaternion"], run.bodies(3)["quaternion"])
    np.testing.assert_array_equal(run.bodies()["quaternion"], run.bodies(4)["quaternion"])
    for outside in (5, -6):
        with pytest.raises(IndexError, match="from -5 to 4") as missing:
            run.contacts(outside)
        assert isinstance(missing.value, InputError)  # a command answers with one line and exit code 3
    for frame in (1.5, "1", None):
        with pytest.raises(TypeError, match="a frame is a whole number, not"):
            run.bodies(frame)
    assert run.bodies(np.int64(1))["id"].tolist() == [0, 1, 2]
    with pytest.raises(KeyError, match="did you mean 'state'"):
        run.array("clumps", "stat")


def test_a_run_without_frames_and_with_frames_that_were_not_committed(tmp_path):
    with open_run(write(tmp_path, frames=0)) as run:
        assert run.times.shape == (0,)
        assert run.summary() == {"frames": 0, "finished": False, "warnings": []} and run and not len(run)
        with pytest.raises(IndexError, match="nothing was written yet"):
            run.bodies(-1)
    # only committed frames are seen
    path = write(tmp_path)
    with h5py.File(path, "r+") as file:
        file["VTKHDF/contacts/Steps"].attrs["NSteps"] = 3
    with open_run(path) as run:
        assert run.frames == 3 and run.times.shape == run.series["distance"].shape == (3,)
        assert run.states.shape == (3, 3)
        np.testing.assert_array_equal(run.bodies(-1)["quaternion"], make_frame(2).clumps["quaternion"])


def test_summary_of_figures_and_of_the_run(tmp_path):
    with open_run(write(tmp_path, finish={"wall_seconds": 2.5, "steps": np.int64(7)})) as run:
        summary = run.summary()
    assert summary["finished"] and summary["wall_seconds"] == 2.5 and summary["steps"] == 7
    assert [summary[name] for name in ("frames", "bodies", "duration", "distance")] == [5, 3, 4 * 1e-6, 8.0]
    # the second half of the 8 m: the intervals of frames 3 and 4 with 0.3 and NaN (unloaded); rel: one product
    assert summary["friction_coefficient"] == pytest.approx(0.3, rel=1e-14)
    assert summary["fractions"] == {"free": 2 / 3, "sticking": 0.0, "sliding": 0.0, "rolling": 1 / 3}


def test_each_reader_of_a_growing_file_has_the_frames_of_the_moment_it_opened(tmp_path):
    path, copy = tmp_path / "run.vtkhdf", tmp_path / "copy.vtkhdf"
    with TrajectoryWriter(path, HEADER, STATIC) as writer:
        writer.append(make_frame(0))
        with open_run(path) as early:
            writer.append(make_frame(1))
            copy.write_bytes(path.read_bytes())  # what another process sees at this moment
            writer.append(make_frame(3))
            writer.finish({"seconds": 1.0})
            with open_run(path) as late, open_run(copy) as middle:
                assert (early.frames, middle.frames, late.frames) == (1, 2, 3)
                assert (early.summary()["finished"], late.summary()["finished"]) == (False, True)
                np.testing.assert_array_equal(middle.contacts(1)["position"], make_frame(1).contacts["points"])
                np.testing.assert_array_equal(late.contacts(2)["position"], make_frame(3).contacts["points"])
                np.testing.assert_array_equal(early.bodies(0)["quaternion"], make_frame(0).clumps["quaternion"])


def test_a_file_written_anew_leaves_its_readers_what_they_opened(run, tmp_path):
    with open_run(write(tmp_path, frames=2)) as new:
        assert (run.frames, new.frames) == (5, 2)
    np.testing.assert_array_equal(run.contacts(3)["position"], make_frame(3).contacts["points"])


def test_pandas_has_one_column_per_component(run):
    pytest.importorskip("pandas")
    table = run.to_pandas()
    columns = ["time", "distance", "displacement", "upper_force_x", "upper_force_y", "upper_force_z", "friction_coefficient"]
    assert sorted(table.columns) == sorted(columns)
    np.testing.assert_array_equal(table["upper_force_z"], run.series["upper_force"][:, 2])


def test_files_that_are_no_runs(tmp_path):
    for absent in (tmp_path, tmp_path / "nowhere", tmp_path / "run.vtkhdf"):
        with pytest.raises(InputError, match="no such run"):
            open_run(absent)
    text, other = tmp_path / "notes.txt", tmp_path / "other.h5"
    text.write_text("scene = 1")
    with h5py.File(other, "w") as file:
        file["a"] = [1, 2]
    for path, words in ((text, "not an HDF5 file"), (other, "not a run")):
        with pytest.raises(InputError, match=words):
            open_run(path)


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


def claimed(file, name, size):
    kind = h5py.h5t.C_S1.copy()
    kind.set_size(size)
    attributes = dict(file[name].attrs)
    del file[name]
    h5py.h5d.create(file.id, name.encode(), kind, h5py.h5s.create(h5py.h5s.SCALAR))
    file[name].attrs.update(attributes)


def test_a_text_that_claims_gigabytes_is_refused_before_it_is_read(path):
    whole = path.read_bytes()
    for name in ("scene/state_names", "scene/scene_text", "scene/summary"):
        path.write_bytes(whole)
        with h5py.File(path, "r+") as file:
            claimed(file, name, 2_000_000_000)
        tracemalloc.start()
        try:
            with pytest.raises(InputError, match=f"{name} claims 2e.09 bytes, and the whole file has"):
                open_run(path).summary()
            assert tracemalloc.get_traced_memory()[1] < 10_000_000
        finally:
            tracemalloc.stop()


def test_what_was_half_written_is_read_again(path, monkeypatch):
    """Its writer completes it while the reader waits; or it never comes to rest; or it is damaged."""
    whole, ticks = path.read_bytes(), iter(range(10**9, 10**12, 10**9))
    path.write_bytes(whole[: len(whole) // 2])
    with pytest.raises(InputError, match="cut short"):
        open_run(path)
    monkeypatch.setattr(open_file.time, "sleep", lambda seconds: os.utime(path, ns=(0, next(ticks))))
    with pytest.raises(InputError, match="is being written.*try again"):
        open_run(path)
    monkeypatch.setattr(open_file.time, "sleep", lambda seconds: path.write_bytes(whole))
    with open_run(path) as run:
        assert run.frames == FRAMES
    monkeypatch.undo()
    path.write_bytes(whole[:-5000])
    with pytest.raises(InputError, match="cut short"):
        open_run(path)


def test_a_closed_run_is_not_damaged_and_gives_no_frames(path):
    run = open_run(path)
    run.close()
    run.close()
    for name in ("times", "states", "series", "units", "friction", "cycles", "has_states"):
        with pytest.raises(ValueError, match="this run was closed; open it again"):
            getattr(run, name)
    for name in ("bodies", "spheres", "contacts", "plates", "summary", "transitions"):
        with pytest.raises(ValueError, match="this run was closed; open it again"):
            getattr(run, name)()


@pytest.mark.full(kind="slow")
def test_a_run_that_is_never_closed_ends_no_process_with_a_crash(path):
    """One in a circle of references, as `Run.drag` makes it, is left over when the interpreter ends."""
    code = "import sys, thirdbody; run = thirdbody.open(sys.argv[1]); run.summary(); run.circle = run"
    report = subprocess.run([sys.executable, "-c", code, str(path)], capture_output=True, text=True, timeout=60)
    assert report.returncode == 0 and not report.stderr
