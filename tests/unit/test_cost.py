"""The ladder of accuracy: its variants, the arithmetic of errors on made-up runs, the front, the table, the picture, the JSON."""

from __future__ import annotations

import json
import math
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from portable import drawn
from steel import STEEL
from thirdbody_three_spot import THREE_SPOT

from thirdbody.engine.orientations import orientations
from thirdbody.errors import OutputError, UsageError
from thirdbody.kernels.columns import body
from thirdbody.runner.simulate import prepare
from thirdbody.scene.model import Scene
from thirdbody.studies import cost, cost_plot, cost_table, worker
from thirdbody.studies.compare import Outcome, errors, label_difference, order, read_outcome, rms_error, rotation_angles
from thirdbody.studies.convergence import convergence, falling, reference_error
from thirdbody.studies.cost_command import StudyOptions, cost_command
from thirdbody.studies.nudge import NUDGE, nudge
from thirdbody.studies.reduced_scene import FEWEST, FEWEST_THAT_MEET, reduce_scene, thin
from thirdbody.studies.stopwatch import Late, bare
from thirdbody.studies.study_setup import StudySource
from thirdbody.studies.time_budget import Budget, Costs, Overheads, fitting, repeats_of, whole
from thirdbody.studies.timing_statistics import slower, timing
from thirdbody.studies.variant_runs import LEFT_OUT, ROUNDS, VariantRuns
from thirdbody.studies.variants import CURVES, Base, Variant, variants_of
from thirdbody.studies.worker_process import Overdue, Worker, request

SCENE = (
    STEEL
    + """\
[[debris]]
material = "steel"
kind = "spheres"
radius = "5 um"
count = 2
[domain]
size = ["100 um", "100 um"]
[plates.lower]
material = "steel"
[plates.upper]
material = "steel"
support = "load_per_particle"
load = "0.1 mN"
motion = {x = {velocity = "0.5 m/s"}}
[contact]
debris_contact = "none"
[solver]
distance = "20 nm"
[output]
every = "4 nm"
"""
)
EXPLICIT = Base("explicit", "mindlin", None, 1e-10, 5e-4)
IMPLICIT = Base("implicit", "mdr", 24, 1e-10, 5e-4)


def outcome(**changes) -> Outcome:
    """Two bodies at rest at three frames, changed as told."""
    report = {
        "friction": np.array([math.nan, 0.2, 0.4]), "normal": np.array([1.0, 1.0, 1.0]), "gap": np.array([1.0, 2.0, 3.0]),
        "states": np.array([[1, 1], [1, 2], [1, 2]]), "position": np.zeros((2, 3)),
        "quaternion": np.array([[1.0, 0.0, 0.0, 0.0]] * 2), "dissipated": 2.0, "distance": 0.5, "residual": 1e-9,
        "period": np.array([10.0, np.inf]),
    }  # fmt: skip
    return Outcome(**(report | changes))


def row(name: str, seconds: float, error: float, **keys) -> cost.Row:
    """A variant that took so long and was so wrong in friction."""
    variant = keys.pop("variant", None) or Variant(name, keys.pop("axis", "law"), name, keys.pop("springs", None), "explicit",
                                          default=keys.pop("default", False), reference=keys.pop("reference", False))  # fmt: skip
    report = {key: error for key in cost.ERRORS} | {"label_difference": keys.pop("labels", 0.0)}
    one = cost.Row(variant, [seconds, 1.2 * seconds, seconds], [seconds, 1.2 * seconds, seconds], True, "", "explicit", 1e-10)
    one.outcome, one.errors = outcome(friction=np.array([0.3 * (1.0 + error)])), report
    for key, value in keys.items():
        setattr(one, key, value)
    return one


@pytest.fixture
def made() -> cost.Study:
    rows = [
        row("coulomb", 1.0, 0.2), row("mindlin", 2.0, 0.05, default=True), row("mdr 8", 3.0, 0.06, springs=8),
        row("mdr 16", 4.0, 0.008, springs=16), row("exact", 9.0, 0.001), row("mindlin, step x4", 0.5, 0.3, axis="step"),
        row("exact, step /4", 30.0, 0.0, reference=True, axis="reference"),
    ]  # fmt: skip
    wrong = cost.Row(Variant("mindlin, implicit", "integrator", "mindlin", None, "implicit"), message="cannot run this scene")
    kind = {"core": "znver5", "code_for": "znver5", "vector_bits": 512, "caches": {"L1": {"KiB": 48, "cores": 1}}}
    machine = {"cpu": "a processor", **kind, "cores": 2, "threads": 1, "load": 0.1}
    return cost.Study("scenes/s.toml", "a scene", ["40 of 2000 bodies"], machine, [*rows[:-1], wrong, rows[-1]])


