"""Bodies before they move: shapes, materials, initial positions and velocities."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from thirdbody.bodies.clump import Clump
from thirdbody.engine.candidates import Array, Ints
from thirdbody.kernels.bodies import BODIES
from thirdbody.kernels.explicit.contact_forces import GROUP


class _Reordered(Sequence[Clump]):
    """Lazy view of clumps in another order; the clumps may be generated on access."""

    def __init__(self, clumps: Sequence[Clump], order: Ints) -> None:
        self.clumps, self.order = clumps, order.tolist()

    def __len__(self) -> int:
        return len(self.order)

    def __getitem__(self, k: Any) -> Any:
        return [self.clumps[b] for b in self.order[k]] if isinstance(k, slice) else self.clumps[self.order[k]]


@dataclass(frozen=True)
class Placed:
    """Initial state of bodies: centres of mass (n, 3), quaternions (n, 4) body to world, velocities (n, 3)."""

    clumps: Sequence[Clump]
    densities: Array
    materials: Ints
    populations: Ints
    positions: Array
    quaternions: Array
    velocities: Array
    angular_velocities: Array

    def reordered(self, order: Ints) -> Placed:
        if np.array_equal(order, np.arange(len(order))):
            return self
        return Placed(
            _Reordered(self.clumps, order), self.densities[order], self.materials[order], self.populations[order],
            self.positions[order], self.quaternions[order], self.velocities[order], self.angular_velocities[order],
        )  # fmt: skip

    def sides(self) -> Ints:
        given = [np.zeros(len(c.radii), np.int64) if c.sides is None else c.sides for c in self.clumps]
        return np.concatenate(given)


ONE_GROUP = BODIES * GROUP  # number of bodies up to which all form one group and keep their order
WIDTH = 1.25  # width of a column of the grid over the mean diameter of the bodies


def in_columns(positions: Array, diameter: float) -> Ints:
    """Return a spatial order (n,) of bodies of a mean `diameter` [m]: columns of a square grid follow a Morton curve, which keeps
    neighbouring columns close (Morton 1966); upwards in each column."""
    if len(positions) <= ONE_GROUP:
        return np.arange(len(positions))
    cells = np.floor((positions[:, :2] - positions[:, :2].min(axis=0)) / (WIDTH * diameter)).astype(np.int64)
    curve = _interleave_zeros(cells[:, 0]) | _interleave_zeros(cells[:, 1]) << 1
    return np.lexsort((positions[:, 2], curve))


def _interleave_zeros(numbers: Ints) -> Ints:
    """Move bit k of numbers below 2^31 to bit 2 k."""
    numbers = np.minimum(numbers, 2**31 - 1)
    for shift, mask in ((16, 0x0000FFFF0000FFFF), (8, 0x00FF00FF00FF00FF), (4, 0x0F0F0F0F0F0F0F0F), (2, 0x3333333333333333),
                        (1, 0x5555555555555555)):  # fmt: skip
        numbers = (numbers | numbers << shift) & mask
    return numbers
