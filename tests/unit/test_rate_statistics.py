"""Statistics and verdict of the rate test: correlated series of known truth, and how often the verdict is wrong."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.signal import lfilter

from thirdbody.trajectory.rate_test import FRICTION, Comparison, effect_of, verdict_of
from thirdbody.trajectory.statistics import mean_and_margin

SEEDS = 400


def correlated(rng: np.random.Generator, n: int, r: float) -> np.ndarray:
    """Return a stationary autoregression of first order with unit variance; its autocorrelation time is 1/2 + r/(1 - r)."""
    noise = rng.normal(size=n + 200) * math.sqrt(1.0 - r * r)
    return lfilter([1.0], [1.0, -r], noise)[200:]


@pytest.mark.parametrize(("n", "r", "most"), [
    (16, 0.0, 0.03), (16, 0.6, 0.06), (28, 0.3, 0.03), (28, 0.8, 0.06), (50, 0.6, 0.04), (100, 0.8, 0.04), (200, 0.9, 0.04),
])  # fmt: skip
def test_the_margin_of_a_short_series_covers_the_mean(n, r, most):
    """1 % of the means may lie outside; measured over 2000 series: 0.5 to 1.9 %, 3 % for the shortest and most correlated.

    The bounds lie three standard deviations of 400 draws above that.
    """
    rng = np.random.default_rng(1)
    outside = [abs(mean.value) > mean.margin for mean in (mean_and_margin(correlated(rng, n, r)) for _ in range(SEEDS))]
    assert np.mean(outside) <= most


@pytest.mark.parametrize(("n", "r"), [(50, 0.3), (100, 0.6), (200, 0.8)])
def test_the_error_is_that_of_the_mean(n, r):
    rng = np.random.default_rng(2)
    means = [mean_and_margin(correlated(rng, n, r)) for _ in range(SEEDS)]
    true = math.sqrt(2.0 * (0.5 + r / (1.0 - r)) / n)
    # the time is the larger one of two estimates: up to 25 % above the truth for these series, never far below
    assert 0.95 * true < np.median([mean.error for mean in means]) < 1.3 * true


def test_series_without_scatter_and_too_short_ones():
    assert mean_and_margin(np.full(20, 0.3)) == pytest.approx((0.3, 0.0, 0.0))
    assert mean_and_margin(np.zeros(20)) == (0.0, 0.0, 0.0)
    short = mean_and_margin(np.array([0.3, 0.5, np.nan]))
    assert short.value == pytest.approx(0.4) and math.isnan(short.error) and math.isnan(short.margin)


def compared(rng: np.random.Generator, effect: float, n: int, scatter: float, r: float = 0.5) -> list[Comparison]:
    """Return friction of two parts with independent scatter, the slow one lower by `effect`."""
    both = [0.38 + scatter * correlated(rng, n, r), 0.38 - effect + scatter * correlated(rng, n, r)]
    fast, slow = (mean_and_margin(values) for values in both)
    change = mean_and_margin(both[1] - both[0])
    found = effect_of(change, FRICTION)
    return [Comparison("friction_coefficient", "friction", *fast[:2], *slow[:2], *change, FRICTION, found)]


def verdicts(effect: float, n: int, scatter: float) -> dict[bool | None, float]:
    """Return the frequency of each verdict."""
    rng = np.random.default_rng(3)
    found = [verdict_of(compared(rng, effect, n, scatter), (0.0, 1.0), "v/3")[0] for _ in range(SEEDS)]
    return {kind: found.count(kind) / SEEDS for kind in (True, False, None)}


def test_false_rates_of_the_verdict():
    """Without an effect at most 1 % say there is one; of an effect three times what matters none is denied.

    An effect of just what matters may be called either way, but is seldom denied where the series is short: undecided then.
    """
    for n, scatter in ((28, 0.01), (50, 0.02), (100, 0.03)):
        none, strong = verdicts(0.0, n, scatter), verdicts(3.0 * FRICTION, n, scatter)
        assert none[True] <= 0.02, (n, none)
        assert strong[False] == 0.0, (n, strong)
    long = verdicts(0.0, 400, 0.02)
    assert long[False] > 0.95 and verdicts(3.0 * FRICTION, 400, 0.02)[True] > 0.99
    assert verdicts(0.0, 28, 0.08)[None] > 0.9  # too short for such a scatter: it does not say that there is none


def one(change: float, error: float, margin: float, name: str = "friction", matters: float = FRICTION) -> Comparison:
    return Comparison(name, name, 0.4, 0.004, 0.4 + change, 0.004, change, error, margin, matters,
                      effect_of(mean_and_margin(np.full(9, change))._replace(error=error, margin=margin), matters))  # fmt: skip


@pytest.mark.parametrize(("friction", "others", "drift", "effect", "words"), [
    (one(-0.002, 0.003, 0.008), [], 0.0, False,
     "no rate effect: friction 0.4000 ± 0.0040 at v, 0.3980 ± 0.0040 at v/3 (0.7 sigma)"),
    (one(-0.005, 0.001, 0.003), [], 0.0, False, "no rate effect that matters: friction falls by 0.0050 ± 0.0010 at v/3"),
    (one(-0.021, 0.004, 0.01), [], 0.0, True, "rate effect: friction falls by 0.0210 ± 0.0040 at v/3 (0.4000 ± 0.0040 at v)"),
    (one(0.004, 0.007, 0.02), [], 0.0, None,
     "undecided: friction rises by 0.0040 ± 0.0070 at v/3, with a margin of 0.02, and 0.01 would matter: "
     "a run about 3.3 times as long would decide"),
    (one(0.0, 0.001, 0.003), [one(0.01, 0.001, 0.003, "solid fraction", 0.005)], 0.0, True,
     "rate effect: solid fraction rises by 0.0100 ± 0.0010 at v/3; friction 0.4000 ± 0.0040 at v"),
    (one(0.0, 0.001, 0.003), [one(0.001, 0.01, 0.1, "solid fraction", 0.005)], 0.0, False,
     "no rate effect: friction 0.4000 ± 0.0040 at v, 0.4000 ± 0.0040 at v/3 (0.0 sigma); undecided: solid fraction"),
    (one(0.0, 0.001, 0.003), [], 0.03, None, "undecided: the difference in friction still changes by +0.030"),
])  # fmt: skip
def test_verdicts_in_words(friction, others, drift, effect, words):
    found, text = verdict_of([friction, *others], (drift, 0.01), "v/3")
    assert found is effect and text.startswith(words)
