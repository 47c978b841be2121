"""One contact at a time in Python floats: does it touch, how do the two surfaces move, what do the laws answer."""

import math
from collections import namedtuple
from dataclasses import make_dataclass

import numpy as np
from scalar_bodies import EFFECT_FORCE, EFFECT_TORQUE, added, cross, dot, quaternion, rotated, three
from thirdbody.kernels.plates import BASINS
from thirdbody.kernels.rolling_kinematics import record_width
from thirdbody.kernels.tables import (
    DEBRIS,
    LOWER,
    UPPER,
    body,
    contact_state,
    loaded_contact,
    observed_body,
    patch,
    record,
    run_totals,
    sphere,
)
from thirdbody.laws.data import Contact, Turn, Twist

STILL = Turn(0.0, 0.0, 0.0, 0.0), Twist(0.0, 0.0)  # where no law asks for a rotation
Surroundings = namedtuple("Surroundings", "P v_x v_y dt l_x l_y")
"""What a contact meets besides its spheres: the patches, the velocity of the upper plate, the periods (0: none), m and s."""
Frame = make_dataclass("Frame", ("overlap", "n", "middle", "arms", "radius", "mass", "moved", "moves"))
"""Geometry of a closed contact: overlap, normals (partner to owner) of now and of the middle of the step; `carry` adds the
tangential axes e and d."""
Done = namedtuple("Done", "force torque back moment frame answer damped")
"""What a contact did in a step: force on the owner, N; torques about the centres of owner and partner, with the moments of
rolling and twisting laws; that of rolling on the owner, N m; the energy that the dashpots took, J."""


def image(d, length):
    c = 1.0 / length if length > 0.0 else 0.0
    return d - length * math.copysign(float(round(d * c)), d)


def between(a, b, world):
    d = [a[sphere.POSITION + k] - b[sphere.POSITION + k] for k in range(3)]
    return image(d[0], world.l_x), image(d[1], world.l_y), d[2]


