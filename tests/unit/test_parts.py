"""Ensembles in parts: the same bits as uncut, whatever the parts; what cannot be cut is refused."""

from __future__ import annotations

import threading
from pathlib import Path

import pytest
from ensembles import EXPLICIT, GAP, ROUGH, arrays, scene

import thirdbody
from thirdbody.engine.energy import Ledger
from thirdbody.engine.independence import coupling
from thirdbody.engine.parts import join, ranges, restrict
from thirdbody.engine.snapshot import Snapshot, snapshot
from thirdbody.engine.time_step import Bound
from thirdbody.errors import GuardStop, UsageError
from thirdbody.runner.output_schedule import targets
from thirdbody.runner.parts import files
from thirdbody.runner.parts.joined import Joined, cut
from thirdbody.runner.parts.steps import Bounds, CommonBound
from thirdbody.runner.parts.workers import LocalProcesses
from thirdbody.runner.prepare import prepare


def states_of_parts(given: thirdbody.Scene, parts: int, folder: Path) -> list[Snapshot]:
    """States of the joined parts at every output; the parts are computed by threads of this process."""
    whole = prepare(given)
    cuts = ranges(whole.state, parts, whole.integrator.divisible)
    stops: list[list[Snapshot]] = [[] for _ in cuts]

    def compute(k: int) -> None:
        part = simulations[k]
        common = CommonBound(folder, k, lambda: None)
        if part.integrator.divisible:
            part.integrator.agree = lambda bound: common.agree(next(numbers[k]), bound)
        for time, distance, is_output in targets(part):
            if is_output:
                part.integrator.advance_to(time, distance)
                taken = snapshot(part.state, part.integrator, Ledger(part.state))
                stops[k].append(Snapshot({name: rows.copy() for name, rows in taken.arrays.items()}, taken.notes))

    simulations, numbers = [], [iter(range(10**6)) for _ in cuts]
    for bodies in cuts:
        part = prepare(given)
        restrict(part.state, part.integrator, Ledger(part.state), bodies)
        simulations.append(part)
    with Bounds(folder, len(cuts), local=True):
        threads = [threading.Thread(target=compute, args=(k,), daemon=True) for k in range(len(cuts))]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join(300.0)
    return [join(at_once, cuts, whole.state) for at_once in zip(*stops, strict=True)]


@pytest.mark.parametrize("level", ["coulomb", "mdr"])
@pytest.mark.parametrize("support", [{}, GAP], ids=["load per particle", "gap"])
def test_states_of_implicit_parts_are_those_of_the_whole(level: str, support: dict[str, object], tmp_path: Path) -> None:
    """Each body has its own steps, so even the candidates are the same; a prescribed gap is a plate that no body moves."""
    given = scene(**{"contact.level": level}, **support)
    whole = prepare(given)
    joined = states_of_parts(given, 3, tmp_path)
    stops = [(time, distance) for time, distance, is_output in targets(whole) if is_output]
    assert len(joined) == len(stops) > 1
    for (time, distance), parts in zip(stops, joined, strict=True):
        whole.integrator.advance_to(time, distance)
        expected = snapshot(whole.state, whole.integrator, Ledger(whole.state))
        for name, rows in expected.arrays.items():
            if name != "A":  # sums over all bodies, which the run that joins the parts makes itself
                assert rows.tobytes() == parts.arrays[name].tobytes(), name


@pytest.mark.parametrize("changes", [EXPLICIT, ROUGH], ids=["flat", "rough"])
def test_states_of_explicit_parts_are_those_of_the_whole(changes: dict[str, object], tmp_path: Path) -> None:
    """The common step, the ledgers of groups, and what spheres are closest to on rough plates do not depend on the cut."""
    given = scene(**changes)
    whole = prepare(given)
    joined = states_of_parts(given, 5, tmp_path)
    for (time, distance, _), parts in zip([stop for stop in targets(whole) if stop[2]], joined, strict=True):
        whole.integrator.advance_to(time, distance)
        expected = snapshot(whole.state, whole.integrator, Ledger(whole.state))
        assert whole.state.dt == parts.notes["dt"] and whole.state.A[0] > 0.0
        for name in {"B", "E", "M", "slots_Q", "integrator_ledgers"}:
            assert expected.arrays[name].tobytes() == parts.arrays[name].tobytes(), name


MEASURED = {"measures.wear": {"law": "energy", "plates": "1e-15 m3/J"}, "measures.cell": "150 um"}
"""Two cells of each plate, with bodies of both parts: their sums depend on the order of deposits."""


