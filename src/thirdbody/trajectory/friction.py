"""Friction coefficient of a run, its error and whether it is stationary: the single source for all outputs."""

import math
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from thirdbody.trajectory.names import CYCLES
from thirdbody.trajectory.plate_motion import Drag
from thirdbody.trajectory.reader import Run
from thirdbody.trajectory.statistics import MIN_SAMPLES, change_and_error, mean_and_error
from thirdbody.units import GLUE, MINUS, percent, quantity_text, with_error

SMALL_CHANGE, SMALL = 0.01, 1e-3
"""A change by less than SMALL_CHANGE of the coefficient, or by less than SMALL, counts as stationary."""

UNCLEAR = 0.1
"""Error of the change, relative to the mean, above which stationarity is undecided."""

FEWEST = 4
"""Least number of values for a linear fit."""

NAN = float("nan")


@dataclass(frozen=True)
class Friction:
    """Friction coefficient of a run.

    Attributes
    ----------
    value : float
        For one-way sliding the mean of -(upper_force . e)/|normal force| over the output intervals of the second half of the
        sliding distance; for strokes the mean of |T|/N over the last whole cycle. On a path that is no straight line the force
        counts along the velocity. NaN where there is none.
    error : float
        Standard error of that mean, corrected for autocorrelation; for strokes the standard deviation between cycles. NaN with
        fewer than eight independent values.
    low, high : float
        Extremes of the averaged values.
    change, change_error : float
        Change over the second half by a linear fit (for two or three cycles: first to last), and its half width at 99 %
        confidence.
    stationary : bool or None
        None where undecided.
    verdict : str
        The same in words.
    cycles : int
        Whole cycles of a stroke, 0 for one-way sliding.
    energy_per_cycle : float
        Work of the friction force over the last cycle, along both axes [J].
    """

    value: float = NAN
    error: float = NAN
    low: float = NAN
    high: float = NAN
    change: float = NAN
    change_error: float = NAN
    stationary: bool | None = None
    verdict: str = ""
    cycles: int = 0
    energy_per_cycle: float = NAN

    def to_dict(self) -> dict[str, Any]:
        """Return the fields by name."""
        return asdict(self)

    @property
    def text(self) -> str:
        """Value with error, for strokes with its definition: `0.158 ± 0.003`."""
        if not math.isfinite(self.value):
            return self.verdict
        if not self.cycles:
            return with_error(self.value, self.error) + self._range()
        energy = quantity_text(self.energy_per_cycle, "J").replace(GLUE, " ")
        return f"{with_error(self.value, self.error)} (mean size over the last cycle, {energy} per cycle)"

    @property
    def short_text(self) -> str:
        """Value and error alone: `0.158 ± 0.003`."""
        return with_error(self.value, self.error) if math.isfinite(self.value) else "unknown"

    @property
    def short_verdict(self) -> str:
        """`stationary`, `still rising by 4 % over the second half`, or that it is undecided."""
        if self.stationary is None:
            return "stationary or not: unknown"
        return "stationary" if self.stationary else self.verdict

    def __str__(self) -> str:
        """Return value, error and verdict in one line."""
        return f"{self.text}; {self.verdict}" if math.isfinite(self.value) else self.verdict

    def _range(self) -> str:
        """Return the extremes as text where no error can be given."""
        if math.isfinite(self.error):
            return ""
        why = "" if self.stationary is False else "; too few independent values for an error"
        return f" ({self.low:z.3f} to {self.high:z.3f}{why})".replace("-", MINUS)


def friction_of(run: Run) -> Friction:
    """Return the friction coefficient of a run."""
    drag, mu = run.drag, run.series.get("friction_coefficient")
    if mu is None or not drag.dragged:
        return Friction(verdict="no sliding")
    if not np.isfinite(mu).any():
        return Friction(verdict="unloaded")
    return _of_strokes(run, drag, mu) if drag.stroke else _of_sliding(drag, mu)


def averaged(run: Run) -> np.ndarray:
    """Return the frames (F,), bool, whose intervals enter the mean of one-way sliding: loaded ones of the second half."""
    mu = run.series.get("friction_coefficient", np.full(run.frames, NAN))
    return run.drag.second_half & np.isfinite(mu)


def _of_sliding(drag: Drag, mu: np.ndarray) -> Friction:
    values = mu[drag.second_half & np.isfinite(mu)]
    if not len(values):
        return Friction(verdict="unloaded over the second half")
    mean, error = mean_and_error(values)
    change, margin = change_and_error(values) if len(values) >= FEWEST else (NAN, NAN)
    stationary, verdict = _verdict(mean, change, margin, "over the second half")
    return Friction(mean, error, float(values.min()), float(values.max()), change, margin, stationary, verdict)