@pytest.mark.parametrize("base", [EXPLICIT, IMPLICIT], ids=["explicit", "implicit"])
def test_the_ladder_changes_one_thing_at_a_time(base):
    scene = Scene.parse(SCENE)
    variants = variants_of(scene, THREE_SPOT, base)
    assert 14 <= len(variants) <= 20
    assert len({variant.name for variant in variants}) == len(variants)
    assert [variant.default for variant in variants].count(True) == 1 and [variant.reference for variant in variants].count(
        True
    ) == 1
    for variant in variants:
        changed = {
            "law": (variant.level, variant.springs) != (base.level, base.springs),
            "step": variant.integrator == base.kind and variant.factor != 1.0,
            "integrator": variant.integrator != base.kind,
        }
        # the variant that is the scene's own changes nothing; the reference and those on the way to it the law and its step
        assert sum(changed.values()) == (0 if variant.default else 2 if variant.axis in ("fine", "reference") else 1), (
            variant.name
        )
        scene.with_settings(variant.changes)  # every variant is a scene without a fault


def test_the_reference_has_the_finest_law_and_step():
    last = variants_of(Scene.parse(SCENE), THREE_SPOT, EXPLICIT)[-1]
    assert last.reference and last.level == "exact"
    assert last.changes["solver.time_step"] == f"{0.25e-10!r} s"


@pytest.mark.parametrize("wanted", [None, 1e-3, 0.02])
def test_a_bed_has_variants_at_other_speeds(wanted):
    """Over the same distance; of a wanted inertial number that is what changes, and a speed beyond its range is left out."""
    text = SCENE.replace('[contact]\ndebris_contact = "none"\n', "")
    scene = Scene.parse(text).with_settings({} if wanted is None else {"solver.inertial_number": wanted})
    assert not [variant for variant in variants_of(scene, THREE_SPOT, EXPLICIT) if variant.axis == "speed"]
    variants = variants_of(scene, THREE_SPOT, replace(EXPLICIT, sheared_bed=True))
    speeds = {variant.name: variant for variant in variants if variant.axis == "speed"}
    names = ["mindlin, speed x9", "mindlin, speed x3", "mindlin, speed /3"]
    assert list(speeds) == (names[1:] if wanted == 0.02 else names)  # 0.02 x 9 is above 0.1
    for variant in speeds.values():
        other = scene.with_settings(json.loads(json.dumps(variant.changes)))  # as the worker gets them
        assert other.plates.upper.motion.x[0].velocity == pytest.approx(0.5 * variant.speed, rel=1e-12)
        assert other.solver.distance == scene.solver.distance and other.output == scene.output
        assert other.solver.inertial_number == (None if wanted is None else pytest.approx(wanted * variant.speed, rel=1e-12))
        assert variant.changes["solver.time_step"] == "1e-10 s" and not variant.reference and not variant.default
    costs = Costs(6.0, 0, None, ("exact", None), 9.0, 6.0)
    assert [costs.of(speeds[name], EXPLICIT) for name in names[1:]] == pytest.approx([6.0, 18.0])


def test_the_speed_of_a_scene_has_an_error_of_its_own(made, capsys):
    """Against the same law at a third of the speed; that variant is never recommended, a faster one may be."""
    assert math.isnan(cost.speed_error(made)[1]) and "speed:" not in " ".join(cost_table.speed_words(made))
    faster = Variant("mindlin, speed x3", "speed", "mindlin", None, "explicit", speed=3.0)
    slow = Variant("mindlin, speed /3", "speed", "mindlin", None, "explicit", speed=1.0 / 3.0)
    made.rows[6:6] = [row("", 0.7, 0.009, variant=faster), row("", 0.1, 0.001, variant=slow)]
    made.rows[7].outcome = outcome(friction=np.array([0.3 * 1.05 / 1.04]))
    speed, error = cost.speed_error(made)
    assert speed == 1.0 / 3.0 and error == pytest.approx(0.04, rel=1e-9)
    assert cost.recommended(made)[0].variant.name == "mindlin, speed x3"
    assert all(entry.variant.speed >= 1.0 for entry in cost.efficient(made))
    report = cost.as_json(made)
    assert report["speed_error"] == error and {entry["speed"] for entry in report["variants"]} == {1.0, 3.0, 1.0 / 3.0}
    cost_table.print_study(made)
    assert "speed: that of the scene costs 4 % in friction, against the same law and step at 1/3 of it" in capsys.readouterr().out
    figure = cost_plot.picture(made)
    assert {"speed x3", "speed /3"} <= {text.get_text() for text in figure.axes[0].texts}
    assert "speed of the plate" in [text.get_text() for text in figure.legends[0].get_texts()]
    assert "that of the scene costs 4 %" in " ".join(figure.axes[0].get_title(loc="left").split())


def test_explicit_variants_hold_their_step():
    """An automatic one looks at the contacts, and laws would differ by their steps too."""
    steps = {variant.factor: variant.changes["solver.time_step"] for variant in variants_of(Scene.parse(SCENE), THREE_SPOT,
                                                                                            EXPLICIT)
             if variant.integrator == "explicit"}  # fmt: skip
    assert steps == {factor: f"{factor * 1e-10!r} s" for factor in (4.0, 2.0, 1.0, 0.5, 0.25)}


