"""The conformance suite: requirements on every law and every other part of a plug-in. `thirdbody laws --check FILE` runs it.

Laws are run through the same composed, compiled tile function as in a simulation; measures, body effects and labellers compiled
as in a run, and in plain Python; interactions of spots in plain Python: what is solved with their two numbers is the engine's
(`kernels.close_spots`), and conservative for any numbers that pass. Tests that do not apply to a part are omitted.
"""

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from itertools import product
from typing import Any

import numpy as np

from thirdbody.kernels.arguments import ContactStep
from thirdbody.kernels.tables import DEBRIS, LOWER, UPPER, body, body_extra, loaded_contact, observed_body
from thirdbody.laws.compose import compose_effects, compose_labeller
from thirdbody.laws.conformance.bench import PAIRS, Bench, Result, forms_of, option_sets
from thirdbody.laws.conformance.energy import area, energy, ledger, tangent
from thirdbody.laws.conformance.symmetry import compiled, finite, friction_limit, history, no_touch, passive, rotation, swap
from thirdbody.laws.contract import STAGES, BodyEffect, Labeller, Law, SpotInteraction
from thirdbody.laws.data import Body, Contact, Wrench
from thirdbody.laws.generated import compile_error, plain
from thirdbody.laws.hertz import HERTZ
from thirdbody.laws.measures import MEAN, Measure, by_kind, compose_measures, layout_of

Cases = Iterator[tuple[str, Result]]
Tests = dict[str, Callable[[], Result | Cases]]  # tests of a part by name: each returns a result, or yields cases with theirs
ROUND_OFF = 1e-12  # relative difference between a compiled kernel and the same in Python: some contracted products

ELASTIC = ("normal", "adhesion", "tangential", "rolling", "twisting")
VISCOUS = ("damping", "tangential_damping")
SHEARED = ("tangential", "tangential_damping", "rolling", "twisting")
DIRECTED = tuple(stage for stage in STAGES if stage != "twisting")
"""Stages whose tests turn the frame: the rotation about the normal has no direction in the contact's plane."""

LAW_TESTS: tuple[tuple[str, tuple[str, ...], Callable[[Bench], Result]], ...] = (
    ("finite", STAGES, finite),
    ("no force beyond reach", STAGES, no_touch),
    ("rotation", DIRECTED, rotation),
    ("swap", STAGES, swap),
    ("friction limit", SHEARED, friction_limit),
    ("energy", ELASTIC, energy),
    ("ledger", ELASTIC, ledger),
    ("dissipates", VISCOUS, passive),
    ("tangent", ELASTIC, tangent),
    ("contact area", ("normal",), area),
    ("compiled", STAGES, compiled),
    ("history", STAGES, history),
)


@dataclass(frozen=True)
class Finding:
    """Result of one test of a part; `detail` describes the worst case or the failure."""

    law: str
    test: str
    passed: bool
    detail: str = ""


def check(parts: Iterable[Any]) -> list[Finding]:
    """Return all findings on these parts of plug-ins, in order. What raises fails the test in which it did. A law that fails in
    its declaration or its parameters is not tested further, another part in any test."""
    findings: list[Finding] = []
    for part in parts:
        findings.append(_finding(part.name, "declaration", partial(_declaration, part)))
        if not findings[-1].passed:
            continue
        is_law = isinstance(part, Law)
        for form in forms_of(part) if is_law else [part]:
            for name, test in next(tests(form) for kind, tests in TESTS.items() if isinstance(form, kind)).items():
                findings.append(_finding(form.name, name, test))
                if not findings[-1].passed and (name == "parameters" or not is_law):
                    break
    return findings


def _finding(part: str, name: str, test: Callable[[], Result | Cases]) -> Finding:
    try:
        result = test()
        if not isinstance(result, tuple):  # the first failure, with its case
            result = next(((False, f"{what}: {detail}") for what, (passed, detail) in result if not passed), (True, ""))
        return Finding(part, name, *result)
    except Exception as problem:  # third-party code: any exception is a finding
        text = (str(problem).strip().splitlines() or [""])[0]
        return Finding(part, name, False, compile_error(problem) or f"{type(problem).__name__}: {text}")


