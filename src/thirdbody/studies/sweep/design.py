"""Designs of a sweep: from axes to the values of each point."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from typing import Any

from thirdbody.studies.sweep.axes import Axis

SAMPLED = ("sobol", "latin_hypercube")
DESIGNS = ("grid", "zip", *SAMPLED)
"""All combinations; the values side by side; low-discrepancy or stratified samples of the space of the axes."""

MAX_POINTS = 1_000_000
"""Largest number of points of a sweep: each is a file at least."""

Settings = dict[str, Any]
"""Values by key, as `Scene.with_settings` takes them."""


def design_fault(design: str, axes: Sequence[Axis], samples: int | None) -> str:
    """Return what a design lacks, in words; empty for a sound one."""
    if design in SAMPLED:
        if samples is None:
            return f"samples: required key is missing: the number of points of design = '{design}'"
        if design == "sobol" and samples & (samples - 1):
            lower = 1 << (samples.bit_length() - 1)
            return f"samples: Sobol points come in powers of two, such as {lower} or {2 * lower}, got {samples}"
        count = samples
    else:
        if samples is not None:
            return f"samples: only {' and '.join(SAMPLED)} designs have samples; the counts of a {design} give its points"
        lengths = {axis[0].key: axis[0].count or 0 for axis in axes}
        if design == "zip" and len(set(lengths.values())) > 1:
            listed = ", ".join(f"{key} {count}" for key, count in lengths.items())
            return f"design: 'zip' takes the values side by side, and their numbers differ: {listed}"
        count = 1
        for length in lengths.values() if design == "grid" else list(lengths.values())[:1]:
            count *= length
    return f"design: {count} points, at most {MAX_POINTS} are computed" if count > MAX_POINTS else ""


def settings_of_points(design: str, axes: Sequence[Axis], samples: int | None, seed: int) -> list[Settings]:
    """Return the settings of all points of a sound design, the last axis running fastest."""
    if design in SAMPLED:
        return [_sampled(axes, row) for row in _fractions(design, len(axes), samples or 0, seed)]
    lists = [[column.listed() for column in axis] for axis in axes]
    indices = [range(len(columns[0])) for columns in lists]
    rows: Any = product(*indices) if design == "grid" else zip(*indices, strict=True)
    return [
        {
            column.key: values[index]
            for axis, columns, index in zip(axes, lists, row, strict=True)
            for column, values in zip(axis, columns, strict=True)
        }
        for row in rows
    ]


def _sampled(axes: Sequence[Axis], row: Sequence[float]) -> Settings:
    return {column.key: column.at(fraction) for axis, fraction in zip(axes, row, strict=True) for column in axis}


def _fractions(design: str, dimensions: int, samples: int, seed: int) -> list[list[float]]:
    """Return points of the unit cube, (samples, dimensions)."""
    import numpy as np
    from scipy.stats import qmc

    generator = np.random.default_rng(seed)
    if design == "sobol":
        engine: qmc.QMCEngine = qmc.Sobol(dimensions, scramble=True, seed=generator)
    else:
        engine = qmc.LatinHypercube(dimensions, seed=generator)
    rows: list[list[float]] = engine.random(samples).tolist()
    return rows
