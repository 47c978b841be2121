"""Forecast against fact as a picture; the forecast on slopes against another linear programme, hulls, closed forms, a run."""

import itertools
import json
import math
import os
from types import SimpleNamespace

import friction_cones as reference
import hull_conditions
import numpy as np
import pytest
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
import thirdbody
from thirdbody.api import open_run
from thirdbody.kernels.tables import DEBRIS, LOWER, UPPER
from thirdbody.palette import STATE_COLORS
from thirdbody.plot import forecast_plot
from thirdbody.plot.forecast_plot import BAND, NEVER, Forecasts, agreement, draw_into
from thirdbody.report import slopes
from thirdbody.report.forecast import compare_forecast, forecasts
from thirdbody.report.slopes import EDGES, IMPOSSIBLE, POSSIBLE, Support, can_slide, can_stick, slopes_report
from thirdbody.trajectory.names import Frame
from thirdbody.trajectory.writer import TrajectoryWriter

# body, friction, t_min, t_max, told that it can slide, fact, margin
ROWS = [
    (0, 0.2, 0.1, 0.4, True, "sliding", 0.5),  # 0.1 above t_min
    (1, 0.2, 0.1, 0.24, True, "rolling", 0.2),  # 0.04 below t_max; other than forecast
    (2, 0.2, -0.3, 0.1, False, "rolling", -0.5),
    (3, 0.2, 0.3, 0.9, False, "sliding", -0.5),  # other than forecast
    (4, 0.2, 0.199, 0.9, True, "rolling", 0.005),  # other than forecast, within the band
    (5, 0.2, 1e9, -1e9, False, "rolling", -5e9 - 1.0),  # no friction lets it slide
    (6, 0.5, 0.0, 0.0, False, "sticking", -1.0),  # other than forecast
]


def cloud(rows=ROWS) -> Forecasts:
    return Forecasts(*(np.array(column) for column in list(zip(*rows, strict=True))[:6]))


@pytest.fixture
def axes():
    axes = Figure().subplots()
    draw_into(axes, cloud(), "seven bodies")
    return axes


def points(axes, label):
    return next((np.asarray(c.get_offsets()) for c in axes.collections if c.get_label() == label), np.empty((0, 2)))


def test_margins_are_relative_distances_from_the_nearer_end():
    # rounding of two subtractions and a division; 0.2 - 0.199 loses three digits
    np.testing.assert_allclose(cloud().margin, [row[6] for row in ROWS], rtol=1e-12)
    still = cloud([(0, 0.0, end, 0.2, True, "sliding") for end in (-0.1, 0.1, 0.0)])
    assert still.margin.tolist() == [np.inf, -np.inf, 0.0]


def test_every_body_is_one_point_and_disagreements_are_ringed_named_and_counted(axes):
    found = {}
    for fact, label in forecast_plot.FACTS.items():
        members = [row for row in ROWS if row[5] == fact]
        where = points(axes, label)
        np.testing.assert_allclose(where[:, 0], [NEVER if row[2] > row[3] else row[6] for row in members], rtol=1e-12)
        assert np.rint(where[:, 1]).tolist() == [float(row[1] == 0.5) for row in members]  # rows by friction, from below
        found[fact] = len(where)
        (collection,) = (c for c in axes.collections if c.get_label() == label)
        assert to_hex(collection.get_facecolor()[0]).upper() == STATE_COLORS[fact]
    assert found == {"rolling": 4, "sliding": 2, "sticking": 1}
    assert [tick.get_text() for tick in axes.get_yticklabels()] == ["0.2", "0.5"]
    np.testing.assert_allclose(points(axes, "other than forecast")[:, 0], [0.2, -0.5, -1.0], rtol=1e-12)
    assert [text.get_text() for text in axes.texts if text.get_text().isdigit()] == ["1", "3", "6"]
    band = next(patch for patch in axes.patches if "open" in patch.get_label())
    assert (band.get_x(), band.get_x() + band.get_width()) == (-BAND, BAND)
    assert axes.get_title() == "seven bodies\nas forecast: 3 of 6 (50.0 %); 1 more in the 2 % band"
    few = Figure().subplots()
    draw_into(few, cloud([ROWS[0], ROWS[2]]))  # without disagreement there is no ring
    assert not len(points(few, "other than forecast")) and few.get_title() == "as forecast: 2 of 2 (100.0 %)"
    assert agreement(cloud([ROWS[4]])) == "as forecast: 0 of 0; 1 more in the 2 % band"


