"""What alarms in a scene is said first, with the number that decides and the remedy; nonsense is a fault with its place."""

import gc
import json
import math
import re
import time
import tracemalloc
from types import SimpleNamespace

import numpy as np
import pytest
from balls import edited
from each import each
from steel import SCENES, scene_text
from thirdbody.api import run
from thirdbody.assembly import upper_plate
from thirdbody.assembly.cautions import Expected
from thirdbody.assembly.plate_load import times
from thirdbody.assembly.simulation import build
from thirdbody.engine.islands import expected_islands
from thirdbody.errors import InputError
from thirdbody.kernels.tables import sphere
from thirdbody.laws.contract import Material
from thirdbody.laws.hertz import yield_limit
from thirdbody.report import scene_check as check
from thirdbody.report.tables import run_report
from thirdbody.runner.outlook import memory_of, run_warnings
from thirdbody.runner.simulate import prepare
from thirdbody.scene.model import Scene

# one ball of 10 um between steel plates: 0.01 mN gives a peak pressure of 1.45 GPa, below first yield
DEBRIS = '[[debris]]\nmaterial = "steel"\nkind = "irregular"\nspheres = 1\naspect = [1.0, 1.0, 1.0]\ncount = 1\n'
DEBRIS += 'size = {distribution = "lognormal", median = "10 um", sigma = 0.2, min = "9 um", max = "11 um"}'
UPPER = 'support = "load_per_particle"\nload = "0.01 mN"\nmotion = {x = {velocity = "1 mm/s"}}'
SOLVER = 'distance = "10 nm"\nsettle = "0.1 us"\nintegrator = "explicit"'
BED = (
    ("count = 1", 'count = 40\nplacement = "dense"'), ('["60 um", "60 um"]', '["30 um", "30 um"]'),
    ('support = "load_per_particle"', 'support = "rigid"'),
)  # fmt: skip

WARNINGS = {
    "210 MPa for GPa": ([("210 GPa", "210 MPa"), ("0.01 mN", "1 nN")], ["youngs_modulus", "210 MPa", "was GPa meant?"]),
    "g/cm3 for kg/m3": ([("7850 kg/m3", "7.85 kg/m3")], ["materials.steel.density: 7.85 kg/m3", "g/cm3", "7850 kg/m3"]),
    "friction in per cent": ([("friction = 0.30", "friction = 30")], ["pairs[0].friction: 30 ", "not per cent"]),
    "deep overlap": ([("210 GPa", "0.6 GPa"), ("0.01 mN", "0.5 mN")], ["expected overlap 0.1", "a run stops at 0.3"]),
    "yield, assumed": (
        [("0.01 mN", "2 mN")],
        ["1.7 times first yield of steel at 3.36 GPa", "2.1 GPa, assumed as E/100", "at most", "effects.elastic_plastic"],
    ),
    "yield, given": (
        [("density =", 'yield_strength = "500 MPa"\ndensity =')], ["first yield of steel at 800 MPa", "500 MPa, given"],
    ),
    "every above the run": (
        [('distance = "10 nm"', 'duration = "1 us"'), ('every = "10 nm"', 'every = "2 us"')],
        ["output.every: 2 us is longer than the whole run; allowed: at most 1.1 us"],
    ),
    "every above the path": (
        [('distance = "10 nm"', 'duration = "1 us"'), ('every = "10 nm"', 'every = "1 um"')],
        ["output.every: 1 um is longer than the whole run; allowed: at most 1 nm"],
    ),
    "dashpots against friction": (
        [("1 mm/s", "1 m/s"), ("load =", 'damping = "3e-5 kg/s"\nload =')],
        ["dashpot carries up to 3.0 times the load", "3 times slower", 'plates.upper.damping = "0.00001 kg/s"'],
    ),
    "bed without contacts": (
        [*BED, ("[solver]", '[contact]\ndebris_contact = "none"\n[solver]')], ["40 bodies, packed", 'debris_contact = "auto"'],
    ),
    "bed, implicit": ([*BED, ('integrator = "explicit"', 'integrator = "implicit"')], ["40 bodies, packed", '"explicit"']),
}  # fmt: skip


