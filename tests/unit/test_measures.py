"""Measures: what they declare and deposit, wear and heat against closed forms; rolling resistance and local damping in scenes."""

import math
from collections import namedtuple

import numpy as np
import pytest
from balls import BALLS, edited
from each import each
from shared_runs import PLATES, clumps
from steel import HOT_STEEL
from steel import STEEL as STEEL_TEXT
import thirdbody
from thirdbody.assembly.physics import law_faults
from thirdbody.assembly.simulation import build
from thirdbody.engine.guards import Ledger
from thirdbody.errors import InputError
from thirdbody.kernels.measures import AMOUNTS, deposit
from thirdbody.kernels.tables import record
from thirdbody.laws.generated import plain
from thirdbody.laws.measures import ADD, MAX, Amount, Measure, layout_of, measures_text
from thirdbody.laws.registry import discover
from thirdbody.plugin import ContactStep, Material, Pair
from thirdbody.scene.model import Scene
from thirdbody.units import parse

MEASURES = discover().measures
HOT = edited(BALLS, (STEEL_TEXT, HOT_STEEL))
STEEL = Material("steel", 80.8e9, 0.3, 7850.0, None, 50.0, 460.0)
PAIR = Pair(STEEL, STEEL, 0.3, 0.6)


def contact(**values):
    return ContactStep(*(values.get(name, 0.0) for name in ContactStep._fields))


def kernel(name, step, **options):
    measure = MEASURES[name]
    given = {option.name: option.default for option in measure.options} | options
    return plain(measure.kernel)(step, measure.mix(PAIR, given))


def test_flash_temperature_of_a_steel_spot_and_wear_by_both_laws():
    """Section 16: 1.2 K for a steel sphere of 10 um at 1 m/s and 0.5 mN, friction 0.3; told to two digits there. Contact radius
    of Hertz: a^3 = 3 F R/(4 E*), E* of steel on steel 210 GPa/(2 (1 - 0.09))."""
    a = (3.0 * 5e-4 * 10e-6 / (4.0 * 210e9 / (2.0 * 0.91))) ** (1.0 / 3.0)
    step = contact(force=0.3 * 5e-4, limit=0.3 * 5e-4, load=5e-4, speed=1.0, contact_radius=a, dt=1e-9, plate=1.0)
    mean, largest, peclet = kernel("flash_temperature", step)
    assert mean == largest == pytest.approx(0.3 * 5e-4 * 1.0 / (4.0 * a * 100.0), rel=1e-14) and float(f"{largest:.1e}") == 1.2
    assert peclet == pytest.approx(1.0 * a / (2.0 * 50.0 / (7850.0 * 460.0)), rel=1e-14)
    assert peclet < 0.02  # slow: the formula holds
    bronze = Material("bronze", 40e9, 0.3, 8800.0, None, 150.0, 380.0)
    for pair in (Pair(STEEL, bronze, 0.3, 0.6), Pair(bronze, STEEL, 0.3, 0.6)):  # heat leaves through 50 + 150 W/(m K)
        measure = MEASURES["flash_temperature"]
        _, hot, number = plain(measure.kernel)(step, measure.mix(pair, {}))
        # steel is the slower side
        assert (hot, number) == pytest.approx((largest / 2.0, peclet), rel=1e-14)
    assert kernel("flash_temperature", contact(friction_work=1e-12)) == (0.0, 0.0, 0.0)  # a contact that opened
    for largest, words in ((0.9, None), (2.0, "between"), (9.0, "a fast source")):
        texts = MEASURES["flash_temperature"].warnings({"peclet_number": largest})
        assert (words is None) == (not texts) and all(words in text for text in texts)
    step = contact(load=2e-3, slip=3e-9, friction_work=1.1e-12)
    assert kernel("wear", step, plates=5e-15, bodies=7e-15) == pytest.approx((7e-15 * 6e-12, 5e-15 * 6e-12, 1.1e-12), rel=1e-14)
    by_energy = kernel("wear", step, plates=5e-15, bodies=7e-15, law="energy")
    assert by_energy == pytest.approx((7e-15 * 1.1e-12, 5e-15 * 1.1e-12, 1.1e-12), rel=1e-14)
    for text in ("1e-15 m3/J", "1e-15 1/Pa", "1e-6 mm3/N/m"):
        assert parse(text, "wear_coefficient") == pytest.approx(1e-15, rel=1e-14)
    with pytest.raises(ValueError, match="is a pressure"):
        parse("1 Pa", "wear_coefficient")


