"""Schedules of motion and load against closed forms, and foundations against a hand calculation."""

import math
from dataclasses import replace
from types import SimpleNamespace
from unittest import mock

import numpy as np
import pytest
from steel import scene_text
from theory.plain import plain
from thirdbody.assembly.integrator import inertial_number
from thirdbody.assembly.schedule import schedule, why_swings
from thirdbody.assembly.simulation import build
from thirdbody.engine.explicit import _contact_bounds
from thirdbody.engine.upper_plate import Schedule, Segment
from thirdbody.errors import InputError
from thirdbody.kernels.schedule import POLYNOMIAL, SINE, TRIANGLE, next_corner
from thirdbody.kernels.tables import patch, run_totals
from thirdbody.laws.registry import Registry
from thirdbody.plugin import HERTZ, MINDLIN, LawFamily, Plugin
from thirdbody.report.scene_check import check_report, print_check
from thirdbody.runner.verdicts import _load_ratio
from thirdbody.scene.model import Scene

PLATES = scene_text("{debris}", '["100 um", "100 um"]', "{upper}", solver="{solver}")


def ball(radius, x):
    return f'[[debris]]\nmaterial = "steel"\nkind = "spheres"\nradius = "{radius}"\npositions = [["{x}", "50 um", "{radius}"]]\n'


THREE = ball("5 um", "20 um") + ball("5.01 um", "50 um") + ball("5.03 um", "80 um")


def scene(upper, solver='duration = "1 us"', debris=THREE):
    return Scene.parse(PLATES.format(upper=upper, solver=solver, debris=debris))


def moved(text, start=0.0):
    return schedule(scene(f'load = "1 mN"\nmotion = {{x = {text}}}'), start)


def test_schedules_are_those_of_the_closed_forms():
    first = '{ramp = "2 m/s", duration = "2 us"}, {velocity = "2 m/s", duration = "1 us"}'
    for text, places in (
        # ramp: v t/2 = 2 um; then 2 um at 2 m/s; rest; back at 1 m/s
        (f'[{first}, {{pause = "3 us"}}, {{velocity = "-1 m/s"}}]', {1: 0.5e-6, 2: 2e-6, 3: 4e-6, 5: 4e-6, 6: 4e-6, 8: 2e-6}),
        # a ramp goes on from the velocity before: 2 um at 2 m/s, then 1.5 m/s on average for 2 us, then 1 m/s for ever
        ('[{velocity = "2 m/s", duration = "1 us"}, {ramp = "1 m/s", duration = "2 us"}]', {1: 2e-6, 3: 5e-6, 4: 6e-6}),
        # and from rest after a pause or after cycles, which end at rest themselves
        (f'[{first}, {{pause = "1 us"}}, {{ramp = "2 m/s", duration = "2 us"}}]', {3: 4e-6, 4: 4e-6, 6: 6e-6}),
        ('{stroke = "2 um", frequency = "1 MHz", shape = "triangle", cycles = 1.5}', {1.5: 2e-6, 9: 2e-6}),
    ):
        made = moved(text)
        for t, x in places.items():
            assert made.displacement_at(t * 1e-6)[0] == pytest.approx(x, rel=1e-12, abs=0.0)
    made = moved('{velocity = "1 m/s"}', start=5e-6)  # after settling
    assert made.displacement_at(4e-6) == (0.0, 0.0)
    assert made.displacement_at(7e-6)[0] == pytest.approx(2e-6, rel=1e-12)
    assert made.direction() == (1.0, 0.0)
    for text, heading in (
        ('x = {velocity = "3 m/s"}, y = {velocity = "-4 m/s"}', (0.6, -0.8)),
        ('x = [{pause = "1 us"}, {velocity = "3 m/s"}], y = {ramp = "-4 m/s", duration = "1 us"}', (0.0, -1.0)),  # the first one
    ):
        made = schedule(scene(f'load = "1 mN"\nmotion = {{{text}}}'), 0.0)
        assert (*made.direction(), made.top_speed()) == pytest.approx((*heading, 5.0), rel=1e-12)
    # strokes are peak to peak
    sine = moved('{stroke = "2 um", frequency = "1 MHz"}')
    triangle = moved('{stroke = "2 um", frequency = "1 MHz", shape = "triangle"}')
    for made in (sine, triangle):
        table, first = made.tables()
        corners = [plain(next_corner)(table, first, 0, t) for t in (0.0, 0.4e-6, 0.6e-6)]
        assert corners == pytest.approx([0.5e-6, 0.5e-6, 1e-6], rel=1e-12)
        assert made.displacement_at(0.0)[0] == 0.0
        assert made.displacement_at(0.5e-6)[0] == pytest.approx(2e-6, rel=1e-12)
        assert made.displacement_at(1e-6)[0] == pytest.approx(0.0, abs=1e-18)
    # a sine's largest speed is pi s f, a triangle's speed is 2 s f
    assert sine.top_speed() == pytest.approx(math.pi * 2.0, rel=1e-12)
    assert triangle.top_speed() == pytest.approx(4.0, rel=1e-12)
    for kind in (POLYNOMIAL, SINE, TRIANGLE):  # rates are slopes
        segment, h = Segment(0.0, kind, 1.0, 2.0, 3.0), 1e-6
        slope = (segment.value(0.1 + h) - segment.value(0.1 - h)) / (2.0 * h)
        assert segment.rate(0.1) == pytest.approx(slope, rel=1e-8)  # h^2 and rounding/h