def test_a_finest_law_has_no_path_to_itself():
    variants = variants_of(Scene.parse(SCENE), THREE_SPOT, Base("implicit", "exact", None, 1e-10, 5e-4))
    assert not [variant for variant in variants if variant.axis == "fine"] and len({variant.name for variant in variants}) == len(
        variants
    )


@pytest.mark.parametrize(
    ("level", "options"),
    [("coulomb", {"slip_scale": 1e-3}), ("mindlin", {"memory": "rescaled"}), ("mdr", {"springs": 24}), ("exact", {"nodes": 96})],
)
def test_a_variant_takes_out_options_that_its_level_does_not_know(level, options):
    settings = {f"contact.{key}": value for key, value in options.items()}
    scene = Scene.parse(SCENE).with_settings({"contact.level": level} | settings)
    for variant in variants_of(scene, THREE_SPOT, Base("implicit", level, options.get("springs"), 1e-10, 5e-4)):
        changed = scene.with_settings(variant.changes).contact.options
        known = {option.name for law in THREE_SPOT.levels[variant.level] for option in law.options}
        assert set(changed) <= known
        if variant.default:
            assert changed == scene.contact.options


@pytest.mark.parametrize(("base", "own"), [(EXPLICIT, {}), (Base("implicit", "exact", None, 1e-10, 5e-4), {"nodes": 96})])
def test_the_reference_resolves_curved_slip_no_worse_than_any_other_variant(base, own):
    """On curves 48 nodes of `exact` are right to 2e-4 of mu N, but 128 springs of `mdr` to 5e-5, as 96 nodes are."""
    settings = {"contact.level": base.level} | {f"contact.{key}": value for key, value in own.items()}
    scene = Scene.parse(SCENE).with_settings(settings)
    variants = variants_of(scene, THREE_SPOT, base)
    assert variants[-1].reference and scene.with_settings(variants[-1].changes).contact.options["nodes"] >= 96
    assert {variant.changes.get("contact.nodes") for variant in variants if variant.axis in ("fine", "reference")} == {
        CURVES["nodes"]
    }


def test_equal_runs_have_no_error():
    found = errors(outcome(), outcome())
    assert found == {name: 0.0 for name in cost.ERRORS}


def test_friction_is_compared_frame_by_frame_where_both_know_it():
    # differences 0 and .1 over the mean .3; the frame without a number does not count
    assert rms_error(np.array([0.1, 0.2, 0.5]), outcome().friction) == pytest.approx(math.sqrt(0.005) / 0.3, rel=1e-12)
    assert math.isnan(rms_error(np.array([math.nan]), outcome().friction))
    assert rms_error(np.array([0.7, 0.2]), outcome().friction) == 0.0  # a shorter run: over the frames that both have


def test_the_load_is_compared_where_the_gap_is_set():
    other = outcome(normal=np.array([1.5, 1.5, 1.5]))
    assert errors(other, outcome())["load_error"] == 0.0
    assert errors(other, outcome(gap_set=True))["load_error"] == pytest.approx(0.5, rel=1e-12)


def test_positions_count_bodies_with_equal_labels_and_the_nearest_image():
    moved = np.array([[9.9, 0.0, 0.0], [3.0, 3.0, 3.0]])
    states = np.array([[1, 1], [1, 2], [1, 3]])
    found = errors(outcome(position=moved, states=states), outcome())
    # the second body has tipped; the first is .1 away across the boundary, in parts of the way .5
    assert found["position_error"] == pytest.approx(0.2, rel=1e-9)
    assert found["label_difference"] == pytest.approx(1.0 / 6.0, rel=1e-12)
    assert label_difference(None, states) != label_difference(None, states)  # NaN: nothing to compare


@pytest.mark.parametrize("angle", [1e-9, 1e-3, 1.0, 3.0])
def test_turns_are_exact_for_small_angles_too(angle):
    axis = np.array([2.0, -1.0, 2.0]) / 3.0
    start = np.array([[0.5, 0.5, -0.5, 0.5]])
    w, v = math.cos(angle / 2.0), math.sin(angle / 2.0) * axis
    real, along = start[0, 0], start[0, 1:]
    turned = np.concatenate([[w * real - v @ along], w * along + real * v + np.cross(v, along)])
    # rounding of a product of quaternions is 2e-16 of one, not of the angle
    assert rotation_angles(turned[None], start)[0] == pytest.approx(angle, rel=1e-12, abs=1e-15)
    assert rotation_angles(-turned[None], start)[0] == pytest.approx(angle, rel=1e-12, abs=1e-15)  # the same orientation


