"""Arrays of constant size without references to count, for compiled functions that are called per contact: parts and scratch.

A slice counts references to its array and has a size that the compiler does not know; `numpy.empty` takes memory from the heap:
60 ns, as long as a law takes for two contacts.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import lower_builtin, type_callable

from thirdbody.jit.arguments import table_at


def array_part(size: int, array: np.ndarray, first: int) -> np.ndarray:
    """Return `size` elements of a contiguous array (n,) of float64, from element `first` on, as a view of it.

    `size`: in compiled functions a literal or a constant of the module. It is the first argument since integers behind an array
    are indices for `numba_pipeline`, which types calls alike whatever their values. Compiled code does not check that `array`
    has the elements, and must not use the view longer than it.
    """
    return array[first : first + size]


def stack_array(size: int) -> np.ndarray:
    """Return an array for scratch, on the stack of a compiled function.

    Parameters
    ----------
    size : int
        Number of elements; in compiled functions a literal or a constant of the module.

    Returns
    -------
    numpy.ndarray
        (size,) float64, of undefined contents. In compiled code it must not leave the function that calls this one.
    """
    return np.empty(size)


@type_callable(array_part)
def _type_part(_context: Any) -> Callable:
    def typer(size: Any, array: Any, first: Any) -> Any:
        contiguous = isinstance(array, types.Array) and array.ndim == 1 and array.layout == "C"
        return array if contiguous and isinstance(first, types.Integer) and isinstance(size, types.IntegerLiteral) else None

    return typer


@type_callable(stack_array)
def _type_stack(_context: Any) -> Callable:
    def typer(size: Any) -> Any:
        return types.Array(types.float64, 1, "C") if isinstance(size, types.IntegerLiteral) else None

    return typer


@lower_builtin(array_part, types.IntegerLiteral, types.Array, types.Integer)
def _lower_part(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    whole = context.make_array(sig.args[1])(context, builder, args[1])
    first = context.cast(builder, args[2], sig.args[2], types.intp)
    size = context.get_constant(types.intp, sig.args[0].literal_value)
    return table_at(context, builder, sig.return_type, cgutils.gep_inbounds(builder, whole.data, first), size)


@lower_builtin(stack_array, types.IntegerLiteral)
def _lower_stack(context: Any, builder: Any, sig: Any, _args: Any) -> Any:
    size = sig.args[0].literal_value
    with builder.goto_entry_block():  # one place however often it is reached; `cgutils.alloca_once` would fill it with zeros
        storage = builder.alloca(ir.ArrayType(ir.DoubleType(), size))
    storage.align = 64
    data = builder.bitcast(storage, ir.DoubleType().as_pointer())
    return table_at(context, builder, sig.return_type, data, context.get_constant(types.intp, size))
