"""Scratch arrays on the stack, for compiled functions that are called for few contacts.

`numpy.empty` takes memory from the heap and counts references: 60 ns, as long as a law takes for two contacts.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import lower_builtin, type_callable


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


@type_callable(stack_array)
def _typer(_context: Any) -> Callable:
    def typer(size: Any) -> Any:
        return types.Array(types.float64, 1, "C") if isinstance(size, types.IntegerLiteral) else None

    return typer


@lower_builtin(stack_array, types.IntegerLiteral)
def _lower(context: Any, builder: Any, sig: Any, _args: Any) -> Any:
    count = sig.args[0].literal_value
    with builder.goto_entry_block():  # one place however often it is reached; `cgutils.alloca_once` would fill it with zeros
        storage = builder.alloca(ir.ArrayType(ir.DoubleType(), count))
    storage.align = 64
    array = context.make_array(sig.return_type)(context, builder)
    context.populate_array(
        array,
        data=builder.bitcast(storage, ir.DoubleType().as_pointer()),
        shape=(context.get_constant(types.intp, count),),
        strides=(context.get_constant(types.intp, 8),),
        itemsize=context.get_constant(types.intp, 8),
        meminfo=None,
    )
    return array._getvalue()
