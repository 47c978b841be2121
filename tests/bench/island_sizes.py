"""What does a body of an island cost? Implicit steps against the number of bodies that are solved together.

    python tests/bench/island_sizes.py [--sizes N N ...] [--shapes chain 0.5 0.6 ...]

The bodies of an island are solved together, in steps that are short enough for each of them: a body costs the more the larger its
island is. An island is a *chain* of balls in a row, each a hundredth of its radius from the next, or the clumps of
`scenes/sheared_debris.toml` in a layer that covers so much of the lower plate. The gap below which two bodies belong together is
3 um, so that nearly all do: the same motion is computed, whatever the size; of small islands several are. Told are the largest
island, the half width of its matrix in bodies, steps per um, microseconds per step and body, seconds per body and um, and the
ratio to the explicit engine, extrapolated for the same bodies at 1 mm/s. The speed at which both cost the same is 1 mm/s times
the ratio. Seconds are those of the processor, on one thread."""

import argparse
import statistics
import time
from typing import Any

from machine import screen
from slow_sliding import Case, scene_of, time_explicit, warm_up
import thirdbody
from thirdbody.engine import meeting
from thirdbody.errors import ThirdbodyError
from thirdbody.kernels.tables import run_totals
from thirdbody.runner.simulate import prepare, set_threads

SPEED, PATH, EVERY = 1e-3, 0.4e-6, 0.02e-6
SEEDS, PATIENCE, NEAR = 5, 20.0, 3e-6
"""Islands of one size at most, of different bodies: in some a body chatters, with a thousand times as many steps. Processor
seconds after which a drag ends at its next stop; gap of bodies that belong together, m."""

RADIUS, GAP = 5e-6, 0.01  # radius of the balls of a chain, m, and the gap between them in radii


def chain(bodies: int) -> thirdbody.Scene:
    """Return a row of balls between plates, at an angle of 30 degrees to the drag."""
    x, y = (2.0 + GAP) * RADIUS * 0.75**0.5, (2.0 + GAP) * RADIUS * 0.5
    places = ", ".join(f'["{k * x + 1e-5!r} m", "{k * y + 1e-5!r} m", "{RADIUS!r} m"]' for k in range(bodies))
    size = f'["{bodies * x + 1e-4!r} m", "{bodies * y + 1e-4!r} m"]'
    return thirdbody.Scene.parse(f"""scene = 1
domain = {{size = {size}}}
materials.steel = {{youngs_modulus = "210 GPa", poisson_ratio = 0.3, density = "7850 kg/m3"}}
pairs = [{{between = ["steel", "steel"], friction = 0.3, restitution = 0.6}}]
solver = {{integrator = "implicit", on_failure = "continue", distance = "{PATH!r} m"}}
output.every = "{EVERY!r} m"
[plates]
lower = {{material = "steel"}}
upper = {{material = "steel", support = "load_per_particle", load = "0.1 mN", motion = {{x = {{velocity = "{SPEED!r} m/s"}}}}}}
[[debris]]
material = "steel"
kind = "spheres"
shape = [{{center = ["0 m", "0 m", "0 m"], radius = "{RADIUS!r} m"}}]
positions = [{places}]
""")


def island(shape: str, bodies: int, seed: int) -> thirdbody.Scene:
    if shape == "chain":
        return chain(bodies)
    return scene_of(Case("implicit", "mindlin", SPEED, bodies, PATH, EVERY, float(shape))).with_settings({"debris.0.seed": seed})


def measure(shape: str, bodies: int) -> dict[str, Any]:
    seeds = 1 if shape == "chain" else max(1, min(SEEDS, 500 // bodies))
    rows = [one(shape, bodies, seed) for seed in range(1, seeds + 1)]
    return {name: statistics.median(row[name] for row in rows) for name in rows[0]}


def one(shape: str, bodies: int, seed: int) -> dict[str, Any]:
    simulation = prepare(island(shape, bodies, seed), force=True)
    integrator = simulation.integrator
    set_threads(1)
    meeting.MARGIN = 1.0 if shape == "chain" else NEAR / integrator.stride
    integrator.advance_to(simulation.settle)
    began, before, distance, wide = time.process_time(), integrator.totals[:, run_totals.STEPS].sum(), 0.0, 0
    while distance < PATH - 0.5 * EVERY and time.process_time() - began < PATIENCE:
        distance += EVERY
        integrator.advance_to(distance=distance)
        wide = max(wide, int(integrator.islands.tables.widths.max(initial=0)))
    seconds, steps = time.process_time() - began, float(integrator.totals[:, run_totals.STEPS].sum() - before)
    summary = integrator.summary()
    return {
        "largest": summary["islands"]["largest"], "half_width": wide, "path_um": 1e6 * distance,
        "steps_per_um": steps / bodies / (1e6 * distance), "us_per_step_and_body": 1e6 * seconds / steps,
        "s_per_body_um": seconds / bodies / (1e6 * distance), "unsolved": len(summary["unsolved"]),
    }  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sizes", type=int, nargs="+", default=[10, 30, 100, 300, 600, 1000, 2000])
    parser.add_argument("--shapes", nargs="+", default=["chain", "0.5"])
    chosen = parser.parse_args()
    console = screen()
    warm_up("implicit", "mindlin"), warm_up("explicit", "mindlin")
    for shape in chosen.shapes:
        fraction = 0.3 if shape == "chain" else float(shape)  # a ball of a chain costs a sphere of a layer
        found = time_explicit(Case("explicit", "mindlin", SPEED, 300, PATH, EVERY, fraction), 3, 1.0)
        explicit = statistics.median(found["seconds"]) / 10.0
        console.print(f"{shape}: explicit, {explicit:.3g} s per body and um", highlight=False)
        for bodies in chosen.sizes:
            try:
                row = measure(shape, bodies)
            except ThirdbodyError as error:
                console.print(f"{shape}, {bodies}: {error}", highlight=False)
                break
            words = (f"{name} {value:.3g}" for name, value in (row | {"ratio": explicit / row["s_per_body_um"]}).items())
            console.print(f"{shape}, {bodies}: {', '.join(words)}", highlight=False)


if __name__ == "__main__":
    main()
