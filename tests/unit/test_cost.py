"""The ladder of accuracy: its variants, the arithmetic of errors on made-up runs, the front, the table, the picture, the JSON."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest
from steel import scene_text
from thirdbody_three_spot import THREE_SPOT
from thirdbody.scene.model import Scene
from thirdbody.studies import cost, cost_report
from thirdbody.studies.cost import Outcome, errors, order, rms_error
from thirdbody.studies.cost_report import reference_error
from thirdbody.studies.variants import CURVES, Base, Costs, Variant, variants_of

DRAG = 'support = "load_per_particle"\nload = "0.1 mN"\nmotion = {x = {velocity = "0.5 m/s"}}\n'
DEBRIS = '[[debris]]\nmaterial = "steel"\nkind = "spheres"\nradius = "5 um"\ncount = 2'
ALONE = '[contact]\ndebris_contact = "none"\n'
SCENE = scene_text(DEBRIS, '["100 um", "100 um"]', DRAG + ALONE, solver='distance = "20 nm"', every="4 nm")
EXPLICIT, IMPLICIT = Base("explicit", "mindlin", None, 1e-10, 5e-4), Base("implicit", "mdr", 24, 1e-10, 5e-4)
FINEST = Base("implicit", "exact", None, 1e-10, 5e-4)
NAN, TWO = math.nan, Scene.parse(SCENE)


def ladder(base=EXPLICIT, scene=TWO):
    return variants_of(scene, THREE_SPOT, base)


def outcome(**changes) -> Outcome:
    report = {
        "friction": np.array([NAN, 0.2, 0.4]), "normal": np.array([1.0, 1.0, 1.0]), "gap": np.array([1.0, 2.0, 3.0]),
        "states": np.array([[1, 1], [1, 2], [1, 2]]), "position": np.zeros((2, 3)),
        "quaternion": np.array([[1.0, 0.0, 0.0, 0.0]] * 2), "dissipated": 2.0, "distance": 0.5, "residual": 1e-9,
        "period": np.array([10.0, np.inf]),
    }  # fmt: skip
    return Outcome(**(report | changes))


def row(name: str, seconds: float, error: float, axis="law", **keys) -> cost.Row:
    variant = keys.pop("variant", None) or Variant(name, axis, name, keys.pop("springs", None), "explicit", **keys)
    one = cost.Row(variant, [seconds, 1.2 * seconds, seconds], [seconds, 1.2 * seconds, seconds], True, "", "explicit", 1e-10)
    one.outcome = outcome(friction=np.array([0.3 * (1.0 + error)]))
    one.errors = dict.fromkeys(cost.ERRORS, error) | {"label_difference": 0.0}
    return one


@pytest.fixture
def made() -> cost.Study:
    rows = [
        row("coulomb", 1.0, 0.2), row("mindlin", 2.0, 0.05, default=True), row("mdr 8", 3.0, 0.06, springs=8),
        row("mdr 16", 4.0, 0.008, springs=16), row("exact", 9.0, 0.001), row("mindlin, step x4", 0.5, 0.3, axis="step"),
        cost.Row(Variant("mindlin, implicit", "integrator", "mindlin", None, "implicit"), message="cannot run this scene"),
        row("exact, step /4", 30.0, 0.0, reference=True, axis="reference"),
    ]  # fmt: skip
    machine = {"cpu": "a processor", "core": "znver5", "code_for": "znver5", "vector_bits": 512, "cores": 2, "threads": 1,
               "caches": {"L1": {"KiB": 48, "cores": 1}}, "load": 0.1}  # fmt: skip
    return cost.Study("scenes/s.toml", "a scene", ["40 of 2000 bodies"], machine, rows)


def set_errors(made, **values):
    for entry in made.rows:
        entry.errors |= values


@pytest.mark.parametrize("base", [EXPLICIT, IMPLICIT], ids=["explicit", "implicit"])
def test_the_ladder_changes_one_thing_at_a_time(base):
    variants = ladder(base)
    assert 14 <= len(variants) <= 20 and len({variant.name for variant in variants}) == len(variants)
    assert sum(variant.default for variant in variants) == sum(variant.reference for variant in variants) == 1
    for variant in variants:
        changed = (
            (variant.level, variant.springs) != (base.level, base.springs),
            variant.integrator == base.kind and variant.factor != 1.0, variant.integrator != base.kind,
        )  # fmt: skip
        # the variant that is the scene's own changes nothing; the reference and those on the way to it the law and its step
        assert sum(changed) == (0 if variant.default else 2 if variant.axis in ("fine", "reference") else 1), variant.name
        TWO.with_settings(variant.changes)  # every variant is a scene without a fault


def test_steps_are_held_and_the_reference_has_the_finest_law_and_step():
    """An automatic step looks at the contacts, and laws would differ by their steps too."""
    steps = {variant.factor: variant.changes["solver.time_step"] for variant in ladder() if variant.integrator == "explicit"}
    assert steps == {factor: f"{factor * 1e-10!r} s" for factor in (4.0, 2.0, 1.0, 0.5, 0.25)}
    last = ladder()[-1]
    assert last.reference and last.level == "exact" and last.changes["solver.time_step"] == f"{0.25e-10!r} s"
    finest = ladder(FINEST)  # has no path to itself
    assert "fine" not in [variant.axis for variant in finest] and len({variant.name for variant in finest}) == len(finest)
    # on curves 48 nodes of `exact` are right to 2e-4 of mu N, but 128 springs of `mdr` to 5e-5, as 96 nodes are
    assert last.changes["contact.nodes"] == CURVES["nodes"] >= 96


@pytest.mark.parametrize("wanted", [None, 0.02])
def test_a_bed_has_variants_at_other_speeds(wanted):
    """Over the same distance; of a wanted inertial number that is what changes, and a speed beyond its range is left out."""
    scene = Scene.parse(SCENE.replace(ALONE, "")).with_settings({} if wanted is None else {"solver.inertial_number": wanted})
    speeds = {v.name: v for v in ladder(replace(EXPLICIT, sheared_bed=True), scene) if v.axis == "speed"}
    names = ["mindlin, speed x9", "mindlin, speed x3", "mindlin, speed /3"]
    assert list(speeds) == (names if wanted is None else names[1:])  # 0.02 x 9 is above 0.1
    for variant in speeds.values():
        other = scene.with_settings(json.loads(json.dumps(variant.changes)))  # as the worker gets them
        assert other.plates.upper.motion.x[0].velocity == pytest.approx(0.5 * variant.speed, rel=1e-12)
        assert other.solver.distance == scene.solver.distance and other.output == scene.output
        assert other.solver.inertial_number == (None if wanted is None else pytest.approx(wanted * variant.speed, rel=1e-12))
        assert variant.changes["solver.time_step"] == "1e-10 s" and not variant.reference and not variant.default
    costs = Costs(EXPLICIT, 6.0, ("exact", None), 6.0, {})
    assert [costs.of(speeds[name]) for name in names[1:]] == pytest.approx([6.0, 18.0])


def test_the_speed_of_a_scene_has_an_error_of_its_own(made, capsys):
    """Against the same law at a third of the speed; that variant is never recommended, a faster one may be."""
    assert math.isnan(cost.speed_error(made)[1]) and "speed:" not in " ".join(cost_report.speed_words(made))
    faster = Variant("mindlin, speed x3", "speed", "mindlin", None, "explicit", speed=3.0)
    slow = replace(faster, name="mindlin, speed /3", speed=1.0 / 3.0)
    made.rows[6:6] = [row("", 0.7, 0.009, variant=faster), row("", 0.1, 0.001, variant=slow)]
    made.rows[7].outcome = outcome(friction=np.array([0.3 * 1.05 / 1.04]))
    speed, error = cost.speed_error(made)
    assert speed == 1.0 / 3.0 and error == pytest.approx(0.04, rel=1e-9)
    assert cost.recommended(made)[0].variant.name == "mdr 16"  # errors of law and speed that cancel recommend nothing
    made.default.errors = dict.fromkeys(made.default.errors, 0.005)
    assert cost.recommended(made)[0].variant.name == "mindlin, speed x3"
    assert all(entry.variant.speed >= 1.0 for entry in cost.efficient(made))
    report = cost_report.as_json(made)
    assert report["speed_error"] == error and {entry["speed"] for entry in report["variants"]} == {1.0, 3.0, 1.0 / 3.0}
    cost_report.print_study(made)
    assert "speed: that of the scene costs 4 % in friction, against the same law and step at 1/3 of it" in capsys.readouterr().out


def test_a_variant_takes_out_options_that_its_level_does_not_know():
    known = {"coulomb": {"slip_scale": 1e-3}, "mindlin": {"memory": "rescaled"}, "mdr": {"springs": 24}, "exact": {"nodes": 96}}
    for level, options in known.items():
        scene = TWO.with_settings({"contact.level": level} | {f"contact.{key}": value for key, value in options.items()})
        for variant in ladder(Base("implicit", level, options.get("springs"), 1e-10, 5e-4), scene):
            changed = scene.with_settings(variant.changes).contact.options
            assert set(changed) <= {option.name for law in THREE_SPOT.levels[variant.level] for option in law.options}
            assert not variant.default or changed == scene.contact.options


def test_errors_of_made_up_runs_and_means_where_runs_part():
    assert errors(outcome(), outcome()) == dict.fromkeys(cost.ERRORS, 0.0)
    # differences 0 and .1 over the mean .3; the frame without a number does not count
    assert rms_error(np.array([0.1, 0.2, 0.5]), outcome().friction) == pytest.approx(math.sqrt(0.005) / 0.3, rel=1e-12)
    assert math.isnan(rms_error(np.array([NAN]), outcome().friction))
    assert rms_error(np.array([0.7, 0.2]), outcome().friction) == 0.0  # a shorter run: over the frames that both have
    other = outcome(normal=np.array([1.5, 1.5, 1.5]))  # the load is compared where the gap is set
    assert errors(other, outcome())["load_error"] == 0.0
    assert errors(other, outcome(gap_set=True))["load_error"] == pytest.approx(0.5, rel=1e-12)
    moved, states = np.array([[9.9, 0.0, 0.0], [3.0, 3.0, 3.0]]), np.array([[1, 1], [1, 2], [1, 3]])
    found = errors(outcome(position=moved, states=states), outcome())
    # the second body has tipped; the first is .1 away across the boundary, in parts of the way .5
    assert found["position_error"] == pytest.approx(0.2, rel=1e-9)
    assert found["label_difference"] == pytest.approx(1.0 / 6.0, rel=1e-12)
    assert math.isnan(errors(outcome(states=None), outcome())["label_difference"])  # nothing to compare
    assert errors(outcome(dissipated=2.5), outcome())["dissipation_error"] == pytest.approx(0.25, rel=1e-12)
    h = np.array([1.0, 0.5, 0.25])
    assert order(h, 3.0 * h**2) == pytest.approx(2.0, rel=1e-12) and math.isnan(order(h, [NAN, 0.0, 0.1]))
    # two bodies that change roles differ in all labels and in no mean
    swapped = outcome(friction=np.array([NAN, 0.4, 0.2]), states=np.array([[1, 1], [2, 1], [2, 1]]),
                      position=np.array([[0.1, 0.0, 0.0], [-0.1, 0.0, 0.0]]))  # fmt: skip
    report = errors(swapped, outcome())
    assert report["label_difference"] == pytest.approx(4.0 / 6.0) and report["friction_error"] > 0.5
    means = ("state_fraction_error", "mean_friction_error", "mean_position_error")
    assert [report[name] for name in means] == pytest.approx([0.0] * 3, abs=1e-15)
    other = errors(outcome(friction=np.array([NAN, 0.2, 0.7]), states=np.array([[1, 2]] * 3)), outcome())
    assert other["mean_friction_error"] == pytest.approx(0.5) and other["state_fraction_error"] == pytest.approx(1.0 / 6.0)


def test_the_recommended_variant_is_the_fastest_that_is_good_enough(made):
    best, words = cost.recommended(made)
    assert best.variant.name == "mdr 16"
    assert words == "`mdr 16` gives 0.8 % friction error at 2 times the cost of `mindlin` (5 %); no label changes"
    front = ["mindlin, step x4", "coulomb", "mindlin", "mdr 16", "exact", "exact, step /4"]
    assert [row.variant.name for row in cost.efficient(made)] == front  # the reference ends it
    set_errors(made, label_difference=0.2)  # without a good one the most accurate one is named
    best, words = cost.recommended(made)
    assert best.variant.name == "exact" and "no variant is within 1 %" in words
    for entry, error in zip(made.rows, (0.2, 0.015, 0.016, 0.016, 0.0152, 0.3), strict=False):
        entry.errors |= {"friction_error": error, "label_difference": 0.0}
    best, words = cost.recommended(made)  # of equal ones not a dearer one than the scene's own
    assert best is made.default and words.endswith("no variant is within 1 % of `exact, step /4` in friction and labels")
    set_errors(made, friction_error=NAN)  # without a drag
    assert cost.figure_of_merit(made) == "load_error"


def parted(made, labels: float, friction: float = 0.02) -> None:
    made.scatter = dict.fromkeys(cost.ERRORS, 0.0) | {"mean_friction_error": 0.003, "state_fraction_error": 0.005}
    made.scatter |= {"label_difference": labels, "friction_error": friction}


def test_where_runs_part_means_decide_and_errors_within_their_spread_are_equal(made):
    """Labels that differ by a fifth are no fault if those of almost equal starts do; two errors below the spread are ties."""
    parted(made, 0.002, 0.001)  # together: compared one by one
    assert not cost.is_chaotic(made) and cost.figure_of_merit(made) == "friction_error"
    made.scatter = {}
    for entry, error in zip(made.rows, (0.2, 0.05, 0.002, 0.001, 0.0015, 0.3), strict=False):
        entry.errors |= {"label_difference": 0.2, "mean_friction_error": error, "state_fraction_error": 0.004}
    parted(made, 0.18)
    assert cost.is_chaotic(made) and cost.figure_of_merit(made) == "mean_friction_error"
    best, words = cost.recommended(made)
    assert best.variant.name == "mdr 8"  # the fastest within 1 %: mdr 16 and exact gain nothing
    assert "0.2 % mean friction error" in words and "20 % of the labels differ (18 % from starts 1e-9 apart)" in words
    assert [row.variant.name for row in cost.efficient(made)][-2:] == ["mdr 8", "exact, step /4"]


def test_the_scatter_is_the_largest_difference_of_the_scenes_own_runs(made):
    for number, friction in enumerate((0.31, 0.33), 1):
        variant = Variant(f"start {number}", "nudged", "mindlin", None, "explicit", nudge=number)
        made.rows.insert(-1, row("", NAN, 0.0, variant=variant))
        made.rows[-2].outcome = outcome(friction=np.array([friction]))
    own = made.rows[1].outcome.friction[0]  # 0.315
    cost.compute_errors(made)
    assert made.scatter["friction_error"] == pytest.approx(max(0.33 / own - 1.0, 0.02 / 0.33), rel=1e-9)
    assert not {"start 1", "start 2"} & {row.variant.name for row in cost.efficient(made)}  # they tell the spread


def test_the_table_marks_the_front_its_end_and_what_stopped(made, capsys):
    parted(made, 0.18)
    made.rows[0].stable, made.rows[0].message = False, "stopped at t = 1 s: the step is too long"
    cost_report.print_study(made)
    lines = capsys.readouterr().out.splitlines()
    assert any(line.startswith("*r  exact, step /4") for line in lines)
    assert next(line for line in lines if "coulomb " in line).split()[-1] == "stopped"  # no errors of a part of a run
    assert any("runs from starts 1e-9 apart differ by up to 2 % of the friction" in line and "18 %" in line for line in lines)
    assert any("mindlin, implicit: cannot run this scene" in line for line in lines)


@pytest.mark.parametrize("p", [1.0, 2.0])
def test_the_error_of_the_reference_comes_from_its_steps(p):
    """Errors h^p of steps 1, 1/2, 1/4, the last one taken for the truth."""
    rows = []
    for size, name, axis in ((1.0, "exact", "law"), (0.5, "exact, step /2", "fine"), (0.25, "exact, step /4", "fine")):
        rows.append(row(name, 1.0 / size, size**p - 0.25**p, axis=axis, reference=size == 0.25))
        rows[-1].variant, rows[-1].step = replace(rows[-1].variant, level="exact"), 1e-10 * size
    made = cost.Study("", "", [], {}, rows)
    assert reference_error(made) == pytest.approx(0.25**p, rel=1e-9)
    rows[1].errors["friction_error"] = rows[0].errors["friction_error"]
    assert math.isnan(reference_error(made))  # no order, no extrapolation
