"""The labeller driven through made-up histories of contacts: every rule, and what no label may depend on."""

import math

import numpy as np
import pytest
from each import each
from label_rig import DT, LABEL_WITH_EFFECTS, S_C, STILL, A, Rig, Spot, View
from thirdbody_three_spot import classify as c
from thirdbody import plugin as k

BELOW, ABOVE, BOTH = 1, 2, 3  # sliding_side
FREE, ROLLING, LIFTED = ("free", "none"), ("rolling", "rotation"), ("rolling", "lift_off")
STICKING, SLIDING, UNBALANCED = ("sticking", "none"), ("sliding", "friction_limit"), ("sliding", "unbalanced")
ONE_SIDED, UNKNOWN, ROLLS_UNKNOWN = ("sticking", "one_sided"), ("sticking", "indeterminate"), ("rolling", "indeterminate")


def lower(x, y=0.0, **more):
    return Spot(k.LOWER, (x, y, -1.0), (0.0, 0.0, 1.0), **more)


def upper(x, y=0.0, **more):
    return Spot(k.UPPER, (x, y, 1.0), (0.0, 0.0, -1.0), **more)


def three_spot(view, **more):
    """Held body: two spots below, 1.8 apart along the drag, one above; plates at rest at first."""
    return Rig([lower(-1.0, **more), lower(0.8, 0.3, **more), upper(0.2, load=2.0, **more)], view).move(dt=0.0)


def ball(view):
    return Rig([lower(0.0), upper(0.0)], view).move(dt=0.0)


def elastic_tilt(view):
    rig = three_spot(view).move(1e-4, 0.65e-4 / 2.0, times=10)  # .65 of the drag goes into tilt, far less than a in all
    rig.has(*STICKING).slide(0.02, [], 8).has(*STICKING)  # beyond a window: r = .65e-3/.1204
    assert 0.0 < rig.last["roll_ratio"] < 0.05
    return rig


def ball_rolls(view):
    rig = ball(view).has(*UNKNOWN)  # at rest under load
    rig.move(0.019 * A, 0.0095 * A).has(*UNKNOWN)  # below .02 a nothing is known
    rig.move(0.019 * A, 0.0095 * A, times=3).has(*ROLLS_UNKNOWN).move(0.097 * A, 0.0485 * A, times=100).has(*ROLLING)
    assert rig.last["roll_ratio"] == pytest.approx(1.0, rel=1e-9) and rig.last["slip_over_travel"] == 0.0
    rig.move(moving=0.0).has(*UNKNOWN)
    # rotation about in-plane axes times D/2 is half the drag since its first stride, which only tells of the start
    assert rig.last["rolled_distance"] / view.unit == pytest.approx(0.5 * (3 * 0.019 + 100 * 0.097) * A, rel=1e-9)
    return rig


def ball_turns_back(view):
    rig = ball(view)
    for sign in (1.0, -1.0, 1.0):
        rig.move(sign * 0.05 * A, sign * 0.0135 * A, times=30).has(*ROLLS_UNKNOWN)  # 1.5 a of drag: no window has closed
    return rig


def ball_against_the_drag(view):
    return ball(view).move(0.05 * A, -0.025 * A, times=10).has(*UNKNOWN)  # does not turn with the drag, and p < a


def slides_below(view):
    rig = three_spot(view).slide(0.4 * S_C, [0, 1], 3)
    rig.has(*STICKING)  # the first stride of a drag is its start: .8 s_c so far
    rig.slide(0.4 * S_C, [0, 1]).has(*SLIDING)
    rig.shows(sliding_side=BELOW, friction_lower=pytest.approx(0.0, abs=1e-15), friction_upper=1.0)
    rig.slide(0.05, [0, 1], 3).has(*SLIDING)  # 0.15 of drag closed a window, in this one nothing slips yet
    rig.slide(0.05, [0, 1], 2).spots[0].force = (0.981, 0.0, 0.0)  # the limit to 2 %
    rig.move(1e-6).has(*SLIDING).spots[0].force = (0.979, 0.0, 0.0)  # one spot holds: the side does not slide
    return rig.move(1e-6).has(*STICKING)


