"""The collector of cycles rests, and memory still comes back."""

from __future__ import annotations

import gc
import weakref

import pytest

from thirdbody.jit.gc_pause import paused


class Cycle:
    """Only the collector can take it apart."""

    def __init__(self) -> None:
        self.own = self


def test_nothing_is_collected_within_and_all_of_it_after():
    with paused("a test"):  # the first time keeps what it finds
        assert not gc.isenabled()
    kept = gc.get_freeze_count()
    with paused("a test"):
        dropped = weakref.ref(Cycle())
        with paused("another one within it"):
            pass
        assert not gc.isenabled() and dropped() is not None
    assert gc.isenabled() and gc.get_freeze_count() == kept
    gc.collect()
    assert dropped() is None


def test_a_fault_within_does_not_leave_it_off():
    with pytest.raises(ValueError, match="within"), paused("a test"):
        raise ValueError("within")
    assert gc.isenabled()


def test_one_who_wants_no_collector_gets_none():
    gc.disable()
    try:
        with paused("a test"):
            pass
        assert not gc.isenabled()
    finally:
        gc.enable()