SCENE = """
scene = 1
pairs = [
{between = ["steel", "steel"], friction = 0.3}, {between = ["brass", "steel"], friction = 0.2},
{between = ["brass", "brass"], friction = 0.1}]
[plates.lower]
material = "steel"
[plates.upper]
material = "brass"
"""
STATES = ["free", "sticking", "sliding", "rolling"]
DISTANCES = (0.0, 0.0, 0.39e-6, 0.6e-6)  # the drag starts at frame 1; 40 a = 0.4 um: frame 2 is watched, frame 3 is not
LABELS = [[1, 1, 1, 1, 0], [3, 1, 1, 1, 0], [2, 3, 1, 2, 3], [3, 2, 1, 2, 3]]
REPORTED = (2, 1, 3, 0, 4)


def write_run(folder, message=REPORTED, distances=DISTANCES, rolled=None, partner=-1, path=1.0):
    """A run of five bodies, the last without a forecast, the second of brass; each on one spot. `rolled` (F, B): length that each
    body has rolled, m; `partner` of body 0 in the drag; `path`: share of the distance that the upper plate is away at the end."""
    folder.mkdir()
    header = {"scene_text": SCENE, "title": "five bodies", "state_names": STATES, "reason_names": ["none"],
              "units": {"distance": "m"}, "materials": ["steel", "brass"]}  # fmt: skip
    static = {"spheres": {}, "clumps": {"material": np.array([0, 1, 0, 0, 0])}}
    places, count = np.arange(15.0).reshape(5, 3), np.zeros(5, np.uint8)
    with TrajectoryWriter(folder / "run.vtkhdf", header, static) as writer:
        for number, distance in enumerate(distances):
            clumps = {"points": places, "state": np.array(LABELS[number], np.uint8), "state_reason": count}
            if message is not None:
                ends = {"t_min": np.array([0.1, 0.2, 0.0, 0.5, 0.0]), "t_max": np.array([0.4, 0.5, 0.9, 0.6, 0.0])}
                clumps |= {"forecast": np.array(message, np.uint8), **ends}
            clumps["quaternion"] = np.tile([1.0, 0.0, 0.0, 0.0], (5, 1))
            if number >= 2:  # bodies 1 and 2 have turned by 1.2 and 0.8 a/R of 0.01, and body 1 is given with the other sign
                half = 0.5 * np.array([[0.012], [0.008]])
                turned = np.hstack([np.cos(half), np.sin(half), 0.0 * half, 0.0 * half])
                clumps["quaternion"][1:3] = turned * [[-1.0], [1.0]]
            clumps |= {"mass": np.full(5, 4e-15)} | ({} if rolled is None else {"rolled_distance": np.array(rolled[number])})
            partners = np.array([partner if number else -1, -1, -1, -1, -1])
            contacts = {"points": places, "body": np.arange(5), "contact_radius": np.full(5, 1e-8), "partner": partners,
                        "overlap": np.full(5, 1e-10), "normal_force": np.full(5, 1e-4)}  # fmt: skip
            corners = np.zeros((8, 3))
            corners[4:, 0] = path * distance
            writer.append(Frame(float(number), {"points": places}, clumps, contacts, {"points": corners}, {"distance": distance}))
    return folder


def test_what_is_drawn_of_a_run(tmp_path):
    with open_run(write_run(tmp_path / "run")) as run:
        found, counted = forecasts(run), compare_forecast(run)
    assert found.body.tolist() == [0, 1, 2, 3]
    assert found.friction.tolist() == [0.2, 0.1, 0.2, 0.2]  # the lesser of the two plates
    assert found.slides.tolist() == [True, False, True, False]
    # body 0 rolls before the drag and after the watched way, neither counts
    assert found.fact.tolist() == ["sliding", "rolling", "sticking", "sliding"] and (found.t_min[3], found.t_max[1]) == (0.5, 0.5)
    assert counted["agree"] == int(found.correct.sum()) == 3 and counted["slides_instead"] == [3]
    # the plain fact is a turn by more than a/R: bodies 1 and 2, told to slide, turned by 1.2 and 0.8 of it whatever their labels
    with open_run(write_run(tmp_path / "told", message=(2, 3, 3, 4, 4))) as run:
        assert compare_forecast(run)["by_rotation"] == [2, 3]
    # coarse output showed bodies that tip onto a better seat as never rolling; the length that they rolled tells it
    rolled = np.zeros((4, 5))
    rolled[1:, 2] = 1e-8  # in the pressing: does not count
    rolled[2:, 3] = 2e-8  # between the frames 1 and 2
    with open_run(write_run(tmp_path / "rolled", rolled=rolled)) as run:
        assert forecasts(run).fact.tolist() == ["sliding", "rolling", "sticking", "rolling"]
        counted = compare_forecast(run)
    assert counted["agree"] == 4 and counted["rolls_as_forecast"] == [1, 3] and counted["slides_instead"] == []
    with open_run(write_run(tmp_path / "few", distances=(0.0, 0.0, 0.41e-6, 0.6e-6))) as run:
        counted = compare_forecast(run)
        assert len(forecasts(run).body) == 0
    assert (counted["forecast"], counted["agree"], counted["unwatched"]) == (0, 0, 4)


