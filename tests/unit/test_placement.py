"""Random layers without overlap, overlaps of given starts and `initial_overlap = "relax"`, against all pairs and images."""

import itertools
import json
import re
from contextlib import nullcontext

import numpy as np
import pytest
from steel import STEEL
from trajectories import contents
import thirdbody
from thirdbody.assembly import initial_relaxation
from thirdbody.assembly.initial_relaxation import UNLOADED_OVERLAP
from thirdbody.assembly.placement import spheres_of
from thirdbody.assembly.populate import populate
from thirdbody.assembly.simulation import build
from thirdbody.bodies.clump import clump
from thirdbody.bodies.irregular_clumps import population
from thirdbody.bodies.overlap_removal import pack
from thirdbody.bodies.packing import overlaps, place_layer, projected_area
from thirdbody.bodies.resting_poses import settle_all
from thirdbody.errors import InputError, Interrupted
from thirdbody.rotations import matrix_from_quaternion

COUNT, UM, SIZE = 30, 1e-6, (50e-6, 50e-6)
UPRIGHT = np.array([1.0, 0.0, 0.0, 0.0])


def gaps(S, ids, size, periodic):
    """Least gaps (n, n) between spheres (x, y, z, radius) and all images of others; between those of a body infinite."""
    least = np.full((len(S), len(S)), np.inf)
    for a, b in itertools.product((0, 1, -1), repeat=2) if periodic else [(0, 0)]:
        image = S[:, :3] + (a * size[0], b * size[1], 0.0)
        least = np.minimum(least, np.linalg.norm(S[:, None, :3] - image, axis=2) - S[:, None, 3] - S[:, 3])
    return np.where(ids[:, None] == ids, np.inf, least)


@pytest.fixture(scope="module")
def bodies():
    size = {"distribution": "lognormal", "median": 1e-5, "sigma": 0.3, "min": 4e-6, "max": 3e-5}
    clumps = population(1, 0, COUNT, (3, 5), [1.0, 0.8, 0.6], **size)
    return clumps, settle_all(clumps, np.random.default_rng(2))[0]


def world(clumps, quaternions, xy):
    rows, ids = [], []
    for k, (body, quaternion) in enumerate(zip(clumps, quaternions, strict=True)):
        centers = body.centers @ matrix_from_quaternion(quaternion).T
        centers[:, 2] -= (centers[:, 2] - body.radii).min()
        centers[:, :2] += xy[k]
        rows.append(np.column_stack((centers, body.radii)))
        ids += [k] * len(body.radii)
    return np.vstack(rows), np.array(ids)


def domain(clumps, quaternions, fraction):
    spheres, ids = world(clumps, quaternions, np.zeros((len(clumps), 2)))
    side = np.sqrt(sum(projected_area(spheres[ids == k]) for k in range(len(clumps))) / fraction)
    return 1.25 * side, side / 1.25


@pytest.mark.parametrize("periodic", [True, False])
def test_layer_keeps_clear(bodies, periodic):
    size = domain(*bodies, 0.4)
    xy = place_layer(*bodies, size, periodic, np.random.default_rng(3))
    assert xy.shape == (COUNT, 2) and (xy >= 0.0).all() and (xy < size).all()
    S, ids = world(*bodies, xy)
    # the clearance promised, to rounding
    assert (gaps(S, ids, size, periodic) / (S[:, None, 3] + S[:, 3])).min() >= 1e-3 * (1.0 - 1e-9)
    if not periodic:
        # lopsided ones that hardly fit
        lopsided = clump([[4.5e-6, 0.0, 0.0], [0.0, 0.0, 0.0]], [1e-6, 4e-6])
        for seed in range(10):
            place = place_layer([lopsided], UPRIGHT[None], (12e-6, 12e-6), False, np.random.default_rng(seed))
            spheres, _ = world([lopsided], UPRIGHT[None], place)
            assert (spheres[:, :2] > spheres[:, 3:]).all() and (spheres[:, :2] + spheres[:, 3:] < 12e-6).all()
        assert (S[:, :2] - S[:, 3:] > 0.0).all() and (S[:, :2] + S[:, 3:] < size).all()
    assert overlaps(S[:, :3], S[:, 3], ids, size, periodic) == []
    same, other = (place_layer(*bodies, size, periodic, np.random.default_rng(seed)) for seed in (3, 2))
    assert np.array_equal(xy, same) and not np.array_equal(xy, other)


