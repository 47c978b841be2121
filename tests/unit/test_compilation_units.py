"""What is compiled, and when: entries at their first call, units at the first start of a scene."""

import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from types import SimpleNamespace

import pytest
from numba import types
from steel import SCENES

import thirdbody
from thirdbody.engine import units
from thirdbody.jit.arguments import address
from thirdbody.jit.options import Entry, entry
from thirdbody.runner.simulate import likely_units

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