def plate_overlap(row, partner, P):
    """Overlap of a sphere with the plate -1, the lower one, or with patch p of the upper one, -1 - (1 + p) BASINS."""
    z, r = row[sphere.Z], row[sphere.RADIUS]
    return r - z if partner == -1 else r - (P[(-1 - partner) // BASINS - 1][patch.HEIGHT] - z)


def touches(S, i, j, world):
    if j < 0:
        return plate_overlap(S[i], j, world.P) > 0.0
    d, reach = between(S[i], S[j], world), S[i][sphere.RADIUS] + S[j][sphere.RADIUS]
    return reach * reach - dot(d, d) > 0.0


def with_plate(a, partner, world):
    up = 1.0 if partner < -1 else 0.0
    plate = up * world.v_x, up * world.v_y, up * world.P[max((-1 - partner) // BASINS - 1, 0)][patch.VELOCITY]
    n, r, overlap = (0.0, 0.0, 1.0 - 2.0 * up), a[sphere.RADIUS], plate_overlap(a, partner, world.P)

    def motion(velocity, spin):
        w = three(a, spin)
        return added(three(a, velocity), plate, -1.0), w, (r * w[0], r * w[1], r * w[2])

    moved, moves = motion(sphere.MID_VELOCITY, sphere.MID_SPIN), motion(sphere.END_VELOCITY, sphere.END_SPIN)
    return Frame(overlap, n, n, (r - 0.5 * overlap, 0.0), r, a[sphere.MASS], moved, moves)


def with_sphere(a, b, world):
    path, r_i, r_j, m_i, m_j = between(a, b, world), a[sphere.RADIUS], b[sphere.RADIUS], a[sphere.MASS], b[sphere.MASS]

    def motion(velocity, spin):
        w_i, w_j = three(a, spin), three(b, spin)
        rolled = (r_i * w_i[0] + r_j * w_j[0], r_i * w_i[1] + r_j * w_j[1], r_i * w_i[2] + r_j * w_j[2])
        return added(three(a, velocity), three(b, velocity), -1.0), added(w_i, w_j), rolled

    moved = motion(sphere.MID_VELOCITY, sphere.MID_SPIN)
    distance = math.sqrt(dot(path, path))
    inverse, reach = 1.0 / max(distance, 1e-300), r_i + r_j
    overlap = reach - distance
    half = 0.5 * world.dt
    past = path[0] - half * moved[0][0], path[1] - half * moved[0][1], path[2] - half * moved[0][2]
    back = 1.0 / max(math.sqrt(dot(past, past)), 1e-300)
    return Frame(
        overlap, scaled(path, inverse), scaled(past, back), (r_i - 0.5 * overlap, r_j - 0.5 * overlap), r_i * r_j / reach,
        m_i * m_j / (m_i + m_j), moved, motion(sphere.END_VELOCITY, sphere.END_SPIN),
    )  # fmt: skip


def scaled(a, factor):
    return a[0] * factor, a[1] * factor, a[2] * factor


def carry(frame, memory, dt):
    """Turn the remembered axis with the contact, or choose one at first touch; the other is normal times it."""
    n, p, e = frame.n, frame.middle, three(memory, contact_state.AXIS)
    twist = 0.5 * dt
    twist *= dot(frame.moved[1], p)
    e = added(e, cross(p, e), twist)
    if memory[contact_state.SLIP] == 0.0:
        e = (1.0, 0.0, 0.0) if abs(n[2]) > 0.5 else (0.0, 0.0, 1.0)
    along = dot(e, n) / dot(p, n)
    e = e[0] - along * p[0], e[1] - along * p[1], e[2] - along * p[2]
    frame.e = scaled(e, 1.0 / math.sqrt(dot(e, e)))
    frame.d = cross(n, frame.e)


def slipping(frame, motion, normal):
    """Velocity of the owner's surface relative to the partner's: the arms are the radii less half the overlap."""
    v, w, rolled = motion
    half = 0.5 * frame.overlap
    o = rolled[0] - half * w[0], rolled[1] - half * w[1], rolled[2] - half * w[2]
    return added(v, cross(o, normal), -1.0)


def rolling(S, i, j, frame, world):
    """Relative rotation of the step and its rate at the end, and the way of the patch over the two surfaces. The rotation about
    the normal of a step belongs to its middle, as slip does."""
    e, d, dt = frame.e, frame.d, world.dt

    def relative(column):
        w = three(S[i], column)
        return w if j < 0 else added(w, three(S[j], column), -1.0)

    w, end = relative(sphere.MID_SPIN), relative(sphere.END_SPIN)
    turn = Turn(dot(w, e) * dt, dot(w, d) * dt, dot(end, e), dot(end, d))
    twist = Twist(dot(w, frame.middle) * dt, dot(end, frame.n))
    a, b = surfaces(S, i, j, frame, world, sphere.MID_VELOCITY, sphere.MID_SPIN)
    share, p = 0.0, (0.0, 0.0, 0.0)
    if j >= 0:
        share, p = S[i][sphere.RADIUS] / (S[i][sphere.RADIUS] + S[j][sphere.RADIUS]), three(S[j], sphere.MID_VELOCITY)
    u = three(S[i], sphere.MID_VELOCITY)
    c = tuple((1.0 - share) * u[k] + share * p[k] - 0.5 * (a[k] + b[k]) for k in range(3))
    along, across = dot((c[0], c[1], c[2]), e), dot((c[0], c[1], c[2]), d)
    return (turn, twist), (along * dt, across * dt)


def surfaces(S, i, j, frame, world, v, w):
    def surface(sphere, r):
        u, o = three(sphere, v), three(sphere, w)
        return u[0] + o[1] * r[2] - o[2] * r[1], u[1] + o[2] * r[0] - o[0] * r[2], u[2] + o[0] * r[1] - o[1] * r[0]

    own = surface(S[i], scaled(frame.n, -frame.arms[0]))
    if j == -1:
        return own, (0.0, 0.0, 0.0)
    if j < -1:
        return own, (world.v_x, world.v_y, world.P[(-1 - j) // BASINS - 1][patch.VELOCITY])
    return own, surface(S[j], scaled(frame.n, frame.arms[1]))


def requested(S, i, j, memory, laws, turns, world):
    frame = with_plate(S[i], j, world) if j < 0 else with_sphere(S[i], S[j], world)
    carry(frame, memory, world.dt)
    n, e, d = frame.n, frame.e, frame.d
    slip, end = slipping(frame, frame.moved, frame.middle), slipping(frame, frame.moves, n)
    rotation, roll = rolling(S, i, j, frame, world) if turns else (STILL, (0.0, 0.0))
    report = Contact(frame.overlap, frame.radius, frame.mass, dot(end, n), dot(slip, e) * world.dt, dot(slip, d) * world.dt,
                   dot(end, e), dot(end, d), *(roll if laws.rolls else (0.0, 0.0)))  # fmt: skip
    return frame, report, rotation


def interact(S, i, j, kind, memory, laws, turns, world):
    frame, report, rotation = requested(S, i, j, memory, laws, turns, world)
    n, e, d = frame.n, frame.e, frame.d
    old, stored, viscous = laws.split(memory)
    answer = laws.request(report, rotation, kind, old)
    if laws.force is not None:
        answer.work += laws.friction_takes(stored, answer.stored_t, old, answer.memory, report, rotation) - answer.lost
    f, x, y = answer.normal, answer.x, answer.y
    force = tuple(f * n[k] + x * e[k] + y * d[k] for k in range(3))
    moment = added(scaled(e, answer.moment[0]), d, answer.moment[1])
    torque, back = torques(S, i, j, frame, (x, y))
    if laws.turns:
        both = added(moment, n, answer.twist)
        torque, back = added(torque, both), added(back, both, -1.0)
    memory[contact_state.AXIS3] = e
    memory[contact_state.SLIP] = max(memory[contact_state.SLIP] + answer.slip, contact_state.CLOSED)
    memory[contact_state.LAW : contact_state.LAW + laws.retained + laws.dashpots] = laws.joined(answer)
    damped = laws.dashpots_take(viscous, answer.viscous, dot(frame.moved[0], frame.middle) * world.dt, report, rotation)
    return Done((force[0], force[1], force[2]), torque, back, moment, frame, answer, damped)


def torques(S, i, j, frame, friction):
    """Torques of the tangential force, told along the frame's axes, about the centres of owner and partner."""
    (x, y), e, d, half = friction, frame.e, frame.d, 0.5 * frame.overlap
    turning = (x * d[0] - y * e[0], x * d[1] - y * e[1], x * d[2] - y * e[2])  # normal times tangential force
    none = (0.0, 0.0, 0.0)
    return scaled(turning, half - S[i][sphere.RADIUS]), scaled(turning, half - S[j][sphere.RADIUS]) if j >= 0 else none


def let_go(S, i, j, memory, laws, turns, world):
    """Wipe the memory of a contact that has opened; the energy that friction and that its dashpots took, J."""
    old, lost, viscous = laws.split(memory)
    frame, report, rotation = requested(S, i, j, memory, laws, turns, world)
    if laws.force is not None:
        lost = laws.friction_takes(lost, 0.0, old, [0.0] * len(old), report, rotation)
    damped = laws.dashpots_take(viscous, [0.0] * len(viscous), dot(frame.moved[0], frame.middle) * world.dt, report, rotation)
    memory[:] = [0.0] * len(memory)
    return lost, damped


def write_record(S, i, j, done, world, rolling):
    frame, answer, n = done.frame, done.answer, done.frame.n
    R = [0.0] * record_width(rolling)
    R[record.POINT3] = added(three(S[i], sphere.ARM), n, -frame.arms[0])
    R[record.PARTNER_POINT3] = added(three(S[j], sphere.ARM), n, frame.arms[1]) if j >= 0 else (0.0, 0.0, 0.0)
    R[record.NORMAL3] = n
    R[record.TANGENTIAL_FORCE3] = [answer.x * frame.e[k] + answer.y * frame.d[k] for k in range(3)]
    R[record.SPHERE_RADIUS], R[record.PARTNER_RADIUS] = S[i][sphere.RADIUS], S[j][sphere.RADIUS] if j >= 0 else 0.0
    R[record.CONTACT_RADIUS], R[record.PEAK_PRESSURE] = answer.radius, answer.pressure
    R[record.OVERLAP], R[record.NORMAL_FORCE], R[record.LOAD] = frame.overlap, answer.normal, answer.load
    R[record.FRICTION_LIMIT], R[record.CRITICAL_SLIP], R[record.EFFECTIVE_RADIUS] = answer.limit, answer.critical, frame.radius
    R[record.STORED_NORMAL], R[record.STORED_TANGENTIAL] = answer.stored_n, answer.stored_t
    R[record.SURFACE_VELOCITY3], R[record.PARTNER_VELOCITY3] = surfaces(
        S, i, j, frame, world, sphere.END_VELOCITY, sphere.END_SPIN
    )
    if len(R) > record.MOMENT:
        R[record.MOMENT3], R[record.MOMENT_LIMIT] = done.moment, answer.moment_limit
    if len(R) > record.TWIST_MOMENT:
        R[record.TWIST_MOMENT], R[record.TWIST_LIMIT] = answer.twist, answer.twist_limit
    return R


# what a labeller sees of every body in a sampled step; the labeller itself is the compiled one

FAR = 67108864.0  # 2^26: spheres that a name of a contact can tell apart


def update_labels(reference, v):
    """Let the labeller observe all bodies of a reference; `v` is the mean velocity of the upper plate."""
    behind = max(contact_state.LAW + len(reference.physics.history), contact_state.MIN_WIDTH)
    speed = (v[0] * v[0] + v[1] * v[1]) ** 0.5
    for b, B in enumerate(reference.B):
        seen = [entry for entry in reference.slots(b) if reference.memory[reference.pairs[entry[0]]][contact_state.SLIP] != 0.0]
        # its memory per contact: that of the owner's body, then that of the partner's
        parts = [behind + (reference.physics.contact_memory if sign < 0.0 else 0) for _, sign in seen]
        pairs = [reference.pairs[k] for k, _ in seen]
        C = np.zeros((len(seen), loaded_contact.MEMORY + reference.physics.contact_memory))
        for n, (pair, (_, sign), part) in enumerate(zip(pairs, seen, parts, strict=True)):
            C[n, : loaded_contact.MEMORY] = contact_row(pair, sign, reference.memory[pair], reference.records[pair])
            C[n, loaded_contact.MEMORY :] = reference.memory[pair][part : part + reference.physics.contact_memory]
        memory = np.array(reference.M[b])
        reference.physics.observe(C, len(seen), body_row(B, reference.A, reference.drag, speed), memory)
        reference.M[b] = memory.tolist()
        for n, (pair, part) in enumerate(zip(pairs, parts, strict=True)):
            reference.memory[pair][part : part + reference.physics.contact_memory] = C[n, loaded_contact.MEMORY :].tolist()


def contact_row(pair, sign, H, R):
    """A contact as its owner (sign 1) or its partner (-1) sees it; the labeller's own memory is left out."""
    C = [0.0] * loaded_contact.MEMORY
    owner, (i, j) = sign > 0.0, pair
    C[loaded_contact.PARTNER] = DEBRIS if j >= 0 else (LOWER if j == -1 else UPPER)
    of_owner = (record.POINT, record.PARTNER_VELOCITY, record.SPHERE_RADIUS)
    of_partner = (record.PARTNER_POINT, record.SURFACE_VELOCITY, record.PARTNER_RADIUS)
    point, velocity, curvature = of_owner if owner else of_partner
    C[loaded_contact.POINT3] = R[point : point + 3]
    C[loaded_contact.PARTNER_VELOCITY3] = R[velocity : velocity + 3]
    C[loaded_contact.NORMAL3] = [sign * n for n in R[record.NORMAL3]]
    C[loaded_contact.TANGENTIAL_FORCE3] = [sign * t for t in R[record.TANGENTIAL_FORCE3]]
    C[loaded_contact.SPHERE_RADIUS], C[loaded_contact.SLIP] = R[curvature], H[contact_state.SLIP] - contact_state.CLOSED
    for name in ("CONTACT_RADIUS", "OVERLAP", "NORMAL_FORCE", "LOAD", "FRICTION_LIMIT", "CRITICAL_SLIP"):
        C[getattr(loaded_contact, name)] = R[getattr(record, name)]
    here, there = (i, max(j, -1 - BASINS)) if owner else (j, i)
    C[loaded_contact.IDENTITY] = here * FAR + there + 1.0 + 2.0 * BASINS
    return np.array(C)


def body_row(B, A, drag, speed):
    O = [0.0] * observed_body.WIDTH  # noqa: E741
    O[observed_body.MASS] = B[body.MASS]
    for to, column in (
        (observed_body.POSITION, body.POSITION), (observed_body.VELOCITY, body.VELOCITY), (observed_body.SPIN, body.SPIN),
        (observed_body.FORCE, body.FORCE), (observed_body.TORQUE, body.TORQUE),
        (observed_body.EFFECT_FORCE, EFFECT_FORCE), (observed_body.EFFECT_TORQUE, EFFECT_TORQUE),
    ):  # fmt: skip
        O[to : to + 3] = B[column : column + 3] if column < len(B) else (0.0, 0.0, 0.0)
    ball = B[body.SPHERE_INERTIA] != 0.0
    O[observed_body.QUATERNION4] = rotated(quaternion(B), three(B, body.SPIN), A[run_totals.BEHIND] if ball else 0.0)
    O[observed_body.ELAPSED] = A[run_totals.ELAPSED]
    O[observed_body.PLATE_SHIFT : observed_body.PLATE_SHIFT + 2] = A[run_totals.SHIFT_X], A[run_totals.SHIFT_Y]
    heading = A[run_totals.HEADING], A[run_totals.HEADING + 1]
    O[observed_body.DRAG2] = drag if heading == (0.0, 0.0) else heading
    O[observed_body.PLATE_SPEED] = speed
    return np.array(O)