def report(findings: Sequence[Finding]) -> str:
    rows = [("", "part", "test", "")]
    rows += [("ok" if f.passed else "FAIL", f.law, f.test, f.detail) for f in sorted(findings, key=lambda f: f.passed)]
    widths = [max(len(row[k]) for row in rows) for k in range(3)]
    lines = ["  ".join([*(row[k].ljust(widths[k]) for k in range(3)), row[3]]).rstrip() for row in rows]
    failed, parts = sum(not f.passed for f in findings), len({f.law for f in findings})
    lines.append(f"{parts} {'part' if parts == 1 else 'parts'}, {len(findings)} tests, {failed} failed")
    return "\n".join(lines)


def _declaration(part: Any) -> Result:
    faults = [] if part.name.isidentifier() else [f"name '{part.name}' is not an identifier"]
    faults += [] if part.source.strip() else ["names no source"]
    if hasattr(part, "parameters") and not hasattr(part.parameters, "_fields"):
        faults.append("parameters is not a NamedTuple")
    if isinstance(part, Law):
        wrong = {
            f"stage '{part.stage}' is none of {', '.join(STAGES)}": part.stage not in STAGES,
            f"the {part.stage} stage keeps no history": part.history and part.stage in VISCOUS,
            f"the {part.stage} stage keeps no field": part.field and part.stage != "tangential",
            f"the {part.stage} stage acts in contact only: no reach": part.reach and part.stage not in ("normal", "adhesion"),
            "a history name occurs twice": len(set(part.history)) < len(part.history),
        }
        faults += [text for text, is_wrong in wrong.items() if is_wrong]
    for option in getattr(part, "options", ()):
        values = option.default if isinstance(option.default, Sequence) else [option.default]
        if option.words:
            if option.default not in option.words and (isinstance(option.default, str) or not option.or_number):
                faults.append(f"the default of option '{option.name}' is none of its words")
        elif isinstance(option.default, str):
            faults.append(f"the default of option '{option.name}' is a text, but the option has no words")
        elif any(x is not None and not option.low <= float(x) <= option.high for x in values):
            faults.append(f"the default of option '{option.name}' is outside its own range")
    return not faults, "; ".join(faults)


def _parameters(declared: type, cases: Iterable[tuple[str, Any]]) -> Cases:
    for label, p in cases:
        if issubclass(type(p), declared):
            yield label, _numbers(p, len(p), "")
        else:
            yield label, (False, f"mix gives a {type(p).__name__}, declared is {declared.__name__}")


def _numbers(values: Any, count: int, what: str) -> Result:
    if not isinstance(values, tuple) or len(values) != count:
        return False, f"the kernel returns {values!r}, expected a tuple of {count}: {what}"
    names = getattr(values, "_fields", range(count))
    bad = [(n, x) for n, x in zip(names, values, strict=True) if not isinstance(x, int | float) or not math.isfinite(x)]
    return not bad, f"returns {bad[0][1]!r}" + (f" for {bad[0][0]}" if isinstance(bad[0][0], str) else "") if bad else ""


def _equal(got: np.ndarray, expected: Any) -> Result:
    off = np.abs(got - np.array(expected, float))
    return bool((off <= ROUND_OFF * np.abs(expected)).all()), f"compiled {got.tolist()}, in Python {list(expected)}"


# -- laws


def _of_law(law: Law) -> Tests:
    bench = cache(lambda: Bench(law))  # the parameters are tested first: what raises here fails that test
    cases = lambda: zip((one.label for one in bench().settings), bench().parameters, strict=True)  # noqa: E731
    tests: Tests = {"parameters": lambda: _parameters(law.parameters, cases())}
    return tests | {name: lambda test=test: test(bench()) for name, stages, test in LAW_TESTS if law.stage in stages}


# -- measures

FULL: dict[str, Any] = {"yield_strength": 1e9, "thermal_conductivity": 40.0, "heat_capacity": 500.0}
"""Optional keys of materials, all given."""

