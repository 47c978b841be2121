"""How many floating-point operations a kernel of ours makes, counted in its code as numba typed it.

Rough: every branch counts as taken and every loop as run once, so that the count of a kernel with one loop is that of one round.
A vector of four is four operations. Copies, comparisons, signs and whatever moves numbers between lanes are none.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np
from numba import njit, types
from numba.core import ir

from thirdbody.jit.simd import LANES, cross, four

WIDTHS = {types.float64: 1, four: LANES}
CROSSED = 3 * LANES  # two products and a difference
ROOTS = (math.sqrt, np.sqrt)
COPIES = (float, np.float64)


class Operations(NamedTuple):
    """Sums, products, minima and the like; square roots; divisions."""

    simple: float = 0.0
    roots: float = 0.0
    divisions: float = 0.0

    def times(self, factor: float) -> Operations:
        """So many of them."""
        return Operations(*(factor * number for number in self))

    def plus(self, other: Operations) -> Operations:
        """These and others."""
        return Operations(*map(sum, zip(self, other, strict=True)))


def operations(kernel: Any) -> Operations:
    """What one call of a kernel makes that was compiled in this process. Raises ValueError if it was not."""
    results = list(kernel.overloads.values())
    if results and isinstance(results[0].type_annotation, str):  # it came from the cache, without its code
        again = njit(error_model="numpy")(kernel.py_func)
        again.compile(results[0].signature.args)
        results = list(again.overloads.values())
    if not results:
        raise ValueError(f"{kernel.__name__} was not compiled")
    return _counted(results[0].type_annotation)


def _counted(code: Any) -> Operations:
    found = Operations()
    for value in _expressions(code):
        kind = code.calltypes.get(value)
        if value.op == "call":
            found = found.plus(_call(code.typemap[value.func.name], kind))
        elif kind is not None and kind.return_type in WIDTHS:
            found = found.plus(_of_operator(value.fn).times(WIDTHS[kind.return_type]))
    return found


def _expressions(code: Any) -> Iterator[Any]:
    """Calls and operators between two numbers."""
    for block in code.blocks.values():
        for line in block.body:
            value = getattr(line, "value", None)
            if isinstance(value, ir.Expr) and value.op in ("call", "binop", "inplace_binop"):
                yield value


def _of_operator(symbol: Callable) -> Operations:
    if symbol in (operator.truediv, operator.itruediv):
        return Operations(divisions=1.0)
    return Operations(roots=1.0) if symbol is operator.pow else Operations(1.0)


def _call(callee: Any, kind: Any) -> Operations:
    """A call of another kernel of ours, or of a function that numba knows."""
    if isinstance(callee, types.Dispatcher):
        return operations(callee.dispatcher)
    key = getattr(callee, "typing_key", None)
    if key is cross:
        return Operations(float(CROSSED))
    if kind.return_type != types.float64 or key in COPIES or not _is_arithmetic(key):
        return Operations()
    return Operations(roots=1.0) if key in ROOTS else Operations(1.0)


def _is_arithmetic(key: Any) -> bool:
    """Whether it is a function of Python or numpy, and not one that only takes a lane of a vector."""
    return isinstance(key, np.ufunc) or getattr(key, "__module__", "") in ("builtins", "math", "numpy")
