"""Conformance tests of work and stiffness: no creation of energy, the law's own ledger, the consistent tangent.

The work of a tangential law is the sum of T_new . ds: the trapezoid would fail good laws on long segments. That of a normal or
adhesion law is the trapezoid, since its force is a function of the overlap. Each test returns (passed, detail).
"""

import math
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from thirdbody.kernels.tile import TILE, law_input, law_output
from thirdbody.laws.conformance.bench import (  # fmt: skip
    CONE,
    PAIRS,
    SPAN,
    Array,
    Bench,
    Path,
    Result,
    closed_cycles,
    compiler_is_off,
    follow_path,
    random_paths,
)
from thirdbody.laws.contract import Law
from thirdbody.laws.data import Contact, Load, Turn, Twist
from thirdbody.laws.generated import plain
from thirdbody.laws.hertz import HERTZ

ROUND_OFF = 1e-9
"""Energy due to round-off over all the work done: some hundred steps of 1e-16, amplified by friction of 1e9."""

FASTER = 2.0
"""Factor by which four times finer steps must reduce a truncation error: order 1 gives 4, kinks cost some of it."""


class Account(NamedTuple):
    """Energies of each path over all the work done on it, maximum over time."""

    created: Array  # largest excess of the stored energy over the work so far
    mismatch: Array  # |work - stored - dissipated| at the end
    negative: Array  # most negative dissipation of a step


def account(bench: Bench, path: Path, m: int) -> Account:
    """Follow the paths and sum their energies. A contact that opens dissipates the energy of its tangential spring."""
    tangential = bench.sheared
    column = law_output.STORED_TANGENTIAL if tangential else law_output.STORED_NORMAL
    zero = np.zeros_like(path.overlap[0])
    work, total, heat, stored, built, negative = zero, zero, zero, zero, zero, zero
    outermost = bench.outermost(len(path.overlap[0]))
    depth, force = zero + outermost, zero
    for moment in follow_path(bench, path, m):
        answer, requested = moment.answer, moment.requested
        new_depth = np.maximum(requested.overlap, outermost)
        if tangential:
            done = -np.sum(answer[:, law_output.TANGENTIAL_X : law_output.TANGENTIAL_Y + 1] * requested.slip, 1)
            lost = np.where(new_depth > 0.0, 0.0, stored)
        else:
            done, lost = 0.5 * (answer[:, law_output.NORMAL_FORCE] + force) * (new_depth - depth), zero
        force, depth = answer[:, law_output.NORMAL_FORCE], new_depth
        work, total = work + done, total + np.abs(done)
        stored, heat = (
            answer[:, column],
            heat + answer[:, law_output.DISSIPATED] + answer[:, law_output.DASHPOT_POWER] * (SPAN / m) + lost,
        )
        built = np.maximum(built, stored - work)
        negative = np.minimum(negative, answer[:, law_output.DISSIPATED])
        total = np.maximum(total, np.abs(stored))
    scale = np.maximum(total, 1e-300)
    return Account(built / scale, np.abs(work - stored - heat) / scale, negative / scale)


def energy(bench: Bench) -> Result:
    """Test that no energy is created on random paths and closed cycles: work >= stored energy at any time, virgin start."""
    repeats = 1 if compiler_is_off() else 4  # thousands of paths, fewer in the interpreter
    cases = {"random": random_paths(bench, 8, repeats), "press-shear cycle": closed_cycles(bench)}
    worst, report = 0.0, ""
    for name, path in cases.items():
        for m, built in _excess(bench, path):
            if not built.max() <= worst:
                worst = float(built.max())
                tile = int(np.argmax(built.max(1))) % len(bench.settings)
                where = f"{name} path, {m} steps a segment, {bench.settings[tile].label}"
                report = f"makes {worst:.2e} of the work, {where}"
    return worst <= ROUND_OFF, report if not worst <= ROUND_OFF else f"{worst:.0e}"


def _excess(bench: Bench, path: Path) -> Iterator[tuple[int, Array]]:
    """Yield the created energy with small and large steps; by the trapezoid, only the part that does not fall with the step."""
    if bench.sheared:
        for m in (1, 3, 16):
            yield m, account(bench, path, m).created
        return
    coarse, fine = (account(bench, touching(bench, path), m).created for m in (8, 32))
    yield 32, np.where(_lasting(coarse, fine)[:, None], fine, 0.0)


