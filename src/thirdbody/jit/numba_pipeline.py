"""A shorter numba pipeline for our kernels: without unneeded passes, with cached types of calls.

numba queries all templates of an operator wherever it is used, which is a third of its time; it compares two sets of compiler
options by making dictionaries of them; and it treats every function as one that Python may call: it generates machine code for it
and runs passes for closures, `with` blocks and array expressions. Callers use the intermediate code only, so no bit of a result
depends on any of this. It depends on numba's internals, so it is used only with tested versions: with any other our kernels are
compiled by numba's own, longer pipeline.
"""

import functools
import operator
from collections import Counter
from types import ModuleType
from typing import Any

import numba
from numba import types
from numba.core import codegen, compiler, compiler_machinery, event, ir, targetconfig, typed_passes
from numba.core.typing import signature

from thirdbody.jit.cache import TESTED
from thirdbody.jit.numba_lowering import KernelLowering, ShortLowering, plain_extreme

PASSES = (
    "TranslateByteCode", "FixupArgs", "IRProcessing", "NumbersOfModules", "RewriteSemanticConstants", "DeadBranchPrune",
    "GenericRewrites", "ReconstructSSA", "NopythonTypeInference", "PreLowerStripPhis", "IRLegalization", "AnnotateTypes",
    "NativeLowering", "NoPythonBackend",
)  # fmt: skip
PLAIN = {operator.add, operator.sub, operator.mul, operator.truediv, operator.lt, operator.le, operator.gt, operator.ge}
"""Operators to which a literal number is like any other of its type."""

_original_call_type = types.BaseFunction.get_call_type
_answers: dict[Any, tuple[Any, Any]] = {}


def _get_call_type(self: Any, context: Any, args: Any, kws: Any) -> Any:
    """Return the cached result of `BaseFunction.get_call_type`. All integers that index a table share an entry."""
    if kws or not args:
        return _original_call_type(self, context, args, kws)
    if plain_extreme(self, args) and isinstance(targetconfig.ConfigStack.top_or_none(), _Flags):
        return signature(types.float64, *args)
    alike = isinstance(args[0], types.Array) or self.typing_key in PLAIN and all(isinstance(a, types.Number) for a in args)
    unliteral = tuple(types.unliteral(a) for a in args) if alike else tuple(args)
    key = id(self), id(context), unliteral, targetconfig.ConfigStack.top_or_none()
    result = _answers.get(key)
    if result is None:  # keep `self` alive, or another object could get its id
        result = _answers[key] = (_original_call_type(self, context, args, kws), self)
    return result[0]


_original_function_type = types.Dispatcher.get_call_type


def _get_function_type(self: Any, context: Any, args: Any, kws: Any) -> Any:
    """Return the type of a call of a compiled function, which is compiled once for all literal numbers: it is inlined anyway."""
    if isinstance(targetconfig.ConfigStack.top_or_none(), _Flags):
        args = tuple(types.unliteral(one) for one in args)
    return _original_function_type(self, context, args, kws)


def _list_variables(self: Any, value: Any) -> list[Any]:
    """Do as `Inst._rec_list_vars`, in less than half the time."""
    variables: list[Any] = []
    for one in value.values() if type(value) is dict else value if type(value) in (list, tuple) else (value,):
        kind = type(one)
        if kind is ir.Var:
            variables.append(one)
        elif kind in (dict, list, tuple):
            variables += _list_variables(self, one)
        elif isinstance(one, ir.Inst):
            variables += one.list_vars()
    return variables


SHORTER: tuple[tuple[Any, str, Any], ...] = (
    (types.BaseFunction, "get_call_type", _get_call_type),
    (types.Dispatcher, "get_call_type", _get_function_type),
    (ir.Inst, "_rec_list_vars", _list_variables),
    (event, "broadcast", lambda _: None),  # of locks, to a clock for each function that is waiting
)
"""What replaces functions of numba, by owner and name, while our kernels are compiled."""


class _Flags(compiler.Flags):  # type: ignore[misc]
    """Compiler options that are compared by the values set: as in numba, but faster. Their hash is that of their names."""

    __slots__ = ()
    SAME = hash(compiler.Flags())

    def __hash__(self) -> int:
        return self.SAME

    def __eq__(self, other: object) -> Any:
        return (isinstance(other, _Flags) and self._values == other._values) or super().__eq__(other)


class _Unbound:
    """numba's code generator for a library that is never loaded: it has no memory for an environment."""

    def __init__(self, own: Any) -> None:
        self.own = own

    def __getattr__(self, name: str) -> Any:
        return getattr(self.own, name)

    def set_env(self, name: str, environment: Any) -> None:
        pass  # the library that links this code allocates its own environment


