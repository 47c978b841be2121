"""Means over an output interval: exact where the trapezoidal rule is, of few samples, the same after a restore."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from thirdbody.trajectory.interval_means import SAMPLES, IntervalMeans

END = 2.0


def means_of(function, duration=END):
    """Means of a function of time (), and the state whose time they follow."""
    state = SimpleNamespace(time=0.0)
    return IntervalMeans(state, {"value": lambda now: np.array([function(now.time), 1.0])}, lambda: duration), state


def advance(means, state, times):
    for state.time in times:
        means.watch()


def test_the_mean_of_a_line_is_exact_for_any_instants():
    means, state = means_of(lambda t: 3.0 + 2.0 * t)
    advance(means, state, np.sort(np.random.default_rng(1).uniform(0.0, END, 500)))
    state.time = END
    # rounding of some thirty sums
    assert means.finish()["value"] == pytest.approx([3.0 + END, 1.0], rel=1e-13)


def test_the_mean_of_a_wave_has_the_error_of_the_trapezoidal_rule():
    means, state = means_of(lambda t: t**2)
    advance(means, state, np.linspace(0.0, END, 1001)[1:-1])
    state.time = END
    error = means.finish()["value"][0] - END**2 / 3.0
    # h^2/12 times the second derivative, 2, with h of a 32nd of the interval, or one watch more
    assert 0.0 < error < 1.1 * (END / SAMPLES) ** 2 / 6.0


def test_an_interval_has_at_most_so_many_samples():
    instants = []
    means, state = means_of(lambda t: instants.append(t) or 0.0)
    instants.clear()
    advance(means, state, np.linspace(0.0, END, 5001)[1:-1])
    state.time = END
    means.finish()
    assert SAMPLES // 2 < len(instants) <= SAMPLES


def test_each_interval_begins_anew():
    means, state = means_of(lambda t: t)
    for start, end in ((0.0, 2.0), (2.0, 3.0)):
        advance(means, state, np.linspace(start, end, 100)[1:-1])
        state.time = end
        assert means.finish()["value"][0] == pytest.approx(0.5 * (start + end), rel=1e-13)


def test_without_time_the_mean_is_the_present_value():
    means, state = means_of(lambda t: 7.0)
    assert means.finish()["value"].tolist() == [7.0, 1.0]


def test_without_an_expected_end_every_instant_is_sampled():
    means, state = means_of(lambda t: abs(t - 1.0), duration=np.inf)
    advance(means, state, np.linspace(0.0, END, 2001)[1:-1])
    state.time = END
    assert means.finish()["value"][0] == pytest.approx(0.5, rel=1e-12)  # a corner on a sample: exact


def test_restored_means_go_on_bit_for_bit():
    times = np.linspace(0.0, END, 777)[1:]
    whole, state = means_of(np.sin)
    advance(whole, state, times)
    reference = whole.finish()["value"]
    first, state = means_of(np.sin)
    advance(first, state, times[:300])
    saved = {name: array.copy() for name, array in first.export_state().items()}
    second, state = means_of(np.sin)
    second.restore(saved)
    advance(second, state, times[300:])
    assert np.array_equal(second.finish()["value"], reference)


def test_a_restore_of_other_means_is_refused():
    means, _ = means_of(np.sin)
    saved = means.export_state()
    del saved["sum_value"]
    with pytest.raises(ValueError, match="sum_value is missing"):
        means.restore(saved)