def scene(*changes: tuple[str, str]) -> Scene:
    return Scene.parse(edited(scene_text(DEBRIS, '["60 um", "60 um"]', UPPER, solver=SOLVER, every="10 nm"), *changes), "x.toml")


@each(WARNINGS)
def test_what_is_unusual_is_warned_of_with_its_number_and_remedy(name):
    changes, words = WARNINGS[name]
    assert len([warning for warning in build(scene(*changes)).warnings if all(word in warning for word in words)]) == 1


def test_dissimilar_pairs_and_every_pair_that_a_foundation_presses_are_warned_of():
    glass = '[materials.glass]\nyoungs_modulus = "70 GPa"\npoisson_ratio = 0.2\ndensity = "2500 kg/m3"\n'
    betas = []
    for names in ('"steel", "glass"', '"glass", "steel"'):
        pair = f"{glass}[[pairs]]\nbetween = [{names}]\nfriction = 0.3\nrestitution = 0.6\n[[pairs]]"
        built = build(scene(("[[pairs]]", pair), ('[plates.lower]\nmaterial = "steel"', '[plates.lower]\nmaterial = "glass"')))
        betas += [float(re.search(r"Dundurs beta ([-+.\d]+)", text)[1]) for text in built.warnings if "Dundurs" in text]
    g, h = 210.0 / 2.6, 70.0 / 2.4  # shear moduli
    beta = (0.4 / g - 0.6 / h) / (2.0 * (0.7 / g + 0.8 / h))
    assert sorted(betas) == pytest.approx([-abs(beta), abs(beta)], abs=6e-4)  # three digits
    # the soft debris, which yields first, does not hide behind the hard grains, which carry more
    warnings = "\n".join(build(Scene.load(SCENES / "mixed_population.toml")).warnings)
    assert "steel/bronze: expected peak pressure" in warnings and "steel/alumina: expected peak pressure" in warnings


def hertz_radius(built):
    """Of the contact of the ball under 0.01 mN: a^3 = 3 F R/(4 E*)."""
    return (3.0 * 1e-5 * float(built.state.spheres.radius[0]) / (4.0 * 210e9 / (2.0 * 0.91))) ** (1.0 / 3.0)


def test_hot_spots_are_warned_of_unless_a_measure_has_them():
    """T = mu F v/(4 a 2 k) with the radius a of Hertz, a^3 = 3 F R/(4 E*); rounding of the overlap in between. 107 K here."""
    glass = 'thermal_conductivity = "1 W/m/K"\nheat_capacity = "460 J/kg/K"\ndensity ='
    hot = scene(("1 mm/s", "20 m/s"), ("density =", glass))
    built = build(hot)
    heat, a = built.expected.heat, hertz_radius(built)
    assert heat.excess == pytest.approx(0.3 * 1e-5 * 20.0 / (4.0 * a * 2.0), rel=1e-9) and heat.excess > 100.0
    assert heat.peclet == pytest.approx(0.5 * 20.0 * a * 7850.0 * 460.0 / 1.0, rel=1e-9) and not heat.assumed
    hot_spots = [line for line in built.expected.warnings() if "friction heats a spot of steel/steel by some 107 K" in line]
    assert len(hot_spots) == 1 and "measures.flash_temperature" in hot_spots[0]
    measured = build(hot.with_settings({"measures.flash_temperature": True}))
    assert not any("friction heats" in warning for warning in measured.expected.warnings())
    built = build(scene())
    slow = built.expected.heat
    assert slow.assumed and slow.excess < 1e-3


