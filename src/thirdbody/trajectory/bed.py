"""Means over the steady part of a run and verdicts in words: whether a bed was sheared slowly and is stiff, and what took up the
motion of the plate (`accommodation`)."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from thirdbody.granular_flow import FAST, SLOW, inertia_verdict
from thirdbody.trajectory.drag import Drag
from thirdbody.trajectory.friction import mean_and_error
from thirdbody.trajectory.names import ACCOMMODATION, BED
from thirdbody.units import MINUS, percent, quantity_text

STIFF, SOFT = 1e4, 1e3
"""Softness above which bodies count as rigid, and below which friction and solid fraction depend on the pressure."""

WORDS = {"upper_slip": "slip at the upper plate", "lower_slip": "slip at the lower plate", "rolling": "rolling", "shear": "shear"}
"""The parts of the plate's speed in words, in the order of ACCOMMODATION."""

SMALL = 0.005
"""A smaller fraction is not named."""


@dataclass(frozen=True)
class Bed:
    """Measures of a bed over the steady part of a run.

    Attributes
    ----------
    means, errors : dict of str to float
        Mean of each measure over the output intervals that friction averages, for strokes over whole cycles of the second half,
        without drag over the second half after settling; its standard error, corrected for autocorrelation, NaN with fewer than
        eight independent values.
    quasi_static : bool or None
        Whether the inertial number is at most 1e-3; None where it is not known.
    verdict, softness_verdict : str
        Whether it was sheared slowly, and whether its bodies are stiff, in words; empty for a layer.
    """

    means: Mapping[str, float] = field(default_factory=dict)
    errors: Mapping[str, float] = field(default_factory=dict)
    quasi_static: bool | None = None
    verdict: str = ""
    softness_verdict: str = ""

    def text(self, name: str) -> str:
        """Return mean and error of a measure: `0.021 ± 0.001`."""
        value, error = quantity_text(self.means[name], "", 2), self.errors[name]
        return f"{value} \N{PLUS-MINUS SIGN} {quantity_text(error, '', 1)}" if math.isfinite(error) else value


def bed_of(drag: Drag) -> Bed | None:
    """Return the measures of the bed of a run; None for a run without one."""
    series = drag.run.series
    if any(name not in series for name in BED) or not drag.frames:
        return None
    rows = {name: mean_and_error(series[name][drag.steady]) for name in BED}
    means, errors = ({name: row[k] for name, row in rows.items()} for k in (0, 1))
    number = means["inertial_number"]
    if not math.isfinite(number):
        return Bed(means, errors)
    return Bed(
        means, errors, number <= SLOW, inertia_verdict(number), softness_verdict(means["softness"], means["overlap_ratio"])
    )


def softness_verdict(softness: float, overlap: float) -> str:
    """Return whether bodies of this softness and mean overlap over radius are stiff, in words."""
    size = f"kappa = {quantity_text(softness, '', 2)}, overlaps {quantity_text(100.0 * overlap, '', 2)} % of the radius"
    if softness >= STIFF:
        return f"stiff: {size}"
    if softness >= SOFT:
        return f"fairly stiff: {size}"
    return f"soft: {size}; friction and solid fraction depend on the pressure"


def bed_figures(bed: Bed) -> dict[str, object]:
    """Return the entries of a run's summary about its bed."""
    figures: dict[str, object] = {}
    for name in BED:
        figures |= {name: bed.means[name], f"{name}_error": bed.errors[name]}
    return figures | {"quasi_static": bed.quasi_static, "bed_verdict": bed.verdict, "softness_verdict": bed.softness_verdict}


def bed_rows(bed: Bed | None) -> list[tuple[str, str]]:
    """Return the lines of the table that ends a run about its bed: name and text; none for a layer."""
    if bed is None or not bed.verdict:
        return []
    others = ("solid_fraction", "coordination_number", "unbalanced_force", "kinetic_energy_ratio")
    words = {"kinetic_energy_ratio": "kinetic over elastic energy"}
    values = ", ".join(f"{words.get(name, name.replace('_', ' '))} {bed.text(name)}" for name in others)
    largest = quantity_text(bed.means["inertial_number_largest"], "", 2)
    number = f"{bed.text('inertial_number')} (with the largest diameter {largest}); {bed.verdict}"
    return [("inertial number", number), ("softness", bed.softness_verdict), ("bed", values)]


def bed_warning(bed: Bed | None) -> str | None:
    """Return a warning of a bed that was sheared too fast; None for others."""
    if bed is None or not bed.means["inertial_number"] > FAST:
        return None
    return (
        f"the bed is {bed.verdict} (as in glass beads); a slower motion of the plate, or solver.inertial_number = {SLOW:g}, "
        "gives the friction of slow shear"
    )


def accommodation_fractions(drag: Drag) -> dict[str, float] | None:
    """Return the fraction of each part in the plate's path by the keys of WORDS; their sum is 1. None without load or drag.

    Over the steady part of the run. Parts count along the motion of the plate in their output interval, so a part can be negative
    where debris moves against it.
    """
    series = drag.run.series
    if any(name not in series for name in ACCOMMODATION) or not drag.dragged:
        return None
    parts = np.array([series[name] for name in ACCOMMODATION])
    along = np.sign(drag.steps) * drag.durations
    frames = drag.steady & np.isfinite(parts).all(axis=0)
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
