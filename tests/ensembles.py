"""An ensemble of bodies that do not influence each other, and what two of its runs have in common."""

from pathlib import Path

from steel import STEEL
from trajectories import contents

import thirdbody

SCENE = f"""{STEEL}[[debris]]
material = "steel"
kind = "irregular"
count = 7
size = {{distribution = "lognormal", median = "10 um", sigma = 0.2, min = "5 um", max = "20 um"}}
spheres = [4, 8]
aspect = [1.0, 0.8, 0.6]
[domain]
size = ["300 um", "200 um"]
[plates.lower]
material = "steel"
[plates.upper]
material = "steel"
support = "load_per_particle"
load = "0.1 mN"
motion = {{x = {{velocity = "10 mm/s"}}}}
[contact]
debris_contact = "none"
[solver]
distance = "0.1 um"
[output]
every = "0.05 um"
"""

SURFACE = {"rms": "20 nm", "hurst": 0.8, "long": "100 um", "short": "10 um", "seed": 3}
ROUGH = {
    "debris.0.count": 520, "debris.0.spheres": [3, 3], "domain.size": ["500 um"] * 2, "solver.integrator": "explicit",
    "solver.settle": "10 ns", "solver.distance": "0.3 um", "plates.upper.motion.x.velocity": "10 m/s", "output.every": "0.1 um",
    "plates.lower.surface": SURFACE, "plates.upper.surface": SURFACE | {"seed": 4},
}  # fmt: skip
"""More than a group of 512 bodies between rough plates, in a few hundred explicit steps. Bodies that do not see each other may
overlap: a small domain has few heights."""


def scene(**changes: object) -> thirdbody.Scene:
    given = thirdbody.Scene.parse(SCENE)
    return given.with_settings(changes) if changes else given


def arrays(run: Path) -> dict[str, bytes]:
    return contents(run, scene=True)
