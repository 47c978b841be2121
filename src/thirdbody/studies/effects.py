"""Cost and influence of each effect and measure of a scene: off if it is on, on if it is off, against the scene as it is.

Both run alternately in one process, so that a ratio of times is that of two adjacent measurements. The picture shows what each
costs, in pairs of runs, beside what it changes.
"""

from __future__ import annotations

import math
import statistics
import textwrap
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from thirdbody.assembly.simulation import Simulation
from thirdbody.errors import ThirdbodyError, UsageError, nearest
from thirdbody.laws.registry import discover
from thirdbody.palette import INK, LINE_COLORS, SOFT_INK
from thirdbody.runner.simulate import prepare
from thirdbody.scene.model import Scene
from thirdbody.studies.copies import StudySource, portable, reduce_scene, reductions, time_point
from thirdbody.studies.cost import errors, percent, read_outcome
from thirdbody.studies.folder import RUNS, SCENE_FILE
from thirdbody.studies.point import DONE, Point, run_point
from thirdbody.studies.timing import NUDGE, Late, machine
from thirdbody.studies.workers import LocalWorkers

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SECONDS = 2.0  # integration time of one run of the copy [s]: some six effects, each in five pairs or, where a run is long, in two

# Time limit of one run [s]; run time above which a run is timed while it also writes its frames, which do not matter there [s];
# least number of pairs.
LIMIT, LONG, PAIRS = 90.0, 2.0, 5

APART = f"starts {NUDGE:g} apart: smaller changes mean nothing"  # what the first row tells where bodies meet

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


def effects_study(source: StudySource, repeats: int, log: Callable[[str], None], only: Sequence[str] = ()) -> dict[str, Any]:
    """Return paired ratios of time and the changes, effect by effect. Raises ThirdbodyError for an invalid scene.

    `only`: names of effects, and no others are studied; all without any.
    """
    log("building the scene and estimating its time")
    whole = source.read()
    first = prepare(whole, source.plugins)
    scene, built = reduce_scene(whole, source.plugins, SECONDS, first)
    reduction = [f"{key} = {value}" for key, value in source.settings.items()]
    reduction += reductions(whole, first.state.n_bodies, first.settle, scene, built)
    scene, left_out = portable(scene), list[str]()
    trials = candidates(scene, built, source.plugins, left_out)
    for name in only:
        if name not in (names := [trial.name for trial in trials]):
            raise UsageError(f"--only {name}: cannot be studied in this scene; {nearest(name, names)}")
    trials = [trial for trial in trials if not only or trial.name in only]
    if built.state.world.debris_meets:
        trials.insert(0, Trial("none", APART, {}, None))
    source.folder.mkdir(parents=True, exist_ok=True)
    scene.save(source.folder / SCENE_FILE)
    rows, files = list[dict[str, Any]](), tuple(Path(file).absolute() for file in source.plugins)
    with LocalWorkers(1) as workers:
        for trial in trials:
            log(f"{trial.name}: {trial.what}")
            # the integrator stays: only the effect is compared
            other = scene.with_settings({"solver.integrator": built.plan.kind, **trial.changes})
            folder = source.folder.absolute() / RUNS / trial.name.replace(" ", "_")
            again = int(trial.named is None)  # the same scene from another start
            pair = [Point(k, folder / str(k), one.to_toml(), Path(), ("integration_time",), files, nudge=k * again)
                    for k, one in enumerate((scene, other))]  # fmt: skip
            row = {"effect": trial.name, "what": trial.what} | _compared(workers, pair, max(repeats, PAIRS))
            rows.append(row if trial.named is None else row | {"named": trial.named})
    return {"scene": str(source.scene), "title": scene.title, "machine": machine(), "reduction": reduction, "effects": rows,
            "left_out": left_out}  # fmt: skip


