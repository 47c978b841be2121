"""Fractions of the plate's path that slip, rolling and shear take up over the drag of a run."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from thirdbody.trajectory.bed_verdict import steady
from thirdbody.trajectory.names import ACCOMMODATION
from thirdbody.units import MINUS, percent

if TYPE_CHECKING:
    from thirdbody.trajectory.reader import Run

WORDS = {"upper_slip": "slip at the upper plate", "lower_slip": "slip at the lower plate", "rolling": "rolling", "shear": "shear"}
"""The parts of the plate's speed in words, in the order of ACCOMMODATION."""

SMALL = 0.005
"""A smaller fraction is not named."""


def accommodation_fractions(run: Run) -> dict[str, float] | None:
    """Return the fraction of each part in the plate's path by the keys of WORDS; their sum is 1. None without load or drag.

    Over the steady part of the run (`bed_verdict.steady`). Parts count along the motion of the plate in their
    output interval, so a part can be negative where debris moves against it.
    """
    if any(name not in run.series for name in ACCOMMODATION) or not run.drag.dragged:
        return None
    parts = np.array([run.series[name] for name in ACCOMMODATION])
    along = np.sign(run.drag.steps) * run.drag.durations
    frames = steady(run) & np.isfinite(parts).all(axis=0)
    paths = parts[:, frames] @ along[frames]
    total = float(paths.sum())
    return dict(zip(WORDS, (paths / total).tolist(), strict=True)) if total > 0.0 else None


def accommodation_text(fractions: dict[str, float]) -> str:
    """Return fractions in words, the largest first: `96 % rolling, 4 % slip at the upper plate`."""
    return _in_words({WORDS[name]: fraction for name, fraction in fractions.items()})


def short_accommodation_text(fractions: dict[str, float]) -> str:
    """Return the same with the slip at both plates as one: `96 % rolling, 4 % slip`."""
    slip = fractions["upper_slip"] + fractions["lower_slip"]
    return _in_words({"slip": slip, "rolling": fractions["rolling"], "shear": fractions["shear"]})


def _in_words(fractions: dict[str, float]) -> str:
    named = sorted(fractions.items(), key=lambda entry: -abs(entry[1]))
    return ", ".join(f"{percent(fraction)} {word}" for word, fraction in named if abs(fraction) >= SMALL).replace("-", MINUS)