def one_of_two_slides_above(view):
    rig = Rig([lower(0.0), upper(-1.0), upper(0.8)], view).move(dt=0.0).slide(0.4 * S_C, [1], 4).has(*STICKING)
    return rig.shows(friction=pytest.approx(0.0, abs=1e-15), friction_upper=1.0)  # the other holds


def slides_on_both_sides_then_stops(view):
    rig = three_spot(view).slide(10.0 * S_C, [0, 1, 2], 2).has(*SLIDING).shows(sliding_side=BOTH)
    rig.move(moving=0.0).has(*STICKING)  # T is left at mu N
    return rig.move(0.5 * S_C, slip=[0.5 * S_C] * 3, times=2).has(*STICKING)


def stroke_reverses(view):
    rig = three_spot(view).slide(0.02, [2], 20).has(*SLIDING)
    return rig.slide(-0.4 * S_C, [2], 2).has(*STICKING).slide(-2.0 * S_C, [2]).has(*SLIDING).shows(sliding_side=ABOVE)


def turns_a_little_in_every_window(view):
    rig = three_spot(view)
    for share, expected in ((0.04, STICKING), (0.06, ROLLING)):
        rig.move(0.01, share * 0.01 / 2.0, times=20).has(*expected)
        assert rig.last["rotation"] == pytest.approx(1.0 - share / 0.05, rel=0.1)  # D is 2 but for the tilt
    return rig


def spins_many_turns(view):
    turn = (0.0, 0.0, 0.1 * math.pi)
    rig = three_spot(view).move(0.01 * A).move(0.01 * A, turn)
    for _ in range(100):  # 5 turns within one A of drag; to a quaternion a whole turn is none
        rig.move(0.01 * A, turn).has("rolling", "pivoting")
    return rig


def tips(view):
    rig = three_spot(view).slide(0.02, [0, 1, 2], 3).has(*SLIDING)
    rig.spots = [rig.spots[1], rig.spots[2]]  # the rear spot lifts off
    return rig.move(0.01 * A, 0.004 * A, times=4).has(*LIFTED).shows(determinacy=-1.0)


def pivots(view):
    rig = three_spot(view).move(1e-4, (0.0, 0.0, 0.01), times=6).has("rolling", "pivoting")
    rig.slide(0.02, [], 6).has("rolling", "pivoting")  # r of the window that held the turn: .05 * 2/.1204
    assert rig.last["roll_ratio"] > 0.05
    return rig.slide(0.02, [], 7).has(*STICKING)


def skids_on_one_plate(view):
    rig = Rig([lower(0.0, force=(-1.0, 0.0, 0.0))], view).move(dt=0.0)
    rig.velocity = (10.0, 0.0, 0.0)
    rig.move(turn=0.01 / 3.0, slip=[0.01 * 2.0 / 3.0], times=40).has(*SLIDING)  # it also spins, at a third of what rolling asks
    rig.shows(sliding_side=BELOW).spots[0].force = STILL
    rig.move(turn=0.01, times=40).has(*ROLLING).shows(roll_ratio=pytest.approx(2.0, rel=1e-9))  # D is twice the radius
    rig.velocity = STILL
    return rig.move(times=40).has(*ONE_SIDED)  # one span of rest, 17 ms at this load, after the one it stopped in


def rolls_back_on_one_plate(view):
    rig = Rig([lower(0.0)], view).move(dt=0.0)
    for sign in (1.0, -1.0):
        rig.velocity = (sign * 10.0, 0.0, 0.0)
        rig.move(turn=sign * 0.01, times=2).has(*ONE_SIDED)  # p < a again: the way back cleared the reference
        rig.move(turn=sign * 0.01, times=40).has(*ROLLING)
    return rig


def rides_on_the_lower_plate(view):
    rig = Rig([lower(-0.5), lower(0.5), lower(0.0, 0.5)], view).move(dt=0.0)
    for s in rig.spots:
        s.surface = (30.0, 0.0, 0.0)
    rig.velocity = (30.0, 0.0, 0.0)
    return rig.move(0.03, times=10).has(*ONE_SIDED)


