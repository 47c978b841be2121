"""What is said of a run whose energy balance does not close."""

from __future__ import annotations

import pytest

from thirdbody.trajectory.energy_check import energy_verdict

SOUND = {
    "integrator": "explicit", "time_step": 2e-9, "time_step_limit": {"smallest": 1e-9}, "energy_residual": 4e-3,
    "energy": {"damping": 0.0, "friction": 1.0},
}  # fmt: skip
FIXED = '[solver]\ntime_step = "2 ns"\n'


@pytest.mark.parametrize("residual", [None, 0.0, 9.9e-4])
def test_a_balance_that_closes_or_is_not_known_is_not_spoken_of(residual):
    assert energy_verdict(SOUND | {"energy_residual": residual}) is None


@pytest.mark.parametrize(
    "facts, scene, words",
    [
        ({}, FIXED, ("the time step is 2 times the automatic one", 'solver.time_step = "5e-10 s"')),
        ({}, "", ("4.0e-03 of the largest energy", "too long for some impact or contact", 'solver.time_step = "5e-10 s"')),
        ({"energy": {"damping": 3.0, "friction": 1.0}}, "", ("dashpots take 75 % of what is lost", "5e-10 s")),
        ({"integrator": "implicit"}, "", ("solver.tolerance",)),
        ({"time_step": None, "time_step_limit": None, "energy": None}, "not TOML", ("smaller solver.time_step",)),
    ],
)
def test_the_reason_follows_from_the_facts(facts, scene, words):
    report = energy_verdict(SOUND | facts, scene)
    assert report is not None and all(word in report for word in words), report


@pytest.mark.parametrize(
    "share, scene, words",
    [
        (0.068, "", ("itself lost 6.8 %", "solver.tolerance", "explicit")),
        (0.068, "[solver]\ninertia = false\n", ("itself lost 6.8 %", "tips", "solver.inertia = true")),
        (-0.26, "", ("itself made 26.0 %", "solver.tolerance")),
        (0.004, "", ()),
        (-0.004, "", ()),
        (None, "", ()),
    ],
)
def test_energy_that_the_integrator_loses_or_makes_is_reported(share, scene, words):
    report = energy_verdict({"integrator": "implicit", "energy_residual": 1e-9, "energy_numerical_share": share}, scene)
    assert bool(report) == bool(words) and all(word in (report or "") for word in words), report
