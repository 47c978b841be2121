"""Heat in the check of a scene: how far friction heats a spot, told where nothing measures it and it would matter."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

from thirdbody.laws.contract import Material
from thirdbody.report.expected_spots import expected_spots

if TYPE_CHECKING:
    from thirdbody.assembly.simulation import Simulation

HOT = 100.0
"""Flash temperature [K] from which on a scene is warned: tempered steel softens from some 200 K above room on, oils crack."""

CONDUCTIVITY, CAPACITY = 50.0, 460.0
"""Thermal conductivity [W/(m K)] and heat capacity [J/(kg K)] of a material that has none: those of carbon steel."""

MEASURE = "flash_temperature"


class Heat(NamedTuple):
    """Temperature rise of a spot [K], its Peclet number, names of both materials, whether thermal values are assumed."""

    excess: float
    peclet: float
    pair: str
    assumed: bool


def expected_heat(built: Simulation) -> Heat | None:
    """Return the heat of the hottest pair: a sphere of median radius that slides at the top speed under the expected load.

    T = mu N v/(4 a (k_1 + k_2)): Holm 1948; Archard 1959, Wear 2, 438, Eq. 2, for slow sources; the Peclet number is
    v a/(2 kappa) of the slower side. None where no load or no speed is known.
    """
    speed, spots = built.schedule.top_speed(), expected_spots(built)
    if spots is None or not 0.0 < speed < math.inf:
        return None
    a, heats = spots.contact_radius, []
    for pair, load in zip(built.choice.pairs, spots.loads, strict=True):
        both = sum(m.thermal_conductivity or CONDUCTIVITY for m in (pair.a, pair.b))
        assumed = any(m.thermal_conductivity is None or m.heat_capacity is None for m in (pair.a, pair.b))
        peclet = 0.5 * speed * a / min(_diffusivity(pair.a), _diffusivity(pair.b))
        heats.append(Heat(pair.friction * load * speed / (4.0 * a * both), peclet, f"{pair.a.name}/{pair.b.name}", assumed))
    return max(heats)


def heat_warnings(built: Simulation) -> list[str]:
    """Return a warning where spots would get hot and no measure of the scene tells how hot."""
    heat = expected_heat(built)
    if heat is None or heat.excess < HOT or any(measure.name == MEASURE for measure in built.choice.measures):
        return []
    values = "with the conductivity of steel where the scene gives none" if heat.assumed else "by the conductivities given"
    return [
        f"friction heats a spot of {heat.pair} by some {heat.excess:.0f} K at the top speed, {values} (slow source; Peclet "
        f"number {heat.peclet:.2g}): measures.{MEASURE} tells it per contact; properties stay as they are"
    ]


def _diffusivity(material: Material) -> float:
    """Return the thermal diffusivity k/(rho c) [m2/s], with assumed values where the material has none."""
    return (material.thermal_conductivity or CONDUCTIVITY) / (material.density * (material.heat_capacity or CAPACITY))
