"""Conformance tests of single results and of symmetry. Each returns (passed, detail).

Finite, no touch no force, rotation, swap, friction, compiler, history.
"""

from dataclasses import replace

import numpy as np

from thirdbody.kernels.tile import TILE, law_output
from thirdbody.laws.conformance.bench import COMPILER_IS_OFF, Array, Bench, ContactPath, Inputs, Result, follow_path, random_paths

ROUND_OFF = 1e-12  # relative difference due to a few thousand round-offs of double precision
ROTATED = 1e-9  # the same for a rotated path: a cosine per step, amplified by friction's return by the trial over the limit

FORCES = [
    law_output.NORMAL_FORCE, law_output.TANGENTIAL_X, law_output.TANGENTIAL_Y, law_output.LOAD, law_output.FRICTION_LIMIT,
    law_output.STORED_NORMAL, law_output.STORED_TANGENTIAL,
]  # fmt: skip
TANGENTIAL = slice(law_output.TANGENTIAL_X, law_output.TANGENTIAL_Y + 1)
ENERGIES = (law_output.STORED_NORMAL, law_output.STORED_TANGENTIAL, law_output.DISSIPATED, law_output.FRICTION_LOSS)
NAMES = {column.first: column.name for column in law_output}


def extremes(bench: Bench, count: int) -> list[Inputs]:
    """Successive contacts, with every quantity drawn from zero, ordinary and absurd values."""
    rng = np.random.default_rng(20240503)
    tiles = len(bench.settings)
    lanes, wide, radius = (tiles, TILE), (tiles, 2, TILE), bench.radius[:tiles]
    overlaps = np.array([0.0, 0.0, 1e-15, 1e-9, 1e-6, 1e-3, 0.1, 1.0, 10.0])
    slips = np.array([0.0, 0.0, 1e-18, 1e-12, 1e-6, 1e-3, 1.0, 1e6])
    fast = np.array([0.0, 0.0, 1e-12, 1e-3, 1.0, 1e4])

    def signed(values: Array, shape: tuple[int, ...]) -> Array:
        return rng.choice(values, shape) * rng.choice([-1.0, 1.0], shape)

    return [
        Inputs(
            radius * rng.choice(overlaps, lanes), radius[:, None] * signed(slips, wide), signed(fast, lanes), signed(fast, wide)
        )
        for _ in range(count)
    ]


def finite(bench: Bench) -> Result:
    memory = bench.virgin(len(bench.settings))
    for requested in extremes(bench, 24):
        answer, memory = bench.call(requested, memory)
        for names, values in ((NAMES, answer), (bench.chain.history, memory)):
            for tile, column, lane in np.argwhere(~np.isfinite(values)):
                return False, f"{names[column]} is {values[tile, column, lane]}, {_describe(bench, requested, tile, lane)}"
            memory = np.where(np.isfinite(memory), memory, 0.0)
    return True, ""


def no_touch(bench: Bench) -> Result:
    """Test for no force and no energy at zero overlap, or at the law's reach, and half as far out again: virgin, after any
    path."""
    path = random_paths(bench, 3)
    tiles = len(bench.settings)
    apart = bench.outermost[:tiles] * np.where(np.arange(TILE) % 2 == 0, 1.0, 1.5)
    moved = Inputs(apart, path.slip[0], -np.abs(path.overlap[0]) * 1e3, path.slip[0] * 1e3)
    memories = [bench.virgin(tiles), *(instant.after for instant in follow_path(bench, path, 2))]
    for memory in memories:
        answer, _ = bench.call(moved, memory)
        for tile, k, lane in np.argwhere(answer[:, FORCES] != 0.0):  # a NaN counts
            value = answer[tile, FORCES[k], lane]
            where = f"{-apart[tile, lane]:.3g} m apart" if apart[tile, lane] < 0.0 else "at zero overlap"
            return False, f"{NAMES[FORCES[k]]} is {value:.3g} {where}, {bench.settings[tile].label}"
    return True, ""


def rotation(bench: Bench) -> Result:
    angle = np.random.default_rng(7).uniform(0.0, 2.0 * np.pi, (len(bench.settings), TILE))
    cos, sin = np.cos(angle), np.sin(angle)
    return _transformed(bench, np.array([[cos, -sin], [sin, cos]]), ROTATED)


