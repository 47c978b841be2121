"""A body whose contacts and motion a test prescribes, and what the labeller tells of it."""

import dataclasses
import math

import numpy as np
from theory.plain import plain
from thirdbody_three_spot import classify as c
from thirdbody import plugin as k
from thirdbody.plugin import loaded_contact as spot_row
from thirdbody.plugin import observed_body as body_row

A = 0.0301  # contact radius of every spot, in units of its radius of curvature; 4 A = .1204 closes a window
S_C = 3e-4  # critical displacement
DT = 1e-3  # s between observations
STILL = (0.0, 0.0, 0.0)
UPDATE, LABEL, LABEL_WITH_EFFECTS = map(plain, (c.update_history, c.label_without_effects, c.label))


@dataclasses.dataclass
class Spot:
    """One loaded contact in units of the radius of curvature and of its load; `force` is T over mu N."""

    partner: int
    point: tuple[float, float, float]
    normal: tuple[float, float, float]
    force: tuple[float, float, float] = STILL
    limit: float = 0.3
    surface: tuple[float, float, float] = STILL
    load: float = 1.0
    slip: float = 0.0
    memory: np.ndarray = dataclasses.field(default_factory=lambda: np.zeros(len(c.CONTACT_MEMORY)))


@dataclasses.dataclass
class View:
    """How a history is told to the labeller: in which unit, mirrored, turned, otherwise ordered, oftener, by which function."""

    unit: float = 1.0
    mirrored: bool = False
    quarter_turns: int = 0
    backward: bool = False
    parts: int = 1
    label: object = LABEL

    def vector(self, v, axial=False):
        x, y, z = v
        if self.mirrored:
            x, y, z = (x, -y, -z) if axial else (-x, y, z)
        for _ in range(self.quarter_turns):
            x, y = -y, x
        return np.array([x, y, z])


def quaternion(turn):
    angle = math.sqrt(sum(t * t for t in turn))
    return np.array([math.cos(angle / 2.0), *(0.5 * np.sinc(angle / (2.0 * math.pi)) * np.array(turn))])


def product(p, q):
    return np.array([p[0] * q[0] - p[1:] @ q[1:], *(p[0] * q[1:] + q[0] * p[1:] + np.cross(p[1:], q[1:]))])


class Rig:
    """The body; `frames` collects what the labeller said, `last` is the last of it."""

    def __init__(self, spots, view):
        self.spots, self.view = list(spots), view
        self.q, self.m = np.array([1.0, 0.0, 0.0, 0.0]), np.zeros(len(c.MEMORY))
        self.velocity, self.spin, self.force, self.torque = STILL, STILL, STILL, STILL
        self.direction = (1.0, 0.0, 0.0)
        self.frames: list[dict[str, float]] = []

    def table(self):
        order = self.spots[::-1] if self.view.backward else self.spots
        C, unit, v = np.zeros((len(order) + 1, spot_row.MEMORY + len(c.CONTACT_MEMORY))), self.view.unit, self.view.vector
        C[-1] = 7.0  # a row beyond n is none of the labeller's business
        for row, s in zip(C, order, strict=False):
            row[spot_row.PARTNER], row[spot_row.POINT3], row[spot_row.NORMAL3] = s.partner, unit * v(s.point), v(s.normal)
            row[spot_row.SPHERE_RADIUS], row[spot_row.CONTACT_RADIUS], row[spot_row.OVERLAP] = unit, unit * A, unit * A * A
            row[spot_row.NORMAL_FORCE] = row[spot_row.LOAD] = s.load
            row[spot_row.TANGENTIAL_FORCE3] = s.limit * s.load * v(s.force)
            row[spot_row.FRICTION_LIMIT] = s.limit * s.load
            row[spot_row.CRITICAL_SLIP], row[spot_row.SLIP] = unit * S_C * s.limit / 0.3, unit * s.slip
            row[spot_row.PARTNER_VELOCITY3] = unit * v(s.surface)
            row[spot_row.MEMORY :] = s.memory
        return order, C

    def body(self, drag, dt, moving):
        b, unit, v = np.zeros(body_row.WIDTH), self.view.unit, self.view.vector
        b[body_row.MASS] = 4e-6 / unit  # at four units of load sqrt(m a/N) is .17 ms, and rest takes 8.7 ms
        b[body_row.QUATERNION4] = self.q
        b[body_row.VELOCITY3], b[body_row.SPIN3] = unit * v(self.velocity), v(self.spin, axial=True)
        b[body_row.FORCE3], b[body_row.TORQUE3] = v(self.force), unit * v(self.torque, axial=True)
        b[body_row.ELAPSED], b[body_row.PLATE_SHIFT2] = dt, unit * v((*drag, 0.0))[:2]
        b[body_row.DRAG2], b[body_row.PLATE_SPEED] = v(self.direction)[:2], unit * moving
        return b

    def move(self, dx=0.0, turn=STILL, slip=(), dt=DT, moving=None, times=1):
        """Strides: drag along x, rotation about y or a vector, and slip of each spot during each; observed in parts."""
        turn = turn if isinstance(turn, tuple) else (0.0, turn, 0.0)
        if dx:
            self.direction = (math.copysign(1.0, dx), 0.0, 0.0)
        moving = (abs(dx) / dt if dt > 0.0 else 0.0) if moving is None else moving
        self.spin = tuple(np.array(turn) / dt) if dt > 0.0 else STILL
        share = 1.0 / self.view.parts
        for _ in range(self.view.parts * times):
            self.q = product(quaternion(share * self.view.vector(turn, axial=True)), self.q)
            for s, length in zip(self.spots, slip, strict=False):
                s.slip += share * length
            order, C = self.table()
            self.observed = (C, self.body((share * dx, 0.0), share * dt, moving))
            UPDATE(C, len(order), self.observed[1], self.m)
            for s, row in zip(order, C, strict=False):
                s.memory = row[spot_row.MEMORY :].copy()
        return self

    def slide(self, dx, spots, times=1):
        """Drag with the named spots at the friction limit and slipping."""
        along = math.copysign(1.0, dx)
        for i in spots:
            self.spots[i].force = (along * (1.0 if self.spots[i].partner == k.UPPER else -1.0), 0.0, 0.0)
        return self.move(dx, slip=[abs(dx) if i in spots else 0.0 for i in range(len(self.spots))], times=times)

    def label(self):
        out, (C, b) = np.full(c.OUTPUTS, np.nan), self.observed
        before = C.copy(), self.m.copy()
        self.view.label(C, len(self.spots), b, self.m, out)
        assert np.isfinite(out).all()
        assert (C == before[0]).all() and (self.m == before[1]).all()  # labels change nothing
        self.frames.append(dict(zip(("state", "reason", *c.MARGINS, *c.EXTRAS), out, strict=True)))
        return c.STATES[int(self.last["state"])], c.REASONS[int(self.last["reason"])]

    def has(self, state, reason):
        assert self.label() == (state, reason)
        return self

    def shows(self, **values):
        assert {name: self.last[name] for name in values} == values
        return self

    @property
    def last(self):
        return self.frames[-1]
