"""Summary of a run: what it stored at its end, and figures computed from its frames."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from thirdbody.trajectory.accommodation_fractions import accommodation_fractions
from thirdbody.trajectory.bed_verdict import bed_figures, bed_warning
from thirdbody.trajectory.energy_check import energy_verdict
from thirdbody.trajectory.state_groups import states_by_group

if TYPE_CHECKING:
    from thirdbody.trajectory.reader import Run


ROLLING = 0.02
"""Fraction of rolling bodies above which a warning says that inertia decides where they come to rest."""


def run_summary(run: Run, stored: dict[str, Any] | None) -> dict[str, Any]:
    """Return the figures of a run with what it stored at its end, None for a run that did not get there (`Run.summary`)."""
    report = figures(run) | {"finished": stored is not None} | (stored or {})
    rolling = run.series.get("fraction_rolling", ())
    if report.get("patches_not_carried") is not None and len(rolling):
        report["largest_fraction_rolling"] = float(np.max(rolling))
    verdict = energy_verdict(report, str(run.header.get("scene_text", "")))
    report |= {} if verdict is None else {"energy_verdict": verdict}
    at_end = verdict, bed_warning(run.bed) if run.frames else None, _rolling_warning(report)
    return report | {"warnings": [*run.header.get("warnings", []), *report.get("warnings", []), *filter(None, at_end)]}


def _rolling_warning(report: dict[str, Any]) -> str | None:
    rolling = report.get("largest_fraction_rolling", 0.0)
    return None if rolling <= ROLLING else (
        f"up to {100.0 * rolling:.0f} % of the bodies rolled or tipped at once, without inertia: where a body that tips "
        "comes to rest depends on its momentum, so some may end in another seat than with inertia, and the friction of "
        "few bodies may differ by some per cent"
    )  # fmt: skip


def figures(run: Run) -> dict[str, Any]:
    """Return the figures that the frames of a run give."""
    if not run.frames:
        return {"frames": 0}
    series = run.series
    result: dict[str, Any] = {"frames": run.frames, "bodies": run.scene_bodies}
    if run.rows("clumps", 0) < run.scene_bodies:
        result["bodies_in_file"] = run.rows("clumps", 0)
    result["duration"] = float(run.times[-1] - run.times[0])
    if "distance" in series:
        result["distance"] = float(series["distance"][-1])
    if "scene_time" in series:
        result["speed_scale"] = run.header.get("speed_scale")
        result["scene_time"] = float(series["scene_time"][-1])
    if "friction_coefficient" in series:
        friction = run.friction
        result["friction_coefficient"] = friction.value
        result["friction_coefficient_error"] = friction.error
        result["friction_verdict"] = friction.verdict
        if run.drag.stroke:
            result |= {"cycles": friction.cycles, "energy_per_cycle": friction.energy_per_cycle}
    result |= {name: _late_mean(run, name) for name in ("active", "load_share_debris") if name in series}
    if portions := accommodation_fractions(run):
        result["accommodation"] = portions
    if run.bed is not None:
        result |= bed_figures(run.bed)
    if run.has_states and result["bodies"]:
        result["fractions"] = _last_fractions(run)
        result |= {f"{kind}s": rows for kind, rows in states_by_group(run).items()}
    return result


def state_counts(run: Run) -> dict[str, np.ndarray]:
    """Return the number of bodies of the scene in each state, (F,) each."""
    if run.rows("clumps", 0) == run.scene_bodies:
        return {name: np.count_nonzero(run.states == code, axis=1) for code, name in enumerate(run.state_names)}
    return {name: np.rint(run.series[f"fraction_{name}"] * run.scene_bodies).astype(np.int64) for name in run.state_names}


def _last_fractions(run: Run) -> dict[str, float]:
    """Return the fraction of the bodies of the scene in each state at the last frame; no other frame is read."""
    if run.rows("clumps", 0) < run.scene_bodies:
        return {name: float(run.series[f"fraction_{name}"][-1]) for name in run.state_names}
    counts = np.bincount(run.bodies(-1)["state"], minlength=len(run.state_names))
    return dict(zip(run.state_names, (counts / counts.sum()).tolist(), strict=False))


def _late_mean(run: Run, name: str) -> float:
    """Return the mean of a series over the second half of the sliding, its last value where nothing slides."""
    values = run.series[name]
    frames = run.drag.second_half & np.isfinite(values)
    return float(values[frames].mean() if frames.any() else values[-1])
