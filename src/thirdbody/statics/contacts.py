"""Compiled laws of contacts in statics: of one particle for straight steps of overlap and slip, and of single virgin contacts."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from thirdbody.kernels.close_spots import NEAR
from thirdbody.kernels.memory import pieces
from thirdbody.kernels.table import Array
from thirdbody.kernels.tile import TILE, law_input, law_output, rolling_input, rolling_output
from thirdbody.laws.compose import compose
from thirdbody.laws.contract import Law, Pair
from thirdbody.laws.registry import installed_interaction

Ints = NDArray[np.int64]

AT_REST = ("damping", "tangential_damping")  # stages without effect in statics
TANGENTS = 7  # number of derivatives written by `tangents`
ITERATIONS = 60  # most steps of Newton's method for the interaction of spots, where four to six are enough; of a bisection


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
    ValueError for a law of the rolling or twisting stage, without tangent, or with an option without value. `interaction`: name
    of the effect by which spots on one plate interact; raises InputError where it is not installed.
    """

    def __init__(
        self, laws: Sequence[Law], pairs: Sequence[Pair], kind: Ints, radius: Array, options: Mapping[str, Any] | None = None,
        interaction: str | None = None,
    ) -> None:  # fmt: skip
        self.interaction = None if interaction is None else installed_interaction(interaction)
        self.materials = tuple(pairs)
        chosen = [law for law in laws if law.stage not in AT_REST and law.wanted(pairs)]
        values = {law.name: {o.name: (options or {}).get(o.name, o.default) for o in law.options} for law in chosen}
        for law, name in ((law, name) for law, given in values.items() for name, value in given.items() if value is None):
            raise ValueError(f"the law '{law}' needs a value for '{name}'")
        self.chain = chain = compose(law.sized(values[law.name]) for law in chosen)
        if any(law.stage in ("rolling", "twisting") for law in chain.laws):
            raise ValueError("a quasi-static path has no law of the rolling or of the twisting stage")
        if chain.reaching:
            raise ValueError(f"a quasi-static path has no law that acts before touch: {', '.join(chain.reaching)}")
        if chain.tangents is None:
            raise ValueError(f"a law without tangent: {', '.join(law.name for law in chain.laws if law.tangent is None)}")
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

    def bending(self, position: Array, upper: NDArray[np.bool_]) -> "SpotBending | None":
        """Return how spots at `position` (n, 3) [m] lower the plates under each other; None without an interaction."""
        if self.interaction is None:
            return None
        compliance = np.array([self.interaction.compliance(pair.b, {}) for pair in self.materials])
        stiffness = np.array([self.interaction.stiffness(pair, {}) for pair in self.materials])
        return SpotBending(position, upper, self.radius, compliance[self.kind], stiffness[self.kind])

    def evaluate(self, overlap: Array, slip: Array, memory: Array) -> Answer:
        """Return the output after a step to `overlap` (n,) [m] with `slip` (n, 2) [m] from `memory`."""
        outputs = self._call(self.chain.law, law_output.HISTORY + len(self.chain.history), overlap, slip, memory)
        tangential = np.stack([outputs[law_output.TANGENTIAL_X], outputs[law_output.TANGENTIAL_Y]], axis=1)
        limit, critical, slid = outputs[law_output.FRICTION_LIMIT], outputs[law_output.CRITICAL_SLIP], outputs[law_output.SLIP]
        normal, radius = outputs[law_output.NORMAL_FORCE], outputs[law_output.CONTACT_RADIUS]
        return Answer(normal, tangential, limit, critical, slid, radius, outputs[law_output.HISTORY :].T)

    def stiffness(self, overlap: Array, slip: Array, memory: Array) -> Array:
        """Return (7, n) [N/m]: dN/dd, dTx/dsx, dTx/dsy, dTy/dsx, dTy/dsy, dTx/dd, dTy/dd; 0 for open contacts."""
        return self._call(self.tangents, TANGENTS, overlap, slip, memory)

    def stiffness_ratio(self, before: Array, overlap: Array, slip: Array, memory: Array, answer: Answer) -> Array:
        """Return the relative tangential stiffness (n,) along the force: 1 sticks, 0 slides. It is relative to a contact that
        never slipped. Both are for a step from the overlap `before`: the annulus that closes within the step sees only a part of
        the slip."""
        still = np.zeros_like(slip)
        unslipped = self.evaluate(np.maximum(before, 0.0), still, self.virgin()).memory
        now, whole = self.stiffness(overlap, slip, memory), self.stiffness(overlap, still, unslipped)
        size = np.hypot(*answer.tangential.T)
        e_x, e_y = np.where(size > 0.0, answer.tangential.T / np.where(size > 0.0, size, 1.0), np.sqrt(0.5))
        resists = [-(e_x * (k[1] * e_x + k[2] * e_y) + e_y * (k[3] * e_x + k[4] * e_y)) for k in (now, whole)]
        return np.where(resists[1] > 0.0, resists[0] / np.where(resists[1] > 0.0, resists[1], 1.0), 0.0)

    def _call(self, function: Callable, count: int, overlap: Array, slip: Array, memory: Array) -> Array:
        answer = np.zeros((count, len(overlap)))
        loaded = np.flatnonzero(overlap > 0.0)
        history, (begin, size) = len(self.chain.history), self.chain.field
        inputs, outputs, field = self._inputs, self._outputs, slice(begin, begin + size)
        for first in range(0, len(loaded), TILE):
            rows = loaded[first : first + TILE]
            n = len(rows)
            outputs[:, :n] = 0.0
            inputs[law_input.OVERLAP, :n], inputs[law_input.RADIUS, :n] = overlap[rows], self.radius[rows]
            inputs[law_input.MASS, :n], inputs[law_input.PAIR_TYPE, :n] = 1.0, self.kind[rows]
            inputs[law_input.SLIP_X, :n], inputs[law_input.SLIP_Y, :n] = slip[rows, 0], slip[rows, 1]
            inputs[law_input.HISTORY : law_input.HISTORY + history, :n] = memory[rows].T
            pieces(inputs[law_input.HISTORY :][field])[:n] = memory[rows, field]
            function(inputs.ravel(), outputs.ravel(), n, self.pairs.ravel())
            answer[:, rows] = outputs[:count, :n]
            if count > TANGENTS:  # not the tangents
                answer[law_output.HISTORY :][field, rows] = pieces(outputs[law_output.HISTORY :][field])[:n].T
        return answer


