"""Bench of the conformance suite for one law: its composed tile function, materials, and paths of contacts.

Arrays are (T, TILE) or (T, k, TILE): one tile for each setting, times `repeats`, all run at once. A setting is a pair of
materials, a radius and a set of options, from ordinary to extreme.

A rolling law follows the same paths: its moment over R* is the tangential force, and the slip over R* is the rotation, so that
every test of a tangential law applies. A twisting law gets the first component of the slip alone.
"""

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from types import FunctionType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from thirdbody.kernels.memory import pieces
from thirdbody.kernels.tile import TILE, law_input, law_output, rolling_input, rolling_output
from thirdbody.laws.compose import compose
from thirdbody.laws.contract import Law, Material, Option, Pair
from thirdbody.laws.friction import MINDLIN
from thirdbody.laws.generated import plain
from thirdbody.laws.hertz import HERTZ

Array = NDArray[np.float64]
Result = tuple[bool, str]  # whether a test has passed, and a detail: the worst case, or what is wrong

SEED = 20240501
SPAN = 1e-3  # duration of one straight segment of a path [s]; sets the velocities only
REPEATS = 4  # most paths for each setting and lane

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


class Setting(NamedTuple):
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


SHEAR = {
    "rolling": (
        (law_output.TANGENTIAL_X, rolling_output.MOMENT_X), (law_output.TANGENTIAL_Y, rolling_output.MOMENT_Y),
        (law_output.FRICTION_LIMIT, rolling_output.MOMENT_LIMIT),
    ),
    "twisting": (
        (law_output.TANGENTIAL_X, rolling_output.TWIST_MOMENT), (law_output.FRICTION_LIMIT, rolling_output.TWIST_LIMIT),
    ),
}  # fmt: skip
"""What stands for force and limit of a law of moments, over R*; the second component of a twisting law is zero."""


class Inputs(NamedTuple):
    """Input of a tile, SI: overlap (T, TILE), slip (T, 2, TILE), separation speed, slip velocity."""

    overlap: Array
    slip: Array
    v_n: Array
    v: Array


class Bench:
    """One law in its place in a chain: after Hertz unless it is a normal law; a tangential dashpot after Mindlin, too. Radius,
    friction and `outermost`, where bodies begin to act on each other [m], are columns (REPEATS * T, 1)."""

    def __init__(self, law: Law):
        sets = option_sets(law)
        self.law = law = law.sized(sets[0][1])
        below: dict[str, tuple[Law, ...]] = {"normal": (), "tangential_damping": (HERTZ, MINDLIN)}
        self.chain = compose((*below.get(law.stage, (HERTZ,)), law))
        self.settings = [Setting(name + label, pair, options, radius) for label, options in sets for name, pair, radius in PAIRS]
        rows = [[one.mix(s.pair, s.options if one is law else {}) for one in self.chain.laws] for s in self.settings]
        self.parameters = [row[self.chain.laws.index(law)] for row in rows]
        numbers = np.array([[x for p in row for x in p] for row in rows]).reshape(len(rows), -1)
        self.table = np.zeros((len(rows), self.chain.width))
        self.table[:, : numbers.shape[1]] = numbers
        self.width = len(self.chain.history)
        self.field = slice(self.chain.field[0], sum(self.chain.field))
        self.sheared = law.stage in ("tangential", "rolling", "twisting")
        self.radius = self.columns(s.radius for s in self.settings)
        self.friction = self.columns(s.pair.friction for s in self.settings)
        reach = law.reach or (lambda pair, options, radius: 0.0)
        self.outermost = 0.0 - self.columns(reach(s.pair, s.options, s.radius) for s in self.settings)

    def columns(self, values: Iterable[float]) -> Array:
        """Return a number of each setting as (REPEATS * T, 1)."""
        return np.resize(np.array([*values], float), (REPEATS * len(self.settings), 1))

    def inputs(self, requested: Inputs, history: Array) -> Array:
        tiles, end = len(requested.overlap), law_input.HISTORY + self.width
        radius = self.radius[:tiles]
        I = np.zeros((tiles, end + rolling_input.WIDTH, TILE))  # noqa: E741
        I[:, law_input.OVERLAP], I[:, law_input.RADIUS], I[:, law_input.MASS] = requested.overlap, radius, 8e3 * radius**3
        I[:, law_input.NORMAL_VELOCITY] = requested.v_n
        I[:, law_input.SLIP_X : law_input.SLIP_Y + 1] = requested.slip
        I[:, law_input.VELOCITY_X : law_input.VELOCITY_Y + 1] = requested.v
        I[:, law_input.PAIR_TYPE] = self.columns(range(len(self.settings)))[:tiles]
        I[:, law_input.HISTORY : end] = history
        for tile, memory in zip(I[:, law_input.HISTORY : end], history, strict=True):
            pieces(tile[self.field])[:] = memory[self.field].T
        if self.law.stage == "rolling":
            I[:, end : end + 2], I[:, end + 2 : end + 4] = requested.slip / radius[:, None], requested.v / radius[:, None]
        if self.law.stage == "twisting":
            I[:, end + rolling_input.TWIST] = requested.slip[:, 0] / radius
            I[:, end + rolling_input.TWIST_RATE] = requested.v[:, 0] / radius
        return I

    def call(self, requested: Inputs, history: Array, law: Callable | None = None) -> tuple[Array, Array]:
        I = self.inputs(requested, history)  # noqa: E741
        end = law_output.HISTORY + self.width
        O = np.full((len(I), end + rolling_output.WIDTH, TILE), np.nan)  # noqa: E741
        flat, out, table = I.reshape(len(I), -1), O.reshape(len(I), -1), self.table.ravel()
        for t in range(len(I)):
            (law or self.chain.law)(flat[t], out[t], TILE, table)
        for force, moment in SHEAR.get(self.law.stage, ()):
            O[:, force] = O[:, end + moment] * (1.0 / self.radius[: len(I)])
        memory = O[:, law_output.HISTORY : end]
        for tile in memory:
            tile[self.field] = pieces(tile[self.field]).T.copy()
        return O[:, : law_output.HISTORY], memory

    def virgin(self, tiles: int) -> Array:
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


