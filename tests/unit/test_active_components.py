"""What `check` tells of effects and parts: on or off, why, and where one that is absent would matter."""

import math
from pathlib import Path

import pytest

from thirdbody.assembly.simulation import build
from thirdbody.report.active_components import neighbours, part_warnings, parts
from thirdbody.scene.model import Scene

SCENES = Path(__file__).parents[2] / "scenes"


def built(**settings):
    return build(Scene.load(SCENES / "three_spot.toml").with_settings({k.replace("__", "."): x for k, x in settings.items()}))


def report(simulation) -> dict[str, dict]:
    return {row["part"]: row for row in parts(simulation)}


def test_every_installed_effect_is_on_or_off_with_a_reason():
    rows = report(built(effects__rolling_resistance="{coefficient = 0.01}", solver__integrator="explicit"))
    assert rows["rolling: rolling_resistance"]["on"] and "effect: rolling_resistance" not in rows
    assert not rows["effect: damping"]["on"]
    assert all(row["reason"] for row in rows.values())
    # weight of 1e-13 kg over .1 mN
    assert rows["effect: gravity"]["reason"].startswith("weight/load = 1e-08")
    assert rows["debris-debris contact"]["on"] is False


def test_a_sound_scene_has_no_warning():
    assert part_warnings(built()) == []


def test_weight_is_warned_of_until_gravity_is_on():
    heavy = {"debris__0__mass": "1e-7 kg", "plates__upper__load": "0.01 mN"}
    assert any("gravity is off" in line and "0.098" in line for line in part_warnings(built(**heavy)))
    on = {"effects__gravity": '["0 m/s2", "0 m/s2", "-9.81 m/s2"]'}
    assert not any("gravity" in line for line in part_warnings(built(**heavy, **on)))


def test_a_drag_near_the_wave_speed_is_warned_of():
    # sqrt(60 GPa/7800 kg/m3) = 2774 m/s is the slowest
    def is_warned_of(speed):
        return any("slowest shear wave" in line for line in part_warnings(built(plates__upper__motion__x__velocity=speed)))

    assert is_warned_of("300 m/s") and not is_warned_of("200 m/s")


def test_spots_that_stand_close_are_warned_of():
    simulation = built(debris__0__spots__1__x="-0.1 um", debris__0__spots__2__x="0.3 um")
    share, distance = neighbours(simulation)
    radius = 1.5e-6 * math.sqrt(simulation.upper.overlap)  # of the larger contact, a^2 = R d
    assert distance == pytest.approx(0.4e-6 / radius, rel=1e-6)
    assert share == pytest.approx(4.0 * radius / (3.0 * math.pi * 0.4e-6), rel=1e-6)
    assert any("spots of a body stand as near as 5.1" in line for line in part_warnings(simulation))
