"""Conformance tests of work and stiffness: no creation of energy, the law's own ledger, the consistent tangent.

The work of a tangential law is the sum of T_new . ds: the trapezoid would fail good laws on long segments. That of a normal or
adhesion law is the trapezoid, since its force is a function of the overlap. Each test returns (passed, detail).
"""

import math
from typing import Any, NamedTuple

import numpy as np

from thirdbody.kernels.tile import TILE, law_input, law_output
from thirdbody.laws.conformance.bench import PAIRS, PATHS, SPAN, Array, Bench, ContactPath, Result, follow_path, random_paths
from thirdbody.laws.contract import Law, kernel
from thirdbody.laws.data import Contact, Load, Normal, Turn, Twist
from thirdbody.laws.generated import plain
from thirdbody.laws.hertz import HERTZ, HertzParameters

ROUND_OFF = 1e-9  # energy due to round-off over all the work done: some hundred steps of 1e-16, amplified by friction of 1e9
FASTER = 2.0  # factor by which four times finer steps must reduce a truncation error: order 1 gives 4, kinks cost some of it

SLOPE = 20.0  # contact radius over overlap of the cone


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
    "cone", "normal", cone, HertzParameters, HERTZ.mix, "Sneddon 1965, International Journal of Engineering Science 3, 47",
    tangent=cone_tangent,
)  # fmt: skip
"""A blunt cone, whose contact radius grows as the overlap: a law that takes the contact area from the normal law (`Load`) is
right under it too; one that assumes a sphere is not."""


class Account(NamedTuple):
    """Energies of each path over all the work done on it, maximum over time."""

    created: Array  # largest excess of the stored energy over the work so far
    mismatch: Array  # |work - stored - dissipated| at the end
    negative: Array  # most negative dissipation of a step


def account(bench: Bench, path: ContactPath, m: int) -> Account:
    """Follow the paths and sum their energies. A contact that opens dissipates the energy of its tangential spring."""
    tangential = bench.sheared
    column = law_output.STORED_TANGENTIAL if tangential else law_output.STORED_NORMAL
    zero = np.zeros_like(path.overlap[0])
    work, total, heat, stored, built, negative = zero, zero, zero, zero, zero, zero
    outermost = bench.outermost[: len(path.overlap[0])]
    depth, force = zero + outermost, zero
    for instant in follow_path(bench, path, m):
        answer, requested = instant.answer, instant.requested
        new_depth = np.maximum(requested.overlap, outermost)
        if tangential:
            done = -np.sum(answer[:, law_output.TANGENTIAL_X : law_output.TANGENTIAL_Y + 1] * requested.slip, 1)
            lost = np.where(new_depth > 0.0, 0.0, stored)
        else:
            done, lost = 0.5 * (answer[:, law_output.NORMAL_FORCE] + force) * (new_depth - depth), zero
        force, depth = answer[:, law_output.NORMAL_FORCE], new_depth
        work, total = work + done, total + np.abs(done)
        heat = heat + answer[:, law_output.DISSIPATED] + answer[:, law_output.DASHPOT_POWER] * (SPAN / m) + lost
        stored = answer[:, column]
        built = np.maximum(built, stored - work)
        negative = np.minimum(negative, answer[:, law_output.DISSIPATED])
        total = np.maximum(total, np.abs(stored))
    scale = np.maximum(total, 1e-300)
    return Account(built / scale, np.abs(work - stored - heat) / scale, negative / scale)


def closed_cycles(bench: Bench) -> ContactPath:
    """Press, shear, change the overlap, shear back, return: with less overlap (C1) or more (C2) on the return. There the form F =
    k_t(d) xi creates the energy (k_1 - k_0) U^2/2 (Elata and Berryman 1996)."""
    tiles = len(bench.settings)
    rng = np.random.default_rng(20240502)
    high = bench.radius[:tiles] * 10.0 ** rng.uniform(-4.0, -2.0, (tiles, TILE))
    low = 0.4 * high
    overlaps, shallow = (low, low, high, high, low), (high, high, low, low, high)
    overlap = np.where(np.arange(TILE) % 2 == 0, np.array(overlaps), np.array(shallow))
    shear = np.minimum(bench.friction[:tiles], 1.0) * high * 10.0 ** rng.uniform(-1.5, 0.5, high.shape)
    slip = np.zeros((5, tiles, 2, TILE))
    slip[1:3, :, 0] = shear
    return ContactPath(overlap, slip)


