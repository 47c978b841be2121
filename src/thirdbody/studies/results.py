"""Results of a run that a sweep can put into its table: names, units, meanings, and how each is computed."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from thirdbody.errors import nearest
from thirdbody.trajectory.names import BED, SERIES

if TYPE_CHECKING:
    from thirdbody.trajectory.run_file import RunFile as Run

# Beginnings of the names of results with a state: `fraction_rolling`, `fraction_ever_rolling`.
FRACTION, EVER = "fraction_", "fraction_ever_"

Stored = Mapping[str, Any]

STATES = "fractions"  # short name of the fractions of all states

DEFAULT = ("friction_coefficient", "friction_coefficient_error", STATES, "fraction_ever_rolling", "load", "energy_residual",
           "wall_time")  # fmt: skip

# Columns of a table that differ from computation to computation; all others have the same bits.
TIMES = ("seconds", "wall_time", "integration_time")


class Result(NamedTuple):
    """A result: its unit ("1" for a pure number), its meaning, and its value for an open run and the summary that it stored."""

    unit: str
    meaning: str
    value: Callable[[Run, Stored], float]


def _load(run: Run, _stored: Stored) -> float:
    """Return the mean load over the frames that the friction coefficient averages [N]."""
    force, frames = run.series["upper_force"][:, 2], run.drag.averaged
    return float(force[frames].mean()) if frames.any() else float(force[-1])


def _stored_value(name: str) -> Callable[[Run, Stored], float]:
    return lambda _run, stored: math.nan if stored.get(name) is None else float(stored[name])


def _last(name: str) -> Callable[[Run, Stored], float]:
    return lambda run, _stored: float(run.series[name][-1]) if name in run.series else math.nan


def _bed(name: str) -> Callable[[Run, Stored], float]:
    return lambda run, _stored: math.nan if run.bed is None else run.bed.means[name]


_SERIES = {
    name: Result(entry.unit, f"Last frame: {entry.meaning}", _last(name))
    for name, entry in SERIES.items()
    if name not in ("upper_force", "lower_force", "direct_force", *BED)
} | {name: Result("1", f"Mean over the steady part: {SERIES[name].meaning}", _bed(name)) for name in BED}

RESULTS: dict[str, Result] = _SERIES | {
    "friction_coefficient": Result("1", "Mean over the second half of the sliding, for strokes over the last cycle.",
                                   lambda run, _: run.friction.value),
    "friction_coefficient_error": Result("1", "Its standard error.", lambda run, _: run.friction.error),
    "load": Result("N", "Normal force of the debris on the upper plate, mean over the frames of `friction_coefficient`.", _load),
    "load_ratio": Result("1", "Force on the upper plate over its load, last output interval.", _stored_value("load_ratio")),
    "energy_residual": Result("1", "Residual of the energy balance, relative.", _stored_value("energy_residual")),
    "energy_numerical_share": Result("1", "Loss by the implicit integrator, relative.", _stored_value("energy_numerical_share")),
    "energy_per_cycle": Result("J", "Work of the sideways motion over the last cycle of strokes.",
                               lambda run, _: run.friction.energy_per_cycle),
    "peak_pressure": Result("Pa", "Largest pressure over contacts and frames, elastic.", _stored_value("peak_pressure")),
    "bodies": Result("1", "Number of bodies.", _stored_value("bodies")),
    "frames": Result("1", "Number of frames.", _stored_value("frames")),
    "steps": Result("1", "Number of steps.", _stored_value("steps")),
    "wall_time": Result("s", "Wall time of the run, without building its scene.", _stored_value("wall_time")),
    "integration_time": Result("s", "Processor time of the steps alone, without frames.", _stored_value("integration_time")),
}  # fmt: skip
"""All results but those of states, by name."""


def result(name: str) -> Result:
    """Return the result of this name, which `unknown` accepts."""
    if name in RESULTS:
        return RESULTS[name]
    if name.startswith(EVER):
        state = name.removeprefix(EVER)
        meaning = f"Fraction of the bodies that are {state} in at least one frame of the drag."
        return Result("1", meaning, lambda run, _: _ever(run, state))
    state = name.removeprefix(FRACTION)
    return Result("1", f"Last frame: fraction of the bodies that are {state}.", _last(name))


def _ever(run: Run, state: str) -> float:
    if not run.has_states or state not in run.state_names:
        return math.nan
    return float(np.mean((run.states[run.drag.during] == run.state_names.index(state)).any(axis=0)))


def with_states(names: Iterable[str], states: Sequence[str]) -> tuple[str, ...]:
    """Return the names with `fractions` written out for each state."""
    listed = [[f"{FRACTION}{state}" for state in states] if name == STATES else [name] for name in names]
    return tuple(dict.fromkeys(name for names in listed for name in names))


def unknown(name: str, states: Iterable[str]) -> str:
    """Return why no result has this name; an empty text for one that exists."""
    known = [*RESULTS, STATES, *(beginning + state for state in states for beginning in (FRACTION, EVER))]
    return "" if name in known else f"'{name}' is no result, {nearest(name, known)}"


def results_of(run: Run, stored: Stored, names: Iterable[str]) -> dict[str, float]:
    """Return the results of an open run, and of the summary that it stored, by name."""
    return {name: float(result(name).value(run, stored)) for name in names}
