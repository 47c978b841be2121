"""Scratch arrays on the stack, for compiled functions that are called for few contacts.

`numpy.empty` takes memory from the heap and counts references: 60 ns, as long as a law takes for two contacts.
"""

from typing import Any

from llvmlite import ir
from numba import types
from numba.extending import intrinsic

_intrinsic: Any = intrinsic  # its annotations count the typing context as an argument


@_intrinsic(prefer_literal=True)
def stack_array(typing: Any, size: Any) -> Any:
    """stack_array(size): an array (size,) of float64 with undefined contents; `size`: a literal.

    It must not leave the function that calls this one.
    """
    if not isinstance(size, types.IntegerLiteral):
        return None
    count = size.literal_value

    def make(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        kind = sig.return_type
        with builder.goto_entry_block():  # one place however often it is reached; `cgutils.alloca_once` would fill it with zeros
            storage = builder.alloca(ir.ArrayType(ir.DoubleType(), count))
        storage.align = 64
        array = context.make_array(kind)(context, builder)
        context.populate_array(
            array,
            data=builder.bitcast(storage, ir.DoubleType().as_pointer()),
            shape=(context.get_constant(types.intp, count),),
            strides=(context.get_constant(types.intp, 8),),
            itemsize=context.get_constant(types.intp, 8),
            meminfo=None,
        )
        return array._getvalue()

    return types.Array(types.float64, 1, "C")(size), make
