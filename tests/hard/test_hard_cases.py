"""The hard cases, each once per integrator at one level, in full with `-m full`; their table: `tests/bench/hard_cases.py`."""

import math

import pytest
from hard.cases import CASES, Case, run_case
from hard.trial import Setting

# of these the other integrator, or tests of the same stage of the law, are in the default command
LONG = {
    "tiny_lump_rolls explicit", "tiny_lump_rolls implicit", "both_plates_pull explicit", "both_plates_pull implicit",
    "step_of_a_file explicit", "stiff_ratio explicit", "light_on_heavy explicit", "turning_pair explicit",
    "sharp_valleys explicit", "rides_onto explicit", "chain_of_ten explicit", "meets_again explicit", "crowded_spots explicit",
    "relaxed_start explicit", "bounces_until_it_sticks explicit", "lost_contact explicit",
}  # fmt: skip
QUICK = {
    case.name: [setting for setting in case.settings(True) if f"{case.name} {setting.integrator}" not in LONG]
    for case in CASES.values()
}  # fmt: skip
FULL = [
    pytest.param(case, s, id=f"{case.name}-{s.integrator}-{s.level}") for case in CASES.values() for s in case.settings(False)
]


@pytest.mark.parametrize("name", [name for name in QUICK if QUICK[name]])
def test_hard_case(name):
    for setting in QUICK[name]:
        row = run_case(CASES[name], setting, sweep=False)
        assert not row.broken, f"{setting}\n" + "\n".join(row.broken)


@pytest.mark.full(kind="hard")
@pytest.mark.parametrize("case, setting", FULL)
def test_hard_case_in_full(case, setting):
    """Every level, the long versions, and the largest stable step between 1.2 and 10 times the automatic one."""
    row = run_case(case, setting)
    assert not row.faults, "\n".join(row.faults)
    assert (row.factor is not None) == (case.swept and setting.integrator == "explicit")


@pytest.mark.parametrize("name", ["symmetric_spots", "rigid_plane"])
def test_automatic_step_has_a_margin_and_wastes_little(name):
    row = run_case(CASES[name], Setting("explicit", "mindlin"))
    assert row.factor and not row.faults
    assert "energy" in row.beyond  # what gives way first in both


def test_a_broken_invariant_fails_a_case():
    case = Case(lambda trial: trial.check("something", [2.0, math.nan], 1.0), ("explicit",), ("mindlin",))
    assert run_case(case, Setting("explicit", "mindlin")).faults == ("something: nan (at most 1)",)