def comes_and_goes(view):
    rig = Rig([], view).move(0.01).has(*FREE)
    assert {rig.last[name] for name in c.MARGINS} == {1.0}
    rig.move(0.01, (0.3, 0.2, 0.1)).spots = three_spot(view).spots  # it tumbles while it is free
    rig.move(0.01, times=2).has(*STICKING).spots = []  # the reference is the first load
    return rig.move(0.01).has(*FREE)


def lifted(view, *strides):
    rig = three_spot(view).slide(0.02 * A, [], 10)
    spots, rig.spots = rig.spots, []
    rig.move(*strides[:2], times=strides[2]).spots = spots
    return rig.move(0.02 * A)


def snaps_over(view):
    rig = lifted(view, 0.02 * A, 0.28, 1).has(*LIFTED)  # 16 degrees within an instant of free
    rig.slide(0.2 * A, [], 25).has(*ROLLING)  # beyond the window in which it landed: its ratio stands until the next one is over
    return rig.slide(0.2 * A, [], 20).has(*STICKING).shows(rolled_distance=0.0)  # nothing rolled in the air


def lands_after_a_whole_turn(view):
    return lifted(view, 0.02 * A, 0.1 * math.pi, 20).has(*ROLLING)


def lands_without_a_turn(view):
    return lifted(view, A, 0.001 * A / 2.0, 20).has(*STICKING)  # a thousandth of the drag


def without_friction(view):
    rig = three_spot(view, limit=0.0).move(0.001).has(*STICKING).shows(friction=1.0)
    return rig.move(0.001, slip=[0.0, 0.0, 0.001]).has(*SLIDING).shows(sliding_side=ABOVE, friction=0.0)


def layer_of_debris(view, turning=0.0, slipping=0.0):
    """A body on two debris under one, dragged by their surfaces; a nearly lateral fourth always slides."""
    up = (0.0, 0.3, -math.sqrt(0.91))
    spots = [
        Spot(k.DEBRIS, (-0.6, 0.0, -0.8), (0.6, 0.0, 0.8), surface=(-5.0, 0.0, 0.0)),
        Spot(k.DEBRIS, (0.6, 0.0, -0.8), (-0.6, 0.0, 0.8), surface=(-5.0, 0.0, 0.0)),
        Spot(k.DEBRIS, (0.0, -0.3, 0.9), up, surface=(5.0, 0.0, 0.0), force=(1.0 if slipping else 0.2, 0.0, 0.0)),
        Spot(k.DEBRIS, (1.0, 0.0, 0.2), (-math.sqrt(0.96), 0.0, -0.2), force=(0.0, 1.0, 0.0)),
    ]
    rig = Rig(spots, view).move(0.01, dt=0.0, moving=1.0)
    return rig.move(0.5, turning * 0.01, [0.0, 0.0, slipping * 0.01, 0.01], moving=1.0, times=30)


def layer_sticks(view):
    return layer_of_debris(view).has(*STICKING).shows(friction=pytest.approx(0.0, abs=1e-15))  # the lateral spot counts here


def layer_slides(view):
    return layer_of_debris(view, slipping=1.0).has(*SLIDING).shows(sliding_side=ABOVE)


def layer_rolls(view):
    # .01 of surface travel a stride (not the .5 of the plates), D from the load centres at .9 and -.8
    return layer_of_debris(view, turning=0.5).has(*ROLLING).shows(roll_ratio=pytest.approx(0.5 * 1.7, rel=1e-9))


def between_plate_and_debris(view):
    rig = Rig([lower(0.0), Spot(k.DEBRIS, (0.0, 0.0, 1.0), (0.0, 0.0, -1.0), surface=(2.0, 0.0, 0.0))], view)
    return rig.move(0.5, dt=0.0, moving=1.0).move(0.5, 0.001, moving=1.0, times=3).has(*ROLLS_UNKNOWN)


def pinched_sideways(view):
    spots = [Spot(k.DEBRIS, (x, 0.0, 0.0), (-x, 0.0, 0.0), force=(0.0, 0.0, 1.0), surface=(0.0, 0.0, 9.0)) for x in (-1.0, 1.0)]
    return Rig(spots, view).move(0.01, dt=0.0, moving=1.0).move(0.5, slip=[0.01, 0.01], moving=1.0).has(*SLIDING)