@compiler_machinery.register_pass(mutates_CFG=False, analysis_only=False)
class NumbersOfModules(compiler_machinery.FunctionPass):  # type: ignore[misc]
    """Replaces the numbers of modules and tables, and sums and products of them, by their values before types are inferred."""

    _name = "numbers_of_modules"  # type: ignore[assignment]

    def __init__(self) -> None:
        super().__init__()

    def run_pass(self, state: Any) -> bool:
        definitions, blocks = state.func_ir._definitions, state.func_ir.blocks
        uses = Counter(var.name for block in blocks.values() for one in block.body for var in one.list_vars())
        for block in blocks.values():
            known: dict[str, Any] = {}
            for one in block.find_insts(ir.Assign):
                name, value = one.target.name, _number(one.value, known)
                if value is None or len(definitions[name]) > 1:
                    continue
                known[name] = value
                if type(value) in (int, float) and isinstance(one.value, ir.Expr):
                    for used in one.value.list_vars():
                        uses[used.name] -= 1
                    one.value = ir.Const(value, one.loc)
                    definitions[name] = [one.value]
            unused = {name for name in known if uses[name] == 1}
            block.body = [one for one in block.body if not (isinstance(one, ir.Assign) and one.target.name in unused)]
        return True


def _number(value: Any, known: dict[str, Any]) -> Any:
    """Return the module, or the number, that a value is known to be; None of others."""
    if isinstance(value, ir.Global | ir.Const | ir.FreeVar):
        return value.value if type(value.value) is int or isinstance(value.value, ModuleType) else None
    if not isinstance(value, ir.Expr):
        return None
    if value.op == "getattr" and isinstance(known.get(value.value.name), ModuleType):
        number = getattr(known[value.value.name], value.attr, None)
        return number if type(number) in (int, float) else None
    if value.op == "binop" and value.fn in (operator.add, operator.mul):
        left, right = known.get(value.lhs.name), known.get(value.rhs.name)
        return value.fn(left, right) if type(left) is int and type(right) is int else None
    return None


class _Library(codegen.JITCodeLibrary):  # type: ignore[misc]
    """Optimised intermediate code for callers to link, without machine code."""

    @property
    def codegen(self) -> Any:
        return _Unbound(self._codegen)

    def get_pointer_to_function(self, name: str) -> int:
        self._ensure_finalized()
        return 0

    def _optimize_functions(self, ll_module: Any) -> None:
        # as numba does, but with one pass manager for all functions of the module
        ll_module.data_layout = self._codegen._data_layout
        manager, builder = self._codegen._function_pass_manager()
        for function in ll_module.functions:
            if not function.is_declaration:
                manager.run(function, builder)

    def _optimize_final_module(self) -> None:
        # the library that links it is optimised as a whole; only the step loop is faster with both
        if numba.config.OPT > 1:  # type: ignore[attr-defined]
            super()._optimize_final_module()

    def _finalize_final_module(self) -> None:
        self._finalize_dynamic_globals()
        self._finalized = True


class Own(compiler.CompilerBase):  # type: ignore[misc]
    """Compiler of our kernels, which are plain loops over tables."""

    def __init__(self, *arguments: Any) -> None:
        _skip_blas()
        super().__init__(*arguments)

    def _compile_core(self) -> Any:
        self.state.flags = _Flags(self.state.flags)
        before = [(owner, name, getattr(owner, name)) for owner, name, _ in SHORTER]
        try:  # numba holds a lock while it compiles
            for owner, name, value in SHORTER:
                setattr(owner, name, value)
            return super()._compile_core()
        finally:
            for owner, name, value in before:
                setattr(owner, name, value)

    def define_pipelines(self) -> list[Any]:
        manager = compiler_machinery.PassManager("own")
        own = {"NativeLowering": KernelLowering, "NumbersOfModules": NumbersOfModules}
        for name in PASSES:
            manager.add_pass(own.get(name) or getattr(compiler, name), name)
        manager.finalize()
        return [manager]


class Inner(Own):
    def compile_extra(self, func: Any) -> Any:
        self.state.library = _Library(self.state.targetctx.codegen(), func.__qualname__)
        return super().compile_extra(func)


class Whole(Own):
    """Compiler of functions of laws and plug-ins: numba's complete pipeline for Python, with the short lowering."""

    def define_pipelines(self) -> list[Any]:
        manager = compiler.DefaultPassBuilder.define_nopython_pipeline(self.state)
        plain = typed_passes.NativeLowering
        manager.passes[:] = [(ShortLowering if one is plain else one, about) for one, about in manager.passes]
        return [manager]


class KernelOnly(Inner, Whole):
    """The same for those that only kernels call."""


@functools.cache
def _skip_blas() -> None:
    """Let numba assume that SciPy has a BLAS, as we depend on it: the check takes as long as the compiler's other imports."""
    from numba.np import linalg

    check = linalg.ensure_blas
    linalg.ensure_blas = lambda: None
    try:
        import numba.np.arraymath  # noqa: F401
    finally:
        linalg.ensure_blas = check  # code that uses the BLAS repeats it


def pipeline_options(pipeline: type[compiler.CompilerBase]) -> dict[str, Any]:
    return {"pipeline_class": pipeline} if numba.__version__.startswith(TESTED) else {}