def test_tangential_springs_get_rings_where_motion_or_load_turns_or_a_plate_is_rough():
    motion, falls = 'load = "2 mN"\nmotion = {x = %s}', '{load = "1 mN", duration = "1 us"}'
    there = '{velocity = "1 m/s", duration = "1 us"}'
    for upper, why in (
        (motion % '{velocity = "-1 m/s"}', ""),
        (motion % f'[{there}, {{pause = "1 us"}}, {{ramp = "3 m/s", duration = "1 us"}}]', ""),
        (motion % f'[{there}, {{velocity = "-1 m/s"}}]', "motion"),
        (motion % '{stroke = "1 um", frequency = "1 Hz", cycles = 3}', "motion"),
        (f'load = "2 mN"\nloading = {falls}', ""),
        (f'load = "2 mN"\nloading = [{falls}, {{load = "3 mN"}}]', "load"),
        ('gap = "11 um"\nclosing = "1 mm/s"', ""),
    ):
        found = why_swings(scene(upper))
        assert found.startswith(f"the {why} of" if why else "") and bool(found) == bool(why), upper
        given = scene(upper).with_settings({"plates.lower.surface": {"rms": "0.1 um", "long": "20 um", "short": "10 um"}})
        assert why_swings(given)
    sine = '{stroke = "1 um", frequency = "1 Hz"}'
    given = (sine, "auto", "two_rings", 11), (there, "auto", "two_number", 3), (sine, "one_ring", "one_ring", 8)
    for text, word, memory, size in given:
        choice = build(scene(motion % text).with_settings({"contact.memory": word})).choice
        assert choice.memory == memory and len(choice.chain.laws[2].history) == size


