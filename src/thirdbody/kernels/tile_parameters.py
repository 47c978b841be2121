"""Parameters of the laws for a tile, field by field, so that the law's loop can be vectorised."""

from numba import njit

from thirdbody.jit.options import BARE_CHUNK
from thirdbody.kernels.tile import TILE, law_input


@njit(**BARE_CHUNK)
def broadcast_parameters(I, n_contacts, pairs, width, U):  # noqa: E741
    """Copy the row of `pairs` (`width` numbers) of each contact's pair type to its element in U, stride TILE.

    The types are compared first: mostly all contacts are of one type.
    """
    first, alike = I[law_input.PAIR_TYPE * TILE], True
    for q in range(n_contacts):
        alike &= I[q + law_input.PAIR_TYPE * TILE] == first
    if alike:
        for f in range(width):
            value = pairs[int(first) * width + f]
            for q in range(n_contacts):
                U[f * TILE + q] = value
    else:
        for q in range(n_contacts):
            o = int(I[q + law_input.PAIR_TYPE * TILE]) * width
            for f in range(width):
                U[f * TILE + q] = pairs[o + f]
