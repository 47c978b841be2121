"""`initial_overlap = "relax"`: overlaps are gone, against all pairs with all images; what it says and refuses; the run after."""

import itertools
import json

import numpy as np
import pytest
from steel import STEEL
from trajectories import contents

import thirdbody
from thirdbody.assembly import initial_relaxation
from thirdbody.assembly.initial_relaxation import UNLOADED_OVERLAP
from thirdbody.assembly.placement import spheres_of
from thirdbody.assembly.simulation import build
from thirdbody.bodies.clump import clump
from thirdbody.bodies.dense_packing import pack
from thirdbody.bodies.irregular_clumps import population
from thirdbody.errors import InputError, Interrupted
from thirdbody.laws.registry import discover
from thirdbody.scene.model import Scene

UM = 1e-6
TEXT = """[[debris]]\nmaterial = "steel"\nkind = "file"\nfile = "packing.npz"
[domain]\nsize = ["50 um", "50 um"]\nperiodic = {periodic}
[plates.lower]\nmaterial = "steel"
[plates.upper]\nmaterial = "steel"\n{plate}\nmotion = {{x = {{velocity = "1 m/s"}}}}
[solver]\ndistance = "0.4 um"\nsettle = "2 us"\ninitial_overlap = "relax"
[output]\nevery = "0.1 um"\n"""
PRESSED, GAP = 'pressure = "20 MPa"', 'gap = "{gap} um"'


