"""What does a contact with a rough plate cost? Steps of the same particles between rough and between flat plates.

    python tests/bench/rough_cost.py [--bodies 200] [--rms 0.1] [--rounds 9] [--implicit]

Clumps of the main scene that do not meet each other, each under a load of its own, dragged at 1 m/s. The shortest wave of the
surfaces is the median radius of the spheres, the hardest case that Hertz' contact allows. Told are processor times on one thread:
of an explicit step, per body and per contact that touches; of an implicit one per body. The ratio is the median of pairs of
segments, one of each kind after the other, so that a busy machine disturbs both.
"""

import argparse
import math
import statistics
import time
from pathlib import Path
from typing import Any

import numpy as np
from ours import advance
from rich.console import Console

import thirdbody
from thirdbody.kernels.tables import run_totals, sphere
from thirdbody.runner.simulate import prepare, set_threads

SCENE = Path(__file__).parents[2] / "scenes" / "sheared_debris.toml"

# of a segment: explicit steps; drag of implicit ones, m. Drag before the first segment, m
STEPS, PATH, WARM = 400, 0.05e-6, 0.3e-6


def built(bodies: int, integrator: str, rough: dict[str, Any]) -> Any:
    length = 20.0 * round(8.0 * math.sqrt(bodies / 60.0))
    settings = {
        "domain.size": [f"{length} um", f"{length} um"], "contact.debris_contact": "none", "solver.integrator": integrator,
        "debris.0.count": bodies,
    }  # fmt: skip
    simulation = prepare(thirdbody.Scene.load(SCENE).with_settings(settings | rough))
    simulation.integrator.advance_to(time=simulation.settle)
    simulation.integrator.advance_to(distance=WARM)
    return simulation


def segment(simulation: Any, integrator: str) -> float:
    """Return the processor seconds per step, of an implicit one per body."""
    began = time.process_time()
    if integrator == "explicit":
        taken = advance(simulation, STEPS)
        return (time.process_time() - began) / taken
    before = simulation.integrator.totals[:, run_totals.STEPS].sum()
    simulation.integrator.advance_to(distance=simulation.state.distance + PATH)
    return (time.process_time() - began) / float(simulation.integrator.totals[:, run_totals.STEPS].sum() - before)


def measure(bodies: int, integrator: str, rms: str, rounds: int) -> dict[str, float]:
    flat = built(bodies, integrator, {})
    radius = float(np.median(flat.state.S[:, sphere.RADIUS]))
    surface = {"rms": rms, "long": "40 um", "short": f"{1e6 * radius!r} um"}
    sides = {f"plates.{side}.surface": surface | {"seed": 1 + k} for k, side in enumerate(("lower", "upper"))}
    rough = built(bodies, integrator, sides)
    times = [(segment(flat, integrator), segment(rough, integrator)) for _ in range(rounds)]
    found = {"flat_us": 1e6 * statistics.median(t for t, _ in times), "rough_us": 1e6 * statistics.median(t for _, t in times),
             "ratio": statistics.median(b / a for a, b in times)}  # fmt: skip
    if integrator == "explicit":
        for name, one in (("flat", flat), ("rough", rough)):
            found[f"{name}_ns_per_contact"] = 1e3 * found[f"{name}_us"] / float((one.state.slots.closed == 1).sum())
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--bodies", type=int, default=200)
    parser.add_argument("--rms", default="0.1", help="rms height of both surfaces, um (default %(default)s)")
    parser.add_argument("--rounds", type=int, default=9, help="pairs of segments (default %(default)s)")
    parser.add_argument("--implicit", action="store_true", help="the implicit integrator, too")
    chosen = parser.parse_args()
    set_threads(1)
    for integrator in ("explicit", "implicit") if chosen.implicit else ("explicit",):
        found = measure(chosen.bodies, integrator, f"{chosen.rms} um", chosen.rounds)
        words = ", ".join(f"{name} {value:.3g}" for name, value in found.items())
        Console().print(f"{integrator}: {words}", highlight=False)


if __name__ == "__main__":
    main()
