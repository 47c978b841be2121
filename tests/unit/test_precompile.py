"""What is compiled at the first start of a scene."""

from pathlib import Path
from types import SimpleNamespace

import pytest

import thirdbody
from thirdbody.engine import precompile
from thirdbody.runner.prepare import likely_units

SCENES = Path(__file__).parents[2] / "scenes"
BODIES, ENSEMBLE, ISLANDS = ("driver", "labels"), ("driver", "ensemble", "labels"), ("driver", "pairs", "labels")


def test_what_a_scene_is_expected_to_need():
    for name, units in (
        ("sheared_debris", ISLANDS), ("scanned_debris", ISLANDS), ("million", ENSEMBLE), ("three_spot", BODIES),
        ("grooves", precompile.EXPLICIT), ("dense_layer", precompile.EXPLICIT), ("sticky_submicron", precompile.EXPLICIT),
    ):  # fmt: skip
        assert likely_units(thirdbody.Scene.load(SCENES / f"{name}.toml")) == units, name


@pytest.fixture
def compiled(monkeypatch, tmp_path):
    """The units that were compiled, in their order, by this process alone and from an empty cache."""
    order: list[str] = []
    monkeypatch.setattr(precompile, "_begun", None)
    monkeypatch.setattr(precompile.cache_dir, "cache_folder", lambda: tmp_path)
    monkeypatch.setattr(precompile, "_helper", lambda *_: SimpleNamespace(wait=lambda _: 0, poll=lambda: 0))
    monkeypatch.setattr(precompile, "UNITS", {name: (lambda name=name: order.append(name)) for name in precompile.UNITS})
    return order


@pytest.mark.parametrize(
    ("expected", "needed"), [(("passes", "step"), ("passes", "step")), (ISLANDS, BODIES), (ISLANDS, (*ISLANDS, "search"))]
)
def test_what_was_expected_is_compiled_where_it_is_needed(compiled, expected, needed):
    precompile.start_compiling(expected)
    precompile.warm_up(needed)
    assert compiled == list(needed)


def test_every_unit_is_compiled_once_and_later_starts_expect_nothing(compiled):
    for units in (("driver", "labels"), ("driver", "pairs", "labels"), ("driver", "pairs")):
        precompile.warm_up(units)
    precompile.start_compiling(("driver",))
    assert precompile._begun is None
    assert compiled == ["driver", "labels", "pairs"]


def test_a_child_process_that_fails_leaves_no_mark(compiled, monkeypatch):
    monkeypatch.setattr(precompile, "_helper", lambda *_: SimpleNamespace(wait=lambda _: 1, poll=lambda: 1))
    precompile.start_compiling(("passes",))
    precompile.warm_up(("passes",))
    precompile.warm_up(("passes",))
    assert compiled == ["passes", "passes"]


def test_a_start_that_compiles_says_so_once_with_seconds(compiled, capsys, monkeypatch):
    monkeypatch.setattr(precompile, "_reported", False)
    monkeypatch.setattr(precompile.cache_dir, "note", "")
    precompile.start_compiling(("driver", "labels"))
    for _ in range(2):
        precompile.report_compilation()
    (line,) = capsys.readouterr().err.splitlines()  # in a log too
    assert line.startswith("thirdbody: first start of this version, compiling: about ") and 45 <= int(line.split()[-2]) <= 65
    precompile.warm_up(("driver", "labels"))
