"""Bench of the conformance suite for one law: its composed tile function, materials, and paths of contacts.

Arrays are (T, TILE) or (T, k, TILE): one tile for each setting, times `repeats`, all run at once. A setting is a pair of
materials, a radius and a set of options, from ordinary to extreme.

A rolling law follows the same paths: its moment over R* is the tangential force, and the slip over R* is the rotation, so that
work and power are the same and every test of a tangential law applies to a rolling law. A twisting law gets the first component
of the slip alone.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from types import FunctionType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from thirdbody.kernels.memory import pieces
from thirdbody.kernels.tile import TILE, law_input, law_output, rolling_input, rolling_output
from thirdbody.laws.compose import compose
from thirdbody.laws.contract import Law, Material, Option, Pair, kernel
from thirdbody.laws.data import Normal
from thirdbody.laws.friction import MINDLIN
from thirdbody.laws.generated import plain
from thirdbody.laws.hertz import HERTZ, HertzParameters, mix_hertz

Array = NDArray[np.float64]
Result = tuple[bool, str]
"""Whether a test has passed, and a detail: the worst case, or what is wrong."""

SEED = 20240501
SPAN = 1e-3
"""Duration of one straight segment of a path [s]; sets the velocities only."""

STEEL = Material("steel", 80e9, 0.3, 7850.0)
CERAMIC = Material("ceramic", 120e9, 0.2, 3900.0)
CORK = Material("cork", 10e6, 0.0, 200.0)
RUBBER = Material("rubber", 80e6, 0.5 - 1e-12, 1100.0)
GLASS = Material("glass", 30e9, 0.1, 2500.0)

PAIRS: tuple[tuple[str, Pair, float], ...] = (
    ("steel on ceramic, 5 um", Pair(STEEL, CERAMIC, 0.3, 0.6), 5e-6),
    ("glass on glass, 10 mm, friction 0.9", Pair(GLASS, GLASS, 0.9, 1.0), 1e-2),
    ("soft incompressible on stiff, 1 m", Pair(RUBBER, STEEL, 1.2, 0.05), 1.0),
    ("slippery, 50 nm", Pair(STEEL, GLASS, 0.02, 0.98), 5e-8),
    ("cork on ceramic, 1 mm", Pair(CORK, CERAMIC, 0.5, 0.3), 1e-3),
    ("frictionless, 5 um", Pair(STEEL, CERAMIC, 0.0, 0.5), 5e-6),
    ("friction 1e9, 5 um", Pair(STEEL, CERAMIC, 1e9, 0.5), 5e-6),
)

TYPICAL = {
    "energy_per_area": 0.05, "length": 1e-7, "time": 1e-6, "velocity": 0.1, "force": 1e-5, "pressure": 1e8,
    "density": 2000.0, "stiffness": 1e3, "damping": 1e-6, "energy": 1e-12, "torque": 1e-11, "viscosity": 1e-3,
}  # fmt: skip
"""Value in SI for an option without a default, by its dimension; 0.1 for any other."""


SLOPE = 20.0
"""Contact radius over overlap of the cone."""


@kernel
def cone(c, p):
    """N = E* a d with a = SLOPE d, stored energy N d/3 (Sneddon 1965); pressure: the mean one, as that of the tip is infinite."""
    a = SLOPE * c.overlap
    force = p.e_star * a * c.overlap
    return Normal(force, a, force * c.overlap / 3.0, 0.0, p.e_star / (math.pi * SLOPE), 2.0 * SLOPE * a)


@kernel
def cone_tangent(c, p):
    """dN/dd = 2 E* a [N/m]."""
    return 2.0 * p.e_star * SLOPE * c.overlap


CONE = Law(
    "cone", "normal", cone, HertzParameters, mix_hertz, "Sneddon 1965, International Journal of Engineering Science 3, 47",
    tangent=cone_tangent,
)  # fmt: skip
"""A blunt cone, whose contact radius grows as the overlap: a law that takes the contact area from the normal law (`Load`) is
right under it too; one that assumes a sphere is not."""


class Setting(NamedTuple):
    """One row of the parameter table: materials, the law's options, the contact's effective radius [m]."""

    label: str
    pair: Pair
    options: dict[str, Any]
    radius: float


def option_sets(part: Any) -> list[tuple[str, dict[str, Any]]]:
    """Return values for the options of a law or another part: typical ones, then all at their ends where these are finite."""
    sets: list[tuple[str, dict[str, Any]]] = []
    for label in ("", "lowest", "highest"):
        values = {option.name: _value(option, label) for option in part.options}
        if values not in [known for _, known in sets]:
            sets.append((f", options {label}" if label else "", values))
    return sets


def _value(option: Option, end: str) -> float | str | tuple[float, ...]:
    if option.words and not end and isinstance(option.default, str | float | int):
        return option.default
    if option.words and not (option.or_number and end):
        return option.words[-1 if end == "highest" else 0]
    bound = {"lowest": option.low, "highest": option.high}.get(end, math.nan)
    usual = TYPICAL.get(option.dimension, 0.1) if option.default is None else option.default
    if math.isfinite(bound):
        usual = bound
    elif isinstance(usual, Sequence) and not isinstance(usual, str):
        return tuple(usual)
    value = min(max(float(usual), option.low), option.high)
    return value if option.size == 1 else (value,) * option.size


def forms_of(law: Law) -> list[Law]:
    """Return the law and its variants for the words of its options, named `NAME_WORD`."""
    forms = [replace(law, variant=None)]
    variant = law.variant or (lambda options: None)
    for name, word in [(option.name, word) for option in law.options for word in option.words]:
        result = variant({option.name: word if option.name == name else option.default for option in law.options})
        if result:
            options = tuple(replace(one, default=word) if one.name == name else one for one in result.options)
            forms.append(replace(result, name=f"{law.name}_{word}", options=options))
    return forms


ROLLED = (
    (law_output.TANGENTIAL_X, rolling_output.MOMENT_X),
    (law_output.TANGENTIAL_Y, rolling_output.MOMENT_Y),
    (law_output.FRICTION_LIMIT, rolling_output.MOMENT_LIMIT),
)
"""What stands for force and limit of a rolling law, over R*."""

TWISTED = ((law_output.TANGENTIAL_X, rolling_output.TWIST_MOMENT), (law_output.FRICTION_LIMIT, rolling_output.TWIST_LIMIT))
"""The same of a twisting law; its second component is zero."""


class Contacts(NamedTuple):
    """Input of a tile, SI: overlap (T, TILE), slip (T, 2, TILE), separation speed, slip velocity."""

    overlap: Array
    slip: Array
    v_n: Array
    v: Array


class Bench:
    """One law in its place in a chain: after Hertz unless it is a normal law; a tangential dashpot after Mindlin, too."""

    def __init__(self, law: Law):
        below: dict[str, tuple[Law, ...]] = {"normal": (), "tangential_damping": (HERTZ, MINDLIN)}
        self.law = law = law.sized(option_sets(law)[0][1])
        self.chain = compose((*below.get(law.stage, (HERTZ,)), law))
        self.index = self.chain.laws.index(law)
        sets = option_sets(law)
        self.settings = [Setting(name + label, pair, options, radius) for label, options in sets for name, pair, radius in PAIRS]
        self.rows = [tuple(one.mix(s.pair, s.options if one is law else {}) for one in self.chain.laws) for s in self.settings]
        self.table = np.zeros((len(self.rows), self.chain.width))
        for k, row in enumerate(self.rows):
            numbers = [x for p in row for x in p]
            self.table[k, : len(numbers)] = numbers
        self.width = len(self.chain.history)
        self.field = slice(self.chain.field[0], sum(self.chain.field))
        self.rolling = law.stage == "rolling"
        self.twisting = law.stage == "twisting"
        self.has_moment = self.rolling or self.twisting
        self.sheared = law.stage == "tangential" or self.has_moment

    def parameters(self, setting: int) -> Any:
        """Return the law's parameters in a setting."""
        return self.rows[setting][self.index]

    def per_tile(self, values: Sequence[float], tiles: int) -> Array:
        """Return a number of each setting as (tiles, 1)."""
        return np.array(values, float)[np.arange(tiles) % len(self.settings), None]

    def radius(self, tiles: int) -> Array:
        """Return the effective radius [m]."""
        return self.per_tile([s.radius for s in self.settings], tiles)

    def outermost(self, tiles: int) -> Array:
        """Return the overlap from which on bodies act on each other [m]: zero, or minus the reach of the law."""
        reach = self.law.reach or (lambda pair, options, radius: 0.0)
        return 0.0 - self.per_tile([reach(s.pair, s.options, s.radius) for s in self.settings], tiles)

    def friction(self, tiles: int) -> Array:
        """Return the friction coefficient of the pair."""
        return self.per_tile([s.pair.friction for s in self.settings], tiles)

    def inputs(self, requested: Contacts, history: Array) -> Array:
        """Return the tiles in the engine's layout, (T, fields, TILE)."""
        tiles = len(requested.overlap)
        radius = self.radius(tiles)
        end = law_input.HISTORY + self.width
        I = np.zeros((tiles, end + rolling_input.WIDTH, TILE))  # noqa: E741
        I[:, law_input.OVERLAP], I[:, law_input.RADIUS], I[:, law_input.MASS] = requested.overlap, radius, 8e3 * radius**3
        I[:, law_input.NORMAL_VELOCITY] = requested.v_n
        I[:, law_input.SLIP_X : law_input.SLIP_Y + 1] = requested.slip
        I[:, law_input.VELOCITY_X : law_input.VELOCITY_Y + 1] = requested.v
        I[:, law_input.PAIR_TYPE] = self.per_tile(range(len(self.settings)), tiles)
        I[:, law_input.HISTORY : end] = history
        for tile, memory in zip(I[:, law_input.HISTORY : end], history, strict=True):
            pieces(tile[self.field])[:] = memory[self.field].T
        if self.rolling:
            I[:, end : end + 2], I[:, end + 2 : end + 4] = requested.slip / radius[:, None], requested.v / radius[:, None]
        if self.twisting:
            I[:, end + rolling_input.TWIST] = requested.slip[:, 0] / radius
            I[:, end + rolling_input.TWIST_RATE] = requested.v[:, 0] / radius
        return I

    def call(self, requested: Contacts, history: Array, law: Callable | None = None) -> tuple[Array, Array]:
        """Return results (T, 13, TILE) by `columns.law_output`, and the new history (T, h, TILE)."""
        I = self.inputs(requested, history)  # noqa: E741
        end = law_output.HISTORY + self.width
        O = np.full((len(I), end + rolling_output.WIDTH, TILE), np.nan)  # noqa: E741
        flat, out, table = I.reshape(len(I), -1), O.reshape(len(I), -1), self.table.ravel()
        for t in range(len(I)):
            (law or self.chain.law)(flat[t], out[t], TILE, table)
        if self.has_moment:
            per_arm = 1.0 / self.radius(len(I))
            for force, moment in ROLLED if self.rolling else TWISTED:
                O[:, force] = O[:, end + moment] * per_arm
        memory = O[:, law_output.HISTORY : end]
        for tile in memory:
            tile[self.field] = pieces(tile[self.field]).T.copy()
        return O[:, : law_output.HISTORY], memory

    def virgin(self, tiles: int) -> Array:
        """Return an empty history."""
        return np.zeros((tiles, self.width, TILE))

    def interpreted(self) -> Callable:
        """Return the tile function without the compiler, on Python floats: a division by zero raises."""
        text = plain(self.chain.law)
        names = {name: plain(value) for name, value in text.__globals__.items()}
        own = [name for name, value in names.items() if getattr(value, "__globals__", None) is text.__globals__]
        names |= {name: FunctionType(names[name].__code__, names) for name in own}
        names["stack_array"] = lambda n: [0.0] * n
        for k, law in enumerate(self.chain.laws):  # of the module, what kernels call has no wrapper for Python
            names |= {f"kernel_{k}": plain(law.kernel), f"added_load_{k}": plain(law.added_load)}
        on_lists = names["law"]
        block = slice((law_output.HISTORY + self.field.start) * TILE, (law_output.HISTORY + self.field.stop) * TILE)

        def run(flat: Array, out: Array, n: int, table: Array) -> None:
            inputs, outputs = flat.tolist(), out.tolist()
            names["array_part"] = lambda size, numbers, first: (flat if numbers is inputs else out)[first : first + size]
            on_lists(inputs, outputs, n, table.tolist())
            outputs[block] = out[block]
            out[:] = outputs

        return run


