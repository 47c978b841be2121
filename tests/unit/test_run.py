"""The reader gives back array for array what the writer was given, and says clearly what it cannot read."""

from __future__ import annotations

import builtins

import h5py
import numpy as np
import pytest

from thirdbody.errors import InputError
from thirdbody.trajectory.reader import open_run
from thirdbody.trajectory.schema import Frame
from thirdbody.trajectory.writer import TrajectoryWriter

HEADER = {
    "scene_text": "scene = 1\n# µm\n",
    "state_names": ["free", "sticking", "sliding", "rolling"],
    "reason_names": ["none", "friction_limit"],
    "units": {"time": "s", "distance": "m", "displacement": "m", "upper_force": "N", "friction_coefficient": "1"},
    "domain": {"size": [4e-5, 2e-5], "periodic": True},
}
STATIC = {"spheres": {"radius": np.linspace(1.0, 2.0, 6), "clump": np.repeat([0, 1, 2], 2)}, "clumps": {"id": np.arange(3)}}
CONTACT_COUNTS = (0, 4, 0, 7, 2)


def make_frame(number: int, forecast: bool = False) -> Frame:
    rng = np.random.default_rng(number)
    count = CONTACT_COUNTS[number]
    clumps = {
        "points": rng.normal(size=(3, 3)),
        "force": rng.normal(size=(3, 3)),
        "state": np.array([number % 4, 1, 3], np.uint8),
        "state_reason": np.array([number % 2, 0, 1], np.uint8),
    }
    if forecast:
        clumps["forecast"] = np.full(3, number % 4, np.uint8)
    friction = np.nan if number == 4 else 0.1 * number
    return Frame(
        time=number * 0.5,
        spheres={"points": rng.normal(size=(6, 3)), "velocity": rng.normal(size=(6, 3))},
        clumps=clumps,
        contacts={"points": rng.normal(size=(count, 3)), "utilisation": rng.random(count)},
        plates={"points": rng.normal(size=(8, 3))},
        series={
            "time": number * 0.5,
            "distance": number * 2.0,
            "displacement": number * 2.0,
            "upper_force": rng.normal(size=3),
            "friction_coefficient": friction,
        },
    )


def write(folder, forecast=False, frames=5, finish=None):
    path = folder / "run.vtkhdf"
    with TrajectoryWriter(path, HEADER, STATIC) as writer:
        for number in range(frames):
            writer.append(make_frame(number, forecast))
        if finish is not None:
            writer.finish(finish)
    return path


@pytest.fixture
def run(tmp_path):
    write(tmp_path)
    with open_run(tmp_path) as run:
        yield run


@pytest.mark.parametrize("number", range(5))
def test_every_array_comes_back(run, number):
    frame = make_frame(number)
    readers = {"spheres": run.spheres, "clumps": run.bodies, "contacts": run.contacts, "plates": run.plates}
    for block, read in readers.items():
        arrays = read(number)
        written = {**frame.block(block), **STATIC.get(block, {})}
        assert set(arrays) == {"position" if name == "points" else name for name in written}
        for name, values in written.items():
            if block == "spheres" and name == "velocity":
                values = np.float32(values)  # stored so
            np.testing.assert_array_equal(arrays["position" if name == "points" else name], values)


def test_histories_and_names(run):
    frames = [make_frame(number) for number in range(5)]
    np.testing.assert_array_equal(run.times, [frame.time for frame in frames])
    np.testing.assert_array_equal(run.states, [frame.clumps["state"] for frame in frames])
    np.testing.assert_array_equal(run.reasons, [frame.clumps["state_reason"] for frame in frames])
    assert run.states.dtype == np.uint8
    assert run.state_names == HEADER["state_names"]
    assert run.reason_names == HEADER["reason_names"]
    assert run.scene_text == HEADER["scene_text"]


def test_series_and_units(run):
    forces = [make_frame(number).series["upper_force"] for number in range(5)]
    np.testing.assert_array_equal(run.series["upper_force"], forces)
    assert run.series["distance"].shape == (5,)
    assert run.units == HEADER["units"]


def test_forecast_only_where_it_was_recorded(tmp_path, run):
    with pytest.raises(AttributeError, match="recorded no 'forecast'"):
        _ = run.forecast
    assert not hasattr(run, "forecast")
    (tmp_path / "with").mkdir()
    with open_run(write(tmp_path / "with", forecast=True)) as other:
        np.testing.assert_array_equal(other.forecast[:, 0], [0, 1, 2, 3, 0])


def test_frames_from_the_end_and_beyond(run):
    np.testing.assert_array_equal(run.bodies(-2)["force"], run.bodies(3)["force"])
    np.testing.assert_array_equal(run.bodies()["force"], run.bodies(4)["force"])
    for outside in (5, -6):
        with pytest.raises(IndexError, match="from -5 to 4"):
            run.contacts(outside)


