"""Every law that we ship passes the conformance suite, and the suite finds each of a set of bad laws."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import pytest

from thirdbody.laws.codegen.laws import ordered
from thirdbody.laws.conformance.spots import check_spots
from thirdbody.laws.conformance.suite import Finding, check, report
from thirdbody.laws.contract import Law, SpotInteraction
from thirdbody.laws.hertz import HERTZ
from thirdbody.laws.registry import discover, load_file

HERE = Path(__file__).parent
TEMPLATE = HERE.parents[1] / "plugins" / "dmt_adhesion.py"

OURS = discover([TEMPLATE]).laws
BAD: dict[str, Law] = {
    law.name: law for family in load_file(HERE / "bad_laws.py").families for laws in family.levels.values() for law in laws
}

# what each fault has to be found by, and by nothing else: a suite that fails everything proves nothing
FOUND_BY = {
    "stored_displacement": {"energy", "ledger"},
    "beyond_friction": {"friction limit"},
    "generous_limit": {"friction limit"},
    "square_friction": {"rotation"},
    "swirl": {"swap"},
    "lossless_ledger": {"ledger"},
    "unguarded": {"finite", "no force beyond reach", "compiled"},
    "wound_up": {"energy", "ledger"},
    "secant": {"tangent"},
    "faint": {"contact area"},
    "fixed_area": {"contact area"},
    "of_spheres": {"tangent"},
    "misnamed": {"history"},
    "stuck": {"tangent"},
    "lasting_pull": {"no force beyond reach"},
    "far_pull": {"no force beyond reach", "energy", "ledger"},
    "pushing_dashpot": {"dissipates"},
    "one_sided": {"swap"},
    "not_finite": {"parameters"},
    "heavy_roller": {"friction limit"},
    "rocking_motor": {"energy", "ledger"},
    "unsourced": {"declaration"},
    "misplaced": {"declaration"},
}


def failed(findings: list[Finding]) -> dict[str, str]:
    return {finding.test: finding.detail for finding in findings if not finding.passed}


def test_the_plug_ins_load():
    registry = discover([TEMPLATE])
    assert not registry.failures
    assert "dmt_adhesion" in registry.effects


@pytest.mark.parametrize("name", sorted(OURS))
def test_our_laws_conform(name):
    findings = check([OURS[name]])
    assert len(findings) > 8, "too few tests ran"
    assert not failed(findings), report(findings)


@pytest.mark.parametrize("name", sorted(FOUND_BY))
def test_the_suite_finds_what_is_wrong(name):
    findings = check([BAD[name]])
    faults = failed(findings)
    # not interpreted when the compiler is off: then nothing is there to compare
    expected = FOUND_BY[name] - ({"compiled"} if "compiler is off" in report(findings) else set())
    assert set(faults) == expected, report(findings)
    assert all(faults.values()), "a failure has to say what is wrong"


def test_a_field_of_a_law_that_is_not_tangential_is_refused():
    law = replace(HERTZ, history=("overlap",), field=4)
    assert failed(check([law])) == {"declaration": "the normal stage keeps no field"}
    with pytest.raises(ValueError, match="'hertz' of the normal stage has a field: only a tangential law may"):
        ordered((law,))


def test_no_bad_law_is_left_out():
    assert set(BAD) == set(FOUND_BY)


def test_a_law_without_tangent_is_reported_not_failed():
    (finding,) = [f for f in check([BAD["swirl"]]) if f.test == "tangent"]
    assert finding.passed and "explicit only" in finding.detail


def test_the_report_has_failures_first_and_counts_them():
    findings = [Finding("good", "finite", True), Finding("bad", "swap", False, "tx differs")]
    lines = report(findings).splitlines()
    assert lines[1].split() == ["FAIL", "bad", "swap", "tx", "differs"]
    assert lines[-1] == "2 laws, 2 tests, 1 failed"


CLOSE_SPOTS = [effect for effect in discover().effects.values() if isinstance(effect, SpotInteraction)]


@pytest.mark.parametrize("effect", CLOSE_SPOTS, ids=lambda effect: effect.name)
def test_our_interactions_of_spots_conform(effect):
    findings = check_spots(effect)
    assert len(findings) == 4 and not failed(findings), report(findings)


@pytest.mark.parametrize(
    ("changes", "test"),
    [
        ({"source": " "}, "declaration"),
        ({"compliance": lambda material, options: float("nan")}, "parameters"),
        ({"compliance": lambda material, options: -1e-12}, "parameters"),
        ({"stiffness": lambda pair, options: 1e11}, "stiffness"),
        ({"compliance": lambda material, options: 1.0 / (2.0 * math.pi * material.shear_modulus)}, "compliance"),
        ({"compliance": lambda material, options: options["none"]}, "parameters"),
    ],
    ids=["source", "nan", "negative", "stiffness", "too soft", "raises"],
)
def test_the_suite_finds_what_is_wrong_with_an_interaction(changes, test):
    assert test in failed(check_spots(replace(CLOSE_SPOTS[0], **changes)))
