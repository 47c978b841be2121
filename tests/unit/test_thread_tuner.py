"""A run on busy cores, or of short steps, goes on with one thread for a while, and tries all of them again."""

from __future__ import annotations

from thirdbody.engine.thread_tuner import LONGEST, MIN_MEASUREMENT, PAUSE, SHORT, STARVED, ThreadTuner

CALL = 0.03
assert CALL > MIN_MEASUREMENT


def report(pace: ThreadTuner, now: float, share: float, threads: int = 2, wall: float = CALL, steps: int = 1) -> None:
    pace.note(threads, steps, wall, share * wall, now)


def played(alone: float, shared: float, seconds: float) -> dict[int, float]:
    """Wall time on one and on two threads, s, of a run whose step takes so long on one and on two, s: calls of 64 steps."""
    pace, now, spent = ThreadTuner(), 0.0, {1: 0.0, 2: 0.0}
    while now < seconds:
        threads = pace.threads(2, now)
        wall = 64 * (alone if threads == 1 else shared)
        now += wall
        spent[threads] += wall
        report(pace, now, 1.0 if threads == 1 else 1.8, threads, wall, 64)
    return spent


def test_threads_with_a_core_each_stay():
    pace = ThreadTuner()
    for k in range(100):
        report(pace, k * CALL, 1.7)
        assert pace.threads(2, k * CALL) == 2


def test_threads_that_wait_yield_to_one():
    pace = ThreadTuner()
    report(pace, 1.0, 0.5 * STARVED)
    assert pace.threads(2, 1.0) == pace.threads(2, 1.0 + 0.9 * PAUSE) == 1
    assert pace.threads(2, 1.0 + PAUSE) == 2


def test_one_thread_with_its_share_of_a_core_is_no_reason():
    pace = ThreadTuner()
    report(pace, 1.0, 0.3, threads=1)
    assert pace.threads(2, 1.0) == 2


def test_trials_that_fail_come_less_and_less_often_until_one_does_not():
    pace, now, pauses = ThreadTuner(), 0.0, []
    for _ in range(8):
        report(pace, now, 0.1)
        pauses.append(pace.until - now)
        now = pace.until
    assert pauses[0] == PAUSE and pauses[-1] == LONGEST
    assert all(after == min(2.0 * before, LONGEST) for before, after in zip(pauses, pauses[1:], strict=False))
    report(pace, now, 1.8)
    assert pace.threads(2, now) == 2
    report(pace, now, 0.1)
    assert pace.until - now == PAUSE


def test_short_calls_are_compared_together():
    pace = ThreadTuner()
    report(pace, 0.0, 0.1, wall=0.4 * MIN_MEASUREMENT)
    assert pace.threads(2, 0.0) == 2
    report(pace, 0.0, 0.1, wall=0.7 * MIN_MEASUREMENT)
    assert pace.threads(2, 0.0) == 1


def test_short_steps_go_on_the_threads_that_take_less():
    """One thread is tried now and then, and two, for some hundredths of a second: a per cent of the time."""
    slower, faster = played(1e-4, 1.4e-4, 60.0), played(3e-4, 2e-4, 60.0)
    assert 0.0 < slower[2] < 0.01 * slower[1]
    assert 0.0 < faster[1] < 0.01 * faster[2]


def test_one_thread_is_not_tried_where_steps_are_long():
    assert played(2.0 * SHORT, 1.1 * SHORT, 60.0)[1] == 0.0


def test_a_step_that_becomes_slower_on_all_threads_is_noticed():
    """As where others come to use the cores, or most bodies leave the contacts that they had."""
    pace = ThreadTuner()
    report(pace, 1.0, 1.8, steps=200)
    report(pace, 1.0 + CALL, 1.0, threads=1, steps=100)
    report(pace, 2.0, 1.8, steps=200)
    assert pace.threads(2, 2.0) == 2
    report(pace, 3.0, 1.8, steps=99)
    assert pace.threads(2, 3.0) == 1
