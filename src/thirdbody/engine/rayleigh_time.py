"""Rayleigh time of a sphere; a module apart, since the bound of the time step compiles kernels."""

import math

from thirdbody.laws.contract import Material

RAYLEIGH_FRACTION = 0.2
"""Time step over Rayleigh time; a Hertz collision at 1 m/s then takes some 30 steps (0.1 to 0.3 is usual in DEM)."""


def rayleigh_time(radius: float, material: Material) -> float:
    """Return the time [s] of a Rayleigh wave around a sphere: pi R sqrt(rho/G)/(0.1631 nu + 0.8766)."""
    speed = 0.1631 * material.poisson_ratio + 0.8766
    return math.pi * radius * math.sqrt(material.density / material.shear_modulus) / speed