class SpotBending:
    """Spots of a particle that lower the plate under each other, as `kernels.close_spots` has it in runs.

    Kinematics is linear, so their distances stay as they are and no force along the plate arises. `compliance` (n,): of the plate
    of each spot [m2/N]; `stiffness` (n,): force over (R d^3)^(1/2) [Pa].
    """

    def __init__(self, position: Array, upper: NDArray[np.bool_], radius: Array, compliance: Array, stiffness: Array) -> None:
        apart = np.hypot(*(position[:, None, :2] - position[None, :, :2]).transpose(2, 0, 1))
        apart = np.maximum(apart, NEAR * np.minimum(radius[:, None], radius[None]))
        self.bend = np.where(upper[:, None] == upper[None], compliance[:, None] / apart, 0.0)  # (n, n) [m/N]
        np.fill_diagonal(self.bend, 0.0)
        self.stiffness = stiffness * np.sqrt(radius)  # (n,) [N/m^(3/2)]

    def relieved(self, overlap: Array) -> Array:
        """Return what presses on each spot itself (n,) [m], x = d - sum_j g_ij N_j(x); negative where nothing does."""
        x = overlap.copy()
        for _ in range(ITERATIONS):
            root = np.sqrt(np.maximum(x, 0.0))
            force, slope = self.stiffness * root**3, 1.5 * self.stiffness * root
            step = np.linalg.solve(np.eye(len(x)) + self.bend * slope, x + self.bend @ force - overlap)
            x = x - step
            if np.abs(step).max() <= 1e-15 * np.abs(overlap).max():
                break
        return x

    def rates(self, relieved: Array) -> Array:
        """Return the change (n, n) of what presses on each spot itself with the overlaps of all."""
        slope = 1.5 * self.stiffness * np.sqrt(np.maximum(relieved, 0.0))
        return np.asarray(np.linalg.inv(np.eye(len(relieved)) + self.bend * slope))


class Compiled(Protocol):
    """Compiled laws of a scene, with a row of parameters per pair (`engine.state.Physics`)."""

    @property
    def law(self) -> Callable: ...
    @property
    def stiffness(self) -> Callable | None: ...
    @property
    def history(self) -> tuple[str, ...]: ...
    @property
    def pairs(self) -> Array: ...


class Response(NamedTuple):
    """Virgin contacts (n,): normal force [N], stiffness [N/m] (NaN without tangents), peak pressure [Pa]."""

    force: Array
    stiffness: Array
    pressure: Array


def response(physics: Compiled, overlap: Array, radius: Array, kind: Ints) -> Response:
    """Return the response of virgin contacts at an overlap (n,) [m]."""
    count = len(overlap)
    force, stiffness, pressure = np.empty(count), np.full(count, np.nan), np.empty(count)
    width = law_input.HISTORY + len(physics.history) + rolling_input.WIDTH
    answers = law_output.HISTORY + len(physics.history) + rolling_output.WIDTH
    for first in range(0, count, TILE):
        rows = slice(first, min(first + TILE, count))
        n = rows.stop - rows.start
        inputs, outputs = np.zeros((width, TILE)), np.zeros((answers, TILE))
        inputs[law_input.OVERLAP, :n], inputs[law_input.RADIUS, :n] = overlap[rows], radius[rows]
        inputs[law_input.MASS], inputs[law_input.PAIR_TYPE, :n] = 1.0, kind[rows]
        physics.law(inputs.ravel(), outputs.ravel(), n, physics.pairs)
        force[rows], pressure[rows] = outputs[law_output.NORMAL_FORCE, :n], outputs[law_output.PEAK_PRESSURE, :n]
        if physics.stiffness is not None:
            physics.stiffness(inputs.ravel(), outputs.ravel(), n, physics.pairs)
            stiffness[rows] = outputs[0, :n]
    return Response(force, stiffness, pressure)


def overlap_at(physics: Compiled, load: Array, radius: Array, kind: Ints) -> Array:
    """Return the overlap (n,) [m], at most the radius, of virgin contacts under `load` (n,) [N]."""
    return _bisected(lambda overlap: response(physics, overlap, radius, kind).force < load, radius)


def load_at(physics: Compiled, pressure: Array, radius: Array, kind: Ints) -> Array:
    """Return the load (n,) [N] under which virgin contacts have the peak pressure (n,) [Pa]; 0 if every load exceeds it."""
    overlap = _bisected(lambda overlap: response(physics, overlap, radius, kind).pressure < pressure, radius)
    return response(physics, overlap, radius, kind).force


def _bisected(is_below: Callable[[Array], NDArray[np.bool_]], radius: Array) -> Array:
    """Return the overlap (n,) [m], at most the radius, up to which `is_below` holds."""
    low, high = np.zeros_like(radius, float), radius.astype(float)
    for _ in range(ITERATIONS):
        middle = 0.5 * (low + high)
        below = is_below(middle)
        low, high = np.where(below, middle, low), np.where(below, high, middle)
    return high