STEPS = {
    "a contact that slides": ContactStep(1e-4, 3e-5, 3e-5, 1e-9, 0.1, 3e-14, 1e-7, 3e9, 1e-8, 1e-8, 1.0),
    "a contact that sticks": ContactStep(1e-4, 1e-5, 3e-5, 0.0, 0.0, 0.0, 1e-7, 3e9, 1e-8, 1e-8, 1.0),
    "a contact of two bodies": ContactStep(1e-4, 3e-5, 3e-5, 1e-9, 0.1, 3e-14, 1e-7, 3e9, 1e-8, 1e-8, 0.0),
    "a contact that opens": ContactStep(0.0, 0.0, 0.0, 0.0, 0.0, 1e-16, 0.0, 0.0, 0.0, 0.0, 1.0),
}


def _of_measure(measure: Measure) -> Tests:
    pairs = {label: replace(pair, a=replace(pair.a, **FULL), b=replace(pair.b, **FULL)) for label, pair, _ in PAIRS}
    sets = option_sets(measure)
    cases = [(label + more, partial(measure.mix, pair, options)) for label, pair in pairs.items() for more, options in sets]
    summands, maxima = ([amount for _, _, amount in entries] for entries in by_kind([measure]))

    def amounts() -> Cases:
        for (label, mix), (what, step) in product(cases, STEPS.items()):
            values = plain(measure.kernel)(step, mix())
            yield f"{what}, {label}", _numbers(values, len(measure.amounts), "one for each amount")

    def as_in_a_run() -> Cases:
        function, layout = compose_measures([measure]), layout_of([measure])
        for (label, mix), (what, step) in product(cases, STEPS.items()):
            H = np.zeros((1, layout.width))
            function(step, 0, H, 0, 0, np.array(mix(), float))
            values = dict(zip(measure.amounts, plain(measure.kernel)(step, mix()), strict=True))
            expected = [values[amount] * (step.dt if amount.kind == MEAN else 1.0) for amount in summands]
            expected += [max(values[amount], 0.0) for amount in maxima]
            yield f"{what}, {label}", _equal(np.delete(H[0, 1:], layout.sums - 1) if layout.time >= 0 else H[0, 1:], expected)

    return {
        "parameters": lambda: _parameters(measure.parameters, ((label, mix()) for label, mix in cases)),
        "amounts": amounts,
        "compiled": as_in_a_run,
    }


# -- body effects

BODIES = {
    "a body that moves": Body(1e-12, 1e-5, -1e-5, 5e-6, 0.1, -0.2, 0.3, 1e4, -2e4, 3e4, 1e-23, 1e-6),
    "a body at rest": Body(1e-12, 1e-5, -1e-5, 5e-6, *(0.0,) * 6, 1e-23, 0.0),
}
TOTAL = Wrench(1e-11, -2e-11, 3e-11, 1e-16, -2e-16, 3e-16)  # force and torque of the contacts, for effects that see them


def _of_effect(effect: BodyEffect) -> Tests:
    cases = [(f"usual options{more}", partial(effect.mix, options)) for more, options in option_sets(effect)]

    def wrench(state: Body, p: Any) -> Any:
        return plain(effect.kernel)(state, TOTAL, p) if effect.sees_forces else plain(effect.kernel)(state, p)

    def forces() -> Cases:
        for (label, mix), (what, state) in product(cases, BODIES.items()):
            yield f"{what}, {label}", _numbers(wrench(state, mix()), 6, "a Wrench")

    def as_in_a_run() -> Cases:
        function = compose_effects([effect])
        for (label, mix), (what, state) in product(cases, BODIES.items()):
            B, E = np.zeros((1, body.WIDTH)), np.zeros((1, body_extra.WIDTH))
            B[0, body.MASS], B[0, body.POSITION3], B[0, body.VELOCITY3], B[0, body.SPIN3] = (
                state.mass, state[1:4], state[4:7], state[7:10],
            )  # fmt: skip
            B[0, body.FORCE3], B[0, body.TORQUE3], E[0, body_extra.INERTIA3] = TOTAL[:3], TOTAL[3:], state.inertia
            late = [math.inf] if effect.settling else []  # the end of settling
            function(B, E, 0, 1, state.time, 1e-9, np.array([*mix(), *late], float))
            got = np.concatenate((E[0, body_extra.EFFECT_FORCE3], E[0, body_extra.EFFECT_TORQUE3]))
            yield f"{what}, {label}", _equal(got, wrench(state, mix()))

    return {
        "parameters": lambda: _parameters(effect.parameters, ((label, mix()) for label, mix in cases)),
        "forces": forces,
        "compiled": as_in_a_run,
    }


