"""Parts of arrays of constant size, for compiled functions that are called per contact.

A slice counts references to its array and has a size that the compiler does not know. The size is the first argument: integers
behind an array are indices for `numba_pipeline`, which types calls alike whatever their values.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
from numba import types
from numba.core import cgutils
from numba.extending import lower_builtin, type_callable


def array_part(size: int, array: np.ndarray, first: int) -> np.ndarray:
    """Return `size` elements of an array as a view of it.

    Parameters
    ----------
    size : int
        Number of elements; in compiled functions a literal or a constant of the module.
    array : numpy.ndarray
        (n,) float64, contiguous.
    first : int
        Index of the first element.

    Returns
    -------
    numpy.ndarray
        (size,) float64. Compiled code does not check that `array` has the elements, and must not use the view longer than it.
    """
    return array[first : first + size]


@type_callable(array_part)
def _typer(_context: Any) -> Callable:
    def typer(size: Any, array: Any, first: Any) -> Any:
        contiguous = isinstance(array, types.Array) and array.ndim == 1 and array.layout == "C"
        return array if contiguous and isinstance(first, types.Integer) and isinstance(size, types.IntegerLiteral) else None

    return typer


@lower_builtin(array_part, types.IntegerLiteral, types.Array, types.Integer)
def _lower(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    size, whole = sig.args[0].literal_value, context.make_array(sig.args[1])(context, builder, args[1])
    part = context.make_array(sig.return_type)(context, builder)
    item = context.get_constant(types.intp, 8)
    context.populate_array(
        part,
        data=cgutils.gep_inbounds(builder, whole.data, context.cast(builder, args[2], sig.args[2], types.intp)),
        shape=(context.get_constant(types.intp, size),),
        strides=(item,),
        itemsize=item,
        meminfo=None,
    )
    return part._getvalue()
