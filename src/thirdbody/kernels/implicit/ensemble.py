"""Driver of ensembles: a body has rows for all its candidates, and for its spheres, only while it is advanced.

Between two calls there are rows of closed contacts only, of a batch of bodies one after the other. The rows of one body stay in
the first cache until its closed ones are written back.
"""

from typing import NamedTuple

import numpy as np
from numba import njit, types

from thirdbody.jit.arguments import PACKED, first_words
from thirdbody.jit.options import BARE, DIRECT, entry
from thirdbody.kernels.closed_contacts import CLOSED, compact, expand, keep
from thirdbody.kernels.implicit.bdf2 import advance_body
from thirdbody.kernels.implicit.bundles import KINDS, context_of, make_workspace
from thirdbody.kernels.implicit.step_control import Stop
from thirdbody.kernels.implicit.tables import step_memory, step_start
from thirdbody.kernels.rigid_body import place_as_it_is
from thirdbody.kernels.tables import body, run_totals, sphere

Array = np.ndarray

_WORDS = first_words(KINDS)
H_ADDRESS, R_ADDRESS, S_ADDRESS = (_WORDS[name] for name in ("H", "R", "S"))
"""Words of the packed arguments that hold the addresses of the tables that exist for one body at a time."""


class Span(NamedTuple):
    """Bodies `first` to `last` - 1 of a batch, of which `low` to `high` - 1 are advanced."""

    first: int
    last: int
    low: int
    high: int


class OneBody(NamedTuple):
    """Tables with room for the candidates and the spheres of any body; radii of all spheres, or none where spheres are kept."""

    H: Array
    R: Array
    S: Array
    radii: Array


@njit(**BARE)
def waits(b, until, context):
    """Return whether body b goes on and has not reached a time [s]."""
    return context.memory[b, step_memory.CODE] == Stop.NONE.value and context.totals[b, run_totals.TIME] < until


@njit(**BARE)
def place_spheres(b, context, one):
    """Write the spheres of body b."""
    if one.radii.shape[0] > 0:
        for s in range(context.start[b], context.start[b + 1]):
            context.S[s, sphere.RADIUS], context.S[s, sphere.MASS] = one.radii[s], context.B[b, body.MASS]
        place_as_it_is(b, context.start, context.offsets, context.S, context.B, context.orientations)


@njit(**BARE)
def point_to(table, row, word, packed):
    """Set the address of a table in the packed arguments so that its first row is the one of that number."""
    packed[word] = table.ctypes.data - row * table.strides[0]


_TABLE, _ROW, _LONG = types.Array(types.float64, 2, "C"), types.Array(types.float64, 1, "C"), types.int64
SPAN, ONE_BODY = types.NamedUniTuple(_LONG, 4, Span), types.NamedTuple((_TABLE, _TABLE, _TABLE, _ROW), OneBody)


@entry(_LONG(SPAN, types.float64, types.float64, PACKED, CLOSED, CLOSED, ONE_BODY), nogil=True, **DIRECT)
def advance_batch(span, until, tries, packed, closed, new, one):
    """Advance bodies of a batch as `bdf2.advance_bodies`; write the batch's closed contacts to `new` and return their number.

    `packed`: a packed `ImplicitContext`, in which the addresses of the tables of one body are changed; `one`: these tables;
    `new`: with room for all candidates of the batch.
    """
    context, n_closed = context_of(packed), np.int64(closed.on.shape[0])
    space, start = make_workspace(context), np.zeros(step_start.WIDTH)
    begin, p, written = context.edges[span.first], np.int64(0), np.int64(0)
    for b in range(span.first, span.last):
        k = context.edges[b]
        first, n, after = k - begin, context.edges[b + 1] - k, p
        while after < n_closed and closed.on[after] < first + n:
            after += 1
        if span.low <= b < span.high and waits(b, until, context):
            expand(n, p, first, closed, one.H, one.R)
            point_to(one.H, k, H_ADDRESS, packed)
            point_to(one.R, k, R_ADDRESS, packed)
            if one.radii.shape[0] > 0:
                point_to(one.S, context.start[b], S_ADDRESS, packed)
            of_body = context_of(packed)
            place_spheres(b, of_body, one)
            advance_body(b, until, tries, of_body, start, space)
            written = compact(n, written, first, one.H, one.R, new)
        else:
            written = keep(p, after, written, closed, new)
        p = after
    return written
