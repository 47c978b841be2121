"""What accuracy costs in time: a ladder of rungs for one scene, each in a process of its own, against the finest of them."""

from __future__ import annotations

import json
import math
import statistics
import subprocess
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from thirdbody.errors import OutputError, UsageError
from thirdbody.scene import units
from thirdbody.scene.model import File, Mesh, Scene

from .compare import Outcome, errors, front, read_outcome
from .ladder import Base, Rung, ladder, springs_option
from .worker import SHORT

if TYPE_CHECKING:
    from thirdbody.scene.build import Simulation

LIMIT = 90.0
"""Seconds of one core after which one run of a rung is given up, and shown as such."""

REPEATS = 3
SCENE_FILE, JSON_FILE, PICTURE, RUNGS = "scene.toml", "cost.json", "cost.png", "rungs"

GOOD, SAME = 0.01, 0.01
"""Friction error and share of changed labels that a recommended rung may have."""

Tell = Callable[[str], None]


@dataclass
class Row:
    """One rung as it came out. `wall`, `cpu`: seconds of its repeats; `outcome`: None for a rung that gave nothing; `place`: the
    folder of its run, beside those of the other rungs; `beside`: seconds of the scene's own rung, in turns with it."""

    rung: Rung
    wall: list[float] = field(default_factory=list)
    cpu: list[float] = field(default_factory=list)
    stable: bool = False
    message: str = ""
    integrator: str = ""
    step: float | None = None
    outcome: Outcome | None = None
    errors: dict[str, float] = field(default_factory=dict)
    place: str = ""
    beside: list[float] = field(default_factory=list)

    @property
    def seconds(self) -> float:
        """What the rung costs: median of the processor's seconds over the repeats, NaN without any."""
        return statistics.median(self.cpu) if self.cpu else math.nan

    @property
    def wall_seconds(self) -> float:
        """Median of the wall's seconds over the repeats, NaN without any."""
        return statistics.median(self.wall) if self.wall else math.nan


@dataclass
class Study:
    """A ladder that was climbed, with the scene that it was climbed with."""

    scene: str
    title: str
    reduction: list[str]
    machine: dict[str, Any]
    rows: list[Row]

    @property
    def default(self) -> Row | None:
        """What the scene itself asks for."""
        return next((row for row in self.rows if row.rung.default), None)

    @property
    def reference(self) -> Row:
        """What errors are against: the finest rung that came to its end."""
        return next(row for row in reversed(self.rows) if row.rung.reference)


def study(
    path: Path, folder: Path, settings: Mapping[str, Any] | None = None, plugins: Sequence[str | Path] = (),
    repeats: int = REPEATS, tell: Tell = lambda text: None, verify: bool = False,
) -> Study:  # fmt: skip
    """Climb the ladder of a scene file; runs are left in `folder`/rungs. Raises ThirdbodyError for a scene that cannot be built.

    Errors are against the last rung, or, where that one failed, against the slowest other one that came to its end.
    """
    from .machine import machine

    if repeats < 2:
        raise UsageError(f"--repeats {repeats}: at least 2, or nothing tells how much times spread")
    scene = Scene.load(path)
    scene = scene.with_settings(settings) if settings else scene
    tell("building the scene and estimating its time")
    scene, built, reduction = reduced(scene, plugins)
    base = base_of(scene, built, plugins)
    _save(scene, folder)
    if base.kind == "explicit" and isinstance(scene.solver.time_step, str):
        tell("a run with an automatic time step")
        base = replace(base, step=_smallest_step(folder, plugins, base.step))
        reduction.append(f"the time step held at {units.pretty(base.step, 'time')}, the smallest that `auto` takes")
    rungs = ladder(scene, built.choice.family, base, verify)
    own = next((rung.changes for rung in rungs if rung.default), None) if _estimate(built) < SHORT else None
    rows = []
    for number, rung in enumerate(rungs, 1):
        tell(f"rung {number} of {len(rungs)}: {rung.name}")
        times = 1 if rung.axis == "verify" else repeats  # of those nothing is timed
        rows.append(climb(folder, rung, f"{number:02d}_{_slug(rung.name)}", plugins, times, own))
        tell(f"  {rows[-1].seconds:.3g} s" if rows[-1].stable else f"  {rows[-1].message}")
    _one_pace(rows)
    made = Study(str(path), scene.title, reduction, machine(), rows)
    judge(made)
    return made


def reduced(scene: Scene, plugins: Sequence[str | Path]) -> tuple[Scene, Simulation, list[str]]:
    """The scene, or a smaller copy of it whose ladder ends within minutes; the simulation of it; what was reduced."""
    from thirdbody.simulate import prepare, set_threads

    from .reduce import shortened, thinned

    set_threads(1)
    built, told = prepare(scene, plugins), []
    for step in ("thin", "shorten"):
        seconds = _estimate(built)
        changes, words = thinned(scene, built.state.n_bodies, seconds) if step == "thin" else shortened(built, seconds)
        if changes:
            told += words
            scene = scene.with_settings(changes)
            built = prepare(scene, plugins)
    return scene, built, told