def test_a_run_without_frames(tmp_path):
    with open_run(write(tmp_path, frames=0)) as run:
        assert run.times.shape == (0,)
        assert run.summary() == {"frames": 0, "finished": False}
        with pytest.raises(IndexError, match="nothing was written yet"):
            run.bodies(-1)


def test_only_committed_frames_are_seen(tmp_path):
    path = write(tmp_path)
    with h5py.File(path, "r+") as file:
        file["VTKHDF/contacts/Steps"].attrs["NSteps"] = 3
    with open_run(path) as run:
        assert run.frames == 3
        assert run.times.shape == (3,)
        assert run.states.shape == (3, 3)
        assert run.series["distance"].shape == (3,)
        np.testing.assert_array_equal(run.bodies(-1)["force"], make_frame(2).clumps["force"])


def test_summary_of_figures_and_of_the_run(tmp_path):
    with open_run(write(tmp_path, finish={"wall_seconds": 2.5, "steps": np.int64(7)})) as run:
        summary = run.summary()
    assert summary["finished"] and summary["wall_seconds"] == 2.5 and summary["steps"] == 7
    figures = [summary[name] for name in ("frames", "bodies", "duration", "distance")]
    assert figures == [5, 3, 2.0, 8.0]
    # the second half of the 8 m: the intervals of frames 3 and 4 with 0.3 and NaN (unloaded); rel: one product
    assert summary["friction_coefficient"] == pytest.approx(0.3, rel=1e-14)
    assert summary["fractions"] == {"free": 1 / 3, "sticking": 1 / 3, "sliding": 0.0, "rolling": 1 / 3}


def test_a_run_can_be_read_while_it_goes_on(tmp_path):
    path = tmp_path / "run.vtkhdf"
    with TrajectoryWriter(path, HEADER, STATIC) as writer:
        writer.append(make_frame(0))
        writer.append(make_frame(1))
        copy = tmp_path / "copy.vtkhdf"
        copy.write_bytes(path.read_bytes())  # what another process sees at this moment
        with open_run(copy) as run:
            assert run.frames == 2
            np.testing.assert_array_equal(run.contacts(1)["position"], make_frame(1).contacts["points"])


def test_each_reader_of_a_growing_file_has_the_frames_of_the_moment_it_opened(tmp_path):
    path = tmp_path / "run.vtkhdf"
    with TrajectoryWriter(path, HEADER, STATIC) as writer:
        writer.append(make_frame(0))
        with open_run(path) as early:
            writer.append(make_frame(1))
            writer.append(make_frame(3))
            writer.finish({"seconds": 1.0})
            with open_run(path) as late:
                assert (early.frames, late.frames) == (1, 3)
                assert (early.summary()["finished"], late.summary()["finished"]) == (False, True)
                np.testing.assert_array_equal(late.contacts(2)["position"], make_frame(3).contacts["points"])
                np.testing.assert_array_equal(early.bodies(0)["force"], make_frame(0).clumps["force"])


def test_a_file_written_anew_leaves_its_readers_what_they_opened(tmp_path):
    with open_run(write(tmp_path)) as old:
        with open_run(write(tmp_path, frames=2)) as new:
            assert (old.frames, new.frames) == (5, 2)
        np.testing.assert_array_equal(old.contacts(3)["position"], make_frame(3).contacts["points"])


def test_pandas_has_one_column_per_component(run):
    pytest.importorskip("pandas")
    table = run.to_pandas()
    expected = ["time", "distance", "displacement", "upper_force_x", "upper_force_y", "upper_force_z", "friction_coefficient"]
    assert sorted(table.columns) == sorted(expected)
    np.testing.assert_array_equal(table["upper_force_z"], run.series["upper_force"][:, 2])


def test_without_pandas_the_message_says_so(run, monkeypatch):
    real_import = builtins.__import__

    def absent(name, *rest, **options):
        if name == "pandas":
            raise ImportError(name)
        return real_import(name, *rest, **options)

    monkeypatch.setattr(builtins, "__import__", absent)
    with pytest.raises(ImportError, match="pip install pandas"):
        run.to_pandas()


def test_missing_run(tmp_path):
    for path in (tmp_path, tmp_path / "nowhere", tmp_path / "run.vtkhdf"):
        with pytest.raises(InputError, match="no such run"):
            open_run(path)


def test_files_that_are_not_runs(tmp_path):
    text = tmp_path / "notes.txt"
    text.write_text("scene = 1")
    with pytest.raises(InputError, match="not an HDF5 file"):
        open_run(text)
    other = tmp_path / "other.h5"
    with h5py.File(other, "w") as file:
        file["a"] = [1, 2]
    with pytest.raises(InputError, match="not a run"):
        open_run(other)


def test_a_file_cut_short(tmp_path):
    path = write(tmp_path)
    content = path.read_bytes()
    path.write_bytes(content[: len(content) // 2])
    with pytest.raises(InputError, match="cut short"):
        open_run(path)
