"""Driver of ensembles: a body has rows for all its candidates, and for its spheres, only while it is advanced.

Between two calls there are rows of closed contacts only, of a batch of bodies one after the other. The rows of one body stay in
the first cache until its closed ones are written back.
"""

from typing import NamedTuple

import numpy as np
from numba import njit, types

from thirdbody.jit.arguments import PACKED, Unpacked, first_words, function_at, make_unpacker
from thirdbody.jit.options import BARE, DIRECT, entry
from thirdbody.kernels.bodies import place_as_it_is
from thirdbody.kernels.implicit.control import Stop
from thirdbody.kernels.implicit.tables import step_memory
from thirdbody.kernels.implicit.workspace import ADVANCE, KINDS, ImplicitContext, context_of
from thirdbody.kernels.memory import CLOSED, compact, expand, keep
from thirdbody.kernels.tables import body, run_totals, sphere

Array = np.ndarray

_WORDS = first_words(KINDS)
H_ADDRESS, R_ADDRESS, S_ADDRESS = (_WORDS[name] for name in ("H", "R", "S"))
"""Words of the packed arguments that hold the addresses of the tables that exist for one body at a time."""


changing_context_of = make_unpacker(Unpacked(KINDS, ImplicitContext, changing=True))

advance_at = function_at(ADVANCE)


class Span(NamedTuple):
    """Bodies `first` to `last` - 1 of a batch, of which `low` to `high` - 1 are advanced; address of `driver.advance_islands`."""

    first: int
    last: int
    low: int
    high: int
    advance: int


class OneBody(NamedTuple):
    """Tables with room for the candidates and the spheres of any body; radii of all spheres, or none where spheres are kept."""

    H: Array
    R: Array
    S: Array
    radii: Array


@njit(**BARE)
def point_to(table, row, word, packed):
    """Set the address of a table in the packed arguments so that its first row is the one of that number."""
    packed[word] = table.ctypes.data - row * table.strides[0]


_TABLE, _ROW, _LONG = types.Array(types.float64, 2, "C"), types.Array(types.float64, 1, "C"), types.int64
SPAN, ONE_BODY = types.NamedUniTuple(_LONG, 5, Span), types.NamedTuple((_TABLE, _TABLE, _TABLE, _ROW), OneBody)


@entry(
    _LONG(SPAN, types.float64, types.float64, PACKED, PACKED, PACKED, types.UniTuple(CLOSED, 2), ONE_BODY), nogil=True, **DIRECT
)
def advance_batch(span, until, tries, packed, tables, packed_scratch, contacts, one):
    """Advance bodies of a batch as `driver.advance_islands`; write its closed contacts, and return their number.

    `packed`: a packed `ImplicitContext`, in which the addresses of the tables of one body are changed; `one`: these tables;
    `contacts`: closed ones before, and tables with room for all candidates of the batch.
    """
    closed, new = contacts
    context, n_closed = context_of(packed), np.int64(closed.on.shape[0])
    begin, p, written = context.plate_edges[span.first], np.int64(0), np.int64(0)
    for b in range(span.first, span.last):
        k = context.plate_edges[b]
        first, n, after = k - begin, context.plate_edges[b + 1] - k, p
        while after < n_closed and closed.on[after] < first + n:
            after += 1
        waits = context.memory[b, step_memory.CODE] == Stop.NONE.value and context.totals[b, run_totals.TIME] < until
        if span.low <= b < span.high and waits:
            expand(n, p, first, closed, one.H, one.R)
            point_to(one.H, k, H_ADDRESS, packed)
            point_to(one.R, k, R_ADDRESS, packed)
            if one.radii.shape[0] > 0:
                point_to(one.S, context.start[b], S_ADDRESS, packed)
                own = changing_context_of(packed)
                for s in range(own.start[b], own.start[b + 1]):
                    own.S[s, sphere.RADIUS], own.S[s, sphere.MASS] = one.radii[s], own.B[b, body.MASS]
                place_as_it_is(b, own.start, own.offsets, own.S, own.B, own.orientations)
            advance_at(span.advance)(np.int64(b), np.int64(b + 1), until, tries, packed, tables, packed_scratch)
            written = compact(n, written, first, one.H, one.R, new)
        else:
            written = keep(p, after, written, closed, new)
        p = after
    return written
