"""Every law that we ship passes the conformance suite, and the suite finds each of a set of bad laws."""

import math
import re
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import pytest
from thirdbody.laws.compose import ordered
from thirdbody.laws.conformance import bench, suite
from thirdbody.laws.conformance.suite import Finding, check, report
from thirdbody.laws.contract import Law, Option, Plugin, SpotInteraction, kernel
from thirdbody.laws.hertz import HERTZ
from thirdbody.laws.registry import discover, load_file

HERE = Path(__file__).parent
OURS = discover([HERE.parents[1] / "plugins" / "dmt_adhesion.py"]).laws
BAD = {law.name: law for family in load_file(HERE / "bad_laws.py").families for laws in family.levels.values() for law in laws}
SLOW = pytest.mark.full(kind="slow")

# what each fault has to be found by, and by nothing else: a suite that fails everything proves nothing
FOUND_BY = {
    "stored_displacement": {"energy", "ledger"}, "beyond_friction": {"friction limit"}, "swirl": {"swap"}, "secant": {"tangent"},
    "pushing_dashpot": {"dissipates"}, "not_finite": {"parameters"}, "unsourced": {"declaration"}, "misplaced": {"declaration"},
}  # fmt: skip
FOUND_BY_TOO = {
    "lossless_ledger": {"ledger"}, "wound_up": {"energy", "ledger"}, "fixed_area": {"contact area"}, "faint": {"contact area"},
    "of_spheres": {"tangent"}, "misnamed": {"history"}, "unguarded": {"finite", "no force beyond reach", "compiled"},
    "square_friction": {"rotation"}, "one_sided": {"swap"}, "far_pull": {"no force beyond reach", "energy", "ledger"},
    "rocking_motor": {"energy", "ledger"},
}  # fmt: skip


def failed(findings):
    return {finding.test: finding.detail for finding in findings if not finding.passed}


# of every stage one; those that many others stand on, in one form with usual options
QUICK = {"hertz_damping", "tangential_damping", "rolling_resistance", "pivoting"}


@pytest.mark.parametrize("name", ["coulomb", "mindlin", "adhesion"])
def test_our_laws_conform_with_usual_options(name, monkeypatch):
    sets, forms = bench.option_sets, suite.forms_of
    monkeypatch.setattr(bench, "option_sets", lambda law: sets(law)[:1])
    monkeypatch.setattr(suite, "forms_of", lambda law: forms(law)[:1])
    findings = check([OURS[name]])
    assert len(findings) > 7 and not failed(findings), report(findings)


@pytest.mark.parametrize("name", [name if name in QUICK else pytest.param(name, marks=SLOW) for name in sorted(OURS)])
def test_our_laws_conform(name):
    findings = check([OURS[name]])
    assert len(findings) > 7, "too few tests ran"
    assert not failed(findings), report(findings)


@pytest.mark.parametrize("rows", [FOUND_BY, pytest.param(FOUND_BY_TOO, marks=SLOW)], ids=["some", "others"])
def test_the_suite_finds_what_is_wrong(rows):
    assert set(BAD) == FOUND_BY.keys() | FOUND_BY_TOO.keys()
    for name, tests in rows.items():
        findings = check([BAD[name]])
        faults = failed(findings)
        # not interpreted when the compiler is off: then nothing is there to compare
        assert set(faults) == tests - ({"compiled"} if "compiler is off" in report(findings) else set()), report(findings)
        assert all(faults.values()), "a failure has to say what is wrong"
        if name == "swirl":
            (finding,) = [f for f in findings if f.test == "tangent"]
            assert finding.passed and "explicit only" in finding.detail  # a law without tangent is reported, not failed


def test_a_field_of_a_law_that_is_not_tangential_is_refused():
    law = replace(HERTZ, history=("overlap",), field=4)
    assert failed(check([law])) == {"declaration": "the normal stage keeps no field"}
    with pytest.raises(ValueError, match="'hertz' of the normal stage has a field: only a tangential law may"):
        ordered((law,))

    lines = report([Finding("good", "finite", True), Finding("bad", "swap", False, "tx differs")]).splitlines()
    assert lines[1].split() == ["FAIL", "bad", "swap", "tx", "differs"] and lines[-1] == "2 parts, 2 tests, 1 failed"


def test_our_interactions_of_spots_conform_and_the_suite_finds_what_is_wrong():
    (spots,) = (effect for effect in discover().effects.values() if isinstance(effect, SpotInteraction))
    findings = check([spots])
    assert len(findings) == 4 and not failed(findings), report(findings)
    for changes, test in (
        ({"source": " "}, "declaration"),
        ({"compliance": lambda material, options: float("nan")}, "parameters"),
        ({"compliance": lambda material, options: -1e-12}, "parameters"),
        ({"stiffness": lambda pair, options: 1e11}, "stiffness"),
        ({"compliance": lambda material, options: 1.0 / (2.0 * math.pi * material.shear_modulus)}, "compliance"),  # too soft
        ({"compliance": lambda material, options: options["none"]}, "parameters"),
    ):
        assert test in failed(check([replace(spots, **changes)]))


PARTS = discover()
LABELLER = PARTS.families["three_spot"].labeller


@SLOW
def test_our_measures_effects_and_labeller_conform():
    findings = check([*(one for one in PARTS.effects.values() if not isinstance(one, Law)), *PARTS.measures.values(), LABELLER])
    assert len(findings) > 20 and not failed(findings), report(findings)


class Rate(NamedTuple):
    rate: float


@kernel
def no_state(contacts, n, body, memory, out):
    out[0] = 7.0


def test_faults_of_measures_effects_and_labellers_and_a_forgotten_comma():
    """Compiled and in Python, for one that passes all tests."""
    measure, effect = PARTS.measures["wear"], PARTS.effects["gravity"]
    assert not failed(passed := check([effect])) and {one.test for one in passed} >= {"forces", "compiled"}
    for part, test, words in (
        (replace(measure, kernel=lambda s, p: s.slipp), "amounts", "no attribute 'slipp'"),
        (replace(measure, kernel=lambda s, p: s.slip), "amounts", "expected a tuple of"),
        (replace(measure, mix=lambda pair, options: Rate(1.0)), "parameters", "mix gives a Rate"),
        (replace(effect, kernel=lambda b, p: (math.nan,) * 6), "forces", "a body that moves, usual options: returns nan"),
        (replace(effect, source=" "), "declaration", "names no source"),
        (replace(LABELLER, label=no_state), "states", "a body without contacts: state 7 of 4"),
    ):
        found = failed(check([part]))
        assert found.keys() == {test} and re.search(words, found[test]), found
    for make, words in (
        (lambda: Plugin("mine", effects=HERTZ), r"effects of 'mine': expected a tuple, as \(EFFECT,\), not Law"),
        (lambda: Plugin("mine", measures=(HERTZ,)), "measures of 'mine': Law .* does not belong there"),
        (lambda: replace(HERTZ, options=Option("nodes", "dimensionless", 1.0)), r"options of 'hertz'.*\(OPTION,\), not Option"),
        (lambda: replace(HERTZ, history="force"), r"history of 'hertz'.*not 'force'"),
    ):
        with pytest.raises(TypeError, match=words):
            make()
