"""Mean and standard error of a correlated series, its change over time, and its running mean."""

import numpy as np

WINDOW = 5.0
"""Autocorrelations are summed up to the first lag beyond WINDOW times the current autocorrelation time."""

MIN_SAMPLES = 8
"""Least number of independent values for which an error is reported: with fewer its estimate is unreliable."""


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
        return float("nan"), float("nan")
    mean = float(values.mean())
    deviations = values - mean
    variance = float(deviations @ deviations) / n
    if n < MIN_SAMPLES:
        return mean, float("nan")
    if variance <= (1e-13 * abs(mean)) ** 2:  # constant but for rounding
        return mean, 0.0
    tau, window = _autocorrelation_time(deviations, variance)
    tau *= 1.0 + (2.0 * window + 1.0) / n
    return mean, float(np.sqrt(2.0 * tau * variance / n)) if n >= 2.0 * tau * MIN_SAMPLES else float("nan")


def _autocorrelation_time(deviations: np.ndarray, variance: float) -> tuple[float, int]:
    """Return the integrated autocorrelation time of deviations from their mean, at least 1/2, and its window [samples]."""
    n = len(deviations)
    size = 1 << (2 * n - 1).bit_length()  # zero padding against circular correlation
    spectrum = np.abs(np.fft.rfft(deviations, size)) ** 2
    covariance = np.fft.irfft(spectrum, size)[:n] / np.arange(n, 0, -1)
    times = np.cumsum(covariance / variance) - 0.5
    beyond = np.flatnonzero(np.arange(n) >= WINDOW * times)
    window = int(beyond[0]) if len(beyond) else n - 1
    return max(float(times[window]), 0.5), window


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
    tau = 0.5
    if n >= MIN_SAMPLES:
        tau, window = _autocorrelation_time(deviations, squares / n)
        tau *= 1.0 + (2.0 * window + 1.0) / n
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