@pytest.mark.parametrize("changes", [{}, EXPLICIT, MEASURED], ids=["implicit", "explicit", "implicit, with maps"])
def test_run_in_parts_has_the_bits_of_the_whole_run(changes: dict[str, object], tmp_path: Path) -> None:
    """Parts in processes of their own; nothing of them is left at the end."""
    given = scene(**changes)
    thirdbody.run(given, tmp_path / "whole", 1, False)
    thirdbody.run(given, tmp_path / "parts", 1, False, parts=2)
    assert arrays(tmp_path / "whole") == arrays(tmp_path / "parts")
    assert not (tmp_path / "parts" / files.FOLDER).exists()


def test_parts_list_all_contacts_that_may_come() -> None:
    """Both plates for every sphere: a bound that misses one would let the time steps of parts and whole drift apart."""
    for number in (0, 1):
        part = prepare(scene(**EXPLICIT))
        restrict(part.state, part.integrator, Ledger(part.state), ranges(part.state, 2, explicit=True)[number])
        assert part.integrator.pairs.count == 2 * part.state.n_spheres


def test_ranges_cover_all_bodies_once() -> None:
    """Explicit parts are whole groups of 512 bodies, so there may be fewer of them than wanted."""
    state = prepare(scene(**EXPLICIT)).state
    for parts, explicit, sizes in ((3, False, [173, 173, 174]), (1, False, [520]), (5, True, [512, 8])):
        cuts = ranges(state, parts, explicit)
        assert [bodies.last - bodies.first for bodies in cuts] == sizes
        assert cuts[0].first == 0 and cuts[-1].last_sphere == state.n_spheres
        assert all(a.last == b.first and a.last_sphere == b.first_sphere for a, b in zip(cuts, cuts[1:], strict=False))


@pytest.mark.parametrize(
    ("changes", "why"),
    [
        ({"contact.debris_contact": "auto"}, "its bodies may meet each other"),
        (EXPLICIT | MEASURED, "an explicit run adds up its measures at each search"),
        ({"plates.upper.support": "rigid"}, "all bodies carry one plate together"),
        ({"plates.upper.support": "foundation", "plates.upper.stiffness": "1 N/mm"}, "one foundation together"),
    ],
)
def test_scenes_that_cannot_be_cut_are_refused(changes: dict[str, object], why: str, tmp_path: Path) -> None:
    """One message, and nothing is written."""
    given = scene(**{"solver.integrator": "auto", **changes})
    with pytest.raises(UsageError, match=why):
        thirdbody.run(given, tmp_path / "run", 1, False, parts=2)
    assert not (tmp_path / "run").exists()


def test_number_of_parts_is_checked() -> None:
    simulation = prepare(scene())
    assert not coupling(simulation.state, explicit=True)
    cut(simulation, 1, LocalProcesses(1))
    assert not isinstance(simulation.integrator, Joined)
    with pytest.raises(UsageError, match="parts = 0: must be at least 1"):
        cut(simulation, 0, LocalProcesses(1))


def test_smallest_bound_is_common_and_kept(tmp_path: Path) -> None:
    """A part that starts again gets the old bounds without the others."""
    own = [Bound(2e-9, "rotation", 3, 8e-9, 5e-9), Bound(1e-9, "patch", 9, 9e-9, 4e-9)]
    common = Bound(1e-9, "patch", 9, 8e-9, 4e-9)
    answers: list[Bound] = []
    with Bounds(tmp_path, 2, local=True) as bounds:
        first, second = (CommonBound(tmp_path, k, lambda: None) for k in (0, 1))
        waiting = threading.Thread(target=lambda: answers.append(first.agree(0, own[0])))
        waiting.start()
        answers.append(second.agree(0, own[1]))
        waiting.join(30.0)
        assert answers == [common, common] and bounds.agreed == [common]
    with (tmp_path / "bounds.jsonl").open("a") as log:
        log.write('{"step": 1e-')  # a kill within a line
    with Bounds(tmp_path, 2, local=True):
        assert CommonBound(tmp_path, 0, lambda: None).agree(0, own[0]) == common


def test_guard_in_a_part_stops_the_run_with_its_frames(tmp_path: Path) -> None:
    """A fixed step far above its bound; the frames before the guard are kept."""
    given = scene(**EXPLICIT | {"solver.time_step": "12 ns", "output.every": "20 nm"})
    for name, parts in (("whole", 1), ("parts", 2)):
        with pytest.raises(GuardStop):
            thirdbody.run(given, tmp_path / name, 1, False, force=True, parts=parts)
    whole, cut = (thirdbody.open(tmp_path / name) for name in ("whole", "parts"))
    assert whole.frames == cut.frames < 15 and not cut.summary()["finished"]
    assert not (tmp_path / "parts" / files.FOLDER).exists()
