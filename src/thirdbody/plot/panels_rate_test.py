"""Panel of the rate test: friction over the last third, at the speed of the run and at the lower one."""

import numpy as np
from matplotlib.axes import Axes

from thirdbody.palette import LINE_COLORS as LINES
from thirdbody.plot.panels_friction import MU
from thirdbody.plot.run_data import RunData
from thirdbody.quantity import scale_values, with_error
from thirdbody.trajectory.rate_test import RateTest, rate_series

RATE_NOTE = (
    "Rate test: the last third of the run, computed again from the same state with a slower plate. Means and errors leave out the"
    " transient after the change of speed (grey)."
)


def why_no_rate_test(data: RunData) -> str:
    """Return why there is no rate test to draw, empty if there is one."""
    result = data.run.rate_test
    if result is None:
        return "the scene asks for none (solver.rate_test)"
    return "" if result.quantities else result.verdict


def rate_title(data: RunData) -> str:
    """Return the verdict in words, without its figures."""
    result = _result(data)
    words = {True: "depends on the speed", False: "no rate effect", None: "undecided"}[result.effect]
    return f"Rate test at v/{result.factor:g}: {words}"


def _result(data: RunData) -> RateTest:
    assert data.run.rate_test is not None  # `why_no_rate_test`
    return data.run.rate_test


def draw_rate_test(axes: Axes, data: RunData) -> None:
    """Draw the friction of the output intervals at both speeds, their means with errors, and the extrapolation."""
    result = _result(data)
    distance, fast, slow = rate_series(data.run)
    x, unit = scale_values(distance, "m")
    scale = x[-1] / distance[-1]
    ends = np.array([result.start, result.end]) * scale
    friction = result.quantities[0]
    means = ((fast, friction.fast, friction.fast_error), (slow, friction.slow, friction.slow_error))
    for (values, mean, error), color, name in zip(means, ("blue", "vermilion"), ("v", f"v/{result.factor:g}"), strict=True):
        axes.plot(x, values, color=LINES[color], linewidth=0.9, marker=".", markersize=3.5, label=f"at {name}")
        axes.plot(
            ends, [mean, mean], color=LINES[color], linewidth=1.4, linestyle=(0, (5, 2)), label=f"mean: {with_error(mean, error)}"
        )
        if np.isfinite(error):
            axes.fill_between(ends, mean - error, mean + error, color=LINES[color], alpha=0.2, linewidth=0.0)
    still, error = result.quasi_static_friction, result.quasi_static_friction_error
    axes.errorbar([x[-1]], [still], yerr=[error] if np.isfinite(error) else None, fmt="D", color=LINES["black"], markersize=4.0,
                  capsize=2.5, clip_on=False, label="extrapolated to\nzero speed")  # fmt: skip
    axes.axvspan(x[0], ends[0], color="#DDDFE3", linewidth=0.0, zorder=0)
    axes.set_xlabel(f"sliding distance ({unit})")
    axes.set_ylabel(MU)
