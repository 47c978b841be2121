"""The motion of one rigid body by velocity Verlet, in Python floats: kick, drift, turn, and where its spheres are; the
upper plate or its patches. Rows are lists of floats with the columns of `thirdbody.kernels.tables`."""

import math

from thirdbody.kernels import schedule as motion
from thirdbody.kernels.tables import body, body_extra, orientation, patch, sphere

ANGULAR_MOMENTUM, LONGEST_ARM, INERTIA, UPPER_PUSH, EFFECT_FORCE, EFFECT_TORQUE = (
    body.WIDTH + orientation.WIDTH + getattr(body_extra, name)
    for name in ("ANGULAR_MOMENTUM", "LONGEST_ARM", "INERTIA", "UPPER_PUSH", "EFFECT_FORCE", "EFFECT_TORQUE")
)  # columns of E: a row of a body is that of B, then its orientation, then that of E
QUATERNION = body.WIDTH + orientation.QUATERNION
QUATERNION4 = slice(QUATERNION, QUATERNION + 4)
MIN_SPEED, MIN_SPIN, MIN_MOMENTUM = 1e-60, 1e-60, 1e-90
"""m/s, rad/s and kg m2/s: what moves more slowly at the end of a step rests."""


def three(row, column):
    return row[column], row[column + 1], row[column + 2]


def dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def cross(a, b):
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def added(a, b, factor=1.0):
    return a[0] + factor * b[0], a[1] + factor * b[1], a[2] + factor * b[2]


def unit(q):
    s = 1.0 / math.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    return q[0] * s, q[1] * s, q[2] * s, q[3] * s


def rows_of(q):
    w, x, y, z = q
    return (
        (1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)),
        (2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)),
        (2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)),
    )


def in_body(q, momentum):
    columns = tuple(zip(*rows_of(q), strict=True))
    return dot(columns[0], momentum), dot(columns[1], momentum), dot(columns[2], momentum)


def spin(q, momentum, inertia):
    p = in_body(q, momentum)
    p = p[0] / inertia[0], p[1] / inertia[1], p[2] / inertia[2]
    turn = rows_of(q)
    return dot(turn[0], p), dot(turn[1], p), dot(turn[2], p)


def about(q, axis, angle):
    s = 0.5 * angle
    c = 1.0 / math.sqrt(1.0 + s * s)
    s *= c
    w, x, y, z = q
    if axis == 0:
        return w * c - x * s, x * c + w * s, y * c + z * s, z * c - y * s
    if axis == 1:
        return w * c - y * s, x * c - z * s, y * c + w * s, z * c + x * s
    return w * c - z * s, x * c + y * s, y * c - x * s, z * c + w * s


def turned_freely(q, momentum, inertia, dt):
    """Orientation after dt without torque: turns about the principal axes 3, 2, 1, 2, 3 (Dullweber et al. 1997)."""
    for axis, share in ((2, 0.5), (1, 0.5), (0, 1.0), (1, 0.5), (2, 0.5)):
        q = about(q, axis, share * dt * in_body(q, momentum)[axis] / inertia[axis])
    return unit(q)


def turned(q, r):
    w, x, y, z = q
    a, b, c = 0.5 * r[0], 0.5 * r[1], 0.5 * r[2]
    new = w - a * x - b * y - c * z, x + a * w + b * z - c * y, y - a * z + b * w + c * x, z + a * y - b * x + c * w
    longer = (new[0] * new[0] + new[1] * new[1]) + (new[2] * new[2] + new[3] * new[3]) - 1.0
    s = 1.0 - longer * (0.5 - 0.375 * longer) if abs(longer) < 5e-6 else 1.0 / math.sqrt(1.0 + longer)
    return new[0] * s, new[1] * s, new[2] * s, new[3] * s


def rotated(q, w, time):
    r = time * w[0], time * w[1], time * w[2]
    tangent = 1.0 + dot(r, r) / 12.0
    return turned(q, (tangent * r[0], tangent * r[1], tangent * r[2])) if time != 0.0 else q


def quaternion(B):
    return B[QUATERNION], B[QUATERNION + 1], B[QUATERNION + 2], B[QUATERNION + 3]


def see_spin(B):
    """The angular velocity of a body from its momentum, rad/s; of a ball the momentum from the velocity."""
    if B[body.SPHERE_INERTIA] != 0.0:
        B[ANGULAR_MOMENTUM : ANGULAR_MOMENTUM + 3] = [B[body.SPHERE_INERTIA] * B[body.SPIN + k] for k in range(3)]
    else:
        B[body.SPIN3] = spin(quaternion(B), three(B, ANGULAR_MOMENTUM), three(B, INERTIA))


