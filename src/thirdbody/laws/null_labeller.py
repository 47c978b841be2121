"""What stands behind a pointer that the engine never follows: a scene without labels or body effects."""

from __future__ import annotations

from thirdbody.laws.contract import Labeller, kernel


@kernel
def observe_nothing(contacts, n, body, memory):
    """Leaves the memory alone."""
    memory[0] += 0.0


@kernel
def label_nothing(contacts, n, body, memory, out):
    """Leaves every body at state 0."""
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
