"""Labeller without effect, for scenes without labels or body effects.

It is the target of a function pointer that the engine never calls.
"""

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
