"""What leaves a run: tables with every digit, files for old readers; each whole or not there at all."""

import csv
import dataclasses
import os
import resource
import sys
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import numpy as np
import pytest
import pyvista
from thirdbody.api import open_run
from thirdbody.errors import InputError, OutputError, UsageError
from thirdbody.export.tables import export_run
from thirdbody.report.tables import states_report
from thirdbody.trajectory.names import BLOCKS, MAP_STATISTICS, Frame
from thirdbody.trajectory.writer import TrajectoryWriter

STATES = [[0, 1, 2], [1, 1, 2], [1, 1, 2], [1, 3, 0]]
HEADER = {
    "scene_text": "scene = 1\n", "state_names": ["free", "sticking", "sliding", "rolling"],
    "reason_names": ["none", "friction_limit"],
    "units": {"time": "s", "distance": "m", "displacement": "m", "upper_force": "N"},
}  # fmt: skip
STATIC = {"spheres": {"radius": np.linspace(1.0, 2.0, 600)}, "clumps": {"id": np.arange(3)}}


def make_frame(number: int, states: bool = True) -> Frame:
    rng = np.random.default_rng(number)
    count = (0, 4, 0, 3)[number]
    report = {"state": np.array(STATES[number], np.uint8), "state_reason": np.array([0, number in (0, 3), 0], np.uint8)}
    side = np.arange(count, dtype=np.uint8) % 3
    return Frame(
        time=number / 3.0,
        spheres={"points": rng.normal(size=(600, 3)), "velocity": rng.normal(size=(600, 3))},
        clumps={"points": rng.normal(size=(3, 3)), "torque": rng.normal(size=(3, 3)), **(report if states else {})},
        contacts={"points": rng.normal(size=(count, 3)), "side": side, "normal_force": rng.random(count) / 3.0},
        plates={"points": rng.normal(size=(8, 3))},
        series={"time": number / 3.0, "distance": number * 0.7, "displacement": number * 0.7, "upper_force": rng.normal(size=3)},
    )


def write(folder: Path, frames: int = 4, states: bool = True) -> Path:
    path = folder / "run.vtkhdf"
    with TrajectoryWriter(path, HEADER, STATIC) as writer:
        for number in range(frames):
            writer.append(make_frame(number, states))
        writer.finish({"wall_time": 1.0})
    return path


@pytest.fixture
def path(tmp_path) -> Path:
    return write(tmp_path)


def export(path: Path, **targets) -> list[Path]:
    return list(export_run(path, *(targets.pop(name, None) for name in ("csv", "pvd")), **targets))


