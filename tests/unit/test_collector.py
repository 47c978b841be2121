"""The collector of cycles rests, and memory still comes back."""

from __future__ import annotations

import gc
import weakref

import pytest

from thirdbody.jit.gc_pause import resting


class Cycle:
    """Only the collector can take it apart."""

    def __init__(self) -> None:
        self.own = self


def test_nothing_is_collected_within_and_all_of_it_after():
    with resting("a test"):  # the first time keeps what it finds
        assert not gc.isenabled()
    kept = gc.get_freeze_count()
    with resting("a test"):
        dropped = weakref.ref(Cycle())
        with resting("another one within it"):
            pass
        assert not gc.isenabled() and dropped() is not None
    assert gc.isenabled() and gc.get_freeze_count() == kept
    gc.collect()
    assert dropped() is None


def test_a_fault_within_does_not_leave_it_off():
    with pytest.raises(ValueError, match="within"), resting("a test"):
        raise ValueError("within")
    assert gc.isenabled()


def test_one_who_wants_no_collector_gets_none():
    gc.disable()
    try:
        with resting("a test"):
            pass
        assert not gc.isenabled()
    finally:
        gc.enable()
