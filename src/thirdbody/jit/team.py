"""A team of threads that divide each pass over some tables, many passes in one call of a compiled function.

The thread of the caller opens passes one after the other; helpers take part in them as soon as they run, which is some 50 us
later, or ms where their cores are busy, so that nobody waits for a thread to start. Each member first takes the parts that are
its own, which it had in the last pass, too: they may still be in its cache. Then it takes those of others, so that all end at
about the same time. A pass begins and ends in less than a microsecond.

Not numba's `prange`: it wakes its threads for every pass, deals equal parts in advance, needs OpenMP or TBB to be used from
several threads of Python, and takes longer to compile.
"""

from numba import njit

from thirdbody.jit.atomics import count_up, load_word, pause, sleep, store_word
from thirdbody.jit.options import BARE

LINE = 8
"""Words of a cache line: members must not write to the same one."""

DONE, DISMISSED = 0, LINE
"""Words: how many parts of the pass are done; 1: no pass will follow."""

FIRST = 2 * LINE
"""Word of the first member: how many of its own parts are taken. Those of the next ones follow, a line each."""

CLOSED = 1 << 40
"""Such a number before the first pass is opened: more than there are parts."""

SPINS = 2000
"""Attempts before a waiting thread sleeps: some 50 us. Where every core has a thread, hardly one waits longer."""


def words_of(members: int) -> int:
    """Return the number of words of a team."""
    return FIRST + LINE * members


@njit(**BARE)
def open_pass(words, members):
    """Offer the parts of the next pass to all members, after all of the last one are done."""
    store_word(words, DONE, 0)
    for member in range(members):
        store_word(words, FIRST + LINE * member, 0)


@njit(**BARE)
def next_part(words, member, members, parts):
    """Return the next of the parts of this pass for a member, now its own to do; -1: all are taken."""
    for k in range(members):
        owner = (member + k) % members
        first, last = owner * parts // members, (owner + 1) * parts // members
        # counted only where some are left: counting takes the line from the other cores
        if load_word(words, FIRST + LINE * owner) < last - first:
            part = first + count_up(words, FIRST + LINE * owner)
            if part < last:
                return part
    return -1


@njit(**BARE)
def wait_again(attempts):
    """Wait a moment after so many attempts, and return their new number."""
    if attempts < SPINS:
        pause()
    else:
        sleep()
    return attempts + 1


@njit(**BARE)
def close_pass(words, parts):
    """Wait until all parts are done."""
    attempts = 0
    while load_word(words, DONE) < parts:
        attempts = wait_again(attempts)
