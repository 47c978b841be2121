"""Bodies before they move: shapes, materials, initial positions and velocities."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from thirdbody.bodies.clump import Clump

Array = NDArray[np.float64]
Ints = NDArray[np.int64]


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
        """Return the same bodies in another order."""
        if np.array_equal(order, np.arange(len(order))):
            return self
        return Placed(
            _Reordered(self.clumps, order), self.densities[order], self.materials[order], self.populations[order],
            self.positions[order], self.quaternions[order], self.velocities[order], self.angular_velocities[order],
        )  # fmt: skip

    def sides(self) -> Ints:
        """Return which plates and debris each sphere can touch (`columns.sides`)."""
        given = [np.zeros(len(c.radii), np.int64) if c.sides is None else c.sides for c in self.clumps]
        return np.concatenate(given)
