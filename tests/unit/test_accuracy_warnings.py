"""What a run says at its end about its own accuracy."""

from __future__ import annotations

import pytest

from thirdbody.runner.accuracy_warnings import ending_warnings, step_words


@pytest.mark.parametrize(
    ("message", "words"),
    [
        ({"load_ratio": 2.61, "finished": True}, ["2.61 times the load", "bounces"]),
        ({"load_ratio": 0.2, "finished": True}, ["0.20 times the load"]),
        ({"load_ratio": 1.02, "finished": True}, []),
        ({"load_ratio": None, "patches_not_carried": None}, []),
        ({"load_ratio": 1.0, "patches_not_carried": 0, "bodies": 40}, []),
        ({"load_ratio": 1.0, "patches_not_carried": 1, "bodies": 40}, ["1 of 40 patches", "solver.inertia"]),
        ({"patches_not_carried": None, "histories_shortened": 3}, ["3 contacts", "contact.nodes"]),
        ({"patches_not_carried": None, "histories_shortened": 0}, []),
        ({"patches_not_carried": 0, "largest_fraction_rolling": 0.25}, ["25 % of the bodies rolled", "momentum"]),
        ({"patches_not_carried": 0, "largest_fraction_rolling": 0.0}, []),
        ({"patches_not_carried": None, "largest_fraction_rolling": 0.25}, []),
        ({"damping_share": 0.41, "energy": {"friction": 5.1, "plate_work": 10.0}}, ["took 41 %", "friction 51 %"]),
        ({"damping_share": 0.08, "energy": {"friction": 9.1, "plate_work": 10.0}}, []),
        ({"damping_share": None}, []),
        ({}, []),
    ],
)
def test_loads_that_are_not_carried_are_reported(message, words):
    said = " ".join(ending_warnings(message))
    assert all(word in said for word in words) and bool(said) == bool(words)


def test_words_for_what_limited_the_steps():
    assert step_words({"steps_limited_by": {"output": 60, "largest_step": 30, "error": 10}}) == (
        "output 60 %, largest step 30 %, error 10 %"
    )
    assert step_words({"time_step": 1e-9}) == ""