def _of_strokes(run: Run, drag: Drag, mu: np.ndarray) -> Friction:
    cycles = friction_cycles(run)
    sizes = cycles["friction_coefficient"]
    if not len(sizes) or not math.isfinite(sizes[-1]):
        return Friction(verdict="unloaded over the last cycle" if len(sizes) else "no whole cycle yet", cycles=len(sizes))
    late = sizes[min(len(sizes) // 2, max(len(sizes) - 2, 0)) :]
    late = late[np.isfinite(late)]
    change, margin = change_and_error(late) if len(late) >= FEWEST else (late[-1] - late[0] if len(late) > 1 else NAN, 0.0)
    over = "over the second half" if len(late) >= FEWEST else f"over the last {len(late)} cycles"
    stationary, verdict = _verdict(float(late.mean()), change, margin, over)
    if len(late) < 2:
        verdict = "only one whole cycle: whether it is stationary is unknown"
    error = float(late.std(ddof=1)) if len(late) >= MIN_SAMPLES else NAN
    return Friction(
        float(sizes[-1]), error, float(late.min()), float(late.max()), float(change), margin, stationary, verdict, len(sizes),
        float(cycles["energy"][-1]),
    )  # fmt: skip


def _verdict(mean: float, change: float, margin: float, over: str) -> tuple[bool | None, str]:
    """Return whether a coefficient is stationary, None where undecided, and that in words."""
    if not math.isfinite(change):
        return None, "too few output intervals to tell whether it is stationary"
    small = max(SMALL_CHANGE * abs(mean), SMALL)
    if abs(change) > max(margin, small):
        return False, f"still {'rising' if change > 0.0 else 'falling'} by {_size(abs(change), mean)} {over}"
    if margin > max(UNCLEAR * abs(mean), SMALL):
        return None, f"stationary or not: its scatter hides changes of up to {_size(margin, mean)} {over}"
    if abs(change) > small:
        return True, f"stationary within its scatter: changes by {_size(abs(change), mean)} {over}"
    return True, f"stationary: changes by {_size(abs(change), mean)} {over}"


def _size(change: float, mean: float) -> str:
    """Return a change in percent of the mean, a number where the mean is nearly zero; below SMALL only that."""
    if abs(mean) <= 10.0 * SMALL:
        return f"{change:.2g}" if change >= SMALL else f"less than {SMALL:g}"
    fraction = percent(max(change / abs(mean), SMALL)).replace(GLUE, " ")
    return fraction if change >= SMALL * abs(mean) else f"less than {fraction}"


def friction_cycles(run: Run) -> dict[str, np.ndarray]:
    """Return the whole cycles of a stroke by the names of CYCLES, one value each (n,); n is 0 without a stroke."""
    drag, frames = run.drag, run.frames
    mu = run.series.get("friction_coefficient", np.full(frames, NAN))
    force = _friction_force(run, mu)
    work = np.diff(run.series["drag_work"], prepend=np.nan) if "drag_work" in run.series else force * drag.steps
    columns: dict[str, list[float]] = {name: [] for name in CYCLES}
    for number, cycle in enumerate(drag.cycles):
        inside = slice(cycle.start + 1, cycle.stop)  # the interval that ends at the first frame belongs to the previous cycle
        energy = float(np.sum(work[inside]))
        row = [number + 1, run.times[cycle.start], run.times[cycle.stop - 1], energy, _known(np.mean, np.abs(mu[inside]))]
        for values in (mu[inside], force[inside], drag.displacement[cycle]):
            row += _extremes(values)
        for name, value in zip(columns, row, strict=True):
            columns[name].append(value)
    return {name: np.array(values, np.int64 if name == "cycle" else float) for name, values in columns.items()}


def _friction_force(run: Run, mu: np.ndarray) -> np.ndarray:
    """Return the friction force (F,) [N] on the upper plate against its first direction of motion, mean per output interval; on a
    path that is no straight line against its velocity, mean along the path.

    The series holds the coefficient, which is that force over the normal one; an unloaded interval has none.
    """
    if "upper_force" not in run.series:
        return np.full(run.frames, NAN)
    return np.nan_to_num(mu) * np.abs(force_on_plate(run)[:, 2])


def force_on_plate(run: Run) -> np.ndarray:
    """Return the mean force (F, 3) [N] of debris and direct contact on the upper plate in each output interval."""
    return run.series["upper_force"] + run.series.get("direct_force", 0.0)


def _extremes(values: np.ndarray) -> tuple[float, float]:
    return _known(np.min, values), _known(np.max, values)


def _known(figure: Any, values: np.ndarray) -> float:
    """Return a figure of the finite values, NaN without any."""
    values = values[np.isfinite(values)]
    return float(figure(values)) if len(values) else NAN