FOUND, PER_PARTICLE = {"support", "frames"}, 'support = "load_per_particle"'
CONDITIONS = [
    ({}, "", FOUND), ({"partner": 3}, "", FOUND | {"neighbours"}), ({"path": 0.5}, "", FOUND | {"reversal"}),
    ({"path": 0.985}, "", FOUND | {"reversal"}), ({"path": 0.995}, "", FOUND),  # a start between two frames
    ({}, PER_PARTICLE, {"frames"}), ({}, PER_PARTICLE + '\ngap = "8 um"', FOUND),
]  # fmt: skip


@pytest.mark.parametrize("words, scene, broken", CONDITIONS)
def test_the_conditions_of_the_forecast_are_evaluated_for_the_run(tmp_path, monkeypatch, words, scene, broken):
    monkeypatch.setattr(f"{__name__}.SCENE", SCENE + scene + "\n")
    with open_run(write_run(tmp_path / "run", **words)) as run:
        counted = compare_forecast(run)
    found = {condition["name"]: condition for condition in counted["conditions"]}
    assert {name for name, condition in found.items() if not condition["satisfied"]} == broken
    assert found["frames"]["value"] == 1.0 and found["neighbours"]["value"] == (0.5 if "partner" in words else 0.0)
    limits = [condition["limit"].replace("\u00a0", " ") for condition in counted["conditions"][:4]]
    assert limits == ["at most 20 %", "at most 0.005", "at most 0.5", "at least 8"]
    # overlap over radius is (overlap/a)^2; m v^2/(mu N a) with 0.3 um in 1 s, half of N on each side, mu 0.2 or, for brass, 0.1
    assert found["overlap"]["value"] == pytest.approx((1e-10 / 1e-8) ** 2, rel=1e-12)
    assert found["inertia"]["value"] == pytest.approx(4e-15 * (0.3e-6) ** 2 / (0.2 * 0.5e-4 * 1e-8), rel=1e-9)
    # body 3 was told to roll and did not turn; labels have it the same way here
    assert counted["by_rotation"] == [3, 4]
    assert counted["clear"] == [3, 4] and counted["alone"] == ([2, 2] if "partner" in words else [3, 4])


def test_the_command_draws_beside_its_tables(command, tmp_path):
    write_run(tmp_path / "run")
    code, out, err = command("states", "run", "-o", "x.png")
    assert (code, err) == (0, "") and "agreement 3 of 4" in out and out.endswith("\nx.png\n")
    assert "support of the upper plate" in out and "not met" in out  # the conditions stand beside the table
    assert (tmp_path / "x.png").read_bytes().startswith(b"\x89PNG")
    code, out, err = command("states", "run", "-o", "y.svg", "--json")
    assert code == 0 and json.loads(out)["forecast"]["agree"] == 3 and err == "y.svg\n"
    # matplotlib draws text as outlines and keeps the words as comments
    text = (tmp_path / "y.svg").read_text(encoding="utf-8")
    assert "five bodies" in text and "as forecast: 3 of 4 (75.0 %)" in text


REFUSED = [
    (REPORTED, DISTANCES, "x.gif", 2, "x.gif: a picture ends in .png, .pdf, .svg"),
    (REPORTED, DISTANCES, "nowhere/x.png", 5, "cannot be written"), (None, DISTANCES, "x.png", 3, "no body has a forecast"),
    ((4, 4, 4, 4, 4), DISTANCES, "x.png", 3, "no body has a forecast"), (REPORTED, (0.0, 0.0), "x.png", 3, "there is no drag"),
]  # fmt: skip


def test_what_cannot_be_drawn_is_reported_in_one_line(command, tmp_path):
    for number, (expected, distances, words, status, message) in enumerate(REFUSED):
        write_run(tmp_path / f"run{number}", expected, distances)
        code, _, err = command("states", f"run{number}", "-o", words)
        assert code == status and message in err and len(err.splitlines()) == 1, message
    assert sorted(os.listdir(tmp_path)) == [f"run{number}" for number in range(len(REFUSED))]


