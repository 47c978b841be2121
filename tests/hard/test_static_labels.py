"""`balance` presses all random particles that have a static state, and labels them at the end of their path as a slow run does.

A run has inertia: a particle that snaps over may land in another seat than the one that it turns into without, so 5 % may differ.
One that `balance` stops has no static state on its way: the run must roll. A planar particle's static states are known apart from
the engine: postures of a rigid particle between rigid parallel plates in which friction can hold the spots that touch, over all
tilts on the side to which it falls (3 of 140 have one on the other side only, uphill). Clumps, in stable poses, all find one."""

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from thirdbody_three_spot.balance import balance
import thirdbody
from thirdbody.bodies.irregular_clumps import irregular
from thirdbody.bodies.resting_poses import settle_all

pytestmark = pytest.mark.full(kind="hard")
LOAD, DRAG, EVERY = 1e-4, 1.6e-6, 20e-9  # the drag is two to three windows of a clump, and more of a planar particle
ALIKE = 0.95
SOLID = {"shear_modulus": 80e9, "poisson_ratio": 0.3}
SIDES = {side: SOLID for side in ("upper", "lower", "particle")}
SLOW = {"velocity": "-0.01 m/s"}  # an inertial number of some 1e-3
SCENE = {
    "scene": 1, "materials": {"solid": SOLID | {"density": 4000.0}}, "domain": {"size": ["60 um", "60 um"]},
    "plates": {
        "lower": {"material": "solid"},
        "upper": {"material": "solid", "support": "load_per_particle", "load": LOAD, "motion": {"x": SLOW}},
    },
    "contact": {"level": "mindlin", "debris_contact": "none"}, "solver": {"integrator": "implicit", "distance": DRAG},
    "output": {"every": EVERY, "every_kind": "distance"},
}  # fmt: skip


def balls(centers, radii):
    return [{"center": tuple(map(float, c)), "radius": float(r)} for c, r in zip(centers, radii, strict=True)]


def balanced(particle, mu, level="mindlin", **path):
    tables = {"materials": SIDES, "friction": {"upper": mu, "lower": mu}, "particle": particle, "path": {"load": LOAD} | path}
    return balance(tables, level)


def labels_of_run(debris, mu, folder):
    pairs = [{"between": ["solid", "solid"], "friction": mu, "restitution": 0.6}]
    scene = thirdbody.Scene(**SCENE, pairs=pairs, debris=[{"material": "solid"} | debris])
    with thirdbody.run(scene, out=folder / "run", overwrite=True, threads=1, progress=False) as run:
        steps = np.rint(run.series["distance"] / EVERY).astype(int)
        return {int(k): run.state_names[state] for k, state in zip(steps, run.states[:, 0], strict=True)}


def alike(particle, debris, mu, folder):
    result = balanced(particle, mu, drag=DRAG, steps=4 * round(DRAG / EVERY), direction=(-1.0, 0.0))
    here, there = [point.label for point in result.points[::4]], labels_of_run(debris, mu, folder)
    if result.stopped is not None:
        assert result.stopped.label == "rolling"
        return "rolling" in [there[k] for k in there if k >= len(here) - 1]
    return here[-1] == there[len(here) - 1]


def test_planar_particles_and_clumps(tmp_path):
    different = []
    for seed in range(20):
        spots, mu = planar(seed)
        debris = {"kind": "spots", "planar": True, "spots": spots, "mass": 1e-13, "inertia": 2e-25}
        if not alike({"spots": spots}, debris, mu, tmp_path):
            different.append(seed)
    assert len(different) <= (1.0 - ALIKE) * 20, different
    different = []
    for seed in range(40):
        centers, radii, mu = clump(seed)
        placed = centers - [-30e-6, -30e-6, (centers[:, 2] - radii).min()]
        file = tmp_path / "clump.npz"
        np.savez(file, center=placed, radius=radii, clump=np.zeros(len(radii), int))
        if not alike({"clump": balls(centers, radii)}, {"kind": "file", "file": str(file)}, mu, tmp_path):
            different.append(seed)
    assert len(different) <= (1.0 - ALIKE) * 40, different


TILTS = np.linspace(-0.5, 0.5, 20_001)  # rad, up to which `balance` follows a particle


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


@pytest.mark.parametrize("level, first, last", [("exact", 0, 70), ("mdr", 0, 20)])
def test_random_planar_particles_are_pressed_where_a_static_state_exists(level, first, last):
    stopped = []
    for seed in range(first, last):
        spots, mu = planar(seed)
        result = balanced({"spots": spots}, mu, level)
        assert result.stopped is None or result.stopped.label == "rolling", seed
        if result.stopped is not None:
            stopped.append(seed)
            assert not len(static_tilts(spots, mu)), seed
        else:
            assert len(static_tilts(spots, mu)), seed
    assert 0 < len(stopped) < (last - first) // 4  # or the ensemble would show nothing


def test_random_clumps_are_pressed():
    for seed in range(40):
        centers, radii, mu = clump(seed)
        result = balanced({"clump": balls(centers, radii)}, mu)
        assert result.stopped is None, seed
        assert math.isfinite(sum(result.points[0].N)) and "sticking" in result.forecast.possible, seed


def planar(seed):
    """One to three spots above and below, heights of 2 um up to .1 um apart; and a friction."""
    draw = np.random.default_rng([21, seed])
    above, below = (int(n) for n in draw.integers(1, 4, 2))
    spots = []
    for side, count, sign in (("upper", above, 1.0), ("lower", max(below, 3 - above), -1.0)):
        for _ in range(count):
            z, x, radius = 2e-6 + draw.uniform(-1e-7, 1e-7), draw.uniform(-2e-6, 2e-6), draw.uniform(0.5e-6, 2e-6)
            spots.append({"side": side, "x": float(x), "z": float(sign * z), "radius": float(radius)})
    return spots, float(draw.uniform(0.1, 0.6))


def clump(seed):
    """Centres (n, 3) and radii (n,) of four to eight spheres, 10 um in all, in a stable pose; and a friction."""
    draw = np.random.default_rng([22, seed])
    body = irregular(draw, int(draw.integers(4, 9)), (1.0, 0.8, 0.6), 10e-6)
    (quaternion,), _ = settle_all([body], draw)
    return Rotation.from_quat(np.roll(quaternion, -1)).apply(body.centers), body.radii, float(draw.uniform(0.1, 0.6))
