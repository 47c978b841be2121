"""The benchmark of the guards still knows their code, and what it takes out is no more than guards."""

from __future__ import annotations

import importlib
import io
from dataclasses import dataclass
from pathlib import Path

import pytest
from rich.console import Console

BENCH = Path(__file__).parents[1] / "bench"


@dataclass(frozen=True)
class Case:
    """What the benchmark asks of a scene."""

    name: str = "S200"
    kind: str = "S"
    number: int = 200
    tiles: str = "1x1"
    warm: int = 70
    steps: int = 130  # two looks lie in it, and some searches
    reps: int = 1


@pytest.fixture
def guards(monkeypatch):
    """tests/bench/guards.py, which is in no package."""
    monkeypatch.syspath_prepend(BENCH)
    return importlib.import_module("guards")


def test_every_text_of_a_guard_is_found_once(guards, tmp_path):
    copy = guards.without_guards(tmp_path)
    for cut in guards.CUTS:
        assert cut.text not in (copy / cut.file).read_text() and cut.text in (guards.PACKAGE / cut.file).read_text()
    changed = {cut.file for cut in guards.CUTS}
    files = {str(file.relative_to(copy)) for file in copy.rglob("*.py")}
    assert changed < files == {str(file.relative_to(guards.PACKAGE)) for file in guards.PACKAGE.rglob("*.py")}
    for name in files - changed:
        assert (copy / name).read_bytes() == (guards.PACKAGE / name).read_bytes(), name


@pytest.mark.parametrize("text", ["a guard that was renamed", "import numpy as np\nfrom numba import njit"])
def test_a_code_that_the_benchmark_no_longer_knows_is_reported(guards, tmp_path, monkeypatch, text):
    monkeypatch.setattr(guards, "CUTS", (guards.Cut("engine/guards.py", text),))
    with pytest.raises(SystemExit, match=r"no longer knows the code: .* in engine/guards\.py"):
        guards.without_guards(tmp_path)


@pytest.mark.full(kind="slow")  # compiles the engine a second time
def test_both_engines_come_to_the_same_bits_and_only_one_stops(guards, monkeypatch):
    monkeypatch.setattr(guards, "PINNED", {1: ()})  # other tests run too
    rows = guards.measure_guards([Case()], rounds=1, peers=None)  # exits where bits differ, or where a limit of 0 stops the other
    with_guards, without = (rows[0]["runs"][name][0][0] for name in (guards.AS_IS, guards.WITHOUT))
    assert with_guards["bits"] == without["bits"] and rows[0]["spheres"] == rows[0]["bodies"] == 200
    assert with_guards["looks"] > 0.0 and without["looks"] > 0.0
    page = io.StringIO()
    guards.print_guards(rows, Console(file=page, width=150))
    assert "S200" in page.getvalue() and f"{rows[0]['ratio']['median']:.3f}" in page.getvalue()


def test_engines_that_differ_are_reported(guards):
    class Answering:
        def __init__(self, bits: str) -> None:
            self.bits = bits

        def request(self, command: str) -> dict[str, str]:
            return {"bits": self.bits, "command": command}

    case = Case()
    same = guards.pair(case, {guards.AS_IS: Answering("1"), guards.WITHOUT: Answering("1")})
    assert {one["command"] for one in same.values()} == {"segment"}
    with pytest.raises(SystemExit, match="S200: .* not .* the same bits"):
        guards.pair(case, {guards.AS_IS: Answering("1"), guards.WITHOUT: Answering("2")})


def test_ratios_are_taken_pair_by_pair(guards):
    def run(*seconds: float) -> list[dict[str, float]]:
        return [{"t": t, "processor": 2.0 * t, "looks": 0.25 * t} for t in seconds]

    report = guards.summed_up({guards.AS_IS: [run(2.0, 9.0), run(4.0, 2.0)], guards.WITHOUT: [run(1.0, 3.0), run(4.0, 1.0)]})
    assert report["ratio"]["pairs"] == report["of_processor"]["pairs"] == [[2.0, 3.0], [1.0, 2.0]]
    # of pairs 1, 2, 2, 3; of rounds 2.5 and 1.5; dividing the medians of the times would give 3/2
    assert (report["ratio"]["median"], report["ratio"]["min"], report["ratio"]["max"]) == (2.0, 1.5, 2.5)
    assert report["looks"] == 0.25
