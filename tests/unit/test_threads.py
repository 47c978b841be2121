"""Work divided among threads: teams in a compiled call, pieces of Python, busy cores, short steps; parts of arrays in memory."""

import threading
import time
from collections import namedtuple

import numpy as np
import pytest
from numba import njit
from numba.core.errors import TypingError
from thirdbody.jit import threads as teams
from thirdbody.jit.arguments import array_part
from thirdbody.jit.options import BARE
from thirdbody.kernels.arguments import Tile
from thirdbody.kernels.contact_geometry import gather_history, load_history
from thirdbody.kernels.memory import load_field, pieces, store_history
from thirdbody.kernels.tables import contact_state
from thirdbody.kernels.tile import TILE, geometry, law_input, law_output

UNCACHED = {"error_model": "numpy", "nogil": True, "_nrt": False}
PASSES, PARTS, CALL = 20_000, 7, 0.03
assert CALL > teams.MIN_MEASUREMENT


@njit(**BARE)
def count(words, part, announced, times):
    times[announced[0], part] += 1
    teams.count_up(words, teams.DONE)


@njit(**UNCACHED)
def lead(words, members, announced, times):
    for number in range(times.shape[0]):
        announced[0] = number
        teams.open_pass(words, members)
        part = teams.next_part(words, 0, members, times.shape[1])
        while part >= 0:
            count(words, part, announced, times)
            part = teams.next_part(words, 0, members, times.shape[1])
        teams.close_pass(words, times.shape[1])


@njit(**UNCACHED)
def follow(words, member, members, announced, times, done):
    attempts = 0
    while teams.load_word(words, teams.DISMISSED) == 0:
        part = teams.next_part(words, member, members, times.shape[1])
        if part < 0:
            attempts = teams.wait_again(attempts)
        else:
            count(words, part, announced, times)
            done[member] += 1
            attempts = 0


def team(members, passes):
    """Words, the number announced, the times that each part of each pass was done, the parts done by each member."""
    times, done = np.zeros((passes, PARTS), np.int64), np.zeros(members, np.int64)
    return np.zeros(teams.words_of(members), np.int64), np.zeros(1, np.int64), times, done


