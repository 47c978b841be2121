"""How often the verdict of the rate test is wrong: one small bed of clumps, many seeds, a fast and a slow shear.

    python tests/bench/rate_test_seeds.py --seeds 20 --inertial-number 0.05 --strain 45
    python tests/bench/rate_test_seeds.py --seeds 20 --strain 15 --factor 1.01   # no effect: every "effect" is false

Prints one line per seed, then the frequency of each verdict. By mu(I) of smooth spheres friction changes by about 0.9 I over
I (Jop et al. 2006), so at a third of the speed by 0.6 I: 0.03 at I = 0.05, far above the 0.01 that matters, and 0.002 at 0.004.
"""

from __future__ import annotations

import argparse
import tempfile
from collections import Counter
from pathlib import Path

import thirdbody

PRESSURE, DENSITY, DIAMETER, HEIGHT = 2.5e6, 2500.0, 10e-6, 5.0
"""Pressure [Pa], density [kg/m3], diameter [m], height of the bed over the diameter."""

SCENE = """\
scene = 1
title = "a small bed of clumps"
[materials.soft]
youngs_modulus = "25 GPa"
poisson_ratio = 0.25
density = "2500 kg/m3"
[materials.wall]
youngs_modulus = "25 GPa"
poisson_ratio = 0.25
density = "2500 kg/m3"
[[pairs]]
between = ["soft", "soft"]
friction = 0.30
restitution = 0.60
[[pairs]]
between = ["soft", "wall"]
friction = 1.0
restitution = 0.60
[[debris]]
material = "soft"
kind = "irregular"
count = 40
seed = 1
spheres = [3, 4]
aspect = [1.0, 0.8, 0.7]
size = {distribution = "uniform", min = "9 um", max = "11 um"}
placement = "dense"
solid_fraction = 0.56
[domain]
size = ["35 um", "25 um"]
[plates.lower]
material = "wall"
[plates.upper]
material = "wall"
support = "rigid"
pressure = "2.5 MPa"
motion = {x = {velocity = "1 m/s"}}
[solver]
distance = "30 um"
[output]
every = "1 um"
"""


def bed(seed: int, inertial_number: float, strain: float, factor: float, outputs: int) -> thirdbody.Scene:
    """Return a bed whose shear rate has the inertial number, sheared to a strain."""
    height = HEIGHT * DIAMETER
    speed = inertial_number * (PRESSURE / DENSITY) ** 0.5 / DIAMETER * height
    return thirdbody.Scene.parse(SCENE).with_settings({
        "debris.0.seed": seed, "plates.upper.motion.x.velocity": f"{speed!r} m/s", "solver.rate_test": factor,
        "solver.distance": f"{strain * height!r} m", "output.every": f"{strain * height / outputs!r} m",
    })  # fmt: skip


def main() -> None:
    """Run the seeds and print the verdicts."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--first", type=int, default=1)
    parser.add_argument("--inertial-number", type=float, default=0.05)
    parser.add_argument("--strain", type=float, default=45.0)
    parser.add_argument("--factor", type=float, default=3.0)
    parser.add_argument("--outputs", type=int, default=240)
    options = parser.parse_args()
    found: Counter[str] = Counter()
    for seed in range(options.first, options.first + options.seeds):
        scene = bed(seed, options.inertial_number, options.strain, options.factor, options.outputs)
        with tempfile.TemporaryDirectory() as folder, thirdbody.run(scene, Path(folder) / "run", progress=False) as run:
            result = run.rate_test
            assert result is not None
            found[{True: "effect", False: "no effect", None: "undecided"}[result.effect]] += 1
            means = run.summary()
            friction = result.quantities[0]
            print(f"seed {seed}, I {means['inertial_number']:.2g}, change {friction.change:+.4f}, "
                  f"error {friction.change_error:.4f}, margin {friction.margin:.4f}: {result}", flush=True)  # fmt: skip
    print(", ".join(f"{kind} {count}" for kind, count in found.most_common()))


if __name__ == "__main__":
    main()
