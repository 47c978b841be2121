"""Comparison of a run with another one of the same scene: friction, load or gap, positions, labels, energy."""

import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

Array = np.ndarray


@dataclass(frozen=True)
class Outcome:
    """Compared quantities of a run of F frames of its drag and B bodies, in SI.

    `friction`, `normal` [N], `gap` [m], all (F,); `states` (F, B) or None; at the end `position` (B, 3), `quaternion` (B, 4; w
    first), `dissipated` [J], `distance` [m] and `residual`, the relative energy residual. `period` (2,) holds the sides of a
    periodic domain, infinite for another; `gap_set`: the scene prescribes the gap, so the load is a result.
    """

    friction: Array
    normal: Array
    gap: Array
    states: Array | None
    position: Array
    quaternion: Array
    dissipated: float
    distance: float
    residual: float | None
    period: Array
    gap_set: bool = False


def read_outcome(folder: Path) -> Outcome | None:
    """Return the outcome of a run; None when it wrote no frame. Raises InputError for a file that is not a run."""
    from thirdbody.trajectory.run_file import RunFile

    with RunFile(folder) as run:
        if not run.frames:
            return None
        series, bodies, domain = run.series, run.bodies(-1), run.header["domain"]
        size, drag = np.array(domain["size"], float), run.drag.during
        spent = [series[name][-1] for name in ("energy_damping", "energy_friction") if name in series]
        return Outcome(
            friction=series["friction_coefficient"][drag],
            normal=np.abs(series["upper_force"][drag, 2]),
            gap=series["gap"][drag],
            states=run.states[drag] if run.has_states else None,
            position=bodies["position"],
            quaternion=bodies["quaternion"],
            dissipated=float(sum(spent)),
            distance=float(series["distance"][-1]),
            residual=run.summary().get("energy_residual"),
            period=size if domain["periodic"] else np.full(2, np.inf),
            gap_set="gap" in tomllib.loads(run.scene_text).get("plates", {}).get("upper", {}),
        )


def errors(result: Outcome, reference: Outcome) -> dict[str, float]:
    """Return the errors of a run against a reference, over the frames that both have. NaN without data.

    `friction_error` and `load_error` (of the load where the gap is set, else of the gap) are the root mean square over the
    frames, divided by the mean size of the reference; `position_error` is divided by the sliding distance (by the gap without
    one), `rotation_error` in rad; both are medians over the bodies whose labels at the end agree, since a body that tips the
    other way carries no information on accuracy. `label_difference`: fraction of all labels, frame by frame. `dissipation_error`
    is relative. Where bodies meet, small differences grow, and only means can be compared: `mean_friction_error` over the frames,
    relative; `mean_position_error` over the bodies, divided as `position_error`; `state_fraction_error`: the least fraction of
    all labels that would have to change to make the share of each state equal.
    """
    path = reference.distance if reference.distance > 0.0 else float(np.nanmean(reference.gap))
    same = np.ones(len(reference.position), bool)
    if result.states is not None and reference.states is not None:
        same = result.states[-1] == reference.states[-1]
    moved = result.position - reference.position
    with np.errstate(invalid="ignore"):
        wraps = np.where(np.isinf(reference.period), 0.0, np.round(moved[:, :2] / reference.period))
    moved[:, :2] -= np.where(wraps == 0.0, 0.0, wraps * np.where(np.isinf(reference.period), 0.0, reference.period))
    load = (result.normal, reference.normal) if reference.gap_set else (result.gap, reference.gap)
    return {
        "friction_error": rms_error(result.friction, reference.friction),
        "load_error": rms_error(*load),
        "position_error": _median(np.linalg.norm(moved, axis=1)[same]) / path,
        "rotation_error": _median(rotation_angles(result.quaternion, reference.quaternion)[same]),
        "label_difference": label_difference(result.states, reference.states),
        "dissipation_error": abs(result.dissipated - spent) / abs(spent) if (spent := reference.dissipated) else float("nan"),
        "mean_friction_error": rms_error(result.friction, reference.friction, of_means=True),
        "mean_position_error": float(np.linalg.norm(moved.mean(axis=0))) / path,
        "state_fraction_error": fraction_difference(result.states, reference.states),
    }


def rms_error(result: Array, reference: Array, of_means: bool = False) -> float:
    """Return the root mean square difference over the mean size of the reference, over common frames with finite values.

    `of_means`: the difference of the means instead. NaN without any.
    """
    frames = min(len(result), len(reference))
    known = np.isfinite(result[:frames]) & np.isfinite(reference[:frames])
    a, b = result[:frames][known], reference[:frames][known]
    size = float(np.mean(np.abs(b))) if len(b) else 0.0
    change = abs(float(np.mean(a - b))) if of_means and len(b) else float(np.sqrt(np.mean((a - b) ** 2))) if len(b) else 0.0
    return change / size if size > 0.0 else float("nan")


def rotation_angles(first: Array, second: Array) -> Array:
    """Return the angles (B,) [rad] between orientations (B, 4); also exact for small ones, where arccos loses half its digits."""
    w = np.abs(np.sum(first * second, axis=1))
    cross = np.cross(second[:, 1:], first[:, 1:])
    v = second[:, :1] * first[:, 1:] - first[:, :1] * second[:, 1:] - cross
    return 2.0 * np.arctan2(np.linalg.norm(v, axis=1), w)


def label_difference(result: Array | None, reference: Array | None) -> float:
    """Return the fraction of labels (F, B) that differ; NaN without labels."""
    if result is None or reference is None:
        return float("nan")
    frames = min(len(result), len(reference))
    return float(np.mean(result[:frames] != reference[:frames])) if frames else float("nan")


def fraction_difference(result: Array | None, reference: Array | None) -> float:
    """Return half the sum of the differences of the shares that the states have of all labels (F, B); NaN without labels."""
    if result is None or reference is None:
        return float("nan")
    frames = min(len(result), len(reference))
    a, b = (np.bincount(labels[:frames].ravel().astype(int), minlength=256) for labels in (result, reference))
    return 0.5 * float(np.abs(a / max(a.sum(), 1) - b / max(b.sum(), 1)).sum()) if frames else float("nan")


def _median(values: Array) -> float:
    return float(np.median(values)) if len(values) else float("nan")


def order(sizes: Any, values: Any) -> float:
    """Return the order of convergence: slope of log(error) over log(step) by least squares; NaN with fewer than two errors."""
    h, e = np.asarray(sizes, float), np.asarray(values, float)
    known = np.isfinite(e) & (e > 0.0)
    if known.sum() < 2:
        return float("nan")
    return float(np.polyfit(np.log(h[known]), np.log(e[known]), 1)[0])