def test_what_does_not_fit_is_refused():
    # random addition of discs jams at a fraction of 0.547 (Feder 1980): 0.7 is out of reach
    balls, side = [clump([[0, 0, 0]], [0.5])] * 40, np.sqrt(40 * np.pi * 0.25 / 0.7)
    with pytest.raises(InputError, match="domain.size") as caught:
        place_layer(balls, np.tile(UPRIGHT, (40, 1)), (side, side), True, np.random.default_rng(0))
    text = str(caught.value)
    placed, reached = re.search(r"(\d+) of 40 bodies placed, area fraction ([0-9.]+) reached", text).groups()
    assert 20 <= int(placed) < 40 and "count" in text
    assert float(reached) == pytest.approx(int(placed) / 40 * 0.7, abs=6e-4)  # printed with three digits
    with pytest.raises(InputError, match="does not fit"):
        place_layer([clump([[0, 0, 0]], [1.0])], UPRIGHT[None], (5.0, 1.9), True, np.random.default_rng(0))
    assert place_layer([], np.zeros((0, 4)), (1.0, 1.0), True, np.random.default_rng(0)).shape == (0, 2)


@pytest.mark.parametrize("periodic", [True, False])
def test_overlaps_of_a_random_start(periodic):
    for size in ((3.0, 2.5), (20.0, 15.0)):
        rng = np.random.default_rng(6)
        # positions outside the domain count by their images when periodic
        centers = rng.uniform(-0.5, 1.5, (60, 3)) * (*size, 2.0)
        radii, ids = rng.uniform(0.1, 0.6, 60), rng.integers(0, 20, 60)
        folded = centers - np.floor(centers / (*size, np.inf)) * (*size, 0.0) if periodic else centers
        found = overlaps(centers, radii, ids, size, periodic)
        gap, expected = gaps(np.column_stack((folded, radii)), ids, size, periodic), {}
        for i, j in zip(*np.nonzero(gap < 0.0), strict=True):
            pair = (ids[i], ids[j])
            expected[pair] = max(expected.get(pair, 0.0), -gap[i, j])
        assert {row[:2] for row in found} == {pair for pair in expected if pair[0] < pair[1]}
        for a, b, overlap in found:
            assert overlap == pytest.approx(expected[a, b], rel=1e-9, abs=1e-12)  # rounding of the images
        assert [row[2] for row in found] == sorted((row[2] for row in found), reverse=True)


def test_all_overlaps_are_reported_but_touching_is_none_and_one_body_has_none():
    n = 60  # 1770 pairs, more than the first table holds
    found = overlaps(np.zeros((n, 3)), np.ones(n), np.arange(n), (9.0, 9.0), False)
    assert len(found) == n * (n - 1) // 2 and all(row[2] == 2.0 for row in found)
    touching = np.array([[0.0, 0, 0], [2.0, 0, 0]])
    assert overlaps(touching, np.ones(2), np.array([0, 1]), (9.0, 9.0), True) == []
    assert overlaps(0.5 * touching, np.ones(2), np.array([0, 0]), (9.0, 9.0), True) == []
    assert overlaps(np.zeros((0, 3)), np.zeros(0), np.zeros(0), (9.0, 9.0), True) == []


TEXT = """[[debris]]\nmaterial = "steel"\nkind = "file"\nfile = "packing.npz"
[domain]\nsize = ["50 um", "50 um"]\nperiodic = {periodic}
[plates.lower]\nmaterial = "steel"
[plates.upper]\nmaterial = "steel"\n{plate}\nmotion = {{x = {{velocity = "1 m/s"}}}}
[solver]\ndistance = "0.4 um"\nsettle = "2 us"\ninitial_overlap = "relax"
[output]\nevery = "0.1 um"\n"""
PRESSED, GAP = 'pressure = "20 MPa"', 'gap = "{gap} um"'
BALL = {"radius": np.full(2, 5e-6), "clump": np.arange(2)}


