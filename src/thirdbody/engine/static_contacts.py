"""The compiled laws of one particle's spots, asked about straight steps of overlap and slip without any velocity."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from thirdbody.engine.state import Array, Ints
from thirdbody.kernels.columns import law_input, law_output, rolling_input
from thirdbody.kernels.columns.tile import TILE
from thirdbody.laws.codegen.laws import Chain, compose
from thirdbody.laws.contract import Law, Pair

AT_REST = ("damping", "tangential_damping")
"""Stages that have nothing to say where nothing moves in time."""
TANGENTS = 7
"""Derivatives that `tangents` gives."""


@dataclass(frozen=True, eq=False)
class Answer:
    """What the laws say of all spots, N and m; zero where a spot is open. `tangential` (n, 2) acts on the body."""

    normal: Array
    tangential: Array
    limit: Array
    critical: Array
    slip: Array
    contact_radius: Array
    memory: Array


class Contacts:
    """The compiled laws of one particle's spots: kind (n,) is the place of each spot's pair in `pairs`, radius (n,) in m.

    Laws of dashpots are left out, as nothing moves in time. Raises ValueError for a law of the rolling stage or without tangent.
    """

    def __init__(
        self,
        laws: Sequence[Law],
        pairs: Sequence[Pair],
        kind: Ints,
        radius: Array,
        options: Mapping[str, Any] | None = None,
    ) -> None:
        chosen = [law for law in laws if law.stage not in AT_REST and law.wanted(pairs)]
        values = {law.name: _options(law, options or {}) for law in chosen}
        chain = compose(law.sized(values[law.name]) for law in chosen)
        if any(law.stage == "rolling" for law in chain.laws):
            raise ValueError("a quasi-static path has no law of the rolling stage")
        if chain.tangents is None:
            raise ValueError(f"a law without tangent: {', '.join(law.name for law in chain.laws if law.tangent is None)}")
        self.chain: Chain = chain
        self.tangents: Callable = chain.tangents
        rows = [[float(x) for law in chain.laws for x in law.mix(pair, values[law.name])] for pair in pairs]
        self.pairs = np.array(rows, float).reshape(len(pairs), -1)
        if not self.pairs.size:
            self.pairs = np.zeros((len(pairs), 1))
        self.radius, self.kind = np.asarray(radius, float), np.asarray(kind, np.int64)
        # tables of the compiled laws, kept because those of a law with a long history take longer to allocate than to fill
        history = len(chain.history)
        self._inputs = np.zeros((law_input.HISTORY + history + rolling_input.WIDTH, TILE))
        self._outputs = np.zeros((max(TANGENTS, law_output.HISTORY + history), TILE))

    def virgin(self) -> Array:
        """The memory (n, width) of spots that never touched."""
        return np.zeros((len(self.radius), len(self.chain.history)))

    def ask(self, overlap: Array, slip: Array, memory: Array) -> Answer:
        """Forces (n,) after a straight step to `overlap` (n,) with `slip` (n, 2) from `memory`."""
        count = law_output.HISTORY + len(self.chain.history)
        out = self._call(self.chain.law, count, overlap, slip, memory)
        tangential = np.stack([out[law_output.TANGENTIAL_X], out[law_output.TANGENTIAL_Y]], axis=1)
        limit, critical, slid, radius = (
            out[k] for k in (law_output.FRICTION_LIMIT, law_output.CRITICAL_SLIP, law_output.SLIP, law_output.CONTACT_RADIUS)
        )
        return Answer(out[law_output.NORMAL_FORCE], tangential, limit, critical, slid, radius, out[law_output.HISTORY :].T)

    def stiffness(self, overlap: Array, slip: Array, memory: Array) -> Array:
        """(7, n): dN/dd, dTx/dsx, dTx/dsy, dTy/dsx, dTy/dsy, dTx/dd, dTy/dd of the step, N/m; 0 for open spots."""
        return self._call(self.tangents, TANGENTS, overlap, slip, memory)

    def hold(self, before: Array, overlap: Array, slip: Array, memory: Array, answer: Answer) -> Array:
        """(n,) tangential stiffness of the step along the force, over that of a spot that never slipped: 1 sticks, 0 slides.

        Both steps go from the overlap `before`: the ring that closes in the step takes a part of the slip only.
        """
        still = np.zeros_like(slip)
        unslipped = self.ask(np.maximum(before, 0.0), still, self.virgin()).memory
        now, whole = self.stiffness(overlap, slip, memory), self.stiffness(overlap, still, unslipped)
        size = np.hypot(*answer.tangential.T)
        along = np.where(size > 0.0, answer.tangential.T / np.where(size > 0.0, size, 1.0), np.sqrt(0.5))
        e_x, e_y = along
        resists = [-(e_x * (k[1] * e_x + k[2] * e_y) + e_y * (k[3] * e_x + k[4] * e_y)) for k in (now, whole)]
        return np.where(resists[1] > 0.0, resists[0] / np.where(resists[1] > 0.0, resists[1], 1.0), 0.0)

    def _call(self, function: Callable, count: int, overlap: Array, slip: Array, memory: Array) -> Array:
        answer = np.zeros((count, len(overlap)))
        loaded = np.flatnonzero(overlap > 0.0)
        history = len(self.chain.history)
        inputs, outputs = self._inputs, self._outputs
        for first in range(0, len(loaded), TILE):
            part = loaded[first : first + TILE]
            n = len(part)
            outputs[:, :n] = 0.0
            inputs[law_input.OVERLAP, :n], inputs[law_input.RADIUS, :n] = overlap[part], self.radius[part]
            inputs[law_input.MASS, :n], inputs[law_input.PAIR_TYPE, :n] = 1.0, self.kind[part]
            inputs[law_input.SLIP_X, :n], inputs[law_input.SLIP_Y, :n] = slip[part, 0], slip[part, 1]
            inputs[law_input.HISTORY : law_input.HISTORY + history, :n] = memory[part].T
            function(inputs.ravel(), outputs.ravel(), n, self.pairs.ravel())
            answer[:, part] = outputs[:count, :n]
        return answer


def _options(law: Law, given: Mapping[str, Any]) -> dict[str, Any]:
    """The values of a law's options: those given, else the defaults. Raises ValueError for one that has none."""
    values = {option.name: given.get(option.name, option.default) for option in law.options}
    for name, value in values.items():
        if value is None:
            raise ValueError(f"the law '{law.name}' needs a value for '{name}'")
    return values
