"""Fields of contact laws, between rows of H and tiles.

A tile has the memory of its contacts (`Chain.history`) as columns, contact beside contact, which the engine and most laws compute
in vectors of contacts. The numbers of a field are read by the loops of one law only: they lie in one piece per contact, which
take the place of as many columns (`pieces`). Copies from and to columns took a quarter of the time of a law of 16 springs.
"""

import numpy as np
from numba import njit

from thirdbody.jit.options import BARE
from thirdbody.kernels.tables import contact_state
from thirdbody.kernels.tile import TILE, law_input, law_output


def pieces(columns: np.ndarray) -> np.ndarray:
    """Return the fields (TILE, size) of the contacts of a tile as a view of their place, the columns (size, TILE)."""
    return columns.reshape(TILE, len(columns))


@njit(**BARE)
def load_field(q, k, context, tile):
    """Load the field of candidate k into the tile, as that of contact q."""
    I, H, begin, size = tile.inputs, context.H, context.field_begin, context.field_size  # noqa: E741
    at = (law_input.HISTORY + begin) * TILE + q * size
    for f in range(size):
        I[at + f] = H[k, contact_state.LAW + begin + f]


@njit(**BARE)
def store_field(q, k, context, tile):
    """Store the field of contact q after the step as that of candidate k."""
    O, H, begin, size = tile.outputs, context.H, context.field_begin, context.field_size  # noqa: E741
    at = (law_output.HISTORY + begin) * TILE + q * size
    for f in range(size):
        H[k, contact_state.LAW + begin + f] = O[at + f]
