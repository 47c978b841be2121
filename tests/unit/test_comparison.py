"""Runs compared with the first one: numbers worked out by hand on made-up runs, other stops, other bodies, keys, the picture."""

import json
import math
from types import SimpleNamespace

import numpy as np
import pytest
from shared_runs import SHARED
import thirdbody
from thirdbody.palette import STATE_COLORS
from thirdbody.plot.comparison_plot import draw_comparison
from thirdbody.report.tables import as_plain
from thirdbody.runner.checkpoint import read_prints
from thirdbody.schema.parts import differences
from thirdbody.trajectory.names import Frame
from thirdbody.trajectory.writer import TrajectoryWriter

SCENE = 'scene = 1\n[[debris]]\nmaterial = "tin"\n[contact]\nlevel = "mindlin"\n'
STARTS = np.array([[1.0, 1.0, 1.0], [4.0, 1.0, 1.0], [1.0, 4.0, 1.0], [9.5, 4.0, 1.0]])
WHOLE = {"finished": True, "stopped": None, "energy_residual": 2e-5, "wall_time": 3.0, "steps": 400, "time_step": 1e-9}
MADE = {"stops": 12, "every": 1.0, "moved": 0.0, "starts": STARTS, "mass": np.ones(4), "work": np.ones(4), "spheres": 1,
        "states": None, "mu": None, "gap": None, "summary": WHOLE}  # fmt: skip


def write(folder, header=None, **changes):
    """A run of made-up arrays in a periodic domain of 10 by 10 m, dragged by `every` between its frames: bodies `moved` (B, 3) at
    the last one, with labels `states` (F, B), friction `mu` (F,) of the intervals, friction `work` (B,) at the end."""
    run = SimpleNamespace(**MADE | changes)
    count, frames = len(run.starts), run.stops + 1
    states = np.full((frames, count), 1) if run.states is None else run.states
    mu = 0.2 + 0.01 * np.sin(3.0 * np.arange(frames)) if run.mu is None else run.mu
    gap = np.full(frames, 2.0) if run.gap is None else run.gap
    head = {"scene_text": SCENE, "title": "made up", "state_names": list(STATE_COLORS), "reason_names": ["none"],
            "units": {"worn_volume": "m3"}, "domain": {"size": [10.0, 10.0], "periodic": True}}  # fmt: skip
    static = {"spheres": {"radius": np.ones(run.spheres * count), "clump": np.repeat(np.arange(count), run.spheres)},
              "clumps": {"id": np.arange(count), "mass": run.mass, "diameter": np.full(count, 2.0)}}  # fmt: skip
    folder.mkdir()
    with TrajectoryWriter(folder / "run.vtkhdf", head | (header or {}), static) as writer:
        for k in range(frames):
            points = (run.starts + (k == run.stops) * np.asarray(run.moved)) % [10.0, 10.0, 100.0]
            spheres, none = {"points": np.repeat(points, run.spheres, axis=0)}, {"points": np.zeros((0, 3))}
            clumps = {"points": points, "state": states[k].astype(np.uint8), "state_reason": np.zeros(count, np.uint8)}
            clumps |= {"friction_work": k / run.stops * run.work, "worn_volume": np.full(count, 1e-18 * k)}
            series = {"time": float(k), "distance": run.every * k, "gap": gap[k], "friction_coefficient": mu[k]}
            series |= {"upper_force": np.array([-2.0 * mu[k], 0.0, 2.0]), "energy_friction": 1.0 * k}
            series |= {f"fraction_{name}": float(np.mean(states[k] == code)) for code, name in enumerate(STATE_COLORS)}
            writer.append(Frame(float(k), spheres, clumps, none, {"points": np.zeros((8, 3))}, series))
        if run.summary is not None:
            writer.finish(run.summary)
    return folder