def compiler_is_off() -> bool:
    """Return whether numba is disabled and all functions run in the interpreter."""
    return plain(HERTZ.kernel) is HERTZ.kernel


class Path(NamedTuple):
    """Piecewise straight paths from the virgin state: overlap (k, T, TILE) and slip (k, T, 2, TILE) at the corners [m].

    `start`: overlap (T, 1) at the start; None: zero.
    """

    overlap: Array
    slip: Array
    start: Array | None = None

    def steps(self, m: int) -> Iterator[Contacts]:
        """Yield the contacts after each of m equal steps per segment."""
        old, at_slip = np.zeros_like(self.overlap[0]), np.zeros_like(self.slip[0])
        old = old if self.start is None else old + self.start
        for new, to_slip in zip(self.overlap, self.slip, strict=True):
            v, v_n = (to_slip - at_slip) / SPAN, (old - new) / SPAN
            for i in range(1, m + 1):
                yield Contacts(old + (new - old) * (i / m), (to_slip - at_slip) / m, v_n, v)
            old, at_slip = new, to_slip


class Moment(NamedTuple):
    """One step of a path: input, history before it, result. Open contacts have the result zero."""

    requested: Contacts
    before: Array
    answer: Array
    after: Array


def follow_path(bench: Bench, path: Path, m: int) -> Iterator[Moment]:
    """Run the law along the paths as the engine does: open contacts are skipped and lose their history."""
    tiles = len(path.overlap[0])
    history, radius, outermost = bench.virgin(tiles), bench.radius(tiles), bench.outermost(tiles)
    for requested in path.steps(m):
        is_open = (requested.overlap <= outermost)[:, None]
        idle = requested._replace(overlap=np.where(is_open[:, 0], 1e-3 * radius, requested.overlap))
        answer, after = bench.call(idle, history)
        answer, after = np.where(is_open, 0.0, answer), np.where(is_open, 0.0, after)
        yield Moment(requested, history, answer, after)
        history = after