def test_where_numbers_are_kept_and_which_amounts_make_sense():
    layout = layout_of([MEASURES["flash_temperature"], MEASURES["wear"]])
    names = [column.name for column in layout.bodies]
    assert names == [
        "flash_temperature_mean", "worn_volume", "plate_wear_lower", "plate_wear_upper", "sliding_work_lower",
        "sliding_work_upper", "measured_time", "flash_temperature", "peclet_number",
    ]  # fmt: skip
    assert layout.time == 6 and layout.sums == 5 and layout.width == 1 + 7
    assert layout.targets[:, 0].tolist() == [ADD] * 5 + [MAX] * 2
    assert layout.targets[2].tolist() == [ADD, 2, 3, -1, 0]  # wear of a plate: by side, nothing with debris, first map
    assert [entry.name for entry in layout.maps] == ["wear_depth", "friction_work_density"]
    with pytest.raises(ValueError, match="worn_volume"):
        layout_of([MEASURES["wear"], MEASURES["wear"]])
    for wrong in ({"kind": "median"}, {"kind": "mean", "of_plate": True}, {"map": ("depth", "m")}):
        with pytest.raises(ValueError, match="amount 'depth'"):
            Amount("depth", "m", "", **wrong)
    Nothing = namedtuple("Nothing", ())  # noqa: PYI024
    amounts = (Amount("a", "1", ""), Amount("b", "1", "", "mean"), Amount("c", "1", "", "maximum"))
    measure = Measure("all", MEASURES["wear"].kernel, Nothing, lambda pair, options: Nothing(), amounts, "")
    lines = measures_text([measure]).splitlines()
    assert "    H[k, at + 1] += r0[0]" in lines and "    H[k, at + 2] += s.dt * r0[1]" in lines
    assert "    H[k, at + 3] += s.dt" in lines and "    H[k, at + 4] = max(H[k, at + 4], r0[2])" in lines


def rows_of(points, radii, amounts, plate=0):
    n = len(points)
    return np.column_stack([np.arange(n), np.full(n, plate), points, radii, amounts])


def test_deposits_add_up_wrap_and_are_spread_like_hertz_pressure():
    """A deposit is split into parts that add up to it: to rounding of the parts, some hundred cells."""
    random = np.random.default_rng(3)
    size, maps = np.array([40e-6, 30e-6]), np.zeros((2, 2, 30, 40))
    points = random.uniform(-1.0, 2.0, (200, 2)) * size
    radii = np.where(np.arange(200) % 3, random.uniform(0.0, 6e-6, 200), 0.0)
    amounts = random.uniform(0.0, 1e-15, (200, 2))
    deposit(rows_of(points, radii, amounts), maps, size)
    assert maps.sum(axis=(1, 2, 3)) == pytest.approx(amounts.sum(axis=0), rel=1e-13)
    assert not maps[:, 1].any() and (maps >= 0.0).all()
    again = np.zeros_like(maps)
    deposit(rows_of(points + size, radii, amounts), again, size)  # one period further: the same cells, but for edges
    assert again == pytest.approx(maps, rel=1e-6, abs=1e-9 * maps.max())
    assert AMOUNTS == rows_of(points, radii, amounts).shape[1] - 2
    maps = np.zeros((1, 2, 30, 40))
    deposit(rows_of(np.array([[12.2e-6, 7.9e-6]]), np.array([0.1e-6]), np.array([[5.0]]), 1), maps, np.array([40e-6, 30e-6]))
    assert maps[0, 1, 7, 12] == 5.0 and np.count_nonzero(maps) == 1
    # the mean of r^2 under Hertz' pressure is 2 a^2/5; 4000 cells in the contact give it to 1 %
    maps, a = np.zeros((1, 2, 100, 100)), 35e-6
    deposit(rows_of(np.array([[50e-6, 50e-6]]), np.array([a]), np.array([[1.0]])), maps, np.array([100e-6, 100e-6]))
    x = (np.arange(100) + 0.5) * 1e-6 - 50e-6
    assert (maps[0, 0] * (x[:, None] ** 2 + x**2)).sum() == pytest.approx(0.4 * a * a, rel=0.01)
    assert math.isclose(maps.sum(), 1.0, rel_tol=1e-13)