@pytest.fixture
def pair(tmp_path):
    """Body 2 slides from the sixth stop on, body 3 rolls at the third alone; the others stick. Body 3 leaves over the side."""
    states, moved = np.full((13, 4), 1), [[0.0, 0.0, 0.0], [0.0, 0.12, 0.0], [0.36, 0.0, 0.48], [0.72, 0.0, 0.0]]
    states[6:, 2], states[3, 3] = 2, 3
    write(tmp_path / "a")
    write(tmp_path / "b", moved=moved, states=states, work=np.array([1.0, 1.0, 3.0, 1.0]), mu=np.full(13, 0.21))
    return tmp_path / "a", tmp_path / "b"


def test_labels_places_and_friction_work_of_each_body(pair):
    report = thirdbody.compare(*pair, bodies=2)
    first, other = report["runs"]  # of the drag of 12 m: 0, .01, .05, .06; the mean place moves by (.27, .03, .12)
    expected = {"place_mean": 0.03, "place_largest": 0.06, "friction_work_mean": 0.5, "friction_work_largest": 2.0,
                "labels_at_end": 0.25, "label_difference": 8.0 / 48.0, "state_fraction_error": 8.0 / 48.0, "load_error": 0.0,
                "mean_position_error": math.hypot(0.27, 0.03, 0.12) / 12.0}  # fmt: skip
    assert {name: other["over_range"][name] for name in expected} == pytest.approx(expected, rel=1e-9)
    assert [row["body"] for row in other["bodies_listed"]] == [3, 2] and other["common_stops"] == 12
    listed = {"place": 0.05, "friction_work": 2.0, "labels": 7, "state": 1, "other_state": 2, "body": 2}
    assert other["bodies_listed"][1] == pytest.approx(listed, rel=1e-9)
    labels = other["labels"]
    assert labels["at_end"].tolist() == [[0] * 4, [0, 3, 1, 0], [0] * 4, [0] * 4]
    assert labels["at_all_stops"][1].tolist() == [0, 40, 7, 1] and labels["at_all_stops"].sum() == 48
    assert labels["difference"].tolist() == [0.0, 0.0, 0.25, 0.0, 0.0, *[0.25] * 7] and labels["distance"][2] == 3.0
    assert other["results"]["worn_volume"] == pytest.approx(4 * 12e-18) and report["units"]["worn_volume"] == "m3"
    friction = [row["results"]["friction_coefficient"] for row in (first, other)]
    assert other["difference"]["friction_coefficient"] == friction[1] - friction[0] and other["difference"]["gap"] == 0.0
    assert other["difference"]["fraction_sliding"] == 0.25 and report["settings"] == {} and "over_range" not in first


def test_other_stops_are_compared_over_the_common_range_and_labels_never_interpolated(tmp_path):
    mu = 0.1 + 0.01 * np.arange(25)
    halves = np.concatenate([[0.0], 0.5 * (mu[1:19:2] + mu[2:19:2])])  # the same friction, means over 1 m instead of 1/2
    states = np.full((25, 4), 1)
    states[1::2] = 2  # at the stops that only the fine run has
    write(tmp_path / "coarse", stops=9, mu=halves, gap=2.0 + 0.2 * np.arange(10))
    write(tmp_path / "fine", stops=24, every=0.5 + 1e-4, mu=mu, states=states, gap=2.0 + 0.1 * np.arange(25))
    write(tmp_path / "third", stops=8, every=1.5)
    report = thirdbody.compare(tmp_path / "coarse", tmp_path / "fine", tmp_path / "third")
    fine, third = report["runs"][1:]
    assert fine["common"] == 9.0 and fine["common_stops"] == 9 and fine["over_range"]["label_difference"] == 0.0
    assert fine["over_range"]["friction_error"] < 1e-3 and fine["over_range"]["load_error"] < 1e-3
    assert third["common_stops"] == 3 and third["labels"]["distance"].tolist() == [3.0, 6.0, 9.0]
    assert "energy_friction" not in fine["difference"] and "friction_coefficient" in fine["difference"]


