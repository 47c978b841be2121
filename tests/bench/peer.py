"""What the fastest C++ peer needs for the same sliding, from its measured cost of a sphere and step.

The next one, LAMMPS (22 Jul 2025, pair style granular), took 83 ns on the same scene and machine as the figure below, YADE
2023.02a 488. The peer's clumps had 2 contacts with the plates each at first and .5 to 1 later; ours carry a load each, on 3 to 4
contacts: the comparison favours the peer.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from ensemble import PATH, Case, scene_of

from thirdbody.engine.rayleigh_time import rayleigh_time
from thirdbody.runner.simulate import prepare

NAME, NS_PER_SPHERE_STEP, FRACTION = "LIGGGHTS 3.8.0", 58.0, 0.18

SOURCE = (
    "LIGGGHTS 3.8.0 (Debian 12), fix rigid, Hertz with tangential history: 2000 steel clumps of 4 to 8 spheres (12092 in all), "
    "friction .3, restitution .6, pinched between two plates, no contact between clumps, upper plate .5 m/s, time step .18 "
    "Rayleigh times of the smallest sphere; 58 ns per sphere and step (median; best 54) on one shared core of a virtual server "
    "(AMD Zen 5), where the same run varied by up to 1.8"
)


@dataclass(frozen=True)
class Peer:
    """A peer by its cost of a sphere and step, ns, and its time step in Rayleigh times of the smallest sphere."""

    name: str = NAME
    nanoseconds: float = NS_PER_SPHERE_STEP
    fraction: float = FRACTION

    @property
    def source(self) -> str:
        """Where the figure comes from."""
        ours = (self.name, self.nanoseconds, self.fraction) == (NAME, NS_PER_SPHERE_STEP, FRACTION)
        return SOURCE if ours else f"{self.name}: {self.nanoseconds:g} ns per sphere and step, given on the command line"

    def seconds(self, ensemble: dict[str, float], speed: float, step: float) -> float:
        """Seconds per particle for the way at a speed, m/s, in time steps of `step` seconds."""
        return 1e-9 * self.nanoseconds * ensemble["spheres_per_particle"] * PATH / speed / step

    def rows(self, ensemble: dict[str, float], steps: dict[float, float]) -> list[dict[str, Any]]:
        """Results of the peer: with the time step that it is run with, and with that of our explicit engine at each speed, s."""
        own = self.fraction * ensemble["rayleigh_of_smallest_sphere"]
        rules = {f"{self.fraction:g} Rayleigh": dict.fromkeys(steps, own), "our explicit step": steps}
        return [
            {
                "engine": f"{self.name}, {rule}",
                "speed": speed,
                "seconds_per_particle": {"median": self.seconds(ensemble, speed, step), "spread": None},
                "time_step": step,
            }
            for rule, taken in rules.items()
            for speed, step in taken.items()
        ]


def ensemble_of(bodies: int) -> dict[str, float]:
    """Spheres per particle of the ensemble and the Rayleigh time of its smallest sphere, s."""
    simulation = prepare(scene_of(Case("implicit", "mindlin", 1.0, bodies)))
    state, materials = simulation.state, simulation.choice.materials
    unit = np.array([rayleigh_time(1.0, material) for material in materials])[state.material[state.body]]
    return {
        "bodies": bodies,
        "spheres_per_particle": state.n_spheres / state.n_bodies,
        "rayleigh_of_smallest_sphere": float((unit * state.spheres.radius).min()),
    }