def swap(bench: Bench) -> Result:
    """Test the same contact seen from the other body: the normal reverses, and with it the second axis of the frame, so slip and
    force are (-x, +y); the rotation about the normal stays, so there the mirror image is tested. With `rotation` this implies
    that negating the slip negates the force. The order of two materials must not matter either."""
    mirror = np.array([[-1.0, 0.0], [0.0, 1.0]])[:, :, None, None] * np.ones((len(bench.settings), TILE))
    passed, detail = _transformed(bench, mirror, ROUND_OFF)
    if not passed:
        return passed, detail
    for setting, p in zip(bench.settings, bench.parameters, strict=True):
        other = bench.law.mix(replace(setting.pair, a=setting.pair.b, b=setting.pair.a), setting.options)
        if not np.allclose(p, other, rtol=ROUND_OFF, atol=0.0):
            return False, f"mix depends on the order of the materials: {p}, {other}"
    return True, detail


def _transformed(bench: Bench, matrix: Array, tolerance: float) -> Result:
    """Compare a path with the path transformed by `matrix` (2, 2, T, TILE)."""
    path = random_paths(bench, 5)
    image = ContactPath(path.overlap, np.einsum("ijtl,ktjl->ktil", matrix, path.slip))
    size = np.full((len(bench.settings), law_output.HISTORY, TILE), 1e-300)
    worst, report = 0.0, ""
    for one, two in zip(follow_path(bench, path, 3), follow_path(bench, image, 3), strict=True):
        expected = one.answer.copy()
        expected[:, TANGENTIAL] = np.einsum("ijtl,tjl->til", matrix, one.answer[:, TANGENTIAL])
        size = np.maximum(size, np.abs(expected))
        size[:, TANGENTIAL] = np.max(size[:, TANGENTIAL], 1, keepdims=True)
        size[:, ENERGIES] = np.max(size[:, ENERGIES], 1, keepdims=True)
        # the dashpot force within the friction limit may be the round-off of a difference: so the scale is force by speed
        speed = np.hypot(*np.moveaxis(one.requested.v, 1, 0)) + np.abs(one.requested.v_n)
        power = np.abs(size[:, law_output.TANGENTIAL_X] + size[:, law_output.NORMAL_FORCE]) * speed
        size[:, law_output.DASHPOT_POWER] = np.maximum(size[:, law_output.DASHPOT_POWER], power)
        error = np.nan_to_num(np.abs(two.answer - expected) / size, nan=np.inf)
        if error.max() > worst:
            worst = float(error.max())
            tile, column, lane = np.unravel_index(np.argmax(error), error.shape)
            report = f"{NAMES[int(column)]} differs by {worst:.1e}, {bench.settings[tile].label}"
    return worst <= tolerance, report if worst > tolerance else f"{worst:.0e}"


def friction_limit(bench: Bench) -> Result:
    """Test that |T| never exceeds the stated limit, and that this is `mu` times the load (rolling: `mu_r`) if there is such a
    number."""
    path = random_paths(bench, 8, repeats=2)
    tiles = len(path.overlap[0])
    rolls = bench.law.stage == "rolling"
    has_mu = bench.sheared and hasattr(bench.law.parameters, "mu_r" if rolls else "mu")
    mu = (bench.columns(p.mu_r for p in bench.parameters) if rolls and has_mu else bench.friction)[:tiles]
    for m in (1, 4):
        for instant in follow_path(bench, path, m):
            answer = instant.answer
            size = np.hypot(answer[:, law_output.TANGENTIAL_X], answer[:, law_output.TANGENTIAL_Y])
            limit = answer[:, law_output.FRICTION_LIMIT]
            for tile, lane in np.argwhere(~(size <= limit * (1.0 + ROUND_OFF))):
                ratio = size[tile, lane] / max(limit[tile, lane], 1e-300)
                return False, f"force is {ratio:.6g} of the limit, {_describe(bench, instant.requested, tile, lane)}"
            allowed = mu * answer[:, law_output.LOAD]
            for tile, lane in np.argwhere(~np.isclose(limit, allowed, rtol=ROUND_OFF, atol=0.0) & has_mu):
                ratio = limit[tile, lane] / max(allowed[tile, lane], 1e-300)
                return False, f"limit is {ratio:.6g} mu N, {_describe(bench, instant.requested, tile, lane)}"
    return True, "" if has_mu or not bench.sheared else "no parameter mu: only |T| <= limit"


