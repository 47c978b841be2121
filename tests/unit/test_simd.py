"""Four numbers at once: the bits of numpy's arithmetic, small turns, arrays on the stack; what is compiled, and when."""

import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from numba import njit, types
from steel import SCENES
import thirdbody
from thirdbody.engine import units
from thirdbody.jit import simd
from thirdbody.jit.arguments import address, stack_array
from thirdbody.jit.options import Entry, entry
from thirdbody.kernels.vectors import NEARLY_UNIT, rotate_small
from thirdbody.runner.simulate import likely_units

SMALLEST, LARGEST_DENORMAL = 5e-324, 2.2250738585072009e-308
ODD = [0.0, -0.0, np.inf, -np.inf, np.nan, SMALLEST, -SMALLEST, LARGEST_DENORMAL, -LARGEST_DENORMAL, 1e-60, -1e-60,
       np.nextafter(1e-60, 1.0), np.nextafter(-1e-60, -1.0), 1.0, -1e308, -np.nan]  # fmt: skip


def numbers(rows: int, seed: int, reach: float = 150.0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return rng.choice([-1.0, 1.0], (rows, 4)) * rng.uniform(1.0, 10.0, (rows, 4)) * 10.0 ** rng.uniform(-reach, reach, (rows, 4))


def alike(one: np.ndarray, other: np.ndarray) -> bool:
    """The same bits, so that -0 is not 0 and what is not a number is the same."""
    return one.shape == other.shape and np.array_equal(one.view(np.uint64), other.view(np.uint64))


@njit(error_model="numpy")
def arithmetic(A, B, C, out):
    for i in range(A.shape[0]):
        a, b, c = simd.load(A, i, 0), simd.load(B, i, 0), simd.load(C, i, 0)
        simd.store(out[0], i, 0, a + b)
        simd.store(out[1], i, 0, a - b)
        simd.store(out[2], i, 0, a * b)
        simd.store(out[3], i, 0, simd.cross(a, b))
        simd.store(out[4], i, 0, a + b * c)
        simd.store(out[5], i, 0, a * b - c)


@njit(error_model="numpy")
def compared(A, B, least, out, bits, whole):
    for i in range(A.shape[0]):
        a, b = simd.load(A, i, 0), simd.load(B, i, 0)
        simd.store(out[0], i, 0, simd.clamp_below(a, least))
        simd.store(out[1], i, 0, simd.round_to_nearest(a))
        simd.store(out[2], i, 0, simd.select_greater(a, b, a, b))
        simd.store(out[3], i, 0, a / b)
        simd.store(out[4], i, 0, simd.flush_below(a, least))
        bits[i], whole[i] = simd.less_mask(a, b), simd.all_below(a, least)


def test_arithmetic_comparison_and_rounding_have_the_bits_of_numpy():
    """A processor can do a product and a sum with one rounding: other bits, and not on every machine."""
    one, other = numbers(400, 1), numbers(400, 2)
    one[:300] *= np.abs(other[:300] / one[:300])  # of like size, so that both have a say in a sum
    one[:100, 1], other[50:150, 2], one[0] = 0.0, -0.0, -other[0]
    for a, b, c in ((one, other, other), [numbers(400, seed, 2.0) for seed in (3, 4, 5)]):
        out = np.full((6, *a.shape), np.nan)
        arithmetic(a, b, c, out)
        x, y = a[:, :3], b[:, :3]
        expected = (a + b, a - b, a * b, x[:, [1, 2, 0]] * y[:, [2, 0, 1]] - x[:, [2, 0, 1]] * y[:, [1, 2, 0]])
        assert all(alike(found, one) for found, one in zip(out[:3], expected[:3], strict=True))
        assert alike(np.ascontiguousarray(out[3, :, :3]), expected[3])
        assert np.all(out[3, :, 3] == 0.0)  # what stands behind a vector stays nothing
    assert alike(out[4], a + b * c) and alike(out[5], a * b - c)
    halves = np.arange(-20.0, 20.0).reshape(10, 4) / 2.0
    a = np.vstack((np.reshape(ODD, (4, 4)), numbers(40, 10, 3.0), halves))
    b = a[::-1].copy()
    b[20:30] = a[20:30]  # none below
    out, bits, whole = np.empty((5, *a.shape)), np.empty(len(a), np.int64), np.empty(len(a), np.bool_)
    compared(a, b, 1e-300, out, bits, whole)
    assert alike(out[0], np.where(a < 1e-300, 1e-300, a)) and alike(out[1], np.rint(a))
    assert np.array_equal(bits, (a < b) @ [1, 2, 4, 8]) and bits.any() and len(set(bits)) > 8
    assert np.array_equal(whole, (a < 1e-300).all(axis=1)) and whole.any() and not whole.all()
    assert alike(out[2], np.where(a > b, a, b))
    with np.errstate(all="ignore"):
        assert alike(out[3], a / b)
    # what is too small is zero, and no number is hidden
    for least in (0.0, SMALLEST, 1e-60, 1e-300, 1.0, np.inf):
        compared(a, b, least, out, bits, whole)
        cut = out[4]
        assert alike(cut, np.where(np.abs(a) <= least, 0.0, a)), least
        assert np.array_equal(np.isnan(cut), np.isnan(a)) and np.isnan(cut).sum() == 2
        assert not np.any(np.signbit(cut[cut == 0.0]))


@njit(error_model="numpy")
def turned_all(Q, R, out):
    for k in range(Q.shape[0]):
        simd.store(out, k, 0, rotate_small(simd.load(Q, k, 0), simd.set4(R[k, 0], R[k, 1], R[k, 2], 0.0)))


def product(p: np.ndarray, q: np.ndarray) -> np.ndarray:
    u, v = p[:, 1:], q[:, 1:]
    real = p[:, 0] * q[:, 0] - np.sum(u * v, axis=1)
    return np.column_stack((real, p[:, [0]] * v + q[:, [0]] * u + np.cross(u, v)))


def test_a_turn_is_by_twice_the_angle_whose_tangent_is_half_of_it():
    rng = np.random.default_rng(3)
    sizes = np.concatenate((np.logspace(-12, 0.5, 2000), 2.0 * np.sqrt(NEARLY_UNIT) * np.linspace(0.99, 1.01, 2001)))
    Q, axes = rng.normal(size=(len(sizes), 4)), rng.normal(size=(len(sizes), 3))
    Q /= np.linalg.norm(Q, axis=1)[:, None]
    R = sizes[:, None] * axes / np.linalg.norm(axes, axis=1)[:, None]
    out = np.empty_like(Q)
    turned_all(Q, R, out)
    turn = np.column_stack((np.ones(len(R)), 0.5 * R))
    expected = product(turn / np.linalg.norm(turn, axis=1)[:, None], Q)
    # a dozen roundings of numbers up to 1
    assert np.abs(out - expected).max() < 1e-15
    assert np.abs(np.sum(out * out, axis=1) - 1.0).max() < 1e-15
    # What rounding leaves of a length is put right by the next turn, and does not add up.
    Q, R, rng = np.array([[1.0, 0.0, 0.0, 0.0]]), np.empty((1, 3)), np.random.default_rng(4)
    for _ in range(5_000):
        R[0] = rng.normal(size=3) * 1e-3
        turned_all(Q, R, Q)
    assert abs(np.sum(Q * Q) - 1.0) < 1e-15


SIZE = 1000


@njit
def sums(n):
    total = np.zeros(n)
    for i in range(n):
        a, b = stack_array(SIZE), stack_array(SIZE)
        for k in range(SIZE):
            a[k], b[k] = i, 2 * i
        total[i] = a.sum() + b.sum()
    return total


def test_arrays_are_apart_and_of_one_place():
    """Rounds of 16 kB, 320 MB in all, would overflow any stack if every round took its own."""
    assert np.array_equal(sums(5), 3.0 * SIZE * np.arange(5))
    assert sums(20_000)[-1] == 3.0 * SIZE * 19_999


REST = ("search", "books", "labels")
BODIES, ENSEMBLE, ISLANDS = ("driver", *REST), ("driver", "ensemble", *REST), ("driver", "pairs", *REST)


def test_what_a_scene_is_expected_to_need():
    for name, expected in (
        ("sheared_debris", ISLANDS), ("scanned_debris", ISLANDS), ("million", ENSEMBLE), ("three_spot", BODIES),
        ("grooves", units.EXPLICIT), ("dense_layer", units.EXPLICIT), ("sticky_submicron", units.EXPLICIT),
    ):  # fmt: skip
        assert likely_units(thirdbody.Scene.load(SCENES / f"{name}.toml")) == expected, name


@pytest.fixture
def compiled(monkeypatch, tmp_path):
    """The units that were compiled, in their order, by this process alone and from an empty cache."""
    order: list[str] = []
    monkeypatch.setattr(units, "_begun", None)
    monkeypatch.setattr(units.cache, "cache_folder", lambda: tmp_path)
    monkeypatch.setattr(units, "_helper", lambda *_: SimpleNamespace(wait=lambda _: 0, poll=lambda: 0))
    monkeypatch.setattr(units, "entries", lambda unit: [SimpleNamespace(compiled=lambda: order.append(unit))])
    return order


@pytest.mark.parametrize(
    ("expected", "needed"), [(("passes", "step"), ("passes", "step")), (ISLANDS, BODIES), (ISLANDS, (*ISLANDS, "rough"))]
)
def test_what_was_expected_is_compiled_where_it_is_needed(compiled, expected, needed):
    units.start_compiling(expected)
    units.warm_up(needed)
    assert compiled == list(needed)


def test_every_unit_is_compiled_once_and_later_starts_expect_nothing(compiled):
    for needed in (("driver", "labels"), ("driver", "pairs", "labels"), ("driver", "pairs")):
        units.warm_up(needed)
    units.start_compiling(("driver",))
    assert units._begun is None
    assert compiled == ["driver", "labels", "pairs"]


def test_a_child_process_that_fails_leaves_no_mark(compiled, monkeypatch):
    monkeypatch.setattr(units, "_helper", lambda *_: SimpleNamespace(wait=lambda _: 1, poll=lambda: 1))
    units.start_compiling(("passes",))
    units.warm_up(("passes",))
    units.warm_up(("passes",))
    assert compiled == ["passes", "passes"]


def test_a_start_that_compiles_says_so_once_with_seconds(compiled, capsys, monkeypatch):
    monkeypatch.setattr(units, "_reported", False)
    monkeypatch.setattr(units.cache, "note", "")
    units.start_compiling(("driver", "labels"))
    for _ in range(2):
        units.report_compilation()
    (line,) = capsys.readouterr().err.splitlines()  # in a log too
    assert line.startswith("thirdbody: first start of this version, compiling: about ") and 20 <= int(line.split()[-2]) <= 26
    units.warm_up(("driver", "labels"))


IMPORT_ALL = """
import importlib, sys
from pathlib import Path
root = Path(sys.argv[1])
for path in sorted(root.rglob("*.py")):
    parts = path.relative_to(root.parent).with_suffix("").parts
    if parts[1] in ("jit", "kernels", "laws", "bodies", "engine", "statics", "assembly") and path.stem != "__init__":
        importlib.import_module(".".join(parts))
"""


def test_importing_compiles_nothing_and_every_unit_has_entries(tmp_path):
    source, env = Path(thirdbody.__file__).parent, os.environ | {"THIRDBODY_CACHE": str(tmp_path)}
    subprocess.run([sys.executable, "-c", IMPORT_ALL, str(source)], env=env, check=True)
    assert not [*tmp_path.rglob("*.nbi"), *tmp_path.rglob("*.nbc")]
    for unit in units.UNITS:
        assert (one := list(units.entries(unit))) and all(isinstance(each, Entry) for each in one), unit


def test_an_entry_is_compiled_once_for_its_signature_by_whichever_thread_is_first():
    @entry(types.float64(types.float64), error_model="numpy")
    def twice(x):
        return 2.0 * x

    assert twice._compiled is None
    with ThreadPoolExecutor(8) as pool:
        assert len({id(each) for each in pool.map(lambda _: twice.compiled(), range(8))}) == 1
    assert twice(3) == 6.0 and len(twice.compiled().overloads) == 1  # an integer is converted, not compiled for
    assert address(twice, types.float64(types.float64)) == address(twice.compiled(), types.float64(types.float64)) > 0