def rows_of(path):
    with open(path, encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def numbers(rows: list[dict[str, str]], heading: str) -> list[float]:
    return [float(row[heading]) for row in rows]


def test_csv_has_every_digit_and_its_units_also_of_one_frame(path, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "pandas", None)  # which it does not need
    written = export(path, csv=tmp_path / "csv")
    assert [file.name for file in written] == ["series.csv", "bodies.csv", "contacts.csv", "transitions.csv"]
    series, bodies, contacts = (rows_of(file) for file in written[:3])
    frames = [make_frame(number) for number in range(4)]
    # equal, not near: a float is written with as many digits as give it back
    assert numbers(series, "time [s]") == [frame.time for frame in frames]
    assert numbers(series, "upper_force_z [N]") == [frame.series["upper_force"][2] for frame in frames]
    assert numbers(bodies, "torque_y [N m]") == [value for frame in frames for value in frame.clumps["torque"][:, 1]]
    assert [(row["frame"], row["body"]) for row in bodies[2:4]] == [("0", "2"), ("1", "0")]
    assert [row["state_name"] for row in bodies[-3:]] == ["sticking", "rolling", "free"]
    assert [row["state_reason_name"] for row in bodies[:2]] == ["none", "friction_limit"]
    assert [row["frame"] for row in contacts] == ["1"] * 4 + ["3"] * 3
    assert numbers(contacts, "normal_force [N]") == [v for frame in frames for v in frame.contacts["normal_force"]]
    assert [row["side_name"] for row in contacts[:3]] == ["lower", "upper", "debris"]
    export(path, csv=tmp_path / "one", frame=-2)
    assert [row["frame"] for row in rows_of(tmp_path / "one" / "bodies.csv")] == ["2"] * 3
    assert (tmp_path / "one" / "contacts.csv").read_text().startswith("frame,time [s],side,side_name,position_x [m]")
    assert rows_of(tmp_path / "one" / "contacts.csv") == []
    export(path, csv=tmp_path / "first", frame=0)
    assert {row["frame"] for row in rows_of(tmp_path / "first" / "bodies.csv")} == {"0"}
    assert len(rows_of(tmp_path / "one" / "series.csv")) == 4


def test_transitions_report_what_changed(path, tmp_path):
    with open_run(path) as run:
        found = run.transitions()
    changes = list(zip(*(found[name].tolist() for name in ("frame", "body", "from", "to", "reason")), strict=True))
    assert changes == [(1, 0, 0, 1, 0), (3, 1, 1, 3, 1), (3, 2, 2, 0, 0)]
    np.testing.assert_array_equal(found["time"], [make_frame(n).time for n in (1, 3, 3)])
    np.testing.assert_array_equal(found["distance"], [make_frame(n).series["distance"] for n in (1, 3, 3)])
    wanted = [make_frame(n).clumps["points"][body] for n, body in ((1, 0), (3, 1), (3, 2))]
    np.testing.assert_array_equal(found["position"], wanted)
    export(path, csv=tmp_path / "csv")
    names = [(row["from_name"], row["to_name"]) for row in rows_of(tmp_path / "csv" / "transitions.csv")]
    assert names == [("free", "sticking"), ("sticking", "rolling"), ("sliding", "free")]
    path = write(tmp_path, states=False)
    assert "transitions.csv" not in [file.name for file in export(path, csv=tmp_path / "without")]
    with open_run(path) as run, pytest.raises(AttributeError, match="recorded no 'state'"):
        run.transitions()


def test_pvd_files_hold_every_array(path, tmp_path):
    export(path, pvd=tmp_path / "pvd")
    with open_run(path) as run:
        for block in BLOCKS:
            entries = ElementTree.parse(tmp_path / "pvd" / f"{block}.pvd").findall("Collection/DataSet")
            assert [float(entry.get("timestep")) for entry in entries] == run.times.tolist()
            for number, entry in enumerate(entries):
                data, wanted = pyvista.read(tmp_path / "pvd" / entry.get("file")), run.block(block, number)
                points = wanted.pop("position")
                assert (data.n_points, data.n_cells) == (len(points), 2 if block == "plates" else len(points))
                np.testing.assert_array_equal(data.points, points)
                for name, values in wanted.items():
                    got = data.point_data[name]
                    assert got.dtype == values.dtype
                    np.testing.assert_array_equal(got, values)
    script = (tmp_path / "pvd" / "open_in_paraview.py").read_text(encoding="utf-8")
    compile(script, "open_in_paraview.py", "exec")
    assert 'FILES = "{name}.pvd"' in script


BOTH = pytest.mark.parametrize("kind", ["csv", "pvd"])


@BOTH
def test_what_exists_is_refused_and_replaced_when_requested(path, tmp_path, kind):
    target = {kind: tmp_path / "there"}
    export(path, **target)
    before = sorted(file.name for file in tmp_path.iterdir())
    with pytest.raises(OutputError, match="exists already; overwrite=True replaces it") as refused:
        export(path, **target)
    assert refused.value.for_command_line().endswith("exists already; --overwrite replaces it")
    export(path, overwrite=True, **target)
    assert sorted(file.name for file in tmp_path.iterdir()) == before, "nothing may be left beside the target"
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "notes.txt").write_text("keep me")
    with pytest.raises(OutputError, match="other files .notes.txt."):
        export(path, overwrite=True, **{kind: tmp_path / "mine"})
    assert (tmp_path / "mine" / "notes.txt").read_text() == "keep me"


def test_other_files_below_a_folder_of_ours_are_never_deleted(path, tmp_path):
    plants = {
        "spheres/notes.txt": ("", Path.touch), "spheres/mine": ("0001.vtp", Path.touch), "mine": ("", Path.mkdir),
        "contacts/link.vtp": ("", lambda mine: mine.symlink_to(path)),
    }  # fmt: skip
    for number, (name, (below, plant)) in enumerate(plants.items()):
        folder = tmp_path / f"pvd{number}"
        export(path, pvd=folder)
        mine = folder / name / below
        mine.parent.mkdir(exist_ok=True)
        plant(mine)
        with pytest.raises(OutputError, match=rf"pvd{number}: holds other files \({name}\) and will not be overwritten"):
            export(path, overwrite=True, pvd=folder)
        assert os.path.lexists(mine) and path.exists()


