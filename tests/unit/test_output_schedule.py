"""The stops of a run: how many of them are frames."""

from __future__ import annotations

from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import pytest

from thirdbody.runner.output_schedule import SETTLING, planned_frames, targets


@dataclass
class Planned:
    """What `targets` reads of a simulation that settles and is then dragged for 1 us."""

    scene: Any
    settle: float
    planned_time: float
    end_time: float
    end_distance: float = 1.0


def planned(settle: float, every: float, wish: float | str) -> Any:
    output, solver = SimpleNamespace(every_kind="time", every=every), SimpleNamespace(settle=wish)
    return Planned(SimpleNamespace(output=output, solver=solver), settle, settle + 1e-6, settle + 1e-6)


def frames(simulation: Any) -> list[float]:
    return [time for time, _, write in targets(simulation) if write]


@pytest.mark.parametrize("settle", [8e-3, 8.05e-5, 1.001e-5])
def test_settling_by_itself_does_not_drown_the_drag_in_frames(settle):
    """Scene 81 of the random ones: 8 ms of settling, 82 ns of drag and a frame every 10 ns, 784 000 of them, one step each."""
    simulation = planned(settle, 1e-7, "auto")
    times = frames(simulation)
    assert len([time for time in times if time < settle]) <= SETTLING + 1
    assert planned_frames(simulation) == 1 + len(times)
    late = [time for time in times if time >= settle]
    assert 10 <= len(late) <= 11 and times == sorted(times) and times[-1] == pytest.approx(simulation.planned_time)
    # (a last stop that is the end but for rounding stays where it is: `course`)
    # the frames of the drag are where they would be without the thinning: at multiples of the interval
    assert all(abs(time / 1e-7 - round(time / 1e-7)) < 1e-4 for time in times[:-1])


@pytest.mark.parametrize(("settle", "wish"), [(8e-5, 8e-5), (9e-6, "auto")])
def test_a_settling_time_of_the_scene_and_a_short_one_keep_all_frames(settle, wish):
    times = frames(planned(settle, 1e-7, wish))
    assert len([time for time in times if time < settle - 1e-12]) == round(settle / 1e-7) - 1