# -- labellers


def _of_labeller(labeller: Labeller) -> Tests:
    rows = np.zeros((3, loaded_contact.MEMORY + len(labeller.contact_memory)))
    for row, partner, normal in zip(rows, (LOWER, UPPER, DEBRIS), ([0, 0, 1], [0, 0, -1], [1, 0, 0]), strict=True):
        row[loaded_contact.PARTNER], row[loaded_contact.IDENTITY] = partner, partner + 1.0
        row[loaded_contact.NORMAL3], row[loaded_contact.POINT3] = normal, -5e-6 * np.array(normal)
        row[loaded_contact.SPHERE_RADIUS], row[loaded_contact.CONTACT_RADIUS], row[loaded_contact.OVERLAP] = 5e-6, 1e-7, 2e-9
        row[loaded_contact.NORMAL_FORCE] = row[loaded_contact.LOAD] = 1e-4
        row[loaded_contact.TANGENTIAL_FORCE], row[loaded_contact.FRICTION_LIMIT] = 3e-5, 3e-5
        row[loaded_contact.CRITICAL_SLIP], row[loaded_contact.SLIP] = 1e-9, 1e-9

    def states() -> Cases:
        observe, label = compose_labeller(labeller)
        for what, n in {"a body without contacts": 0, "a pressed body": 2, "a body that touches another": 3}.items():
            C = rows[:n].copy()
            memory, out = np.zeros(len(labeller.memory)), np.zeros(2 + len(labeller.margins) + len(labeller.extras))
            observed = np.zeros(observed_body.WIDTH)
            observed[observed_body.MASS], observed[observed_body.QUATERNION], observed[observed_body.DRAG] = 1e-12, 1.0, 1.0
            for _ in range(2):  # observed again with what it has noted
                observe(C, n, observed, memory)
                observed[observed_body.ELAPSED] = observed[observed_body.PLATE_SHIFT] = 1e-8
            label(C, n, observed, memory, out)
            names = [("state", out[0], labeller.states), ("reason", out[1], labeller.reasons)]
            wrong = [f"{name} {code:g} of {len(known)}" for name, code, known in names if code not in range(len(known))]
            yield what, (not wrong, ", ".join(wrong))

    return {"states": states}


# -- interactions of spots

OVERLAP = 1e-4  # over the radius, of the contact in which forces are compared


def _of_spots(effect: SpotInteraction) -> Tests:
    cases = [(label + more, pair, radius, options) for more, options in option_sets(effect) for label, pair, radius in PAIRS]

    def parameters() -> Cases:
        for label, pair, _, options in cases:
            values = {"stiffness": effect.stiffness(pair, options)}
            values |= {f"compliance of {one.name}": effect.compliance(one, options) for one in (pair.a, pair.b)}
            for name, value in values.items():
                sound = math.isfinite(value) and value >= 0.0 and (name != "stiffness" or value > 0.0)
                yield label, (sound, f"{name} is {value!r}")

    def stiffness() -> Cases:  # the law then sees what is left of the overlap
        for label, pair, radius, options in cases:
            d = OVERLAP * radius
            force = plain(HERTZ.kernel)(Contact(d, radius, 8e3 * radius**3, *(0.0,) * 7), HERTZ.mix(pair, {})).force
            off = abs(effect.stiffness(pair, options) * math.sqrt(radius * d**3) / force - 1.0)
            yield label, (off <= ROUND_OFF, f"the force of a spot alone is off that of Hertz by {off:.1e}")

    def compliance() -> Cases:  # with more, spots that touch could relieve each other by more than their own indentation
        for label, pair, _, options in cases:
            compliances = sum(effect.compliance(one, options) for one in (pair.a, pair.b))
            ratio = math.pi * 0.75 * effect.stiffness(pair, options) * compliances
            yield label, (ratio <= 1.0 + ROUND_OFF, f"the plates give way {ratio:.3g} times as far as half-spaces")

    return {"parameters": parameters, "stiffness": stiffness, "compliance": compliance}


TESTS: dict[type, Callable[[Any], Tests]] = {
    Law: _of_law, Measure: _of_measure, BodyEffect: _of_effect, Labeller: _of_labeller, SpotInteraction: _of_spots,
}  # fmt: skip
