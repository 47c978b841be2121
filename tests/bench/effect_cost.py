"""What each effect adds to the time of a run: processor time with it over without, in turn, per explicit step and implicit drag.

`PYTHONPATH=tests python tests/bench/effect_cost.py [INTEGRATOR ...]`: 200 particles of `scenes/yielding_debris.toml`, one thread.
Both runs of a pair go on side by side, piece by piece, so that what disturbs the machine falls on both.
"""

import statistics
import sys
import time
from typing import Any

from effect_labels import SCENE

import thirdbody
from thirdbody.assembly.simulation import Simulation
from thirdbody.jit.threads import allow_threads
from thirdbody.kernels.columns import run_totals
from thirdbody.runner.prepare import prepare

EFFECTS: dict[str, dict[str, Any]] = {
    "elastic_plastic": {},
    "adhesion": {"work_of_adhesion": "50 mJ/m2", "model": "jkr"},
    "pivoting": {},
    "close_spots": {},
}
PIECES = {"explicit": 40e-9, "implicit": 1e-6}
"""Drag of a piece [m]."""
PAIRS = 8


def started(integrator: str, effects: dict[str, Any]) -> Simulation:
    """Return a run with these effects at the start of the drag, compiled."""
    settings = {"debris.0.count": 200, "solver.integrator": integrator, "effects.elastic_plastic": None}
    run = prepare(
        thirdbody.Scene.load(SCENE).with_settings(settings | {f"effects.{name}": given for name, given in effects.items()})
    )
    run.integrator.advance_to(time=run.settle)
    run.integrator.advance_to(distance=PIECES[integrator])
    return run


def seconds(run: Simulation, distance: float) -> float:
    """Advance to a distance [m]; return processor time [s], in explicit runs per step."""
    begin, steps = time.process_time(), run.state.A[run_totals.STEPS]
    run.integrator.advance_to(distance=distance)
    spent = time.process_time() - begin
    return spent / (run.state.A[run_totals.STEPS] - steps) if run.plan.kind == "explicit" else spent


def main() -> None:
    """Print median and range of the pairs."""
    allow_threads(1)
    for integrator in sys.argv[1:] or PIECES:
        for effect, options in EFFECTS.items():
            without, named = started(integrator, {}), started(integrator, {effect: options})
            ends = [PIECES[integrator] * (k + 2) for k in range(PAIRS)]
            ratios = sorted((1.0 / seconds(without, end)) * seconds(named, end) for end in ends)
            text = f"{statistics.median(ratios):.2f} ({ratios[0]:.2f} to {ratios[-1]:.2f})"
            print(f"{integrator} {effect:16s} {text}", flush=True)


if __name__ == "__main__":
    main()
