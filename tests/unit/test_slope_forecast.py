"""The forecast on slopes: against another linear programme, the hulls of parallel planes, closed forms, labels of a run."""

import itertools
import json
import math
from types import SimpleNamespace

import friction_cones as reference
import hull_conditions
import numpy as np

from thirdbody.kernels.tables import DEBRIS, LOWER, UPPER
from thirdbody.report import slopes
from thirdbody.report.slopes import EDGES, IMPOSSIBLE, POSSIBLE, Support, can_slide, can_stick, slopes_report
from thirdbody.scene.model import Scene

NO_WEIGHT, ALONG_X, RIGID = np.zeros(3), np.array([1.0, 0.0]), 0.0


def support(points, slopes, friction, above, weight=0.0) -> Support:
    """A body whose plates rise by `slopes` (n, 2) under its spots, under a load of 1."""
    above = np.asarray(above, bool)
    normals = np.column_stack([-np.asarray(slopes, float), np.ones(len(above))]) * np.where(above, -1.0, 1.0)[:, None]
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    return Support(np.asarray(points, float), normals, np.full(len(above), friction), above, 1.0, np.array([0.0, 0.0, -weight]))


def test_it_agrees_with_another_programme_on_random_slopes():
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


def test_between_planes_it_is_the_hulls():
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


def test_two_spots_stick_if_their_line_lies_in_both_cones():
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


def test_a_spot_whose_plate_falls_away_opens_unless_its_overlap_lasts():
    """Two spots above: the plate falls away from one as it slides, and the other alone cannot hold the body."""
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
    monkeypatch.setattr(Scene, "parse", lambda text: falling)
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
