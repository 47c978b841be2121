"""Friction coefficient of a run, its error and whether it is stationary; statistics of correlated series."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from thirdbody.trajectory.drag import Drag
from thirdbody.trajectory.names import CYCLES
from thirdbody.trajectory.run_arrays import RunArrays
from thirdbody.units import GLUE, MINUS, percent, with_error, with_unit

SMALL_CHANGE, SMALL = 0.01, 1e-3
"""A change by less than SMALL_CHANGE of the coefficient, or by less than SMALL, counts as stationary."""

UNCLEAR = 0.1
"""Error of the change, relative to the mean, above which stationarity is undecided."""

FEWEST = 4
"""Least number of values for a linear fit."""

WINDOW = 5.0
"""Autocorrelations are summed up to the first lag beyond WINDOW times the current autocorrelation time."""

MIN_SAMPLES = 8
"""Least number of independent values for which an error is reported: with fewer its estimate is unreliable."""

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

    @property
    def text(self) -> str:
        """Value with error, for strokes with its definition: `0.158 ± 0.003`."""
        if not math.isfinite(self.value):
            return self.verdict
        if not self.cycles:
            if math.isfinite(self.error):
                return with_error(self.value, self.error)
            why = "" if self.stationary is False else "; too few independent values for an error"
            return with_error(self.value, self.error) + f" ({self.low:z.3f} to {self.high:z.3f}{why})".replace("-", MINUS)
        energy = with_unit(self.energy_per_cycle, "J")
        return f"{with_error(self.value, self.error)} (mean size over the last cycle, {energy} per cycle)"

    @property
    def short_text(self) -> str:
        """Value and error alone: `0.158 ± 0.003`."""
        return with_error(self.value, self.error) if math.isfinite(self.value) else "unknown"

    def __str__(self) -> str:
        """Return value, error and verdict in one line."""
        return f"{self.text}; {self.verdict}" if math.isfinite(self.value) else self.verdict


def friction_of(drag: Drag) -> Friction:
    """Return the friction coefficient of a run."""
    mu = drag.run.series.get("friction_coefficient")
    if mu is None or not drag.dragged:
        return Friction(verdict="no sliding")
    if not np.isfinite(mu).any():
        return Friction(verdict="unloaded")
    if drag.stroke:
        return _of_strokes(drag)
    values = mu[drag.averaged]
    if not len(values):
        return Friction(verdict="unloaded over the second half")
    mean, error = mean_and_error(values)
    change, margin = change_and_error(values) if len(values) >= FEWEST else (NAN, NAN)
    stationary, verdict = _verdict(mean, change, margin, "over the second half")
    return Friction(mean, error, float(values.min()), float(values.max()), change, margin, stationary, verdict)


def _of_strokes(drag: Drag) -> Friction:
    cycles = friction_cycles(drag)
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


def friction_cycles(drag: Drag) -> dict[str, np.ndarray]:
    """Return the whole cycles of a stroke by the names of CYCLES, one value each (n,); n is 0 without a stroke."""
    run = drag.run
    mu = run.series.get("friction_coefficient", np.full(run.frames, NAN))
    force = np.full(run.frames, NAN)
    if "upper_force" in run.series:
        # The friction force on the plate against its first direction of motion, on a path that is no straight line against its
        # velocity, mean per interval: the coefficient is that force over the normal one, and an unloaded interval has none.
        force = np.nan_to_num(mu) * np.abs(force_on_plate(run)[:, 2])
    work = np.diff(run.series["drag_work"], prepend=np.nan) if "drag_work" in run.series else force * drag.steps
    rows = []
    for number, cycle in enumerate(drag.cycles):
        inside = slice(cycle.start + 1, cycle.stop)  # the interval that ends at the first frame belongs to the previous cycle
        energy = float(np.sum(work[inside]))
        row = [number + 1, run.times[cycle.start], run.times[cycle.stop - 1], energy, _known(np.mean, np.abs(mu[inside]))]
        for values in (mu[inside], force[inside], drag.displacement[cycle]):
            row += [_known(np.min, values), _known(np.max, values)]
        rows.append(row)
    columns = zip(CYCLES, np.array(rows, float).reshape(-1, len(CYCLES)).T, strict=True)
    return {name: values.astype(np.int64) if name == "cycle" else values for name, values in columns}


def force_on_plate(run: RunArrays) -> np.ndarray:
    """Return the mean force (F, 3) [N] of debris and direct contact on the upper plate in each output interval."""
    return run.series["upper_force"] + run.series.get("direct_force", 0.0)


def _known(figure: Any, values: np.ndarray) -> float:
    values = values[np.isfinite(values)]
    return float(figure(values)) if len(values) else NAN


def mean_and_error(values: np.ndarray) -> tuple[float, float]:
    """Return the mean of a stationary series (n,) and the standard error of that mean, in the unit of the series.

    Successive values are correlated, so the error is sqrt(2 tau s^2/n) with the integrated autocorrelation time tau = 1/2 + sum
    rho(k), summed to a self-consistent window W = 5 tau (Madras and Sokal 1988, J. Stat. Phys. 50, 109, appendix C). The factor 1
    + (2 W + 1)/n corrects the bias due to the estimated mean (Wolff 2004, Comput. Phys. Commun. 156, 143); anticorrelation is not
    credited (tau >= 1/2). Non-finite values are ignored. The mean is NaN without values; the error is NaN with fewer than
    MIN_SAMPLES independent values.
    """
    values = values[np.isfinite(values)]
    n = len(values)
    if not n:
        return NAN, NAN
    mean = float(values.mean())
    deviations = values - mean
    variance = float(deviations @ deviations) / n
    if n < MIN_SAMPLES:
        return mean, NAN
    if variance <= (1e-13 * abs(mean)) ** 2:  # constant but for rounding
        return mean, 0.0
    tau = _autocorrelation_time(deviations, variance)
    return mean, float(np.sqrt(2.0 * tau * variance / n)) if n >= 2.0 * tau * MIN_SAMPLES else NAN


def _autocorrelation_time(deviations: np.ndarray, variance: float) -> float:
    # integrated, of deviations from their mean, at least 1/2, and without the bias due to that mean [samples]
    n = len(deviations)
    size = 1 << (2 * n - 1).bit_length()  # zero padding against circular correlation
    spectrum = np.abs(np.fft.rfft(deviations, size)) ** 2
    covariance = np.fft.irfft(spectrum, size)[:n] / np.arange(n, 0, -1)
    times = np.cumsum(covariance / variance) - 0.5
    beyond = np.flatnonzero(np.arange(n) >= WINDOW * times)
    window = int(beyond[0]) if len(beyond) else n - 1
    return max(float(times[window]), 0.5) * (1.0 + (2.0 * window + 1.0) / n)


def change_and_error(values: np.ndarray) -> tuple[float, float]:
    """Return the change of a series (n,), n >= 4, over its length by a linear fit, and its half width at 99 %.

    Least squares with Student's t; residuals are correlated, so their number is divided by 2 tau, tau as in `mean_and_error`.
    Of fewer than MIN_SAMPLES values tau cannot be estimated: they count as independent, as those of cycles nearly are.
    """
    from scipy.special import stdtrit

    n = len(values)
    x = np.linspace(-0.5, 0.5, n)
    slope = float(x @ values) / float(x @ x)
    deviations = values - values.mean() - slope * x
    squares = float(deviations @ deviations)
    if squares <= n * (1e-13 * float(np.abs(values).max())) ** 2:  # a straight line but for rounding
        return slope, 0.0
    tau = _autocorrelation_time(deviations, squares / n) if n >= MIN_SAMPLES else 0.5
    freedom = max(n / (2.0 * tau) - 2.0, 1.0)
    error = float(np.sqrt(2.0 * tau * squares / ((n - 2) * float(x @ x))))
    return slope, float(stdtrit(freedom, 0.995)) * error


def running_mean(values: np.ndarray, width: int) -> np.ndarray:
    """Return the mean (n,) over the `width` values around each one, fewer at the ends; NaN are ignored, NaN without values."""
    known = np.isfinite(values)
    sums = np.concatenate([[0.0], np.cumsum(np.where(known, values, 0.0))])
    counts = np.concatenate([[0], np.cumsum(known)])
    index = np.arange(len(values))
    low, high = np.maximum(index - (width - 1) // 2, 0), np.minimum(index + width // 2 + 1, len(values))
    number = counts[high] - counts[low]
    return np.divide(sums[high] - sums[low], number, out=np.full(len(values), np.nan), where=number > 0)