def packing(seed, count=40, clumps=True, overlap=0.3):
    """A bed of balls and clumps on 50 um, enlarged: balls that touched overlap by this part of their radius."""
    rng = np.random.default_rng(seed)
    size = {"distribution": "lognormal", "median": 1e-5, "sigma": 0.2, "min": 6e-6, "max": 16e-6}
    balls = [clump([[0, 0, 0]], [r * UM]) for r in rng.uniform(3.5, 6.5, count)]
    bodies = balls[: count // 2] + population(seed, 0, count - count // 2, (3, 6), (1.0, 0.8, 0.6), **size) if clumps else balls
    low = sum(body.volume for body in bodies) / (SIZE[0] ** 2 * 2.0 * max(body.diameter for body in bodies))
    bed = pack(bodies, min(0.45, low), SIZE, True, rng)
    grown = [body.scaled(1.0 / (1.0 - 0.5 * overlap)) for body in bodies]
    centres, radii, body = spheres_of(grown, bed.positions, bed.quaternions)
    return {"center": centres, "radius": radii, "clump": body}


def prepared(folder, table, plate=PRESSED, periodic=True):
    np.savez(folder / "packing.npz", **table)
    (folder / "scene.toml").write_text(STEEL + TEXT.format(plate=plate, periodic=str(periodic).lower()))
    return thirdbody.Scene.load(folder / "scene.toml")


def built(folder, table, *settings):
    return build(prepared(folder, table, *settings))


def deepest(state, periodic=True):
    """Deepest overlap of all spheres with each other and with the floor, over the smaller radius."""
    S = np.column_stack((state.spheres.position, state.spheres.radius))
    between = gaps(S, state.body, SIZE, periodic) / np.minimum(S[:, None, 3], S[:, 3])
    return max(-between.min(), ((S[:, 3] - S[:, 2]) / S[:, 3]).max())


@pytest.mark.parametrize("axis", [0, 1])
def test_a_body_longer_than_the_period_is_refused_wherever_it_comes_from(tmp_path, axis):
    """It would meet its own image. Given positions by a table and by the scene, and thrown into a volume."""
    line = np.zeros((11, 3))
    line[:, axis], line[:, 2] = np.arange(11) * 4.6, 5.0  # 46 um and two radii, of 2.5 um
    table = {"center": (line + (1.0, 1.0, 0.0)) * UM, "radius": np.full(11, 2.5 * UM), "clump": np.zeros(11, int)}
    with pytest.raises(InputError, match=rf"debris\[0\].file: body 0 is 51 um long in {'xy'[axis]}, .* own image.* of 50 um"):
        populate(prepared(tmp_path, table), [])
    assert len(populate(prepared(tmp_path, table, PRESSED, False), []).clumps) == 1
    shape = [{"center": row.tolist(), "radius": 2.5 * UM} for row in line * UM]
    for more in ({"positions": [[0.0, 0.0, 10 * UM]]}, {"count": 2, "placement": "dilute", "height": 2e-3}):
        debris = {"kind": "spheres", "material": "steel", "shape": shape, **more}
        scene = prepared(tmp_path, table).document() | {"debris": [debris]}
        with pytest.raises(InputError, match=r"body 0 .*(own image|does not fit)"):
            populate(thirdbody.Scene.of(scene), [])


def test_bodies_may_fill_the_period_and_a_raft_closes_but_no_diagonal_or_block(tmp_path):
    """A row of balls from 0 to 45 um and one beside it that protrudes to 49.99 um: 2.51 um from the image of the first in x."""
    line = np.column_stack((np.append(np.arange(10) * 5.0, 47.49), np.append(np.full(10, 1.0), 5.325), np.full(11, 2.5)))
    table = {"center": line * UM, "radius": np.full(11, 2.5 * UM), "clump": np.zeros(11, int)}
    assert len(populate(prepared(tmp_path, table), []).clumps) == 1
    x, y = (axis.ravel() * 10.0 for axis in np.meshgrid(np.arange(5), np.arange(5)))
    sheet = np.column_stack((x, y, np.full(25, 5.2)))
    diagonal = np.column_stack((np.arange(9) * 6.0, np.arange(9) * 6.0, np.full(9, 5.2)))
    block = np.concatenate([sheet + (0.0, 0.0, 10.0 * k) for k in range(4)])
    for centres, accepted in ((sheet, True), (diagonal, False), (block, False)):
        n = len(centres)
        table = {"center": centres * UM, "radius": np.full(n, 5.2 * UM), "clump": np.zeros(n, int)}
        with nullcontext() if accepted else pytest.raises(InputError, match="own image"):
            assert len(populate(prepared(tmp_path, table), []).clumps) == 1


def test_a_bed_with_overlaps_of_a_third_is_relaxed_and_runs_on(tmp_path, command):
    table = packing(1, clumps=False)
    prepared(tmp_path, table)
    said = command("run", "scene.toml", "-o", "run", "--json")
    assert said.code == 0 and "bodies were pushed apart, by" in said.err
    report = json.loads(said.out)
    change = report["initial_overlap"]
    assert change["pairs_before"] > 80 and change["overlap_before"] > 0.3 and change["overlap_after"] == 0.0
    assert change["bodies_moved"] == 40 and UNLOADED_OVERLAP < change["expected_overlap"] < 0.1
    assert 0.0 < change["mean_displacement"] < change["largest_displacement"] < 6.0  # the bed grows by some 60 %
    # energy of the overlaps by Hertz [J]: 8/15 E* sqrt(R) d^2.5
    r = table["radius"]
    depth = np.maximum(-gaps(np.column_stack((table["center"], r)), np.arange(len(r)), SIZE, True), 0.0)
    curvature = np.sqrt(r[:, None] * r / (r[:, None] + r))
    stored = 0.5 * float(np.sum(8.0 / 15.0 * 210e9 / (2.0 * (1.0 - 0.3**2)) * curvature * depth**2.5))
    with thirdbody.open(tmp_path / "run") as run:
        energy, work = run.series["energy_kinetic"], run.series["energy_plate_work"]
        assert energy[0] == 0.0 and run.series["energy_elastic_normal"][0] == 0.0
        assert 0.0 < energy.max() <= work.max() < 1e-2 * stored
    # truncation of the explicit steps, of the order of the other beds
    assert abs(report["energy_residual"]) < 1e-3 and report["finished"]


def test_the_same_start_every_time_and_after_an_interruption(tmp_path):
    scene = prepared(tmp_path, packing(2, 10))
    whole = thirdbody.run(scene, tmp_path / "whole", progress=False, threads=1)

    def interrupt(progress):
        if progress.frame > 2:
            raise KeyboardInterrupt

    with pytest.raises((Interrupted, KeyboardInterrupt)):
        thirdbody.run(scene, tmp_path / "cut", progress=interrupt, threads=2)
    again = thirdbody.resume(tmp_path / "cut", progress=False)
    assert again.summary()["initial_overlap"] == whole.summary()["initial_overlap"]
    assert contents(tmp_path / "cut") == contents(tmp_path / "whole")


@pytest.mark.parametrize("seed", [0, 1, *(pytest.param(seed, marks=pytest.mark.full(kind="slow")) for seed in range(2, 100))])
def test_random_packings(seed, tmp_path):
    rng, periodic = np.random.default_rng(seed), bool(seed % 3)
    table = packing(seed, int(rng.integers(10, 60)), bool(seed % 2), float(rng.uniform(0.05, 0.6)))
    simulation = built(tmp_path, table, PRESSED, periodic)
    state, start = simulation.state, simulation.relaxed
    assert deepest(state, periodic) <= 0.0
    assert start.overlap_after == 0.0 < start.overlap_before
    simulation.integrator.advance_to(time=100.0 * state.dt)
    kinetic = 0.5 * float(np.sum(state.bodies.mass * np.sum(state.bodies.velocity**2, axis=1)))
    # nothing but the falling plate can have set anything in motion
    upper = state.world.upper
    assert kinetic <= float(upper.load[0]) * (upper.heights[0] - state.patches.height[0]) * 1.01 + 1e-30


def test_the_plate_at_a_gap_is_a_wall_and_a_row_in_balance_is_relaxed(tmp_path):
    table = packing(3, 25, overlap=0.1)
    gap = 1.1 * float((table["center"][:, 2] + table["radius"]).max())
    state = built(tmp_path, table, GAP.format(gap=gap / UM)).state  # in um, to the last digit that the scene holds
    assert float((state.spheres.position[:, 2] + state.spheres.radius).max()) <= gap and deepest(state) <= 0.0
    # balls in a straight periodic row, too long for the domain: their forces cancel, so they are kicked out of it
    centres = np.column_stack((np.arange(8) * 50e-6 / 8, np.full(8, 25e-6), np.full(8, 20e-6)))
    assert deepest(built(tmp_path, {"center": centres, "radius": np.full(8, 4e-6), "clump": np.arange(8)}).state) <= 0.0


def test_bodies_without_overlap_keep_their_bits(tmp_path, command):
    table = packing(4, 20, clumps=False, overlap=0.0)
    lowest = int(np.argmin(table["center"][:, 2]))
    table["center"][lowest, 2] -= 0.5 * table["radius"][lowest]  # into the floor; a gap is left above
    pressed = built(tmp_path, table)
    order = pressed.state.order
    moved = np.linalg.norm(pressed.state.bodies.position - table["center"][order], axis=1) / table["radius"][order]
    assert pressed.relaxed.bodies_moved == np.count_nonzero(moved) < 6
    assert pressed.relaxed.largest_displacement == pytest.approx(moved.max(), rel=1e-12)  # over the radius
    sound = built(tmp_path, packing(4, 20, overlap=0.0))
    assert sound.relaxed.bodies_moved == sound.relaxed.pairs_before == 0
    assert any("nothing overlaps" in warning for warning in sound.warnings)
    prepared(tmp_path, packing(6, 12, clumps=False))
    report = command("check", "scene.toml")
    assert report.code == 0 and 'initial_overlap = "relax": 7 of 12 bodies were pushed apart' in report.out


def test_overlaps_below_the_expected_ones_stay(tmp_path):
    # contacts of a bed that was under this load elsewhere are kept
    r = 5e-6
    start = built(tmp_path, BALL | {"center": np.array([[5 * r, 5 * r, r], [5 * r, 5 * r, 3.0 * r * (1.0 - 1e-5)]])}).relaxed
    assert start.bodies_moved == 0 and start.pairs_after == 1 and start.overlap_after == pytest.approx(3e-5, rel=1e-6)
    # Hertz: force p d^2 between equal spheres of radius r: overlap = (9 F^2/(16 E*^2 r/2))^(1/3)
    force, e_star = 20e6 * (2.0 * r) ** 2, 210e9 / (2.0 * (1.0 - 0.3**2))
    assert start.expected_overlap == pytest.approx((9.0 * force**2 / (16.0 * e_star**2 * 0.5 * r)) ** (1.0 / 3.0) / r, rel=1e-6)


def test_what_cannot_be_relaxed_is_refused(tmp_path, command, monkeypatch):
    # two links of a chain, thicker than the hole of the other
    turn = np.arange(12) * np.pi / 6
    ring = np.column_stack((np.cos(turn), np.sin(turn), np.zeros(12))) * 1.6
    centres = (np.vstack((ring, ring[:, [0, 2, 1]] + (1.6, 0.0, 0.0))) * 4.0 + (20.0, 25.0, 12.0)) * UM
    links = {"center": centres, "radius": np.full(24, 4.0 * UM), "clump": np.repeat([0, 1], 12)}
    for table, plate, words in (
        (packing(5, 40, clumps=False), GAP.format(gap=15), ["too little room", "up to the plate", "bodies"]),
        (BALL | {"center": np.full((2, 3), 25e-6)}, PRESSED, ["bodies 0 and 1 have the same centre", "given twice"]),
        (links, PRESSED, ["bodies 0 and 1 still overlap", "interlocked"]),
    ):
        prepared(tmp_path, table, plate)
        report = command("run", "scene.toml", "-o", "run")
        assert report.code == 3 and not (tmp_path / "run").exists()
        for word in ["debris[0].file", *words]:
            assert word in report.err
    monkeypatch.setattr(initial_relaxation, "_LIMIT", 5)
    with pytest.raises(InputError, match="the limit of 5 steps is reached"):
        built(tmp_path, packing(1))


def test_an_ensemble_is_moved_out_of_the_floor_only(tmp_path):
    # bodies that do not see each other keep x and y; the patches come to rest on them
    table = BALL | {"center": np.array([[20e-6, 20e-6, 3e-6], [24e-6, 20e-6, 9e-6]])}
    scene = prepared(tmp_path, table, 'support = "load_per_particle"\nload = "0.1 mN"')
    alone = scene.with_settings({"contact.debris_contact": "none", "solver.integrator": "explicit"})
    position = build(alone).state.bodies.position
    assert np.array_equal(position[:, :2], table["center"][:, :2]) and position[1, 2] == table["center"][1, 2]
    # out of the floor, and beyond by one step of the relaxation at most: a tenth of the radius
    assert 5e-6 < position[0, 2] <= 5.5e-6
