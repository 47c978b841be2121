"""Labels of one particle on a quasi-static path, whose equilibria the labeller sees as steps."""

import numpy as np

from thirdbody.kernels.table import Array
from thirdbody.kernels.tables import LOWER, UPPER, loaded_contact, observed_body
from thirdbody.laws.compose import compose_labeller
from thirdbody.laws.contract import Labeller
from thirdbody.statics.solver import Balance, Grip

STEP = 1.0  # nominal time [s] between two equilibria, which do not depend on it; rates are increments


class StaticLabels:
    """Labels of one particle along its path.

    Call `update` for the pressed state, then for each equilibrium of the drag. `heading`: unit vector of the drag.
    """

    def __init__(self, labeller: Labeller, grip: Grip, radius: Array, heading: tuple[float, float]) -> None:
        self.labeller, self.grip, self.radius, self.heading = labeller, grip, radius, heading
        self.memory = np.zeros(len(labeller.memory))
        self.contact_memory = np.zeros((len(radius), len(labeller.contact_memory)))
        self.last: Balance | None = None
        self._observe, self._label = compose_labeller(labeller, effects=False)

    def update(self, point: Balance, grip: Grip) -> dict[str, float]:
        """Return the labels of the next equilibrium, by name: `state`, `reason`, margins, extras."""
        self.grip = grip
        last, loaded = point if self.last is None else self.last, np.flatnonzero(point.overlap > 0.0)
        dragged = point.plate[1:] - last.plate[1:]  # of the upper plate since the last equilibrium [m]
        contacts, body = self._contacts(point, loaded, dragged), self._body(point, last, dragged)
        self._observe(contacts, len(loaded), body, self.memory)
        self.contact_memory[:] = 0.0
        self.contact_memory[loaded] = contacts[:, loaded_contact.MEMORY :]
        names = ("state", "reason", *self.labeller.margins, *self.labeller.extras)
        out = np.zeros(len(names))
        self._label(contacts, len(loaded), body, self.memory, out)
        self.last = point
        return dict(zip(names, out.tolist(), strict=True))

    def _contacts(self, point: Balance, loaded: np.ndarray, dragged: Array) -> Array:
        """Return one row `loaded_contact` per loaded contact."""
        rows = np.zeros((len(loaded), loaded_contact.MEMORY + self.contact_memory.shape[1]))
        up, answer = self.grip.upper[loaded], point.answer
        rows[:, loaded_contact.PARTNER] = np.where(up, UPPER, LOWER)
        rows[:, loaded_contact.POINT3] = self.grip.position[loaded]
        rows[:, loaded_contact.NORMAL + 2] = np.where(up, -1.0, 1.0)
        rows[:, loaded_contact.SPHERE_RADIUS], rows[:, loaded_contact.OVERLAP] = self.radius[loaded], point.overlap[loaded]
        rows[:, loaded_contact.CONTACT_RADIUS] = answer.contact_radius[loaded]
        rows[:, loaded_contact.NORMAL_FORCE] = rows[:, loaded_contact.LOAD] = answer.normal[loaded]
        rows[:, loaded_contact.TANGENTIAL_FORCE : loaded_contact.TANGENTIAL_FORCE + 2] = answer.tangential[loaded]
        rows[:, loaded_contact.FRICTION_LIMIT] = answer.limit[loaded]
        rows[:, loaded_contact.CRITICAL_SLIP] = answer.critical[loaded]
        rows[:, loaded_contact.SLIP] = point.slip[loaded]
        velocity = slice(loaded_contact.PARTNER_VELOCITY, loaded_contact.PARTNER_VELOCITY + 2)
        rows[:, velocity] = np.where(up[:, None], dragged / STEP, 0.0)
        rows[:, loaded_contact.IDENTITY] = loaded + 1.0
        rows[:, loaded_contact.MEMORY :] = self.contact_memory[loaded]
        return rows

    def _body(self, point: Balance, last: Balance, dragged: Array) -> Array:
        """Return the row `observed_body` of the particle: motion since the last equilibrium, residual force, plates."""
        from scipy.spatial.transform import Rotation  # imported here: 0.2 s

        row = np.zeros(observed_body.WIDTH)
        row[observed_body.POSITION3] = point.motion[:3]
        row[observed_body.VELOCITY3] = (point.motion[:3] - last.motion[:3]) / STEP
        row[observed_body.SPIN3] = (point.motion[3:] - last.motion[3:]) / STEP
        row[observed_body.QUATERNION4] = np.roll(Rotation.from_rotvec(point.motion[3:]).as_quat(), 1)
        forces = np.column_stack([point.answer.tangential, np.where(self.grip.upper, -1.0, 1.0) * point.answer.normal])
        row[observed_body.FORCE3] = forces.sum(axis=0) - [0.0, 0.0, self.grip.weight]
        row[observed_body.TORQUE3] = np.cross(self.grip.position, forces).sum(axis=0)
        row[observed_body.ELAPSED] = STEP
        row[observed_body.PLATE_SHIFT2] = dragged
        row[observed_body.DRAG2] = self.heading
        row[observed_body.PLATE_SPEED] = 1.0  # as for a drag that starts from the pressed state
        return row
