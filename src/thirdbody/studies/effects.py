"""Cost and influence of each effect and measure of a scene: off if it is on, on if it is off, against the scene as it is.

Both run alternately in one process, so that a ratio of times is that of two adjacent measurements.
"""

import math
import statistics
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from thirdbody.assembly.simulation import Simulation
from thirdbody.errors import UsageError, nearest
from thirdbody.laws.measures import Measure
from thirdbody.scene.model import Scene
from thirdbody.studies.compare import errors, read_outcome
from thirdbody.studies.cost import percent
from thirdbody.studies.machine_info import machine
from thirdbody.studies.nudge import NUDGE
from thirdbody.studies.reduced_scene import reduce_scene
from thirdbody.studies.study_setup import save
from thirdbody.studies.worker_process import RUNS, SCENE_FILE, in_process

EFFECTS_PICTURE = "effects.png"
"""In the folder of the study."""

SECONDS = 2.0
"""Integration time of one run of the copy [s]: some six effects, each in five pairs or, where a run is long, in two."""

APART = f"starts {NUDGE:g} apart: smaller changes mean nothing"
"""What the first row tells where bodies meet."""

TRIED: Mapping[str, tuple[str, Any, str]] = {
    "gravity": ("effects.gravity", ["0 m/s2", "0 m/s2", "-9.81 m/s2"], "9.81 m/s2 downwards"),
    "damping": ("effects.damping", {"rate": "1e3 1/s"}, "rate 1e3 1/s"),
    "local_damping": ("effects.local_damping", {"coefficient": 0.3}, "coefficient 0.3 while settling"),
    "rolling_resistance": ("effects.rolling_resistance", {"coefficient": 0.01}, "coefficient 0.01"),
    "pivoting": ("effects.pivoting", {}, "undamped"),
    "close_spots": ("effects.close_spots", {}, "of a body on a plate"),
    "elastic_plastic": ("effects.elastic_plastic", {}, "yield strengths as given"),
    "adhesion": ("effects.adhesion", {"work_of_adhesion": "50 mJ/m2"}, "50 mJ/m2"),
    "wear": ("measures.wear", {"plates": "1e-14 m3/J"}, "of the plates, without maps"),
    "flash_temperature": ("measures.flash_temperature", {}, "of all contacts"),
}
"""Effects and measures of the catalogue that can be switched on, and the trial values."""


def effects_study(
    path: Path, folder: Path, settings: Mapping[str, Any], plugins: Sequence[str | Path], repeats: int,
    log: Callable[[str], None], only: Sequence[str] = (),
) -> dict[str, Any]:  # fmt: skip
    """Return paired ratios of time and the changes, effect by effect. Raises ThirdbodyError for an invalid scene.

    `only`: names of effects, and no others are studied; all without any.
    """
    scene = Scene.load(path, plugins)
    scene = scene.with_settings(settings) if settings else scene
    log("building the scene and estimating its time")
    scene, built, reduction = reduce_scene(scene, plugins, SECONDS)
    reduction = [f"{key} = {value}" for key, value in settings.items()] + reduction
    save(scene, folder)
    rows: list[dict[str, Any]] = []
    left_out: list[str] = []
    trials = candidates(scene, built, plugins, left_out)
    for name in only:
        if name not in (names := [trial.name for trial in trials]):
            raise UsageError(f"--only {name}: cannot be studied in this scene; {nearest(name, names)}")
    if built.state.world.debris_meets:
        log(f"none: {APART}")
        rows.append(_compared(folder, "none", APART, {"solver.integrator": built.plan.kind}, plugins, repeats, nudge=1))
    for trial in [trial for trial in trials if not only or trial.name in only]:
        log(f"{trial.name}: {trial.what}")
        changes = {"solver.integrator": built.plan.kind, **trial.changes}  # the integrator stays: only the effect is compared
        rows.append(_compared(folder, trial.name, trial.what, changes, plugins, repeats) | {"named": trial.named})
    return {"scene": str(path), "title": scene.title, "machine": machine(), "reduction": reduction, "effects": rows,
            "left_out": left_out}  # fmt: skip


class Trial(NamedTuple):
    """One comparison: what is switched, how, the changes to the scene, and whether the scene names it."""

    name: str
    what: str
    changes: dict[str, Any]
    named: bool