def _compared(workers: LocalWorkers, pair: Sequence[Point], repeats: int) -> dict[str, Any]:
    """Return the ratios of time of two points that are run and then timed alternately, and what the second one changes."""
    results = [workers.submit(run_point, point).result() for point in pair]
    bad = next((result for result in reversed(results) if result.status != DONE), None)
    row: dict[str, Any] = {"ratios": [], "stable": bad is None, "message": "" if bad is None else bad.reason}
    if bad is not None:
        return row
    first = tuple(result.results["integration_time"] for result in results)
    times = [first] if min(first) > LONG else []
    while len(times) < repeats and sum(map(sum, times)) < LIMIT:
        try:
            times.append(tuple(workers.submit(time_point, point, LIMIT).result()[1] for point in pair))
        except (Late, ThirdbodyError):
            break
    ratios = sorted(b / a for a, b in times if a > 0.0)
    outcomes = [read_outcome(point.folder) for point in pair]
    if ratios and outcomes[0] is not None and outcomes[1] is not None:
        seconds = [statistics.median(column) for column in zip(*times, strict=True)]
        change = errors(outcomes[1], outcomes[0])
        row |= {"ratios": ratios, "ratio": statistics.median(ratios), "seconds": seconds, "change": change}
    return row


class Trial(NamedTuple):
    """One comparison: what is switched, how, the changes to the scene, and whether the scene names it; None for no change."""

    name: str
    what: str
    changes: dict[str, Any]
    named: bool | None


def candidates(scene: Scene, built: Simulation, plugins: Sequence[str | Path], left_out: list[str]) -> list[Trial]:
    """Return the trial of every effect and measure; those without a sensible value go to `left_out`."""
    known, result, measures = discover(tuple(plugins)), list[Trial](), scene.measures
    on = {*scene.effects.named, *measures.named} | ({"gravity"} if scene.effects.gravity is not None else set())
    if built.state.world.debris_meets:
        result.append(Trial("debris-debris contact", "switched off", {"contact.debris_contact": "none"}, True))
    elif scene.contact.debris_contact == "none":
        result.append(Trial("debris-debris contact", "switched on", {"contact.debris_contact": "auto"}, False))
    for name in (*known.effects, *known.measures):
        changes: dict[str, Any] = {f"{'effects' if name in known.effects else 'measures'}.{name}": None}
        needed = known.measures[name].materials if name in known.measures else ()
        maps = [amount.map for other in measures.named if other != name for amount in known.measures[other].amounts]
        if name in measures.named and measures.cell is not None and not any(maps):
            changes["measures.cell"] = None  # the cells of the maps, where no other measure has one
        if name == "wear" and scene.plates.wear is not None:
            changes["plates.wear"] = None  # takes what it has mapped
        if name in on:
            result.append(Trial(name, "switched off", changes, True))
        elif lacking := [key for key in needed if any(getattr(m, key) is None for m in built.choice.materials)]:
            left_out.append(f"{name}: off, and the materials lack {', '.join(lacking)}")
        elif name in TRIED:
            key, value, words = TRIED[name]
            result.append(Trial(name, f"switched on: {words}", {key: value}, False))
        else:
            left_out.append(f"{name}: off, and no value to try is known")
    return result


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
    for line in [*_failed(message), *message["left_out"]]:
        print_line(line)


def _failed(report: dict[str, Any]) -> list[str]:
    return [f"{row['effect']}: {row['message'].splitlines()[0]}" for row in report["effects"] if "ratio" not in row]


CHANGES = {  # in `studies.cost.errors`: label, colour, marker
    "friction_error": ("friction (rms)", LINE_COLORS["blue"], "o"),
    "load_error": ("load or gap (rms)", LINE_COLORS["sky"], "P"),
    "label_difference": ("labels that differ", LINE_COLORS["vermilion"], "s"),
    "dissipation_error": ("dissipated energy", LINE_COLORS["green"], "D"),
}
ON, OFF = LINE_COLORS["black"], LINE_COLORS["purple"]  # colours of times: of what the scene names, and of what it does not
NOTHING = 1e-6  # smaller changes are drawn at this value, at the edge


def with_over_without(row: dict[str, Any]) -> list[float]:
    """Return the time with the effect over that without it, pair by pair: the ratios of a row, or their inverses."""
    return [1.0 / ratio if row.get("named") else ratio for ratio in row["ratios"]]