def passive(bench: Bench) -> Result:
    """Test that a dashpot takes power at any velocity, and none at rest."""
    path = random_paths(bench, 5)
    rng = np.random.default_rng(11)
    for instant in follow_path(bench, path, 2):
        requested, zero = instant.requested, np.zeros_like(instant.requested.v_n)
        open_at = np.maximum(requested.overlap, 0.0)
        speed = np.sqrt(9.81 * bench.radius[: len(zero)]) * 10.0 ** rng.uniform(-3.0, 2.0, zero.shape)
        v = speed[:, None] * rng.uniform(-1.0, 1.0, requested.v.shape)
        v_n = speed * rng.uniform(-1.0, 1.0, zero.shape)
        moving, _ = bench.call(Inputs(open_at, requested.slip, v_n, v), instant.before)
        still, _ = bench.call(Inputs(open_at, requested.slip, zero, np.zeros_like(v)), instant.before)
        power = moving[:, law_output.DASHPOT_POWER]
        scale = np.abs(still[:, law_output.NORMAL_FORCE]) * speed
        for tile, lane in np.argwhere(~(power >= -ROUND_OFF * scale)):
            return False, f"power is {power[tile, lane]:.3g} W, {_describe(bench, requested, tile, lane)}"
        if np.any(still[:, law_output.DASHPOT_POWER] != 0.0):
            return False, "power without velocity"
    return True, ""


def compiled(bench: Bench) -> Result:
    """Compare the compiled tile with the same text in the interpreter, on ordinary and absurd contacts."""
    if COMPILER_IS_OFF:
        return True, "the compiler is off"
    law = bench.interpreted()
    outermost = bench.outermost[: len(bench.settings)]
    cases: list[tuple[Inputs, Array]] = []
    for instant in follow_path(bench, random_paths(bench, 2), 1):
        cases.append((instant.requested._replace(overlap=np.maximum(instant.requested.overlap, outermost)), instant.before))
    memory = bench.virgin(len(bench.settings))
    for requested in extremes(bench, 2):
        cases.append((requested, memory))
        _, memory = bench.call(requested, memory)
    worst = 0.0
    for requested, before in cases:
        a, b = (np.concatenate(bench.call(requested, before, which), 1) for which in (None, law))
        size = np.maximum(np.abs(a), np.abs(b))
        size[:, ENERGIES] = np.max(size[:, ENERGIES], 1, keepdims=True)
        error = np.where((a == b) | (np.isnan(a) & np.isnan(b)), 0.0, np.abs(a - b) / np.maximum(size, 1e-300))
        worst = max(worst, float(np.nan_to_num(error, nan=np.inf).max()))
    return worst <= ROUND_OFF, "same bits" if worst == 0.0 else f"differ by {worst:.1e}"


def history(bench: Bench) -> Result:
    """Test that continuing from copied history gives the same bits, also elsewhere in the tile: no memory is hidden."""
    instants = list(follow_path(bench, random_paths(bench, 4), 3))
    order = np.random.default_rng(3).permutation(TILE)
    back = np.argsort(order)
    memory, outermost = instants[5].after.copy(), bench.outermost[: len(bench.settings)]
    for instant in instants[6:]:
        touches = (instant.requested.overlap > outermost)[:, None]
        touched = instant.requested._replace(overlap=np.maximum(instant.requested.overlap, outermost))
        shuffled = Inputs(*(np.ascontiguousarray(x[..., order]) for x in touched))
        answer, after = bench.call(shuffled, np.ascontiguousarray(memory[..., order]))
        answer, after = np.where(touches, answer[..., back], 0.0), np.where(touches, after[..., back], 0.0)
        if not (np.array_equal(answer, instant.answer) and np.array_equal(after, instant.after)):
            return False, "a continued contact differs from one that was not interrupted"
        memory = after
    if bench.sheared and "energy" in bench.law.history:  # which the engine reads there
        stored = ((instant.after[:, bench.chain.stored], instant.answer[:, law_output.STORED_TANGENTIAL]) for instant in instants)
        if not all(np.array_equal(*pair) for pair in stored):
            return False, "what it remembers as `energy` is not what it answers as `stored`"
    return True, f"{len(bench.law.history)} floats" if bench.law.history else "none"


def _describe(bench: Bench, requested: Inputs, tile: int, lane: int) -> str:
    setting = bench.settings[tile % len(bench.settings)]
    depth = requested.overlap[tile, lane] / setting.radius
    slip = float(np.hypot(*requested.slip[tile, :, lane])) / setting.radius
    return f"overlap/radius {depth:.2g}, slip/radius {slip:.2g}, {setting.label}"
