"""What is compiled at the first start of a scene."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import pytest

import thirdbody
from thirdbody.engine import precompile
from thirdbody.runner.prepare import likely_units

SCENES = Path(__file__).parents[2] / "scenes"
BODIES, ENSEMBLE, ISLANDS = ("bodies", "labels"), ("ensemble", "labels"), ("islands", "bodies", "labels")


@pytest.mark.parametrize(
    ("name", "units"),
    [
        ("sheared_debris", ISLANDS), ("scanned_debris", ISLANDS), ("million", ENSEMBLE), ("three_spot", BODIES),
        ("grooves", precompile.EXPLICIT), ("dense_layer", precompile.EXPLICIT), ("sticky_submicron", precompile.EXPLICIT),
    ],
)  # fmt: skip
def test_what_a_scene_is_expected_to_need(name, units):
    assert likely_units(thirdbody.Scene.load(SCENES / f"{name}.toml")) == units


@pytest.fixture
def compiled(monkeypatch, tmp_path) -> list[str]:
    """The units that were compiled, in their order, by this process alone and from an empty cache."""
    order: list[str] = []
    monkeypatch.setattr(precompile, "_begun", None)
    monkeypatch.setattr(precompile.cache_dir, "cache_folder", lambda: tmp_path)
    monkeypatch.setattr(precompile, "_helper", lambda *_: SimpleNamespace(wait=lambda _: 0, poll=lambda: 0))
    monkeypatch.setattr(precompile, "UNITS", {name: (lambda name=name: order.append(name)) for name in precompile.UNITS})
    return order


def test_every_unit_is_compiled_once(compiled):
    precompile.warm_up(("islands", "labels"))
    precompile.warm_up(("islands", "bodies", "labels"))
    precompile.warm_up(("islands", "bodies"))
    assert compiled == ["islands", "labels", "bodies"]


def test_what_was_expected_is_what_is_needed(compiled):
    precompile.start_compiling(("passes", "step"))
    precompile.warm_up(("passes", "step"))
    assert compiled == ["passes", "step"]


@pytest.mark.parametrize("needed", [("bodies", "labels"), ("islands", "bodies", "labels", "search")])
def test_what_is_not_needed_is_dropped(compiled, needed):
    precompile.start_compiling(("islands", "bodies", "labels"))
    precompile.warm_up(needed)
    assert compiled == list(needed)


def test_nothing_is_compiled_where_nothing_is_missing(compiled):
    precompile.warm_up(("passes",))
    precompile.start_compiling(("islands",))
    precompile.warm_up(("passes",))
    assert compiled == ["passes"]


def test_a_child_process_that_fails_leaves_no_mark(compiled, monkeypatch):
    monkeypatch.setattr(precompile, "_helper", lambda *_: SimpleNamespace(wait=lambda _: 1, poll=lambda: 1))
    precompile.start_compiling(("passes",))
    precompile.warm_up(("passes",))
    precompile.warm_up(("passes",))
    assert compiled == ["passes", "passes"]


def test_later_starts_expect_nothing(compiled):
    """Where another integrator is chosen again and again, what was expected would never be complete."""
    precompile.warm_up(("passes",))
    precompile.start_compiling(("islands",))
    assert precompile._begun is None
