"""The explicit time step: bounded by the current contact stiffness, capped by a fraction of the Rayleigh time."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..kernels import layout as at
from ..kernels.stability import frequencies, matrices
from ..laws.contract import Material
from .state import Array, State

RAYLEIGH_FRACTION = 0.2
"""Share of the Rayleigh time used: a Hertz collision at 1 m/s then takes some 30 steps (the usual DEM choice is 0.1 to 0.3)."""

STABILITY_FRACTION = 0.2
"""Share used of 2/omega: the frequency error of velocity Verlet is then (omega dt)^2/24 = 0.7 %.
Halving it changes the friction curve of the main scene by less than 1e-5 and doubles its time."""

DAMPING_FRACTION = 0.7
"""Share used of the longest stable step with damping. It binds where the dashpots of many spots add up on one body, each scaled
for its own spot. Such a mode only creeps: what rings at the step itself loses 40 % each step here, so staying off the limit is
enough."""


@dataclass(frozen=True)
class Bound:
    """A time step and what limits it: `mechanism` is rayleigh, translation, rotation, damping or patch, `body` the particle."""

    step: float
    mechanism: str
    body: int
    stability: float  # the longest stable step, s; infinite when nothing touches
    rayleigh: float  # s


def rayleigh_time(radius: float, material: Material) -> float:
    """Time of a Rayleigh wave around a sphere, s: pi R sqrt(rho/G)/(0.1631 nu + 0.8766) (physics: time step)."""
    speed = 0.1631 * material.poisson_ratio + 0.8766
    return math.pi * radius * math.sqrt(material.density / material.shear_modulus) / speed


def stable_step(squared_frequency, rate):
    """Longest stable step, s, of oscillators x'' + rate x' + squared_frequency x = 0; infinite without both.

    Velocity Verlet with the velocity of the dashpot predicted from the force before: its amplification has the eigenvalue -1
    where (omega dt)^2/4 + rate dt = 1.
    """
    with np.errstate(divide="ignore"):
        return 2.0 / (rate + np.sqrt(rate * rate + squared_frequency))


def bound(state: State, materials: list[Material], steps: int, deepest: float) -> Bound:
    """The automatic time step for the next so many steps; overlaps over the radius are foreseen up to `deepest`."""
    times = np.array([rayleigh_time(1.0, m) for m in materials])[state.material] * state.rayleigh_radius
    slowest = int(np.argmin(times))
    rayleigh = float(times[slowest])
    named = state.order.tolist()
    best = Bound(RAYLEIGH_FRACTION * rayleigh, "rayleigh", named[slowest], math.inf, rayleigh)
    if state.physics.stiffness is None:
        return best
    bodies, patches = np.zeros((state.n_bodies, 4)), np.zeros((len(state.P), 2))
    slots, physics = state.slots, state.physics
    horizon = steps * (state.dt or best.step)
    l_x, l_y = max(state.D[at.D_LX], 0.0), max(state.D[at.D_LY], 0.0)
    frequencies(
        slots.count, slots.own, slots.partner, slots.kind, state.body, state.S, state.B, _pressed(state, horizon), physics.pairs,
        l_x, l_y, horizon, deepest, physics.stiffness, bodies, patches, *matrices(state.n_bodies),
    )  # fmt: skip
    of_bodies, of_patches = _steps(bodies[:, 0], bodies[:, 3]), _steps(patches[:, 0], patches[:, 1])
    body, patch = int(np.argmin(of_bodies)), int(np.argmin(of_patches))
    limit = float(min(stable_step(bodies[:, 0], bodies[:, 3]).min(), stable_step(patches[:, 0], patches[:, 1]).min()))
    if min(of_bodies[body], of_patches[patch]) >= best.step:
        return Bound(best.step, "rayleigh", named[slowest], limit, rayleigh)
    if of_patches[patch] < of_bodies[body]:
        owner = int(np.argmax(state.patch == patch))
        return Bound(float(of_patches[patch]), "patch", named[owner], limit, rayleigh)
    every, along, around, _ = bodies[body]
    by_frequency = STABILITY_FRACTION * stable_step(every, 0.0)
    mechanism = "damping" if of_bodies[body] < by_frequency else "rotation" if around > along else "translation"
    return Bound(float(of_bodies[body]), mechanism, named[body], limit, rayleigh)


def _pressed(state: State, horizon: float) -> Array:
    """The patches under the largest load until the bound is asked for next, whose steps may be a little longer."""
    upper = state.world.upper
    if upper is None or not upper.schedule.load:
        return state.P
    P = state.P.copy()
    largest = upper.schedule.largest_load(state.time, state.time + 1.5 * horizon)
    P[:, at.P_LOAD] = np.maximum(P[:, at.P_LOAD], largest * P[:, at.P_LOAD0])
    return P


def _steps(squared_frequency: Array, rate: Array) -> Array:
    """The steps to take for these oscillators, s."""
    still = np.zeros_like(rate)
    return np.minimum(
        STABILITY_FRACTION * stable_step(squared_frequency, still), DAMPING_FRACTION * stable_step(squared_frequency, rate)
    )
