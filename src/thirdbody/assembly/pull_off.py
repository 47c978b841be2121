"""Pull-off forces of contacts, for the bodies that hang together."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from thirdbody.laws.contract import Law, Pair


def pull_off_forces(laws: Sequence[Law], pairs: Sequence[Pair], options: Mapping[str, Any]) -> Callable[..., Any] | None:
    """Return the pull-off forces [N] of contacts by their pairs and effective radii [m], or None without adhesion."""
    law = next((law for law in laws if law.pull_off), None)
    if law is None or law.pull_off is None:
        return None
    rule, values = law.pull_off, options[law.name]

    def forces(kinds: np.ndarray, radius: np.ndarray) -> np.ndarray:
        result = np.zeros(len(radius))
        for k, pair in enumerate(pairs):
            result[kinds == k] = rule(pair, law.options_of(pair, values), radius[kinds == k])
        return result

    return forces