def _estimate(built: Simulation) -> float:
    """Seconds of one core that a run would take, from a trial; infinite where a guard stops it."""
    from thirdbody.check import check_report

    wall, cpu = time.perf_counter(), time.process_time()
    told = check_report(built)["estimated_wall_time"]
    # what other processes took from the trial does not count
    busy = min(1.0, (time.process_time() - cpu) / max(time.perf_counter() - wall, 1e-9))
    return math.inf if math.isnan(told) else told * busy


def base_of(scene: Scene, built: Simulation, plugins: Sequence[str | Path]) -> Base:
    """What the scene itself says: its law and springs, its integrator, and the steps of both."""
    from thirdbody.engine.implicit import Accuracy
    from thirdbody.scene.tables import IMPLICIT_KEYS
    from thirdbody.simulate import prepare

    option = springs_option(built.choice.family, built.choice.level)
    springs = None if option is None else int(scene.contact.options.get("springs", option))
    explicit = built
    if built.plan.kind == "implicit":
        other = {"solver.integrator": "explicit", **{f"solver.{key}": None for key in IMPLICIT_KEYS}}
        explicit = prepare(scene.with_settings(other), plugins, force=True)
    tolerance = scene.solver.tolerance or Accuracy().tolerance
    return Base(built.plan.kind, built.choice.level, springs, explicit.state.dt, tolerance)


def _smallest_step(folder: Path, plugins: Sequence[str | Path], first: float) -> float:
    """The smallest time step, s, that a run of the saved scene with an automatic one takes; `first` if it does not end."""
    from thirdbody.output.run import open_run

    place = folder / RUNGS / "automatic_step"
    if not in_process(folder / SCENE_FILE, place, [{}], plugins, 0)[0]["stable"]:
        return first
    with open_run(place / "0") as run:
        return min(first, float(run.summary()["time_step_limit"]["smallest"]))


def _one_pace(rows: Sequence[Row]) -> None:
    """Put the seconds of rungs that took turns with the scene's own to one pace of the machine, that of its median."""
    paces = [seconds for row in rows for seconds in row.beside]
    for row in rows:
        if row.beside:
            row.cpu = [cpu * statistics.median(paces) / own for cpu, own in zip(row.cpu, row.beside, strict=True)]


def climb(
    folder: Path, rung: Rung, name: str, plugins: Sequence[str | Path], repeats: int, own: Mapping[str, Any] | None = None
) -> Row:  # fmt: skip
    """One rung, in a process of its own; a short one in turns with the scene's `own`, by these changes."""
    place = folder / RUNGS / name
    found = in_process(folder / SCENE_FILE, place, [rung.changes], plugins, repeats, beside=own)[0]
    row = Row(rung, found["wall"], found["cpu"], found["stable"], found["message"], found.get("integrator") or rung.integrator,
              found.get("step"), place=name, beside=found.get("beside", []))  # fmt: skip
    if found["wall"]:
        row.outcome = read_outcome(place / "0")
    return row


def in_process(
    scene: Path, place: Path, variants: Sequence[Mapping[str, Any]], plugins: Sequence[str | Path], repeats: int,
    limit: float = LIMIT, beside: Mapping[str, Any] | None = None,
) -> list[dict[str, Any]]:  # fmt: skip
    """What `worker` tells of these variants of a scene; one that crashed is told like one that failed."""
    place.mkdir(parents=True, exist_ok=True)
    job, patience = place / "job.json", 600.0 + 4.0 * limit * len(variants) * (repeats + 1)
    job.write_text(json.dumps({
        "scene": str(scene), "variants": [dict(changes) for changes in variants], "plugins": [str(p) for p in plugins],
        "folder": str(place), "repeats": repeats, "limit": limit, "beside": None if beside is None else dict(beside),
    }), encoding="utf-8")  # fmt: skip
    command = [sys.executable, "-m", "thirdbody.studies.worker", str(job)]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=patience, check=False)
        if done.returncode == 0:
            return json.loads(done.stdout.splitlines()[-1])
        why = (done.stderr.strip().splitlines() or ["no message"])[-1]
        message = f"the process ended with code {done.returncode}: {why}"
    except subprocess.TimeoutExpired:
        message = f"given up after {patience:.0f} s"
    finally:
        job.unlink(missing_ok=True)
    return [{"wall": [], "cpu": [], "stable": False, "message": message} for _ in variants]