@pytest.mark.parametrize(("members", "present"), [(1, 1), (2, 2), (3, 3), (3, 1), (8, 3)])
def test_every_part_of_every_pass_is_done_once(members, present):
    """Also where members are missing, and where there are more threads than cores or parts."""
    words, announced, times, done = team(members, PASSES if present <= 2 else PASSES // 20)
    with teams.helpers(present, words, lambda member: follow(words, member, members, announced, times, done)):
        lead(words, members, announced, times)
    assert (times == 1).all() and done.sum() <= times.size


def test_a_helper_takes_part():
    words, announced, times, done = team(2, 1)
    with teams.helpers(2, words, lambda member: follow(words, member, 2, announced, times, done)):
        words[teams.FIRST :: teams.LINE], limit = 0, time.monotonic() + 60.0  # opened
        while done[1] < PARTS and time.monotonic() < limit:
            time.sleep(0.001)
    assert (times == 1).all() and list(done) == [0, PARTS]


def complain(text):
    raise ValueError(text)


def test_errors_of_helpers_are_raised_and_helpers_dismissed_after_an_error():
    words, ended = np.zeros(teams.words_of(2), np.int64), threading.Event()
    with pytest.raises(ValueError, match="member 1"), teams.helpers(2, words, lambda member: complain(f"member {member}")):
        pass
    assert words[teams.DISMISSED] == 1

    def wait_for_dismissal(_member):
        while not words[teams.DISMISSED]:
            time.sleep(0.001)
        ended.set()

    words[:] = 0
    with pytest.raises(ValueError, match="leader"), teams.helpers(2, words, wait_for_dismissal):
        complain("leader")
    assert ended.is_set()


@pytest.fixture
def unchanged():
    before = teams.allowed_threads()
    yield before
    teams.allow_threads(before)


def test_pieces_and_every_thread_of_python_has_its_own_number(unchanged):
    """They cover it, in order, none below the fewest unless it is the only one; one thread has one piece."""
    for threads in (1, 2, 5):
        teams.allow_threads(threads)
        for first, last, fewest in ((0, 0, 4), (3, 5, 4), (3, 11, 4), (0, 1000, 4), (7, 1000, 300)):
            pieces = teams.pieces_of(first, last, fewest)
            assert [pieces[0][0], *(end for _, end in pieces)] == [*(begin for begin, _ in pieces), last]
            assert pieces[0][0] == first
            assert len(pieces) == 1 or (threads > 1 and min(end - begin for begin, end in pieces) >= fewest)
    # pieces are done once and errors are raised after all have ended
    teams.allow_threads(3)
    done = []
    teams.distribute(range(40), lambda: done.append)
    assert sorted(done) == list(range(40))
    with pytest.raises(ValueError, match="piece 5"):
        teams.distribute(range(40), lambda: lambda piece: complain(f"piece {piece}") if piece == 5 else None)
    seen = []
    teams.allow_threads(unchanged + 1)
    other = threading.Thread(target=lambda: seen.append(teams.allowed_threads()))
    other.start()
    other.join()
    assert (teams.allowed_threads(), seen) == (unchanged + 1, [teams.max_threads()])


def report(pace, now, share, threads=2, wall=CALL, steps=1):
    pace.note(threads, steps, wall, share * wall, now)


def played(alone, shared, seconds):
    """Wall time on one and on two threads, s, of a run whose step takes so long on one and on two, s: calls of 64 steps."""
    pace, now, spent = teams.ThreadTuner(), 0.0, {1: 0.0, 2: 0.0}
    while now < seconds:
        threads = pace.threads(2, now)
        wall = 64 * (alone if threads == 1 else shared)
        now += wall
        spent[threads] += wall
        report(pace, now, 1.0 if threads == 1 else 1.8, threads, wall, 64)
    return spent


def test_threads_with_a_core_each_stay_and_those_that_wait_yield_to_one():
    pace = teams.ThreadTuner()
    for k in range(100):
        report(pace, k * CALL, 1.7)
        assert pace.threads(2, k * CALL) == 2
    pace = teams.ThreadTuner()
    report(pace, 1.0, 0.5 * teams.STARVED)
    assert pace.threads(2, 1.0) == pace.threads(2, 1.0 + 0.9 * teams.PAUSE) == 1
    assert pace.threads(2, 1.0 + teams.PAUSE) == 2
    pace = teams.ThreadTuner()  # one thread with its share of a core is no reason
    report(pace, 1.0, 0.3, threads=1)
    assert pace.threads(2, 1.0) == 2
    pace = teams.ThreadTuner()  # short calls are compared together
    report(pace, 0.0, 0.1, wall=0.4 * teams.MIN_MEASUREMENT)
    assert pace.threads(2, 0.0) == 2
    report(pace, 0.0, 0.1, wall=0.7 * teams.MIN_MEASUREMENT)
    assert pace.threads(2, 0.0) == 1
    # trials that fail come less and less often until one does not
    pace, now, pauses = teams.ThreadTuner(), 0.0, []
    for _ in range(8):
        report(pace, now, 0.1)
        pauses.append(pace.until - now)
        now = pace.until
    assert pauses[0] == teams.PAUSE and pauses[-1] == teams.LONGEST
    assert all(after == min(2.0 * before, teams.LONGEST) for before, after in zip(pauses, pauses[1:], strict=False))
    report(pace, now, 1.8)
    assert pace.threads(2, now) == 2
    report(pace, now, 0.1)
    assert pace.until - now == teams.PAUSE


def test_short_steps_go_on_the_threads_that_take_less():
    """One thread is tried now and then, and two, for some hundredths of a second: a per cent of the time. Not for long steps."""
    slower, faster = played(1e-4, 1.4e-4, 60.0), played(3e-4, 2e-4, 60.0)
    assert 0.0 < slower[2] < 0.01 * slower[1] and 0.0 < faster[1] < 0.01 * faster[2]
    assert played(2.0 * teams.SHORT, 1.1 * teams.SHORT, 60.0)[1] == 0.0


Rows = namedtuple("Rows", "H kind n_history field_begin field_size")  # noqa: PYI024


@njit
def doubled(array, first):
    part = array_part(3, array, first)
    for i in range(len(part)):
        part[i] *= 2.0
    return len(part)


def test_a_part_is_a_view():
    array = np.arange(10.0)
    assert doubled(array, 4) == 3
    assert array.tolist() == [0.0, 1.0, 2.0, 3.0, 8.0, 10.0, 12.0, 7.0, 8.0, 9.0]
    assert array_part(3, array, 4).tolist() == [8.0, 10.0, 12.0]
    with pytest.raises(TypingError):  # gaps
        doubled(np.zeros((4, 4))[:, 1], 0)


@njit
def load(slots, context, tile):
    for q in range(len(slots)):
        load_history(q, slots[q], context, tile)


@njit
def gather(slots, context, tile):
    for q in range(0, len(slots), 4):
        gather_history(q, (slots[q], slots[q + 1], slots[q + 2], slots[q + 3]), context, tile)
    for q in range(len(slots)):
        load_field(q, slots[q], context, tile)


@njit
def store(slots, context, tile):
    store_history(len(slots), slots, context, tile)


@pytest.mark.parametrize("read", [load, gather])
def test_rows_survive_loading_and_storing(read):
    """Every place of a field: first columns (which are loaded in fours) or later, other history behind it."""
    for history, begin, size in ((5, 5, 0), (2, 2, 0), (7, 2, 5), (9, 1, 6), (12, 5, 6), (16, 8, 8)):
        rng = np.random.default_rng(history)
        rows = rng.uniform(1.0, 2.0, (TILE, max(contact_state.LAW + history, contact_state.MIN_WIDTH)))
        slots = rng.permutation(TILE)
        context = Rows(rows.copy(), np.zeros(TILE, np.int32), history, begin, size)
        widths = law_input.HISTORY + max(history, 4), law_output.HISTORY + history
        tile = Tile(*(np.zeros(width * TILE) for width in widths), np.zeros(0), np.ones(geometry.WIDTH * TILE))
        read(slots, context, tile)
        inputs = tile.inputs.reshape(-1, TILE)[law_input.HISTORY :][:history]
        laws = rows[slots, contact_state.LAW : contact_state.LAW + history]
        assert np.array_equal(pieces(inputs[begin : begin + size]), laws[:, begin : begin + size]), history
        others = np.r_[:begin, begin + size : history]
        assert np.array_equal(inputs[others], laws[:, others].T), history
        tile.outputs.reshape(-1, TILE)[law_output.HISTORY :] = 2.0 * inputs
        store(slots, context, tile)
        assert np.array_equal(context.H[slots, contact_state.LAW : contact_state.LAW + history], 2.0 * laws), history