def test_faults_of_measures():
    for measures, words in (
        ('weer = {plates = "1e-15 m3/J"}', "did you mean 'wear'?"),
        ('wear = {bodies = "1e-15 m3/J"}', "required key 'plates' is missing"),
        ('wear = {plates = "1 Pa"}', "is a pressure, expected a wear coefficient"),
        ('wear = {plates = "1 Pa", bodys = 1}', "is a pressure, expected a wear coefficient"),  # beside an unknown key, too
        ('cell = "1 um"\nflash_temperature = true', "no measure of this scene has a map"),
        ('cell = "1 nm"\nwear = {plates = "1e-15 m3/J"}', "makes 4.8e+09 cells"),
    ):
        faults = law_faults(Scene.parse(f"{HOT}[measures]\n{measures}\n"), discover())
        assert any(words in str(fault) for fault in faults), faults


MATERIALS = """\
scene = 1
[materials]
steel = {youngs_modulus = "210 GPa", poisson_ratio = 0.30, density = "7850 kg/m3"}
brass = {youngs_modulus = "105 GPa", poisson_ratio = 0.34, density = "8500 kg/m3"}
[[pairs]]
between = ["steel", "brass"]
friction = 0.30
restitution = 0.60
PAIR
[[pairs]]
between = ["brass", "brass"]
friction = 0.30
restitution = 0.60
"""
LAYER = clumps(12, '["60 um", "50 um"]', MATERIALS).replace('"steel"\nkind', '"brass"\nseed = 1\nplacement = "layer"\nkind')
TEXT = LAYER + PLATES.replace("motion", 'damping = "7e-5 kg/s"\nmotion').replace("10 mm/s", "1 m/s")
TEXT += '[effects]\nEFFECTS\n[solver]\ndistance = "2 um"\nsettle = "3 us"\n[output]\nevery = "1 um"\n'

ROLLING = "rolling_resistance = {coefficient = 0.05}"


def scene(effects: str = "", pair: str = "") -> Scene:
    return Scene.parse(TEXT.replace("EFFECTS", effects).replace("PAIR", pair))


def report(*texts: str) -> str:
    with pytest.raises(InputError) as caught:
        build(scene(*texts))
    return str(caught.value)


def test_contacts_report_the_moment_only_if_it_is_named(tmp_path):
    with thirdbody.run(scene(), tmp_path / "bare", progress=False) as run:
        assert not {"moment", "rolling_utilisation"} & set(run.contacts(-1))
    with thirdbody.run(scene(ROLLING), tmp_path / "rolling", progress=False) as run:
        contacts = run.contacts(-1)
        size = np.linalg.norm(contacts["moment"], axis=1)
        assert size.max() > 0.0
        # the moment has no part about the normal; arrays are stored as float32
        assert np.abs(np.sum(contacts["moment"] * contacts["normal"], axis=1)).max() < 1e-6 * size.max()
        used = contacts["rolling_utilisation"]
        assert np.all((used >= 0.0) & (used < 1.0 + 1e-6)) and used.max() > 0.5


def test_the_ledger_of_a_sheared_layer_closes_and_moments_are_balanced():
    """As in the shipped scenes; and the body's torque is that of its contacts' forces and moments."""
    rolling = build(scene("rolling_resistance = {coefficient = 0.2, damping = 0.3}\nlocal_damping = {coefficient = 0.3}"))
    state, ledger = rolling.state, Ledger(rolling.state)
    rolling.integrator.advance_to(time=rolling.settle)
    rolling.integrator.advance_to(distance=2e-6, watch=lambda: ledger.watch(state))
    assert ledger.relative_residual(state, ledger.lines(state)["residual"]) < 1e-3
    slots = state.slots
    torque, between = np.zeros((state.n_bodies, 3)), 0
    for k in np.flatnonzero(slots.histories.slip > 0.0):
        R, own, other = slots.R[k], state.body[slots.own[k]], slots.partner[k]
        force = R[record.NORMAL_FORCE] * R[record.NORMAL3] + R[record.TANGENTIAL_FORCE3]
        torque[own] += np.cross(R[record.POINT3], force) + R[record.MOMENT3]
        if other >= 0:
            between += np.linalg.norm(R[record.MOMENT3]) > 0.0
            torque[state.body[other]] -= np.cross(R[record.PARTNER_POINT3], force) + R[record.MOMENT3]
    # sums of a few numbers in another order
    assert np.allclose(torque, state.bodies.torque, rtol=0.0, atol=1e-12 * np.abs(torque).max())
    assert between > 0, "the layer is crowded enough that bodies collide"