def test_deep_wear_is_warned_of_unless_a_measure_has_it():
    """h = k N/(pi a^2) s with the radius a of Hertz and k = 1e-14 m3/J: 14 nm after 1 mm under 0.01 mN, 0.4 of the overlap."""
    far = scene(('distance = "10 nm"', 'distance = "1 mm"'), ('every = "10 nm"', 'every = "1 mm"'))
    built = build(far)
    wear, radius, a = built.expected.wear, float(built.state.spheres.radius[0]), hertz_radius(built)
    assert wear.depth == pytest.approx(1e-14 * 1e-5 / (math.pi * a**2) * built.schedule.path(0.0, built.planned_time), rel=1e-9)
    assert wear.fraction == pytest.approx(wear.depth * radius / a**2, rel=1e-9) and wear.fraction > 0.3
    worn = [warning for warning in built.expected.warnings() if "a spot of steel/steel that slides all the way wears" in warning]
    assert len(worn) == 1 and "measures.wear" in worn[0]
    measured = build(far.with_settings({"measures.wear": {"plates": "1e-14 m3/J"}}))
    assert not any("that slides all the way wears" in warning for warning in measured.expected.warnings())
    assert build(scene()).expected.wear.fraction < 0.01


FAULTS = {
    "x.toml:25:1: plates.upper.load: 5 N on each body would press contacts in by more than 0.3 of the radius":
        [("0.01 mN", "5 N")],
    "x.toml:26:1: plates.upper.load: 5 N on each body would press contacts in by more than 0.3 of the radius":
        [('"load_per_particle"', '"foundation"\nstiffness = "200 N/m"'), ("0.01 mN", "5 N")],
    "x.toml:16:37: debris[0].size.median: the median 3 um is outside the limits, min 9 um and max 11 um":
        [('median = "10 um"', 'median = "3 um"')],
    "x.toml:32:1: output.every: 20 nm is longer than the whole run; allowed: at most 10 nm":
        [('every = "10 nm"', 'every = "20 nm"')],
}  # fmt: skip


@each(FAULTS)
def test_nonsense_is_a_fault_with_its_place_and_range(text):
    with pytest.raises(InputError) as caught:
        build(scene(*FAULTS[text]))
    assert str(caught.value).startswith(text)


def test_a_usual_scene_has_no_warning_and_one_interval_may_be_the_whole_run():
    assert build(scene()).warnings == []
    assert scene(('distance = "10 nm"', 'distance = "30 nm"'), ('every = "10 nm"', 'every = "30 nm"')).output.every == 30e-9


def test_a_load_that_all_bodies_share_is_not_laid_on_one():
    """A rigid plate comes down on the tallest of a bed; what a load does to it is judged by those that carry it."""
    rigid = ("0.01 mN", "0.1 mN"), ('support = "load_per_particle"', 'support = "rigid"')
    equal = '"lognormal", median = "10 um", sigma = 0.2, min = "9 um", max = "11 um"', '"constant", value = "10 um"'
    one, four = build(scene(*rigid)), build(scene(*rigid, ("count = 1", "count = 4"), equal))
    assert four.upper.loaded == 4
    # Hertz: the overlap goes as the load to the power 2/3; the lone ball has another size
    assert four.upper.shared_overlap < one.upper.shared_overlap
    assert four.upper.shared_overlap == pytest.approx(four.upper.overlap * 4.0 ** (-2.0 / 3.0), rel=1e-6)


def test_a_long_run_a_large_file_slow_frames_and_a_trial_that_a_guard_stops_are_reported():
    report = list(run_warnings(build(scene()), 2.2e6, 1e3, 50e9, "stopped at t = 0 s"))
    assert "stopped by a guard" in report[0] and "stopped at t = 0 s" in report[0]
    assert "about 25 days (2.2e+06 s)" in report[1] and "solver.distance" in report[1]
    assert "about 50 GB on disk" in report[2] and 'output.every = "50 nm"' in report[2]
    assert list(run_warnings(build(scene()), 80000.0, 79000.0, 9e9, "")) == []
    (report,) = run_warnings(build(scene()), 3e5, 2.5e5, 1e9, "")
    assert "frames would take about 2.9 days" in report and 'output.every = "30 nm" leaves 1 days or less' in report
    report = check.check_report(build(scene(("[output]", 'time_step = "30 ns"\n[output]')), force=True))
    assert math.isnan(report["estimated_wall_time"])
    words = "a trial of the first steps was stopped by a guard, and so will the run be: stopped at"
    assert report["warnings"][0].startswith(words)


