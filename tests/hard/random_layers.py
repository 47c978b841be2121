"""Random small layers of debris that meets, for the implicit integrator: shapes, area fractions, supports, levels and speeds."""

from __future__ import annotations

import math
from random import Random
from typing import Any

RADIUS = 5e-6  # m, of balls; half the median size of clumps
HERTZ = 4.0 / 3.0 * 115e9  # 4/3 E* of steel on steel, Pa


def random_layer(seed: int) -> dict[str, Any]:
    """The scene of a seed as a TOML document: 3 to 16 bodies under a load that presses spots in by 1e-4 to 1e-2 of the radius.

    They slide for 0.05 to 0.5 radii at 0.1 mm/s to 1 m/s, so that neighbours a fraction of a radius apart meet.
    """
    rng = Random(f"layer {seed}")
    count, fraction = rng.randint(3, 16), rng.uniform(0.1, 0.6)
    side = math.sqrt(count * math.pi * RADIUS**2 / fraction)
    load = HERTZ * RADIUS**2 * (10.0 ** rng.uniform(-4.0, -2.0)) ** 1.5
    distance, speed = RADIUS * rng.uniform(0.05, 0.5), 10.0 ** rng.uniform(-4.0, 0.0)
    return {
        "scene": 1,
        "title": f"random layer {seed}",
        "materials": {"steel": {"youngs_modulus": "210 GPa", "poisson_ratio": 0.3, "density": "7850 kg/m3"}},
        "pairs": [
            {
                "between": ["steel", "steel"],
                "friction": rng.choice((0.0, 0.05, 0.3, 0.6, 1.0)),
                "restitution": rng.choice((0.1, 0.3, 0.6, 0.9)),
            }
        ],
        "debris": [_debris(rng, count, seed)],
        "domain": {"size": [f"{side!r} m", f"{side!r} m"]},
        "plates": {"lower": {"material": "steel"}, "upper": _upper_plate(rng, load, speed, distance)},
        "contact": {"level": rng.choice(("coulomb", "mindlin", "mdr", "exact"))},
        "effects": {"gravity": ["0 m/s2", "0 m/s2", "-9.81 m/s2"]} if rng.random() < 0.3 else {},
        "solver": {"integrator": "implicit", "duration": f"{distance / speed!r} s"},
        "output": {"every": f"{distance / speed / 8.0!r} s"},
    }


def _debris(rng: Random, count: int, seed: int) -> dict[str, Any]:
    """Balls, pairs of spheres, or irregular clumps."""
    table: dict[str, Any] = {"material": "steel", "count": count, "seed": seed, "placement": "layer"}
    kind = rng.choice(("ball", "pair", "irregular", "irregular"))
    if kind == "irregular":
        size = {"distribution": "lognormal", "median": f"{2.0 * RADIUS!r} m", "sigma": 0.2}
        return table | {"kind": "irregular", "size": size, "spheres": [3, rng.randint(3, 8)], "aspect": [1.0, 0.8, 0.6]}
    if kind == "ball":
        return table | {"kind": "spheres", "radius": f"{RADIUS!r} m"}
    radius = f"{0.6 * RADIUS!r} m"
    shape = [{"center": [f"{0.9 * RADIUS * i!r} m", "0 m", "0 m"], "radius": radius} for i in range(2)]
    return table | {"kind": "spheres", "shape": shape}


def _upper_plate(rng: Random, load: float, speed: float, distance: float) -> dict[str, Any]:
    """A support and a motion: one way, or two strokes."""
    support = rng.choice(("load_per_particle", "load_per_particle", "rigid", "foundation"))
    plate: dict[str, Any] = {"material": "steel", "support": support, "load": f"{load!r} N"}
    if support == "foundation":
        plate["stiffness"] = f"{load / RADIUS * 10.0 ** rng.uniform(0.0, 2.0)!r} N/m"
    drag: dict[str, Any] = {"velocity": f"{speed!r} m/s"}
    if rng.random() < 0.3:
        drag = {"stroke": f"{distance / 4.0!r} m", "frequency": f"{2.0 * speed / distance!r} Hz"}
    return plate | {"motion": {"x": drag}}
