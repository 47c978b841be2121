"""Shorter intermediate code for what our kernels do most: tables, loops over a range, calls.

For every access to one number of a table numba copies the table's header into memory and leaves it to LLVM to find that none of
it was needed: fifty lines instead of eight. It also stores every variable that several blocks use in memory, counts the passes of
a loop in advance, and tests after each call whether an exception was raised. Here an access is written out, a variable with one
definition that precedes all its uses remains a value, a loop compares its variable, and functions that cannot raise are not
tested. The machine code does the same arithmetic in the same order; with `numba_pipeline` compilation takes half the time.
"""

from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from llvmlite import ir as llvm
from numba.core import analysis, callconv, cgutils, compiler_machinery, cpu, ir, lowering, typed_passes, types

PLAIN = (types.Integer, types.Float)
_i = llvm.instructions
PURE = (_i.InsertValue, _i.ExtractValue, _i.LoadInstr, _i.GEPInstr, _i.CastInstr, _i.CompareInstr, _i.SelectInstr)
ARITHMETIC = {"add", "sub", "mul", "sdiv", "and", "or", "xor"}
"""Instructions that are dropped where their result is not used: of these classes, and plain ones of these names."""

_silent: set[str] = set()  # names of functions compiled here that return no error


class _Builder(llvm.IRBuilder):  # type: ignore[misc]
    def extract_value(self, agg: Any, idx: Any, name: str = "") -> Any:
        path = tuple(idx) if isinstance(idx, tuple | list) else (idx,)
        if len(path) == 1:
            value = agg
            while isinstance(value, _i.InsertValue):
                if tuple(value.indices) == path:
                    return value.value
                if value.indices[0] == path[0]:
                    break
                value = value.aggregate
        return super().extract_value(agg, idx, name)

    @contextmanager
    def if_then(self, pred: Any, likely: bool | None = None) -> Iterator[Any]:
        """Write the block of a condition; nothing where it is known to be false."""
        if not (isinstance(pred, llvm.Constant) and pred.constant == 0):
            with super().if_then(pred, likely) as end:
                yield end
            return
        block, blocks = self.block, self.function.blocks
        count = len(blocks)
        self.position_at_end(self.append_basic_block())
        yield block
        del blocks[count:]
        self.position_at_end(block)


class _Calls(callconv.CPUCallConv):  # type: ignore[misc]
    """numba's calls; those of functions that return no error are known to succeed."""

    def call_function(self, builder: Any, callee: Any, *args: Any, **kwargs: Any) -> tuple[Any, Any]:
        status, result = super().call_function(builder, callee, *args, **kwargs)
        return (status._replace(is_error=llvm.Constant(llvm.IntType(1), 0)) if callee.name in _silent else status), result


class _Context(cpu.CPUContext):  # type: ignore[misc]
    @property
    def call_conv(self) -> Any:
        return _Calls(self)


def _is_pure(instruction: Any) -> bool:
    return isinstance(instruction, PURE) or (type(instruction) is _i.Instruction and instruction.opname in ARITHMETIC)


def _prune(function: Any) -> None:
    instructions = [one for block in function.blocks for one in block.instructions]
    uses: Counter[int] = Counter()
    for one in instructions:
        uses.update(map(id, [value for value, _ in one.incomings] if isinstance(one, _i.PhiInstr) else one.operands))
    idle, dropped = [one for one in instructions if _is_pure(one) and not uses[id(one)]], set()
    while idle:
        one = idle.pop()
        dropped.add(id(one))
        for operand in one.operands:
            uses[id(operand)] -= 1
            if _is_pure(operand) and not uses[id(operand)]:
                idle.append(operand)
    for block in function.blocks:
        block.instructions[:] = [one for one in block.instructions if id(one) not in dropped]


