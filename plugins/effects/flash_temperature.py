"""Flash temperature, a measure: how far friction heats a contact above the bulk of its two bodies.

A circular source of heat Q on a half-space heats it by about Q/(4 a k), with the contact radius a and the thermal conductivity k,
as long as heat spreads faster than the source moves. Heat divides so that both sides have the same temperature:
T = Q/(4 a (k_1 + k_2)), with Q = mu N v where the contact slips throughout. The range is told by the Peclet number v a/(2 kappa)
with the diffusivity kappa of the slower side: well below 1 the formula holds, above 5 the contact is a fast source and is cooler.
"""

from typing import NamedTuple

from thirdbody.plugin import Amount, Material, Measure, Options, Pair, Plugin, kernel

SLOW, FAST = 1.0, 5.0
"""Peclet numbers between which a source is neither slow nor fast (Jaeger 1942; Johnson, Contact Mechanics, 12.3)."""


class HeatParameters(NamedTuple):
    """Sum of the conductivities [W/(m K)], and the smaller diffusivity [m2/s]."""

    conductivity: float
    diffusivity: float


@kernel
def flash_temperature(s, p):
    """Return the temperature rise [K] for its mean, again for its maximum, and the Peclet number. T = Q/(4 a (k_1 + k_2)): Holm
    1948; Archard 1959, Wear 2, 438, Eq. 2 (slow); Q = T v is the power of the tangential force."""
    a = s.contact_radius
    excess = s.force * s.speed / (4.0 * a * p.conductivity) if a > 0.0 else 0.0
    return excess, excess, 0.5 * s.speed * a / p.diffusivity


def diffusivity(material: Material) -> float:
    """Return the thermal diffusivity k/(rho c) [m2/s]."""
    assert material.thermal_conductivity is not None and material.heat_capacity is not None  # `Measure.materials`
    return material.thermal_conductivity / (material.density * material.heat_capacity)


def mix_heat(pair: Pair, _options: Options) -> HeatParameters:
    """Return the parameters of a pair; nothing is averaged: heat flows into both sides."""
    assert pair.a.thermal_conductivity is not None and pair.b.thermal_conductivity is not None
    both = pair.a.thermal_conductivity + pair.b.thermal_conductivity
    return HeatParameters(both, min(diffusivity(pair.a), diffusivity(pair.b)))


def peclet_warnings(largest: dict[str, float]) -> list[str]:
    """Return a warning where contacts slid too fast for the formula; `largest`: over all bodies."""
    peclet = largest["peclet_number"]
    if peclet <= SLOW:
        return []
    also = "a fast source, whose temperature rise is smaller" if peclet > FAST else "between a slow source and a fast one"
    return [f"flash_temperature holds for slow sources, Peclet numbers below {SLOW:g}; the largest was {peclet:.2g}: {also}"]


FLASH_TEMPERATURE = Measure(
    name="flash_temperature",
    kernel=flash_temperature,
    parameters=HeatParameters,
    mix=mix_heat,
    amounts=(
        Amount("flash_temperature_mean", "K", "Mean temperature rise of its contacts by friction, over the drag.", "mean"),
        Amount("flash_temperature", "K", "Largest temperature rise of its contacts by friction since the start.", "maximum"),
        Amount("peclet_number", "1", "Largest Peclet number of its contacts since the start.", "maximum"),
    ),
    materials=("thermal_conductivity", "heat_capacity"),
    warnings=peclet_warnings,
    source="Holm 1948; Archard 1959, Wear 2, 438: slow sources",
)  # fmt: skip

PLUGIN = Plugin(name="flash_temperature", measures=(FLASH_TEMPERATURE,), source="heat of sliding")
