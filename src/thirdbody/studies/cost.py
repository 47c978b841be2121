"""Cost of accuracy: errors of runs of a scene against the finest of its variants, their front, and the recommended one."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from thirdbody.errors import UsageError
from thirdbody.studies.timing import LONE, Timing, slower, timing
from thirdbody.studies.variants import Variant

if TYPE_CHECKING:
    from thirdbody.trajectory.run_file import RunFile

GOOD, SAME = 0.01, 0.01  # friction error and fraction of changed labels that a recommended variant may have
# Least gain of time for which another variant is recommended than one that is preferred: a second study finds the same.
GAIN = 0.25

ERRORS = ("friction_error", "load_error", "position_error", "rotation_error", "label_difference", "dissipation_error",
          "mean_friction_error", "mean_position_error", "state_fraction_error")  # fmt: skip

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

    @property
    def path(self) -> float:
        """What places are divided by [m]: the sliding distance, without one the mean gap."""
        return self.distance if self.distance > 0.0 else float(np.mean(self.gap[np.isfinite(self.gap)]))


def read_outcome(folder: Path) -> Outcome | None:
    """Return the outcome of a run; None when it wrote no frame. Raises InputError for a file that is not a run."""
    from thirdbody.trajectory.run_file import RunFile

    with RunFile(folder) as run:
        return outcome_at(run, np.flatnonzero(run.drag.during)) if run.frames else None


def outcome_at(run: RunFile, frames: Array) -> Outcome:
    """Return the outcome of a run at these of its frames (F,), that is until the last of them; without any until its end."""
    series, domain, last = run.series, run.header.get("domain", {}), int(frames[-1]) if len(frames) else -1
    bodies = run.bodies(last)
    spent = [series[name][last] for name in ("energy_damping", "energy_friction") if name in series]
    unknown = np.full((run.frames, 3), np.nan)
    return Outcome(
        friction=series.get("friction_coefficient", unknown[:, 0])[frames],
        normal=np.abs(series.get("upper_force", unknown)[frames, 2]),
        gap=series.get("gap", unknown[:, 0])[frames],
        states=run.states[frames] if run.has_states else None,
        position=bodies["position"],
        quaternion=bodies.get("quaternion", np.full((len(bodies["position"]), 4), np.nan)),
        dissipated=float(sum(spent)),
        distance=float(run.drag.distance[last]),
        residual=run.drag.stored.get("energy_residual"),
        period=np.array(domain["size"], float) if domain.get("periodic") else np.full(2, np.inf),
        gap_set="gap" in run.scene_tables.get("plates", {}).get("upper", {}),
    )


def errors(result: Outcome, reference: Outcome, same_bodies: bool = True) -> dict[str, float]:
    """Return the errors of a run against a reference, over the frames that both have. NaN without data.

    `friction_error` and `load_error` (of the load where the gap is set, else of the gap) are the root mean square over the
    frames, divided by the mean size of the reference; `position_error` is divided by the sliding distance (by the gap without
    one), `rotation_error` in rad; both are medians over the bodies whose labels at the end agree, since a body that tips the
    other way carries no information on accuracy. `label_difference`: fraction of all labels, frame by frame. `dissipation_error`
    is relative. Where bodies meet, small differences grow, and only means can be compared: `mean_friction_error` over the frames,
    relative; `mean_position_error` over the bodies, divided as `position_error`; `state_fraction_error`: the least fraction of
    all labels that would have to change to make the share of each state equal. What compares bodies one by one is NaN where they
    are not the same.
    """
    unknown = np.full((1, 3), np.nan)
    moved = displacements(result.position, reference.position, reference.period) if same_bodies else unknown
    angles = rotation_angles(result.quaternion, reference.quaternion) if same_bodies else unknown[:, 0]
    same, changed, moved_fractions = np.ones(len(moved), bool), math.nan, math.nan
    if result.states is not None and reference.states is not None:
        frames = min(len(result.states), len(reference.states))
        labels = result.states[:frames], reference.states[:frames]
        if frames:
            parts = [np.bincount(some.ravel().astype(int), minlength=256) / max(some.size, 1) for some in labels]
            moved_fractions = 0.5 * float(np.abs(parts[0] - parts[1]).sum())
        if frames and same_bodies:
            same, changed = result.states[-1] == reference.states[-1], float(np.mean(labels[0] != labels[1]))
    load = (result.normal, reference.normal) if reference.gap_set else (result.gap, reference.gap)
    return {
        "friction_error": rms_error(result.friction, reference.friction),
        "load_error": rms_error(*load),
        "position_error": _median(np.linalg.norm(moved, axis=1)[same]) / reference.path,
        "rotation_error": _median(angles[same]),
        "label_difference": changed,
        "dissipation_error": abs(result.dissipated - spent) / abs(spent) if (spent := reference.dissipated) else float("nan"),
        "mean_friction_error": rms_error(result.friction, reference.friction, of_means=True),
        "mean_position_error": float(np.linalg.norm(moved.mean(axis=0))) / reference.path,
        "state_fraction_error": moved_fractions,
    }


def displacements(result: Array, reference: Array, period: Array) -> Array:
    """Return by how much the positions (B, 3) [m] of one run differ from those of another, across the sides of the domain."""
    moved = result - reference
    # 0 * infinity is no number, hence the finite factor of a side without period
    moved[:, :2] -= np.round(moved[:, :2] / period) * np.where(np.isinf(period), 0.0, period)
    return moved


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


def _median(values: Array) -> float:
    return float(np.median(values)) if len(values) else float("nan")


def order(sizes: Any, values: Any) -> float:
    """Return the order of convergence: slope of log(error) over log(step) by least squares; NaN with fewer than two errors."""
    h, e = np.asarray(sizes, float), np.asarray(values, float)
    known = np.isfinite(e) & (e > 0.0)
    return float(np.polyfit(np.log(h[known]), np.log(e[known]), 1)[0]) if known.sum() > 1 else float("nan")


@dataclass(eq=False)
class Row:
    """Result of one variant.

    `wall`, `cpu`: seconds of its repeats; `outcome`: None for a variant without result; `beside`: seconds of the scene's own
    variant, timed alternately with it; `single`: relative uncertainty of one timing.
    """

    variant: Variant
    wall: list[float] = field(default_factory=list)
    cpu: list[float] = field(default_factory=list)
    stable: bool = False
    message: str = ""
    integrator: str = ""
    step: float | None = None
    outcome: Outcome | None = None
    errors: dict[str, float] = field(default_factory=dict)
    beside: list[float] = field(default_factory=list)
    single: float = LONE

    @property
    def timing(self) -> Timing:
        """Cost of the variant [s of the processor], with its uncertainty."""
        return timing(self.cpu, self.single)

    @property
    def seconds(self) -> float:
        """Cost of the variant: median of the processor seconds over the repeats, NaN without any."""
        return self.timing.seconds


@dataclass
class Study:
    """Completed study, with the scene that was computed.

    `scatter`: largest errors of runs against each other whose starts differ by 1e-9, empty where bodies do not meet: smaller
    errors mean nothing; `budget`, `elapsed`: of the whole study [s].
    """

    scene: str
    title: str
    reduction: list[str]
    machine: dict[str, Any]
    rows: list[Row]
    scatter: Mapping[str, float] = field(default_factory=dict)
    budget: float = math.nan
    elapsed: float = math.nan

    @property
    def default(self) -> Row | None:
        """Variant with the settings of the scene itself."""
        return next((row for row in self.rows if row.variant.default), None)

    @property
    def reference(self) -> Row:
        """Reference of the errors: the finest variant that finished."""
        return next(row for row in reversed(self.rows) if row.variant.reference)


def compute_errors(built: Study) -> None:
    """Compute the errors of all rows against the reference, and the scatter.

    Where the finest variant did not finish, the reference is the finest one that did: the finest law in short steps, else with
    the scene's own step. Raises UsageError where none did.
    """
    rows = built.rows
    if not rows[-1].stable:
        done = [row for row in rows if row.stable]
        whole = [row for row in done if row.variant.axis == "fine" and row.variant.factor < 1.0]
        whole = whole or [row for row in done if row.variant.axis == "law"]
        if whole and whole[-1].variant.default:
            whole += [row for row in done if row.variant.axis == "step" and row.variant.factor < 1.0]
        if not whole:
            raise UsageError(f"no variant of {built.scene} finished: {rows[0].message or rows[-1].message}")
        for row in rows:
            row.variant = replace(row.variant, reference=row is whole[-1])
    reference = built.reference.outcome
    assert reference is not None  # a stable run has frames
    for row in rows:
        if row.outcome is not None:
            row.errors = errors(row.outcome, reference)
    same = [row.outcome for row in rows if (row.variant.default or row.variant.axis == "nudged") and row.stable]
    pairs = [errors(a, b) for a, b in itertools.combinations([outcome for outcome in same if outcome is not None], 2)]
    built.scatter = {name: max(pair[name] for pair in pairs) for name in ERRORS} if pairs else {}


def is_chaotic(built: Study) -> bool:
    """Return whether runs whose starts differ by 1e-9 part further than a recommended variant may be wrong."""
    return built.scatter.get("friction_error", 0.0) > GOOD or built.scatter.get("label_difference", 0.0) > SAME


def figure_of_merit(built: Study) -> str:
    """Return the error on the axis of the front: friction, or the load (gap) of a scene without a drag.

    Where runs part, that of the mean friction.
    """
    if not any(math.isfinite(row.errors.get("friction_error", math.nan)) for row in built.rows if row.stable):
        return "load_error"
    return "mean_friction_error" if is_chaotic(built) else "friction_error"


def merit_in_words(built: Study) -> str:
    """Return the name of `figure_of_merit` in sentences."""
    return {"friction_error": "friction", "mean_friction_error": "mean friction", "load_error": "load"}[figure_of_merit(built)]


def significant_error(built: Study, row: Row, merit: str) -> float:
    """Return an error of a variant, at least the scatter of runs from starts 1e-9 apart: smaller ones are equal.

    With a faster plate it is at least that of the scene's own speed: a smaller one is chance, as errors cancel.
    """
    own = built.default if row.variant.speed > 1.0 else None
    return max(row.errors[merit], built.scatter.get(merit, 0.0), own.errors.get(merit, 0.0) if own is not None else 0.0)


def efficient(built: Study) -> list[Row]:
    """Return the Pareto front: variants than which no other one is closer in the same or less time, or as close in less.

    The reference, whose error is zero by definition, is the last.
    """
    merit = figure_of_merit(built)
    rows = [row for row in built.rows if row.stable and is_choice(row) and math.isfinite(row.errors[merit])]

    def beaten(row: Row, other: Row) -> bool:
        """Return whether another variant is closer and not slower, or as close and faster."""
        error, better = significant_error(built, row, merit), significant_error(built, other, merit)
        if better == error:
            return (other.seconds, id(other)) < (row.seconds, id(row))
        return better < error and other.seconds <= row.seconds

    others = [row for row in rows if row is not built.reference]
    saved = [row for row in rows if row is built.reference or not any(beaten(row, other) for other in others)]
    return sorted(saved, key=lambda row: (row is built.reference, row.seconds))


def is_choice(row: Row) -> bool:
    """Return whether a variant may be recommended: those that only measure an error are not."""
    return row.variant.axis not in ("nudged", "meeting") and row.variant.speed >= 1.0


def speed_error(built: Study) -> tuple[float, float]:
    """Return what the scene's own speed costs in accuracy: the lowest speed over it, and the error against that variant.

    In friction, or in the load (`figure_of_merit`), with the same law and step; NaN without such a variant.
    """
    own, slow = built.default, [row for row in built.rows if row.stable and row.variant.speed < 1.0]
    slowest = min(slow, key=lambda row: row.variant.speed, default=None)
    if own is None or slowest is None or own.outcome is None or slowest.outcome is None:
        return math.nan, math.nan
    return slowest.variant.speed, errors(own.outcome, slowest.outcome)[figure_of_merit(built)]


def recommended(built: Study) -> tuple[Row, str]:
    """Return the recommended variant, and the reason in words.

    The fastest of those whose friction is right to 1 % and that change at most 1 % of the labels, else of the most accurate ones,
    whose errors differ by less than a quarter.
    Times within their spread, or that differ by less than a quarter, are equal: of such variants the scene's own is
    preferred, else the most accurate one; errors below 0.1 % are equal. Where runs from starts 1e-9 apart differ by more than
    1 %, the mean friction and the shares of the states decide, and errors below that scatter are equal. A run whose bodies do not
    meet is reported separately.
    """
    merit, default = figure_of_merit(built), built.default
    choices = [row for row in built.rows if row.stable and is_choice(row) and not row.variant.reference]
    close = [row for row in choices if significant_error(built, row, merit) <= max(GOOD, built.scatter.get(merit, 0.0))]
    labels = "state_fraction_error" if is_chaotic(built) else "label_difference"
    limit = max(SAME, built.scatter.get(labels, 0.0))
    good = [row for row in close if not row.errors[labels] > limit]
    smallest = min((significant_error(built, row, merit) for row in choices), default=0.0)
    nearest = [row for row in choices if significant_error(built, row, merit) <= (1.0 + GAIN) * smallest]
    equal = good or [row for row in nearest if not row.errors[labels] > limit] or nearest
    first = min(equal, key=lambda row: row.seconds + row.timing.half, default=built.reference)
    ties = [row for row in equal if not slower(row.timing, first.timing) or row.seconds <= (1.0 + GAIN) * first.seconds]
    # errors far below those that matter are equal: which of them is the smallest changes from study to study
    best = min(ties or [built.reference], key=lambda row: (max(significant_error(built, row, merit), 0.1 * GOOD), row.seconds))
    row = default if default is not None and default in ties else best
    own = ", the variant of the scene," if row is default else ""
    words = [f"`{row.variant.name}`{own} gives {percent(row.errors[merit])} {merit_in_words(built)} error"]
    if default is not None and default.stable and default is not row:
        same, ratio = "the same cost, within the spread, as", f"{row.seconds / default.seconds:.2g} times the cost of"
        cost = same if _same_time(row, default) else ratio
        words.append(f" at {cost} `{default.variant.name}` ({percent(default.errors[merit])})")
    words.append(_of_labels(built, row))
    words += _why_not_the_fastest(built, row, close, good)
    names = [f"`{other.variant.name}`" for other in ties if other is not row and _same_time(other, row)]
    if good and names:
        words.append(f"; {', '.join(names)} take{'s' if len(names) == 1 else ''} the same time within the spread")
    if not good:
        words.append(f"; no variant is within 1 % of `{built.reference.variant.name}` in {merit_in_words(built)} and labels")
    alone = next((other for other in built.rows if other.variant.axis == "meeting" and other.stable), None)
    if alone is not None and default is not None and default.stable:
        words.append(f"; without contact between bodies (contact.debris_contact = \"none\") {merit_in_words(built)} is off by "
                     f"{percent(alone.errors[merit])}, in {alone.seconds / default.seconds:.2g} times the time of "
                     f"`{default.variant.name}`{_of_labels(built, alone)}")  # fmt: skip
    return row, "".join(words)


def _why_not_the_fastest(built: Study, row: Row, close: Sequence[Row], good: Sequence[Row]) -> Iterator[str]:
    """Yield why the fastest variant whose friction is right is not the recommended one, unless they take the same time."""
    first = min(close, key=lambda other: other.seconds, default=row)
    if first is row or (first in good and _same_time(first, row)):
        return
    faster = f"; `{first.variant.name}` is faster, {first.seconds / row.seconds:.2g} times the time, and as right in "
    faster += merit_in_words(built)
    if first not in good:
        yield f"{faster}, but not in the states of the bodies{_of_labels(built, first).replace(';', ':', 1)}"
    else:
        why = "`{}` is the scene's own" if row is built.default else "`{}` is more accurate"
        yield f"{faster}, but by less than a quarter, and {why.format(row.variant.name)}"


def _same_time(a: Row, b: Row) -> bool:
    return not slower(a.timing, b.timing) and not slower(b.timing, a.timing)


def _of_labels(built: Study, row: Row) -> str:
    labels, apart = row.errors["label_difference"], built.scatter.get("label_difference", 0.0)
    if math.isnan(labels):
        return ""
    if labels == 0.0:
        return "; no label changes"
    return f"; {percent(labels)} of the labels differ" + (f" ({percent(apart)} from starts 1e-9 apart)" if apart > 0.0 else "")


def percent(fraction: float) -> str:
    """Return a fraction in per cent, two digits."""
    return f"{100.0 * fraction:.2g} %"