def test_paths_of_strokes_the_times_of_places_on_them_and_the_engine_that_follows():
    made = moved('{stroke = "2 um", frequency = "1 MHz"}')
    # to and fro: 4 um a cycle; chords of a thousandth of a period fall short by (pi/1000)^2/24 at most
    assert made.path(0.0, 3e-6) == pytest.approx(12e-6, rel=1e-6)
    assert made.time_of(6e-6, 0.0) == pytest.approx(1.5e-6, abs=2e-9)  # one chord
    ending = moved('[{velocity = "1 m/s", duration = "1 us"}, {pause = "1 us"}]')
    assert ending.time_of(0.5e-6, 0.0) == pytest.approx(0.5e-6, rel=1e-12)
    assert math.isinf(ending.time_of(2e-6, 0.0))
    # Whole cycles are not summed up chord by chord: a sine stroke of length b covers 2 b a cycle.
    for shape, rate in ((SINE, 2.0 * math.pi * 5.0), (TRIANGLE, 5.0)):
        axis = Schedule(x=(Segment(1.0, shape, 0.0, 5e-5, rate),))
        assert axis.path(0.0, 1.0 + 2e5) == pytest.approx(1e6 * 1e-4, rel=1e-6)
        assert axis.path(1.03, 1.03 + 2e5) == pytest.approx(1e6 * 1e-4, rel=1e-6)
        assert axis.time_of(1e6 * 1e-4, 0.0) == pytest.approx(1.0 + 2e5, rel=1e-6)
        # and a part of a cycle behind them: half a stroke at its middle
        assert axis.time_of(1e3 * 1e-4 + 2.5e-5, 0.0) == pytest.approx(1.0 + 200.0 + 0.05, abs=2e-4)
    # a ramp across a stroke repeats nothing
    stroke, ramp = Segment(0.0, SINE, 0.0, 5e-5, 2.0 * math.pi), Segment(0.0, POLYNOMIAL, 0.0, 0.0, 1e-5)
    both, fine = Schedule(x=(stroke,), y=(ramp, Segment(9.0, POLYNOMIAL, 0.0))), np.linspace(0.0, 8.5, 85_001)
    places = np.array([both.displacement_at(t) for t in fine])
    assert both.path(0.0, 8.5) == pytest.approx(np.linalg.norm(np.diff(places, axis=0), axis=1).sum(), rel=1e-5)
    text = '[{ramp = "1 m/s", duration = "0.2 us"}, {stroke = "0.3 um", frequency = "5 MHz", cycles = 1}, {velocity = "-1 m/s"}]'
    built = build(scene(f'load = "1 mN"\nmotion = {{x = {text}}}', 'duration = "0.6 us"\nsettle = "0.1 us"'))
    built.integrator.advance_to(time=0.6e-6)
    assert built.schedule.displacement_at(0.3e-6)[0] > 0.0
    # the path's length is the sum of the steps' lengths: chords of a curve, relative (omega dt)^2/24
    assert built.state.distance == pytest.approx(built.schedule.path(0.1e-6, built.state.time), rel=1e-3)


def test_masses_dashpots_and_settling_times_where_the_scene_gives_none():
    drag, d = 'motion = {x = {velocity = "1 mm/s"}}', 2.0 * np.array([5e-6, 5.01e-6, 5.03e-6])
    m, e_star = 7850.0 * np.pi / 6.0 * d**3, 210e9 / (2.0 * (1.0 - 0.3**2))
    critical = 2.0 * np.sqrt(2.0 * e_star * (3.0 * 1e-5 * 0.5 * d / (4.0 * e_star)) ** (1.0 / 3.0) * m.mean())  # k = 2 E* a
    upper = build(scene(f'support = "load_per_particle"\nload = "10 uN"\n{drag}')).upper
    assert upper.plate.mass == pytest.approx(m.mean(), rel=1e-9) and upper.plate.damping == pytest.approx(critical, rel=1e-6)
    fall = 0.25 * d.max()  # of the patch
    assert upper.settle == pytest.approx(math.sqrt(2.0 * fall * (m.max() + m.mean()) / 1e-5) + critical.max() * fall / 1e-5)
    springs = build(scene(f'support = "foundation"\nstiffness = "10 N/m"\nload = "10 uN"\n{drag}'))
    common, dashpot = springs.upper.plate.foundation, springs.upper.plate.damping[0]
    assert common.mass == pytest.approx(m.sum(), rel=1e-9) and springs.upper.settle == pytest.approx(12.0 * dashpot / 10.0)
    assert common.damping == pytest.approx(2.0 * math.sqrt(3.0 * 10.0 * m.sum()), rel=1e-9)
    rigid = build(scene(f'load = "10 uN"\n{drag}'))
    for built, mass in ((rigid, m.mean()), (springs, 2.0 * m.mean())):  # mass and load of the plate in equal parts, and a patch
        number = 1e-3 * np.sqrt((m + mass) / (1e-5 / 3.0 * d)).max()
        assert inertial_number(built.state).number == pytest.approx(number, rel=1e-9)
    assert build(scene('support = "load_per_particle"\nload = "10 uN"')).upper.settle == 0.0  # nothing moves


