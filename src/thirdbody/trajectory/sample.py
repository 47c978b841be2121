"""Bodies that the run file holds where a scene asks for a sample of them (`output.sample`).

They are numbered anew in the file, from 0, so that the number of a body is its row in all files; `scene_id` is its number in the
scene. A contact belongs to the file if one of its bodies does. That one is its owner there, and a body that the file does not
hold has the number `ELSEWHERE`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

Array = np.ndarray

ELSEWHERE = -3
"""Partner of a contact that is a body, but not in the file; -1 and -2 are the plates."""

SEED = 1
"""Of the choice of bodies: runs of one scene hold the same ones."""

REVERSED = ("force", "normal", "tangential_force", "moment")
"""Arrays of contacts that are those of the owner by the partner."""


class Sample(NamedTuple):
    """The bodies in the file."""

    bodies: Array
    """Their numbers in the scene (n,), ascending."""
    row: Array
    """Row in the file of each body of the scene (B,), `ELSEWHERE` of those that are not in it."""

    def has(self, number: Array) -> Array:
        """Return which of these bodies are in the file; numbers below 0 are plates."""
        return (number >= 0) & (self.row[np.maximum(number, 0)] >= 0)

    def of_contacts(self, arrays: dict[str, Array]) -> dict[str, Array]:
        """Return contacts of bodies in the file as it holds them; `arrays`: with numbers of the scene."""
        own, partner = arrays["body"], arrays["partner"]
        from_partner = ~self.has(own)
        first, second = np.where(from_partner, partner, own), np.where(from_partner, own, partner)
        numbers = {"body": self.row[first], "partner": np.where(second < 0, second, self.row[np.maximum(second, 0)])}
        signs = np.where(from_partner, -1.0, 1.0)[:, None]
        return arrays | {name: signs * arrays[name] for name in REVERSED if name in arrays} | numbers


def sample_of(count: int, bodies: int) -> Sample:
    """Return so many of the bodies of a scene: one, at random, of each of `count` equal stretches of their numbers."""
    edges = np.arange(count + 1) * bodies // count
    chosen = np.random.default_rng(SEED).integers(edges[:-1], edges[1:])
    row = np.full(bodies, ELSEWHERE)
    row[chosen] = np.arange(count)
    return Sample(chosen, row)