def random_paths(bench: Bench, corners: int, repeats: int = 1, resolved: bool = False) -> Path:
    """Random corners: overlap 1e-6 to 0.03 radii, one in eight apart; a third of the paths have their slip on a line.

    Corners apart are beyond touch and, where the law has a reach, from touch to twice the reach.

    The slip is scaled by the overlap, by the radius, or by the displacement at which, according to the law, a virgin contact
    slips; only by the last if `resolved`, so that every reversal takes some twenty steps.
    """
    rng = np.random.default_rng(SEED)
    tiles = repeats * len(bench.settings)
    lanes = (tiles, TILE)
    deepest = bench.radius(tiles) * 10.0 ** rng.uniform(-6.0, -1.5, lanes)
    overlap = deepest * rng.uniform(0.02, 1.0, (corners, *lanes))
    apart = np.where(bench.outermost(tiles) < 0.0, bench.outermost(tiles) * np.linspace(0.0, 2.0, TILE), -0.2 * deepest)
    overlap = np.where(rng.random(overlap.shape) < 0.125, apart, overlap)
    scale = rng.integers(3, size=lanes)
    by_overlap = np.clip(bench.friction(tiles), 0.02, 3.0) * deepest * 10.0 ** rng.uniform(-1.5, 1.0, lanes)
    by_radius = bench.radius(tiles) * 10.0 ** rng.uniform(-5.0, -1.0, lanes)
    still, none = np.zeros(lanes), np.zeros((tiles, 2, TILE))
    critical = bench.call(Contacts(deepest, none, still, none), bench.virgin(tiles))[0][:, law_output.CRITICAL_SLIP]
    critical = np.where(np.isfinite(critical), critical, 0.0)
    by_critical = np.where(critical > 0.0, critical * 10.0 ** rng.uniform(-1.5, 1.0, lanes), by_overlap)
    size = np.where(scale == 0, by_overlap, np.where(scale == 1, by_radius, by_critical))
    size = by_critical if resolved else size
    slip = size[:, None] * rng.uniform(-1.0, 1.0, (corners, tiles, 2, TILE))
    angle = rng.uniform(0.0, 2.0 * np.pi, lanes)
    line = np.stack([np.cos(angle), np.sin(angle)], 1)
    on_line = np.sum(slip * line, 2, keepdims=True) * line
    return Path(overlap, np.where(rng.random((tiles, 1, TILE)) < 0.3, on_line, slip))