@pytest.mark.parametrize("changes, reason", [
    ({"starts": STARTS[:3], "mass": np.ones(3), "work": np.ones(3)}, "4 bodies against 3"),
    ({"mass": np.array([1.0, 1.001, 1.0, 1.0])}, "other shapes: mass of 1 of 4 bodies differs"),
    ({"spheres": 3}, "other shapes: 4 spheres against 12"),
    ({"starts": STARTS + np.array([[0.3], [0.0], [0.0], [0.0]])}, "other places at the start: 1 of 4 bodies"),
    ({"every": 1e-3}, "no frames at the same distance"),
])  # fmt: skip
def test_why_bodies_cannot_be_compared_is_told_and_the_rest_is_compared(tmp_path, changes, reason):
    write(tmp_path / "a"), write(tmp_path / "b", **changes)
    report = thirdbody.compare(tmp_path / "a", tmp_path / "b")
    other = report["runs"][1]
    assert other["not_by_body"] == reason and reason in str(report) and "bodies_listed" not in other and "labels" not in other
    assert math.isnan(other["over_range"]["label_difference"]) and "friction_coefficient" in other["difference"]


def test_keys_that_differ_and_a_run_that_was_stopped(tmp_path, pair, command):
    assert differences({"a": [{"b": 1}, {"b": 2}], "c": {}}, {"a": [{"b": 1}, {"b": 3}], "c": {"d": [1, 2]}}) == {
        "a[1].b": [2, 3], "c": [{}, "absent"], "c.d": ["absent", [1, 2]]
    }  # fmt: skip
    head = {"scene_text": SCENE.replace("mindlin", "exact"), "versions": {"thirdbody": "9.9"}}
    stopped = write(tmp_path / "c", header=head, stops=6, summary=None)
    report = command("compare", *pair, stopped)
    assert report.code == 0 and "no: killed, or still running" in report.out
    lines = [" ".join(line.split()) for line in report.out.splitlines()]
    assert {"contact.level mindlin mindlin exact", "versions.thirdbody absent absent 9.9"} <= set(lines)
    assert str(thirdbody.compare(*pair, stopped)) == report.out
    assert json.loads(command("compare", *pair, stopped, "--json").out) == as_plain(thirdbody.compare(*pair, stopped))
    for words, code, text in (
        ([pair[0]], 2, "1 run: give two or more"), ([pair[0], "nowhere"], 3, "nowhere: no such run"),
        ([*pair, "-o", "x.gif"], 2, "ends in .png"), ([*pair, "-o", "no/x.png"], 5, "does not exist"),
    ):  # fmt: skip
        report = command("compare", *words)
        assert report.code == code and text in report.err and report.out == ""


def test_the_picture_shows_every_run_in_every_panel(pair, command, tmp_path):
    assert command("compare", *pair, "-o", "x.png").out.endswith("x.png\n") and (tmp_path / "x.png").stat().st_size > 20_000
    figure = draw_comparison(json.loads(command("compare", *pair, "--json").out))
    panels = {axes.get_label(): [line.get_ydata() for line in axes.lines] for axes in figure.axes}
    assert list(panels) == ["friction_coefficient", "states", "gap", "load", "labels"]
    assert panels["friction_coefficient"][1].tolist()[1:] == [0.21] * 12
    assert panels["labels"][0].tolist() == [0.0, 0.0, 25.0, 0.0, 0.0, *[25.0] * 7] and len(panels["gap"]) == 2
    assert [text.get_text() for text in figure.legends[0].texts] == ["1: a", "2: b"]


def test_a_scene_at_another_tolerance(shared_run, tmp_path):
    scene = thirdbody.Scene.parse(SHARED["layer"]).with_settings({"solver.tolerance": 2e-3})
    with thirdbody.run(scene, tmp_path / "run", threads=1, progress=False) as other:
        report = thirdbody.compare(shared_run("layer"), other)
    row = report["runs"][1]
    assert list(report["settings"]) == ["solver.tolerance"] and "sources" in read_prints(tmp_path / "run")["the contact laws"]
    assert row["labels"]["at_end"].sum() == 40 and 0.0 < row["over_range"]["place_largest"] < 0.5
