"""Profiles: means of the debris in slabs between the plates, over an output interval.

Everything is added up slab by slab, over the bodies and over time, and divided at the end:

* A sphere counts in a slab with the part of its volume that lies there. The volume of a clump, whose spheres overlap, is spread
  over them in proportion to theirs.
* The velocity is that of the matter in the slab: of a sphere cut by a plane, rotation included.
* Spin, contacts and states of a body have the weight of its volume in the slab.
* The contact stress is sum f_a l_b / volume (J. Christoffersen, M. M. Mehrabadi, S. Nemat-Nasser, J. Appl. Mech. 48:339, 1981):
  force f on a body and branch l from the centre of mass of the other one over the contact point to its own, with the part of both
  lines that lies in the slab; at a plate the branch begins at the contact point. Pressure is positive. Where nothing is
  accelerated, the components xz, yz, zz in every slab, times the area of the plates, are the force between the plates.
* The kinetic stress is sum m (v - u)_a (v - u)_b / volume: velocities of the bodies less their mean u in the slab over the
  interval. The stress of the debris is the sum of both.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from thirdbody.engine.state import State
from thirdbody.kernels.tables import DEBRIS, domain, patch

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
AXES = "xyz"

CHUNK = 1 << 20
"""Numbers in a temporary array of spheres or contacts by slabs: 8 MB."""

SPACE, VOLUME, VELOCITY, SPIN, CONTACTS, FORCE, MASS, MOMENTUM, FLUX, STATES = 0, 1, 2, 5, 8, 9, 18, 19, 22, 31
"""First columns of the sums: volume of the slab, of debris in it, and this times the others; contact stress times volume; mass,
momentum, and its flux; states."""


@dataclass(frozen=True)
class Slabs:
    """Slabs of equal thickness from `start` to `end` [m]; if `periodic`, the last is followed by the first."""

    start: float
    end: float
    count: int
    periodic: bool = False

    def images(self, position: Array) -> tuple[Array, ...]:
        """Return positions for every image that can reach the slabs: themselves, or wrapped ones and their neighbours."""
        if not self.periodic:
            return (position,)
        period = self.end - self.start
        wrapped = self.start + np.mod(position - self.start, period)
        return wrapped, wrapped - period, wrapped + period

    def touched(self, low: Array, high: Array) -> tuple[Ints, Ints]:
        """Return every pair of an interval and a slab that it touches: number of the interval `low` to `high` [m], and slab."""
        thickness = (self.end - self.start) / self.count
        first, last = (np.clip(np.floor((x - self.start) / thickness), 0, self.count - 1) for x in (low, high))
        number = np.where((high < self.start) | (low >= self.end), 0, last - first + 1).astype(np.int64)
        row = np.repeat(np.arange(len(low)), number)
        before = np.cumsum(number) - number
        return row, first.astype(np.int64)[row] + np.arange(len(row)) - before[row]

    def planes(self, slab: Ints) -> tuple[Array, Array]:
        """Return the positions of the planes below and above slabs [m]."""
        thickness = (self.end - self.start) / self.count
        below = self.start + slab.astype(np.float64) * thickness
        return below, below + thickness


class Parts(NamedTuple):
    """Parts of things in slabs: number of the thing, slab, and how much of it lies there."""

    thing: Ints
    slab: Ints
    amount: Array


def sphere_parts(slabs: Slabs, centres: Array, radii: Array) -> tuple[Parts, Array]:
    """Return the volumes of spheres in the slabs that they touch [m3], and their first moments about the centres [m4].

    `centres` (n,): positions across the slabs [m]. A sphere of radius R has the cross section pi (R^2 - h^2) at the height h
    above its centre, so that below h lie the volume pi (R^2 h - h^3/3 + 2 R^3/3) and the moment pi (R^2 h^2/2 - h^4/4 - R^4/4).
    What lies outside all slabs is left out. In a periodic domain a sphere is thinner than the period.
    """
    parts, moments = [], []
    for centre in slabs.images(centres):
        row, slab = slabs.touched(centre - radii, centre + radii)
        R = radii[row]
        low, high = (np.clip(plane - centre[row], -R, R) for plane in slabs.planes(slab))
        volume = math.pi * (high - low) * (R**2 - (high**2 + high * low + low**2) / 3.0)
        parts.append(Parts(row, slab, volume))
        moments.append(math.pi * (high**2 - low**2) * (R**2 / 2.0 - (high**2 + low**2) / 4.0))
    return _joined(parts), np.concatenate(moments)


def line_parts(slabs: Slabs, starts: Array, changes: Array) -> Parts:
    """Return the fractions of straight lines in the slabs that they touch.

    `starts` (n,): positions of one end across the slabs [m]; `changes` (n,): to the other end. A line without extent across the
    slabs lies in one of them.
    """
    parts, length = [], np.abs(changes)
    for begin in slabs.images(np.minimum(starts, starts + changes)):
        row, slab = slabs.touched(begin, begin + length)
        low, high = (np.clip(plane - begin[row], 0.0, length[row]) for plane in slabs.planes(slab))
        parts.append(Parts(row, slab, np.divide(high - low, length[row], out=np.ones(len(row)), where=length[row] > 0.0)))
    return _joined(parts)


def _joined(parts: list[Parts]) -> Parts:
    return Parts(*(np.concatenate(arrays) for arrays in zip(*parts, strict=True)))


@dataclass(frozen=True, eq=False)
class Profiler:
    """Sampler of profiles (`interval_means`).

    `axis`: 0, 1, 2 for x, y, z; `labels`: function that returns the state codes of all bodies (n,), None without a labeller;
    `states`: their names.
    """

    bins: int
    axis: int = 2
    labels: Callable[[], Array] | None = None
    states: Sequence[str] = ()

    def __call__(self, state: State) -> Array:
        """Return the sums over all bodies and contacts now, (bins, STATES + number of states). Contacts must have records."""
        upper, (length, width) = state.world.upper, state.world.size
        assert upper is not None
        height = float(np.max(state.P[: len(upper.heights), patch.HEIGHT]))
        extent = (length, width, height)[self.axis]
        slabs = Slabs(0.0, extent, self.bins, self.axis < 2 and state.D[domain.LENGTH_X + self.axis] > 0.0)
        sums = np.zeros((self.bins, STATES + len(self.states)))
        sums[:, SPACE] = length * width * height / self.bins
        self._add_bodies(state, slabs, sums)
        self._add_contacts(state, slabs, sums)
        return sums

    def profiles(self, sums: Array, state: State) -> dict[str, Array]:
        """Return the profiles, by the names of `names.PROFILES`, of sums or their mean over time: arrays (bins, ...).

        What is an average over the debris is NaN in a slab without any.
        """
        space, volume, area = sums[:, SPACE], sums[:, VOLUME], float(np.prod(state.world.size))
        extent = (*state.world.size, float(space.sum()) / area)[self.axis]
        mean = np.divide(sums, volume[:, None], out=np.full_like(sums, np.nan), where=volume[:, None] > 0.0)
        mass, momentum = sums[:, MASS, None, None], sums[:, MOMENTUM:FLUX]
        # flux of momentum by the mean motion of each slab
        carried = np.divide(momentum[:, :, None] * momentum[:, None, :], mass, out=np.zeros((len(sums), 3, 3)), where=mass > 0.0)
        result = {
            "position": (np.arange(self.bins) + 0.5) * extent / self.bins,
            "solid_fraction": volume / space if not np.any(state.side) else np.full(len(volume), np.nan),
            "velocity": mean[:, VELOCITY:SPIN],
            "angular_velocity": mean[:, SPIN:CONTACTS],
            "coordination_number": mean[:, CONTACTS],
            "contact_stress": sums[:, FORCE:MASS] / space[:, None],
            "kinetic_stress": (sums[:, FLUX:STATES] - carried.reshape(-1, 9)) / space[:, None],
        }
        return result | {f"fraction_{name}": mean[:, STATES + code] for code, name in enumerate(self.states)}

    def _add_bodies(self, state: State, slabs: Slabs, sums: Array) -> None:
        radii, body = state.spheres.radius, state.body
        total = np.bincount(body, radii**3, state.n_bodies)
        scale = (state.rayleigh_radius**3 / total)[body]  # so that the spheres of a clump have its volume together
        density = state.bodies.mass / (4.0 / 3.0 * np.pi * state.rayleigh_radius**3)
        v = state.bodies.velocity
        flux = (density[:, None, None] * v[:, :, None] * v[:, None, :]).reshape(len(v), 9)
        codes = () if self.labels is None else (self.labels()[:, None] == np.arange(len(self.states)),)
        slots = state.slots
        loaded = np.flatnonzero((slots.histories.slip > 0.0) & (slots.records.normal_force != 0.0))
        debris = loaded[slots.sides[loaded] == DEBRIS]
        touched = np.concatenate([body[slots.own[loaded]], body[slots.partner[debris]]])
        contacts = np.bincount(touched, minlength=state.n_bodies).astype(float)  # those with plates count
        per_body = np.column_stack([state.bodies.spin, contacts, density, density[:, None] * v, flux, *codes])
        across = np.zeros(3)
        across[self.axis] = 1.0
        for chunk in chunks(len(radii), self.bins):
            rows = body[chunk]
            parts, moment = sphere_parts(slabs, state.spheres.position[chunk, self.axis], radii[chunk])
            parts = parts._replace(amount=parts.amount * scale[chunk][parts.thing])
            moments = parts._replace(amount=moment * scale[chunk][parts.thing])
            spin = state.bodies.spin[rows]
            arm = state.spheres.position[chunk] - state.bodies.position[rows]
            add(sums[:, VOLUME:VELOCITY], parts, np.ones((len(rows), 1)))
            add(sums[:, VELOCITY:SPIN], parts, state.bodies.velocity[rows] + np.cross(spin, arm))
            add(sums[:, VELOCITY:SPIN], moments, np.cross(spin, across))
            add(sums[:, SPIN:FORCE], parts, per_body[rows, :4])
            add(sums[:, MASS:], parts, per_body[rows, 4:])

    def _add_contacts(self, state: State, slabs: Slabs, sums: Array) -> None:
        slots, position = state.slots, state.bodies.position[:, self.axis]
        on = np.flatnonzero(slots.histories.slip > 0.0)
        for chunk in chunks(len(on), self.bins):
            k = on[chunk]
            force = slots.records.normal_force[k, None] * slots.records.normal[k] + slots.records.tangential_force[k]
            self._add_lines(slabs, position[state.body[slots.own[k]]], slots.records.point[k], force, sums)
            debris = k[slots.sides[k] == DEBRIS]
            partner, back = state.body[slots.partner[debris]], -force[slots.sides[k] == DEBRIS]
            self._add_lines(slabs, position[partner], slots.records.partner_point[debris], back, sums)

    def _add_lines(self, slabs: Slabs, centres: Array, arms: Array, forces: Array, sums: Array) -> None:
        """Add forces on bodies times lines from the contact point to their centres of mass, which are `arms` (n, 3) before it."""
        products = (forces[:, :, None] * -arms[:, None, :]).reshape(-1, 9)
        add(sums[:, FORCE:MASS], line_parts(slabs, centres, arms[:, self.axis]), products)


def add(sums: Array, parts: Parts, values: Array) -> None:
    """Add values (things, columns) to the sums (bins, columns) of the slabs, times the amount of each thing there."""
    for column in range(sums.shape[1]):
        weights = parts.amount * values[:, column][parts.thing]
        sums[:, column] += np.bincount(parts.slab, weights, len(sums))


def chunks(rows: int, bins: int) -> list[slice]:
    """Return slices of rows that make temporary arrays of CHUNK numbers."""
    size = max(CHUNK // bins, 1)
    return [slice(first, first + size) for first in range(0, rows, size)]
