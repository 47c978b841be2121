"""Debris between plates that meets: forces, motion and labels of few bodies against statics."""

from __future__ import annotations

import closed_forms
import numpy as np
import pytest
from meetings import GAP, HALF, LOAD, MEETINGS, MU, RIDGE, SPEED, START, STROKE, R

import thirdbody

INTEGRATORS = ("explicit", "implicit")
"""Those with contact between bodies."""

RESIDUAL = {"explicit": 1e-3, "implicit": 1e-6}
"""Of the energy balance, over the work of the plate: explicit steps leave their truncation error in impacts."""

NUMERICAL, NUMERICAL_OF_PRESSING = 1e-3, 3e-3
"""What the implicit integrator itself may lose or gain of the work of the plate; and where bodies only roll, so that the work is
that of the pressing: the patches come to rest within some 20 steps, whose error falls with the second order of their length."""

LOWER, UPPER = -1, -2
"""Partners of a contact that are plates."""

TILT = 1e-3
"""Bodies under the same load sink in by different amounts, so that they meet at heights that differ by overlaps, 4 nm of 5 um."""


@pytest.fixture(scope="module", params=INTEGRATORS)
def met(request, tmp_path_factory):
    """name -> run of a meeting, each simulated once."""
    done: dict[str, thirdbody.Run] = {}

    def get(name: str) -> thirdbody.Run:
        if name not in done:
            scene = thirdbody.Scene.parse(MEETINGS[name].text(request.param))
            done[name] = thirdbody.run(scene, tmp_path_factory.mktemp(name) / "run", progress=False)
        return done[name]

    get.residual = RESIDUAL[request.param]  # type: ignore[attr-defined]
    return get


def forces(run: thirdbody.Run, frame: int = -1) -> dict[tuple[int, int], np.ndarray]:
    """(body, partner) -> force of the partner on the body (3,), over the load; contacts of one pair are summed."""
    contacts, found = run.contacts(frame), dict[tuple[int, int], np.ndarray]()
    for body, partner, force in zip(contacts["body"], contacts["partner"], contacts["force"], strict=True):
        key = (int(body), int(partner))
        found[key] = found.get(key, np.zeros(3)) + force / LOAD
    return found


def labels(run: thirdbody.Run, body: int) -> list[str]:
    return [run.state_names[state] for state in run.states[:, body]]


@pytest.mark.parametrize("name", MEETINGS)
def test_energy_balance(name, met):
    series = met(name).series
    work = np.abs(series["energy_plate_work"]).max()
    assert np.abs(series["energy_residual"]).max() < met.residual * work
    bound = NUMERICAL_OF_PRESSING if name == "two_that_touch" else NUMERICAL
    assert np.abs(series["energy_numerical"]).max() < bound * work


@pytest.mark.parametrize("name", MEETINGS)
def test_plates_feel_opposite_forces(name, met):
    """Bodies that do not accelerate hand on what drags them; some swing still when the run ends, a stroke ends at rest only."""
    series, swing = met(name).series, {"chain_of_ten": 0.02, "held_by_a_ridge": 0.3, "lost_and_found": 0.01}.get(name, 1e-3)
    total = series["upper_force"][-1] + series["lower_force"][-1]
    assert np.abs(total).max() < swing * LOAD


def test_two_balls_that_touch_roll_on_together(met):
    run = met("two_that_touch")
    bodies = run.bodies(-1)
    speed, spin = closed_forms.pinched_sphere_rolling(SPEED, R * 1e-6)
    # elastic: the balls are flattened by an overlap of 1e-3 R at either plate
    assert bodies["velocity"][:2, 0] == pytest.approx(speed, rel=1e-6)
    assert bodies["angular_velocity"][:2, 1] == pytest.approx(spin, rel=TILT)
    assert np.abs(forces(run).get((0, 1), np.zeros(3))).max() < 1e-6 * MU
    assert labels(run, 0)[-1] == labels(run, 1)[-1] == "rolling"


def test_a_ball_stops_at_a_post(met):
    """Nothing rubs between them: the upper plate drags by mu W, the lower one by as much, the post holds 2 mu W."""
    run = met("stopped")
    below, normal, push = closed_forms.stopped_sphere(MU, 0.0)
    final = forces(run)
    assert final[0, LOWER][[0, 2]] == pytest.approx([below, normal], abs=TILT)
    assert final[0, UPPER][[0, 2]] == pytest.approx([MU, -1.0], rel=1e-6)
    assert final[0, 1][[0, 2]] == pytest.approx([-push, 0.0], abs=TILT)
    assert final[1, LOWER][0] == pytest.approx(-push, abs=TILT)
    # it comes to rest within the time for which the pair of springs and dashpots swings
    assert np.abs(run.bodies(-1)["velocity"]).max() < 1e-6 * SPEED