class _Lower(lowering.Lower):  # type: ignore[misc]
    """numba's lowering to LLVM, except for accesses to tables and for variables that never change."""

    FROM_END = True  # whether a variable may be negative as an index, to count from the end

    def setup_function(self, fndesc: Any) -> None:
        super().setup_function(fndesc)
        self.builder = _Builder(self.entry_block)
        self.context.__class__ = _Context  # a copy of numba's, for this function
        self.call_helper = self.call_conv.init_call_helper(self.builder)

    def lower_normal_function(self, fndesc: Any) -> None:
        super().lower_normal_function(fndesc)
        _prune(self.function)
        codes = [block.terminator.operands[0] for block in self.function.blocks if isinstance(block.terminator, _i.Ret)]
        if all(isinstance(code, llvm.Constant) and code.constant == 0 for code in codes):
            _silent.add(self.function.name)

    def _pointer(self, table: Any, table_type: Any, index: Any, index_type: Any) -> Any:
        """Return the pointer to one number of a contiguous table; None if the index addresses anything else."""
        kinds = tuple(index_type) if isinstance(index_type, types.UniTuple | types.Tuple) else (index_type,)
        if not (isinstance(table_type, types.Array) and table_type.layout == "C" and isinstance(table_type.dtype, PLAIN)):
            return None
        if len(kinds) != table_type.ndim or not all(isinstance(kind, types.Integer) for kind in kinds):
            return None
        if self.context.enable_boundscheck:
            return None
        b, fields = self.builder, self.context.data_model_manager[table_type]
        shape = b.extract_value(table, fields.get_field_position("shape"))
        at = None
        for k, kind in enumerate(kinds):
            position = b.extract_value(index, k) if isinstance(index_type, types.BaseTuple) else index
            position = self.context.cast(b, position, kind, types.intp)
            length = None
            known = isinstance(position, llvm.Constant)
            if kind.signed and (position.constant < 0 if known else self.FROM_END):
                length = b.extract_value(shape, k)
                position = b.select(b.icmp_signed("<", position, position.type(0)), b.add(position, length), position)
            if at is not None:
                position = b.add(b.mul(at, b.extract_value(shape, k) if length is None else length), position)
            at = position
        return b.gep(b.extract_value(table, fields.get_field_position("data")), [at], inbounds=True)

    def lower_getitem(self, resty: Any, expr: Any, value: Any, index: Any, signature: Any) -> Any:
        kind = self.typeof(value.name)
        pointer = self._pointer(self.loadvar(value.name), kind, self.loadvar(index.name), self.typeof(index.name))
        if pointer is None:
            return super().lower_getitem(resty, expr, value, index, signature)
        return self.context.cast(self.builder, self.builder.load(pointer), kind.dtype, resty)

    def lower_setitem(self, target_var: Any, index_var: Any, value_var: Any, signature: Any) -> Any:
        kind = self.typeof(target_var.name)
        pointer = self._pointer(self.loadvar(target_var.name), kind, self.loadvar(index_var.name), self.typeof(index_var.name))
        if pointer is None:
            return super().lower_setitem(target_var, index_var, value_var, signature)
        value = self.context.cast(self.builder, self.loadvar(value_var.name), self.typeof(value_var.name), kind.dtype)
        return self.builder.store(value, pointer)

    def _find_singly_assigned_variable(self) -> None:
        super()._find_singly_assigned_variable()
        blocks = self.func_ir.blocks
        once = _lasting(blocks)
        assigned = [one for block in blocks.values() for one in block.find_insts(ir.Assign)]
        given = {one.target.name for one in assigned if isinstance(one.value, ir.Arg)}
        self._assigned, self._borrowed = assigned, given & (self._singly_assigned_vars | once)
        self._singly_assigned_vars |= {name for name in once if name in given or not self._counted(name)}

    def lower_assign(self, ty: Any, inst: Any) -> Any:
        # the caller owns an argument that is never replaced: its references are not counted
        if inst.target.name not in self._borrowed or isinstance(self.typeof("arg." + inst.value.name), types.Omitted):
            return super().lower_assign(ty, inst)
        value = inst.value
        return self.context.cast(self.builder, self.fnargs[value.index], self.typeof("arg." + value.name), ty)

    def delvar(self, name: str) -> None:
        if name not in self._borrowed and self._counted(name):
            super().delvar(name)

    def lower_expr(self, resty: Any, expr: Any) -> Any:
        # loops over a range with a constant step compare their variable
        if expr.op not in ("getiter", "iternext", "pair_first", "pair_second"):
            return super().lower_expr(resty, expr)
        b, value, kind = self.builder, self.loadvar(expr.value.name), self.typeof(expr.value.name)
        if expr.op == "getiter" and isinstance(kind, types.RangeType) and kind.dtype.signed and self._remains(expr):
            start, stop, step = (b.extract_value(value, k) for k in range(3))
            if not isinstance(step, llvm.Constant) or step.constant == 0:
                return super().lower_expr(resty, expr)
            pointer = cgutils.alloca_once(b, start.type)
            b.store(start, pointer)
            return self._struct(resty, (pointer, stop, step, llvm.Constant(pointer.type, None)))
        if expr.op == "iternext" and isinstance(kind, types.RangeIteratorType):
            pointer, stop, step, count = (b.extract_value(value, k) for k in range(4))
            if isinstance(count, llvm.Constant) and isinstance(step, llvm.Constant):
                now = b.load(pointer)
                b.store(b.add(now, step, flags=("nsw",)), pointer)
                return self._struct(resty, (now, b.icmp_signed("<" if step.constant > 0 else ">", now, stop)))
        if isinstance(kind, types.Pair) and isinstance(kind.first_type, PLAIN):  # nothing that is counted
            return b.extract_value(value, 0 if expr.op == "pair_first" else 1)
        return super().lower_expr(resty, expr)

    def _remains(self, expr: Any) -> bool:
        """Return whether the result of an expression, and its copies, remain values."""
        names = {one.target.name for one in self._assigned if one.value is expr}
        names |= {one.target.name for one in self._assigned if isinstance(one.value, ir.Var) and one.value.name in names}
        return names <= self._singly_assigned_vars

    def _struct(self, kind: Any, members: tuple[Any, ...]) -> Any:
        value = self.context.get_value_type(kind)(llvm.Undefined)
        for k, member in enumerate(members):
            value = self.builder.insert_value(value, member, k)
        return value

    def _lower_call_normal(self, fnty: Any, expr: Any, signature: Any) -> Any:
        if getattr(fnty, "typing_key", None) is range and not expr.kws and not expr.vararg:
            long = self.context.get_value_type(signature.return_type.dtype)
            given = [self._cast_var(var, kind) for var, kind in zip(expr.args, signature.args, strict=True)]
            start = given[0] if len(given) > 1 else llvm.Constant(long, 0)
            step = given[2] if len(given) > 2 else llvm.Constant(long, 1)
            return self._struct(signature.return_type, (start, given[min(1, len(given) - 1)], step))
        if not plain_extreme(fnty, signature.args) or expr.kws or expr.vararg:
            return super()._lower_call_normal(fnty, expr, signature)
        values = [self._cast_var(var, kind) for var, kind in zip(expr.args, signature.args, strict=True)]
        sign, result = "<" if fnty.typing_key is min else ">", values[0]
        for value in values[1:]:
            better = self.builder.fcmp_ordered(sign, value, result)
            result = self.builder.select(better, value, result)
        return result

    def _counted(self, name: str) -> bool:
        return self.context.enable_nrt and self.context.data_model_manager[self.typeof(name)].contains_nrt_meminfo()


