"""What does slow sliding cost? Our explicit and implicit engines and the fastest C++ peer, side by side.

    python tests/bench/slow_sliding.py [--json FILE] [--bodies N] [--quick]
    python tests/bench/slow_sliding.py --layers [--json FILE] [--bodies N] [--seeds N] [--quick]

How to read it. The first command tells the seconds that one core spends on one particle for 10 um of sliding at 1 m/s, 10 mm/s
and 1 mm/s. The particles are those of `scenes/sheared_debris.toml`, each under its own load, blind to the others. Only the
sliding is timed, by the seconds of the processor on one thread. A cell is the median of the repeats, their spread (largest less
smallest, over the median) and the peer's time over ours.

- explicit: a few seconds of the sliding are run and extrapolated; the second table says which share was run.
- implicit: the whole way is run, with a stop every um.
- peer: not run here. Its measured cost per sphere and step (`PEER` says what differs) times spheres per particle times steps:
  with the time step that it is usually given, a fraction of the Rayleigh time of the smallest sphere, and with that of our
  explicit engine. A figure of your machine is given by --peer-name, --peer-ns and --peer-fraction.

With --layers: the bodies meet, and cover 0.05 to 0.5 of the lower plate, seen from above; 1 mm/s, one thread. Told are the
processor seconds per particle and um by the implicit engine, from the first 2 um, and by the explicit one, extrapolated: median,
smallest and largest of three layers of different particles, and the median of the ratios.

Timings mean something on an idle machine only: the load stands in the head and in the JSON, and the column CPU tells the share of
the wall time in which the one thread did run.
"""

import argparse
import json
import statistics
from pathlib import Path
from typing import Any

from ensemble import EXPLICIT, PATH, Case, scene_of, time_explicit, time_implicit, warm_up
from machine import head, machine, screen
from rich.console import Console
from rich.table import Table

from thirdbody.engine.state import rayleigh_times
from thirdbody.runner.simulate import prepare

SPEEDS = [1.0, 10e-3, 1e-3]
LEVELS = ["mindlin", "mdr"]
FRACTIONS, LAYER_PATH, LAYER_EVERY = [0.05, 0.1, 0.15, 0.2, 0.3, 0.4, 0.5], 2e-6, 0.5e-6
QUICK_FRACTIONS = [0.05, 0.3]
LAYER_UM = 1e-6 / PATH  # what was counted per PATH, per um
QUICK_PATH = 1e-6

PEER, PEER_NS, PEER_FRACTION = "LIGGGHTS 3.8.0", 58.0, 0.18
"""The fastest peer. The next one, LAMMPS (22 Jul 2025, pair style granular), took 83 ns on that scene and machine, YADE 2023.02a
488. The peer's clumps had 2 contacts with the plates each at first and .5 to 1 later; ours carry a load each, on 3 to 4 contacts:
the comparison favours the peer."""

SOURCE = (
    "LIGGGHTS 3.8.0 (Debian 12), fix rigid, Hertz with tangential history: 2000 steel clumps of 4 to 8 spheres (12092 in all), "
    "friction .3, restitution .6, pinched between two plates, no contact between clumps, upper plate .5 m/s, time step .18 "
    "Rayleigh times of the smallest sphere; 58 ns per sphere and step (median; best 54) on one shared core of a virtual server "
    "(AMD Zen 5), where the same run varied by up to 1.8"
)

Rows = list[dict[str, Any]]


def main() -> None:
    requested = arguments()
    console = screen()
    report: dict[str, Any] = {"machine": head(console)}
    report |= (part_layers if requested.layers else part_speeds)(requested, console)
    report["load_at_end"] = machine()["load"]
    if requested.json:
        Path(requested.json).write_text(json.dumps(report, indent=1), encoding="utf-8")


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--json", metavar="FILE", help="write all figures there")
    parser.add_argument("--bodies", type=int, default=300, help="particles of the ensemble (default %(default)s)")
    parser.add_argument("--repeats", type=int, default=5, help="timings of each case (default %(default)s)")
    parser.add_argument("--patience", type=float, default=3.0, help="seconds of an explicit timing (default %(default)s)")
    parser.add_argument("--quick", action="store_true", help="few particles and repeats: does it run?")
    parser.add_argument("--peer-name", default=PEER)
    parser.add_argument("--peer-ns", type=float, default=PEER_NS, help="ns per sphere and step (default %(default)s)")
    parser.add_argument(
        "--peer-fraction", type=float, default=PEER_FRACTION, help="time step in Rayleigh times (default %(default)s)"
    )
    parser.add_argument("--layers", action="store_true", help="the second part: layers whose bodies meet, by area fraction")
    parser.add_argument("--seeds", type=int, default=3, help="layers of each area fraction (default %(default)s)")
    requested = parser.parse_args()
    if requested.quick:
        requested.bodies, requested.repeats, requested.patience = min(requested.bodies, 60), min(requested.repeats, 2), 0.5
        requested.seeds = min(requested.seeds, 2)
    return requested


