"""Compiled laws of one particle's contacts for straight steps of overlap and slip in statics."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from thirdbody.engine.state import Array, Ints
from thirdbody.engine.static_interaction import SpotBending
from thirdbody.kernels.contact_fields import pieces
from thirdbody.kernels.tile import TILE, law_input, law_output, rolling_input
from thirdbody.laws.compose import Chain, compose
from thirdbody.laws.contract import Law, Pair
from thirdbody.laws.registry import installed_interaction

AT_REST = ("damping", "tangential_damping")
"""Stages without effect in statics."""
TANGENTS = 7
"""Number of derivatives written by `tangents`."""


@dataclass(frozen=True, eq=False)
class Answer:
    """Output of the laws for all contacts, SI; 0 for open ones. `tangential` (n, 2): on the body."""

    normal: Array
    tangential: Array
    limit: Array
    critical: Array
    slip: Array
    contact_radius: Array
    memory: Array


class Contacts:
    """Compiled laws of one particle's contacts.

    `kind` (n,): index of each contact's pair in `pairs`; `radius` (n,) [m]. Dashpot laws are omitted in statics. Raises
    ValueError for a law of the rolling or twisting stage or without tangent. `interaction`: name of the effect by which spots
    on one plate interact; raises InputError where it is not installed.
    """

    def __init__(
        self, laws: Sequence[Law], pairs: Sequence[Pair], kind: Ints, radius: Array, options: Mapping[str, Any] | None = None,
        interaction: str | None = None,
    ) -> None:  # fmt: skip
        self.interaction = None if interaction is None else installed_interaction(interaction)
        self.materials = tuple(pairs)
        chosen = [law for law in laws if law.stage not in AT_REST and law.wanted(pairs)]
        values = {law.name: _options(law, options or {}) for law in chosen}
        chain = compose(law.sized(values[law.name]) for law in chosen)
        if any(law.stage in ("rolling", "twisting") for law in chain.laws):
            raise ValueError("a quasi-static path has no law of the rolling or of the twisting stage")
        if chain.reaching:
            raise ValueError(f"a quasi-static path has no law that acts before touch: {', '.join(chain.reaching)}")
        if chain.tangents is None:
            raise ValueError(f"a law without tangent: {', '.join(law.name for law in chain.laws if law.tangent is None)}")
        self.chain: Chain = chain
        self.tangents: Callable = chain.tangents
        rows = [[float(x) for law in chain.laws for x in law.mix(pair, law.options_of(pair, values[law.name]))] for pair in pairs]
        self.pairs = np.array(rows, float).reshape(len(pairs), -1)
        if not self.pairs.size:
            self.pairs = np.zeros((len(pairs), 1))
        self.radius, self.kind = np.asarray(radius, float), np.asarray(kind, np.int64)
        # tables of the compiled laws, reused because with a long history allocation takes longer than filling
        history = len(chain.history)
        self._inputs = np.zeros((law_input.HISTORY + history + rolling_input.WIDTH, TILE))
        self._outputs = np.zeros((max(TANGENTS, law_output.HISTORY + history), TILE))

    def virgin(self) -> Array:
        """Return the history (n, width) of virgin contacts."""
        return np.zeros((len(self.radius), len(self.chain.history)))

    def bending(self, position: Array, upper: NDArray[np.bool_]) -> SpotBending | None:
        """Return how spots at `position` (n, 3) [m] lower the plates under each other; None without an interaction."""
        if self.interaction is None:
            return None
        compliance = np.array([self.interaction.compliance(pair.b, {}) for pair in self.materials])
        stiffness = np.array([self.interaction.stiffness(pair, {}) for pair in self.materials])
        return SpotBending(position, upper, self.radius, compliance[self.kind], stiffness[self.kind])

    def evaluate(self, overlap: Array, slip: Array, memory: Array) -> Answer:
        """Return the output after a step to `overlap` (n,) [m] with `slip` (n, 2) [m] from `memory`."""
        count = law_output.HISTORY + len(self.chain.history)
        outputs = self._call(self.chain.law, count, overlap, slip, memory)
        tangential = np.stack([outputs[law_output.TANGENTIAL_X], outputs[law_output.TANGENTIAL_Y]], axis=1)
        limit, critical, slid, radius = (
            outputs[k] for k in (law_output.FRICTION_LIMIT, law_output.CRITICAL_SLIP, law_output.SLIP, law_output.CONTACT_RADIUS)
        )
        return Answer(
            outputs[law_output.NORMAL_FORCE], tangential, limit, critical, slid, radius, outputs[law_output.HISTORY :].T
        )

    def stiffness(self, overlap: Array, slip: Array, memory: Array) -> Array:
        """Return (7, n) [N/m]: dN/dd, dTx/dsx, dTx/dsy, dTy/dsx, dTy/dsy, dTx/dd, dTy/dd; 0 for open contacts."""
        return self._call(self.tangents, TANGENTS, overlap, slip, memory)

    def stiffness_ratio(self, before: Array, overlap: Array, slip: Array, memory: Array, answer: Answer) -> Array:
        """Return the relative tangential stiffness (n,) along the force: 1 sticks, 0 slides.

        It is relative to a contact that never slipped. Both are for a step from the overlap `before`: the annulus that closes
        within the step sees only a part of the slip.
        """
        still = np.zeros_like(slip)
        unslipped = self.evaluate(np.maximum(before, 0.0), still, self.virgin()).memory
        now, whole = self.stiffness(overlap, slip, memory), self.stiffness(overlap, still, unslipped)
        size = np.hypot(*answer.tangential.T)
        along = np.where(size > 0.0, answer.tangential.T / np.where(size > 0.0, size, 1.0), np.sqrt(0.5))
        e_x, e_y = along
        resists = [-(e_x * (k[1] * e_x + k[2] * e_y) + e_y * (k[3] * e_x + k[4] * e_y)) for k in (now, whole)]
        return np.where(resists[1] > 0.0, resists[0] / np.where(resists[1] > 0.0, resists[1], 1.0), 0.0)

    def _call(self, function: Callable, count: int, overlap: Array, slip: Array, memory: Array) -> Array:
        answer = np.zeros((count, len(overlap)))
        loaded = np.flatnonzero(overlap > 0.0)
        history, (begin, size) = len(self.chain.history), self.chain.field
        inputs, outputs, field = self._inputs, self._outputs, slice(begin, begin + size)
        for first in range(0, len(loaded), TILE):
            part = loaded[first : first + TILE]
            n = len(part)
            outputs[:, :n] = 0.0
            inputs[law_input.OVERLAP, :n], inputs[law_input.RADIUS, :n] = overlap[part], self.radius[part]
            inputs[law_input.MASS, :n], inputs[law_input.PAIR_TYPE, :n] = 1.0, self.kind[part]
            inputs[law_input.SLIP_X, :n], inputs[law_input.SLIP_Y, :n] = slip[part, 0], slip[part, 1]
            inputs[law_input.HISTORY : law_input.HISTORY + history, :n] = memory[part].T
            pieces(inputs[law_input.HISTORY :][field])[:n] = memory[part, field]
            function(inputs.ravel(), outputs.ravel(), n, self.pairs.ravel())
            answer[:, part] = outputs[:count, :n]
            if count > TANGENTS:  # not the tangents
                answer[law_output.HISTORY :][field, part] = pieces(outputs[law_output.HISTORY :][field])[:n].T
        return answer


def _options(law: Law, given: Mapping[str, Any]) -> dict[str, Any]:
    """Return the values of a law's options, given or default. Raises ValueError for an option without value."""
    values = {option.name: given.get(option.name, option.default) for option in law.options}
    for name, value in values.items():
        if value is None:
            raise ValueError(f"the law '{law.name}' needs a value for '{name}'")
    return values
