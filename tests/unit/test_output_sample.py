"""`output.sample`: the run file holds some of the bodies in full, and the series tell of all."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from ensembles import SCENE
from trajectories import whole_and_resumed

import thirdbody
from thirdbody.errors import InputError
from thirdbody.trajectory.rebuilt_spheres import rows_of
from thirdbody.trajectory.sample import ELSEWHERE, REVERSED, sample_of

BED = Path(__file__).parents[2] / "scenes" / "dense_layer.toml"
SHORT = {
    "debris.0.count": 40, "domain.size": ["40 um", "40 um"], "solver": {"settle": "40 ns"},
    "plates.upper.motion.x.velocity": "1 m/s", "solver.distance": "4 nm", "output.every": "2 nm",
}  # fmt: skip
"""A bed under load before it rests: bodies that meet, in some hundred steps."""

EXPLICIT = {"solver.integrator": "explicit", "solver.settle": "50 ns", "solver.distance": "4 nm", "output.every": "1 nm"}
COUNT = 15


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """The bed with all bodies in its file, and with some."""
    folder, scene = tmp_path_factory.mktemp("runs"), thirdbody.Scene.load(BED).with_settings(SHORT)
    whole = thirdbody.run(scene, out=folder / "whole", progress=False, threads=1)
    some = thirdbody.run(scene.with_settings({"output.sample": COUNT}), out=folder / "some", progress=False, threads=1)
    with whole, some:
        yield whole, some


def test_one_body_of_each_stretch():
    sample = sample_of(1000, 50_000)
    assert np.array_equal(sample.bodies // 50, np.arange(1000))
    assert np.array_equal(np.flatnonzero(sample.row >= 0), sample.bodies) and np.array_equal(
        sample_of(1000, 50_000).row, sample.row
    )
    # not every fiftieth: shapes of a library follow each other at such a distance
    assert len(np.unique(sample.bodies % 50)) == 50
    assert np.array_equal(sample_of(7, 7).bodies, np.arange(7))


def test_bodies_and_spheres_are_those_of_the_whole_run(runs):
    whole, some = runs
    ids = some.bodies(0)["scene_id"]
    assert len(ids) == COUNT and some.scene_bodies == 40 and "scene_id" not in whole.bodies(0)
    for frame in range(whole.frames):
        every, mine = whole.bodies(frame), some.bodies(frame)
        assert np.array_equal(mine["id"], np.arange(COUNT))
        for name in set(every) - {"id"}:
            assert np.array_equal(mine[name], every[name][ids]), name
        spheres, own = whole.spheres(frame), some.spheres(frame)
        chosen = np.isin(spheres["clump"], ids)
        assert np.array_equal(ids[own["clump"]], spheres["clump"][chosen])
        for name in ("position", "velocity", "radius", "state"):
            assert np.array_equal(own[name], spheres[name][chosen]), name
    assert np.array_equal(rows_of(some.bodies(0), some.spheres(0)["clump"]), some.spheres(0)["clump"])


def test_contacts_are_those_of_the_bodies_in_the_file(runs):
    """A contact of which the file holds the partner alone is seen from there: force and normal turn, nothing else changes."""
    whole, some = runs
    ids = some.bodies(0)["scene_id"]
    every, mine = whole.contacts(-1), some.contacts(-1)
    in_file = np.isin(every["body"], ids), np.isin(every["partner"], ids)
    chosen = in_file[0] | in_file[1]
    from_partner = ~in_file[0][chosen]
    assert from_partner.any() and (~from_partner).any() and (mine["partner"] == ELSEWHERE).any()
    one, other = every["body"][chosen], every["partner"][chosen]
    assert np.array_equal(ids[mine["body"]], np.where(from_partner, other, one))
    far = np.where(from_partner, one, other)
    here = mine["partner"] >= 0
    assert np.array_equal(ids[mine["partner"][here]], far[here])
    assert np.array_equal(mine["partner"] == ELSEWHERE, (far >= 0) & ~np.isin(far, ids))
    for name in set(every) - {"body", "partner"}:
        signs = np.where(from_partner, -1.0, 1.0) if name in REVERSED else np.ones(len(from_partner))
        assert np.array_equal((mine[name].T * signs).T, every[name][chosen]), name


def test_series_and_summary_are_those_of_all_bodies(runs):
    whole, some = runs
    for name, values in whole.series.items():
        assert np.array_equal(some.series[name], values, equal_nan=True), name
    reasons = whole.reasons
    for code, name in enumerate(whole.reason_names):
        assert np.array_equal(some.series[f"count_{name}"], np.count_nonzero(reasons == code, axis=1)), name
    every, mine = whole.summary(), some.summary()
    assert mine["bodies"] == 40 and mine["bodies_in_file"] == COUNT and "bodies_in_file" not in every
    assert mine["fractions"] == every["fractions"] and mine["peak_pressure"] == every["peak_pressure"] > 0.0


def test_what_reads_a_run_reads_a_sampled_one(runs, tmp_path, command):
    _, some = runs
    folder = some.path.parent
    code, out, errors = command("states", folder)
    assert code == 0 and f"{COUNT} of 40 bodies are in the file" in out and "reasons of all bodies" in out, errors
    words = (("plot", folder, "-o", tmp_path / "a.png"), ("render", folder, "--forces", "-o", tmp_path / "b.png"),
             ("render", folder, "--body", "3", "-o", tmp_path / "c.png"),
             ("export", folder, "--csv", tmp_path / "csv"))  # fmt: skip
    for each in words:
        code, _, errors = command(*each)
        assert code == 0, errors
    header = (tmp_path / "csv" / "bodies.csv").read_text().splitlines()
    assert any("scene_id" in line for line in header[:5])


def test_a_resumed_run_has_the_bits_of_the_whole_one(tmp_path):
    settings = EXPLICIT | {"output.sample": 3, "output.blocks": ["clumps"], "output.precision": "float32"}
    scene = thirdbody.Scene.parse(SCENE).with_settings(settings)
    whole_and_resumed(scene, tmp_path)
    with thirdbody.open(tmp_path / "whole") as run:
        assert np.array_equal(run.spheres(-1)["clump"][[0, -1]], [0, 2])


def test_a_sample_of_all_is_no_sample(tmp_path):
    scene = thirdbody.Scene.parse(SCENE).with_settings(EXPLICIT | {"output.sample": 7})
    with thirdbody.run(scene, out=tmp_path / "run", progress=False, threads=1) as run:
        assert "scene_id" not in run.bodies(0) and "count_none" not in run.series and "bodies_in_file" not in run.summary()
    with pytest.raises(InputError, match=r"output.sample: 0 must be at least 1"):
        thirdbody.Scene.parse(SCENE).with_settings({"output.sample": 0})
