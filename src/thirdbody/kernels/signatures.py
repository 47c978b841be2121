"""Signatures of the functions that the engine calls through a pointer, so that it is compiled once for all laws."""

from numba import types

_TABLE = types.Array(types.float64, 2, "C")
_ROW = types.Array(types.float64, 1, "C")
_I, _I1, _S1 = types.int64, types.Array(types.int64, 1, "C"), types.Array(types.int32, 1, "C")

LAW = types.void(_ROW, _ROW, types.int64, _ROW)
"""law(inputs, outputs, number of contacts in the tile, parameters of all pairs)"""

EFFECTS = types.void(_TABLE, types.int64, types.int64, types.float64, types.float64, _ROW)
"""effects(bodies, first, last, time, time step, parameters)"""

OBSERVE = types.void(_TABLE, types.int64, _ROW, _ROW)
"""observe(contacts of the body, how many, body, memory)"""

LABEL = types.void(_TABLE, types.int64, _ROW, _ROW, _ROW)
"""label(contacts of the body, how many, body, memory, out)"""

_S2 = types.Array(types.int32, 2, "C")
SLOTS = (_S1, _S1, _S1, _S1, _S1, _S1, _S1, _S1, _S1, _S1, _S2, _S1, _S1)
# ... own, partner, kind, closed, outer; edges, incidence; near, beginning; guests, cuts, lowest, needs
SHAPES = (_I1, _I1, _TABLE)  # body, start; offsets
TABLES = (_TABLE, _TABLE, _TABLE, _TABLE, _TABLE, _TABLE, _TABLE)  # S, B, P, H, F, R, M
KNOWN = (_ROW, _ROW, _ROW, _ROW, _TABLE, _TABLE, _I, _I, _I, types.boolean, types.UniTuple(types.float64, 2))
# ... pairs, effect parameters, D, A; sums, moves; n_history, rolling, width, has_effects; drag direction
POINTERS = (types.FunctionType(LAW), types.FunctionType(EFFECTS), types.FunctionType(OBSERVE))
ADDRESSES = (_I, _I, _I)  # of the same
SCRATCH = (_TABLE, _S2, types.Array(types.float64, 3, "C"), _S1)  # room, marks, rows, moved
STEP = (_I, types.boolean, types.float64, types.float64, types.float64, types.float64)  # number, record, time, v_x, v_y, dt
WORK = types.void(_I, _I, _I, _I, *STEP, *SLOTS, *SHAPES, *TABLES, *KNOWN, *POINTERS, *SCRATCH)
"""work(pass, part, first group, the one behind the last, then all that a step knows and works on)"""

EARLY, SWEEP, LATE, LOOK = range(4)
"""Passes of a step. The sweep goes through its groups once and does all that a group needs; where there are several parts, bodies
that others ask for move early, and those to which others hand forces are kicked late. In sampled steps the labeller looks."""