def closed_cycles(bench: Bench) -> Path:
    """Press, shear, change the overlap, shear back, return: with less overlap (C1) or more (C2) on the return.

    On these paths the form F = k_t(d) xi creates the energy (k_1 - k_0) U^2/2 (Elata and Berryman 1996).
    """
    tiles = len(bench.settings)
    rng = np.random.default_rng(SEED + 1)
    high = bench.radius(tiles) * 10.0 ** rng.uniform(-4.0, -2.0, (tiles, TILE))
    low = 0.4 * high
    overlaps, shallow = (low, low, high, high, low), (high, high, low, low, high)
    overlap = np.where(np.arange(TILE) % 2 == 0, np.array(overlaps), np.array(shallow))
    shear = np.minimum(bench.friction(tiles), 1.0) * high * 10.0 ** rng.uniform(-1.5, 0.5, high.shape)
    slip = np.zeros((5, tiles, 2, TILE))
    slip[1:3, :, 0] = shear
    return Path(overlap, slip)


def extremes(bench: Bench, count: int) -> list[Contacts]:
    """Successive contacts, with every quantity drawn from zero, ordinary and absurd values."""
    rng = np.random.default_rng(SEED + 2)
    tiles = len(bench.settings)
    lanes = (tiles, TILE)
    radius = bench.radius(tiles)
    overlaps = np.array([0.0, 0.0, 1e-15, 1e-9, 1e-6, 1e-3, 0.1, 1.0, 10.0])
    slips = np.array([0.0, 0.0, 1e-18, 1e-12, 1e-6, 1e-3, 1.0, 1e6])
    fast = np.array([0.0, 0.0, 1e-12, 1e-3, 1.0, 1e4])

    def signed(values: Array, shape: tuple[int, ...]) -> Array:
        return rng.choice(values, shape) * rng.choice([-1.0, 1.0], shape)

    def drawn() -> Contacts:
        overlap, slip = radius * rng.choice(overlaps, lanes), radius[:, None] * signed(slips, wide)
        return Contacts(overlap, slip, signed(fast, lanes), signed(fast, wide))

    wide = (tiles, 2, TILE)
    return [drawn() for _ in range(count)]
