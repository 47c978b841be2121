"""The conformance suite: requirements on every contact law. `thirdbody laws --check FILE` runs it.

Each law is run through the same composed, compiled tile function as in a simulation. Tests that do not apply to the law's stage
are omitted.
"""

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import partial

from thirdbody.laws.conformance.energy import area, energy, ledger, tangent
from thirdbody.laws.conformance.paths import Bench, forms_of
from thirdbody.laws.conformance.symmetry import compiled, finite, friction_limit, history, no_touch, passive, rotation, swap
from thirdbody.laws.contract import STAGES, Law, Option
from thirdbody.laws.generated import compile_error

ELASTIC = ("normal", "adhesion", "tangential", "rolling", "twisting")
VISCOUS = ("damping", "tangential_damping")
SHEARED = ("tangential", "tangential_damping", "rolling", "twisting")
DIRECTED = tuple(stage for stage in STAGES if stage != "twisting")
"""Stages whose tests turn the frame: the rotation about the normal has no direction in the contact's plane."""

TESTS: tuple[tuple[str, tuple[str, ...], Callable[[Bench], tuple[bool, str]]], ...] = (
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
    """Result of one test of a law or another part; `detail` describes the worst case or the failure."""

    law: str
    test: str
    passed: bool
    detail: str = ""


def check(laws: Iterable[Law]) -> list[Finding]:
    """Return all findings on these laws, in order. A law that raises fails the test in which it did."""
    findings: list[Finding] = []
    for law in laws:
        faults = declaration_faults(law)
        findings.append(Finding(law.name, "declaration", not faults, "; ".join(faults)))
        if faults:
            continue
        for form in forms_of(law):
            findings += _measured(form)
    return findings


def _measured(law: Law) -> list[Finding]:
    """Return the findings on the compiled law, or on a variant."""
    try:
        bench = Bench(law)
        faults = parameter_faults(bench)
    except Exception as problem:  # third-party code: any exception is a finding
        faults = [_problem_text(problem)]
    result = [Finding(law.name, "parameters", not faults, "; ".join(faults[:3]))]
    if not faults:
        result += [finding(law.name, name, partial(test, bench)) for name, stages, test in TESTS if law.stage in stages]
    return result


def report(findings: Sequence[Finding]) -> str:
    """Format the findings as a plain-text table, failures first, with a line of counts."""
    rows = [("", "part", "test", "")]
    rows += [("ok" if f.passed else "FAIL", f.law, f.test, f.detail) for f in sorted(findings, key=lambda f: f.passed)]
    widths = [max(len(row[k]) for row in rows) for k in range(3)]
    lines = ["  ".join([*(row[k].ljust(widths[k]) for k in range(3)), row[3]]).rstrip() for row in rows]
    failed = sum(not f.passed for f in findings)
    parts = len({f.law for f in findings})
    lines.append(f"{parts} {'part' if parts == 1 else 'parts'}, {len(findings)} tests, {failed} failed")
    return "\n".join(lines)


def declaration_faults(law: Law) -> list[str]:
    """Return faults in the declaration of the law, before anything is compiled."""
    faults = []
    if law.stage not in STAGES:
        faults.append(f"stage '{law.stage}' is none of {', '.join(STAGES)}")
    if not law.name.isidentifier():
        faults.append(f"name '{law.name}' is not an identifier")
    if not law.source.strip():
        faults.append("names no source")
    if not hasattr(law.parameters, "_fields"):
        faults.append("parameters is not a NamedTuple")
    if law.history and law.stage in VISCOUS:
        faults.append(f"the {law.stage} stage keeps no history")
    if law.field and law.stage != "tangential":
        faults.append(f"the {law.stage} stage keeps no field")
    if law.reach and law.stage not in ("normal", "adhesion"):
        faults.append(f"the {law.stage} stage acts in contact only: no reach")
    if len(set(law.history)) < len(law.history):
        faults.append("a history name occurs twice")
    return faults + option_faults(law.options)


def option_faults(options: Iterable[Option]) -> list[str]:
    """Return faults of the defaults of options."""
    faults = []
    for option in options:
        values = option.default if isinstance(option.default, Sequence) else [option.default]
        if option.words:
            if option.default not in option.words and (isinstance(option.default, str) or not option.or_number):
                faults.append(f"the default of option '{option.name}' is none of its words")
        elif isinstance(option.default, str):
            faults.append(f"the default of option '{option.name}' is a text, but the option has no words")
        elif any(x is not None and not option.low <= float(x) <= option.high for x in values):
            faults.append(f"the default of option '{option.name}' is outside its own range")
    return faults


def parameter_faults(bench: Bench) -> list[str]:
    """Return settings in which `mix` does not return finite floats in a tuple of the declared type."""
    faults = []
    for k, setting in enumerate(bench.settings):
        p = bench.parameters(k)
        is_declared: bool = isinstance(p, bench.law.parameters)
        if not is_declared:
            return [f"mix gives a {type(p).__name__}, declared is {bench.law.parameters.__name__}"]
        faults += [
            f"{setting.label}: {name} is {value!r}"
            for name, value in zip(p._fields, p, strict=True)
            if not isinstance(value, int | float) or not math.isfinite(value)
        ]
    return faults


def finding(part: str, name: str, test: Callable[[], tuple[bool, str]]) -> Finding:
    """Return the result of a test of a part of a plug-in. What raises fails the test."""
    try:
        passed, detail = test()
    except Exception as problem:  # third-party code: any exception is a finding
        passed, detail = False, _problem_text(problem)
    return Finding(part, name, passed, detail)


def _problem_text(problem: Exception) -> str:
    reason = compile_error(problem)
    if reason is not None:
        return reason
    text = str(problem).strip().splitlines()
    return f"{type(problem).__name__}: {text[0] if text else ''}"