def test_means_and_shares_are_compared_where_runs_part():
    """Two bodies that change roles differ in all labels and in no mean."""
    swapped = outcome(friction=np.array([math.nan, 0.4, 0.2]), states=np.array([[1, 1], [2, 1], [2, 1]]),
                      position=np.array([[0.1, 0.0, 0.0], [-0.1, 0.0, 0.0]]))  # fmt: skip
    report = errors(swapped, outcome())
    assert report["label_difference"] == pytest.approx(4.0 / 6.0) and report["friction_error"] > 0.5
    means = {"state_fraction_error", "mean_friction_error", "mean_position_error"}
    assert all(report[name] == pytest.approx(0.0, abs=1e-15) for name in means)
    other = errors(outcome(friction=np.array([math.nan, 0.2, 0.7]), states=np.array([[1, 2], [1, 2], [1, 2]])), outcome())
    assert other["mean_friction_error"] == pytest.approx(0.5) and other["state_fraction_error"] == pytest.approx(1.0 / 6.0)


def test_dissipation_is_relative():
    assert errors(outcome(dissipated=2.5), outcome())["dissipation_error"] == pytest.approx(0.25, rel=1e-12)


def test_the_order_is_a_slope():
    h = np.array([1.0, 0.5, 0.25])
    assert order(h, 3.0 * h**2) == pytest.approx(2.0, rel=1e-12)
    assert math.isnan(order(h, [math.nan, 0.0, 0.1]))


def test_the_recommended_variant_is_the_fastest_that_is_good_enough(made):
    best, words = cost.recommended(made)
    assert best.variant.name == "mdr 16"
    assert words == "`mdr 16` gives 0.8 % friction error at 2 times the cost of `mindlin` (5 %); no label changes"
    front = ["mindlin, step x4", "coulomb", "mindlin", "mdr 16", "exact", "exact, step /4"]
    assert [row.variant.name for row in cost.efficient(made)] == front  # the reference ends it


def test_without_a_good_variant_the_most_accurate_one_is_named(made):
    for entry in made.rows:
        entry.errors["label_difference"] = 0.2
    best, words = cost.recommended(made)
    assert best.variant.name == "exact" and "no variant is within 1 %" in words


def parted(made, labels: float, friction: float = 0.02) -> None:
    """Give a study a spread of runs from starts 1e-9 apart."""
    made.scatter = dict.fromkeys(cost.ERRORS, 0.0) | {
        "label_difference": labels, "friction_error": friction, "mean_friction_error": 0.003, "state_fraction_error": 0.005,
    }  # fmt: skip


def test_where_runs_part_means_decide_and_errors_within_their_spread_are_equal(made):
    """Labels that differ by a fifth are no fault if those of almost equal starts do; two errors below the spread are ties."""
    for entry, error in zip(made.rows, (0.2, 0.05, 0.002, 0.001, 0.0015, 0.3), strict=False):
        entry.errors |= {"label_difference": 0.2, "mean_friction_error": error, "state_fraction_error": 0.004}
    assert cost.figure_of_merit(made) == "friction_error" and "no variant is within 1 %" in cost.recommended(made)[1]
    parted(made, 0.18)
    assert cost.is_chaotic(made) and cost.figure_of_merit(made) == "mean_friction_error"
    best, words = cost.recommended(made)
    assert best.variant.name == "mdr 8"  # the fastest within 1 %: mdr 16 and exact gain nothing
    assert "0.2 % mean friction error" in words and "20 % of the labels differ (18 % from starts 1e-9 apart)" in words
    assert [row.variant.name for row in cost.efficient(made)][-2:] == ["mdr 8", "exact, step /4"]


def test_runs_that_stay_together_are_compared_one_by_one(made):
    parted(made, 0.002, 0.001)
    assert not cost.is_chaotic(made) and cost.figure_of_merit(made) == "friction_error"
    assert cost.recommended(made)[0].variant.name == "mdr 16"


def test_the_scatter_is_the_largest_difference_of_the_scenes_own_runs(made):
    for number, friction in enumerate((0.31, 0.33), 1):
        variant = Variant(f"start {number}", "nudged", "mindlin", None, "explicit", nudge=number)
        made.rows.insert(-1, row(variant.name, math.nan, 0.0, variant=variant))
        made.rows[-2].outcome = outcome(friction=np.array([friction]))
    own = made.rows[1].outcome.friction[0]  # 0.315
    cost.compute_errors(made)
    assert made.scatter["friction_error"] == pytest.approx(max(0.33 / own - 1.0, 0.02 / 0.33), rel=1e-9)
    names = {row.variant.name for row in cost.efficient(made)}
    assert not {"start 1", "start 2"} & names  # they tell the spread, and are no choice


def test_bodies_that_do_not_meet_are_reported_beside_the_recommended_variant(made):
    made.rows.append(row("mindlin, bodies do not meet", 0.1, 0.004, axis="meeting"))
    best, words = cost.recommended(made)
    assert best.variant.name == "mdr 16"
    other = "friction is off by 0.4 %, in 0.05 times the time of `mindlin`; no label changes"
    assert words.endswith(f'(contact.debris_contact = "none") {other}')