def test_calls_that_cannot_work_write_nothing(path, tmp_path):
    with pytest.raises(UsageError, match="say what to write"):
        export(path)
    with pytest.raises(InputError, match="no frame 4; frames are from -4 to 3"):
        export(path, csv=tmp_path / "csv", frame=4)
    with pytest.raises(OutputError, match="No such file or directory"):
        export(path, csv=tmp_path / "absent" / "csv")
    (tmp_path / "pvd").write_text("mine")
    with pytest.raises(OutputError, match="pvd: exists already"):
        export(path, csv=tmp_path / "csv", pvd=tmp_path / "pvd")
    assert sorted(file.name for file in tmp_path.iterdir()) == ["pvd", "run.vtkhdf"]


@BOTH
def test_a_write_that_fails_is_reported_once_and_changes_nothing(path, tmp_path, kind):
    """The system itself refuses to write on, as it does when a disk is full."""
    target = tmp_path / "there"
    export(path, **{kind: target})
    before = {file: file.read_bytes() for file in target.rglob("*") if file.is_file()}
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    with pytest.raises(OutputError) as failed:
        try:
            resource.setrlimit(resource.RLIMIT_FSIZE, (600, limits[1]))
            export(path, overwrite=True, **{kind: target})
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert "cannot be written (File too large); nothing was changed there" in str(failed.value)
    assert len(str(failed.value).splitlines()) == 1
    assert {file: file.read_bytes() for file in before} == before
    assert sorted(file.name for file in tmp_path.iterdir()) == ["run.vtkhdf", "there"]


def test_numbers_of_maps_since_the_start_and_per_cycle(tmp_path, capsys):
    """Three strokes between 0 and 1 m; the first wears twice as fast, and does not count for the rate: 2 times a row of cells."""
    cells, worn = np.array([[1.0, 0.0], [2.0, 4.0]]), [0, 2, 4, 5, 6, 7, 8]
    header = HEADER | {"domain": {"size": [2.0, 1.0]}, "units": HEADER["units"] | {"wear_depth": "m"}}
    with TrajectoryWriter(tmp_path / "run.vtkhdf", header, STATIC) as writer:
        for number, depth in enumerate(worn):
            frame = make_frame(number % 4)
            series = {"time": float(number), "distance": float(number), "displacement": float(number % 2)}
            maps = {"wear_depth": np.stack([depth * cells, 0.0 * cells])}
            writer.append(dataclasses.replace(frame, time=float(number), series=series, maps=maps))
        writer.finish({"wall_time": 1.0})
    with open_run(tmp_path) as run:
        for given, scale in (({}, 8.0), ({"frame": 1}, 2.0), ({"cycles": 1.0}, 2.0), ({"cycles": 1000.0}, 2000.0)):
            rows = run.map_statistics(**given)
            assert rows["plate"].tolist() == ["lower", "upper"] and set(rows["map"]) == {"wear_depth"}
            # of 1, 2 and 4: the 95th percentile lies at 1.9 of the steps from the least; a cell has 0.5 m2
            for name, value in {"mean": 7.0 / 3.0, "percentile_95": 3.8, "largest": 4.0, "total": 3.5}.items():
                assert rows[name] == pytest.approx([scale * value, 0.0], rel=1e-12), (given, name)
            assert rows["area_fraction"].tolist() == [0.75, 0.0] and set(rows["total_unit"]) == {"m3"}
        with pytest.raises(InputError, match="cycles: -1 must be greater than 0"):
            run.map_statistics(cycles=-1.0)
        assert set(run.to_pandas("map_statistics")["over"]) == {"run", "cycle"}
    table = rows_of(export(tmp_path / "run.vtkhdf", csv=tmp_path / "csv")[-1])
    assert [row["over"] for row in table] == ["run", "run", "cycle", "cycle"]
    states_report(tmp_path, None, json=False, cycles=1000.0)
    shown = capsys.readouterr().out
    assert "maps of the plates: 1000 cycles, by the mean rate" in shown and "7e+21 um3" in shown
    assert MAP_STATISTICS.keys() == rows.keys()