def packing(seed, count=40, clumps=True, overlap=0.3):
    """A bed of balls and clumps on 50 um, free of overlap, whose bodies are then enlarged: balls that touched overlap by
    this part of their radius."""
    rng = np.random.default_rng(seed)
    size = {"distribution": "lognormal", "median": 1e-5, "sigma": 0.2, "min": 6e-6, "max": 16e-6}
    balls = [clump([[0, 0, 0]], [r * UM]) for r in rng.uniform(3.5, 6.5, count)]
    bodies = balls[: count // 2] + population(seed, 0, count - count // 2, (3, 6), (1.0, 0.8, 0.6), **size) if clumps else balls
    low = sum(body.volume for body in bodies) / ((50.0 * UM) ** 2 * 2.0 * max(body.diameter for body in bodies))
    bed = pack(bodies, min(0.45, low), (50.0 * UM, 50.0 * UM), True, rng)
    grown = [body.scaled(1.0 / (1.0 - 0.5 * overlap)) for body in bodies]
    centres, radii, body = spheres_of(grown, bed.positions, bed.quaternions)
    return {"center": centres, "radius": radii, "clump": body}


def prepared(folder, table, plate=PRESSED, periodic=True):
    np.savez(folder / "packing.npz", **table)
    (folder / "scene.toml").write_text(STEEL + TEXT.format(plate=plate, periodic=str(periodic).lower()))
    return Scene.load(folder / "scene.toml")


def built(folder, table, *settings):
    return build(prepared(folder, table, *settings), discover())


def spheres(state):
    return np.column_stack((state.spheres.position, state.spheres.radius)), state.body


def deepest(state, size, periodic=True):
    S, ids = spheres(state)
    worst = float(((S[:, 3] - S[:, 2]) / S[:, 3]).max())
    for a, b in itertools.product((0, 1, -1), repeat=2) if periodic else [(0, 0)]:
        image = S + (a * size[0], b * size[1], 0.0, 0.0)
        apart = np.linalg.norm(S[:, None, :3] - image[:, :3], axis=2)
        depth = (S[:, None, 3] + image[:, 3] - apart) / np.minimum(S[:, None, 3], image[:, 3])
        worst = max(worst, float(depth[ids[:, None] != ids].max()))
    return worst


def stored_by_overlaps(table, size):
    """Energy of the overlaps of a table of balls by Hertz [J]: 8/15 E* sqrt(R) d^2.5, with nearest images."""
    x, r = table["center"], table["radius"]
    i, j = np.triu_indices(len(r), 1)
    between = x[i] - x[j]
    between[:, :2] -= size * np.round(between[:, :2] / size)
    depth = np.maximum(r[i] + r[j] - np.linalg.norm(between, axis=1), 0.0)
    e_star = 210e9 / (2.0 * (1.0 - 0.3**2))
    return float(np.sum(8.0 / 15.0 * e_star * np.sqrt(r[i] * r[j] / (r[i] + r[j])) * depth**2.5))


def test_a_bed_with_overlaps_of_a_third_is_relaxed_and_runs_on(tmp_path):
    table = packing(1, clumps=False)
    scene = prepared(tmp_path, table)
    run = thirdbody.run(scene, tmp_path / "run", progress=False)
    report = run.summary()
    change = report["initial_overlap"]
    assert change["pairs_before"] > 80 and change["overlap_before"] > 0.3 and change["overlap_after"] == 0.0
    assert change["bodies_moved"] == 40
    assert 0.0 < change["mean_displacement"] < change["largest_displacement"] < 6.0  # the bed grows by some 60 %
    energy, work = run.series["energy_kinetic"], run.series["energy_plate_work"]
    stored = stored_by_overlaps(table, 50e-6)
    assert energy[0] == 0.0 and run.series["energy_elastic_normal"][0] == 0.0
    assert 0.0 < energy.max() <= work.max() < 1e-2 * stored
    # truncation of the explicit steps, of the order of the other beds
    assert abs(report["energy_residual"]) < 1e-3
    assert report["finished"]


def test_the_same_start_every_time_and_after_an_interruption(tmp_path):
    scene = prepared(tmp_path, packing(2, 20))
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
    rng = np.random.default_rng(seed)
    periodic = bool(seed % 3)
    table = packing(seed, int(rng.integers(10, 60)), bool(seed % 2), float(rng.uniform(0.05, 0.6)))
    simulation = built(tmp_path, table, PRESSED, periodic)
    state = simulation.state
    assert deepest(state, (50e-6, 50e-6), periodic) <= 0.0
    start = simulation.relaxed
    assert start.overlap_after == 0.0 < start.overlap_before
    simulation.integrator.advance_to(time=100.0 * state.dt)
    kinetic = 0.5 * float(np.sum(state.bodies.mass * np.sum(state.bodies.velocity**2, axis=1)))
    # nothing but the falling plate can have set anything in motion
    upper = state.world.upper
    fallen = upper.heights[0] - state.patches.height[0]
    assert kinetic <= float(upper.load[0]) * fallen * 1.01 + 1e-30


def test_the_plate_at_a_gap_is_a_wall(tmp_path):
    table = packing(3, 25, overlap=0.1)
    top = float((table["center"][:, 2] + table["radius"]).max())
    gap = 1.1 * top  # in um, to the last digit that the scene holds
    simulation = built(tmp_path, table, GAP.format(gap=gap / UM))
    S, _ = spheres(simulation.state)
    assert float((S[:, 2] + S[:, 3]).max()) <= gap and deepest(simulation.state, (50e-6, 50e-6)) <= 0.0


def test_bodies_without_overlap_keep_their_bits(tmp_path):
    table = packing(4, 20, clumps=False, overlap=0.0)
    lowest = int(np.argmin(table["center"][:, 2]))
    table["center"][lowest, 2] -= 0.5 * table["radius"][lowest]  # into the floor; a gap is left above
    pressed = built(tmp_path, table)
    before = table["center"][pressed.state.order]
    same = (pressed.state.bodies.position == before).all(axis=1)
    assert pressed.relaxed.bodies_moved == int((~same).sum()) < 6
    sound = built(tmp_path, packing(4, 20, overlap=0.0))
    assert sound.relaxed.bodies_moved == sound.relaxed.pairs_before == 0
    assert any("nothing overlaps" in warning for warning in sound.warnings)


def test_overlaps_below_the_expected_ones_stay(tmp_path):
    r = 5e-6
    pair = {"center": np.array([[25e-6, 25e-6, r], [25e-6, 25e-6, 3.0 * r * (1.0 - 1e-5)]]), "radius": np.full(2, r)}
    table = pair | {"clump": np.arange(2)}
    simulation = built(tmp_path, table)
    start = simulation.relaxed
    assert start.bodies_moved == 0 and start.pairs_after == 1 and start.overlap_after == pytest.approx(3e-5, rel=1e-6)
    # Hertz: force p d^2 between equal spheres of radius r: overlap = (9 F^2/(16 E*^2 r/2))^(1/3)
    force, e_star = 20e6 * (2.0 * r) ** 2, 210e9 / (2.0 * (1.0 - 0.3**2))
    assert start.expected_overlap == pytest.approx((9.0 * force**2 / (16.0 * e_star**2 * 0.5 * r)) ** (1.0 / 3.0) / r, rel=1e-6)


RING = np.column_stack((np.cos(np.arange(12) * np.pi / 6), np.sin(np.arange(12) * np.pi / 6), np.zeros(12))) * 1.6
LINK = RING[:, [0, 2, 1]] + (1.6, 0.0, 0.0)
BALL = {"radius": np.full(2, 5e-6), "clump": np.arange(2)}


def linked():
    centres = (np.vstack((RING, LINK)) * 4.0 + (20.0, 25.0, 12.0)) * UM
    return {"center": centres, "radius": np.full(24, 4.0 * UM), "clump": np.repeat([0, 1], 12)}


REFUSED = [
    (lambda: packing(5, 40, clumps=False), GAP.format(gap=15), ["too little room", "up to the plate", "bodies"]),
    (lambda: BALL | {"center": np.full((2, 3), 25e-6)}, PRESSED, ["bodies 0 and 1 have the same centre", "given twice"]),
    (linked, PRESSED, ["bodies 0 and 1 still overlap", "interlocked"]),
]


def test_what_cannot_be_relaxed_is_refused(tmp_path, command, monkeypatch):
    for table, plate, words in REFUSED:
        prepared(tmp_path, table(), plate)
        report = command("run", "scene.toml", "-o", "run")
        assert report.code == 3 and not (tmp_path / "run").exists()
        for word in ["debris[0].file", *words]:
            assert word in report.err
    monkeypatch.setattr(initial_relaxation, "_LIMIT", 5)
    with pytest.raises(InputError, match="the limit of 5 steps is reached"):
        built(tmp_path, packing(1))


def test_a_row_in_balance_is_relaxed(tmp_path):
    """Balls in a straight periodic row, too long for the domain: their forces cancel, so they are kicked out of it."""
    x = np.arange(8) * 50e-6 / 8
    centres = np.column_stack((x, np.full(8, 25e-6), np.full(8, 20e-6)))
    table = {"center": centres, "radius": np.full(8, 4e-6), "clump": np.arange(8)}
    simulation = built(tmp_path, table)
    assert deepest(simulation.state, (50e-6, 50e-6)) <= 0.0


def test_an_ensemble_is_moved_out_of_the_floor_only(tmp_path):
    table = BALL | {"center": np.array([[20e-6, 20e-6, 3e-6], [24e-6, 20e-6, 9e-6]])}
    plate = 'support = "load_per_particle"\nload = "0.1 mN"'
    scene = prepared(tmp_path, table, plate).with_settings({"contact.debris_contact": "none", "solver.integrator": "explicit"})
    simulation = build(scene, discover())
    assert np.array_equal(simulation.state.bodies.position[:, :2], table["center"][:, :2])
    assert simulation.state.bodies.position[1, 2] == table["center"][1, 2]
    # out of the floor, and beyond by one step of the relaxation at most: a tenth of the radius
    assert 5e-6 < simulation.state.bodies.position[0, 2] <= 5.5e-6


def test_check_and_run_say_what_was_done(tmp_path, command):
    prepared(tmp_path, packing(6, 12, clumps=False))
    report = command("check", "scene.toml")
    assert report.code == 0 and 'initial_overlap = "relax": 7 of 12 bodies were pushed apart' in report.out
    report = command("run", "scene.toml", "-o", "run", "--json")
    assert report.code == 0 and "bodies were pushed apart, by" in report.err
    change = json.loads(report.out)["initial_overlap"]
    assert change["bodies_moved"] == 7 and change["overlap_before"] > change["overlap_after"] == 0.0
    assert UNLOADED_OVERLAP < change["expected_overlap"] < 0.1
