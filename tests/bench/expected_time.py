"""Expected and measured processor times of both integrators for layers whose debris meets, and for other scenes.

`PYTHONPATH=tests python tests/bench/expected_time.py [NAME ...]` prints the table (all: some minutes). Runs have no frames and
no checkpoints; explicit ones are measured over a part of their time.
"""

from __future__ import annotations

import math
import sys
import time
from pathlib import Path

from thirdbody.assembly.simulation import Simulation
from thirdbody.kernels.columns import run_totals
from thirdbody.runner.output_schedule import targets
from thirdbody.runner.prepare import prepare, set_threads
from thirdbody.scene.model import Scene

SCENES = Path(__file__).parents[2] / "scenes"
LONGEST = 12.0
"""Processor time after which an explicit run is extrapolated [s]."""


def layer(bodies: int, coverage: float, speed: str, distance: str, **more: object) -> tuple[str, dict[str, object]]:
    """The main scene with fewer bodies that cover this fraction of the lower plate, seen from above (2000 cover 0.325)."""
    stretch = math.sqrt(bodies / 2000.0 * 0.325 / coverage)
    sizes = [f"{stretch * side:.4g} um" for side in (1000.0, 750.0)]
    motion = {"plates.upper.motion.x.velocity": speed, "solver.distance": distance}
    return "sheared_debris", {"debris.0.count": bodies, "domain.size": sizes} | motion | more


SETTLED = {"solver.settle": "auto", "plates.upper.damping": None}
CASES = {
    "layer": layer(100, 0.325, "1 m/s", "3 um"),
    "600 bodies": layer(600, 0.325, "1 m/s", "3 um"),
    "long": layer(100, 0.325, "1 m/s", "20 um"),
    "sparse": layer(100, 0.05, "1 m/s", "3 um"),
    "close": layer(100, 0.45, "1 m/s", "3 um"),
    "closer": layer(100, 0.55, "1 m/s", "3 um"),
    "50 m/s": layer(100, 0.325, "50 m/s", "50 um"),
    "20 m/s": layer(100, 0.325, "20 m/s", "60 um", **SETTLED),
    "5 m/s": layer(100, 0.325, "5 m/s", "40 um", **SETTLED),
    "0.1 m/s": layer(100, 0.325, "0.1 m/s", "3 um"),
    "1 mm/s": layer(100, 0.325, "1 mm/s", "3 um"),
    "10 uN": layer(100, 0.325, "1 m/s", "10 um", **SETTLED, **{"plates.upper.load": "10 uN"}),
    "1 uN": layer(100, 0.325, "1 m/s", "10 um", **SETTLED, **{"plates.upper.load": "1 uN"}),
    "1 mN": layer(100, 0.325, "1 m/s", "3 um", **{"plates.upper.load": "1 mN"}),
    "friction 0.8": layer(100, 0.325, "1 m/s", "3 um", **{"pairs.0.friction": 0.8}),
    "coulomb": layer(100, 0.325, "1 m/s", "3 um", **{"contact.level": "coulomb"}),
    "mdr": layer(100, 0.325, "1 m/s", "1 um", **{"contact.level": "mdr"}),
    "roller_bearing": ("roller_bearing", {"solver.distance": "2 um"}),
    "sliding_flakes": ("sliding_flakes", {"solver.distance": "2 um"}),
    "scanned_debris": ("scanned_debris", {"solver.distance": "2 um"}),
    "fretting": ("fretting", {"solver.duration": "10 us"}),
}


def measured(built: Simulation) -> float:
    """Return the processor time of all steps [s]; that of an explicit run may be extrapolated."""
    begun, state, integrator = time.process_time(), built.state, built.integrator
    for until, distance, is_output in targets(built):
        if not integrator.divisible:
            if is_output:
                integrator.advance_to(until, distance)
            continue
        while state.time < until and state.distance < distance:
            integrator.advance_to(min(until, state.time + 400.0 * state.dt), distance)
            if time.process_time() - begun > LONGEST:
                return (time.process_time() - begun) * built.planned_time / state.time
    return time.process_time() - begun


def row(name: str) -> str:
    """Return the line of a case."""
    scene, settings = CASES[name]
    cells = []
    for kind in ("implicit", "explicit"):
        given = Scene.load(SCENES / f"{scene}.toml").with_settings(settings | {"solver.integrator": kind})
        compiled = prepare(given)
        set_threads(1)
        compiled.integrator.advance_to(1e-9)
        built = prepare(given)
        times = built.plan.times
        assert times is not None  # all bodies have loads of their own
        expected, seconds = times._asdict()[kind], measured(built)
        steps = f", {built.integrator.totals[:, run_totals.STEPS].mean():.0f} steps" if kind == "implicit" else ""  # type: ignore[union-attr]
        cells.append(f"{kind} {seconds:.3g} s, expected {expected / seconds:.2f} of it{steps}")
    return f"{name:15} {'; '.join(cells)}"


if __name__ == "__main__":
    for chosen in sys.argv[1:] or CASES:
        print(row(chosen), flush=True)