def test_the_table_marks_the_front_its_end_and_what_stopped(made, capsys):
    parted(made, 0.18)
    made.rows[0].stable, made.rows[0].message = False, "stopped at t = 1 s: the step is too long"
    cost_table.print_study(made)
    lines = {line[:18].strip(): line for line in capsys.readouterr().out.splitlines()}
    report = {name: line.split() for name, line in lines.items()}
    assert report["*r  exact, step /4"[:18].strip()][0] == "*r"
    assert next(line for line in lines.values() if "coulomb " in line).split()[-1] == "stopped"  # no errors of a part of a run
    assert any("starts 1e-9 apart" in line and "18 %" in line for line in lines.values())
    assert any("runs from starts 1e-9 apart differ by up to 2 % of the friction" in line for line in lines.values())


def test_variants_that_stopped_alike_are_reported_once(made):
    made.rows[0].stable, made.rows[0].message = False, made.rows[-2].message
    assert cost_table.stopped(made) == {"cannot run this scene": ["coulomb", "mindlin, implicit"]}


@pytest.mark.parametrize("p", [1.0, 2.0])
def test_the_error_of_the_reference_comes_from_its_steps(p):
    """Errors h^p of steps 1, 1/2, 1/4, the last one taken for the truth."""
    h = {1.0: "exact", 0.5: "exact, step /2", 0.25: "exact, step /4"}
    rows = []
    for size, name in h.items():
        rows.append(row(name, 1.0 / size, size**p - 0.25**p, axis="law" if size == 1.0 else "fine", reference=size == 0.25))
        rows[-1].variant = cost.replace(rows[-1].variant, level="exact")
        rows[-1].step = 1e-10 * size
    made = cost.Study("", "", [], {}, rows)
    assert reference_error(made) == pytest.approx(0.25**p, rel=1e-9)
    rows[1].errors["friction_error"] = rows[0].errors["friction_error"]
    assert math.isnan(reference_error(made))  # no order, no extrapolation


@pytest.mark.parametrize("seconds, runs", [(0.01, 7), (1.0, 3), (60.0, 2)])
def test_cheap_variants_are_repeated_more_often(seconds, runs):
    assert repeats_of(seconds, 3) == runs
    assert repeats_of(seconds, 1) == 1 and repeats_of(seconds, 0) == 0  # nothing to be timed
    assert repeats_of(0.01, 12) == 12


def test_a_copy_is_as_large_as_the_budget_allows():
    variants = variants_of(Scene.parse(SCENE), THREE_SPOT, EXPLICIT)
    costs = Costs(1.0, 128, 17.0, ("exact", None), 15.0, 0.1)
    report = {variant.name: costs.of(variant, EXPLICIT) for variant in variants}
    assert report["mdr 64"] == pytest.approx(9.0) and report["mindlin"] == 1.0  # linear in the springs
    assert report["mindlin, step x4"] == 0.25 and report["exact, step /4"] == 60.0 and report["mindlin, implicit"] == 0.1
    share = fitting(variants, EXPLICIT, costs, 3, 300.0)
    assert share < 1.0 and whole(variants, EXPLICIT, costs, 3, share) < 300.0
    assert fitting(variants, EXPLICIT, costs, 3, 600.0) > 1.5 * share
    assert fitting(variants, EXPLICIT, costs, 3, 0.0) == pytest.approx(0.01, rel=0.03)  # and not for ever


def crowd() -> Scene:
    text = SCENE.replace("count = 2", "count = 200").replace('radius = "5 um"', 'radius = "5 um"\nplacement = "layer"')
    return Scene.parse(text.replace('"100 um", "100 um"', '"300 um", "200 um"').replace('debris_contact = "none"', ""))


def test_a_thinned_copy_has_its_bodies_as_close_as_they_were():
    scene = crowd()
    near, words = thin(scene, 200, 0.25)
    copy = scene.with_settings(near)
    assert copy.debris[0].count == 50 and words == ["50 of 200 bodies, as close as they were"]
    assert copy.domain.size == pytest.approx((150e-6, 100e-6), rel=1e-12)  # a quarter of the area
    assert thin(scene, 200, 1.5) == ({}, []) and thin(scene, FEWEST, 0.1) == ({}, [])


def test_bodies_of_a_copy_meet_those_and_as_many_as_before():
    """So what contact between bodies costs and changes is measured, with either integrator."""
    scene = crowd()
    copy, built, words = reduce_scene(scene, [], 1e-9)
    assert copy.debris[0].count == FEWEST_THAT_MEET and built.state.world.debris_meets and "as close" in words[0]
    assert np.prod(copy.domain.size) / FEWEST_THAT_MEET == pytest.approx(np.prod(scene.domain.size) / 200, rel=1e-12)


@pytest.mark.parametrize("base", [EXPLICIT, IMPLICIT], ids=["explicit", "implicit"])
def test_bodies_that_meet_have_variants_of_what_meeting_does(base):
    """From displaced starts, with nothing else changed, and without contact between bodies."""
    names = {variant.name for variant in variants_of(crowd(), THREE_SPOT, base)}
    more = [variant for variant in variants_of(crowd(), THREE_SPOT, replace(base, meets=True)) if variant.name not in names]
    assert [variant.axis for variant in more] == ["nudged", "nudged", "meeting"]
    own = next(variant for variant in variants_of(crowd(), THREE_SPOT, base) if variant.default)
    assert [variant.nudge for variant in more] == [1, 2, 0] and more[0].changes == own.changes
    assert more[2].changes == own.changes | {"contact.debris_contact": "none"}


