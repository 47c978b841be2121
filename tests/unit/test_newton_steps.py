"""Newton's method without a run: linear systems against LAPACK, what shortens a correction, the Jacobian of a contact."""

import itertools
from collections import namedtuple

import numpy as np
import pytest
from numba import njit

from thirdbody.kernels.implicit import newton
from thirdbody.kernels.implicit.jacobian import NO_TANGENT, Contact, add_contact
from thirdbody.kernels.implicit.tables import step_start
from thirdbody.kernels.tables import sphere
from thirdbody.kernels.tile import TILE, geometry, law_input, law_output


def test_solution_is_that_of_lapack():
    """Random matrices need many exchanges of rows; a singular one is refused."""
    for n, seed in itertools.product((6, 7), range(20)):
        rng = np.random.default_rng(seed)
        A, b = rng.normal(size=(n, n)), rng.normal(size=n)
        np.fill_diagonal(A, 0.0)
        J, pivots, r = A.copy(), np.zeros(n, np.int64), -b
        assert newton.factorise.py_func(J, pivots, n)
        newton.substitute.py_func(J, pivots, r, n)
        x = np.linalg.solve(A, b)
        # rounding grows with the condition of the matrix
        bound = 50.0 * np.finfo(float).eps * np.linalg.cond(A) * np.abs(x).max()
        np.testing.assert_allclose(r, x, rtol=0.0, atol=bound)
    assert not newton.factorise.py_func(np.ones((7, 7)), np.zeros(7, np.int64), 7)


OVERLAP, SLIP, BACK = 1e-9, 2e-10, 1e-9
"""Overlap of the spot, its slip in the step so far, and how far the correction moves it back [m]."""
FIELDS = 80  # of a tile, more than any of its tables has


Rows = namedtuple("Rows", "interaction own partner S")
Scratch = namedtuple("Scratch", "inputs outputs geometry")
Space = namedtuple("Space", "tile slots correction")
Active = namedtuple("Active", "start")


@njit
def limited(context, active, space):
    return newton.limit_slip_reversal(context, active, 1, 1.0, space)


def fraction(relief, limit=0.0, interaction=3):
    """Fraction of a correction that is left by one spot at the limit of friction (N), at which it slips along x."""
    tile = Scratch(*np.zeros((3, FIELDS * TILE)))
    tile.inputs[law_input.OVERLAP * TILE], tile.inputs[law_input.SLIP_X * TILE] = OVERLAP, SLIP
    tile.outputs[law_output.FRICTION_LIMIT * TILE] = tile.outputs[law_output.TANGENTIAL_X * TILE] = limit
    tile.geometry[geometry.RELIEF * TILE] = relief
    for column in (geometry.NORMAL + 2, geometry.AXIS, geometry.CROSS_AXIS + 1):
        tile.geometry[column * TILE] = 1.0
    start = np.zeros(step_start.WIDTH)
    start[step_start.ARM] = 1e-6
    context = Rows(np.zeros(interaction), np.zeros(1, int), np.full(1, -1), np.zeros((1, sphere.WIDTH)))
    return limited(context, Active(start), Space(tile, np.zeros(1, int), np.array([-BACK, *(0.0,) * 6])))


def test_a_spot_at_the_limit_shortens_a_correction_that_reverses_its_slip():
    """To its slip so far: with no displacement that friction holds, nothing more. One that is relieved wholly shortens none:

    its limit is none at all, it would shorten every correction, to a stop. Where spots do not interact it counts.
    """
    for relief in (0.0, 0.5 * OVERLAP):
        assert fraction(relief, limit=1e-6) == pytest.approx(SLIP / BACK, rel=1e-12)
    assert fraction(OVERLAP) == fraction(1.5 * OVERLAP) == 1.0
    assert fraction(OVERLAP, interaction=0) < 1.0


@njit
def jacobian_of(contact):
    J = np.zeros((7, 7))
    add_contact(contact, False, J)
    return J


def random_contact(seed, upper, rolling):
    rng = np.random.default_rng(seed)
    axes, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    n, e = axes[0], axes[1]
    vectors = [tuple(v.tolist()) for v in (n, e, np.cross(n, e), *rng.normal(size=(4, 3)))]
    tangent = tuple(rng.normal(size=7).tolist())
    none = (0.0, 0.0, 0.0)
    return Contact(
        (vectors[0], vectors[1], vectors[2]), vectors[3], vectors[4], 1.0, vectors[5], none, 1.0, 1.0, none, NO_TANGENT,
        NO_TANGENT, vectors[6], tangent, rolling, NO_TANGENT, (0.0, 0.0), upper,
    )  # fmt: skip


def test_blocks_are_the_columns():
    """A law with moments takes the columns; with moments of zero stiffness both are the same derivative."""
    for seed, upper in itertools.product(range(5), (False, True)):
        blocks = jacobian_of(random_contact(seed, upper, rolling=False))
        columns = jacobian_of(random_contact(seed, upper, rolling=True))
        assert np.count_nonzero(blocks) == (49 if upper else 36)
        np.testing.assert_allclose(blocks, columns, rtol=0.0, atol=1e-13)  # rounding of products of numbers of order one
