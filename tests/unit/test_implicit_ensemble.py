"""Ensembles keep rows of closed contacts only: same bits as with all rows, also after a checkpoint, and less memory."""

import numpy as np
import pytest
from steel import SCENES

from thirdbody.api import open_run
from thirdbody.engine import implicit, implicit_ensemble
from thirdbody.engine.candidates import AllRows, ClosedRows
from thirdbody.engine.guards import Ledger
from thirdbody.engine.snapshot import restore, snapshot
from thirdbody.runner.checkpoint import read_checkpoint
from thirdbody.runner.outlook import memory_of
from thirdbody.runner.run_loop import WallTimes
from thirdbody.runner.simulate import execute, prepare
from thirdbody.scene.model import Scene
from thirdbody.trajectory.frame import FrameMaker

SCENE = SCENES / "sheared_debris.toml"
SETTINGS = {
    "debris.0.count": 20, "debris.0.shapes": 5, "contact.debris_contact": "none", "domain.size": ["200 um", "150 um"],
    "plates.upper.motion.x.velocity": "1 mm/s", "solver.distance": "0.2 um", "output.every": "0.1 um",
}  # fmt: skip
STOPS = (1e-5, 2e-5, 2e-4)  # in the pressing, at its end, in the first sliding [s]


@pytest.fixture
def small_batches(monkeypatch):
    for module in (implicit, implicit_ensemble):
        monkeypatch.setattr(module, "BATCH", 8)


def built(**settings):
    return prepare(Scene.load(SCENE).with_settings(SETTINGS | settings))


def with_all_rows(monkeypatch, use=lambda simulation: simulation, **settings):
    with monkeypatch.context() as patch:
        patch.setattr(implicit_ensemble, "is_ensemble", lambda state: False)
        return use(built(**settings))


def advanced(simulation, stops=STOPS):
    for stop in stops:
        simulation.integrator.advance_to(time=stop)
    return simulation


def assert_same(one, other):
    for name in ("B", "E", "orientations", "P", "M", "A"):
        np.testing.assert_array_equal(getattr(one.state, name), getattr(other.state, name))
    closed = other.state.slots.rows.closed()
    np.testing.assert_array_equal(one.state.slots.rows.closed(), closed)
    np.testing.assert_array_equal(one.state.slots.H, other.state.slots.H)
    np.testing.assert_array_equal(one.state.slots.R[closed], other.state.slots.R[closed])
    np.testing.assert_array_equal(one.state.S[:, :4], other.state.S[:, :4])
    np.testing.assert_array_equal(one.integrator.label(), other.integrator.label())
    frames = [FrameMaker(each.state, Ledger(each.state), each.labeller, each.integrator.drag) for each in (one, other)]
    first, second = (maker.frame(each.integrator.label()) for maker, each in zip(frames, (one, other), strict=True))
    for block in ("spheres", "clumps", "contacts", "series"):
        for name, values in getattr(second, block).items():
            np.testing.assert_array_equal(getattr(first, block)[name], values, err_msg=f"{block} {name}")


def test_same_bits_as_with_all_rows(small_batches, monkeypatch):
    batched, whole = built(), with_all_rows(monkeypatch)
    assert isinstance(batched.state.slots.rows, ClosedRows) and isinstance(whole.state.slots.rows, AllRows)
    assert batched.state.sphere_table is None
    for stop in STOPS:
        assert_same(advanced(batched, (stop,)), advanced(whole, (stop,)))


def test_snapshot_goes_on_with_the_same_bits(small_batches):
    straight, stopped, later = built(), built(), built()
    advanced(stopped, STOPS[:1])
    saved = snapshot(stopped.state, stopped.integrator, Ledger(stopped.state))
    restore(saved, later.state, later.integrator, Ledger(later.state))
    assert_same(advanced(later, STOPS[1:]), advanced(straight))


def test_memory_of_a_body_is_at_most_4_kB():
    simulation = built(**{"debris.0.count": 600, "domain.size": ["600 um", "450 um"]})
    assert isinstance(simulation.state.slots.rows, ClosedRows)
    assert memory_of(simulation) <= 4000 * 600 + 2 * 4000 * implicit.BATCH  # of a batch, tables of spheres and contacts


def test_a_sample_has_its_contacts_and_a_checkpoint_closed_ones_only(small_batches, monkeypatch, tmp_path):
    settings = {"output.sample": 5, "output.blocks": ["clumps", "contacts"]}
    few, whole = (tmp_path / name for name in ("few", "whole"))
    simulation = built(**settings)
    execute(simulation, few, times=WallTimes())
    arrays, rows = read_checkpoint(few).snapshot.arrays, simulation.state.slots.rows
    assert "S" not in arrays and len(arrays["slots_H"]) == len(arrays["slots_R"]) == len(rows.closed())
    for name, pieces in zip(("slots_H", "slots_R"), rows.pieces(), strict=True):
        np.testing.assert_array_equal(arrays[name], np.concatenate(pieces))
    with_all_rows(monkeypatch, lambda simulation: execute(simulation, whole), **settings)
    with open_run(few) as one, open_run(whole) as other:
        first, second = one.contacts(-1), other.contacts(-1)
        assert len(first["body"]) > 0 and set(first) == set(second)
        for name, values in first.items():
            np.testing.assert_array_equal(values, second[name], err_msg=name)
