"""Quantities with units: exact scaling, agreement with pint, and messages that say what was meant."""

import math
from functools import cache

import pint
import pytest
from each import each
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from thirdbody import units

# pattern with a place for the prefix, the same for pint, our dimension
PATTERNS = [
    ("{}m", "{}m", "length"), ("{}m2", "{}m**2", "area"), ("{}m^3", "{}m**3", "volume"), ("{}s", "{}s", "time"),
    ("{}g", "{}g", "mass"), ("{}m/s", "{}m/s", "velocity"), ("m/{}s**2", "m/{}s**2", "acceleration"), ("{}N", "{}N", "force"),
    ("kg {}m/s2", "kg*{}m/s**2", "force"), ("{}Pa", "{}Pa", "pressure"), ("g/{}m3", "g/{}m**3", "density"),
    ("N/{}m", "N/{}m", "stiffness"), ("{}J/m2", "{}J/m**2", "energy_per_area"), ("{}N*s/m", "{}N*s/m", "damping"),
    ("kg/{}s", "kg/{}s", "damping"), ("{}J", "{}J", "energy"), ("{}W", "{}W", "power"), ("{}Pa s", "{}Pa*s", "viscosity"),
    ("kg {}m2", "kg*{}m**2", "inertia"), ("1/{}s", "1/{}s", "rate"), ("{}Hz", "{}Hz", "frequency"),
    ("{}rad/s", "{}rad/s", "angular_velocity"), ("deg/{}s", "deg/{}s", "angular_velocity"), ("{}rad", "{}rad", "angle"),
]  # fmt: skip
PLAIN = [
    ("rpm", "rpm", "angular_velocity"), ("deg", "deg", "angle"), ("°", "deg", "angle"), ("h", "h", "time"),
    ("min", "min", "time"), ("mm/h", "mm/h", "velocity"), ("angstrom", "angstrom", "length"), ("mbar", "mbar", "pressure"),
    ("%", "percent", "dimensionless"),
]  # fmt: skip
registry = cache(pint.UnitRegistry)


def pint_value(number, unit):
    return float(registry().Quantity(number, unit).to_base_units().magnitude)


@each(PATTERNS)
def test_agrees_with_pint_for_every_prefix(row):
    ours, theirs, dimension = row
    for prefix in ("", "f", "p", "n", "u", "µ", "μ", "m", "c", "d", "h", "k", "M", "G", "T"):
        expected = pint_value(2.5, theirs.format("u" if prefix in "µμ" and prefix else prefix))
        # pint multiplies a few floats: some units in the last place, 2.2e-16 each
        assert units.parse(f"2.5 {ours.format(prefix)}", dimension) == pytest.approx(expected, rel=3e-15, abs=0)


@each(PLAIN)
def test_agrees_with_pint_without_prefix(row):
    assert units.parse(f"7 {row[0]}", row[2]) == pytest.approx(pint_value(7, row[1]), rel=3e-15, abs=0)


@given(st.floats(min_value=1e-12, max_value=1e12), st.sampled_from([("um", "e-6"), ("nm", "e-9"), ("fm", "e-15")]))
def test_scaling_by_a_power_of_ten_is_exact(value, scale):
    assume("e" not in repr(value))
    assert units.parse(f"{value!r} {scale[0]}", "length") == float(f"{value!r}{scale[1]}")


def test_micrometres_are_the_nearest_float_in_any_spelling():
    assert units.parse("60 um", "length") == 60e-6
    assert units.parse("7.85 g/cm3", "density") == 7850.0
    assert units.parse("60 rpm", "angular_velocity") == 2.0 * math.pi
    assert units.parse("180 deg", "angle") == math.pi
    for text in ("5 um", "5um", " 5  um ", "5. um", "+5 um", "0.5e1 um", "5 µm", "5 μm", "5 m/s*us", "5e-6 m", "5 m2/Mm"):
        assert units.parse(text, "length") == 5e-6, text
    for text in ("1 m/s2", "1 m/s^2", "1 m/s**2", "1 m/s/s", "1 m s-2", "1 m s⁻²", "1 N/kg"):
        assert units.parse(text, "acceleration") == 1.0, text
    # either of two dimensions
    assert units.parse_any("2 um", ("length", "time")) == (2e-6, "length")
    assert units.parse_any("2 us", ("length", "time")) == (2e-6, "time")
    with pytest.raises(ValueError, match="'1 N' is a force, expected a length or a time"):
        units.parse_any("1 N", ("length", "time"))