def test_a_closing_gap_presses():
    with pytest.raises(InputError, match="upper.gap: .* is smaller than body 2, .*it would start inside the plate"):
        build(scene('gap = "10.05 um"'))
    built = build(scene('gap = "10.001 um"\nclosing = "10 mm/s"', 'duration = "0.5 us"', ball("5 um", "50 um")))
    built.integrator.advance_to(time=0.5e-6)
    assert built.state.patches.height[0] == pytest.approx(10.001e-6 - 0.5e-6 * 10e-3, rel=1e-4)
    assert built.state.A[run_totals.UPPER_FORCE + 2] > 0.0 and built.state.A[run_totals.PLATE_WORK] > 0.0


def settled(upper, time=40e-6):
    built = build(scene(upper, f'duration = "{time} s"'))
    built.integrator.advance_to(time=time)
    slots, force = built.state.slots, np.zeros(3)
    for k in np.flatnonzero((slots.histories.slip > 0.0) & (slots.partner < -1)):
        force[built.state.body[slots.own[k]]] += slots.records.normal_force[k]
    return built, force


def shared(tops, stiffness, load):
    """Loads by hand: spring and two Hertz contacts in series under each body, a common plate that carries `load`."""
    e_star, radii = 210e9 / (2.0 * (1.0 - 0.3**2)), 0.5 * np.asarray(tops)

    def approach(n):
        return n / stiffness + 2.0 * (3.0 * n / (4.0 * e_star * np.sqrt(radii))) ** (2.0 / 3.0)

    def loads(level):
        low, high = np.zeros(3), np.full(3, load)
        for _ in range(60):
            middle = 0.5 * (low + high)
            below = approach(middle) < np.maximum(tops - level, 0.0)
            low, high = np.where(below, middle, low), np.where(below, high, middle)
        return np.where(tops > level, high, 0.0)

    low, high = 0.5 * min(tops), max(tops)
    for _ in range(80):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if loads(middle).sum() > load else (low, middle)
    return loads(high)


def test_a_foundation_shares_the_load_by_its_springs_and_a_stiff_one_is_a_rigid_plate():
    built, force = settled('support = "foundation"\nstiffness = "100 N/m"\nload = "10 uN"')
    tops = np.array([10.0e-6, 10.02e-6, 10.06e-6])
    # 40 us are eight relaxation times c/k of the patches: e^-8
    assert force == pytest.approx(shared(tops, 100.0, 10e-6), rel=2e-3)
    assert force.sum() == pytest.approx(10e-6, rel=1e-3)
    assert built.upper.loaded == 3
    # a soft foundation with preload loads each
    _, force = settled('support = "foundation"\nstiffness = "1e-3 N/m"\npreload = "10 uN"\ngap = "10.07 um"')
    assert force == pytest.approx([10e-6] * 3, rel=0.01)
    _, stiff = settled('support = "foundation"\nstiffness = "1e6 N/m"\nload = "10 uN"')
    built, rigid = settled('support = "rigid"\nload = "10 uN"')
    # the tallest carries it all: 40 nm more than the overlap under 10 uN
    assert rigid == pytest.approx([0.0, 0.0, 10e-6], rel=1e-3)
    assert stiff == pytest.approx(rigid, rel=0.01, abs=1e-9)
    assert built.state.A[run_totals.UPPER_FORCE + 2] == pytest.approx(10e-6, rel=0.01)
    assert built.upper.plate.mass == pytest.approx(built.state.bodies.mass.sum(), rel=1e-12)  # where the scene gives none
    assert built.upper.loaded == 1 and built.state.A[run_totals.PLATE_WORK] > 0.0
    assert not any("rests on about 1 of 3" in warning for warning in built.warnings)  # three bodies are no larger layer
    warnings = build(scene('load = "10 uN"', debris=THREE + ball("5 um", "5 um"))).warnings
    assert any("rests on about 1 of 4 bodies" in warning for warning in warnings)


