"""A contact with a plane, by blocks of the Jacobian and column by column."""

import itertools

import numpy as np
from numba import njit

from thirdbody.kernels.implicit.jacobian import NO_TANGENT, Contact, add_contact


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