def test_a_stopped_ball_is_labelled_sliding(met):
    """It rolls until it meets the post, after 0.8 um of drag; two windows of four contact radii later it slides."""
    run = met("stopped")
    seen, drag = labels(run, 0), run.series["distance"]
    contact_radius = run.contacts(-1)["contact_radius"].max()
    meets = 2.0 * 0.4e-6
    assert seen[int(np.searchsorted(drag, 0.95 * meets)) - 1] == "rolling"
    assert set(np.array(seen)[drag > meets + 8.0 * contact_radius]) == {"sliding"}


def test_a_stopped_ball_wears_by_all_of_the_drag(met):
    """Friction work mu W times the drag: the top slips by all of it."""
    run = met("stopped")
    work = [run.bodies(frame)["friction_work"][0] for frame in (-4, -1)]
    drag = run.series["distance"][-1] - run.series["distance"][-4]
    assert work[1] - work[0] == pytest.approx(MU * LOAD * drag, rel=1e-4)


@pytest.mark.parametrize(("name", "rough"), [("stopped_by_a_rough_post", 0.3), ("stopped_by_a_rougher_post", 1.0)])
def test_a_rough_post_holds_less(name, rough, met):
    """What friction at the post carries depends on how the ball has bounced; all else follows, and friction limits it."""
    final = forces(met(name))
    rub = final[0, 1][2]
    below, normal, push = closed_forms.stopped_sphere(MU, rub)
    assert final[0, LOWER][[0, 2]] == pytest.approx([below, normal], abs=TILT)
    assert -final[0, 1][0] == pytest.approx(push, abs=TILT)
    # the common normal leans by the overlaps
    assert 2.0 * MU / (1.0 + rough) * (1.0 - TILT) <= push <= 2.0 * MU
    assert labels(met(name), 0)[-1] == "sliding"


def test_a_ball_turns_on_the_spot(met):
    """Over a slippery lower plate the post stops the ball, but not its rotation: its top goes with the plate."""
    run = met("turns_on_the_spot")
    final, bodies = forces(run), run.bodies(-1)
    rub = closed_forms.sphere_turning_on_the_spot(0.1, 0.3)
    below = 0.1 * (1.0 - rub)
    assert final[0, LOWER][[0, 2]] == pytest.approx([below, 1.0 - rub], abs=TILT)
    assert final[0, UPPER][0] == pytest.approx(below + rub, abs=TILT)
    assert final[0, 1][[0, 2]] == pytest.approx([-rub / 0.3, rub], abs=TILT)
    assert abs(bodies["velocity"][0, 0]) < TILT * SPEED
    assert bodies["angular_velocity"][0, 1] * R * 1e-6 == pytest.approx(SPEED, rel=TILT)
    assert labels(run, 0)[-1] == "rolling"


def test_three_in_a_row(met):
    final = forces(met("three_in_a_row"))
    assert [-final[0, 1][0], -final[1, 2][0]] == pytest.approx([2.0 * MU, 4.0 * MU], abs=2.0 * TILT)
    assert [labels(met("three_in_a_row"), k)[-1] for k in (0, 1)] == ["sliding", "sliding"]


def test_three_in_a_row_that_rub(met):
    final = forces(met("three_that_rub"))
    rubs = final[0, 1][2], final[1, 2][2]
    first, second = closed_forms.stopped_sphere(MU, rubs[0]), closed_forms.second_of_two_stopped_spheres(MU, rubs)
    for body, (below, normal, push) in enumerate((first, second)):
        assert final[body, LOWER][[0, 2]] == pytest.approx([below, normal], abs=TILT)
        assert -final[body, body + 1][0] == pytest.approx(push, abs=TILT)
        assert abs(rubs[body]) <= 0.3 * push * (1.0 + TILT)


def test_slow_balls_rub_on_the_post_as_much_as_friction_allows(tmp_path):
    """At 1 mm/s nothing bounces, and each turns against what it meets until it stands: its friction is at the limit there."""
    scene = thirdbody.Scene.parse(MEETINGS["three_that_rub"].text("implicit"))
    slow = scene.with_settings({"plates.upper.motion.x.velocity": "1 mm/s"})
    final = forces(thirdbody.run(slow, tmp_path / "run", progress=False))
    first = 2.0 * MU / 1.3
    # what closed_forms.second_of_two_stopped_spheres gives with rubs of 0.3 of the pushes
    second = (2.0 * MU + 0.7 * first) / 1.3
    assert [-final[0, 1][0], -final[1, 2][0]] == pytest.approx([first, second], rel=TILT)