def test_check_says_that_preload_comes_on_top_of_the_load(capsys):
    upper = 'support = "foundation"\nstiffness = "100 N/m"\npreload = "3 uN"\nload = "10 uN"'
    print_check(check_report(build(scene(upper, 'duration = "1 us"'))))
    assert "load 10 uN and 3 uN of preload on each patch (9 uN more in all)" in capsys.readouterr().out
    _, force = settled(upper)
    assert force.sum() == pytest.approx(19e-6, rel=1e-3)  # as above: e^-8


def test_a_reversal_clears_the_windows_of_the_labels():
    upper = 'support = "load_per_particle"\nload = "0.1 mN"\n'
    upper += 'motion = {x = {stroke = "0.6 um", frequency = "0.5 MHz", shape = "triangle"}}'
    built = build(scene(upper, 'duration = "3 us"\nsettle = "2 us"'))
    travel = built.labeller.memory.index("travel")

    def travelled(time):
        built.integrator.advance_to(time=time)
        return float(built.state.M[:, travel].max())

    # the stroke turns after 1 us; each way is 0.6 um at 0.6 m/s
    steps = built.state.dt * built.labeller.stride
    assert travelled(2e-6 + 0.3e-6) > 0.0 and built.state.A[run_totals.HEADING] == 1.0
    # two looks after the turn the window has seen no more than they have
    assert travelled(3e-6 + 2.0 * steps) <= 0.6 * 3.0 * steps and built.state.A[run_totals.HEADING] == -1.0


def test_a_law_without_a_tangent_is_reported():
    bare = replace(MINDLIN, name="bare", tangent=None)
    plain = scene('load = "1 mN"\ndamping = "1e-4 kg/s"').with_settings({"contact.law": "bare", "contact.level": "only"})
    built = build(plain, Registry((Plugin("bare", families=(LawFamily("bare", {"only": (HERTZ, bare)}, "only"),)),)))
    assert any(warning.startswith("bare has no tangent") for warning in built.warnings)


def read(loading, held='load = "2 mN"'):
    return scene(f"{held}\nloading = {loading}", debris=ball("5 um", "50 um"))


def factors(given, start, times):
    """The load over the first one at these times after settling, s."""
    axis = schedule(given, start).load
    return [[piece for piece in axis if piece.start <= start + t][-1].value(start + t) for t in times]


STAGES = '[{pause = "1 us"}, {load = "0 N", duration = "2 us"}, {pause = "1 us"}, {load = "20 N"}]'


