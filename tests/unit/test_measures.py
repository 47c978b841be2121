"""Measures: what they declare, how they are collected and deposited, and the kernels of wear and heat against closed forms."""

import math
from collections import namedtuple

import numpy as np
import pytest
from balls import BALLS, edited
from steel import HOT_STEEL
from steel import STEEL as STEEL_TEXT

from thirdbody.assembly.physics import law_faults
from thirdbody.kernels.measures import AMOUNTS, deposit
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


def test_flash_temperature_of_a_steel_spot_and_its_warning():
    """Section 16: 1.2 K for a steel sphere of 10 um at 1 m/s and 0.5 mN, friction 0.3; told to two digits there.

    Contact radius of Hertz: a^3 = 3 F R/(4 E*), E* of steel on steel 210 GPa/(2 (1 - 0.09)).
    """
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


def test_wear_by_both_laws_and_its_units():
    step = contact(load=2e-3, slip=3e-9, friction_work=1.1e-12)
    assert kernel("wear", step, plates=5e-15, bodies=7e-15) == pytest.approx((7e-15 * 6e-12, 5e-15 * 6e-12, 1.1e-12), rel=1e-14)
    by_energy = kernel("wear", step, plates=5e-15, bodies=7e-15, law="energy")
    assert by_energy == pytest.approx((7e-15 * 1.1e-12, 5e-15 * 1.1e-12, 1.1e-12), rel=1e-14)
    for text in ("1e-15 m3/J", "1e-15 1/Pa", "1e-6 mm3/N/m"):
        assert parse(text, "wear_coefficient") == pytest.approx(1e-15, rel=1e-14)
    with pytest.raises(ValueError, match="is a pressure"):
        parse("1 Pa", "wear_coefficient")


def test_where_numbers_are_kept():
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


def test_amounts_that_make_no_sense_are_refused_and_others_have_a_line_each():
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


def test_deposits_add_up_and_wrap():
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


def test_small_contacts_lie_in_the_cell_of_their_centre_and_large_ones_are_spread_like_hertz_pressure():
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
