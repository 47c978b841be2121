"""Implicit integrator with contact between bodies that carry one plate together: rigid, or with a foundation.

As in `ImplicitIslands`, islands are found after every stride of the drag; as in `ImplicitCommonPlate`, all bodies share their
steps, and one equation for the plate remains. A contact that was missed returns all bodies, and the plate, to the start of the
stride.
"""

from collections.abc import Callable
from typing import Any

import numpy as np

from thirdbody.engine.expected_islands import MARGIN
from thirdbody.engine.implicit_common_plate import ImplicitCommonPlate
from thirdbody.engine.implicit_islands import ImplicitIslands
from thirdbody.engine.neighbours import search_pairs
from thirdbody.engine.state import Array, State
from thirdbody.jit.threads import distribute
from thirdbody.kernels.bundles import Motion
from thirdbody.kernels.implicit import common_plate_islands as kernel
from thirdbody.kernels.implicit.tables import body_solution


class ImplicitCommonPlateIslands(ImplicitIslands, ImplicitCommonPlate):
    """`ImplicitCommonPlate` for a state whose bodies have contact with each other."""

    def __init__(self, state: State, *arguments: Any, **options: Any) -> None:
        super().__init__(state, *arguments, **options)
        self._packed_tables = np.zeros(0, np.int64)

    def _until(self, until: float) -> float:
        """As `ImplicitIslands._until`, but no stop is added where no bodies are near each other now."""
        sooner = super()._until(until)
        return sooner if sooner < until and len(search_pairs(self.state, MARGIN * self.stride)[0]) else until

    def _advance_all(self, until: float, watch: Callable[[], None], between: Callable[[], None]) -> None:
        ImplicitCommonPlate._advance_to(self, until, watch, between)

    def _connect(self) -> None:
        super()._connect()
        self._packed_tables = self._pack_tables(self.islands.tables)
        self.solutions[:, body_solution.IN_ISLAND] = self.islands.member

    def _solve_bodies(self, step: tuple[bool, float, Motion], context: Array) -> None:
        super()._solve_bodies(step, context)
        parts, tables = range(self.islands.parts if self.islands.count else 0), self._packed_tables
        distribute(parts, lambda: lambda part: kernel.solve_islands(part, *step, context, tables))

    def _accept_bodies(self, step: tuple[float, bool, int, Motion], context: Array) -> None:
        super()._accept_bodies(step, context)
        parts, tables = range(self.islands.parts if self.islands.count else 0), self._packed_tables
        distribute(parts, lambda: lambda part: kernel.accept_islands(part, *step, context, tables))

    def _tables(self) -> dict[str, Array]:
        return super()._tables() | {"plate": self.plate, "plate_memory": self.plate_memory}

    def _put_back(self, bodies: np.ndarray) -> None:
        for name, table in self._tables().items():
            table[:] = self._saved[name]
        self._begin_paths(np.ones(self.state.n_spheres, bool))
        self._deposits = []
