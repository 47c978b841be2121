"""Our way through numba gives what numba's own gives: every function here is compiled by both. Only a variable that is negative
as an index counts from the end no more in kernels, and in them none is."""

import itertools
import math
import os
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from numba import njit
from numba.core.runtime import _nrt_python, rtsys
from thirdbody.jit.options import CHUNK, HELPER, OPTIONS

NUMBERS = np.array([3.5, -1.0, 0.0, -0.0, math.nan, math.inf, 7.25, -2.5])


def ours(function, options=CHUNK):
    """Compiled as our kernels are: inside another, since inner kernels have no machine code of their own."""
    inner = njit(**options)(function)

    @njit(**{key: value for key, value in OPTIONS.items() if key != "cache"})
    def outer(*arguments):
        return inner(*arguments)

    return outer


def written(table):
    total = table[0, -1] + 5.0 * table[-2, -3]
    for i in range(table.shape[0]):
        row = table[i]
        row[-1] += 1.0
        table[i, 0] = table[i, 1] - i
    short = table.reshape(table.size, 1)  # rows of length one, an index without a sign, numbers of four bytes
    for place in np.array([1, 3, 0], np.int32):
        total += short[place, 0] * (1 + place) + short[np.uint8(2), 0]
    return total, table.sum()


def test_tables_are_used_as_numba_does_and_functions_of_plugins_count_from_the_end():
    table = np.random.default_rng(3).normal(size=(7, 4))
    mine, other = table.copy(), table.copy()
    assert ours(written)(mine) == njit(error_model="numpy")(written)(other)
    assert np.array_equal(mine, other)

    def backwards(table):
        total = 0.0
        for i in range(table.shape[0]):
            total = 2.0 * total + table[-i, i - 2]
        return total

    table = np.random.default_rng(4).normal(size=(4, 4))
    assert ours(backwards, HELPER)(table) == backwards(table)


NEVER_NEGATIVE = """
import subprocess, sys
from llvmlite import ir as llvm
from numba.core import cgutils, types
from thirdbody.engine import units
from thirdbody.jit import numba_lowering

usual = numba_lowering._KernelLower._pointer

def checked(self, table, table_type, index, index_type):
    b, several = self.builder, isinstance(index_type, types.BaseTuple)
    for k, kind in enumerate(index_type if several else [index_type]):
        position = b.extract_value(index, k) if several else index
        if isinstance(kind, types.Integer) and kind.signed and not isinstance(position, llvm.Constant):
            with b.if_then(b.icmp_signed("<", position, position.type(0)), likely=False):
                stop = llvm.FunctionType(llvm.VoidType(), [])
                b.call(cgutils.get_or_insert_function(b.module, stop, "llvm.trap"), [])
    return usual(self, table, table_type, index, index_type)

numba_lowering._KernelLower._pointer = checked
units._helper = lambda *_: subprocess.Popen([sys.executable, "-c", ""])  # this process compiles all
import thirdbody
from reference_scenes import SCENES, tables_of
for name in sys.argv[1:]:
    print(name, flush=True)
    thirdbody.run(thirdbody.Scene.of(tables_of(SCENES[name])), name)
"""


@pytest.mark.full(kind="slow")
@pytest.mark.parametrize(
    "names",
    [
        ("explicit_mdr_rolling", "bed_profiles", "explicit_gap_closing"), ("islands_mdr_stroke", "ensemble_mdr"),
        ("common_plate_islands_foundation", "close_spots"), ("rough_common_plate", "maps_implicit"),
        ("adhesion_jkr", "elastic_plastic_implicit"),
    ],
)  # fmt: skip
def test_no_kernel_counts_from_the_end(names, tmp_path):
    scenes = str(Path(__file__).parents[1] / "bench")
    changes = {"THIRDBODY_CACHE": str(tmp_path / "cache"), "NUMBA_OPT": "1", "PYTHONPATH": scenes}
    command = [sys.executable, "-W", "ignore", "-c", NEVER_NEGATIVE, *names]
    done = subprocess.run(command, env=os.environ | changes, cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr


def test_extremes_order_nan_and_signs_of_zero_as_python_does():
    def extremes(a, b):
        return max(a, b), min(a, b), max(a, b, 1.0), min(2, int(a) if math.isfinite(a) else 0)

    compiled = ours(extremes)
    for a, b in itertools.product(NUMBERS, NUMBERS):
        for mine, true in zip(compiled(a, b), extremes(a, b), strict=True):
            same = mine == true and math.copysign(1.0, mine) == math.copysign(1.0, true)
            assert same or (math.isnan(mine) and math.isnan(true)), (a, b)


def loops(n, step):
    seen = 0
    for i in range(n):
        for k in range(i, -1, -2):
            if k == 5:
                continue
            seen = 3 * seen + k
        for k in range(n - i):
            if k > 3:
                break
            seen += k * i
    last = -1
    for k in range(n, 3 * n, step):  # a step that is known only as it runs
        last = k
    for k in range(np.uint8(3), n):
        seen += k
    return seen, last


def test_loops_over_ranges_run_as_in_python():
    compiled = ours(loops)
    for n, step in itertools.product((-3, 0, 1, 2, 7, 12), (1, 3, -1, -4)):
        assert compiled(n, step) == loops(n, step), (n, step)


def of_tables(n):
    total = 0.0
    for table in (np.ones((n, 2)), np.full((n + 1, 2), 2.0)):
        total += table.sum()
    return total


def test_a_loop_over_tables_keeps_them_alive():
    compiled = ours(of_tables)
    for n in range(200):
        assert compiled(n) == 2.0 * n + 4.0 * (n + 1)
    _nrt_python.memsys_enable_stats()
    before = rtsys.get_allocation_stats()
    compiled(5)
    after = rtsys.get_allocation_stats()
    _nrt_python.memsys_disable_stats()
    assert after.alloc - before.alloc == after.free - before.free > 0


def root(x):
    if x < 0.0:
        raise ValueError("negative")
    return math.sqrt(x)


def test_an_exception_leaves_all_functions_between():
    inner, quiet = njit(**CHUNK)(root), njit(**CHUNK)(lambda x: 2.0 * x)

    def total(x):
        y = 0.0
        for k in range(3):
            y += inner(quiet(x) - k)
        return y

    compiled = ours(total)
    assert compiled(2.0) == root(4.0) + root(3.0) + root(2.0)
    with pytest.raises(ValueError, match="negative"):
        compiled(0.5)


def test_numbers_of_modules_are_what_they_were_when_it_was_compiled():
    table = ModuleType("table")
    vars(table).update(FIRST=3, SCALE=0.5, ROWS=slice(1, 3))

    def value(a):
        return table.FIRST * 4 + a[table.FIRST + 1] * table.SCALE + math.pi, a[table.ROWS].sum()

    a = np.arange(8.0)
    assert ours(value)(a) == (12.0 + 2.0 + math.pi, 3.0)