NO_WEIGHT, ALONG_X, RIGID = np.zeros(3), np.array([1.0, 0.0]), 0.0


def support(points, slopes, friction, above, weight=0.0) -> Support:
    """A body whose plates rise by `slopes` (n, 2) under its spots, under a load of 1."""
    above = np.asarray(above, bool)
    normals = np.column_stack([-np.asarray(slopes, float), np.ones(len(above))]) * np.where(above, -1.0, 1.0)[:, None]
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    return Support(np.asarray(points, float), normals, np.full(len(above), friction), above, 1.0, np.array([0.0, 0.0, -weight]))


def test_it_agrees_with_another_programme_on_random_slopes_and_between_planes_with_hulls():
    """Its load is a vertical force, that of the other one of normal forces: without weight both are mere scales."""
    rng, found = np.random.default_rng(0), []
    for _ in range(16):
        above = np.arange(6) < 3 if rng.random() < 0.5 else np.arange(3) < rng.integers(1, 3)
        points = np.column_stack([rng.normal(size=(len(above), 2)), np.where(above, 0.8, -0.8)])
        body = support(points, 0.3 * rng.normal(size=(len(above), 2)), rng.uniform(0.1, 0.8), above)
        grasp = reference.grasp(body.arms, body.normals, body.friction, body.above)
        inner, outer = (reference.can_balance(grasp, scale, EDGES) for scale in (1.0, 1.0 / math.cos(math.pi / EDGES)))
        found.append(can_stick(body))
        # polygons of both are turned against each other: a body between them may be report by one and not by the other
        assert not (inner and found[-1] == IMPOSSIBLE) and not (not outer and found[-1] == POSSIBLE)
    assert 2 <= found.count(POSSIBLE) <= 14
    rng, verdicts = np.random.default_rng(1), []
    for _ in range(12):
        upper, lower, height = 0.3 * rng.normal(size=(1, 2)), 2.0 * rng.normal(size=(3, 2)), 2.0
        points = np.vstack([np.column_stack([side, np.full(len(side), z)]) for side, z in ((upper, 1.0), (lower, -1.0))])
        required = hull_conditions.required_friction(upper, lower, height)
        low, high = hull_conditions.sliding_interval(upper, lower, height, ALONG_X)
        for friction in (0.1, 0.5, 1.0):
            body = support(points, np.zeros((4, 2)), friction, [True, False, False, False])
            if abs(friction - required) > 2e-3 * friction:  # polygons are 0.12 % of the friction wide
                assert (can_stick(body) == POSSIBLE) == (friction > required)
            if min(abs(friction - low), abs(friction - high)) > 2e-3 * friction:
                verdicts.append(can_slide(body, ALONG_X, True, np.full(4, RIGID)))
                assert (verdicts[-1] == POSSIBLE) == (low < friction < high)
    assert {POSSIBLE, IMPOSSIBLE} == set(verdicts)


def test_two_spots_stick_if_their_line_lies_in_both_cones_and_open_where_a_plate_falls_away():
    """Eqs. 16 and 19 on slopes: the line of both spots leans by `lean`; the cone of the lower one by its plate's slope."""
    for lean, slope in itertools.product((0.1, 0.3), (-0.2, 0.0, 0.15)):
        points = [(lean, 0.0, 1.0), (-lean, 0.0, -1.0)]
        required = math.tan(max(abs(math.atan(lean)), abs(math.atan(lean) + math.atan(slope))))
        for factor, verdict in ((0.997, IMPOSSIBLE), (1.003, POSSIBLE)):
            assert can_stick(support(points, [(0.0, 0.0), (slope, 0.0)], factor * required, [True, False])) == verdict
    # A spot that climbs a plate of this slope, on two feet that stick: its force leans by atan(mu) + atan(slope).
    mu, height = 0.3, 1.0
    for slope in (-0.1, 0.0, 0.2):
        reach = height * math.tan(math.atan(mu) + math.atan(slope))
        for factor, verdict in ((0.999, IMPOSSIBLE), (1.001, POSSIBLE)):
            points = [(0.0, 0.0, 0.5 * height), (factor * reach, 0.0, -0.5 * height), (-factor * reach, 0.0, -0.5 * height)]
            body = support(points, [(slope, 0.0), (0.0, 0.0), (0.0, 0.0)], mu, [True, False, False])
            body.friction[1:] = 1.0
            assert can_slide(body, ALONG_X, True, np.full(3, RIGID)) == verdict
            assert can_slide(body, ALONG_X, False, np.full(3, RIGID)) == IMPOSSIBLE  # the feet grip more
    # two spots above: the plate falls away from one as it slides, and the other alone cannot hold the body
    points = [(1.0, 0.0, 0.5), (-1.0, 0.0, 0.5), (0.2, 0.0, -0.5), (-0.2, 0.0, -0.5)]
    body = support(points, [(0.0, 0.0), (-0.05, 0.0), (0.0, 0.0), (0.0, 0.0)], 0.1, [True, True, False, False])
    body.friction[2:] = 1.0
    assert can_slide(body, ALONG_X, True, np.full(4, 0.06)) == POSSIBLE
    assert can_slide(body, ALONG_X, True, np.full(4, 0.04)) == IMPOSSIBLE
    # A foot beside the load: weight of the size of the load brings the lower resultant half way back to the centre of mass.
    for offset, verdict in ((0.55, POSSIBLE), (0.65, IMPOSSIBLE)):
        points = [(offset, 0.0, 0.5), (0.0, 0.0, -0.5)]
        # Eq. 2: N_1 p - (N_1 + m g) q = T h with q = 0, |T| <= mu N_1
        assert can_stick(support(points, np.zeros((2, 2)), 0.6, [True, False], weight=1.0)) == verdict