def test_a_pair_may_have_its_own_coefficient_if_the_effect_is_on():
    rows = build(scene(ROLLING, "rolling_friction = 0.2")).choice.rows
    assert [row[-1].mu_r for row in rows] == [0.2, 0.05]
    assert Scene.parse(scene(ROLLING, "rolling_friction = 0.2").to_toml()).pairs[0].rolling_friction == 0.2
    for key, remedy in (
        ("rolling_friction = 0.2", "rolling_resistance = {coefficient = ...}"),
        ('work_of_adhesion = "5 mJ/m2"', "adhesion = {work_of_adhesion = ...}"),
    ):
        words = f"pairs[0].{key.split()[0]}: the effect that it belongs to is off: add [effects] {remedy}"
        assert words in report("", key)


def adhesive(own: str, all_pairs: str = 'work_of_adhesion = "50 mJ/m2", ', model: str = "jkr") -> tuple[str, str]:
    return f'adhesion = {{{all_pairs}model = "{model}"}}', f'work_of_adhesion = "{own}"'


def test_a_pair_may_have_its_own_work_of_adhesion_also_without_one_for_all():
    """In the parameters, the pull-off force and the reach; `check` tells it pair by pair."""
    built = build(scene(*adhesive("20 mJ/m2")))
    first, second = (row[0].adhesion * row[0].e_star for row in built.choice.rows)
    assert (first, second) == pytest.approx((0.02, 0.05), rel=1e-12)
    for pull_off, factor in (
        (built.state.physics.pull_off, 1.5), (build(scene(*adhesive("20 mJ/m2", model="dmt"))).state.physics.pull_off, 2.0)
    ):  # fmt: skip
        assert pull_off is not None
        assert pull_off(np.array([0, 1]), np.full(2, 1e-6)) == pytest.approx(factor * np.pi * 1e-6 * np.array([0.02, 0.05]))
    texts = [(pair, text.partition(",")[0]) for pair, text, _ in built.expected.remarks]
    assert texts == [("steel/brass", "w = 20 mJ/m2"), ("brass/brass", "w = 50 mJ/m2")]
    stronger = build(scene(*adhesive("2 J/m2")))
    assert stronger.choice.reach(1e-6) > 5.0 * built.choice.reach(1e-6)  # w^(2/3): that of the strongest pair
    # the effect's value may be left out where every pair has one; else the pairs that lack it are named: nothing is mixed
    message = report(*adhesive("20 mJ/m2", ""))
    assert "effects.adhesion: required key 'work_of_adhesion' is missing, and brass/brass of [[pairs]] give no" in message
    effects, own = adhesive("20 mJ/m2", "")
    text = scene(effects, own).to_toml()
    both = scene(effects, own).with_settings({"pairs.1.work_of_adhesion": "0 J/m2"})
    assert [row[0].adhesion for row in build(both).choice.rows][1] < 1e-25 and Scene.parse(text).pairs[0].work_of_adhesion == 0.02
    with pytest.raises(InputError, match=r"pairs\[0\].work_of_adhesion.*at least 0"):
        scene(effects, 'work_of_adhesion = "-1 J/m2"')


FAULTS = {
    "rolling_resistance = 0.05": "effects.rolling_resistance: expected a table with coefficient, damping",
    "rolling_resistance = {coefficient = 1.5}": "rolling_resistance.coefficient: 1.5 must lie between 0 and 1",
    "rolling_resistance = {damping = 0.1}": "required key 'coefficient' is missing",
    "local_damping = {coefficient = 0.95}": "local_damping.coefficient: 0.95 must lie between 0 and 0.9",
    'local_damping = {coefficient = 0.3, until = "ever"}': "local_damping.until: expected 'settled', got 'ever'",
}


@each(FAULTS)
def test_faults_are_reported(effects):
    assert FAULTS[effects] in report(effects)


def test_local_damping_may_say_when_it_ends():
    built = build(scene('local_damping = {coefficient = 0.3, until = "settled"}\ngravity = ["0 m/s2", "0 m/s2", "-9.81 m/s2"]'))
    assert built.choice.physics.effect_parameters.tolist() == [0.0, 0.0, -9.81, 0.3, built.settle]
