"""Ensembles keep rows of closed contacts only, with the same bits; Newton's method without a run, against LAPACK."""

import itertools
from collections import namedtuple

import numpy as np
import pytest
from numba import njit
from steel import SCENES
from thirdbody.api import open_run
from thirdbody.engine import implicit, implicit_ensemble
from thirdbody.engine.candidates import AllRows, ClosedRows
from thirdbody.engine.guards import Ledger
from thirdbody.engine.snapshot import restore, snapshot
from thirdbody.kernels.implicit import jacobian, newton
from thirdbody.kernels.implicit.contact import NOWHERE, ZERO_TENSOR, ContactOfSides, Side, add_planar
from thirdbody.kernels.implicit.jacobian import add_general
from thirdbody.kernels.step_tables import step_start
from thirdbody.kernels.tables import sphere
from thirdbody.kernels.tile import TILE, geometry, law_input, law_output
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


def test_a_run_and_its_snapshot_have_the_bits_of_one_with_all_rows(small_batches, monkeypatch):
    batched, whole = built(), with_all_rows(monkeypatch)
    assert isinstance(batched.state.slots.rows, ClosedRows) and isinstance(whole.state.slots.rows, AllRows)
    assert batched.state.sphere_table is None
    for stop in STOPS:
        assert_same(advanced(batched, (stop,)), advanced(whole, (stop,)))
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


def test_solution_is_that_of_lapack():
    """Dense and as a band. Random matrices need many exchanges of rows; a singular one is refused."""
    for (n, w), seed in itertools.product(((7, 6), (14, 6), (28, 13)), range(20)):
        rng = np.random.default_rng(seed)
        A, b = rng.normal(size=(n, n)), rng.normal(size=n)
        A[np.abs(np.subtract.outer(np.arange(n), np.arange(n))) > w] = 0.0
        np.fill_diagonal(A, 0.0)
        step, offset = (n, 0) if n == 7 else (3 * w, w)
        J, pivots, r = np.zeros(n * (step + 1)), np.zeros(n, np.int64), -b
        for i, j in zip(*np.nonzero(A), strict=True):
            J[i * step + j + offset] = A[i, j]
        assert jacobian.factorise.py_func(J, pivots, n, w, step, offset)
        jacobian.substitute.py_func(J, pivots, r, n, w, step, offset)
        x = np.linalg.solve(A, b)
        # rounding grows with the condition of the matrix
        bound = 50.0 * np.finfo(float).eps * np.linalg.cond(A) * np.abs(x).max()
        np.testing.assert_allclose(r, x, rtol=0.0, atol=bound)
    assert not jacobian.factorise.py_func(np.ones(49), np.zeros(7, np.int64), 7, 6, 7, 0)


OVERLAP, SLIP, BACK = 1e-9, 2e-10, 1e-9
"""Overlap of the spot, its slip in the step so far, and how far the correction moves it back [m]."""
FIELDS = 80  # of a tile, more than any of its tables has


Rows = namedtuple("Rows", "spots_part own partner S")
Space = namedtuple("Space", "inputs outputs geometry start slots correction")


@njit
def limited(context, space):
    return newton.limit_slip_reversal(context, 1, 1.0, space)


def fraction(relief, limit=0.0, spots_part=1):
    """Fraction of a correction that is left by one spot at the limit of friction (N), at which it slips along x."""
    correction = np.array([-BACK, *(0.0,) * 6])
    tile = Space(*np.zeros((3, FIELDS * TILE)), np.zeros(step_start.WIDTH), np.zeros(1, int), correction)
    tile.inputs[law_input.OVERLAP * TILE], tile.inputs[law_input.SLIP_X * TILE] = OVERLAP, SLIP
    tile.outputs[law_output.FRICTION_LIMIT * TILE] = tile.outputs[law_output.TANGENTIAL_X * TILE] = limit
    tile.geometry[geometry.RELIEF * TILE] = relief
    for column in (geometry.NORMAL + 2, geometry.AXIS, geometry.CROSS_AXIS + 1):
        tile.geometry[column * TILE] = 1.0
    tile.start[step_start.ARM] = 1e-6
    return limited(Rows(spots_part, np.zeros(1, int), np.full(1, -1), np.zeros((1, sphere.WIDTH))), tile)


def test_a_spot_at_the_limit_shortens_a_correction_that_reverses_its_slip():
    """To its slip so far: with no displacement that friction holds, nothing more. One that is relieved wholly shortens none:
    its limit is none at all, it would shorten every correction, to a stop. Where spots do not interact it counts."""
    for relief in (0.0, 0.5 * OVERLAP):
        assert fraction(relief, limit=1e-6) == pytest.approx(SLIP / BACK, rel=1e-12)
    assert fraction(OVERLAP) == fraction(1.5 * OVERLAP) == 1.0
    assert fraction(OVERLAP, spots_part=0) < 1.0


@njit
def by_blocks(contact):
    J = np.zeros(49)
    add_planar(contact, J)
    return J


@njit
def by_columns(contact):
    J = np.zeros(49)
    add_general(contact, J, 7, 0)
    return J


def random_contact(seed, upper):
    """With a plane; force and displacement along the normal, since the blocks leave out that the frame turns about it."""
    rng = np.random.default_rng(seed)
    axes, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    n, e = axes[0], axes[1]
    frame = tuple(tuple(v.tolist()) for v in (n, e, np.cross(n, e)))
    centre = rng.normal(size=3)
    point = centre - n  # an arm of one
    force = tuple((rng.normal() * n).tolist())
    tangent = tuple(rng.normal(size=7).tolist())
    owner = Side(0, -1, 1.0, tuple(centre.tolist()), tuple(point.tolist()), 1.0)
    return ContactOfSides(
        owner, Side(-1, 6 if upper else -1, 1.0, NOWHERE, NOWHERE, 0.0), frame, force, NOWHERE, (0.3, 0.0, 0.0), tangent,
        ZERO_TENSOR, (0.0, 0.0), ZERO_TENSOR, 1.0, 1.0, NOWHERE, ZERO_TENSOR,
    )  # fmt: skip


def test_blocks_are_the_columns():
    for seed, upper in itertools.product(range(5), (False, True)):
        contact = random_contact(seed, upper)
        # rounding of products of numbers of order one
        np.testing.assert_allclose(by_blocks(contact), by_columns(contact), rtol=0.0, atol=1e-13)