def test_a_chain_of_ten_is_pushed_against_a_post(met):
    """Each ball hands on what it gets, and adds 2 mu W."""
    final = forces(met("chain_of_ten"))
    pushes = [-final[k, k + 1][0] for k in range(10)]
    # the chain still swings by some per cent when the run ends
    assert pushes == pytest.approx([2.0 * 0.05 * (k + 1) for k in range(10)], rel=0.03)


def test_two_flakes_meet_head_on(met):
    """A rider comes with the plate and is stopped by a post: it slid below, now it slides above."""
    run = met("head_on")
    final = forces(run)
    assert final[0, 1][0] == pytest.approx(-0.3, abs=TILT)
    assert final[0, UPPER][0] == pytest.approx(0.3, rel=1e-6)
    assert final[1, LOWER][0] == pytest.approx(-0.4, abs=TILT)
    assert labels(run, 0)[-1] == "sliding" and run.bodies(-1)["sliding_side"][0] == 2
    assert np.abs(run.bodies(-1)["velocity"]).max() < 1e-6 * SPEED


def test_a_rider_pushes_a_flake_along(met):
    """The push is what friction of the lower plate resists: mu W, no more."""
    run = met("pushed_along")
    final = forces(run)
    assert final[0, 1][0] == pytest.approx(-0.5, abs=TILT)
    assert final[0, UPPER][0] == pytest.approx(0.5, abs=TILT)
    assert run.bodies(-1)["velocity"][:, 0] == pytest.approx(SPEED, rel=1e-4)


def test_a_ball_mounts_a_ridge(met):
    """Where sqrt(r/R) is less than friction it leaves the lower plate; the force goes along the chord of its two contacts."""
    assert closed_forms.mounting_friction(RIDGE, R) < 0.5
    run = met("mounts")
    contacts, final = run.contacts(-1), forces(run)
    assert (0, LOWER) not in final
    own = contacts["body"] == 0
    (top,), (side,) = (contacts["position"][own & (contacts["partner"] == partner)] for partner in (UPPER, 1))
    chord = (side[0] - top[0]) / (top[2] - side[2])
    # a body of 4 ng that rolls at 0.1 m/s over 5 um bends its path with 1e-4 of the load
    assert final[0, UPPER][0] / -final[0, UPPER][2] == pytest.approx(chord, rel=2e-3)
    assert run.bodies(-1)["position"][0, 2] > 1.02 * R * 1e-6
    assert labels(run, 0)[-1] == "rolling"


def test_a_ridge_holds_a_ball(met):
    """Where sqrt(r/R) is more than friction it stays where it meets the ridge, on the lower plate."""
    assert closed_forms.mounting_friction(RIDGE, R) > 0.3
    run = met("held_by_a_ridge")
    position = run.bodies(-1)["position"][0] * 1e6
    assert forces(run)[0, LOWER][2] > 0.1
    # it has overlaps of 4 nm at the plate, and stays within what its bounces amount to
    assert position[0] == pytest.approx(START + GAP, abs=0.03)
    assert position[2] == pytest.approx(R, abs=0.01)


def test_contact_is_lost_and_found(met):
    """A ball rolls back from the post by half of the stroke, and finds it again where it left it."""
    run = met("lost_and_found")
    # frame 1 is the end of settling; from there an eighth of a period each
    seen = {eighth: run.bodies(eighth + 1) for eighth in (4, 6, 8, 12, 14)}
    place = {eighth: bodies["position"][0, 0] * 1e6 for eighth, bodies in seen.items()}
    assert [(0, 1) in forces(run, eighth + 1) for eighth in (3, 4, 6, 8, 14, 16)] == [True, True, False, False, False, False]
    # springs at its top and its foot and the overlap at the post, nm each, come before rolling and after it
    assert place[4] == pytest.approx(START + GAP, abs=0.01)
    assert place[8] == pytest.approx(START + GAP - 0.5 * STROKE, abs=0.01)
    assert place[12] == pytest.approx(START + GAP, abs=0.01)
    assert place[6] == pytest.approx(place[14], abs=1e-3)
    # all slip lies in the first half of the stroke: what the plate drags over the ball before it turns back
    slip = 1e-6 * (STROKE - 2.0 * GAP)
    assert seen[4]["friction_work"][0] == pytest.approx(MU * LOAD * slip, rel=0.02)
    assert seen[14]["friction_work"][0] == pytest.approx(seen[4]["friction_work"][0], rel=1e-3)


def test_posts_stand_where_they_are_meant_to():
    """The first sphere of a post is the one that is met."""
    assert min(x - radius for x, _, radius in MEETINGS["stopped"].bodies[1][1]) == -(HALF + R)
