"""Update of the contacts with rough plates: called through a pointer, so that scenes with flat plates do not compile it."""

from typing import NamedTuple

import numpy as np
from numba import njit, types

from thirdbody.jit.arguments import function_at
from thirdbody.jit.options import BARE

Array = np.ndarray


class RoughPlates(NamedTuple):
    """Candidates and tables that an update needs; names as in `signatures.Context`."""

    own: Array
    partner: Array
    S: Array
    P: Array
    Q: Array
    D: Array
    lower: Array
    upper: Array


_TABLE, _ROW, _S1 = types.Array(types.float64, 2, "C"), types.Array(types.float64, 1, "C"), types.Array(types.int32, 1, "C")
UPDATE = types.void(types.int64, types.int64, types.NamedTuple((_S1, _S1, _TABLE, _TABLE, _TABLE, _ROW, _ROW, _ROW), RoughPlates))
"""update(first candidate, last + 1, tables)"""

update_at = function_at(UPDATE)


@njit(**BARE)
def update_by(update, first, last, context):
    """Update the rows of Q of candidates first to last, all those of a sphere with a plate, by the function at an address."""
    tables = RoughPlates(context.own, context.partner, context.S, context.P, context.Q, context.D, context.lower, context.upper)
    update_at(update)(np.int64(first), np.int64(last), tables)


@njit(**BARE)
def update_surfaces(first, last, context):
    """Update the rows of Q of candidates first to last."""
    update_by(context.update_surfaces, first, last, context)
