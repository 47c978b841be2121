"""Label, reason and margins of a particle in balance, point by point along its path: the rules of `classify` without time.

`free`: nothing loaded. `rolling`: the particle turned by a contact radius, or it is not held (no side has two loaded spots more
than a apart along the drag) and takes up half of the drag by turning since its set of loaded spots changed. `sliding`: all
loaded spots of a side are at the friction limit and slip. `sticking`: else.

Margins (positive = satisfied; 1 where a condition does not apply): `friction` 1 - max eta, eta = |T|/(mu N); `friction_spots`
1 - eta of each; `friction_upper`, `friction_lower` 1 - min eta of the side; `force_balance`, `moment_balance` from what the
solver left; `determinacy` spread of a side's loaded spots along the drag over a, less 1; `rotation`.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from thirdbody.plugin import Balance, Grip

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

AT_LIMIT = {"mdr": 1e-3}
"""Least 1 - eta that is not the limit: the springs of `mdr` fall short of mu N by 4e-4."""
RING = {"mdr": 0.15}
"""Loss of tangential stiffness, the width of the slip ring over a, that can be told: `mdr` has 16 to 32 springs."""
SPREAD = 0.02
"""The same in space, and `classify`'s: springs of a patch that slid along a curved path pull in slightly different directions."""
ROUNDING, ANNULUS = 1e-9, 1e-6
BALANCE, TURN, LEAST_TRAVEL = 0.05, 0.5, 0.02  # as in `classify`


class Observer:
    """Follows one particle; `see` the pressed state first, then every point of the drag."""

    def __init__(self, grip: Grip, radius: Array, heading: tuple[float, float], level: str) -> None:
        self.grip, self.radius, self.heading = grip, radius, np.array(heading)
        self.limit = AT_LIMIT.get(level, ROUNDING) if grip.planar else SPREAD
        self.ring = RING.get(level, ANNULUS)
        self.pressed: Balance | None = None
        self.changed: Balance | None = None  # where the set of loaded spots is what it is now

    def see(self, point: Balance) -> tuple[list[str], str, str, dict[str, Any]]:
        """(state of each spot, label, reason, margins) of the next point."""
        loaded = point.overlap > 0.0
        if self.pressed is None or self.changed is None:
            self.pressed = self.changed = point
        if np.any(loaded != (self.changed.overlap > 0.0)):
            self.changed = point
        eta = self._eta(point, loaded)
        spots = self._spots(point, loaded, eta)
        margins = self._margins(point, loaded, eta)
        return spots, *self._label(point, loaded, spots, margins), margins

    def _eta(self, point: Balance, loaded: Flags) -> Array:
        """|T|/(mu N); without friction 1 where a spot slipped, else 0."""
        size, limit = np.hypot(*point.answer.tangential.T), point.answer.limit
        slipped = (point.slip > ROUNDING * point.answer.contact_radius).astype(float)
        return np.where(loaded, np.where(limit > 0.0, size / np.where(limit > 0.0, limit, 1.0), slipped), 0.0)

    def _spots(self, point: Balance, loaded: Flags, eta: Array) -> list[str]:
        states = []
        for k, on in enumerate(loaded):
            if not on:
                states.append("open")
            elif eta[k] >= 1.0 - self.limit:
                states.append("slide")
            else:
                partial = point.answer.limit[k] > 0.0 and point.hold[k] < 1.0 - self.ring
                states.append("partial" if partial else "stick")
        return states

    def _margins(self, point: Balance, loaded: Flags, eta: Array) -> dict[str, Any]:
        margins: dict[str, Any] = {"friction": 1.0 - float(eta.max(initial=0.0)), "friction_spots": (1.0 - eta).tolist()}
        for name, side in (("friction_upper", self.grip.upper), ("friction_lower", ~self.grip.upper)):
            own = eta[side & loaded]
            margins[name] = 1.0 - float(own.min()) if len(own) else 1.0
        margins["force_balance"] = margins["moment_balance"] = 1.0 - point.rest / BALANCE
        a = float(point.answer.contact_radius.max(initial=0.0))
        margins["determinacy"] = self._spread(loaded) / a - 1.0 if a > 0.0 else -1.0
        margins["rotation"] = self._rotation(point, loaded, a, margins["determinacy"] > 0.0)
        return margins

    def _spread(self, loaded: Flags) -> float:
        """Largest distance along the drag between two loaded spots of one side, m."""
        along = self.grip.place[:, :2] @ self.heading
        widest = 0.0
        for side in (self.grip.upper, ~self.grip.upper):
            own = along[side & loaded]
            widest = max(widest, float(np.ptp(own)) if len(own) else 0.0)
        return widest

    def _rotation(self, point: Balance, loaded: Flags, a: float, held: bool) -> float:
        assert self.pressed is not None and self.changed is not None
        if a <= 0.0:
            return 1.0
        since = point.motion[3:] - self.pressed.motion[3:]
        patch = self.radius * np.hypot(since[0], since[1])
        patch = np.maximum(patch, np.linalg.norm(self.grip.place[:, :2], axis=1) * abs(since[2]))
        margin = 1.0 - float(patch[loaded].max(initial=0.0)) / a
        dragged = float((point.plate[1:] - self.changed.plate[1:]) @ self.heading)
        if not held and self._both(loaded) and dragged >= LEAST_TRAVEL * a and dragged > 0.0:
            turn = point.motion[3:] - self.changed.motion[3:]
            share = self._height(point) * (turn[1] * self.heading[0] - turn[0] * self.heading[1]) / dragged
            margin = min(margin, 1.0 - share / TURN)
        return margin

    def _both(self, loaded: Flags) -> bool:
        return bool(np.any(loaded & self.grip.upper) and np.any(loaded & ~self.grip.upper))

    def _height(self, point: Balance) -> float:
        """Vertical distance between the load centres of the sides, m."""
        up, normal, z = self.grip.upper, point.answer.normal, self.grip.place[:, 2]
        return float(normal[up] @ z[up] / normal[up].sum() - normal[~up] @ z[~up] / normal[~up].sum())

    def _label(self, point: Balance, loaded: Flags, spots: list[str], margins: dict[str, Any]) -> tuple[str, str]:
        assert self.pressed is not None
        if not loaded.any():
            return "free", "none"
        if margins["rotation"] <= 0.0:
            lifted = bool(np.any((self.pressed.overlap > 0.0) & ~loaded))
            return "rolling", "lift_off" if lifted else ("rotation" if margins["determinacy"] > 0.0 else "indeterminate")
        for side in (self.grip.upper, ~self.grip.upper):
            own = [spots[k] for k in np.flatnonzero(side & loaded)]
            if own and all(state == "slide" for state in own):
                return "sliding", "friction_limit"
        if not self._both(loaded):
            return "sticking", "one_sided"
        return "sticking", "none" if margins["determinacy"] > 0.0 else "indeterminate"
