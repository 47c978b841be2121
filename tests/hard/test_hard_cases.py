"""The hard cases that `thirdbody hard` runs: in CI each once per integrator at one level, in full with `-m hard`."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from thirdbody.errors import UsageError
from thirdbody.studies.robustness import time_steps
from thirdbody.studies.robustness.case import Finding, Setting, Trial
from thirdbody.studies.robustness.cases import CASES, LEVELS, Case


def paths(quick):
    found = [(case, setting) for case in CASES for setting in time_steps.settings_of(case, quick)]
    return [pytest.param(*path, id=f"{path[0].name}-{path[1].integrator}-{path[1].level}") for path in found]


@pytest.mark.parametrize("case, setting", paths(quick=True))
def test_hard_case(case, setting):
    """The reasons for the tolerances stand beside the invariants."""
    row = time_steps.run_case(case, setting, sweep=False)
    assert row.passed, "\n".join(row.broken)


@pytest.mark.full(kind="hard")
@pytest.mark.parametrize("case, setting", paths(quick=False))
def test_hard_case_in_full(case, setting):
    """Every level, the long versions, and the largest stable step between 1.2 and 10 times the automatic one."""
    row = time_steps.run_case(case, setting)
    assert row.passed, f"{row.factor} {row.beyond}\n" + "\n".join(row.broken)
    assert (row.factor is not None) == (case.swept and setting.integrator == "explicit")


@pytest.mark.parametrize("name", ["symmetric_spots", "rigid_plane"])
def test_automatic_step_has_a_margin_and_wastes_little(name):
    (case,) = time_steps.chosen([name])
    row = time_steps.run_case(case, Setting("explicit", "mindlin"))
    assert time_steps.MIN_FACTOR <= row.factor <= time_steps.MAX_FACTOR
    assert "energy" in row.beyond  # what gives way first in both


def test_cases_have_names_of_their_own_and_known_levels():
    assert len({case.name for case in CASES}) == len(CASES)
    assert all(set(case.levels) <= set(LEVELS) and case.integrators for case in CASES)
    with pytest.raises(UsageError, match="did you mean 'lost_contact'"):
        time_steps.chosen(["lost_contac"])


def made(run):
    """A row of a case with this course."""
    return time_steps.run_case(Case("made_up", "", run, ("explicit",), ("mindlin",)), Setting("explicit", "mindlin"))


def test_a_broken_invariant_fails_a_case():
    assert not made(lambda trial: trial.check("something", 2.0, 1.0)).passed
    assert not made(lambda trial: trial.check("something", math.nan, 1.0)).passed
    assert not made(lambda trial: trial.check_true("a label", False)).passed
    assert made(lambda trial: trial.check("something", 2.0, 1.0)).broken == ("something: 2 (at most 1)",)


def test_a_step_that_is_never_stable_or_always_is_fails_a_case():
    row = made(lambda trial: trial.steps.append(1.0))
    assert row.factor == time_steps.FACTORS[-1] and not row.passed
    assert not replace(row, factor=1.0).passed and replace(row, factor=1.2).passed and replace(row, factor=10.0).passed


def test_limits_of_truncation_are_not_compared_in_a_sweep():
    for steps, holds in (((), False), ((1e-9,), True)):
        trial = Trial(Setting("explicit", "mindlin", steps))
        trial.check("truncation", 2.0, 1.0, math.inf)
        assert (not trial.broken()) == holds
    assert Finding("exact", 0.0, 0.0).passed
