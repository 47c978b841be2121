"""What contacts of a part of a run leave on the maps of the plates, kept until the run that joins the parts lays it down.

Sums of floats depend on their order. A whole implicit run lays deposits down batch of bodies after batch, and in a batch the
first steps of all bodies since the output, then the second ones, and so on. Each deposit is kept with both numbers, so that
joined ones come in that order.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

Array = np.ndarray

ROWS, STEPS = "deposit_rows", "deposit_steps"
"""Names in a snapshot: deposits, each behind its batch and step; steps of the bodies up to the last output."""


class PartDeposits:
    """Deposits since the last output. `first`: number of the first body; `steps` (n,): steps of bodies so far."""

    def __init__(self, first: int, batch: int, steps: Array, maps: int) -> None:
        self.first, self.batch, self.maps = first, batch, maps
        self.clear(steps)

    def clear(self, steps: Array) -> None:
        """Forget all, at an output."""
        from thirdbody.kernels.measures import AMOUNTS  # here as in `engine.measures`: a run without measures compiles none

        self.steps, self.rows = steps.copy(), np.zeros((0, 2 + AMOUNTS + self.maps))
        self._later: list[Array] = []

    def keep(self, deposits: Array, steps: Array) -> None:
        """Keep the deposits of a step of all bodies that made one."""
        from thirdbody.kernels.measures import BODY

        if len(deposits):
            bodies = deposits[:, BODY].astype(np.int64)
            batches, since = (bodies + self.first) // self.batch, steps[bodies] - self.steps[bodies]
            self._later.append(np.column_stack([batches, since, deposits]))

    def arrays(self) -> dict[str, Array]:
        """Return what a snapshot holds."""
        self.rows, self._later = np.concatenate([self.rows, *self._later]), []
        return {ROWS: self.rows, STEPS: self.steps}

    def restore(self, arrays: Mapping[str, Array]) -> None:
        """Restore what a snapshot holds. Raises KeyError."""
        self.clear(arrays[STEPS])
        self.rows = arrays[ROWS]


def joined_maps(maps: Array, parts: list[Array], size: tuple[float, float]) -> Array:
    """Return the maps at an output: those of the last one, and the deposits of all parts, in the order of a whole run."""
    from thirdbody.kernels.measures import deposit

    rows, result = np.concatenate(parts), maps.copy()
    ordered = rows[np.lexsort((rows[:, 1], rows[:, 0]))]  # stable: bodies stay in their order
    deposit(np.ascontiguousarray(ordered[:, 2:]), result, np.array(size, float))
    return result
