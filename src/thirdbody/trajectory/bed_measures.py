"""Measures of a bed at an output: how slowly it is sheared and in which band, how stiff, dense and close to equilibrium it is.

All come from what the last step computed and from the means over the output interval.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from thirdbody.engine.state import State
from thirdbody.granular_flow import LAYERS, inertial_number, median_by_mass, softness
from thirdbody.kernels.tables import DEBRIS, body, body_extra, record

Array = NDArray[np.float64]

CORE = 0.25
"""Largest fraction of the gap that is left out at each plate for the solid fraction."""


EDGE = 0.1
"""Fractions EDGE and 1 - EDGE of the velocity difference of the bed are reached at the edges of the shear zone."""


class BedMeasures:
    """Measures of the bed in a state. `modulus`: effective modulus E* of two of its bodies [Pa]."""

    def __init__(self, state: State, modulus: float) -> None:
        self.state, self.modulus = state, modulus
        self.mass, radius = state.bodies.mass, state.rayleigh_radius
        self.volume = 4.0 / 3.0 * np.pi * radius**3
        self.density = float(self.mass.sum() / self.volume.sum())
        self.median, self.largest = median_by_mass(2.0 * radius, self.mass), float(2.0 * radius.max())

    def series(self, P: float, velocities: Array, gap: float, elastic: float) -> dict[str, float]:
        """Return the measures by the names of their series; NaN where one is not defined.

        Means over the output interval: pressure P on the plates [Pa], velocities of the bodies (n, 3) [m/s]; the gap [m] and the
        elastic energy [J] now.
        """
        s, bed, number = self.state, gap >= LAYERS * self.median, math.nan
        v, heights, mass = s.bodies.velocity, s.bodies.position[:, 2], self.mass
        if bed and P > 0.0:
            zone = shear_zone(heights, velocities, mass, self.median)
            number = math.nan if zone is None else inertial_number(zone.rate, self.median, self.density, P)
        loaded = np.flatnonzero((s.slots.histories.slip > 0.0) & (s.slots.records.normal_force > 0.0))
        R, sides = s.slots.R[loaded], s.slots.sides[loaded]
        overlap = math.nan
        if len(loaded):
            radius, other = R[:, record.SPHERE_RADIUS], R[:, record.PARTNER_RADIUS]
            overlap = float(np.mean(R[:, record.OVERLAP] / np.where(other > 0.0, np.minimum(radius, other), radius)))
        v = v - np.average(v, axis=0, weights=mass)  # relative to the mean flow; in a layer, to the mean velocity
        v = v - _mean_flow(heights, v, mass) if bed else v
        spinning = np.sum(s.E[:, body_extra.ANGULAR_MOMENTUM3] * s.B[:, body.SPIN3])
        kinetic = 0.5 * float(mass @ np.sum(v**2, axis=1) + spinning)
        margin, (l_x, l_y) = min(self.largest, CORE * gap), s.world.size
        inside = self._volume_below(gap - margin) - self._volume_below(margin) if bed else np.zeros(0)
        return {
            "inertial_number": number,
            "inertial_number_largest": number * self.largest / self.median,
            "softness": softness(self.modulus, P) if P > 0.0 else math.nan,
            "overlap_ratio": overlap,
            "unbalanced_force": unbalanced_force(s, loaded),
            "kinetic_energy_ratio": kinetic / elastic if elastic > 0.0 else math.nan,
            "coordination_number": (len(sides) + np.count_nonzero(sides == DEBRIS)) / s.n_bodies,
            "solid_fraction": float(inside.sum() / (l_x * l_y * (gap - 2.0 * margin))) if bed else math.nan,
        }

    def _volume_below(self, height: float) -> Array:
        """Return the volume of each body below a height [m3]: of its whole volume the same fraction as of its spheres'."""
        s = self.state
        radius = s.spheres.radius
        depth = np.clip(height - s.spheres.position[:, 2] + radius, 0.0, 2.0 * radius)
        below = np.add.reduceat(depth**2 * (3.0 * radius - depth), s.start[:-1])
        return self.volume * below / np.add.reduceat(4.0 * radius**3, s.start[:-1])


def unbalanced_force(s: State, loaded: NDArray[np.int64]) -> float:
    """Return the mean total force on the bodies of loaded contacts, over the mean contact force; NaN without any."""
    if not len(loaded):
        return math.nan
    R, partner = s.slots.R[loaded], s.slots.partner[loaded]
    contact = np.hypot(R[:, record.NORMAL_FORCE], np.linalg.norm(R[:, record.TANGENTIAL_FORCE3], axis=1))
    carrying = np.union1d(s.body[s.slots.own[loaded]], s.body[partner[partner >= 0]])
    return float(np.linalg.norm(s.B[carrying, body.FORCE3], axis=1).mean() / contact.mean())


def _mean_flow(heights: Array, velocities: Array, masses: Array) -> Array:
    """Return the velocity (n, 3) [m/s] of a flow that rises with the height, nearest to these velocities."""
    trend = (masses * (heights - np.average(heights, weights=masses))) @ velocities[:, :2]
    size = float(np.linalg.norm(trend))
    flow = np.zeros_like(velocities)
    if size > 0.0:
        order = np.argsort(heights, kind="stable")
        along = rising_profile(velocities[order, :2] @ trend / size, masses[order])
        flow[order, :2] = along[:, None] * (trend / size)
    return flow


class ShearZone(NamedTuple):
    """Shear rate [1/s], and the heights of the zone's edges above the lower plate [m]."""

    rate: float
    bottom: float
    top: float


def shear_zone(heights: Array, velocities: Array, masses: Array, diameter: float) -> ShearZone | None:
    """Return the shear zone of bodies at heights (n,) [m] with velocities (n, 3) [m/s]; None where all lie in one layer.

    The bed shears by the difference between the mean velocities of its lowest and its highest layer, one `diameter` [m] thick.
    The edges of the zone are where a profile that does not fall reaches the fractions EDGE and 1 - EDGE of it; the rate is the
    difference between the edges over their distance. A zone is at least a diameter thick: grains are not sheared themselves.
    """
    low, high = heights <= heights.min() + diameter, heights >= heights.max() - diameter
    if np.any(low & high):
        return None
    base = np.average(velocities[low, :2], axis=0, weights=masses[low])
    difference = np.average(velocities[high, :2], axis=0, weights=masses[high]) - base
    size = float(np.linalg.norm(difference))
    if size == 0.0:
        return ShearZone(0.0, float(heights.min()), float(heights.max()))
    order = np.argsort(heights, kind="stable")
    along = (velocities[order, :2] - base) @ (difference / size)
    profile = rising_profile(along, masses[order])
    bottom, top = (_height_of(fraction * size, profile, heights[order]) for fraction in (EDGE, 1.0 - EDGE))
    within = 1.0 - 2.0 * EDGE
    return ShearZone(within * size / max(top - bottom, within * diameter), bottom, top)


def rising_profile(values: Array, weights: Array) -> Array:
    """Return the sequence (n,) that never falls and is nearest to `values` (n,) by weighted least squares."""
    from scipy.optimize import isotonic_regression

    return np.asarray(isotonic_regression(values, weights=weights).x, float)


def _height_of(value: float, profile: Array, heights: Array) -> float:
    """Return the height [m] at which a profile that does not fall reaches a value, linear between bodies."""
    k = int(np.searchsorted(profile, value))
    if k in (0, len(profile)):
        return float(heights[min(k, len(profile) - 1)])
    below, above = profile[k - 1], profile[k]
    return float(heights[k - 1] + (value - below) / (above - below) * (heights[k] - heights[k - 1]))
