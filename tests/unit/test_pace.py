"""A run on busy cores goes on with one thread for a while, and tries all of them again."""

from __future__ import annotations

from thirdbody.engine.pace import LEAST, LONGEST, PAUSE, STARVED, Pace

CALL = 0.03
assert CALL > LEAST


def told(pace: Pace, now: float, share: float, threads: int = 2, wall: float = CALL) -> None:
    pace.note(threads, wall, share * wall, now)


def test_threads_with_a_core_each_stay():
    pace = Pace()
    for k in range(100):
        told(pace, k * CALL, 1.7)
        assert pace.threads(2, k * CALL) == 2


def test_threads_that_wait_make_way_for_one():
    pace = Pace()
    told(pace, 1.0, 0.5 * STARVED)
    assert pace.threads(2, 1.0) == pace.threads(2, 1.0 + 0.9 * PAUSE) == 1
    assert pace.threads(2, 1.0 + PAUSE) == 2


def test_one_thread_with_its_share_of_a_core_is_no_reason():
    pace = Pace()
    told(pace, 1.0, 0.3, threads=1)
    assert pace.threads(2, 1.0) == 2


def test_trials_that_fail_come_less_and_less_often_until_one_does_not():
    pace, now, pauses = Pace(), 0.0, []
    for _ in range(8):
        told(pace, now, 0.1)
        pauses.append(pace.until - now)
        now = pace.until
    assert pauses[0] == PAUSE and pauses[-1] == LONGEST
    assert all(after == min(2.0 * before, LONGEST) for before, after in zip(pauses, pauses[1:], strict=False))
    told(pace, now, 1.8)
    assert pace.threads(2, now) == 2
    told(pace, now, 0.1)
    assert pace.until - now == PAUSE


def test_short_calls_are_judged_together():
    pace = Pace()
    told(pace, 0.0, 0.1, wall=0.4 * LEAST)
    assert pace.threads(2, 0.0) == 2
    told(pace, 0.0, 0.1, wall=0.7 * LEAST)
    assert pace.threads(2, 0.0) == 1