MESSAGES = [
    ("60 MPa", "length", "'60 MPa' is a pressure, expected a length"),
    ("0.1", "length", "0.1 has no unit, expected a unit of length (pm, nm, um, mm, m, angstrom)"),
    ("90", "angle", "90 has no unit, expected a unit of angle (rad, deg)"),
    ("20 mu", "length", "unknown unit 'mu', did you mean 'um'?"),
    ("20 mpa", "pressure", "unknown unit 'mpa', did you mean 'MPa'?"),
    ("5 xyz", "acceleration", "unknown unit 'xyz', known: m/s2"),
    ("10 Hz", "angular_velocity", "'10 Hz' is a frequency, expected an angular velocity"),
    ("5 N m", "stiffness", "'5 N m' is an energy or a torque, expected a stiffness"),
    ("5 um", "dimensionless", "'5 um' is a length, expected a pure number"),
    ("nan m", "length", "cannot read 'nan m' as a length: write for example \"10 um\""),
    ("", "time", "cannot read '' as a time: write for example \"10 ms\""),
    ("0,1 um", "length", "cannot read '0,1 um': the decimal sign is a point, and thousands are not separated"),
    ("1 kg/m s", "viscosity", "the unit 'kg/m s' can be read in two ways: write / before each unit to divide by"),
    ("1 m/", "length", "cannot read the unit 'm/'"), ("1e999 m", "length", "'1e999 m' is outside the range of numbers"),
    ("1e-330 m", "length", "'1e-330 m' is outside the range of numbers"),
]  # fmt: skip


@each(MESSAGES, name_of=lambda row: row[2])
def test_messages(row):
    with pytest.raises(ValueError) as caught:
        units.parse(row[0], row[1])
    assert str(caught.value) == row[2]


@settings(max_examples=50)
@given(st.text(max_size=30))
def test_any_text_gives_a_value_or_a_ValueError(text):
    try:
        assert math.isfinite(units.parse(text, "length"))
    except ValueError as error:
        assert str(error)  # anything else than a ValueError fails the test


@given(st.floats(allow_nan=False, allow_infinity=False), st.sampled_from(sorted(units.DIMENSIONS)))
def test_format_si_gives_back_the_same_bits(value, dimension):
    again = units.parse(units.format_si(value, dimension), dimension)
    assert again == value and math.copysign(1.0, again) == math.copysign(1.0, value)


def test_texts_are_readable_and_every_dimension_has_a_unit_of_factor_one_and_a_true_ladder():
    for value, dimension, text in (
        (60e-6, "length", "60 um"), (210e9, "pressure", "210 GPa"), (7850.0, "density", "7850 kg/m3"), (0.0, "velocity", "0 m/s"),
    ):  # fmt: skip
        assert units.format_si(value, dimension) == text
    with pytest.raises(ValueError, match="nan cannot be written as a length"):
        units.format_si(math.nan, "length")
    for value, dimension, text in (
        (1.2345e-8, "length", "12.3 nm"), (9.996e-7, "length", "1 um"),  # rounding may change the prefix
        (-4.56e-5, "force", "-45.6 uN"), (0.0, "time", "0 s"), (3.0, "dimensionless", "3"), (math.inf, "pressure", "inf Pa"),
    ):  # fmt: skip
        assert units.pretty(value, dimension) == text
    for name, entry in units.DIMENSIONS.items():
        assert units.parse(f"1 {entry.si_unit}", name) == 1.0
        for unit, power in entry.ladder:
            assert units.parse(f"1 {unit}", name) == float(f"1e{power}")
        assert name == "dimensionless" or units.parse(f"1 {entry.usual}", name) > 0.0


def test_a_unit_of_length_has_a_name_or_a_size():
    assert units.parse_unit("um") == units.parse_unit(" 1 um") == 1e-6 and units.parse_unit(".5 um") == 5e-7
    for text, message in {
        "kg": "is a mass, expected a length",
        "1": "has no unit",
        "": "cannot read",
        "mu": "did you mean 'um'",
    }.items():
        with pytest.raises(ValueError, match=message):
            units.parse_unit(text)
