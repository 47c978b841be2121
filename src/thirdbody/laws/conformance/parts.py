"""Conformance tests of measures, body effects and labellers: what they declare, and what they return, compiled as in a run."""

import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from thirdbody.kernels.contact_step import ContactStep
from thirdbody.kernels.tables import DEBRIS, LOWER, UPPER, body, body_extra, loaded_contact, observed_body
from thirdbody.laws.compose import compose_effects, compose_labeller
from thirdbody.laws.conformance.paths import PAIRS, option_sets
from thirdbody.laws.conformance.suite import Finding, finding, option_faults
from thirdbody.laws.contract import BodyEffect, Labeller
from thirdbody.laws.data import Body, Wrench
from thirdbody.laws.generated import plain
from thirdbody.laws.measures import Measure, compose_measures, largest, layout_of, summed

Result = tuple[bool, str]

ROUND_OFF = 1e-12
"""Relative difference between a compiled kernel and the same in Python: some contracted products."""

FULL: dict[str, Any] = {"yield_strength": 1e9, "thermal_conductivity": 40.0, "heat_capacity": 500.0}
"""Optional keys of materials, all given."""

STEPS = {
    "a contact that slides": ContactStep(1e-4, 3e-5, 3e-5, 1e-9, 0.1, 3e-14, 1e-7, 3e9, 1e-8, 1e-8, 1.0),
    "a contact that sticks": ContactStep(1e-4, 1e-5, 3e-5, 0.0, 0.0, 0.0, 1e-7, 3e9, 1e-8, 1e-8, 1.0),
    "a contact of two bodies": ContactStep(1e-4, 3e-5, 3e-5, 1e-9, 0.1, 3e-14, 1e-7, 3e9, 1e-8, 1e-8, 0.0),
    "a contact that opens": ContactStep(0.0, 0.0, 0.0, 0.0, 0.0, 1e-16, 0.0, 0.0, 0.0, 0.0, 1.0),
}
BODIES = {
    "a body that moves": Body(1e-12, 1e-5, -1e-5, 5e-6, 0.1, -0.2, 0.3, 1e4, -2e4, 3e4, 1e-23, 1e-6),
    "a body at rest": Body(1e-12, 1e-5, -1e-5, 5e-6, *(0.0,) * 6, 1e-23, 0.0),
}
TOTAL = Wrench(1e-11, -2e-11, 3e-11, 1e-16, -2e-16, 3e-16)
"""Force and torque of the contacts, for effects that see them."""


def check_parts(parts: Iterable[Any]) -> list[Finding]:
    """Return all findings on the measures, body effects and labellers among these parts of a plug-in."""
    results: list[Finding] = []
    for part in parts:
        tests = next((of(part) for kind, of in TESTS.items() if isinstance(part, kind)), {})
        for name, test in tests.items():
            results.append(finding(part.name, name, test))
            if not results[-1].passed:
                break
    return results


def declaration(part: Any) -> Result:
    """Its name can be a key, it has a source, and its defaults are in their own ranges."""
    faults = [] if part.name.isidentifier() else [f"name '{part.name}' is not an identifier"]
    faults += [] if part.source.strip() else ["names no source"]
    if not isinstance(part, Labeller):
        faults += [] if hasattr(part.parameters, "_fields") else ["parameters is not a NamedTuple"]
        faults += option_faults(part.options)
    return not faults, "; ".join(faults)


def of_measure(measure: Measure) -> dict[str, Callable[[], Result]]:
    """Return the tests of a measure."""
    pairs = {label: replace(pair, a=replace(pair.a, **FULL), b=replace(pair.b, **FULL)) for label, pair, _ in PAIRS}
    sets = option_sets(measure)
    cases = [(label + more, partial(measure.mix, pair, options)) for label, pair in pairs.items() for more, options in sets]
    columns = [*summed([measure]), *largest([measure])]

    def amounts() -> Iterator[tuple[str, Result]]:
        for label, mix in cases:
            for what, step in STEPS.items():
                values = plain(measure.kernel)(step, mix())
                yield f"{what}, {label}", _numbers(values, len(measure.amounts), "one for each amount")

    def compiled() -> Iterator[tuple[str, Result]]:
        function, layout = compose_measures([measure]), layout_of([measure])
        for label, mix in cases:
            for what, step in STEPS.items():
                H = np.zeros((1, layout.width))
                function(step, 0, H, 0, 0, np.array(mix(), float))
                values = plain(measure.kernel)(step, mix())
                expected = [values[i] * (step.dt if measure.amounts[i].kind == "mean" else 1.0) for _, i in columns]
                got = np.delete(H[0, 1:], layout.sums - 1) if layout.time >= 0 else H[0, 1:]
                expected = [*expected[: len(summed([measure]))], *np.maximum(expected[len(summed([measure])) :], 0.0)]
                yield f"{what}, {label}", _equal(got, expected)

    return {"declaration": partial(declaration, measure), "parameters": partial(_parameters, measure.parameters, cases),
            "amounts": partial(_all, amounts), "compiled": partial(_all, compiled)}  # fmt: skip


