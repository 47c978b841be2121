"""The labels of one particle in balance, by the labeller of a run: it sees the balances one after another as steps of a run."""

from __future__ import annotations

import numpy as np

from thirdbody.engine.quasistatic import Balance, Grip
from thirdbody.engine.state import Array
from thirdbody.kernels import layout as at
from thirdbody.laws.codegen.effects import compose_labeller
from thirdbody.laws.contract import Labeller

STEP = 1.0
"""Time from one balance to the next, s: nothing in a balance depends on it, and rates are increments."""


class StaticLabels:
    """Follows one particle along its path: `see` the pressed state first, then every balance of the drag along `heading`."""

    def __init__(self, labeller: Labeller, grip: Grip, radius: Array, heading: tuple[float, float]) -> None:
        self.labeller, self.grip, self.radius, self.heading = labeller, grip, radius, heading
        self.memory = np.zeros(len(labeller.memory))
        self.contact_memory = np.zeros((len(radius), len(labeller.contact_memory)))
        self.last: Balance | None = None
        self._observe, self._label = compose_labeller(labeller, effects=False)

    def see(self, point: Balance, grip: Grip) -> dict[str, float]:
        """What the labeller says of the next balance, with the spots at `grip`: codes `state`, `reason`, margins and extras."""
        self.grip = grip
        loaded = np.flatnonzero(point.overlap > 0.0)
        contacts, body = self._contacts(point, loaded), self._body(point)
        self._observe(contacts, len(loaded), body, self.memory)
        self.contact_memory[:] = 0.0
        self.contact_memory[loaded] = contacts[:, at.C_MEMORY :]
        names = ("state", "reason", *self.labeller.margins, *self.labeller.extras)
        out = np.zeros(len(names))
        self._label(contacts, len(loaded), body, self.memory, out)
        self.last = point
        return dict(zip(names, out.tolist(), strict=True))

    def _contacts(self, point: Balance, loaded: np.ndarray) -> Array:
        """One row per loaded spot (C_ columns)."""
        rows = np.zeros((len(loaded), at.C_MEMORY + self.contact_memory.shape[1]))
        up, answer = self.grip.upper[loaded], point.answer
        rows[:, at.C_PARTNER] = np.where(up, at.UPPER, at.LOWER)
        rows[:, at.C_POINT : at.C_POINT + 3] = self.grip.place[loaded]
        rows[:, at.C_NORMAL + 2] = np.where(up, -1.0, 1.0)
        rows[:, at.C_CURVATURE], rows[:, at.C_OVERLAP] = self.radius[loaded], point.overlap[loaded]
        rows[:, at.C_A] = answer.contact_radius[loaded]
        rows[:, at.C_FN] = rows[:, at.C_LOAD] = answer.normal[loaded]
        rows[:, at.C_T : at.C_T + 2] = answer.tangential[loaded]
        rows[:, at.C_LIMIT], rows[:, at.C_CRITICAL] = answer.limit[loaded], answer.critical[loaded]
        rows[:, at.C_SLIP] = point.slip[loaded]
        rows[:, at.C_V : at.C_V + 2] = np.where(up[:, None], self._dragged(point) / STEP, 0.0)
        rows[:, at.C_IDENTITY] = loaded + 1.0
        rows[:, at.C_MEMORY :] = self.contact_memory[loaded]
        return rows

    def _body(self, point: Balance) -> Array:
        """The particle, its motion since the last balance, and the plates (O_ columns)."""
        from scipy.spatial.transform import Rotation  # a fifth of a second of imports

        row = np.zeros(at.O_COLS)
        before = point.motion if self.last is None else self.last.motion
        row[at.O_X : at.O_X + 3] = point.motion[:3]
        row[at.O_V : at.O_V + 3] = (point.motion[:3] - before[:3]) / STEP
        row[at.O_W : at.O_W + 3] = (point.motion[3:] - before[3:]) / STEP
        row[at.O_Q : at.O_Q + 4] = np.roll(Rotation.from_rotvec(point.motion[3:]).as_quat(), 1)
        row[at.O_F : at.O_F + 3], row[at.O_T : at.O_T + 3] = self._unbalanced(point)
        row[at.O_ELAPSED] = STEP
        row[at.O_SHIFT : at.O_SHIFT + 2] = self._dragged(point)
        row[at.O_DRAG : at.O_DRAG + 2], row[at.O_SPEED] = self.heading, 1.0  # as in a drag that begins at the pressed state
        return row

    def _dragged(self, point: Balance) -> Array:
        """Drag (2,) of the upper plate since the last balance, m."""
        return point.plate[1:] - (point.plate if self.last is None else self.last.plate)[1:]

    def _unbalanced(self, point: Balance) -> tuple[Array, Array]:
        """Force, N, and moment about the centre of mass, N m, that are left on the particle."""
        normal = np.where(self.grip.upper, -1.0, 1.0) * point.answer.normal
        forces = np.column_stack([point.answer.tangential, normal])
        moment = np.cross(self.grip.place, forces).sum(axis=0)
        return forces.sum(axis=0) - [0.0, 0.0, self.grip.weight], moment
