"""Vectors of four numbers (float64x4) for kernels that use the processor's vector arithmetic.

The compiler vectorises loops over fields by itself, but not copies between rows and fields, nor arithmetic on the few numbers of
one row. Each lane is IEEE arithmetic: the bits are those of scalar code.
"""

import operator
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

LINE = 8
"""Numbers in a cache line of the processor."""


def _vector_length() -> int:
    """Return how many numbers a pass over fields computes at once in the code that numba makes: 8 with AVX-512, else 4."""
    return LINE if "+avx512f" in cpu_target.target_context.codegen().magic_tuple()[2] else LANES


VECTOR = _vector_length()
"""Numbers that a vectorised loop over fields computes at once; a remainder is computed one by one, each at the cost of all."""

_VECTOR = ir.VectorType(ir.DoubleType(), LANES)
_SPLIT = ir.IntType(32)
_BITS = ir.VectorType(ir.IntType(64), LANES)
_SHORTS = ir.VectorType(_SPLIT, LANES)
_BYTES = ir.VectorType(ir.IntType(8), LANES)
_POSITIONS = [_SHORTS([*(q for q in range(LANES) if bits >> q & 1), *[0] * (LANES - bits.bit_count())]) for bits in range(16)]


_intrinsic: Any = intrinsic  # its annotations count the typing context as an argument


class FourType(types.Type):
    """The numba type of a vector of four numbers."""

    def __init__(self) -> None:
        super().__init__("four")


four = FourType()


@register_model(FourType)
class _Model(models.PrimitiveModel):  # type: ignore[misc]
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, _VECTOR)


def _operator(symbol: Any, name: str) -> None:
    """Register an operator between two vectors with numba."""

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


def _pointer_to(context: Any, builder: Any, kind: Any, table: Any, index: list[Any]) -> Any:
    """Return the pointer to four numbers of a table, which need not be aligned."""
    return builder.bitcast(_number(context, builder, kind, table, index), _VECTOR.as_pointer())


def _number(context: Any, builder: Any, kind: Any, table: Any, index: list[Any]) -> Any:
    """Return the pointer to a number of a contiguous table."""
    fields, at = context.data_model_manager[kind], index[0]
    for k in range(1, kind.ndim):
        lengths = builder.extract_value(table, fields.get_field_position("shape"))
        at = builder.add(builder.mul(at, builder.extract_value(lengths, k)), index[k])
    return builder.gep(builder.extract_value(table, fields.get_field_position("data")), [at])


def _lane_number(kind: Any) -> int:
    if not isinstance(kind, types.IntegerLiteral) or not 0 <= kind.literal_value < LANES:
        raise errors.TypingError("a lane is a literal from 0 to 3")
    return int(kind.literal_value)


def _index(context: Any, builder: Any, sig: Any, args: Any, which: range) -> list[Any]:
    return [context.cast(builder, args[k], sig.args[k], types.intp) for k in which]


