"""Work divided among threads: teams within a compiled call, pieces of Python."""

from __future__ import annotations

import threading
import time

import numpy as np
import pytest
from numba import njit

from thirdbody.jit.atomics import count_up, load_word
from thirdbody.jit.options import BARE
from thirdbody.jit.team import DISMISSED, DONE, FIRST, LINE, close_pass, next_part, open_pass, wait_again, words_of
from thirdbody.jit.threads import allow_threads, allowed_threads, distribute, helpers, max_threads, pieces_of

UNCACHED = {"error_model": "numpy", "nogil": True, "_nrt": False}
PASSES, PARTS = 20_000, 7


@njit(**BARE)
def count(words, part, announced, times):
    times[announced[0], part] += 1
    count_up(words, DONE)


@njit(**UNCACHED)
def lead(words, members, announced, times):
    """Open all passes, and take part in them."""
    for number in range(times.shape[0]):
        announced[0] = number
        open_pass(words, members)
        part = next_part(words, 0, members, times.shape[1])
        while part >= 0:
            count(words, part, announced, times)
            part = next_part(words, 0, members, times.shape[1])
        close_pass(words, times.shape[1])


@njit(**UNCACHED)
def follow(words, member, members, announced, times, done):
    """Take part in all passes; count the parts done."""
    attempts = 0
    while load_word(words, DISMISSED) == 0:
        part = next_part(words, member, members, times.shape[1])
        if part < 0:
            attempts = wait_again(attempts)
        else:
            count(words, part, announced, times)
            done[member] += 1
            attempts = 0


@pytest.mark.parametrize(("members", "present"), [(1, 1), (2, 2), (3, 3), (3, 1), (8, 3)])
def test_every_part_of_every_pass_is_done_once(members, present):
    """Also where members are missing, and where there are more threads than cores or parts."""
    words, announced = np.zeros(words_of(members), np.int64), np.zeros(1, np.int64)
    times, done = np.zeros((PASSES if present <= 2 else PASSES // 20, PARTS), np.int64), np.zeros(members, np.int64)
    with helpers(present, words, lambda member: follow(words, member, members, announced, times, done)):
        lead(words, members, announced, times)
    assert (times == 1).all()
    assert done.sum() <= times.size


def test_a_helper_takes_part():
    """While the first member waits, the second one does all parts, its own and those of others."""
    words, announced = np.zeros(words_of(2), np.int64), np.zeros(1, np.int64)
    times, done = np.zeros((1, PARTS), np.int64), np.zeros(2, np.int64)
    with helpers(2, words, lambda member: follow(words, member, 2, announced, times, done)):
        words[FIRST::LINE], limit = 0, time.monotonic() + 60.0  # opened
        while done[1] < PARTS and time.monotonic() < limit:
            time.sleep(0.001)
    assert (times == 1).all()
    assert list(done) == [0, PARTS]


def test_errors_of_helpers_are_raised():
    words = np.zeros(words_of(2), np.int64)
    with pytest.raises(ValueError, match="member 1"), helpers(2, words, lambda member: complain(f"member {member}")):
        pass
    assert words[DISMISSED] == 1


def test_helpers_are_dismissed_after_an_error():
    words = np.zeros(words_of(2), np.int64)
    ended = threading.Event()

    def wait_for_dismissal(_member: int) -> None:
        while not words[DISMISSED]:
            time.sleep(0.001)
        ended.set()

    with pytest.raises(ValueError, match="leader"), helpers(2, words, wait_for_dismissal):
        complain("leader")
    assert ended.is_set()


def complain(text: str) -> None:
    raise ValueError(text)


def test_pieces_are_done_once_and_errors_are_raised_after_all_have_ended():
    before = allowed_threads()
    try:
        allow_threads(3)
        done: list[int] = []
        distribute(range(40), lambda: done.append)
        assert sorted(done) == list(range(40))
        with pytest.raises(ValueError, match="piece 5"):
            distribute(range(40), lambda: lambda piece: complain(f"piece {piece}") if piece == 5 else None)
    finally:
        allow_threads(before)


def test_pieces_of_a_range():
    """They cover it, in order, none below the fewest unless it is the only one; one thread has one piece."""
    before = allowed_threads()
    try:
        for threads in (1, 2, 5):
            allow_threads(threads)
            for first, last, fewest in ((0, 0, 4), (3, 5, 4), (3, 11, 4), (0, 1000, 4), (7, 1000, 300)):
                pieces = pieces_of(first, last, fewest)
                assert [pieces[0][0], *(end for _, end in pieces)] == [*(begin for begin, _ in pieces), last]
                assert pieces[0][0] == first
                assert len(pieces) == 1 or (threads > 1 and min(end - begin for begin, end in pieces) >= fewest)
    finally:
        allow_threads(before)


def test_every_thread_of_python_has_its_own_number():
    """Runs may be made in several threads at once."""
    before, seen = allowed_threads(), []
    try:
        allow_threads(before + 1)
        other = threading.Thread(target=lambda: seen.append(allowed_threads()))
        other.start()
        other.join()
        assert (allowed_threads(), seen) == (before + 1, [max_threads()])
    finally:
        allow_threads(before)