def energy(bench: Bench) -> Result:
    """Test that no energy is created on random paths and closed cycles: work >= stored energy at any time, virgin start."""
    cases = {"random": random_paths(bench, 8, PATHS), "press-shear cycle": closed_cycles(bench)}
    worst, report = 0.0, ""
    for name, path in cases.items():
        if bench.sheared:
            excess = {m: account(bench, path, m).created for m in (1, 3, 16)}
        else:  # by the trapezoid, only the part that does not fall with the step
            coarse, fine = (account(bench, touching(bench, path), m).created for m in (8, 32))
            excess = {32: np.where(_lasting(coarse, fine)[:, None], fine, 0.0)}
        for m, built in excess.items():
            if not built.max() <= worst:
                worst = float(built.max())
                tile = int(np.argmax(built.max(1))) % len(bench.settings)
                where = f"{name} path, {m} steps a segment, {bench.settings[tile].label}"
                report = f"makes {worst:.2e} of the work, {where}"
    return worst <= ROUND_OFF, report if not worst <= ROUND_OFF else f"{worst:.0e}"


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


def touching(bench: Bench, path: ContactPath) -> ContactPath:
    """Return the same paths from where the law begins to act, and with open corners moved there: no step is partly outside."""
    outermost = bench.outermost[: len(path.overlap[0])]
    return path._replace(overlap=np.maximum(path.overlap, outermost), start=outermost)


def _lasting(coarse: Array, fine: Array) -> Array:
    """Return settings (T,) whose error does not fall with the step: in the mean of the paths, or much of a single one."""
    before, after = coarse.mean(1), fine.mean(1)
    slow = ~((after <= ROUND_OFF) | (after <= before / FASTER))
    # one path may touch for less than a step, or hardly; the mean would hide more than that
    stuck = np.mean((fine > 0.05) & (fine > coarse / 1.2), 1) > 0.02
    return slow | stuck


class Sample(NamedTuple):
    """One contact as plain floats, with the law of the bench after a normal law."""

    bench: Bench
    setting: int
    contact: Contact
    history: tuple[float, ...]
    normal: Law = HERTZ

    @property
    def span(self) -> float:
        """Overlap, or its distance from where the law begins to act if that is before touch [m]."""
        return self.contact.overlap - float(self.bench.outermost[self.setting, 0])

    def arguments(self, c: Contact) -> tuple[Any, ...]:
        stage, p, count = self.bench.law.stage, self.bench.parameters[self.setting], len(self.bench.law.history)
        memory: tuple[Any, ...] = (self.history[:count],) if count else ()
        if len(self.history) > count:
            memory += (np.array(self.history[count:]),)
        if stage == "normal":
            return (c, p, *memory)
        closed, of_normal = c._replace(overlap=max(c.overlap, 0.0)), self.normal.mix(self.bench.settings[self.setting].pair, {})
        n = plain(self.normal.kernel)(closed, of_normal)
        if stage == "adhesion":
            return (c, n, p, *memory)
        load = Load(n.force, n.force, n.contact_radius, plain(self.normal.tangent)(closed, of_normal), n.squared_radius_rate)
        if stage == "rolling":
            return (c, Turn(*(x / c.radius for x in (c.slip_x, c.slip_y, c.v_x, c.v_y))), load, p, *memory)
        if stage == "twisting":
            return (c, Twist(c.slip_x / c.radius, c.v_x / c.radius), load, p, *memory)
        return (c, load, p, *memory)

    def answer(self, c: Contact) -> Any:
        size = len(self.history) - len(self.bench.law.history)
        answer = plain(self.bench.law.kernel)(*self.arguments(c), *((np.zeros(size),) if size else ()))
        return answer[0] if self.bench.law.history else answer

    def force(self, c: Contact) -> Array:
        """Return the force [N]; of a moment that over R*."""
        answer = self.answer(c)
        if self.bench.law.stage == "twisting":
            return np.array([answer.moment, 0.0]) / c.radius
        if self.bench.law.stage == "rolling":
            return np.array([answer.x, answer.y]) / c.radius
        return np.array([answer.x, answer.y] if self.bench.sheared else [answer.force])


def samples(bench: Bench) -> list[Sample]:
    rng = np.random.default_rng(5)
    usual = [k for k, s in enumerate(bench.settings[: len(PAIRS)]) if 0.0 < s.pair.friction < 10.0]
    first = bench.chain.first_of(bench.law)
    own = slice(first, first + len(bench.law.memory()))
    result: list[Sample] = []
    for instant in follow_path(bench, random_paths(bench, 3), 4):
        I = bench.inputs(instant.requested, instant.before)  # noqa: E741
        for k in usual:
            for lane in rng.integers(TILE, size=3):
                numbers = I[k, :, lane].tolist()
                if numbers[law_input.OVERLAP] > bench.outermost[k, 0]:
                    contact = Contact._make((*numbers[: law_input.PAIR_TYPE], 0.0, 0.0, 0.0))
                    result.append(Sample(bench, k, contact, tuple(instant.before[k, own, lane].tolist())))
    return result


