"""What the name of compiled code depends on: all that a law can reach; the collector of cycles rests while it is compiled."""

import gc
import importlib
import subprocess
import sys
import weakref
from pathlib import Path

import numpy as np
import pytest
from thirdbody.jit.cache import paused
from thirdbody.kernels.table import Table, number, skip, vector
from thirdbody.laws.generated import sources

# an installed package with a helper of another one, and tables in a data file
LAW = """\
from pathlib import Path
from typing import NamedTuple
from enum import IntEnum
import numpy as np
from numba import njit
import helper_a
from helper_a import scale
HERE = Path(__file__).parent
STRENGTH = float((HERE / "strength.txt").read_text())
TABLE = np.loadtxt(HERE / "table.txt")
class Numbers(NamedTuple):
    a: float = STRENGTH
class Kind(IntEnum):
    ONE = int(TABLE[1])
def bound(cell):
    @njit
    def inner(x):
        return x * cell
    return inner
by_cell = bound(STRENGTH)
op = njit(lambda x: x + 1.0)
unused = STRENGTH
@njit
def by_name(x): return scale(x)
@njit
def by_module(x): return helper_a.scale(x)
@njit
def by_value(x): return x * STRENGTH
@njit
def by_table(x): return x * TABLE[0]
@njit
def by_class(x): return x * Kind.ONE
@njit
def by_default(x, y=STRENGTH): return x * y
@njit
def by_tuple(x): return x * Numbers().a
@njit
def by_attribute(x): return x * helper_a.tables.FACTOR
def by_plain(x): return by_value(x)
@njit
def untouched(x): return op(x) * np.sqrt(x)
"""
PARTS = {
    "law.py": LAW,
    "strength.txt": "2.0",
    "table.txt": "3.0 4.0",
    "helper_a/__init__.py": "from numba import njit\nfrom helper_b import offset\nfrom . import tables\n"
    "@njit\ndef scale(x): return 2.0 * offset(x)\n",
    "helper_a/tables.py": "FACTOR = 5.0\n",
    "helper_b.py": "from numba import njit\n@njit\ndef offset(x): return x + 1.0\n",
}
READ = """\
import sys
sys.path.insert(0, sys.argv[1])
import law
from thirdbody.laws.generated import sources
for name in sys.argv[2:]:
    print(name, sources([getattr(law, name)]))
"""
KERNELS = (
    "by_name", "by_module", "by_value", "by_table", "by_class", "by_default", "by_tuple", "by_attribute", "by_cell", "by_plain",
    "untouched",
)  # fmt: skip


def digests(folder: Path, changes: dict[str, str], apart=False) -> dict[str, str]:
    for name, text in (PARTS | changes).items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    if apart:
        done = subprocess.run([sys.executable, "-c", READ, str(folder), *KERNELS], check=True, stdout=subprocess.PIPE, text=True)
        return dict(line.split() for line in done.stdout.splitlines())
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(folder))
        law = importlib.import_module("law")
        found = {name: sources([getattr(law, name)]) for name in KERNELS}
    for name in [name for name in sys.modules if name.partition(".")[0] in ("law", "helper_a", "helper_b")]:
        del sys.modules[name]
    return found


def test_a_change_in_what_a_kernel_reaches_is_noticed_also_by_another_process(tmp_path):
    before = digests(tmp_path / "site-packages", {})
    assert digests(tmp_path / "apart" / "site-packages", {}, apart=True) == before
    for k, (name, (text, touched)) in enumerate(
        {
            "helper_b.py": (PARTS["helper_b.py"].replace("1.0", "1.5"), {"by_name", "by_module"}),
            "strength.txt": ("2.5", {"by_value", "by_default", "by_tuple", "by_cell", "by_plain"}),
            "table.txt": ("3.0 5.0", {"by_table", "by_class"}),
            "helper_a/tables.py": ("FACTOR = 6.0\n", {"by_attribute"}),
        }.items()
    ):
        after = digests(tmp_path / str(k) / "site-packages", {name: text})
        changed = {kernel for kernel in KERNELS if after[kernel] != before[kernel]}
        assert touched <= changed and "untouched" not in changed, name


def test_arrays_and_tables_that_differ_change_what_reads_them():
    tables = [np.zeros(4), np.zeros((2, 2)), np.zeros(4, np.float32), np.array([0.0, 0.0, 0.0, -0.0]), np.array(["a", 1], object)]

    def with_table(table):
        def kernel(x):
            return x * table[0]

        return kernel

    assert len({sources([with_table(table)]) for table in tables}) == len(tables)

    def with_table(table):
        def kernel(x):
            return x[table.WORN]

        return kernel

    tables = [
        Table("m", "a body", path=number("m", "path"), worn=number("m3", "volume")),
        Table("m", "a body", worn=number("m3", "volume"), path=number("m", "path")),
        Table("m", "a body", path=vector(2, "m", "path"), worn=number("m3", "volume")),
    ]
    assert len({sources([with_table(table)]) for table in tables}) == len(tables)
    other = Table("m", "a body", other=skip(1), worn=number("m3", "volume"))
    assert sources([with_table(tables[0])]) == sources([with_table(other)])


class Cycle:
    def __init__(self) -> None:
        self.own = self


def test_nothing_is_collected_within_and_all_of_it_after():
    with paused("a test"):  # the first time keeps what it finds
        assert not gc.isenabled()
    kept = gc.get_freeze_count()
    with paused("a test"):
        dropped = weakref.ref(Cycle())
        with paused("another one within it"):
            pass
        assert not gc.isenabled() and dropped() is not None
    # nothing more is kept, and nothing let go: of some 1e6 objects a few may be freed by their references meanwhile
    assert gc.isenabled() and kept - 10 <= gc.get_freeze_count() <= kept
    gc.collect()
    assert dropped() is None