def test_displaced_starts_differ_by_a_billionth_and_can_be_repeated():
    first, again, other = (prepare(Scene.parse(SCENE)).state for _ in range(3))
    start = first.B.copy()
    for state, number in ((first, 1), (again, 1), (other, 2)):
        nudge(state, number)
    assert np.array_equal(first.B, again.B) and not np.array_equal(first.B, other.B)
    moved = np.linalg.norm((first.B - start)[:, body.POSITION : body.POSITION + 3], axis=1)
    # a normal deviate of two components is above 1e-3 and below 6 but for one in a million
    assert np.all((moved > 1e-3 * NUDGE * 5e-6) & (moved < 6.0 * NUDGE * 5e-6))
    assert np.array_equal(first.S[:, :3], first.B[first.body, body.POSITION : body.POSITION + 3])  # balls: centred


def test_a_scene_without_a_drag_is_assessed_by_its_load(made):
    for entry in made.rows:
        entry.errors["friction_error"] = math.nan
    assert cost.figure_of_merit(made) == "load_error"


def test_the_json_has_the_names_of_the_contract(made):
    report = json.loads(json.dumps(cost.as_json(made)))
    assert {"scene", "machine", "reduction", "reference", "recommended", "variants"} <= set(report)
    names = {"level", "springs", "integrator", "step", "wall_s", "time_ratio", "friction_error", "load_error", "position_error",
             "label_difference", "energy_residual", "stable"}  # fmt: skip
    assert all(names <= set(variant) for variant in report["variants"])
    assert report["variants"][3]["time_ratio"] == 2.0 and report["variants"][3]["springs"] == 16
    assert report["reference"] == "exact, step /4"


def test_a_failed_variant_is_shown_everywhere(made, capsys, tmp_path):
    report = cost.as_json(made)["variants"][-2]
    assert report["stable"] is False and report["message"] == "cannot run this scene"
    cost_table.print_study(made)
    printed = capsys.readouterr().out
    assert "mindlin, implicit: cannot run this scene" in printed and "failed" in printed
    figure = cost_plot.picture(made)
    assert "mindlin, implicit" in figure.axes[0].get_title(loc="left")


def test_the_picture_shows_every_variant_the_front_and_the_scenes_own(made, tmp_path):
    figure = cost_plot.picture(made)
    axes = figure.axes[0]
    assert (axes.get_xscale(), axes.get_yscale()) == ("log", "log")
    names = {text.get_text() for text in axes.texts}
    assert {"coulomb", "mindlin", "mdr 8", "mdr 16", "exact", "step x4"} <= names
    labels = [text.get_text() for text in figure.legends[0].get_texts()]
    assert {"efficient front, to the reference", "as in the scene", "recommended"} <= set(labels)
    line = next(line for line in axes.lines if line.get_label() == "efficient front, to the reference")
    assert list(line.get_xdata()) == [0.5, 1.0, 2.0, 4.0, 9.0, 30.0] and line.get_drawstyle() == "steps-post"
    # steps of the reference's law are not there to tell its own error: it stands below all others
    assert line.get_ydata()[-1] < min(line.get_ydata()[:-1])
    cost_plot.draw_study(made, tmp_path / "cost.png")
    assert drawn(tmp_path / "cost.png") > 0.02


def test_springs_are_compared_against_the_finest_law_at_their_own_step(made):
    series = next(entry for entry in convergence(made) if entry["what"] == "springs")
    assert series["sizes"] == ["8", "16"] and series["against"] == "exact"
    # friction of the made-up runs: .3 (1 + error)
    assert series["errors"] == pytest.approx([(1.06 - 1.001) / 1.001, (1.008 - 1.001) / 1.001], rel=1e-9)


def test_an_order_is_reported_about_errors_that_fall():
    assert falling([8.0, 4.0, 2.0, 1.9, 1.8]) == 3  # something else has taken over
    assert falling([8.0, 4.0, 2.0]) == 3
    assert falling([1.0, 2.0, 0.1]) == 3  # no order to be seen: all of them, and the slope tells
    assert falling([4.0, 1.0, math.nan, 0.1]) == 2


def test_when_the_finest_variant_fails_the_next_one_is_the_reference(made):
    made.rows[-1].stable = False
    cost.compute_errors(made)
    assert made.reference.variant.name == "exact"
    assert made.reference.errors["friction_error"] == 0.0


def test_nothing_that_runs_is_reported(made):
    for entry in made.rows:
        entry.stable = False
    with pytest.raises(UsageError, match="no variant"):
        cost.compute_errors(made)