def ledger(bench: Bench) -> Result:
    """Test that stored plus dissipated equals the work, up to truncation that falls with the step; no step dissipates < 0."""
    path = touching(bench, random_paths(bench, 5, repeats=2, resolved=True))  # some hundred paths per setting
    coarse, fine = account(bench, path, 12), account(bench, path, 48)
    lowest = float(min(coarse.negative.min(), fine.negative.min()))
    if not lowest >= -ROUND_OFF:
        return False, f"a step dissipates {lowest:.2e} of the path's work"
    rough, smooth = (np.concatenate(np.split(one.mismatch, 2), 1) for one in (coarse, fine))  # by setting
    bad = np.flatnonzero(_lasting(rough, smooth))
    tile = int(bad[0]) if len(bad) else int(np.argmax(smooth.mean(1)))
    before, after = rough[tile].mean(), smooth[tile].mean()
    report = f"work differs by {before:.1e}, with steps of a quarter by {after:.1e}"
    return not len(bad), report + (f", {bench.settings[tile].label}" if len(bad) else "")


def touching(bench: Bench, path: Path) -> Path:
    """Return the same paths from where the law begins to act, and with open corners moved there: no step is partly outside."""
    outermost = bench.outermost(len(path.overlap[0]))
    return path._replace(overlap=np.maximum(path.overlap, outermost), start=outermost)


def _lasting(coarse: Array, fine: Array) -> Array:
    """Return settings (T,) whose error does not fall with the step: in the mean of the paths, or much of a single one."""
    before, after = coarse.mean(1), fine.mean(1)
    slow = ~((after <= ROUND_OFF) | (after <= before / FASTER))
    # one path may touch for less than a step, or hardly; the mean would hide more than that
    stuck = np.mean((fine > 0.05) & (fine > coarse / 1.2), 1) > 0.02
    return slow | stuck


class Sample(NamedTuple):
    """One contact as plain floats."""

    setting: int
    contact: Contact
    history: tuple[float, ...]
    normal: Law = HERTZ


def samples(bench: Bench) -> list[Sample]:
    """Return touching contacts with their history, from random paths; typical options, friction neither zero nor huge."""
    rng = np.random.default_rng(5)
    usual = [k for k, s in enumerate(bench.settings[: len(PAIRS)]) if 0.0 < s.pair.friction < 10.0]
    first = sum(len(law.memory()) for law in bench.chain.laws[: bench.index])
    outermost = bench.outermost(len(bench.settings))
    own = slice(first, first + len(bench.law.memory()))
    result: list[Sample] = []
    for moment in follow_path(bench, random_paths(bench, 3), 4):
        I = bench.inputs(moment.requested, moment.before)  # noqa: E741
        for k in usual:
            for lane in rng.integers(TILE, size=3):
                numbers = I[k, :, lane].tolist()
                if numbers[law_input.OVERLAP] > outermost[k, 0]:
                    memory = tuple(moment.before[k, own, lane].tolist())
                    result.append(Sample(k, Contact._make((*numbers[: law_input.PAIR_TYPE], 0.0, 0.0, 0.0)), memory))
    return result


def tangent(bench: Bench) -> Result:
    """Compare the tangent with central differences of the kernel, away from kinks; under each normal law that the law admits."""
    law = bench.law
    if law.tangent is None:
        return True, "explicit only: the law has no tangent"
    cases = samples(bench)
    passed, detail = _tangent_under(bench, HERTZ, cases)
    if not passed or law.stage == "normal" or law.assumes:
        return passed, detail
    passed, other = _tangent_under(bench, CONE, cases)
    return passed, detail if passed else f"{other}; under a normal law that is not Hertz's"


def _tangent_under(bench: Bench, normal: Law, cases: list[Sample]) -> Result:
    """Compare the tangent with differences under one normal law; a normal law stands for itself."""
    saved, worst, report = 0, 0.0, ""
    for sample in (one._replace(normal=normal) for one in cases):
        expected, one_sided = _difference(bench, sample)
        given, radius = plain(bench.law.tangent)(*_arguments(bench, sample, sample.contact)), sample.contact.radius
        if bench.twisting:
            given = [given[0] / radius**2, 0.0, 0.0, 0.0, given[1] / radius, 0.0]
        elif bench.rolling:
            given = [x / radius**2 for x in given[:4]] + [x / radius for x in given[4:]]
        given = np.atleast_1d(np.array(given, float))
        if given.shape != expected.shape:
            return False, f"gives {given.size} numbers, expected {expected.size}"
        # the compared stiffness, or a thousandth of the force over the overlap or the slip if larger
        c, force = sample.contact, 1e-3 * float(np.max(np.abs(_force(bench, sample, sample.contact))))
        parts = np.maximum(np.abs(expected), np.abs(given))
        by_overlap = max(float(parts[-2:].max()), force / _span(bench, sample), 1e-300)
        by_slip = max(float(parts[:4].max()), force / max(abs(c.slip_x), abs(c.slip_y), 1e-300))
        size = np.array([by_overlap] if len(expected) == 1 else [by_slip] * 4 + [by_overlap] * 2)
        if np.any(one_sided > 1e-3 * size):
            continue  # a kink between the two sides
        saved += 1
        error = float(np.nan_to_num(np.abs(given - expected) / size, nan=np.inf).max())
        if error > worst:
            worst, report = error, f"differs by {error:.1e}, {bench.settings[sample.setting].label}"
    if saved < len(cases) // 2:
        return False, f"only {saved} of {len(cases)} contacts are smooth enough to compare"
    return worst <= 1e-4, report if worst > 1e-4 else f"{worst:.0e}, {saved} contacts"


