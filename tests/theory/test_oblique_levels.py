"""Chung and Ooi's test 4 (a ball of aluminium oxide at 3.9 m/s on a rigid plane) from 5 to 85 degrees at every level.

Printed with `pytest -s -m ''` it is the table in plugins/three_spot/README.md.
"""

import functools
import math

import closed_forms
import pytest
from slow import slow
from thirdbody_three_spot import THREE_SPOT, theory

from thirdbody.scene.model import Contact

SPEED, FRICTION, RESTITUTION, RADIUS = 3.9, 0.092, 0.98, 2.5e-3
ANGLES = range(5, 86, 10)
LEVELS = sorted(THREE_SPOT.levels)
levels = pytest.mark.parametrize("level", [slow("exact") if level == "exact" else level for level in LEVELS])


def rebound(make, degrees: float, level: str) -> tuple[float, float, float]:
    """v_t'/v_t of the centre, spin over that of a grazing slip (SPEED/RADIUS), rebound angle of the contact point in degrees."""
    angle = math.radians(degrees)
    material = make.solid(380e9, 0.23, 4000.0)
    normal, along = SPEED * math.cos(angle), SPEED * math.sin(angle)
    e = theory.e_star(material.shear(), material.poisson_ratio, math.inf, 0.0)
    duration = closed_forms.impact_duration(make.ball_mass(material, RADIUS), RADIUS, e, normal)
    simulation = make.ball_on_plane(
        material, RADIUS, (along, 0.0, -normal), friction=FRICTION, restitution=RESTITUTION, time_step=duration / 400.0,
        contact=Contact(law="three_spot", level=level),
    )  # fmt: skip
    make.leave(simulation, duration)
    v, spin = make.velocity(simulation), make.spin(simulation)[1]
    return v[0] / along, spin * RADIUS / SPEED, math.degrees(math.atan2(v[0] - RADIUS * spin, v[2]))


@functools.cache
def rows_of(make, level):
    return [rebound(make, degrees, level) for degrees in ANGLES]


@levels
def test_steep_impacts_slip_throughout_at_every_level(make, level):
    """Gross slip from about 31 degrees on: the impulse of friction is mu times the normal one, whatever the law."""
    for (ratio, spin, _), degrees in zip(rows_of(make, level), ANGLES, strict=True):
        if degrees >= (55 if level == "coulomb" else 45):
            angle = math.radians(degrees)
            # restitution to 3e-3, and the overlap of 1e-2 R shortens friction's arm by half of that
            assert 1.0 - ratio == pytest.approx(1.0 - closed_forms.gross_slip_speed_ratio(FRICTION, RESTITUTION, angle), rel=3e-3)
            report = closed_forms.gross_slip_spin(FRICTION, RESTITUTION, angle, SPEED, RADIUS) * RADIUS / SPEED
            assert spin == pytest.approx(-report, rel=9e-3)  # that of the theory counts against the drag


@levels
def test_shallow_impacts_come_back(make, level):
    """Near the normal the tangential spring throws the contact point back: its rebound is reversed."""
    assert min(angle for _, _, angle in rows_of(make, level)) < 0.0
    assert all(ratio < 1.0 for ratio, _, _ in rows_of(make, level))


@pytest.mark.full(kind="slow")
def test_springs_follow_the_finest_level(make):
    for k, degrees in enumerate(ANGLES):
        cells = " | ".join("{:.3f} {:.4f} {:+.1f}".format(*rows_of(make, level)[k]) for level in LEVELS)
        print(f"| {degrees} | {cells} |")
    for coarse, fine in zip(rows_of(make, "mdr"), rows_of(make, "exact"), strict=True):
        # 32 springs: 1e-3 of the friction limit, which is a third of the speeds here at most
        assert coarse[0] == pytest.approx(fine[0], abs=2e-3)