def test_the_worker_reports_what_failed_and_times_the_rest(tmp_path):
    file = tmp_path / "scene.toml"
    file.write_text(SCENE)
    good = request(file, tmp_path / "runs" / "0", {}, [], 30.0)
    ran, timed = worker.answer({"do": "run", **good}), worker.answer({"do": "time", **good})
    assert ran["stable"] and timed["stable"] and ran["cpu_s"] > 0.0 and timed["cpu_s"] > 0.0
    assert ran["integrator"] == "implicit" and ran["step_kind"] == "tolerance" and ran["used_cpu"] > ran["cpu_s"]
    changes = {"solver.time_step": "1 s", "solver.integrator": "explicit"}
    bad = worker.answer({"do": "run", **request(file, tmp_path / "runs" / "1", changes, [], 30.0)})
    assert not bad["stable"] and "above the bound" in bad["message"] and "cpu_s" not in bad
    late = worker.answer({"do": "time", **request(file, tmp_path / "runs" / "0", {}, [], -1.0)})
    assert not late["stable"] and "given up" in late["message"]


def test_a_worker_that_dies_is_reported_and_one_that_is_late_is_ended(tmp_path):
    with Worker() as process:
        report = process.request({"do": "nothing that it knows"})
        assert not report["stable"] and "the process ended with code 1: KeyError" in report["message"]
        with pytest.raises(Overdue):
            process.request({"do": "nothing"}, until=0.0)


def test_a_run_that_takes_too_long_is_stopped_and_reported(tmp_path):
    file = tmp_path / "scene.toml"
    file.write_text(SCENE)
    report = worker.timed_run(Scene.load(file), tmp_path / "run", [], 0.0)
    assert not report["stable"] and "given up after 0 s of one core" in report["message"]


@pytest.mark.parametrize("integrator", ["explicit", "implicit"])
def test_what_is_timed_is_the_run(integrator, tmp_path):
    """The same steps to the last bit, without what is done at the stops."""
    file = tmp_path / "scene.toml"
    file.write_text(SCENE.replace("[solver]", f'[solver]\nintegrator = "{integrator}"'))
    scene, folder = Scene.load(file), tmp_path / "run"
    worker.timed_run(scene, folder, [], 30.0)
    built = prepare(scene)
    wall, cpu = bare(built, 30.0)
    ran = read_outcome(folder)
    assert np.array_equal(built.state.bodies.position, ran.position)
    assert np.array_equal(orientations(built.state), ran.quaternion)
    assert 0.0 < wall and 0.0 < cpu


def test_seconds_are_put_to_one_pace():
    """Timed beside the scene's own variant, a variant takes what it takes of that one's time."""
    variant = Variant("a", "law", "a", None, "implicit")
    slow = [cost.Row(variant, cpu=[pace, 2.0 * pace], beside=[pace, pace]) for pace in (1.0, 3.0, 9.0)]
    cost._one_pace(slow)
    assert [row.cpu for row in slow] == [[3.0, 6.0]] * 3  # three times, the median pace


class MadeUpWorker:
    """Answers at once and lets a made-up clock run: a variant takes a second to compile and `seconds` of one core to run or time,
    and the machine is `slow` after some requests."""

    started = 1.0

    def __init__(self, monkeypatch, seconds, slow=lambda requested: 1.0, noise=lambda requested: 1.0):
        self.now, self.requests, self.seconds, self.slow, self.noise, self.log = 0.0, 0, seconds, slow, noise, []
        monkeypatch.setattr(time, "perf_counter", lambda: self.now)
        monkeypatch.setattr("thirdbody.studies.variant_runs.read_outcome", lambda folder: outcome())

    @property
    def pace(self):
        return self.slow(self.requests)

    def request(self, request, until=math.inf):
        self.requests += 1
        self.log.append((request["do"], request["changes"].get("contact.springs")))
        cpu = self.seconds * self.noise(self.requests)
        used = cpu + (1.0 if request["do"] == "run" else 0.05)
        if self.now + used * self.pace > until:
            self.now = until
            raise Overdue
        self.now += used * self.pace
        return {"stable": True, "message": "", "cpu_s": cpu, "wall_s": cpu * self.pace, "used_cpu": used}


def climbed(made_up, seconds, repeats=3):
    variants = variants_of(Scene.parse(SCENE), THREE_SPOT, EXPLICIT)
    costs = Costs(made_up.seconds, 128, made_up.seconds, ("exact", None), made_up.seconds, made_up.seconds)
    budget = Budget(seconds)
    report = VariantRuns(made_up, Path("nowhere"), [], EXPLICIT, costs, Overheads(1.0, 1.0), budget, lambda text: None)
    return report.rows(variants, repeats)


@pytest.mark.parametrize("budget", [20.0, 60.0, 400.0])
@pytest.mark.parametrize("pace", [1.0, 4.0])
def test_a_budget_is_kept_on_a_machine_that_slows_down(monkeypatch, budget, pace):
    """Rungs for which no time is left are left out and say so; the scene's own and the reference come first."""
    made_up = MadeUpWorker(monkeypatch, 0.2, lambda requested: pace if requested > 2 else 1.0)
    rows = climbed(made_up, budget)
    assert made_up.now <= budget
    ran = [row for row in rows if row.cpu]
    assert {"mindlin", "exact, step /4"} <= {row.variant.name for row in ran}
    assert all(row.message in (LEFT_OUT, "stopped: the budget was over") for row in rows if not row.cpu)
    assert (len(ran) < len(rows)) == (budget < 50.0 or (budget < 100.0 and pace > 1.0))