def seats_while_pressed(view):
    rig = three_spot(view).move(turn=0.02, slip=[0.02, 0.02, 0.0], times=5).has(*ROLLING)
    rig.move(times=18).has(*STICKING)  # 18 ms, in which the load could have moved it by thousands of a
    return rig.move(1e-4).has(*STICKING)


def out_of_balance(view):
    rig = three_spot(view).slide(0.01, [2], 3)
    rig.force = (0.0, 0.0, 0.04 * 4.0)
    rig.move(0.01, slip=[0.0, 0.0, 0.01]).has(*SLIDING).shows(force_balance=pytest.approx(0.2, rel=1e-12))
    rig.force = (0.0, 0.0, 0.06 * 4.0)
    rig.move(0.01, slip=[0.0, 0.0, 0.01]).has(*UNBALANCED)
    rig.force, rig.torque = STILL, (0.0, 0.06 * 4.0 * 2.0, 0.0)
    return rig.move(0.01, slip=[0.0, 0.0, 0.01]).has(*UNBALANCED).shows(moment_balance=pytest.approx(-0.2, rel=1e-12))


# a start or stop counts from the observation that sees it, so that finer observation loses less of the first stride: histories
# built to sit within one stride of a threshold need theirs
FINE = [ball_rolls, slides_below, one_of_two_slides_above, slides_on_both_sides_then_stops, stroke_reverses]
COARSE = [
    elastic_tilt, ball_turns_back, ball_against_the_drag, turns_a_little_in_every_window, spins_many_turns, tips, pivots,
    skids_on_one_plate, rolls_back_on_one_plate, rides_on_the_lower_plate, comes_and_goes, snaps_over, lands_after_a_whole_turn,
    lands_without_a_turn, without_friction, layer_sticks, layer_slides, layer_rolls, between_plate_and_debris, pinched_sideways,
    seats_while_pressed, out_of_balance,
]  # fmt: skip
by_name = each(FINE + COARSE, lambda history: history.__name__)


@by_name
def test_histories_also_by_the_labeller_with_forecasts_of_effects(history):
    assert history(View()).frames == history(View(label=LABEL_WITH_EFFECTS)).frames


@by_name
def test_frames_do_not_depend_on_the_view(history):
    expected = history(View()).frames
    for name, view in {
        "micrometres": View(unit=1e-6), "mirrored": View(mirrored=True), "turned": View(quarter_turns=1),
        "other order, kilometres": View(backward=True, unit=1e3),
    }.items():  # fmt: skip
        for there, here in zip(expected, history(view).frames, strict=True):
            here["rolled_distance"] /= view.unit
            assert (here["state"], here["reason"]) == (there["state"], there["reason"]), name
            # sums in another order or unit round differently; 1e-10 is far above that and far below any threshold
            assert list(here.values()) == pytest.approx(list(there.values()), rel=1e-10, abs=1e-10), name


@each(COARSE, lambda history: history.__name__)
def test_labels_do_not_depend_on_the_stride(history):
    expected = [frame["state"] for frame in history(View()).frames]
    assert [frame["state"] for frame in history(View(parts=5)).frames] == expected


def test_both_quaternions_of_an_orientation_are_the_same():
    rig = three_spot(View())
    for _ in range(10):
        rig.q = -rig.q
        rig.move(1e-4, 1e-6).has(*STICKING)


def test_on_slopes_there_is_a_label_and_no_forecast():
    """The forecast is that of parallel planes; a hundredth of the friction of 0.3 is neglected."""
    for slope, known in ((0.0, True), (0.002, True), (0.004, False), (1.0, False)):
        size = math.hypot(1.0, slope)
        feet = [lower(-1.0, load=0.5), Spot(k.LOWER, (1.0, 0.0, -1.0), (slope / size, 0.0, 1.0 / size), load=0.5)]
        rig, out = Rig([*feet, upper(0.0)], View()), np.zeros(c.OUTPUTS)
        rig.view.label(rig.table()[1][:3], 3, rig.body((0.0, 0.0), DT, True), rig.m, out)
        assert c.STATES[int(out[0])] == "sticking"
        assert (int(out[c.output.FORECAST]) != k.NO_FORECAST) == known, slope