def place(row, offset, B, v, w, end, h):
    """Put a sphere where its body is: v, w of the step act at its arm of h seconds ago, those of the `end` at that of now."""
    turn = rows_of(quaternion(B))
    arm = dot(turn[0], offset), dot(turn[1], offset), dot(turn[2], offset)
    path = cross(w, arm)
    middle = arm[0] - h * path[0], arm[1] - h * path[1], arm[2] - h * path[2]
    row[sphere.POSITION3] = added(three(B, body.POSITION), arm)
    row[sphere.MID_VELOCITY3] = carried(v, w, middle)
    row[sphere.MID_SPIN3] = w
    row[sphere.END_VELOCITY3] = carried(end[0], end[1], arm)
    row[sphere.END_SPIN3] = end[1]
    row[sphere.ARM3] = arm


def carried(v, w, r):
    return added(v, cross(w, r))


def place_now(B, spheres, offsets):
    see_spin(B)
    v, w = three(B, body.VELOCITY), three(B, body.SPIN)
    for sphere_number, offset in zip(spheres, offsets, strict=True):
        place(sphere_number, offset, B, v, w, (v, w), 0.0)


def drift_ball(B, row, dt, rotation):
    """Half kick and full drift of a ball, which its spin turns for a time of `rotation` seconds."""
    half = 0.5 * dt
    change = [half / B[body.MASS] * f for f in three(B, body.FORCE)]
    turn = [half / B[body.SPHERE_INERTIA] * t for t in three(B, body.TORQUE)]
    v = [B[body.VELOCITY + k] + change[k] for k in range(3)]
    w = [B[body.SPIN + k] + turn[k] for k in range(3)]
    B[body.POSITION3] = x = [B[body.POSITION + k] + dt * v[k] for k in range(3)]
    B[body.VELOCITY3], B[body.SPIN3] = v, w
    row[sphere.POSITION3], row[sphere.MID_VELOCITY3], row[sphere.MID_SPIN3] = x, v, w
    row[sphere.END_VELOCITY3] = [v[k] + change[k] for k in range(3)]
    row[sphere.END_SPIN3] = [w[k] + turn[k] for k in range(3)]
    B[QUATERNION4] = rotated(quaternion(B), (w[0], w[1], w[2]), rotation)


def drift_body(B, spheres, offsets, dt):
    """Half kick and full drift of any body, and its spheres with the velocities of the step and those foretold for its end."""
    half, kick = 0.5 * dt, 0.5 * dt / B[body.MASS]
    force, torque, inertia, before = three(B, body.FORCE), three(B, body.TORQUE), three(B, INERTIA), quaternion(B)
    v = added(three(B, body.VELOCITY), force, kick)
    momentum = added(three(B, ANGULAR_MOMENTUM), torque, half)
    after = turned_freely(before, momentum, inertia, dt)
    w_0, w_1 = spin(before, momentum, inertia), spin(after, momentum, inertia)
    w = 0.5 * (w_0[0] + w_1[0]), 0.5 * (w_0[1] + w_1[1]), 0.5 * (w_0[2] + w_1[2])
    B[body.POSITION3] = added(three(B, body.POSITION), v, dt)
    B[body.VELOCITY3], B[ANGULAR_MOMENTUM : ANGULAR_MOMENTUM + 3], B[QUATERNION4] = v, momentum, after
    end = added(v, force, kick), spin(after, added(momentum, torque, half), inertia)
    for sphere_number, offset in zip(spheres, offsets, strict=True):
        place(sphere_number, offset, B, v, w, end, 0.5 * dt)


def drift(B, spheres, offsets, dt, rotation):
    """Half kick and full drift of a body and its spheres; the forces on it are used up. `rotation`: see `drift_ball`."""
    inertia = three(B, INERTIA)
    # spheres round one point with one moment of inertia turn without a matrix
    if not any(map(any, offsets)) and inertia[0] == inertia[1] == inertia[2]:
        drift_ball(B, spheres[0], dt, rotation)
    else:
        drift_body(B, spheres, offsets, dt)
    for column in (body.FORCE, body.TORQUE):  # the contacts add them up anew
        B[column : column + 3] = 0.0, 0.0, 0.0
    B[UPPER_PUSH] = 0.0


def act(B, force, torque):
    for column, push in ((body.FORCE, force), (body.TORQUE, torque)):
        B[column : column + 3] = added(three(B, column), push)


