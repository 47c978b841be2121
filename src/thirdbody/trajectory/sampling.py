"""What frames sample: some of the bodies (`output.sample`), and quantities between outputs, for means over the interval.

Bodies of a sample are numbered anew in the file, from 0, so that the number of a body is its row; `scene_id` is its number in the
scene. A contact belongs to the file if one of its bodies does. That one is its owner there, and a body that the file does not
hold has the number `ELSEWHERE`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np

from thirdbody.engine.snapshot import check
from thirdbody.engine.state import State

Array = np.ndarray
Sampler = Callable[[State], Array]
"""A quantity of a synchronised state, whose contacts have records: an array whose shape never changes."""

SAMPLES = 32
"""Samples per output interval, at most: the statistical error of a mean hardly falls with more of such correlated values."""

CLOCK = "clock"

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


class IntervalMeans:
    """Means over time of some quantities by name, by the trapezoidal rule between samples.

    The state is sampled at instants that follow from simulated time alone, so the means have the same bits for any number of
    threads, and after a resume. `duration` returns the expected length [s] of the output interval that begins now, `ready`
    whether the state can be sampled; if not, it is asked again at the next call of `watch`.
    """

    def __init__(
        self, state: State, samplers: Mapping[str, Sampler], duration: Callable[[], float] = lambda: 0.0,
        ready: Callable[[], bool] = lambda: True,
    ) -> None:  # fmt: skip
        self.state, self.samplers, self.duration, self.ready = state, dict(samplers), duration, ready
        self.values = {name: np.array(sample(state), float) for name, sample in self.samplers.items()}
        self._begin()

    def _begin(self) -> None:
        self.sums = {name: np.zeros_like(value) for name, value in self.values.items()}
        self.start = self.last = self.state.time
        length = self.duration()
        self.period = length / SAMPLES if math.isfinite(length) else 0.0

    def watch(self) -> None:
        """Sample the state if a sample is due."""
        if self.state.time >= self.last + self.period and self.ready():
            self._sample()

    def _sample(self) -> None:
        half = 0.5 * (self.state.time - self.last)
        for name, sample in self.samplers.items():
            value = np.array(sample(self.state), float)
            self.sums[name] += half * (self.values[name] + value)
            self.values[name] = value
        self.last = self.state.time

    def finish(self) -> dict[str, Array]:
        """Return the means over the interval that ends now, the present values where no time has passed; begin the next one."""
        self._sample()
        length = self.last - self.start
        means = {name: total / length if length > 0.0 else self.values[name] for name, total in self.sums.items()}
        self._begin()
        return means

    def export_state(self) -> dict[str, Array]:
        """Return the sums and the last samples as arrays by name."""
        sums = {f"sum_{name}": total for name, total in self.sums.items()}
        values = {f"last_{name}": value for name, value in self.values.items()}
        return {CLOCK: np.array([self.start, self.last, self.period])} | sums | values

    def restore(self, arrays: Mapping[str, Array]) -> None:
        """Restore the result of `export_state`. Raises ValueError, with the means unchanged, where it does not fit."""
        check(arrays, self.export_state())
        self.start, self.last, self.period = (float(x) for x in arrays[CLOCK])
        self.sums = {name: arrays[f"sum_{name}"].copy() for name in self.samplers}
        self.values = {name: arrays[f"last_{name}"].copy() for name in self.samplers}
