"""Compiled functions passed to kernels as numbers, their addresses.

For a function argument numba looks up the address in every call, by unpacking the types of all its arguments, for 0.1 ms; a run
of few bodies makes ten steps in that time.
"""

from collections.abc import Callable
from typing import Any

from numba import types
from numba.core import cgutils
from numba.extending import intrinsic


def address(function: Any, signature: Any) -> int:
    """Return the address of the machine code of a compiled function. Keep the function alive as long as it may be called."""
    result = function.get_compile_result(signature)
    return int(result.library.get_pointer_to_function(result.fndesc.llvm_func_name))


def function_at(signature: Any) -> Callable[[int], Any]:
    """Return a function for kernels that turns an address into a callable of this signature."""
    kind = types.FunctionType(signature)
    make_intrinsic: Any = intrinsic

    @make_intrinsic
    def function(typing: Any, address: Any) -> Any:
        def make(context: Any, builder: Any, sig: Any, args: Any) -> Any:
            built = cgutils.create_struct_proxy(kind)(context, builder)
            built.c_addr = built.jit_addr = builder.inttoptr(args[0], cgutils.voidptr_t)
            built.py_addr = cgutils.get_null_value(built.py_addr.type)
            return built._getvalue()

        return kind(types.intp), make

    return function  # type: ignore[no-any-return]
