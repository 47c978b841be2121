"""Debris between plates that meets: forces, motion and labels of few bodies against statics."""

import closed_forms
import numpy as np
import pytest
from meetings import GAP, LOAD, MEETINGS, MU, RIDGE, SPEED, START, STROKE, R
import thirdbody

RESIDUAL = {"explicit": 1e-3, "implicit": 1e-6}
"""Of the energy balance, over the work of the plate: explicit steps leave their truncation error in impacts."""

NUMERICAL, NUMERICAL_OF_PRESSING = 1e-3, 3e-3
"""What the implicit integrator itself may lose or gain of the work of the plate; and where bodies only roll, so that the work is
that of the pressing: the patches come to rest within some 20 steps, whose error falls with the second order of their length."""

LOWER, UPPER = -1, -2
TILT = 1e-3
"""Bodies under the same load sink in by different amounts, so that they meet at heights that differ by overlaps, 4 nm of 5 um."""


def forces(run, frame=-1):
    """(body, partner) -> force of the partner on the body (3,), over the load; contacts of one pair are summed."""
    contacts, found = run.contacts(frame), {}
    for body, partner, force in zip(contacts["body"], contacts["partner"], contacts["force"], strict=True):
        key = (int(body), int(partner))
        found[key] = found.get(key, np.zeros(3)) + force / LOAD
    return found


def labels(run, body):
    return [run.state_names[state] for state in run.states[:, body]]


def two_that_touch(run, final, bodies):
    """They roll on together, flattened by an overlap of 1e-3 R at either plate."""
    speed, spin = closed_forms.pinched_sphere_rolling(SPEED, R * 1e-6)
    assert bodies["velocity"][:2, 0] == pytest.approx(speed, rel=1e-6)
    assert bodies["angular_velocity"][:2, 1] == pytest.approx(spin, rel=TILT)
    assert np.abs(final.get((0, 1), np.zeros(3))).max() < 1e-6 * MU
    assert labels(run, 0)[-1] == labels(run, 1)[-1] == "rolling"


def stopped(run, final, bodies):
    """Nothing rubs between them: the upper plate drags by mu W, the lower one by as much, the post holds 2 mu W."""
    below, normal, push = closed_forms.stopped_sphere(MU, 0.0)
    assert final[0, LOWER][[0, 2]] == pytest.approx([below, normal], abs=TILT)
    assert final[0, UPPER][[0, 2]] == pytest.approx([MU, -1.0], rel=1e-6)
    assert final[0, 1][[0, 2]] == pytest.approx([-push, 0.0], abs=TILT)
    assert final[1, LOWER][0] == pytest.approx(-push, abs=TILT)
    # it comes to rest within the time for which the pair of springs and dashpots swings
    assert np.abs(bodies["velocity"]).max() < 1e-6 * SPEED
    # it rolls until it meets the post, after 0.8 um of drag; two windows of four contact radii later it slides
    seen, drag, meets = labels(run, 0), run.series["distance"], 2.0 * 0.4e-6
    assert seen[int(np.searchsorted(drag, 0.95 * meets)) - 1] == "rolling"
    assert set(np.array(seen)[drag > meets + 8.0 * run.contacts(-1)["contact_radius"].max()]) == {"sliding"}
    # friction work mu W times the drag: the top slips by all of it
    work = bodies["friction_work"][0] - run.bodies(-4)["friction_work"][0]
    assert work == pytest.approx(MU * LOAD * (drag[-1] - drag[-4]), rel=1e-4)


def stopped_by_a_rough_post(run, final, bodies):
    """What friction at the post carries depends on how the ball has bounced; all else follows, and friction limits it."""
    below, normal, push = closed_forms.stopped_sphere(MU, final[0, 1][2])
    assert final[0, LOWER][[0, 2]] == pytest.approx([below, normal], abs=TILT)
    assert -final[0, 1][0] == pytest.approx(push, abs=TILT)
    # the common normal leans by the overlaps
    assert 2.0 * MU / 1.3 * (1.0 - TILT) <= push <= 2.0 * MU
    assert labels(run, 0)[-1] == "sliding"


def turns_on_the_spot(run, final, bodies):
    """Over a slippery lower plate the post stops the ball, but not its rotation: its top goes with the plate."""
    rub = closed_forms.sphere_turning_on_the_spot(0.1, 0.3)
    below = 0.1 * (1.0 - rub)
    assert final[0, LOWER][[0, 2]] == pytest.approx([below, 1.0 - rub], abs=TILT)
    assert final[0, UPPER][0] == pytest.approx(below + rub, abs=TILT)
    assert final[0, 1][[0, 2]] == pytest.approx([-rub / 0.3, rub], abs=TILT)
    assert abs(bodies["velocity"][0, 0]) < TILT * SPEED
    assert bodies["angular_velocity"][0, 1] * R * 1e-6 == pytest.approx(SPEED, rel=TILT)
    assert labels(run, 0)[-1] == "rolling"


def three_that_rub(run, final, bodies):
    rubs = final[0, 1][2], final[1, 2][2]
    first, second = closed_forms.stopped_sphere(MU, rubs[0]), closed_forms.second_of_two_stopped_spheres(MU, rubs)
    for body, (below, normal, push) in enumerate((first, second)):
        assert final[body, LOWER][[0, 2]] == pytest.approx([below, normal], abs=TILT)
        assert -final[body, body + 1][0] == pytest.approx(push, abs=TILT)
        assert abs(rubs[body]) <= 0.3 * push * (1.0 + TILT)


def chain_of_ten(run, final, bodies):
    """Each ball hands on what it gets, and adds 2 mu W; the chain still swings by some per cent when the run ends."""
    assert [-final[k, k + 1][0] for k in range(10)] == pytest.approx([2.0 * 0.05 * (k + 1) for k in range(10)], rel=0.03)


