"""Labeller without effect, the target of a function pointer that is never called: scenes without labels or body effects."""

from __future__ import annotations

from thirdbody.laws.contract import Labeller, kernel


@kernel
def observe_nothing(contacts, n, body, memory):
    """Leave the memory unchanged."""
    memory[0] += 0.0


@kernel
def label_nothing(contacts, n, body, memory, out):
    """Leave every body at state 0."""
    out[0] = 0.0


NO_LABELS = Labeller(
    name="none",
    observe=observe_nothing,
    label=label_nothing,
    states=(),
    reasons=(),
    margins=(),
    extras=(),
    memory=(),
    contact_memory=(),
    source="",
)
