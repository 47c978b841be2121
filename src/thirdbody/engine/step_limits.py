"""Report of the causes that limit implicit steps (`kernels.implicit.control`)."""

import numpy as np

from thirdbody.engine.state import Array
from thirdbody.kernels.implicit.control import CAUSES, OF_A_BODY, WORDS
from thirdbody.kernels.implicit.tables import step_memory


def causes(memory: Array) -> Array:
    """Return the number of steps of each body limited by each cause: a view of these columns."""
    return memory[:, step_memory.LIMITED : step_memory.LIMITED + len(CAUSES)]


def limited_by(memory: Array) -> dict[str, int]:
    """Return the number of steps limited by each cause, most frequent first, without zeros."""
    counts = causes(memory).sum(axis=0)
    return {CAUSES[k]: int(counts[k]) for k in np.argsort(-counts, kind="stable") if counts[k] > 0.0}


def limiting_body(memory: Array, order: np.ndarray) -> dict[str, int]:
    """Return the body (number in the scene) that has limited most steps, and how many."""
    steps = memory[:, step_memory.LIMITED : step_memory.LIMITED + OF_A_BODY].sum(axis=1)
    body = int(np.argmax(steps))
    return {"body": int(order[body]), "steps": int(steps[body])}


def in_words(steps: Array, order: np.ndarray) -> str:
    """Return as text the most frequent cause, its fraction, the body most affected; "" without steps.

    `steps`: those of each body limited by each cause (`causes`).
    """
    counts = steps.sum(axis=0)
    if not counts.sum() > 0.0:
        return ""
    k = int(np.argmax(counts))
    fraction = f"{100.0 * counts[k] / counts.sum():.0f} % of steps limited by {WORDS[k]}"
    if len(steps) == 1 or k >= OF_A_BODY:
        return fraction
    return f"{fraction}, most of them of body {order[int(np.argmax(steps[:, k]))]}"