def plain_extreme(function: Any, arguments: tuple[Any, ...]) -> bool:
    """Return whether this is Python's `max` or `min` of several numbers of double precision."""
    return getattr(function, "typing_key", None) in (max, min) and len(arguments) > 1 and set(arguments) == {types.float64}


def _lasting(blocks: dict[int, Any]) -> set[str]:
    """Return the variables with one definition that precedes all uses, on every path and in lowering order."""
    uses, defined = analysis.compute_use_defs(blocks), {}
    often = lowering.must_use_alloca(blocks)
    for label, block in blocks.items():
        for one in block.find_insts(ir.Assign):
            name = one.target.name
            if name in defined:
                often.add(name)
            defined[name] = label
    before = analysis.compute_cfg_from_blocks(blocks).dominators()
    for label, names in uses.usemap.items():
        often |= {n for n in names if defined.get(n, label) >= label or defined[n] not in before.get(label, ())}
    return set(defined) - often


@compiler_machinery.register_pass(mutates_CFG=True, analysis_only=False)
class ShortLowering(typed_passes.BaseNativeLowering):  # type: ignore[misc]
    _name = "short_lowering"  # type: ignore[assignment]
    lowering_class = _Lower  # type: ignore[assignment]


class _KernelLower(_Lower):
    FROM_END = False


@compiler_machinery.register_pass(mutates_CFG=True, analysis_only=False)
class KernelLowering(typed_passes.BaseNativeLowering):  # type: ignore[misc]
    """The same for kernels: none of their variables is negative as an index."""

    _name = "kernel_lowering"  # type: ignore[assignment]
    lowering_class = _KernelLower  # type: ignore[assignment]
