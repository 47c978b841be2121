"""Arguments of large kernels: all tables and numbers packed into one array, compiled functions as their addresses, scratch.

Compiling a function that passes fifty arguments costs a second; one array of integers costs nothing. The tables must stay alive
at the same addresses as long as the array may be used. For a function argument numba looks up the address in every call, by
unpacking the types of all its arguments, for 0.1 ms; a run of few bodies makes ten steps in that time.
"""

import operator
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.typing.templates import AttributeTemplate, infer_getattr
from numba.extending import intrinsic, lower_builtin, lower_getattr_generic, models, register_model, type_callable
from numba.np.numpy_support import as_dtype

Kinds = dict[str, Any]  # numba's types of the packed arguments, by name: contiguous arrays, and int64
PACKED = types.Array(types.int64, 1, "C")  # numba's type of packed arguments

_LONG = ir.IntType(64)
_intrinsic: Any = intrinsic  # its annotations count the typing context as an argument


def address(function: Any, signature: Any) -> int:
    """Return the address of the machine code of a compiled function. Keep the function alive as long as it may be called."""
    result = function.get_compile_result(signature)
    return int(result.library.get_pointer_to_function(result.fndesc.llvm_func_name))


def function_at(signature: Any) -> Callable[[int], Any]:
    """Return a function for kernels that turns an address into a callable of this signature."""
    kind = types.FunctionType(signature)

    @_intrinsic
    def function(typing: Any, address: Any) -> Any:
        def make(context: Any, builder: Any, sig: Any, args: Any) -> Any:
            built = cgutils.create_struct_proxy(kind)(context, builder)
            built.c_addr = built.jit_addr = builder.inttoptr(args[0], cgutils.voidptr_t)
            built.py_addr = cgutils.get_null_value(built.py_addr.type)
            return built._getvalue()

        return kind(types.intp), make

    return function  # type: ignore[no-any-return]


def first_words(kinds: Kinds) -> dict[str, int]:
    """Return which word of the packed arguments is the first one of each, by name: of a table its address; its shape follows."""
    counts = [1 + getattr(kind, "ndim", 0) for kind in kinds.values()]
    return dict(zip(kinds, np.concatenate(([0], np.cumsum(counts)[:-1])).tolist(), strict=True))


class Packer:
    """Packs the arguments of a kernel into int64: addresses, shapes and scalars; anew (30 us) only where one was replaced."""

    def __init__(self, kinds: Kinds) -> None:
        self._specs = [
            (name, as_dtype(kind.dtype), kind.ndim) if isinstance(kind, types.Array) else None for name, kind in kinds.items()
        ]
        self.given: Any = None  # the last ones; they keep the tables alive
        self._packed = np.zeros(0, np.int64)

    def __getstate__(self) -> dict[str, Any]:  # a copy packs its own tables
        return {"_specs": self._specs, "given": None, "_packed": np.zeros(0, np.int64)}

    def __call__(self, given: NamedTuple) -> np.ndarray:
        """Return the packed arguments, one per kind. Raises TypeError for a table of another dtype, dimension or layout."""
        if self.given is None or any(map(operator.is_not, given, self.given)):
            words: list[int] = []
            for spec, value in zip(self._specs, given, strict=True):
                if spec is None:
                    words.append(value)
                    continue
                name, kind, dimensions = spec
                if value.dtype != kind or value.ndim != dimensions or not value.flags.c_contiguous:
                    given_as = f"{value.dtype}, of shape {value.shape}, strides {value.strides}"
                    raise TypeError(f"{name} is {given_as}; the step takes {kind}")
                words += (value.__array_interface__["data"][0], *value.shape)
            self.given, self._packed = given, np.array(words, np.int64)
        return self._packed


class Unpacked(types.Type):  # type: ignore[misc]
    """Numba's type of packed arguments that are read by name: a pointer, from which a field is loaded where it is used.

    A named tuple of sixty tables would be four hundred arguments of each function that takes it. `names`: the named tuple that
    these arguments are in Python. Unless `changing`, words must not change while a compiled function may read them: they are
    loaded as invariant."""

    def __init__(self, kinds: Kinds, names: type, changing: bool = False) -> None:
        super().__init__(name=f"{'changing' if changing else 'unpacked'} {names.__name__}")
        self.kinds, self.words, self.changing = kinds, first_words(kinds), changing


register_model(Unpacked)(models.OpaqueModel)


