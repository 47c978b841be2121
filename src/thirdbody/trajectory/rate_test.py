"""Rate test of a run: its last third at two speeds compared, with errors and a verdict: the single source for all outputs."""

from __future__ import annotations

import math
import tomllib
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from thirdbody.quantity import MINUS, with_error
from thirdbody.trajectory.open_file import FILE_NAME, RATE_TEST
from thirdbody.trajectory.reader import Run, open_run
from thirdbody.trajectory.statistics import Mean, change_and_error, mean_and_margin

TRANSIENT = 1.0 / 6.0
"""Fraction of the last third that is skipped after the change of speed."""

FRICTION, SOLID_FRACTION, LABELS = 0.01, 0.005, 0.05
"""Changes from the speed of the run to zero speed that matter: of the friction coefficient, of the solid fraction, of the share
of bodies in a state. Linear in the speed, (1 - 1/factor) of them appears at the lower speed."""

NORMAL, LONGER = 2.58, 1.5
"""Half width of 99 % of a normal distribution in standard deviations; least advised length of a longer run over that of a run."""

ENOUGH = 8
"""Least number of output intervals that can be compared."""

NAN = float("nan")


@dataclass(frozen=True)
class Comparison:
    """One quantity at the speed of the run and at the lower one: means over the same stretch of sliding.

    Attributes
    ----------
    name : str
        Name of its series.
    words : str
        The quantity in words.
    fast, fast_error, slow, slow_error : float
        Means and their standard errors.
    change, change_error : float
        Mean of the differences slow less fast, interval by interval, and its standard error: both parts start from one state and
        share what depends on the path, which the error of the difference does not count.
    margin : float
        Half width of the confidence interval of the change at 99 %.
    matters : float
        Change at the lower speed from which on it matters.
    effect : bool or None
        Whether the change is significant and matters; None where the margin is too wide to tell.
    """

    name: str
    words: str
    fast: float
    fast_error: float
    slow: float
    slow_error: float
    change: float
    change_error: float
    margin: float
    matters: float
    effect: bool | None

    @property
    def significant(self) -> bool:
        """Whether the change exceeds its margin."""
        return abs(self.change) > self.margin

    @property
    def text(self) -> str:
        """The change in words: `friction falls by 0.021 ± 0.004`."""
        verb = "rises" if self.change > 0.0 else "falls"
        return f"{self.words} {verb} by {with_error(abs(self.change), self.change_error)}"

    @property
    def longer(self) -> float:
        """How many times as long a run would decide."""
        return max((NORMAL * self.change_error / self.matters) ** 2, LONGER)


@dataclass(frozen=True)
class RateTest:
    """Result of a rate test.

    Attributes
    ----------
    factor : float
        Speed of the run over that of the test.
    finished : bool
        Whether the test was computed to its end; figures are given only then.
    effect : bool or None
        Whether anything depends on the speed by so much that it matters; None where undecided.
    verdict : str
        The same in words.
    quasi_static_friction, quasi_static_friction_error : float
        Friction coefficient extrapolated linearly to zero speed, and its standard error.
    intervals : int
        Output intervals compared, after the transient.
    start, end : float
        Sliding distances between which they lie [m].
    quantities : tuple of Comparison
        Friction coefficient, solid fraction where it is recorded, shares of the states.
    """

    factor: float
    finished: bool = False
    effect: bool | None = None
    verdict: str = ""
    quasi_static_friction: float = NAN
    quasi_static_friction_error: float = NAN
    intervals: int = 0
    start: float = NAN
    end: float = NAN
    quantities: tuple[Comparison, ...] = ()

    def to_dict(self) -> dict[str, Any]:
        """Return the fields by name, the quantities by theirs."""
        return asdict(self) | {"quantities": {entry.name: asdict(entry) for entry in self.quantities}}

    def __str__(self) -> str:
        """Return verdict and extrapolation in one line."""
        if not math.isfinite(self.quasi_static_friction_error):
            return self.verdict
        still = with_error(self.quasi_static_friction, self.quasi_static_friction_error)
        return f"{self.verdict}; extrapolated to zero speed {still}"


def rate_test_of(run: Run) -> RateTest | None:
    """Return the result of the rate test of a run, None where its scene has none."""
    factor = _factor(run)
    if factor is None:
        return None
    path = run.path.parent / RATE_TEST / FILE_NAME
    if not run.frames or not path.is_file():
        why = f"no rate test beside this run ({RATE_TEST}/{FILE_NAME}): not finished, or a copy without it"
        return RateTest(factor, verdict=why)
    with open_run(path) as test:
        if test.scene_text != run.scene_text or not test.frames or not test.summary()["finished"]:
            return RateTest(factor, verdict="the rate test is not finished: resume the run")
        return compare(run, test, factor)


def _factor(run: Run) -> float | None:
    """Return the factor on the speed that the scene of a run asks for; None without a rate test, and for the test itself."""
    if "rate_test" in run.header:
        return None
    try:
        return tomllib.loads(run.scene_text).get("solver", {}).get("rate_test")
    except tomllib.TOMLDecodeError:
        return None


def matched_frames(run: Run, test: Run, factor: float) -> tuple[np.ndarray, np.ndarray]:
    """Return frames of a run and of its rate test with the plate at the same places, after the changeover, (n,) each."""
    start = test.times[0]
    first = int(np.searchsorted(run.times, start))
    fast, slow = np.arange(first + 1, run.frames), np.arange(1, test.frames)
    if not len(fast) or not len(slow):
        return fast[:0], slow[:0]
    # the nearest frame at the same place; they differ in number only where an explicit step passes several outputs
    nearest = np.rint(np.interp(start + (test.times[slow] - start) / factor, run.times[fast], fast)).astype(int)
    nearest, first_of_each = np.unique(nearest, return_index=True)
    return nearest, slow[first_of_each]


