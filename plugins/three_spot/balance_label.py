"""State of every spot, label, reason and margins of a particle in balance, point by point along its path.

Label and reason are those of a run: `classify` evaluates the balances like the steps of a run. So a side slides when all its
spots are at the limit and have slipped by more than their critical displacement. Margins (positive = satisfied): those of
`classify`, and `friction_spots`, 1 - eta of each spot, eta = |T|/(mu N).
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from thirdbody.plugin import Balance, Grip, Labeller, StaticLabels

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

AT_LIMIT = {"mdr": 1e-3}
"""Smallest 1 - eta that is not the limit: the springs of `mdr` fall short of mu N by 4e-4."""
RING = {"mdr": 0.15}
"""Detectable loss of tangential stiffness, the width of the slip ring over a: `mdr` has 16 to 32 springs."""
SPATIAL_TOLERANCE = 0.02
"""The same in space, as in `classify`: springs of a contact that slid along a curved path differ slightly in direction."""
ROUNDING, ANNULUS = 1e-9, 1e-6


class Observer:
    """Labels one particle; call `update` for the pressed state first, then for every point of the drag."""

    def __init__(self, labeller: Labeller, grip: Grip, radius: Array, heading: tuple[float, float], level: str) -> None:
        self.labeller = labeller
        self.labels = StaticLabels(labeller, grip, radius, heading)
        self.limit = AT_LIMIT.get(level, ROUNDING) if grip.planar else SPATIAL_TOLERANCE
        self.ring = RING.get(level, ANNULUS)

    def update(self, point: Balance, grip: Grip) -> tuple[list[str], str, str, dict[str, Any]]:
        """Return (state of each spot, label, reason, margins) of the next point, computed with the spots at `grip`."""
        loaded = point.overlap > 0.0
        eta = utilisation(point, loaded)
        report = self.labels.update(point, grip)
        margins: dict[str, Any] = {name: report[name] for name in self.labeller.margins}
        margins["friction_spots"] = (1.0 - eta).tolist()
        state, reason = self.labeller.states[int(report["state"])], self.labeller.reasons[int(report["reason"])]
        return self._spots(point, loaded, eta), state, reason, margins

    def _spots(self, point: Balance, loaded: Flags, eta: Array) -> list[str]:
        states = []
        for k, on in enumerate(loaded):
            if not on:
                states.append("open")
            elif eta[k] >= 1.0 - self.limit:
                states.append("slide")
            else:
                partial = point.answer.limit[k] > 0.0 and point.stiffness_ratio[k] < 1.0 - self.ring
                states.append("partial" if partial else "stick")
        return states


def utilisation(point: Balance, loaded: Flags) -> Array:
    """eta = |T|/(mu N) of every spot; without friction 1 if it slipped, else 0; 0 if it is open."""
    size, limit = np.hypot(*point.answer.tangential.T), point.answer.limit
    slipped = (point.slip > ROUNDING * point.answer.contact_radius).astype(float)
    return np.where(loaded, np.where(limit > 0.0, size / np.where(limit > 0.0, limit, 1.0), slipped), 0.0)
