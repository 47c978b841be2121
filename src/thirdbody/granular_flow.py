"""Flow of granular beds: median diameter, what counts as slow shear, and friction against the inertial number.

The inertial number is I = shear rate * d * sqrt(density / pressure), d the diameter (GDR MiDi 2004, Eur. Phys. J. E 14, 341).
"""

import math

import numpy as np

from thirdbody.units import quantity_text

LAYERS = 3.0  # height over the median diameter from which debris is a bed with an inside, not a layer or two
# mu(I) = mu_s + INCREASE/(SCALE/I + 1), glass beads (Jop, Forterre and Pouliquen 2006, Nature 441, 727).
INCREASE, SCALE = 0.26, 0.28
# Inertial number up to which a bed counts as quasi-static, and up to which nearly: friction rises by 0.001 and 0.01.
SLOW, FAST = 1e-3, 1e-2


def median_by_mass(diameters: np.ndarray, masses: np.ndarray) -> float:
    """Return the diameter below which half the mass lies (d50 of a sieve curve) [m]."""
    order = np.argsort(diameters, kind="stable")
    below = np.cumsum(masses[order])
    return float(diameters[order][np.searchsorted(below, 0.5 * below[-1] * (1.0 - 1e-12))])


def inertial_number(shear_rate: float, diameter: float, density: float, pressure: float) -> float:
    """Return I, the shear rate times the time in which the pressure moves a body by its diameter; infinite without pressure."""
    return shear_rate * diameter * math.sqrt(density / pressure) if pressure != 0.0 else math.inf


def softness(modulus: float, pressure: float) -> float:
    """Return kappa = (E*/P)^(2/3), infinite without pressure; its inverse is of the order of the overlaps over the radius.

    Source: Agnolin and Roux, Phys. Rev. E 76, 2007, 061304 (their stiffness level, with E* for E).
    """
    return (modulus / pressure) ** (2.0 / 3.0) if pressure != 0.0 else math.inf


def friction_increase(number: float) -> float:
    """Return by how much an inertial number raises the friction coefficient, by mu(I) of glass beads."""
    return INCREASE * number / (SCALE + number)


def inertia_verdict(number: float) -> str:
    """Return whether shear at this inertial number is slow, in words."""
    number_text, increase = quantity_text(number, "", 2), quantity_text(max(friction_increase(number), 1e-4), "", 1)
    if number <= SLOW:
        return f"quasi-static: I = {number_text}, friction within {increase} of its slow limit"
    if number <= FAST:
        return f"nearly quasi-static: I = {number_text} raises friction by about {increase}"
    return f"not quasi-static: I = {number_text} raises friction by about {increase}"