def area(bench: Bench) -> Result:
    """Test what a normal law tells of its contact area.

    `squared_radius_rate` is the derivative of the squared contact radius by the overlap, away from kinks; the peak pressure is at
    least the mean one.
    """
    cases = samples(bench)
    for sample in cases:
        c = sample.contact
        span, n = _span(bench, sample), _answer(bench, sample, c)
        step = 1e-6 * span
        ahead, behind = (_answer(bench, sample, c._replace(overlap=c.overlap + x)).contact_radius ** 2 for x in (step, -step))
        size = max(n.contact_radius**2 / span, 1e-300)
        kink = abs(ahead + behind - 2.0 * n.contact_radius**2) / step > 1e-3 * size
        error = abs((ahead - behind) / (2.0 * step) - n.squared_radius_rate) / size
        where = bench.settings[sample.setting].label
        if not kink and not error <= 1e-4:
            return False, f"squared_radius_rate differs by {error:.1e}, {where}"
        if not n.peak_pressure * math.pi * n.contact_radius**2 >= n.force * (1.0 - ROUND_OFF):
            return False, f"the peak pressure {n.peak_pressure:.3g} Pa is below the mean one, {where}"
    return True, f"{len(cases)} contacts"


def _arguments(bench: Bench, sample: Sample, c: Contact) -> tuple[Any, ...]:
    p = bench.parameters(sample.setting)
    count = len(bench.law.history)
    memory: tuple[Any, ...] = (sample.history[:count],) if count else ()
    if len(sample.history) > count:
        memory += (np.array(sample.history[count:]),)
    if bench.law.stage == "normal":
        return (c, p, *memory)
    closed, of_normal = c._replace(overlap=max(c.overlap, 0.0)), sample.normal.mix(bench.settings[sample.setting].pair, {})
    n = plain(sample.normal.kernel)(closed, of_normal)
    if bench.law.stage == "adhesion":
        return (c, n, p, *memory)
    stiffness = plain(sample.normal.tangent)(closed, of_normal)
    rotation: tuple[Any, ...] = ()
    if bench.rolling:
        rotation = (Turn(c.slip_x / c.radius, c.slip_y / c.radius, c.v_x / c.radius, c.v_y / c.radius),)
    elif bench.twisting:
        rotation = (Twist(c.slip_x / c.radius, c.v_x / c.radius),)
    return (c, *rotation, Load(n.force, n.force, n.contact_radius, stiffness, n.squared_radius_rate), p, *memory)


def _answer(bench: Bench, sample: Sample, c: Contact) -> Any:
    size = len(sample.history) - len(bench.law.history)
    answer = plain(bench.law.kernel)(*_arguments(bench, sample, c), *((np.zeros(size),) if size else ()))
    return answer[0] if bench.law.history else answer


def _span(bench: Bench, sample: Sample) -> float:
    """Overlap of the sample, or its distance from where the law begins to act if that is before touch [m]."""
    return sample.contact.overlap - float(bench.outermost(len(bench.settings))[sample.setting, 0])


def _force(bench: Bench, sample: Sample, c: Contact) -> Array:
    answer = _answer(bench, sample, c)
    if bench.twisting:
        return np.array([answer.moment, 0.0]) / c.radius
    if bench.rolling:
        return np.array([answer.x, answer.y]) / c.radius
    return np.array([answer.x, answer.y] if bench.sheared else [answer.force])


def _difference(bench: Bench, sample: Sample) -> tuple[Array, Array]:
    """Return central differences in the order of the contract, and the deviation between the two one-sided ones."""
    c = sample.contact
    here = _force(bench, sample, c)
    directions = [("overlap", 1e-6 * _span(bench, sample))]
    if bench.sheared:
        critical = 0.0 if bench.has_moment else _answer(bench, sample, c).critical
        step = 1e-6 * (critical or c.overlap)
        directions = [("slip_x", step), ("slip_y", step), *directions]
    central, apart = [], []
    for name, step in directions:
        ahead = _force(bench, sample, c._replace(**{name: getattr(c, name) + step}))
        behind = _force(bench, sample, c._replace(**{name: getattr(c, name) - step}))
        central.append((ahead - behind) / (2.0 * step))
        apart.append(np.abs(ahead - 2.0 * here + behind) / step)
    if not bench.sheared:
        return central[0], apart[0]
    order = [central[0][0], central[1][0], central[0][1], central[1][1], *central[2]]
    return np.array(order), np.array([apart[0][0], apart[1][0], apart[0][1], apart[1][1], *apart[2]])