@_intrinsic
def load(typing: Any, A: Any, i: Any, c: Any) -> Any:
    """Load four numbers of row i of the table A from column c on."""

    def make(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        pointer = _pointer_to(context, builder, sig.args[0], args[0], _index(context, builder, sig, args, range(1, 3)))
        return builder.load(pointer, align=8)

    return four(A, i, c), make


@_intrinsic
def store(typing: Any, A: Any, i: Any, c: Any, v: Any) -> Any:
    """Store v into row i of the table A from column c on."""

    def make(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        pointer = _pointer_to(context, builder, sig.args[0], args[0], _index(context, builder, sig, args, range(1, 3)))
        builder.store(args[3], pointer, align=8)
        return context.get_dummy_value()

    return types.void(A, i, c, v), make


@_intrinsic
def get(typing: Any, G: Any, at: Any) -> Any:
    """Load four numbers of a 1-D array from `at` on."""

    def make(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        pointer = _pointer_to(context, builder, sig.args[0], args[0], _index(context, builder, sig, args, range(1, 2)))
        return builder.load(pointer, align=8)

    return four(G, at), make


@_intrinsic
def put(typing: Any, G: Any, at: Any, v: Any) -> Any:
    """Store v into a 1-D array from `at` on."""

    def make(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        pointer = _pointer_to(context, builder, sig.args[0], args[0], _index(context, builder, sig, args, range(1, 2)))
        builder.store(args[2], pointer, align=8)
        return context.get_dummy_value()

    return types.void(G, at, v), make


@_intrinsic
def broadcast(typing: Any, x: Any) -> Any:
    """Return x in all lanes."""

    def make(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return _four_times(builder, args[0])

    return four(types.float64), make


@_intrinsic
def set4(typing: Any, x: Any, y: Any, z: Any, w: Any) -> Any:
    """Return the vector (x, y, z, w)."""

    def make(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        v = ir.Constant(_VECTOR, ir.Undefined)
        for k in range(LANES):
            v = builder.insert_element(v, args[k], _SPLIT(k))
        return v

    return four(*[types.float64] * LANES), make


@_intrinsic(prefer_literal=True)
def extract(typing: Any, v: Any, k: Any) -> Any:
    """Return lane k of v, k a literal."""
    number = _lane_number(k)

    def make(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return builder.extract_element(args[0], _SPLIT(number))

    return types.float64(v, k), make


@_intrinsic(prefer_literal=True)
def broadcast_lane(typing: Any, v: Any, k: Any) -> Any:
    """Return lane k of v in all lanes, k a literal."""
    number = _lane_number(k)

    def make(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return _shuffle(builder, args[0], args[0], [number] * LANES)

    return four(v, k), make


@_intrinsic
def with_last(typing: Any, v: Any, w: Any) -> Any:
    """Return the first three lanes of v and the last one of w."""

    def make(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return _shuffle(builder, args[0], args[1], [0, 1, 2, 7])

    return four(v, w), make


@_intrinsic
def cross(typing: Any, v: Any, w: Any) -> Any:
    """Return the cross product of the first three lanes of v and of w."""

    def make(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        a, b = args
        a_1, a_2 = (_shuffle(builder, a, a, lanes) for lanes in ([1, 2, 0, 3], [2, 0, 1, 3]))
        b_1, b_2 = (_shuffle(builder, b, b, lanes) for lanes in ([1, 2, 0, 3], [2, 0, 1, 3]))
        return builder.fsub(builder.fmul(a_1, b_2), builder.fmul(a_2, b_1))

    return four(v, w), make


@_intrinsic(prefer_literal=True)
def axis_times_quaternion(typing: Any, q: Any, axis: Any) -> Any:
    """Return the product of the unit vector of an axis (0, 1 or 2, a literal) and the quaternion (w, x, y, z)."""
    number = _lane_number(axis)
    lanes = ([1 + LANES, 0, 3 + LANES, 2], [2 + LANES, 3, 0, 1 + LANES], [3 + LANES, 2 + LANES, 1, 0])[number]

    def make(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return _shuffle(builder, args[0], builder.fneg(args[0]), lanes)

    return four(q, axis), make


@_intrinsic
def round_to_nearest(typing: Any, v: Any) -> Any:
    """Return v rounded to the nearest integers, halves to the even ones, as `np.rint`."""

    def make(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        kind = ir.FunctionType(_VECTOR, [_VECTOR])
        return builder.call(cgutils.get_or_insert_function(builder.module, kind, f"llvm.rint.v{LANES}f64"), args)

    return four(v), make


@_intrinsic
def less_mask(typing: Any, v: Any, w: Any) -> Any:
    """Return which lanes of v are smaller than those of w, as bits 0 to 3."""

    def make(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        each = builder.bitcast(builder.fcmp_ordered("<", *args), ir.IntType(LANES))
        return builder.zext(each, ir.IntType(64))

    return types.int64(v, w), make


@_intrinsic
def all_below(typing: Any, v: Any, maximum: Any) -> Any:
    """Return whether all lanes of v are smaller than `maximum`; NaN is not."""

    def make(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        each = builder.bitcast(builder.fcmp_ordered("<", args[0], _four_times(builder, args[1])), ir.IntType(LANES))
        return builder.icmp_unsigned("==", each, ir.Constant(ir.IntType(LANES), (1 << LANES) - 1))

    return types.boolean(v, types.float64), make


@_intrinsic
def select_greater(typing: Any, v: Any, w: Any, yes: Any, no: Any) -> Any:
    """Return the lanes of `yes` where v > w, of `no` elsewhere."""

    def make(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return builder.select(builder.fcmp_ordered(">", args[0], args[1]), args[2], args[3])

    return four(v, w, yes, no), make


@_intrinsic
def clamp_below(typing: Any, v: Any, minimum: Any) -> Any:
    """Return v, with `minimum` in all lanes that are smaller; NaN is passed on."""

    def make(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        floor = _four_times(builder, args[1])
        return builder.select(builder.fcmp_ordered("<", args[0], floor), floor, args[0])

    return four(v, types.float64), make


@_intrinsic
def flush_below(typing: Any, v: Any, minimum: Any) -> Any:
    """Return v, with 0 in all lanes of |v| <= `minimum`; NaN is passed on."""

    def make(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        bits = builder.and_(builder.bitcast(args[0], _BITS), ir.Constant(_BITS, [(1 << 63) - 1] * LANES))  # without the sign
        size = builder.bitcast(bits, _VECTOR)
        low = builder.fcmp_ordered("<=", size, _four_times(builder, args[1]))
        return builder.select(low, ir.Constant(_VECTOR, [0.0] * LANES), args[0])

    return four(v, types.float64), make


@_intrinsic
def active_bits(typing: Any, v: Any, closed: Any, k: Any) -> Any:
    """Return which lanes of v are positive (bits 0 to 3), and which ceased to be (bits 4 to 7).

    The latter are not positive though `closed[k:k + 4]`, bytes, was not 0. Sets `closed` to 1 where v is positive, else to 0.
    """

    def make(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        pointer = _number(context, builder, sig.args[1], args[1], _index(context, builder, sig, args, range(2, 3)))
        pointer = builder.bitcast(pointer, _BYTES.as_pointer())
        was, on = builder.load(pointer, align=1), builder.fcmp_ordered(">", args[0], _VECTOR([0.0] * LANES))
        builder.store(builder.zext(on, _BYTES), pointer, align=1)
        opened = builder.and_(builder.icmp_unsigned("!=", was, _BYTES([0] * LANES)), builder.not_(on))
        bits = [builder.zext(builder.bitcast(each, ir.IntType(LANES)), ir.IntType(64)) for each in (on, opened)]
        return builder.or_(bits[0], builder.shl(bits[1], ir.IntType(64)(LANES)))

    return types.int64(v, closed, k), make


@_intrinsic
def compress_store(typing: Any, A: Any, m: Any, k: Any, bits: Any) -> Any:
    """Write the numbers k to k + 3 whose bit is set into the list A from m on; return their number.

    The elements after them, up to m + 3, are overwritten with undefined values.
    """

    def make(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        pointer = _number(context, builder, sig.args[0], args[0], _index(context, builder, sig, args, range(1, 2)))
        rows = cgutils.global_constant(builder, "places", ir.ArrayType(_SHORTS, len(_POSITIONS))(_POSITIONS))
        ahead = builder.load(builder.gep(rows, [_SPLIT(0), args[3]]))
        first = builder.insert_element(_SHORTS(ir.Undefined), builder.trunc(args[2], _SPLIT), _SPLIT(0))
        numbers = builder.add(_shuffle(builder, first, first, [0] * LANES), ahead)
        builder.store(numbers, builder.bitcast(pointer, _SHORTS.as_pointer()), align=4)
        return builder.ctpop(args[3])

    return types.int64(A, m, k, bits), make


@_intrinsic
def transpose(typing: Any, a: Any, b: Any, c: Any, d: Any) -> Any:
    """Return rows as columns: the first numbers of a, b, c and d, the second ones, and so on."""

    def make(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        a, b, c, d = args
        low, high = _shuffle(builder, a, b, [0, 4, 1, 5]), _shuffle(builder, a, b, [2, 6, 3, 7])
        low_2, high_2 = _shuffle(builder, c, d, [0, 4, 1, 5]), _shuffle(builder, c, d, [2, 6, 3, 7])
        columns = [
            _shuffle(builder, low, low_2, [0, 1, 4, 5]), _shuffle(builder, low, low_2, [2, 3, 6, 7]),
            _shuffle(builder, high, high_2, [0, 1, 4, 5]), _shuffle(builder, high, high_2, [2, 3, 6, 7]),
        ]  # fmt: skip
        return context.make_tuple(builder, sig.return_type, columns)

    return types.UniTuple(four, LANES)(a, b, c, d), make


@_intrinsic
def prefetch(typing: Any, A: Any, i: Any, c: Any) -> Any:
    """Prefetch the cache line of a number that is needed soon; nothing changes by it."""

    def make(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        pointer = _number(context, builder, sig.args[0], args[0], _index(context, builder, sig, args, range(1, 3)))
        byte = ir.IntType(8).as_pointer()
        kind = ir.FunctionType(ir.VoidType(), [byte, _SPLIT, _SPLIT, _SPLIT])
        function = cgutils.get_or_insert_function(builder.module, kind, "llvm.prefetch.p0")
        builder.call(function, [builder.bitcast(pointer, byte), _SPLIT(0), _SPLIT(3), _SPLIT(1)])  # to read, near, data
        return context.get_dummy_value()

    return types.void(A, i, c), make