def test_a_run_gives_friction_by_plate_weight_and_neighbours(monkeypatch):
    """Two spots that lean by 0.1, the lower one on a slope of 0.15; a heavy foot beside the load; one that meets others."""
    falling = SimpleNamespace(effects=SimpleNamespace(gravity=[0.0, 0.0, -1.0]))
    monkeypatch.setattr(thirdbody.Scene, "parse", lambda text: falling)
    tables = {"effects": {"gravity": ["0 m/s2", "0 m/s2", "-1 m/s2"]}}
    one = support([(0.1, 0.0, 1.0), (-0.1, 0.0, -1.0)], [(0.0, 0.0), (0.15, 0.0)], 0.0, [True, False])
    foot = support([(0.55, 0.0, 0.5), (0.0, 0.0, -0.5)], np.zeros((2, 2)), 0.0, [True, False])
    cases, side, none = [one, foot, one], np.array([UPPER, LOWER] * 3 + [DEBRIS]), np.zeros((1, 3))
    rows = {"body": [0, 0, 1, 1, 2, 2, 2], "partner": [-1] * 6 + [2], "normal_force": np.ones(7), "overlap": np.ones(7)}
    contacts = {name: np.array(values) for name, values in rows.items()} | {"side": side, "contact_radius": np.ones(7)}
    contacts["position"] = np.vstack([*(body.arms for body in cases), none])
    contacts["normal"] = contacts["force"] = np.vstack([*(body.normals for body in cases), none])
    bodies = {"position": np.zeros((3, 3)), "mass": np.array([0.0, 1.0, 0.0]), "material": np.array([0, 1, 0])}
    for lower, upper, verdict in ((0.3, 0.15, POSSIBLE), (0.15, 0.3, IMPOSSIBLE)):  # needed: tan 14.2 degrees below, 0.1 above
        monkeypatch.setattr(slopes, "plate_friction", lambda run, mu=(lower, upper): np.array([[mu[0], 0.6], [mu[1], 0.6]]))
        run = SimpleNamespace(bodies=lambda k: bodies, contacts=lambda k: contacts, scene_tables=tables, scene_text="")
        found = slopes.slope_forecast(run, 0, ALONG_X)
        assert found.supported.tolist() == [True, True, False] and found.stick[:2].tolist() == [verdict, POSSIBLE]


def test_what_sticks_can_stick(shared_run, capsys, command):
    """Bodies at rest under load are in balance with forces inside their cones, so the programme has to find some."""
    run = shared_run("rough")
    slopes_report(run, 1, json=True)
    report = json.loads(capsys.readouterr().out)
    assert report["supported"] == len(report["bodies"])
    assert report["stick"]["sticking"] == [8, 0, 0]  # possible, impossible, undecided
    slopes_report(run, None, json=True)  # from the start of the drag, which is frame 1
    assert json.loads(capsys.readouterr().out) == report
    assert report["outcome"]["impossible"] == [8, 0]  # none can slide, and all were rolling
    slopes_report(run, -1, json=False)
    text = " ".join(capsys.readouterr().out.split())
    assert "can slide along the drag" in text and "against the first" not in text
    for arguments, code, words in ((("-o", "x.png"), 2, "--slopes"), (("--frame", "99"), 3, "no frame 99")):
        report = command("states", str(run), "--slopes", *arguments)
        assert report.code == code and words in report.err