def of_effect(effect: BodyEffect) -> dict[str, Callable[[], Result]]:
    """Return the tests of a body effect."""
    cases = [(f"usual options{more}", partial(effect.mix, options)) for more, options in option_sets(effect)]

    def wrench(state: Body, p: Any) -> Any:
        return plain(effect.kernel)(state, TOTAL, p) if effect.sees_forces else plain(effect.kernel)(state, p)

    def forces() -> Iterator[tuple[str, Result]]:
        for label, mix in cases:
            for what, state in BODIES.items():
                yield f"{what}, {label}", _numbers(wrench(state, mix()), 6, "a Wrench")

    def compiled() -> Iterator[tuple[str, Result]]:
        function = compose_effects([effect])
        for label, mix in cases:
            for what, state in BODIES.items():
                B, E = np.zeros((1, body.WIDTH)), np.zeros((1, body_extra.WIDTH))
                B[0, body.MASS], B[0, body.POSITION3], B[0, body.VELOCITY3] = state[0], state[1:4], state[4:7]
                B[0, body.SPIN3] = state[7:10]
                B[0, body.FORCE3], B[0, body.TORQUE3], E[0, body_extra.INERTIA3] = TOTAL[:3], TOTAL[3:], state.inertia
                late = [math.inf] if effect.settling else []  # the end of settling
                function(B, E, 0, 1, state.time, 1e-9, np.array([*mix(), *late], float))
                got = np.concatenate((E[0, body_extra.EFFECT_FORCE3], E[0, body_extra.EFFECT_TORQUE3]))
                yield f"{what}, {label}", _equal(got, wrench(state, mix()))

    return {"declaration": partial(declaration, effect), "parameters": partial(_parameters, effect.parameters, cases),
            "forces": partial(_all, forces), "compiled": partial(_all, compiled)}  # fmt: skip


def of_labeller(labeller: Labeller) -> dict[str, Callable[[], Result]]:
    """Return the tests of a labeller."""

    def states() -> Iterator[tuple[str, Result]]:
        observe, label = compose_labeller(labeller)
        for what, rows in _surroundings().items():
            C = np.zeros((3, loaded_contact.MEMORY + len(labeller.contact_memory)))
            C[: len(rows), : loaded_contact.MEMORY] = rows
            memory, out = np.zeros(len(labeller.memory)), np.zeros(2 + len(labeller.margins) + len(labeller.extras))
            observed = np.zeros(observed_body.WIDTH)
            observed[observed_body.MASS], observed[observed_body.QUATERNION], observed[observed_body.DRAG] = 1e-12, 1.0, 1.0
            for _ in range(2):  # observed again with what it has noted
                observe(C[: len(rows)], len(rows), observed, memory)
                observed[observed_body.ELAPSED] = observed[observed_body.PLATE_SHIFT] = 1e-8
            label(C[: len(rows)], len(rows), observed, memory, out)
            names = [("state", out[0], labeller.states), ("reason", out[1], labeller.reasons)]
            wrong = [f"{name} {code:g} of {len(known)}" for name, code, known in names if code not in range(len(known))]
            yield what, (not wrong, ", ".join(wrong))

    return {"declaration": partial(declaration, labeller), "states": partial(_all, states)}


TESTS: dict[type, Callable[[Any], Mapping[str, Callable[[], Result]]]] = {
    Measure: of_measure, BodyEffect: of_effect, Labeller: of_labeller,
}  # fmt: skip


def _surroundings() -> dict[str, np.ndarray]:
    """Return rows of loaded contacts: none, two of a pressed ball, three with another body."""
    rows = np.zeros((3, loaded_contact.MEMORY))
    for row, partner, normal in zip(rows, (LOWER, UPPER, DEBRIS), ([0, 0, 1], [0, 0, -1], [1, 0, 0]), strict=True):
        row[loaded_contact.PARTNER], row[loaded_contact.IDENTITY] = partner, partner + 1.0
        row[loaded_contact.NORMAL3], row[loaded_contact.POINT3] = normal, -5e-6 * np.array(normal)
        row[loaded_contact.SPHERE_RADIUS], row[loaded_contact.CONTACT_RADIUS], row[loaded_contact.OVERLAP] = 5e-6, 1e-7, 2e-9
        row[loaded_contact.NORMAL_FORCE] = row[loaded_contact.LOAD] = 1e-4
        row[loaded_contact.TANGENTIAL_FORCE], row[loaded_contact.FRICTION_LIMIT] = 3e-5, 3e-5
        row[loaded_contact.CRITICAL_SLIP], row[loaded_contact.SLIP] = 1e-9, 1e-9
    return {"a body without contacts": rows[:0], "a pressed body": rows[:2], "a body that touches another": rows}


def _parameters(declared: type, cases: Iterable[tuple[str, Callable[[], Any]]]) -> Result:
    for label, mix in cases:
        p = mix()
        is_declared: bool = isinstance(p, declared)
        if not is_declared:
            return False, f"mix gives a {type(p).__name__}, declared is {declared.__name__}"
        passed, detail = _numbers(p, len(p), "")
        if not passed:
            return False, f"{label}: {detail}"
    return True, ""


def _all(results: Callable[[], Iterator[tuple[str, Result]]]) -> Result:
    """Return the first failure, with its case."""
    failed = ((False, f"{what}: {detail}") for what, (passed, detail) in results() if not passed)
    return next(failed, (True, ""))


def _numbers(values: Any, count: int, what: str) -> Result:
    """Test for a tuple of so many finite numbers."""
    if not isinstance(values, tuple) or len(values) != count:
        return False, f"the kernel returns {values!r}, expected a tuple of {count}: {what}"
    bad = [value for value in values if not isinstance(value, int | float) or not math.isfinite(value)]
    return not bad, f"returns {bad[0]!r}" if bad else ""


def _equal(got: np.ndarray, expected: Any) -> Result:
    """Test that a compiled kernel gives what the same in Python gives, to rounding of the largest value."""
    off = np.abs(got - np.array(expected, float))
    return bool((off <= ROUND_OFF * np.abs(expected)).all()), f"compiled {got.tolist()}, in Python {list(expected)}"
