"""The explicit time step: bounded by the current contact stiffness, capped by a fraction of the Rayleigh time."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..kernels import layout as at
from ..kernels.stability import frequencies
from ..laws.contract import Material
from .state import State

RAYLEIGH_FRACTION = 0.2
"""Share of the Rayleigh time used: a Hertz collision at 1 m/s then takes some 30 steps (the usual DEM choice is 0.1 to 0.3)."""

STABILITY_FRACTION = 0.2
"""Share of the stability limit 2/omega used: the frequency error of velocity Verlet is then (omega dt)^2/24 = 0.7 %.
Halving it changes the friction curve of the main scene by less than 1e-5 and doubles its time."""


@dataclass(frozen=True)
class Bound:
    """A time step and what limits it: `mechanism` is rayleigh, translation, rotation or patch, `body` the particle."""

    step: float
    mechanism: str
    body: int
    stability: float  # 2/omega_max, s; infinite when nothing touches
    rayleigh: float  # s


def rayleigh_time(radius: float, material: Material) -> float:
    """Time of a Rayleigh wave around a sphere, s: pi R sqrt(rho/G)/(0.1631 nu + 0.8766) (physics: time step)."""
    speed = 0.1631 * material.poisson_ratio + 0.8766
    return math.pi * radius * math.sqrt(material.density / material.shear_modulus) / speed


def bound(state: State, materials: list[Material]) -> Bound:
    """The automatic time step at this instant."""
    times = np.array([rayleigh_time(1.0, m) for m in materials])[state.material] * state.rayleigh_radius
    slowest = int(np.argmin(times))
    rayleigh = float(times[slowest])
    best = Bound(RAYLEIGH_FRACTION * rayleigh, "rayleigh", slowest, math.inf, rayleigh)
    if state.physics.stiffness is None:
        return best
    omega, patches = np.zeros((state.n_bodies, 3)), np.zeros(len(state.P))
    slots, physics = state.slots, state.physics
    l_x, l_y = max(state.D[at.D_LX], 0.0), max(state.D[at.D_LY], 0.0)
    frequencies(
        slots.count, slots.own, slots.partner, slots.kind, state.body, state.S, state.B, state.P, physics.pairs,
        l_x, l_y, physics.stiffness, omega, patches,
    )  # fmt: skip
    body, patch = int(np.argmax(omega[:, 0])), int(np.argmax(patches))
    highest = max(float(omega[body, 0]), float(patches[patch]))
    if highest <= 0.0:
        return best
    limit = 2.0 / math.sqrt(highest)
    if STABILITY_FRACTION * limit >= best.step:
        return Bound(best.step, "rayleigh", slowest, limit, rayleigh)
    if patches[patch] > omega[body, 0]:
        owner = int(np.argmax(state.patch == patch))
        return Bound(STABILITY_FRACTION * limit, "patch", owner, limit, rayleigh)
    mechanism = "rotation" if omega[body, 2] > omega[body, 1] else "translation"
    return Bound(STABILITY_FRACTION * limit, mechanism, body, limit, rayleigh)