def picture(report: dict[str, Any]) -> Figure:
    """Return the picture as a matplotlib figure: one line per effect or measure, the most expensive first."""
    from matplotlib.figure import Figure

    rows = [row for row in report["effects"] if "ratio" in row]
    # from below, the first: starts a little apart
    rows.sort(key=lambda row: ("named" in row, statistics.median(with_over_without(row))))
    figure = Figure(figsize=(8.27, 2.1 + 0.34 * len(rows)), layout="constrained")
    time, change = figure.subplots(1, 2, sharey=True)
    for axes in (time, change):
        axes.grid(True, axis="x", alpha=0.25, linewidth=0.6)
        axes.spines[["top", "right"]].set_visible(False)
        axes.tick_params(labelsize=8)
    _times(time, rows)
    _changes(change, rows)
    origin = {None: "scene twice", True: "in the scene", False: "tried"}
    time.set_yticks(range(len(rows)), [f"{row['effect'].replace('_', ' ')} ({origin[row.get('named')]})" for row in rows])
    time.set_ylim(-0.6, len(rows) - 0.4)
    seconds = statistics.median([row["seconds"][0] for row in rows]) if rows else math.nan
    reduction = "; ".join(report["reduction"]) or "the whole scene"
    lines = [
        f"Computed: {reduction}; {seconds:.2g} s of one core, {report['machine']['cpu']}.",
        *(f"Failed: {textwrap.shorten(words, 130, placeholder=' ...')}" for words in _failed(report)),
    ]
    title = f"What effects cost and change: {report['title'] or report['scene']}"
    figure.suptitle(title, fontsize=12, fontweight="bold", x=0.01, ha="left", color=INK)
    text = "\n".join(line for words in lines for line in textwrap.wrap(words, 90))
    time.set_title(text, loc="left", fontsize=8, color=SOFT_INK)
    figure.legend(fontsize=8, frameon=False, loc="outside lower right", ncols=4)
    return figure


def _times(axes: Any, rows: list[dict[str, Any]]) -> None:
    axes.axvline(1.0, color=SOFT_INK, linewidth=1.0, linestyle="-.", zorder=1)
    for y, row in enumerate(rows):
        ratios = with_over_without(row)
        color = ON if row.get("named", True) else OFF
        axes.plot(ratios, [y] * len(ratios), "|", color=color, markersize=7.0, alpha=0.6, zorder=2)
        middle = statistics.median(ratios)
        axes.plot([middle], [y], "o", color=color, markersize=5.5, zorder=3)
        axes.annotate(f"{middle:.2f}", (middle, y), xytext=(0, 6), textcoords="offset points", ha="center", fontsize=7, color=INK)
    axes.set_xscale("log")
    axes.margins(x=0.1)
    low, high = axes.get_xlim()
    steps = (1, 2, 5) if high / low > 4.0 else (0.8, 1, 1.2, 1.5, 2, 3, 5)
    axes.set_xticks([tick for power in range(-3, 4) for tick in (10.0**power * step for step in steps) if low <= tick <= high])
    axes.xaxis.set_major_formatter("{x:g}")
    axes.minorticks_off()
    axes.set_xlabel("time with it over time without, pairs", fontsize=9)


def _changes(axes: Any, rows: list[dict[str, Any]]) -> None:
    for name, (label, color, marker) in CHANGES.items():
        known = [(row["change"][name], y) for y, row in enumerate(rows) if not math.isnan(row["change"][name])]
        if known:
            values, heights = zip(*known, strict=True)
            axes.plot([max(value, NOTHING) for value in values], heights, marker, color=color, markersize=6.0, label=label,
                      markeredgecolor="white", markeredgewidth=0.6, linestyle="none", clip_on=False, zorder=3)  # fmt: skip
    axes.set_xscale("log")
    axes.set_xlim(left=NOTHING)
    axes.set_xlabel(f"relative change ({NOTHING:g} and less at the edge)", fontsize=9)