def part_speeds(requested: argparse.Namespace, console: Console) -> dict[str, Any]:
    compiled = {"explicit": warm_up("explicit", "mindlin"), **{level: warm_up("implicit", level) for level in LEVELS}}
    ensemble = ensemble_of(requested.bodies)
    cases = [Case("explicit", "mindlin", v, requested.bodies) for v in SPEEDS]
    ours = [time_explicit(case, requested.repeats, requested.patience) for case in cases]
    steps = {row["speed"]: row["time_step"] for row in ours}
    for level in LEVELS:
        ours += [time_implicit(Case("implicit", level, v, requested.bodies), requested.repeats) for v in SPEEDS]
    name, ns, fraction = requested.peer_name, requested.peer_ns, requested.peer_fraction
    usual = (name, ns, fraction) == (PEER, PEER_NS, PEER_FRACTION)
    source = SOURCE if usual else f"{name}: {ns:g} ns per sphere and step, given on the command line"
    rows = peer_rows(requested, ensemble, steps) + ours
    print_speeds(rows, requested, console)
    console.print(f"peer: not run here, but computed. {source}")
    print_explicit([row for row in ours if row["engine"] == EXPLICIT], console)
    print_implicit([row for row in ours if row["engine"] != EXPLICIT], console)
    peer = {"name": name, "nanoseconds": ns, "fraction": fraction, "source": source}
    return {"compile_s": compiled, "ensemble": ensemble, "peer": peer, "way": PATH, "rows": rows}


def ensemble_of(bodies: int) -> dict[str, float]:
    """Spheres per particle of the ensemble and the Rayleigh time of its smallest sphere, s."""
    simulation = prepare(scene_of(Case("implicit", "mindlin", 1.0, bodies)))
    state, materials = simulation.state, simulation.choice.materials
    per_radius = (rayleigh_times(state, materials) / state.rayleigh_radius)[state.body]
    smallest = float((per_radius * state.spheres.radius).min())
    return {"bodies": bodies, "spheres_per_particle": state.n_spheres / bodies, "rayleigh_of_smallest_sphere": smallest}


def peer_rows(requested: argparse.Namespace, ensemble: dict[str, float], steps: dict[float, float]) -> Rows:
    """Results of the peer: with the time step that it is run with, and with that of our explicit engine at each speed, s."""
    own = requested.peer_fraction * ensemble["rayleigh_of_smallest_sphere"]
    rules = {f"{requested.peer_fraction:g} Rayleigh": dict.fromkeys(steps, own), "our explicit step": steps}
    seconds = 1e-9 * requested.peer_ns * ensemble["spheres_per_particle"] * PATH
    return [
        {"engine": f"{requested.peer_name}, {rule}", "speed": speed, "time_step": step,
         "seconds_per_particle": {"median": seconds / speed / step, "spread": None}}
        for rule, taken in rules.items() for speed, step in taken.items()
    ]  # fmt: skip


def print_speeds(rows: Rows, requested: argparse.Namespace, console: Console) -> None:
    title = f"processor seconds per particle per {1e6 * PATH:g} um of sliding, one thread; {requested.bodies} particles"
    table = Table(
        "engine",
        *(_speed(v) for v in SPEEDS),
        title=f"{title}, median of {requested.repeats}",
        caption="x: the peer's time (shorter one) over ours",
    )
    by = {(row["engine"], row["speed"]): row["seconds_per_particle"] for row in rows}
    peers = {v: min(cell["median"] for (_, u), cell in by.items() if u == v and cell["spread"] is None) for v in SPEEDS}
    for engine in dict.fromkeys(row["engine"] for row in rows):
        table.add_row(engine, *(_cell(by[engine, v], peers[v]) for v in SPEEDS))
    console.print(table)


