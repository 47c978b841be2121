"""Vectors of four numbers (float64x4) for kernels that use the processor's vector arithmetic.

The compiler vectorises loops over fields by itself, but not copies between rows and fields, nor arithmetic on the few numbers of
one row. Each lane is IEEE arithmetic: the bits are those of scalar code.
"""

import inspect
import operator
from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils, errors
from numba.core.registry import cpu_target
from numba.core.typing.templates import ConcreteTemplate, infer_global, signature
from numba.extending import intrinsic, lower_builtin, models, register_model

LANES = 4

AHEAD = 16
"""Distance of a prefetch, in rows: some 0.5 us ahead. In tables larger than the cache this reduces a step by a fifth; 8 and 32
are as good."""

LINE = 8  # numbers in a cache line of the processor


VECTOR = LINE if "+avx512f" in cpu_target.target_context.codegen().magic_tuple()[2] else LANES
"""Numbers that a vectorised loop over fields computes at once; a remainder is computed one by one, each at the cost of all."""

_VECTOR = ir.VectorType(ir.DoubleType(), LANES)
_SPLIT = ir.IntType(32)
_BITS = ir.VectorType(ir.IntType(64), LANES)
_SHORTS = ir.VectorType(_SPLIT, LANES)
_BYTES = ir.VectorType(ir.IntType(8), LANES)
_POSITIONS = [_SHORTS([*(q for q in range(LANES) if bits >> q & 1), *[0] * (LANES - bits.bit_count())]) for bits in range(16)]
_INT = types.int64


class FourType(types.Type):
    def __init__(self) -> None:
        super().__init__("four")


four = FourType()


@register_model(FourType)
class _Model(models.PrimitiveModel):  # type: ignore[misc]
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, _VECTOR)


