"""Random particles with spots of unequal height, and random clumps: `balance` presses all that have a static state.

A planar particle's static states are known apart from the engine: those postures of a rigid particle between rigid parallel
plates in which friction can hold the spots that touch, searched over all tilts on the side to which the particle falls (3 of 140
have one on the other side only, uphill: a load does not lead there). The clumps, in stable poses on the lower body, all find one
within half a radian.
"""

from __future__ import annotations

import math

import numpy as np
import pytest
from random_particles import clump, planar
from thirdbody_three_spot.balance import balance

pytestmark = pytest.mark.full(kind="hard")

MATERIALS = {side: {"shear_modulus": 80e9, "poisson_ratio": 0.3} for side in ("upper", "lower", "particle")}
FARTHEST = 0.5  # rad, up to which `balance` follows a particle
TILTS = np.linspace(-FARTHEST, FARTHEST, 20_001)


def pressed(particle, mu, level):
    tables = {"materials": MATERIALS, "friction": {"upper": mu, "lower": mu}, "particle": particle}
    return balance(tables | {"path": {"load": 1e-4}}, level)


def static_tilts(spots, mu):
    """Tilts, rad about +y, with a static state: the resultant can pass through the spots that touch, and leans by mu at most."""
    up = np.array([s["side"] == "upper" for s in spots])
    x, z, r = (np.array([s[key] for s in spots]) for key in ("x", "z", "radius"))
    centre, cos, sin = z - np.where(up, r, -r), np.cos(TILTS)[:, None], np.sin(TILTS)[:, None]
    along, height = x * cos + centre * sin, centre * cos - x * sin + np.where(up, r, -r)
    top, foot = np.where(up, height, -np.inf).argmax(axis=1), np.where(up, np.inf, height).argmin(axis=1)
    rows = np.arange(len(TILTS))
    h = height[rows, top] - height[rows, foot]
    lean = along[rows, top] - along[rows, foot]
    t = lean / h
    # where another spot comes to touch, the resultant may lean by any value between those of the two struts
    low, high = np.minimum(t[1:], t[:-1]), np.maximum(t[1:], t[:-1])
    static = (low <= mu) & (high >= -mu)
    middle = len(TILTS) // 2
    falls = 0.0 if static[middle - 1 : middle + 1].any() else float(np.sign(t[middle]))  # the top goes on to where it leans
    return TILTS[1:][static & (falls * TILTS[1:] >= 0.0)]


@pytest.mark.parametrize("level, first, last", [("exact", 0, 140), ("mdr", 0, 40)])
def test_random_planar_particles_are_pressed_where_a_static_state_exists(level, first, last):
    stopped = []
    for seed in range(first, last):
        spots, mu = planar(seed)
        result = pressed({"spots": spots}, mu, level)
        assert result.stopped is None or result.stopped.label == "rolling", seed
        if result.stopped is not None:
            stopped.append(seed)
            assert not len(static_tilts(spots, mu)), seed
        else:
            assert len(static_tilts(spots, mu)), seed
    assert 0 < len(stopped) < (last - first) // 4  # or the ensemble would show nothing


def test_random_clumps_are_pressed():
    for seed in range(80):
        centers, radii, mu = clump(seed)
        balls = [{"center": tuple(map(float, c)), "radius": float(r)} for c, r in zip(centers, radii, strict=True)]
        result = pressed({"clump": balls}, mu, "mindlin")
        assert result.stopped is None, seed
        assert math.isfinite(sum(result.points[0].N)) and "sticking" in result.forecast.possible, seed