def test_warnings_come_first_and_in_json(capsys):
    report = check.check_report(build(scene(("friction = 0.30", "friction = 30"))))
    check.print_check(report)
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == f"warning: {report['warnings'][0]}" and "friction: 30" in lines[0]
    assert lines[-1] == f"# {len(report['warnings'])} warning(s): see the top"
    assert json.loads(json.dumps(report["warnings"])) == report["warnings"]


def test_the_softer_material_yields_first():
    hard = Material("hard", 80e9, 0.3, 7850.0, 2e9)
    soft = Material("soft", 30e9, 0.3, 2700.0, None)
    rubber = Material("rubber", 1e6, 0.49, 1000.0, None)
    assert yield_limit(hard, soft).pressure == pytest.approx(1.6 * 0.01 * 78e9, rel=1e-12) and yield_limit(hard, soft).assumed
    assert yield_limit(hard, hard) == (3.2e9, "hard", 2e9, False)
    assert yield_limit(rubber, rubber).pressure == math.inf and yield_limit(rubber, hard).material == "hard"


def test_a_run_reports_its_peak_pressure_against_first_yield(tmp_path, capsys):
    with run(scene(("0.01 mN", "2 mN")), tmp_path / "hard", threads=1, progress=False) as result:
        report = result.summary()
        largest = max(result.bodies(k)["peak_pressure"].max() for k in range(result.frames))
    assert report["peak_pressure"] == largest
    found = report["first_yield"]
    assert found["pressure"] == pytest.approx(3.36e9, rel=1e-12) and found["assumed"]
    assert found["ratio"] == pytest.approx(largest / 3.36e9, rel=1e-12) and found["ratio"] > 1.0
    run_report(tmp_path / "hard", json=False)
    out, err = capsys.readouterr()
    assert "peak pressure" in out and "warning: peak pressure" in err and "assumed as E/100" in err
    with run(scene(), tmp_path / "soft", threads=1, progress=False) as gentle:
        assert 0.0 < gentle.summary()["first_yield"]["ratio"] < 1.0
    run_report(tmp_path / "soft", json=False)
    assert "warning" not in capsys.readouterr().err


@pytest.mark.parametrize("integrator, most", [("explicit", 9000), ("implicit", 8000)])
def test_memory_per_body_is_what_a_larger_scene_takes_more(integrator, most):
    sheared = Scene.load(SCENES / "sheared_debris.toml")
    sheared = sheared.with_settings({"solver.integrator": integrator, "contact.debris_contact": "none"})
    kept, taken = [prepare(sheared.with_settings({"debris.0.count": 50}), force=True)], []  # caches and compiled code
    tracemalloc.start()
    for count in (100, 400):
        gc.collect()
        before = tracemalloc.get_traced_memory()[0]
        kept.append(prepare(sheared.with_settings({"debris.0.count": count}), force=True))
        gc.collect()
        taken.append(tracemalloc.get_traced_memory()[0] - before)
    tracemalloc.stop()
    counted = memory_of(kept[2]) - memory_of(kept[1])
    # 3 %: the scene itself and Python's own objects; a table of one number per sphere would be .7 %
    assert counted == pytest.approx(taken[1] - taken[0], rel=0.03)
    assert counted < 300 * most  # three eighths are records, of all candidates although few of them touch


def three_spot(**settings):
    return build(Scene.load(SCENES / "three_spot.toml").with_settings({k.replace("__", "."): x for k, x in settings.items()}))


def test_every_installed_effect_is_on_or_off_with_a_reason():
    rolling = three_spot(effects__rolling_resistance="{coefficient = 0.01}", solver__integrator="explicit")
    rows = {row["part"]: row for row in rolling.expected.parts()}
    assert rows["rolling: rolling_resistance"]["on"] and "effect: rolling_resistance" not in rows
    assert not rows["effect: damping"]["on"] and all(row["reason"] for row in rows.values())
    # weight of 1e-13 kg over .1 mN
    assert rows["effect: gravity"]["reason"].startswith("weight/load = 1e-08")
    assert rows["debris-debris contact"]["on"] is False and not three_spot().expected.warnings()
    # 3/2 pi w R of 2 um pulls with 0.47 uN, a tenth of 4.7 uN
    assert [len(rolling.expected.adhesion_warnings(load)) for load in (4.7e-6, 4.72e-6)] == [1, 0]