@infer_getattr
class _Fields(AttributeTemplate):  # type: ignore[misc]
    key = Unpacked

    def generic_resolve(self, kind: Any, name: str) -> Any:  # type: ignore[override]
        return kind.kinds.get(name)


@lower_getattr_generic(Unpacked)
def _load_field(context: Any, builder: Any, kind: Any, value: Any, name: str) -> Any:
    first, numbers, field = builder.bitcast(value, _LONG.as_pointer()), [], kind.kinds[name]
    for k in range(1 + getattr(field, "ndim", 0)):
        number = builder.load(builder.gep(first, [_LONG(kind.words[name] + k)]))
        if not kind.changing:
            number.set_metadata("invariant.load", builder.module.add_metadata([]))
        numbers.append(number)
    if len(numbers) == 1:
        return numbers[0]
    data = builder.inttoptr(numbers[0], context.get_data_type(field.dtype).as_pointer())
    return table_at(context, builder, field, data, *numbers[1:])


def make_unpacker(unpacked: Unpacked) -> Any:
    @_intrinsic
    def function(typing: Any, rows: Any) -> Any:
        def make(context: Any, builder: Any, sig: Any, args: Any) -> Any:
            first = builder.extract_value(args[0], context.data_model_manager[sig.args[0]].get_field_position("data"))
            return builder.bitcast(first, context.get_value_type(unpacked))

        return unpacked(PACKED), make

    return function


def make_view(unpacked: Unpacked) -> Any:
    @_intrinsic
    def function(typing: Any, given: Any) -> Any:
        return unpacked(given), lambda context, builder, sig, args: args[0]

    return function


def table_at(context: Any, builder: Any, kind: Any, data: Any, *lengths: Any) -> Any:
    model, size = context.data_model_manager[kind], _LONG(as_dtype(kind.dtype).itemsize)
    strides: list[Any] = []
    step = size
    for length in reversed(lengths):
        strides.insert(0, step)
        step = builder.mul(step, length)
    parts = {
        "nitems": builder.sdiv(step, size), "itemsize": size, "data": data,
        "shape": cgutils.pack_array(builder, lengths), "strides": cgutils.pack_array(builder, strides),
    }  # fmt: skip
    table = context.get_value_type(kind)(None)
    for name, part in parts.items():
        table = builder.insert_value(table, part, model.get_field_position(name))
    return table


# -- arrays of constant size without references to count, for functions that are called per contact: parts and scratch. A slice
# counts references to its array and has a size that the compiler does not know; `numpy.empty` takes memory from the heap: 60 ns,
# as long as a law takes for two contacts --


def array_part(size: int, array: np.ndarray, first: int) -> np.ndarray:
    """Return `size` elements of a contiguous array (n,) of float64, from element `first` on, as a view of it.

    `size`: in
    compiled functions a literal or a constant of the module, and the first argument, since integers behind an array are indices
    for `numba_pipeline`. Compiled code does not check that `array` has the elements, and must not use the view longer."""
    return array[first : first + size]


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


@type_callable(array_part)
def _type_part(_context: Any) -> Callable:
    def typer(size: Any, array: Any, first: Any) -> Any:
        contiguous = isinstance(array, types.Array) and array.ndim == 1 and array.layout == "C"
        return array if contiguous and isinstance(first, types.Integer) and isinstance(size, types.IntegerLiteral) else None

    return typer


@type_callable(stack_array)
def _type_stack(_context: Any) -> Callable:
    def typer(size: Any) -> Any:
        return types.Array(types.float64, 1, "C") if isinstance(size, types.IntegerLiteral) else None

    return typer


@lower_builtin(array_part, types.IntegerLiteral, types.Array, types.Integer)
def _lower_part(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    whole = context.make_array(sig.args[1])(context, builder, args[1])
    first = context.cast(builder, args[2], sig.args[2], types.intp)
    size = context.get_constant(types.intp, sig.args[0].literal_value)
    return table_at(context, builder, sig.return_type, cgutils.gep_inbounds(builder, whole.data, first), size)


@lower_builtin(stack_array, types.IntegerLiteral)
def _lower_stack(context: Any, builder: Any, sig: Any, _args: Any) -> Any:
    size = sig.args[0].literal_value
    with builder.goto_entry_block():  # one place however often it is reached; `cgutils.alloca_once` would fill it with zeros
        storage = builder.alloca(ir.ArrayType(ir.DoubleType(), size))
    storage.align = 64
    data = builder.bitcast(storage, ir.DoubleType().as_pointer())
    return table_at(context, builder, sig.return_type, data, context.get_constant(types.intp, size))