def tangent(bench: Bench) -> Result:
    """Compare the tangent with central differences of the kernel, away from kinks; under each normal law that the law admits."""
    law = bench.law
    if law.tangent is None:
        return True, "explicit only: the law has no tangent"
    cases = samples(bench)
    passed, detail = _tangent_of(cases)
    if not passed or law.stage == "normal" or law.assumes:
        return passed, detail
    passed, other = _tangent_of([one._replace(normal=CONE) for one in cases])
    return passed, detail if passed else f"{other}; under a normal law that is not Hertz's"


def _tangent_of(cases: list[Sample]) -> Result:
    saved, worst, report = 0, 0.0, ""
    for sample in cases:
        c, law = sample.contact, sample.bench.law
        expected, one_sided = _difference(sample)
        given = np.atleast_1d(np.array(plain(law.tangent)(*sample.arguments(c)), float))
        if law.stage == "twisting":
            given = np.array([given[0], 0.0, 0.0, 0.0, given[1], 0.0])
        if given.shape != expected.shape:
            return False, f"gives {given.size} numbers, expected {expected.size}"
        if law.stage in ("rolling", "twisting"):
            given /= [c.radius**2] * 4 + [c.radius] * 2
        # the compared stiffness, or a thousandth of the force over the overlap or the slip if larger
        force = 1e-3 * float(np.max(np.abs(sample.force(c))))
        parts = np.maximum(np.abs(expected), np.abs(given))
        by_overlap = max(float(parts[-2:].max()), force / sample.span, 1e-300)
        by_slip = max(float(parts[:4].max()), force / max(abs(c.slip_x), abs(c.slip_y), 1e-300))
        size = np.array([by_overlap] if len(expected) == 1 else [by_slip] * 4 + [by_overlap] * 2)
        if np.any(one_sided > 1e-3 * size):
            continue  # a kink between the two sides
        saved += 1
        error = float(np.nan_to_num(np.abs(given - expected) / size, nan=np.inf).max())
        if error > worst:
            worst, report = error, f"differs by {error:.1e}, {sample.bench.settings[sample.setting].label}"
    if saved < len(cases) // 2:
        return False, f"only {saved} of {len(cases)} contacts are smooth enough to compare"
    return worst <= 1e-4, report if worst > 1e-4 else f"{worst:.0e}, {saved} contacts"


def _difference(sample: Sample) -> tuple[Array, Array]:
    """Return central differences in the order of the contract, and the deviation between the two one-sided ones."""
    c, here = sample.contact, sample.force(sample.contact)
    steps = {"overlap": 1e-6 * sample.span}
    if sample.bench.sheared:
        critical = sample.answer(c).critical if sample.bench.law.stage == "tangential" else 0.0
        steps = dict.fromkeys(("slip_x", "slip_y"), 1e-6 * (critical or c.overlap)) | steps
    central, apart = [], []
    for name, step in steps.items():
        ahead, behind = (sample.force(c._replace(**{name: getattr(c, name) + x})) for x in (step, -step))
        central.append((ahead - behind) / (2.0 * step))
        apart.append(np.abs(ahead - 2.0 * here + behind) / step)
    if not sample.bench.sheared:
        return central[0], apart[0]
    by_x, by_y, by_overlap = np.array([central, apart]).swapaxes(0, 1)
    given, deviation = np.stack([by_x[:, 0], by_y[:, 0], by_x[:, 1], by_y[:, 1], by_overlap[:, 0], by_overlap[:, 1]], 1)
    return given, deviation


def area(bench: Bench) -> Result:
    """Test that `squared_radius_rate` is the derivative of the squared contact radius by the overlap, away from kinks, and the
    peak pressure at least the mean one."""
    cases = samples(bench)
    for sample in cases:
        c, span, n = sample.contact, sample.span, sample.answer(sample.contact)
        step = 1e-6 * span
        ahead, behind = (sample.answer(c._replace(overlap=c.overlap + x)).contact_radius ** 2 for x in (step, -step))
        size = max(n.contact_radius**2 / span, 1e-300)
        kink = abs(ahead + behind - 2.0 * n.contact_radius**2) / step > 1e-3 * size
        error = abs((ahead - behind) / (2.0 * step) - n.squared_radius_rate) / size
        where = bench.settings[sample.setting].label
        if not kink and not error <= 1e-4:
            return False, f"squared_radius_rate differs by {error:.1e}, {where}"
        if not n.peak_pressure * math.pi * n.contact_radius**2 >= n.force * (1.0 - ROUND_OFF):
            return False, f"the peak pressure {n.peak_pressure:.3g} Pa is below the mean one, {where}"
    return True, f"{len(cases)} contacts"