def _cell(report: dict[str, Any], peer: float) -> str:
    median, spread = report["median"], report["spread"]
    return f"{median:.3g}" + ("" if spread is None else f" (spread {100.0 * spread:.0f} %)  {peer / median:.3g} x")


def _speed(v: float) -> str:
    return f"{v:g} m/s" if v >= 1.0 else f"{1e3 * v:g} mm/s"


def print_explicit(rows: Rows, console: Console) -> None:
    table = Table("speed", "share of the way run", "time step", "steps for the way", "ns per sphere and step", "settling, all",
                  "CPU", title=f"{EXPLICIT}: the rest of the way is extrapolated")  # fmt: skip
    for row in rows:
        table.add_row(_speed(row["speed"]), f"{100.0 * row['share_run']:.3g} %", f"{1e9 * row['time_step']:.3g} ns",
                      f"{row['steps_per_particle']:.3g}", f"{row['ns_per_sphere_step']:.0f}",
                      f"{row['settle_s']:.2g} s", f"{row['busy']['median']:.0%}")  # fmt: skip
    console.print(table)


def print_implicit(rows: Rows, console: Console) -> None:
    table = Table("engine", "speed", "steps per particle", "median, 99 %, largest", "us per step", "unsolved",
                  "settling, all", "CPU", title="implicit: the whole way is run")  # fmt: skip
    for row in rows:
        steps = ", ".join(f"{row['steps'][key]:.0f}" for key in ("median", "99 %", "largest"))
        table.add_row(row["engine"], _speed(row["speed"]), f"{row['steps_per_particle']:.0f}", steps,
                      f"{1e6 * row['seconds_per_step']:.1f}", str(row["unsolved"]), f"{row['settle_s']:.2g} s",
                      f"{row['busy']['median']:.0%}")  # fmt: skip
    console.print(table)


def part_layers(requested: argparse.Namespace, console: Console) -> dict[str, Any]:
    for integrator in ("implicit", "explicit"):
        warm_up(integrator, "mindlin")
    fractions = QUICK_FRACTIONS if requested.quick else FRACTIONS
    rows = [layers_of(fraction, requested) for fraction in fractions]
    print_layers(rows, requested, console)
    return {"rows": rows}


def layers_of(fraction: float, requested: argparse.Namespace) -> dict[str, Any]:
    path, every = (QUICK_PATH, QUICK_PATH) if requested.quick else (LAYER_PATH, LAYER_EVERY)
    row: dict[str, Any] = {"fraction": fraction, "implicit": [], "explicit": []}
    for seed in range(1, requested.seeds + 1):
        implicit, explicit = (
            Case(kind, "mindlin", SPEEDS[-1], requested.bodies, path, every, fraction, seed) for kind in ("implicit", "explicit")
        )
        row["implicit"].append(time_implicit(implicit, requested.repeats))
        row["explicit"].append(time_explicit(explicit, requested.repeats, requested.patience))
    return row


def print_layers(rows: Rows, requested: argparse.Namespace, console: Console) -> None:
    title = (
        f"processor seconds per particle and um of sliding at {_speed(SPEEDS[-1])}, one thread; {requested.bodies} particles, "
    )
    title += f"median (smallest to largest) of {requested.seeds} layers"
    table = Table("area fraction", "implicit", "steps per um", "unsolved", "explicit, extrapolated", "ratio", title=title)
    for row in rows:
        costs = [[float(run["seconds_per_particle"]["median"]) * LAYER_UM for run in row[e]] for e in ("implicit", "explicit")]
        cells = [_with_range(values) for values in costs]
        ratio = statistics.median(explicit / implicit for implicit, explicit in zip(*costs, strict=True))
        steps = _with_range([run["steps_per_particle"] * LAYER_UM for run in row["implicit"]])
        unsolved = str(sum(run["unsolved"] for run in row["implicit"]))
        table.add_row(f"{row['fraction']:g}", cells[0], steps, unsolved, cells[1], f"{ratio:.3g}")
    console.print(table)


def _with_range(values: list[float]) -> str:
    return f"{statistics.median(values):.3g} ({min(values):.3g} to {max(values):.3g})"


if __name__ == "__main__":
    main()