def test_a_budget_without_space_for_the_smallest_ladder_is_refused(monkeypatch):
    made_up = MadeUpWorker(monkeypatch, 30.0)
    with pytest.raises(UsageError, match=r"--budget 40 s: too short for the smallest ladder .* about 2\.\d min are needed"):
        climbed(made_up, 40.0)
    assert made_up.now <= 40.0


def test_a_budget_of_nothing_is_refused_before_anything_is_climbed(tmp_path):
    file = tmp_path / "scene.toml"
    file.write_text(SCENE)
    with pytest.raises(UsageError, match="--budget 0.01 s: too short"):
        cost.study(file, tmp_path / "out", budget=0.01)


def test_short_variants_are_timed_until_their_spread_is_small(monkeypatch):
    """Rungs of 20 ms are timed at least seven times; where times vary by a third, up to the most."""
    quiet = climbed(MadeUpWorker(monkeypatch, 0.02), 1000.0)
    counts = {len(row.cpu) for row in quiet if row.variant.axis != "reference" and not row.variant.default}
    assert counts == {7}
    loud = climbed(MadeUpWorker(monkeypatch, 0.02, noise=lambda requested: (1.0, 1.6, 0.7, 2.1, 0.5)[requested % 5]), 1000.0)
    assert max(len(row.cpu) for row in loud) == ROUNDS
    assert all(len(row.beside) == len(row.cpu) for row in loud if row.variant.axis == "law")


def test_medians_and_how_far_they_may_be_off():
    assert timing([2.0]) == (2.0, 1.0)  # one alone tells a factor of two
    assert timing([1.0, 2.0, 4.0]) == (2.0, 1.5)  # half the range of a few
    assert timing([2.0, 2.0]) == (2.0, 0.5)  # that two agree may be chance
    many = timing([1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0])
    assert many.seconds == 5.0 and many.half == pytest.approx(1.57 * 4.0 / 3.0, rel=1e-12)
    assert timing([1.0] * 9).half == 0.03  # what repeats in one process cannot tell
    assert slower(timing([2.0] * 9), timing([1.0] * 9)) and not slower(timing([1.05] * 9), timing([1.0] * 9))


def test_noise_recommends_nothing(made):
    """A variant at half the median cost, timed once, or with a spread that covers the difference, is no cheaper variant."""
    own, fine = made.rows[1], made.rows[3]
    own.errors = dict.fromkeys(own.errors, 0.004)
    fine.errors = dict.fromkeys(fine.errors, 0.001)
    made.rows[5].errors = dict.fromkeys(made.rows[5].errors, 0.5)
    fine.cpu = [0.52 * own.seconds]  # as "tolerance / 16 at 0.52 times the cost" was
    own.cpu = [own.seconds]
    best, words = cost.recommended(made)
    assert best is own and "`mindlin`, the variant of the scene," in words
    assert words.endswith("`mdr 16` takes the same time within the spread")
    fine.cpu = [0.52 * own.seconds] * 9
    own.cpu = own.cpu * 9
    best, words = cost.recommended(made)
    assert best is fine and "at 0.52 times the cost of `mindlin`" in words


def test_a_less_accurate_variant_that_takes_the_same_time_is_not_on_the_front(made):
    made.rows[3].cpu = [1.01 * x for x in made.rows[2].cpu]  # mdr 16 beside mdr 8
    assert "mdr 8" not in [row.variant.name for row in cost.efficient(made)]
    assert "mdr 16" in [row.variant.name for row in cost.efficient(made)]


def test_timing_has_an_end(tmp_path):
    with pytest.raises(Late):
        bare(prepare(Scene.parse(SCENE)), -1.0)


def test_an_existing_folder_is_refused(tmp_path):
    (tmp_path / "kept").write_text("mine")
    for overwrite in (False, True):  # never what is no study
        with pytest.raises(OutputError):
            cost_command(StudySource(tmp_path / "s.toml", {}, tmp_path, []), StudyOptions(3), overwrite, False, print)
    assert (tmp_path / "kept").exists()


@pytest.mark.full(kind="slow")
def test_the_whole_command(tmp_path, capsys):
    file, out = tmp_path / "scene.toml", tmp_path / "out"
    file.write_text(SCENE)
    cost_command(StudySource(file, {}, out, []), StudyOptions(2), False, True, lambda text: None)
    report = json.loads(capsys.readouterr().out)
    assert report == json.loads((out / "cost.json").read_text())
    assert len(report["variants"]) >= 14 and all(variant["stable"] for variant in report["variants"])
    assert (out / "cost.png").exists() and (out / "cost.pdf").exists()
    by_name = {variant["name"]: variant["friction_error"] for variant in report["variants"]}
    assert by_name["mdr 64"] < by_name["coulomb"]