def test_weight_drags_near_the_wave_speed_and_close_spots_are_warned_of():
    heavy = {"debris__0__mass": "1e-7 kg", "plates__upper__load": "0.01 mN"}
    assert any("gravity is off" in line and "0.098" in line for line in three_spot(**heavy).expected.warnings())
    on = {"effects__gravity": '["0 m/s2", "0 m/s2", "-9.81 m/s2"]'}
    assert not any("gravity" in line for line in three_spot(**heavy, **on).expected.warnings())

    # sqrt(60 GPa/7800 kg/m3) = 2774 m/s is the slowest
    def is_warned_of(speed):
        fast = three_spot(plates__upper__motion__x__velocity=speed)
        return any("slowest shear wave" in line for line in fast.expected.warnings())

    assert is_warned_of("300 m/s") and not is_warned_of("200 m/s")
    simulation = three_spot(debris__0__spots__1__x="-0.1 um", debris__0__spots__2__x="0.3 um")
    share, distance = simulation.expected.neighbours
    radius = 1.5e-6 * math.sqrt(simulation.upper.overlap)  # of the larger contact, a^2 = R d
    assert distance == pytest.approx(0.4e-6 / radius, rel=1e-6)
    assert share == pytest.approx(4.0 * radius / (3.0 * math.pi * 0.4e-6), rel=1e-6)
    assert any("spots of a body stand as near as 5.1" in line for line in simulation.expected.warnings())


def test_spots_of_many_bodies_are_compared_in_seconds():
    """Quadratic in the bodies it would take a minute; two arrays of 2e5 numbers take a hundredth of a second."""
    n, S = 100_000, np.zeros((200_000, sphere.WIDTH))
    S[:, sphere.RADIUS] = S[:, sphere.Z] = 1.0
    S[1::2, sphere.X] = 3.0
    world = SimpleNamespace(upper=None)
    state = SimpleNamespace(S=S, body=np.repeat(np.arange(n), 2), side=np.zeros(2 * n, np.int8), world=world)
    begun = time.process_time()
    built = SimpleNamespace(state=state, upper=SimpleNamespace(overlap=1e-4), radii=S[:, sphere.RADIUS])
    assert Expected.neighbours.func(built)[1] == pytest.approx(300.0)
    assert time.process_time() - begun < 5.0


def test_adhesion_that_crushes_alone_is_told_without_a_load_below_zero(monkeypatch):
    layer = SimpleNamespace(scene=scene(), plate=scene().plates.upper, radius=np.ones(1), kind=np.zeros(1, int),
                            choice=SimpleNamespace(physics=None))  # fmt: skip
    monkeypatch.setattr(upper_plate, "response", lambda *_: SimpleNamespace(force=np.array([-15.2])))
    with pytest.raises(InputError, match="adhesion alone presses contacts in.*lower the work of adhesion") as caught:
        upper_plate._Layer.refuse_crushing(layer, np.zeros(1, int), 1e-5)
    assert "-15.2" not in str(caught.value)
    assert [times(1.004), times(0.9), times(1.25)] == ["equal to", "0.9 times", "1.2 times"]


def test_no_more_bodies_are_expected_in_an_island_than_there_are(monkeypatch):
    chain = np.arange(149), np.arange(1, 150)
    monkeypatch.setattr("thirdbody.engine.islands.search_pairs", lambda _state, _margin: chain)
    world, spheres = SimpleNamespace(debris_meets=True, size=(1.0, 1.0)), SimpleNamespace(radius=np.ones(150))
    state = SimpleNamespace(n_bodies=150, body=np.arange(150), world=world, spheres=spheres, rayleigh_radius=np.ones(150))
    found = expected_islands(state)
    assert found.mean == found.largest == 150