def rate_series(run: Run) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return sliding distance [m], friction coefficient and that of the finished rate test at the same places, (n,) each."""
    factor = _factor(run)
    assert factor is not None
    with open_run(run.path.parent / RATE_TEST / FILE_NAME) as test:
        fast, slow = matched_frames(run, test, factor)
        name = "friction_coefficient"
        strokes = run.drag.stroke  # of the whole run: its last third may be less than a stroke
        return run.series["distance"][fast], _series(run, name, fast, strokes), _series(test, name, slow, strokes)


def compare(run: Run, test: Run, factor: float) -> RateTest:
    """Return the result of a finished rate test: `run` at its speed, `test` at a speed smaller by a factor."""
    fast, slow = matched_frames(run, test, factor)
    skipped = math.ceil(TRANSIENT * len(fast) - 1e-9)
    fast, slow = fast[skipped:], slow[skipped:]
    if len(fast) < ENOUGH:
        return RateTest(factor, True, verdict="undecided: too few output intervals in the last third to compare")
    strokes = run.drag.stroke
    visible = 1.0 - 1.0 / factor  # fraction of the change to zero speed that appears at the lower one
    compared = [
        _compared(name, words, visible * matters, (_series(run, name, fast, strokes), _series(test, name, slow, strokes)))
        for name, words, matters in _quantities(run)
    ]
    mu = [_series(part, "friction_coefficient", frames, strokes) for part, frames in ((run, fast), (test, slow))]
    still = mean_and_margin((factor * mu[1] - mu[0]) / (factor - 1.0))
    effect, verdict = verdict_of(compared, _drift(mu[1] - mu[0]), f"v/{factor:g}")
    distance = run.series["distance"]
    ends = float(distance[fast[0] - 1]), float(distance[fast[-1]])
    return RateTest(factor, True, effect, verdict, still.value, still.error, len(fast), *ends, tuple(compared))


def _quantities(run: Run) -> list[tuple[str, str, float]]:
    """Return series, words and the change to zero speed that matters, of what is compared."""
    known = [("friction_coefficient", "friction", FRICTION), ("solid_fraction", "solid fraction", SOLID_FRACTION)]
    known += [(f"fraction_{state}", f"share {state}", LABELS) for state in run.state_names]
    return [entry for entry in known if entry[0] in run.series]


def _series(run: Run, name: str, frames: np.ndarray, strokes: bool) -> np.ndarray:
    """Return a series at some frames; of the friction coefficient of strokes its size."""
    values = np.asarray(run.series[name], float)[frames]
    return np.abs(values) if name == "friction_coefficient" and strokes else values


def _compared(name: str, words: str, matters: float, both: tuple[np.ndarray, np.ndarray]) -> Comparison:
    (fast, slow), change = (mean_and_margin(values) for values in both), mean_and_margin(both[1] - both[0])
    return Comparison(
        name, words, fast.value, fast.error, slow.value, slow.error, *change, matters, effect_of(change, matters)
    )  # fmt: skip


def effect_of(change: Mean, matters: float) -> bool | None:
    """Return whether a change is significant and matters, None where its margin is wider than what matters."""
    if abs(change.value) > max(change.margin, matters):
        return True
    return False if change.margin <= matters else None


def _drift(difference: np.ndarray) -> tuple[float, float]:
    """Return the change of a difference over the stretch compared by a linear fit, and its margin at 99 %."""
    return change_and_error(difference[np.isfinite(difference)])


def verdict_of(compared: list[Comparison], drift: tuple[float, float], slow: str) -> tuple[bool | None, str]:
    """Return whether there is a rate effect, None where undecided, and that in words.

    `drift`: of the difference in friction, with its margin; `slow`: the lower speed in words.
    """
    friction, others = compared[0], compared[1:]
    effects = [entry for entry in compared if entry.effect]
    if effects:
        at_v = f" ({with_error(friction.fast, friction.fast_error)} at v)" if friction.effect else f"; {_both(friction, slow)}"
        return True, f"rate effect: {'; '.join(entry.text for entry in effects)} at {slow}{at_v}"
    if abs(drift[0]) > max(drift[1], 2.0 * friction.matters):
        size = f"{drift[0]:+.3f}".replace("-", MINUS)
        return None, f"undecided: the difference in friction still changes by {size} over the stretch compared: run longer"
    if friction.effect is None:
        return None, (
            f"undecided: {friction.text} at {slow}, with a margin of {friction.margin:.2g}, and {friction.matters:.2g} would "
            f"matter: a run about {friction.longer:.2g} times as long would decide"
        )
    unclear = [entry.words for entry in others if entry.effect is None]
    open_end = f"; undecided: {', '.join(unclear)}" if unclear else ""
    if friction.significant:
        small = [entry for entry in others if entry.significant and entry.effect is False]
        texts = "; ".join(entry.text for entry in [friction, *small])
        return False, f"no rate effect that matters: {texts} at {slow}{open_end}"
    return False, f"no rate effect: {_both(friction, slow)}{open_end}"


def _both(friction: Comparison, slow: str) -> str:
    """Return friction at both speeds in words, and how many standard errors lie between."""
    fast, slower = with_error(friction.fast, friction.fast_error), with_error(friction.slow, friction.slow_error)
    sigma = abs(friction.change) / friction.change_error if friction.change_error > 0.0 else 0.0
    return f"friction {fast} at v, {slower} at {slow} ({sigma:.1f} sigma)"