COMPILER_IS_OFF = plain(HERTZ.kernel) is HERTZ.kernel  # whether numba is disabled and all functions run in the interpreter
PATHS = 1 if COMPILER_IS_OFF else REPEATS  # of each setting: thousands in all, fewer in the interpreter


class ContactPath(NamedTuple):
    """Piecewise straight paths from the virgin state: overlap (k, T, TILE) and slip (k, T, 2, TILE) at the corners [m]."""

    overlap: Array
    slip: Array
    start: Array | float = 0.0


class Instant(NamedTuple):
    """One step of a path: input, history before it, result. Open contacts have the result zero."""

    requested: Inputs
    before: Array
    answer: Array
    after: Array


def follow_path(bench: Bench, path: ContactPath, m: int) -> Iterator[Instant]:
    """Run the law along the paths, in m equal steps per segment, as the engine does: open contacts lose their history."""
    tiles = len(path.overlap[0])
    history, outermost = bench.virgin(tiles), bench.outermost[:tiles]
    old, at_slip = np.zeros_like(path.overlap[0]) + path.start, np.zeros_like(path.slip[0])
    for new, to_slip in zip(path.overlap, path.slip, strict=True):
        for i in range(1, m + 1):
            overlap = old + (new - old) * (i / m)
            requested = Inputs(overlap, (to_slip - at_slip) / m, (old - new) / SPAN, (to_slip - at_slip) / SPAN)
            is_open = (overlap <= outermost)[:, None]
            idle = requested._replace(overlap=np.where(is_open[:, 0], 1e-3 * bench.radius[:tiles], overlap))
            answer, after = (np.where(is_open, 0.0, result) for result in bench.call(idle, history))
            yield Instant(requested, history, answer, after)
            history = after
        old, at_slip = new, to_slip


def random_paths(bench: Bench, corners: int, repeats: int = 1, resolved: bool = False) -> ContactPath:
    """Random corners: overlap 1e-6 to 0.03 radii, one in eight beyond touch, or to twice the reach; a third with slip on a line.
    The slip is scaled by the overlap, the radius, or the displacement at which a virgin contact slips; only by that if
    `resolved`."""
    rng = np.random.default_rng(SEED)
    tiles = repeats * len(bench.settings)
    lanes = (tiles, TILE)
    radius, outermost, friction = bench.radius[:tiles], bench.outermost[:tiles], bench.friction[:tiles]
    deepest = radius * 10.0 ** rng.uniform(-6.0, -1.5, lanes)
    overlap = deepest * rng.uniform(0.02, 1.0, (corners, *lanes))
    apart = np.where(outermost < 0.0, outermost * np.linspace(0.0, 2.0, TILE), -0.2 * deepest)
    overlap = np.where(rng.random(overlap.shape) < 0.125, apart, overlap)
    scale = rng.integers(3, size=lanes)
    by_overlap = np.clip(friction, 0.02, 3.0) * deepest * 10.0 ** rng.uniform(-1.5, 1.0, lanes)
    by_radius = radius * 10.0 ** rng.uniform(-5.0, -1.0, lanes)
    still, none = np.zeros(lanes), np.zeros((tiles, 2, TILE))
    critical = bench.call(Inputs(deepest, none, still, none), bench.virgin(tiles))[0][:, law_output.CRITICAL_SLIP]
    critical = np.where(np.isfinite(critical), critical, 0.0)
    by_critical = np.where(critical > 0.0, critical * 10.0 ** rng.uniform(-1.5, 1.0, lanes), by_overlap)
    size = np.where(scale == 0, by_overlap, np.where(scale == 1, by_radius, by_critical))
    size = by_critical if resolved else size
    slip = size[:, None] * rng.uniform(-1.0, 1.0, (corners, tiles, 2, TILE))
    angle = rng.uniform(0.0, 2.0 * np.pi, lanes)
    line = np.stack([np.cos(angle), np.sin(angle)], 1)
    on_line = np.sum(slip * line, 2, keepdims=True) * line
    return ContactPath(overlap, np.where(rng.random((tiles, 1, TILE)) < 0.3, on_line, slip))
