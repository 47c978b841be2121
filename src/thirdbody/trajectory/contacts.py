"""Closed contacts of a frame: bodies and series need some of their columns, and only those are gathered."""

from functools import cached_property
from typing import Any

import numpy as np

from thirdbody.engine.candidates import sides_of
from thirdbody.engine.measures import contact_maxima
from thirdbody.engine.state import State
from thirdbody.kernels.rolling_kinematics import TWIST
from thirdbody.kernels.tables import DEBRIS, LOWER, UPPER, WALL, contact_state, record
from thirdbody.trajectory.names import LOWER_PLATE, UPPER_PLATE

Array = np.ndarray


class FrameContacts:
    """Closed contacts now, (n,) each; bodies are numbered as in the scene.

    `on`: numbers of the candidates that are closed; `owner`: rows of their bodies in the tables of the state; `side`: what each
    touches (`names.SIDES`); `normal_force` [N]; `peak_pressure` [Pa]; `arm`: contact points from the centres of mass (n, 3) [m].
    """

    def __init__(self, state: State) -> None:
        self.state, slots = state, state.slots
        self.on = slots.rows.closed()
        self.owner = state.body[slots.own[self.on]]
        self.side = sides_of(slots.partner[self.on]).astype(np.uint8)
        # in one pass, what every frame needs of the records
        self.normal_force, self._normal_z, self._tangential_z, self.peak_pressure, self.arm = slots.rows.records(
            self.on, record.NORMAL_FORCE, record.NORMAL + 2, record.TANGENTIAL_FORCE + 2, record.PEAK_PRESSURE, record.POINT3
        )

        if state.world.walls:  # normals of the plates are vertical
            self.side[(self.side == LOWER) & (self._normal_z == 0.0)] = WALL

    @cached_property
    def body(self) -> Array:
        """Their bodies."""
        return self.state.order[self.owner]

    @cached_property
    def partner(self) -> Array:
        """The other body, LOWER_PLATE or UPPER_PLATE; of side walls that of the lower one."""
        s, plate = self.state, np.where(self.side == UPPER, UPPER_PLATE, LOWER_PLATE)
        if not np.any(self.side == DEBRIS):
            return plate
        other = np.maximum(s.slots.partner[self.on], 0)
        return np.where(self.side == DEBRIS, s.order[s.body[other]], plate)

    @cached_property
    def utilisation(self) -> Array:
        """Tangential forces over their friction limits."""
        force, limit = self.state.slots.rows.records(self.on, record.TANGENTIAL_FORCE3, record.FRICTION_LIMIT)
        return _over_limit(np.sqrt(force[:, 0] ** 2 + force[:, 1] ** 2 + force[:, 2] ** 2), limit)

    def largest(self, values: Array) -> Array:
        """Return the largest value over the contacts of each body (n_bodies,), zero without any."""
        largest, debris = np.zeros(self.state.n_bodies), self.partner >= 0
        np.maximum.at(largest, self.body, values)
        np.maximum.at(largest, self.partner[debris], values[debris])
        return largest

    def number(self, chosen: Any = slice(None)) -> Array:
        """Return the number of contacts of each body (n_bodies,), of those chosen."""
        body, partner = self.body[chosen], self.partner[chosen]
        return np.bincount(np.concatenate([body, partner[partner >= 0]]), minlength=self.state.n_bodies)

    def active(self) -> float:
        """Return the fraction of bodies that are pressed from above and from below."""
        debris = self.partner >= 0
        bodies = np.concatenate([self.body, self.partner[debris]])
        lift = self.normal_force * self._normal_z + self._tangential_z
        lift = np.concatenate([lift, -lift[debris]])
        above, below = (np.bincount(bodies[on], minlength=self.state.n_bodies) > 0 for on in (lift < 0.0, lift > 0.0))
        return float(np.mean(above & below))

    def wall_forces(self) -> tuple[Array, Array]:
        """Return the forces on the side walls at y = 0 and at the far end (3,) each [N]."""
        on = self.on[self.side == WALL]
        rows = self.state.slots.rows
        size, normal, tangential = rows.records(on, record.NORMAL_FORCE, record.NORMAL3, record.TANGENTIAL_FORCE3)
        force = -size[:, None] * normal - tangential
        return force[normal[:, 1] > 0.0].sum(axis=0), force[normal[:, 1] < 0.0].sum(axis=0)

    def arrays(self, chosen: Any) -> dict[str, Array]:
        """Return all arrays of the chosen contacts, in the order of the file."""
        s, on = self.state, self.on[chosen]
        rows = s.slots.rows
        (R,) = rows.records(on, slice(None)) if len(on) else (np.zeros((0, rows.widths[1])),)
        slip = rows.histories(on, contact_state.SLIP) if len(on) else np.zeros(0)
        tangential, normal_force = R[:, record.TANGENTIAL_FORCE3], R[:, record.NORMAL_FORCE]
        arrays = {
            "points": s.bodies.position[self.owner[chosen]] + R[:, record.POINT3],
            "body": self.body[chosen],
            "partner": self.partner[chosen],
            "side": self.side[chosen],
            "normal": R[:, record.NORMAL3],
            "normal_force": normal_force,
            "tangential_force": tangential,
            "force": normal_force[:, None] * R[:, record.NORMAL3] + tangential,
            "utilisation": self.utilisation[chosen] if len(on) else np.zeros(0),
            "slip": slip - contact_state.CLOSED,
            "overlap": R[:, record.OVERLAP],
            "contact_radius": R[:, record.CONTACT_RADIUS],
            "peak_pressure": R[:, record.PEAK_PRESSURE],
            "critical_slip": R[:, record.CRITICAL_SLIP],
        }
        if s.physics.moments:
            moment = R[:, record.MOMENT3]
            arrays["moment"] = moment
            arrays["rolling_utilisation"] = _over_limit(np.linalg.norm(moment, axis=1), R[:, record.MOMENT_LIMIT])
        if s.physics.rolling >= TWIST:
            arrays["twist_moment"] = R[:, record.TWIST_MOMENT]
            arrays["twist_utilisation"] = _over_limit(np.abs(R[:, record.TWIST_MOMENT]), R[:, record.TWIST_LIMIT])
        return arrays | contact_maxima(s, on)


def _over_limit(size: Array, limit: Array) -> Array:
    return np.divide(size, limit, out=np.zeros_like(size), where=limit > 0.0)
