"""Parts of arrays of constant size, for compiled functions that are called per contact.

A slice counts references to its array and has a size that the compiler does not know.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
from numba import types
from numba.core import cgutils
from numba.extending import lower_builtin, type_callable


def array_part(array: np.ndarray, first: int, size: int) -> np.ndarray:
    """Return `size` elements of an array as a view of it.

    Parameters
    ----------
    array : numpy.ndarray
        (n,) float64, contiguous.
    first : int
        Index of the first element.
    size : int
        Number of elements; in compiled functions a literal or a constant of the module.

    Returns
    -------
    numpy.ndarray
        (size,) float64. Compiled code does not check that `array` has the elements, and must not use the view longer than it.
    """
    return array[first : first + size]


@type_callable(array_part)
def _typer(_context: Any) -> Callable:
    def typer(array: Any, first: Any, size: Any) -> Any:
        contiguous = isinstance(array, types.Array) and array.ndim == 1 and array.layout == "C"
        return array if contiguous and isinstance(first, types.Integer) and isinstance(size, types.IntegerLiteral) else None

    return typer


@lower_builtin(array_part, types.Array, types.Integer, types.IntegerLiteral)
def _lower(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    whole, size = context.make_array(sig.args[0])(context, builder, args[0]), sig.args[2].literal_value
    part = context.make_array(sig.return_type)(context, builder)
    item = context.get_constant(types.intp, 8)
    context.populate_array(
        part,
        data=cgutils.gep_inbounds(builder, whole.data, context.cast(builder, args[1], sig.args[1], types.intp)),
        shape=(context.get_constant(types.intp, size),),
        strides=(item,),
        itemsize=item,
        meminfo=None,
    )
    return part._getvalue()
