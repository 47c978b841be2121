"""An ensemble of bodies that do not influence each other, and what two of its runs have in common."""

from shared_runs import PATH, PLATES, clumps
from trajectories import contents
import thirdbody

SCENE = clumps(7, '["300 um", "200 um"]') + PLATES + '[contact]\ndebris_contact = "none"\n'
SCENE += PATH.replace("0.1 um", "0.05 um").replace("0.4 um", "0.1 um")

SURFACE = {"rms": "20 nm", "hurst": 0.8, "long": "100 um", "short": "10 um", "seed": 3}
ROUGH = {
    "debris.0.count": 520, "debris.0.spheres": [3, 3], "domain.size": ["500 um"] * 2, "solver.integrator": "explicit",
    "solver.settle": "10 ns", "solver.distance": "0.3 um", "plates.upper.motion.x.velocity": "10 m/s", "output.every": "0.1 um",
    "plates.lower.surface": SURFACE, "plates.upper.surface": SURFACE | {"seed": 4},
}  # fmt: skip
"""More than a group of 512 bodies between rough plates, in a few hundred explicit steps. Bodies that do not see each other may
overlap: a small domain has few heights."""


def scene(**changes):
    given = thirdbody.Scene.parse(SCENE)
    return given.with_settings(changes) if changes else given


def arrays(run):
    return contents(run, scene=True)