def candidates(scene: Scene, built: Simulation, plugins: Sequence[str | Path], left_out: list[str]) -> list[Trial]:
    """Return the trial of every effect and measure; those without a sensible value go to `left_out`."""
    from thirdbody.laws.registry import discover

    known, result = discover(tuple(plugins)), []
    on = set(scene.effects.named) | ({"gravity"} if scene.effects.gravity is not None else set())
    for name in known.effects:
        if name in on:
            result.append(Trial(name, "switched off", {f"effects.{name}": None}, True))
        else:
            _try(name, result, left_out)
    if built.state.world.debris_meets:
        result.append(Trial("debris-debris contact", "switched off", {"contact.debris_contact": "none"}, True))
    elif scene.contact.debris_contact == "none":
        result.append(Trial("debris-debris contact", "switched on", {"contact.debris_contact": "auto"}, False))
    for name, measure in known.measures.items():
        if name in scene.measures.named:
            result.append(Trial(name, "switched off", _without(name, scene, known.measures), True))
        elif lacking := [key for key in measure.materials if any(getattr(m, key) is None for m in built.choice.materials)]:
            left_out.append(f"{name}: off, and the materials lack {', '.join(lacking)}")
        else:
            _try(name, result, left_out)
    return result


def _try(name: str, result: list[Trial], left_out: list[str]) -> None:
    """Add the trial of an effect or measure that the scene does not name, or the reason why there is none."""
    if name in TRIED:
        key, value, words = TRIED[name]
        result.append(Trial(name, f"switched on: {words}", {key: value}, False))
    else:
        left_out.append(f"{name}: off, and no value to try is known")


def _without(name: str, scene: Scene, known: Mapping[str, Measure]) -> dict[str, Any]:
    """Return the changes that remove a measure, with the cells of the maps where no other measure has one."""
    others = (known[other] for other in scene.measures.named if other != name)
    mapped = any(amount.map for measure in others for amount in measure.amounts)
    changes: dict[str, Any] = {f"measures.{name}": None}
    return changes if mapped or scene.measures.cell is None else changes | {"measures.cell": None}


def _compared(
    folder: Path, name: str, what: str, changes: dict[str, Any], plugins: Sequence[str | Path], repeats: int, nudge: int = 0
) -> dict[str, Any]:
    folder_of_runs = folder / RUNS / name.replace(" ", "_")
    own, other = in_process(folder / SCENE_FILE, folder_of_runs, [{}, changes], plugins, max(repeats, 5), nudge)
    ratios = sorted(b / a for a, b in zip(own["cpu"], other["cpu"], strict=False) if a > 0.0)
    row: dict[str, Any] = {"effect": name, "what": what, "ratios": ratios, "stable": other["stable"], "message": other["message"]}
    if ratios and other["stable"] and own["stable"]:
        first, second = read_outcome(folder_of_runs / "0"), read_outcome(folder_of_runs / "1")
        assert first is not None and second is not None  # both finished
        seconds = [statistics.median(one["cpu"]) for one in (own, other)]
        row |= {"ratio": statistics.median(ratios), "seconds": seconds, "change": errors(second, first)}
    return row


def print_effects(message: dict[str, Any]) -> None:
    """Print the result of `effects_study`."""
    from thirdbody.report.tables import table
    from thirdbody.system.terminal import print_line

    print_line(f"{message['title'] or message['scene']}: each effect against the scene as it is")
    print_line(f"reduced: {'; '.join(message['reduction']) or 'nothing'}")
    rows = []
    for row in message["effects"]:
        if "ratio" not in row:
            rows.append((row["effect"], row["what"], "failed", "", "", "", ""))
            continue
        cost = f"{row['ratio']:.3f} ({row['ratios'][0]:.3f} to {row['ratios'][-1]:.3f})"
        change = [row["change"][key] for key in ("friction_error", "load_error", "label_difference", "dissipation_error")]
        rows.append((row["effect"], row["what"], cost, *("" if math.isnan(x) else percent(x) for x in change)))
    table("", ("effect", "what", "time (pairs)", "friction", "load|gap", "labels", "dissipated"), rows)
    failed = [f"{row['effect']}: {row['message'].splitlines()[0]}" for row in message["effects"] if "ratio" not in row]
    for line in [*failed, *message["left_out"]]:
        print_line(line)
