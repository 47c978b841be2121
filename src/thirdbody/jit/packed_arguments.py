"""All tables and numbers that a step needs, packed into one array of addresses, shapes and scalars.

Compiling a function that passes fifty arguments costs a second; one array of integers costs nothing. The tables must stay alive
at the same addresses as long as the array may be used.
"""

import operator
from typing import Any, NamedTuple

import numpy as np
from llvmlite import ir
from numba import types
from numba.core.typing.templates import AttributeTemplate, infer_getattr
from numba.extending import intrinsic, lower_getattr_generic, models, register_model
from numba.np.numpy_support import as_dtype

Kinds = dict[str, Any]
"""Numba's types of the packed arguments, by name: contiguous arrays, and int64."""

PACKED = types.Array(types.int64, 1, "C")
"""Numba's type of packed arguments."""

_LONG = ir.IntType(64)


def _word_count(kind: Any) -> int:
    """Return the number of words of one argument: address and shape of a table, or the scalar itself."""
    return 1 + (kind.ndim if isinstance(kind, types.Array) else 0)


def argument_specs(kinds: Kinds) -> tuple[tuple[str, np.dtype | None, int], ...]:
    """Return name, dtype and number of dimensions of each table; the dtype of a scalar is None."""
    return tuple(
        (name, as_dtype(kind.dtype), kind.ndim) if isinstance(kind, types.Array) else (name, None, 0)
        for name, kind in kinds.items()
    )


def first_words(kinds: Kinds) -> dict[str, int]:
    """Return which word of the packed arguments is the first one of each, by name: the address, of a table."""
    counts = [_word_count(kind) for kind in kinds.values()]
    return dict(zip(kinds, np.concatenate(([0], np.cumsum(counts)[:-1])).tolist(), strict=True))


def pack(expected: tuple[tuple[str, np.dtype | None, int], ...], given: NamedTuple) -> np.ndarray:
    """Pack `given` (one field per entry of `expected`) into int64: addresses, shapes and scalars.

    Raises TypeError for a table of another dtype, number of dimensions or layout.
    """
    rows: list[int] = []
    for (name, kind, dimensions), value in zip(expected, given, strict=True):
        if kind is None:
            rows.append(value)
            continue
        if value.dtype != kind or value.ndim != dimensions or not value.flags.c_contiguous:
            raise TypeError(f"{name} is {value.dtype}, of shape {value.shape}, strides {value.strides}; the step takes {kind}")
        rows.append(value.__array_interface__["data"][0])
        rows += value.shape
    return np.array(rows, np.int64)


class Packer:
    """Packs the arguments of a kernel; packed anew (30 us) only where one of them was replaced."""

    def __init__(self, kinds: Kinds) -> None:
        self._specs = argument_specs(kinds)
        self.given: Any = None  # the last ones; they keep the tables alive
        self._packed = np.zeros(0, np.int64)

    def __getstate__(self) -> dict[str, Any]:
        """Return the state of a copy: it packs its own tables, since the addresses here are those of the original."""
        return {"_specs": self._specs, "given": None, "_packed": np.zeros(0, np.int64)}

    def __call__(self, given: NamedTuple) -> np.ndarray:
        """Return the packed arguments (`pack`)."""
        if self.given is None or any(map(operator.is_not, given, self.given)):
            self.given, self._packed = given, pack(self._specs, given)
        return self._packed


class Unpacked(types.Type):  # type: ignore[misc]
    """Numba's type of packed arguments that are read by name: a pointer, from which a field is loaded where it is used.

    A named tuple of sixty tables would be four hundred arguments of each function that takes it: the engine compiles in half the
    time this way. Unless `changing`, words must not change while a compiled function may read them: they are loaded as invariant.
    """

    def __init__(self, name: str, kinds: Kinds, changing: bool) -> None:
        super().__init__(name=f"{'changing' if changing else 'unpacked'} {name}")
        self.kinds, self.words, self.changing = kinds, first_words(kinds), changing


register_model(Unpacked)(models.OpaqueModel)


@infer_getattr
class _Fields(AttributeTemplate):  # type: ignore[misc]
    key = Unpacked

    def generic_resolve(self, kind: Any, name: str) -> Any:
        """Return the type of a field; None if there is none of that name."""
        return kind.kinds.get(name)


@lower_getattr_generic(Unpacked)
def _load_field(context: Any, builder: Any, kind: Any, value: Any, name: str) -> Any:
    first, numbers = builder.bitcast(value, _LONG.as_pointer()), []
    for k in range(_word_count(kind.kinds[name])):
        number = builder.load(builder.gep(first, [_LONG(kind.words[name] + k)]))
        if not kind.changing:
            number.set_metadata("invariant.load", builder.module.add_metadata([]))
        numbers.append(number)
    return _table(context, builder, kind.kinds[name], *numbers) if len(numbers) > 1 else numbers[0]


def make_unpacker(kinds: Kinds, names: type, changing: bool = False) -> Any:
    """Return a function for kernels that makes the fields of packed arguments readable by name, as in the named tuple `names`."""
    unpacked = Unpacked(names.__name__, kinds, changing)
    make_intrinsic: Any = intrinsic

    @make_intrinsic
    def function(typing: Any, rows: Any) -> Any:
        def make(context: Any, builder: Any, sig: Any, args: Any) -> Any:
            first = builder.extract_value(args[0], context.data_model_manager[sig.args[0]].get_field_position("data"))
            return builder.bitcast(first, context.get_value_type(unpacked))

        return unpacked(PACKED), make

    return function


def _table(context: Any, builder: Any, kind: Any, address: Any, *lengths: Any) -> Any:
    """Return the table at an address, without reference counting."""
    model, size = context.data_model_manager[kind], _LONG(as_dtype(kind.dtype).itemsize)
    strides: list[Any] = []
    step = size
    for length in reversed(lengths):
        strides.insert(0, step)
        step = builder.mul(step, length)
    parts = {
        "nitems": builder.sdiv(step, size), "itemsize": size, "shape": _row(builder, lengths), "strides": _row(builder, strides),
        "data": builder.inttoptr(address, context.get_data_type(kind.dtype).as_pointer()),
    }  # fmt: skip
    table = context.get_value_type(kind)(None)
    for name, part in parts.items():
        table = builder.insert_value(table, part, model.get_field_position(name))
    return table


def _row(builder: Any, values: Any) -> Any:
    row = ir.ArrayType(_LONG, len(values))(ir.Undefined)
    for k, value in enumerate(values):
        row = builder.insert_value(row, value, k)
    return row