def test_stages_follow_each_other_the_last_load_stays_and_the_largest_is_foreseen():
    times = [0.0, 0.9e-6, 2e-6, 3.5e-6, 3.999e-6, 4e-6, 1.0]
    # straight lines between numbers of a few digits: rounding only
    assert factors(read(STAGES), 3e-6, times) == pytest.approx([1.0, 1.0, 0.5, 0.0, 0.0, 1e4, 1e4], rel=1e-9, abs=1e-9)
    # before the debris has settled the load is the first one
    axis = schedule(read(STAGES), 3e-6).load
    assert axis[0].start == 0.0 and axis[0].value(2.9e-6) == 1.0
    # what the explicit time step must foresee: also a jump just ahead
    for start, end, largest in (
        (0.0, 9.9, 1e4), (0.0, 3.5e-6, 1.0), (2e-6, 3.9e-6, 0.5), (3.1e-6, 3.9e-6, 0.0), (3e-6, 4e-6, 1e4),
    ):  # fmt: skip
        assert schedule(read(STAGES), 0.0).largest_load(start, end) == pytest.approx(largest, rel=1e-9, abs=1e-9)
    # until the next bound, since steps may grow: 1.5 horizons
    P, upper = np.full((1, patch.WIDTH), 2.0), SimpleNamespace(schedule=schedule(read(STAGES), 0.0))
    state = mock.Mock(P=P, time=3e-6, world=SimpleNamespace(upper=upper))
    for horizon, load in ((0.6e-6, 2.0), (0.7e-6, 2e4)):
        with mock.patch("thirdbody.engine.explicit.limits.Assembly", side_effect=KeyError) as given, pytest.raises(KeyError):
            _contact_bounds(state, horizon, 0.3)
        assert given.call_args.args[11][0, patch.LOAD] == pytest.approx(load, rel=1e-9)
    P = np.zeros((3, patch.WIDTH))  # what is carried at the end: two patches with a preload on the springs of a common plate
    P[:, patch.FREE], P[:, patch.LOAD], P[2, patch.NOMINAL_LOAD], P[:2, patch.SPRING] = 1.0, (3.0, 3.0, 10.0), 10.0, 5.0
    loop = SimpleNamespace(series={"upper_force": (0, 0, 11.0), "direct_force": (0, 0, 1.0)}, maker=SimpleNamespace(interval=2.0))
    rising = Schedule(load=(Segment(0.0, POLYNOMIAL, 1.0), Segment(3.0, POLYNOMIAL, 1.0, 2.0)))  # in the mean 1.5 from 2 s to 4 s
    for given, ratio in ((Schedule(), 1.2), (rising, 0.8)):
        assert _load_ratio(
            SimpleNamespace(state=SimpleNamespace(P=P, time=4.0, world=SimpleNamespace(zone=None)), schedule=given), loop
        ) == pytest.approx(ratio)


def table_scene(folder, rows, more=""):
    (folder / "load.csv").write_text(rows)
    read(f'{{table = "load.csv"{more}}}').save(folder / "scene.toml")
    return Scene.load(folder / "scene.toml")


def test_loads_of_a_table_and_of_the_scene_right_and_wrong(tmp_path):
    given = table_scene(tmp_path, "time (us), load (mN)\n0, 2\n1, 4\n3, 0\n")
    assert factors(given, 0.0, [0.5e-6, 1e-6, 2e-6, 5e-6]) == pytest.approx([1.5, 2.0, 1.0, 0.0], rel=1e-9, abs=1e-12)
    fast = table_scene(tmp_path, "time (us), load (mN)\n0, 2\n1, 4\n", ", speed = 10")
    assert factors(fast, 0.0, [0.05e-6, 0.1e-6]) == pytest.approx([1.5, 2.0], rel=1e-9)
    for rows, message in (
        ("displacement (um)\n0, 0\n1, 1\n", "expected 'load (unit)'"), ("load (um)\n0, 0\n1, 1\n", "expected a force"),
        ("load (mN)\n0, 1\n1, -1\n", "line 3: a load is never negative"), ("load (mN)\n0, 1\n0, 2\n", "times must grow"),
        ("load (mN)\n0, 1\n1, nan\n", "not a finite number"),
    ):  # fmt: skip
        with pytest.raises(InputError, match="plates.upper.loading.table") as caught:
            schedule(table_scene(tmp_path, f"time (us), {rows}"), 0.0)
        assert message in str(caught.value)
    for loading, message in (
        ('{load = "-1 N"}', "plates.upper.loading.load"), ('[{lode = "1 N"}]', "did you mean 'load'"),
        ("[]", "the list of stages is empty"), ('[{load = "1 N", duration = "0 s"}]', "duration"),
    ):  # fmt: skip
        with pytest.raises(InputError) as caught:
            read(loading)
        assert message in str(caught.value)
    with pytest.raises(InputError, match="plates.upper.loading: changes a load"):
        read('{load = "1 N"}', 'gap = "20 um"')
    given = read(STAGES)
    assert Scene.parse(given.to_toml()).plates.upper == given.plates.upper