def head_on(run, final, bodies):
    assert final[0, 1][0] == pytest.approx(-0.3, abs=TILT)
    assert final[0, UPPER][0] == pytest.approx(0.3, rel=1e-6)
    assert final[1, LOWER][0] == pytest.approx(-0.4, abs=TILT)
    assert labels(run, 0)[-1] == "sliding" and bodies["sliding_side"][0] == 2
    assert np.abs(bodies["velocity"]).max() < 1e-6 * SPEED


def pushed_along(run, final, bodies):
    assert [final[0, 1][0], final[0, UPPER][0]] == pytest.approx([-0.5, 0.5], abs=TILT)
    assert bodies["velocity"][:, 0] == pytest.approx(SPEED, rel=1e-4)


def mounts(run, final, bodies):
    """Where sqrt(r/R) is less than friction it leaves the lower plate; the force goes along the chord of its two contacts."""
    assert closed_forms.mounting_friction(RIDGE, R) < 0.5 and (0, LOWER) not in final
    contacts = run.contacts(-1)
    place = {side: contacts["position"][(contacts["body"] == 0) & (contacts["partner"] == side)] for side in (UPPER, 1)}
    (top,), (side,) = place.values()
    # a body of 4 ng that rolls at 0.1 m/s over 5 um bends its path with 1e-4 of the load
    assert final[0, UPPER][0] / -final[0, UPPER][2] == pytest.approx((side[0] - top[0]) / (top[2] - side[2]), rel=2e-3)
    assert bodies["position"][0, 2] > 1.02 * R * 1e-6
    assert labels(run, 0)[-1] == "rolling"


def held_by_a_ridge(run, final, bodies):
    assert closed_forms.mounting_friction(RIDGE, R) > 0.3 and final[0, LOWER][2] > 0.1
    # it has overlaps of 4 nm at the plate, and stays within what its bounces amount to
    assert bodies["position"][0, 0] * 1e6 == pytest.approx(START + GAP, abs=0.03)
    assert bodies["position"][0, 2] * 1e6 == pytest.approx(R, abs=0.01)


def lost_and_found(run, final, bodies):
    # frame 1 is the end of settling; from there an eighth of a period each
    seen = {eighth: run.bodies(eighth + 1) for eighth in (4, 6, 8, 12, 14)}
    place = {eighth: bodies["position"][0, 0] * 1e6 for eighth, bodies in seen.items()}
    assert [(0, 1) in forces(run, eighth + 1) for eighth in (3, 4, 6, 8, 14, 16)] == [True, True, False, False, False, False]
    # springs at its top and its foot and the overlap at the post, nm each, come before rolling and after it
    assert [place[4], place[12]] == pytest.approx([START + GAP] * 2, abs=0.01)
    assert place[8] == pytest.approx(START + GAP - 0.5 * STROKE, abs=0.01)
    assert place[6] == pytest.approx(place[14], abs=1e-3)
    # all slip lies in the first half of the stroke: what the plate drags over the ball before it turns back
    work = MU * LOAD * 1e-6 * (STROKE - 2.0 * GAP)
    assert seen[4]["friction_work"][0] == pytest.approx(work, rel=0.02)
    assert seen[14]["friction_work"][0] == pytest.approx(seen[4]["friction_work"][0], rel=1e-3)


QUICK = {
    "implicit": {"two_that_touch", "stopped", "three_that_rub", "head_on", "pushed_along", "mounts", "lost_and_found"},
    "explicit": {"stopped", "turns_on_the_spot"},
}  # fmt: skip
SLOW = pytest.mark.full(kind="slow")
ALL = [pytest.param(one, name, marks=[] if name in quick else SLOW) for one, quick in QUICK.items() for name in MEETINGS]


@pytest.mark.parametrize(("integrator", "name"), ALL)
def test_meetings(tmp_path, integrator, name):
    """Energy; and bodies that do not accelerate hand on what drags them: some swing at the end, a stroke ends at rest only."""
    run = thirdbody.run(thirdbody.Scene.parse(MEETINGS[name].text(integrator)), tmp_path / "run", progress=False)
    series = run.series
    work = np.abs(series["energy_plate_work"]).max()
    assert np.abs(series["energy_residual"]).max() < RESIDUAL[integrator] * work
    bound = NUMERICAL_OF_PRESSING if name == "two_that_touch" else NUMERICAL
    assert np.abs(series["energy_numerical"]).max() < bound * work
    swing = {"chain_of_ten": 0.02, "held_by_a_ridge": 0.3, "lost_and_found": 0.01}.get(name, 1e-3)
    assert np.abs(series["upper_force"][-1] + series["lower_force"][-1]).max() < swing * LOAD
    globals()[name](run, forces(run), run.bodies(-1))


@SLOW
def test_slow_balls_rub_on_the_post_as_much_as_friction_allows(tmp_path):
    """At 1 mm/s nothing bounces, and each turns against what it meets until it stands: its friction is at the limit there."""
    scene = thirdbody.Scene.parse(MEETINGS["three_that_rub"].text("implicit"))
    slow = scene.with_settings({"plates.upper.motion.x.velocity": "1 mm/s"})
    final, first = forces(thirdbody.run(slow, tmp_path / "run", progress=False)), 2.0 * MU / 1.3
    # what closed_forms.second_of_two_stopped_spheres gives with rubs of 0.3 of the pushes
    assert [-final[0, 1][0], -final[1, 2][0]] == pytest.approx([first, (2.0 * MU + 0.7 * first) / 1.3], rel=TILT)