def kick(B, force, torque, dt):
    half = 0.5 * dt
    inertia, turn, least = (
        (B[body.SPHERE_INERTIA], body.SPIN, MIN_SPIN) if B[body.SPHERE_INERTIA] != 0.0 else (1.0, ANGULAR_MOMENTUM, MIN_MOMENTUM)
    )
    for column, push, share, limit in (
        (body.VELOCITY, force, half / B[body.MASS], MIN_SPEED),
        (turn, torque, half / inertia, least),
    ):
        for k in range(3):
            moved = B[column + k] + share * push[k]
            B[column + k] = 0.0 if abs(moved) <= limit else moved  # what is not a number is not hidden


# the upper plate: driven by a schedule, loaded, moved by velocity Verlet


class Plan:
    """What is prescribed of the upper plate: rows of a schedule, `first[axis]` to `first[axis + 1]` belong to an axis."""

    def __init__(self, schedule, first):
        self.rows = [schedule[first[axis] : first[axis + 1]] for axis in range(len(first) - 1)]

    def row(self, axis, t):
        begun = [row for row in self.rows[axis] if row[motion.START] <= t]
        return begun[-1] if begun else None

    def value(self, axis, t):
        row = self.row(axis, t)
        if row is None:
            return 0.0
        tau, a, b, c = t - row[motion.START], row[motion.A], row[motion.B], row[motion.C]
        if row[motion.KIND] == motion.SINE:
            return a + 0.5 * b * (1.0 - math.cos(c * tau))
        if row[motion.KIND] == motion.TRIANGLE:
            phase = c * tau - math.floor(c * tau)
            return a + b * (2.0 * phase if phase < 0.5 else 2.0 - 2.0 * phase)
        return a + tau * (b + 0.5 * c * tau)

    def rate(self, axis, t, dt):
        row = self.row(axis, t)
        if row is self.row(axis, t + dt):
            if row is None:
                return 0.0
            if row[motion.KIND] == motion.POLYNOMIAL:
                return row[motion.B] + row[motion.C] * (t - row[motion.START] + 0.5 * dt)
        return (self.value(axis, t + dt) - self.value(axis, t)) / dt


class Patches:
    """The table of patches; `patch[b]` is that of body b. With more than one and a plate they hang on, that plate is the last."""

    def __init__(self, P, patch, plan):
        self.P, self.patch, self.plan = P, patch, plan

    def drive(self, t, dt):
        if self.plan.rows[motion.GAP]:
            for p in self.P:
                if p[patch.SPRING] == 0.0 and p[patch.FREE] == 0.0:
                    p[patch.VELOCITY] = self.plan.rate(motion.GAP, t, dt)

    def drift(self, dt, v_x, v_y):
        for p in self.P:
            if p[patch.FREE] != 0.0:
                force = p[patch.FORCE] - p[patch.LOAD] - p[patch.DAMPING] * p[patch.VELOCITY]
                p[patch.VELOCITY] += 0.5 * dt / p[patch.MASS] * force
            p[patch.HEIGHT] += dt * p[patch.VELOCITY]
            p[patch.DISPLACEMENT] += dt * v_x
            p[patch.DISPLACEMENT + 1] += dt * v_y

    def load(self, t):
        if self.plan.rows[motion.LOAD]:
            factor = self.plan.value(motion.LOAD, t)
            for p in self.P:
                if p[patch.NOMINAL_LOAD] != 0.0:
                    p[patch.LOAD] = factor * p[patch.NOMINAL_LOAD]

    def press(self, B, push):
        """Upward forces: `push` of all debris on one patch, else of every body on its own, and of the springs."""
        P = self.P
        if len(P) == 1:
            P[0][patch.FORCE] = push
            return
        for p in P:
            p[patch.FORCE] = 0.0
        for b, row in enumerate(B):
            P[self.patch[b]][patch.FORCE] -= row[UPPER_PUSH]
        for p in P[:-1]:
            spring = p[patch.SPRING] * (p[patch.HEIGHT] - P[-1][patch.HEIGHT])
            p[patch.FORCE] -= spring
            P[-1][patch.FORCE] += spring

    def kick(self, dt):
        """Closing half kick; powers of the loads, of what is prescribed, and of the dashpots, W."""
        load, damping, driven = 0.0, 0.0, 0.0
        for p in self.P:
            if p[patch.FREE] != 0.0:
                half = 0.5 * dt / p[patch.MASS]
                p[patch.VELOCITY] = (p[patch.VELOCITY] + half * (p[patch.FORCE] - p[patch.LOAD])) / (
                    1.0 + half * p[patch.DAMPING]
                )
                load -= p[patch.LOAD] * p[patch.VELOCITY]
                damping += p[patch.DAMPING] * p[patch.VELOCITY] * p[patch.VELOCITY]
            else:
                driven -= p[patch.FORCE] * p[patch.VELOCITY]
        return load, driven, damping