def _operator(symbol: Any, name: str) -> None:

    @infer_global(symbol)
    class _Template(ConcreteTemplate):  # type: ignore[misc]
        key = symbol
        cases = [signature(four, four, four)]

    @lower_builtin(symbol, FourType, FourType)
    def _lower(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return getattr(builder, name)(*args)


for _symbol, _name in ((operator.add, "fadd"), (operator.sub, "fsub"), (operator.mul, "fmul"), (operator.truediv, "fdiv")):
    _operator(_symbol, _name)


def _shuffle(builder: Any, a: Any, b: Any, lanes: list[int]) -> Any:
    return builder.shuffle_vector(a, b, ir.Constant(ir.VectorType(_SPLIT, len(lanes)), lanes))


def _four_times(builder: Any, x: Any) -> Any:
    one = builder.insert_element(ir.Constant(_VECTOR, ir.Undefined), x, _SPLIT(0))
    return _shuffle(builder, one, one, [0] * LANES)


def _declared(write: Callable, count: int, typed: Callable, literal: bool = False) -> Any:
    """Return an intrinsic function of `count` arguments; `typed(*kinds)` gives its signature and its code for their types."""

    def function(typing: Any, *kinds: Any) -> Any:
        return typed(*kinds)

    for name in ("__name__", "__doc__", "__qualname__"):
        setattr(function, name, getattr(write, name))
    names = ["typing", *(f"x_{k}" for k in range(count))]  # numba asks for the number of arguments
    parameters = [inspect.Parameter(name, inspect.Parameter.POSITIONAL_OR_KEYWORD) for name in names]
    function.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    make: Any = intrinsic(prefer_literal=literal)
    return make(function)


def _result(context: Any, sig: Any, value: Any) -> Any:
    return context.get_dummy_value() if sig.return_type == types.void else value


def code(sig: Any) -> Callable[[Callable], Any]:
    """Return a decorator that makes an intrinsic function of a signature from `write(builder, *values)`."""

    def typed(write: Callable) -> Callable:
        return lambda *_: (sig, lambda context, builder, sig, args: _result(context, sig, write(builder, *args)))

    return lambda write: _declared(write, len(sig.args), typed(write))


def _lane_code(result: Any) -> Callable[[Callable], Any]:
    """Return a decorator that makes an intrinsic function (vector, literal lane) from `write(builder, vector, lane)`."""

    def declare(write: Callable) -> Any:
        def typed(v: Any, k: Any) -> Any:
            if not isinstance(k, types.IntegerLiteral) or not 0 <= k.literal_value < LANES:
                raise errors.TypingError("a lane is a literal from 0 to 3")
            return result(v, k), lambda context, builder, sig, args: write(builder, args[0], int(k.literal_value))

        return _declared(write, 2, typed, literal=True)

    return declare


def memory_code(count: int, result: Any, *others: Any) -> Callable[[Callable], Any]:
    """Return a decorator that makes an intrinsic function (table, `count` indices, ...) from `write(builder, pointer, ...)`."""

    def declare(write: Callable) -> Any:
        def make(context: Any, builder: Any, sig: Any, args: Any) -> Any:
            fields = context.data_model_manager[sig.args[0]]
            index = [context.cast(builder, args[k], sig.args[k], types.intp) for k in range(1, count + 1)]
            at = index[0]
            for k in range(1, count):
                lengths = builder.extract_value(args[0], fields.get_field_position("shape"))
                at = builder.add(builder.mul(at, builder.extract_value(lengths, k)), index[k])
            pointer = builder.gep(builder.extract_value(args[0], fields.get_field_position("data")), [at])
            return _result(context, sig, write(builder, pointer, *args[count + 1 :]))

        number = 1 + count + len(others)
        return _declared(write, number, lambda *kinds: (result(*kinds[: count + 1], *others), make))

    return declare


@memory_code(2, four)
def load(builder: Any, pointer: Any) -> Any:
    """Load four numbers of row i of the table A from column c on: (A, i, c)."""
    return builder.load(builder.bitcast(pointer, _VECTOR.as_pointer()), align=8)


@memory_code(2, types.void, four)
def store(builder: Any, pointer: Any, v: Any) -> None:
    """Store v into row i of the table A from column c on: (A, i, c, v)."""
    builder.store(v, builder.bitcast(pointer, _VECTOR.as_pointer()), align=8)


@memory_code(1, four)
def get(builder: Any, pointer: Any) -> Any:
    """Load four numbers of a 1-D array from a place on: (G, at)."""
    return builder.load(builder.bitcast(pointer, _VECTOR.as_pointer()), align=8)


@memory_code(1, types.void, four)
def put(builder: Any, pointer: Any, v: Any) -> None:
    """Store v into a 1-D array from a place on: (G, at, v)."""
    builder.store(v, builder.bitcast(pointer, _VECTOR.as_pointer()), align=8)


@code(four(types.float64))
def broadcast(builder: Any, x: Any) -> Any:
    return _four_times(builder, x)


@code(four(*[types.float64] * LANES))
def set4(builder: Any, *numbers: Any) -> Any:
    v = ir.Constant(_VECTOR, ir.Undefined)
    for k in range(LANES):
        v = builder.insert_element(v, numbers[k], _SPLIT(k))
    return v


@_lane_code(types.float64)
def extract(builder: Any, v: Any, k: int) -> Any:
    """Return lane k of v, k a literal."""
    return builder.extract_element(v, _SPLIT(k))


@_lane_code(four)
def broadcast_lane(builder: Any, v: Any, k: int) -> Any:
    """Return lane k of v in all lanes, k a literal."""
    return _shuffle(builder, v, v, [k] * LANES)


@_lane_code(four)
def axis_times_quaternion(builder: Any, q: Any, axis: int) -> Any:
    """Return the product of the quaternion (w, x, y, z) and, from the left, the unit vector of an axis: 0, 1 or 2, a literal."""
    lanes = ([1 + LANES, 0, 3 + LANES, 2], [2 + LANES, 3, 0, 1 + LANES], [3 + LANES, 2 + LANES, 1, 0])[axis]
    return _shuffle(builder, q, builder.fneg(q), lanes)


@code(four(four, four))
def with_last(builder: Any, v: Any, w: Any) -> Any:
    """Return the first three lanes of v and the last one of w."""
    return _shuffle(builder, v, w, [0, 1, 2, 7])


@code(four(four, four))
def cross(builder: Any, v: Any, w: Any) -> Any:
    v_1, v_2 = (_shuffle(builder, v, v, lanes) for lanes in ([1, 2, 0, 3], [2, 0, 1, 3]))
    w_1, w_2 = (_shuffle(builder, w, w, lanes) for lanes in ([1, 2, 0, 3], [2, 0, 1, 3]))
    return builder.fsub(builder.fmul(v_1, w_2), builder.fmul(v_2, w_1))


@code(four(four))
def round_to_nearest(builder: Any, v: Any) -> Any:
    """Return v rounded to the nearest integers, halves to the even ones, as `np.rint`."""
    kind = ir.FunctionType(_VECTOR, [_VECTOR])
    return builder.call(cgutils.get_or_insert_function(builder.module, kind, f"llvm.rint.v{LANES}f64"), [v])


@code(_INT(four, four))
def less_mask(builder: Any, v: Any, w: Any) -> Any:
    """Return which lanes of v are smaller than those of w, as bits 0 to 3."""
    return builder.zext(builder.bitcast(builder.fcmp_ordered("<", v, w), ir.IntType(LANES)), ir.IntType(64))


@code(types.boolean(four, types.float64))
def all_below(builder: Any, v: Any, maximum: Any) -> Any:
    """Return whether all lanes of v are smaller than `maximum`; NaN is not."""
    each = builder.bitcast(builder.fcmp_ordered("<", v, _four_times(builder, maximum)), ir.IntType(LANES))
    return builder.icmp_unsigned("==", each, ir.Constant(ir.IntType(LANES), (1 << LANES) - 1))


@code(four(four, four, four, four))
def select_greater(builder: Any, v: Any, w: Any, yes: Any, no: Any) -> Any:
    """Return the lanes of `yes` where v > w, of `no` elsewhere."""
    return builder.select(builder.fcmp_ordered(">", v, w), yes, no)


@code(four(four, types.float64))
def clamp_below(builder: Any, v: Any, minimum: Any) -> Any:
    """Return v, with `minimum` in all lanes that are smaller; NaN is passed on."""
    floor = _four_times(builder, minimum)
    return builder.select(builder.fcmp_ordered("<", v, floor), floor, v)


@code(four(four, types.float64))
def flush_below(builder: Any, v: Any, minimum: Any) -> Any:
    """Return v, with 0 in all lanes of |v| <= `minimum`; NaN is passed on."""
    bits = builder.and_(builder.bitcast(v, _BITS), ir.Constant(_BITS, [(1 << 63) - 1] * LANES))  # without the sign
    low = builder.fcmp_ordered("<=", builder.bitcast(bits, _VECTOR), _four_times(builder, minimum))
    return builder.select(low, ir.Constant(_VECTOR, [0.0] * LANES), v)


@memory_code(1, _INT, four)
def active_bits(builder: Any, pointer: Any, v: Any) -> Any:
    """Return which lanes of v are positive (bits 0 to 3), and which are not though `closed[k:k + 4]`, bytes, was not 0 (bits 4 to
    7): (closed, k, v). Sets `closed` to 1 where v is positive, else to 0."""
    pointer = builder.bitcast(pointer, _BYTES.as_pointer())
    was, on = builder.load(pointer, align=1), builder.fcmp_ordered(">", v, _VECTOR([0.0] * LANES))
    builder.store(builder.zext(on, _BYTES), pointer, align=1)
    opened = builder.and_(builder.icmp_unsigned("!=", was, _BYTES([0] * LANES)), builder.not_(on))
    bits = [builder.zext(builder.bitcast(each, ir.IntType(LANES)), ir.IntType(64)) for each in (on, opened)]
    return builder.or_(bits[0], builder.shl(bits[1], ir.IntType(64)(LANES)))


@memory_code(1, _INT, _INT, _INT)
def compress_store(builder: Any, pointer: Any, k: Any, bits: Any) -> Any:
    """Write the numbers k to k + 3 whose bit is set into the list A from m on, (A, m, k, bits); return their number. The elements
    up to m + 3 are overwritten."""
    rows = cgutils.global_constant(builder, "places", ir.ArrayType(_SHORTS, len(_POSITIONS))(_POSITIONS))
    ahead = builder.load(builder.gep(rows, [_SPLIT(0), bits]))
    first = builder.insert_element(_SHORTS(ir.Undefined), builder.trunc(k, _SPLIT), _SPLIT(0))
    numbers = builder.add(_shuffle(builder, first, first, [0] * LANES), ahead)
    builder.store(numbers, builder.bitcast(pointer, _SHORTS.as_pointer()), align=4)
    return builder.ctpop(bits)


@code(types.UniTuple(four, LANES)(four, four, four, four))
def transpose(builder: Any, a: Any, b: Any, c: Any, d: Any) -> Any:
    low, high = _shuffle(builder, a, b, [0, 4, 1, 5]), _shuffle(builder, a, b, [2, 6, 3, 7])
    low_2, high_2 = _shuffle(builder, c, d, [0, 4, 1, 5]), _shuffle(builder, c, d, [2, 6, 3, 7])
    columns = [
        _shuffle(builder, low, low_2, [0, 1, 4, 5]), _shuffle(builder, low, low_2, [2, 3, 6, 7]),
        _shuffle(builder, high, high_2, [0, 1, 4, 5]), _shuffle(builder, high, high_2, [2, 3, 6, 7]),
    ]  # fmt: skip
    return cgutils.pack_array(builder, columns)


@memory_code(2, types.void)
def prefetch(builder: Any, pointer: Any) -> None:
    """Prefetch the cache line of a number that is needed soon, (A, i, c); nothing changes by it."""
    byte = ir.IntType(8).as_pointer()
    kind = ir.FunctionType(ir.VoidType(), [byte, _SPLIT, _SPLIT, _SPLIT])
    function = cgutils.get_or_insert_function(builder.module, kind, "llvm.prefetch.p0")
    builder.call(function, [builder.bitcast(pointer, byte), _SPLIT(0), _SPLIT(3), _SPLIT(1)])  # to read, near, data
