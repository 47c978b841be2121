"""Signatures of the functions that the engine calls through a pointer, so that it is compiled once for all laws."""

from numba import types

_TABLE = types.Array(types.float64, 2, "C")
_ROW = types.Array(types.float64, 1, "C")

LAW = types.void(_ROW, _ROW, types.int64, _ROW)
"""law(inputs, outputs, number of contacts in the tile, parameters of all pairs)"""

EFFECTS = types.void(_TABLE, types.int64, types.int64, types.float64, types.float64, _ROW)
"""effects(bodies, first, last, time, time step, parameters)"""

OBSERVE = types.void(_TABLE, types.int64, _ROW, _ROW)
"""observe(contacts of the body, how many, body, memory)"""

LABEL = types.void(_TABLE, types.int64, _ROW, _ROW, _ROW)
"""label(contacts of the body, how many, body, memory, out)"""
