"""Numbers that several threads read and write, and waiting for them, in compiled functions.

What a thread wrote before it stores or adds with these functions is seen by the thread that reads the new number.
"""

import os
import platform
from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

WORDS = types.Array(types.int64, 1, "C")
"""Table of such numbers."""

_LONG, _INT = ir.IntType(64), ir.IntType(32)
_PAUSES: dict[str, tuple[str, list[int]]] = {
    **dict.fromkeys(("x86_64", "amd64"), ("llvm.x86.sse2.pause", [])),
    **dict.fromkeys(("aarch64", "arm64"), ("llvm.aarch64.hint", [1])),
}
"""LLVM's name and arguments of the instruction by kind of processor; others go on at once."""

_SLEEP, _SHORTEST = ("Sleep", 1) if os.name == "nt" else ("usleep", 20)
"""Function of the C library, and its argument for the shortest sleep: 1 ms, or some 70 us."""

_intrinsic: Any = intrinsic  # its annotations count the typing context as an argument


def _pointer(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    """Return the pointer to element `args[1]` of the table `args[0]`."""
    data = builder.extract_value(args[0], context.data_model_manager[sig.args[0]].get_field_position("data"))
    return builder.gep(data, [context.cast(builder, args[1], sig.args[1], types.int64)])


def _on_word(make: Callable[..., Any], result: Any, *others: Any) -> Callable[..., Any]:
    """Return an intrinsic function (words, position, ...) whose code `make(builder, pointer, ...)` writes."""

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        value = make(builder, _pointer(context, builder, sig, args), *args[2:])
        return context.get_dummy_value() if result == types.void else value

    return lambda words, at: (result(WORDS, at, *others), generate)


@_intrinsic
def load_word(typing: Any, words: Any, at: Any) -> Any:
    """Return a word."""
    return _on_word(lambda builder, pointer: builder.load_atomic(pointer, "acquire", 8), types.int64)(words, at)


@_intrinsic
def store_word(typing: Any, words: Any, at: Any, value: Any) -> Any:
    """Write a word."""
    return _on_word(
        lambda builder, pointer, value: builder.store_atomic(value, pointer, "release", 8), types.void, types.int64
    )(words, at)  # fmt: skip


@_intrinsic
def count_up(typing: Any, words: Any, at: Any) -> Any:
    """Add 1 to a word and return its value before."""
    return _on_word(lambda builder, pointer: builder.atomic_rmw("add", pointer, _LONG(1), "acq_rel"), types.int64)(words, at)


@_intrinsic
def pause(typing: Any) -> Any:
    """Let the core do something else for some 40 cycles."""

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        if platform.machine().lower() in _PAUSES:
            name, given = _PAUSES[platform.machine().lower()]
            kind = ir.FunctionType(ir.VoidType(), [_INT] * len(given))
            builder.call(cgutils.get_or_insert_function(builder.module, kind, name), [_INT(one) for one in given])
        return context.get_dummy_value()

    return types.void(), generate


@_intrinsic
def sleep(typing: Any) -> Any:
    """Sleep as briefly as the system allows, so that another thread can use the core."""

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        kind = ir.FunctionType(_INT, [_INT])
        builder.call(cgutils.get_or_insert_function(builder.module, kind, _SLEEP), [_INT(_SHORTEST)])
        return context.get_dummy_value()

    return types.void(), generate