def judge(made: Study) -> None:
    """Errors of all rows against the reference. Another one takes its place where the finest rung failed."""
    rows = made.rows
    if not rows[-1].stable:
        whole = [row for row in rows if row.stable and row.rung.axis == "law"]
        if not whole:
            raise UsageError(f"no rung of {made.scene} came to its end: {rows[0].message or rows[-1].message}")
        for row in rows:
            row.rung = replace(row.rung, reference=row is whole[-1])
    reference = made.reference.outcome
    assert reference is not None  # a stable run has frames
    for row in rows:
        if row.outcome is not None:
            row.errors = errors(row.outcome, reference)


def figure_of_merit(made: Study) -> str:
    """The error that the front is drawn with: friction, or the load (gap) of a scene without a drag."""
    known = [row.errors.get("friction_error", math.nan) for row in made.rows if row.stable]
    return "friction_error" if any(math.isfinite(x) for x in known) else "load_error"


def efficient(made: Study) -> list[Row]:
    """The rungs that no other one beats in both time and error, by time; without the reference, whose error is zero by
    definition."""
    rows = [row for row in made.rows if row.stable and not row.rung.reference and row.rung.axis != "verify"]
    merit = figure_of_merit(made)
    return [rows[k] for k in front([(row.seconds, row.errors[merit]) for row in rows])]


def recommended(made: Study) -> tuple[Row, str]:
    """One rung, and why in words: the fastest whose friction is right to 1 % and that changes at most 1 % of the labels, else the
    most accurate one of the front."""
    rows = efficient(made) or [made.reference]
    merit = figure_of_merit(made)
    good = [row for row in rows if row.errors[merit] <= GOOD and not row.errors["label_difference"] > SAME]
    row = good[0] if good else rows[-1]
    what = "friction" if merit == "friction_error" else "load"
    default = made.default
    own = ", what the scene asks for," if row is default else ""
    words = [f"`{row.rung.name}`{own} gives {percent(row.errors[merit])} {what} error"]
    if default is not None and default.stable and default is not row:
        words.append(f" at {row.seconds / default.seconds:.2g} times the cost of `{default.rung.name}`"
                     f" ({percent(default.errors[merit])})")  # fmt: skip
    labels = row.errors["label_difference"]
    if not math.isnan(labels):
        words.append("; no label changes" if labels == 0.0 else f"; {percent(labels)} of the labels differ")
    if not good:
        words.append("; no rung is within 1 % in both: bodies that tip make the rest")
    return row, "".join(words)


def percent(share: float) -> str:
    """A share in per cent, two digits."""
    return f"{100.0 * share:.2g} %"


def as_json(made: Study) -> dict[str, Any]:
    """The whole study as it is written; numbers in SI or relative."""
    default, (row, words) = made.default, recommended(made)
    base = default.seconds if default is not None and default.stable else math.nan
    onfront = efficient(made)
    return {
        "scene": made.scene,
        "title": made.title,
        "machine": made.machine,
        "reduction": made.reduction,
        "reference": made.reference.rung.name,
        "recommended": {"rung": row.rung.name, "words": words},
        "rungs": [
            {
                "name": entry.rung.name,
                "axis": entry.rung.axis,
                "level": entry.rung.level,
                "springs": entry.rung.springs,
                "integrator": entry.integrator,
                "step": entry.step,
                "wall_s": entry.wall_seconds,
                "wall_spread_s": [min(entry.wall), max(entry.wall)] if entry.wall else None,
                "cpu_s": entry.seconds,
                "cpu_spread_s": [min(entry.cpu), max(entry.cpu)] if entry.cpu else None,
                "yardstick_s": statistics.median(entry.beside) if entry.beside else None,
                "repeats": len(entry.wall),
                "time_ratio": entry.seconds / base,
                **{name: entry.errors.get(name, math.nan) for name in ERRORS},
                "energy_residual": None if entry.outcome is None else entry.outcome.residual,
                "stable": entry.stable,
                "message": entry.message,
                "default": entry.rung.default,
                "reference": entry.rung.reference,
                "on_front": any(entry is other for other in onfront),
            }
            for entry in made.rows if entry.rung.axis != "verify"
        ],
    }


ERRORS = ("friction_error", "load_error", "position_error", "rotation_error", "label_difference", "dissipation_error")


def _save(scene: Scene, folder: Path) -> None:
    """The scene as it is climbed, beside the rungs; files that it names are told by their absolute paths."""
    changes = {
        f"debris.{k}.file": str(scene.beside(debris.file).absolute())
        for k, debris in enumerate(scene.debris)
        if isinstance(debris, File | Mesh)
    }
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(f"{folder}: cannot be made ({error.strerror or error})") from error
    (scene.with_settings(changes) if changes else scene).save(folder / SCENE_FILE)


def _slug(name: str) -> str:
    return "".join(c if c.isalnum() else "_" for c in name).replace("__", "_")
