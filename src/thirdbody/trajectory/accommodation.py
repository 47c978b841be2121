"""Velocity accommodation: how the speed V of the upper plate is taken up between the plates (Y. Berthier, Wear 139, 1990).

The surface of a body at a contact moves with v + w x r: velocity and spin of the body, and the contact point from its centre of
mass. All speeds are components along the first direction of motion of the upper plate, relative to the lower one; on a path that
is no straight line, along its velocity now. Means over the bodies at a plate have the weights p (upper plate) and q (lower
plate), whose sums are 1:

    upper slip    sum p (V - v - w x r)            V minus the surface speed of the bodies at the upper plate
    lower slip    sum q (v + w x r)                the surface speed of the bodies at the lower plate
    rolling       sum p (w x r) - sum q (w x r)    what their rotation adds between both plates
    shear         sum p v - sum q v                velocities of the bodies at the upper plate minus those at the lower one

r is the mean of the contact points of a body with that plate, by normal force. The four add up to V identically, and none is
computed as the remainder.

The weights follow the load on its way from plate to plate. A body that touches both passes on the smaller of its two normal
forces, with the same weight in p and q; alone it has slip and rolling, but no shear. What a plate carries beyond that passes
through other bodies: the smaller of the two remainders is spread over the bodies by theirs. A body without load, or that rests on
one plate by its weight or hits it, passes nothing on and does not count. Where bodies do not meet each other there is no shear.
"""

from __future__ import annotations

import numpy as np

from thirdbody.engine.state import State
from thirdbody.engine.upper_plate import rate_before
from thirdbody.kernels.tables import LOWER, UPPER, drive
from thirdbody.trajectory.contacts import FrameContacts
from thirdbody.trajectory.names import ACCOMMODATION

Array = np.ndarray


def has_accommodation(state: State, drag: Array) -> bool:
    """Return whether a scene has two plates of which the upper one moves; `drag`: first direction of motion."""
    return state.world.lower is not None and state.world.upper is not None and bool(np.any(drag))


def accommodation(drag: Array, state: State, contacts: FrameContacts | None = None) -> Array:
    """Return the four parts of the plate's speed now [m/s] and 1, (5,); zeros where no load passes from plate to plate.

    The mean of the last number over time is the fraction of the time in which the parts are defined (`parts_of`). `drag` (3,):
    unit vector of the first motion of the upper plate. `contacts`: those of now, if known; they must have records.
    """
    assert state.world.upper is not None
    schedule = state.world.upper.schedule
    if not schedule.straight:
        drag = np.array([*schedule.heading_at(state.time), 0.0])
    (lower, lower_rim), (upper, upper_rim) = _plate_contacts(state, drag, contacts or FrameContacts(state))
    weights = transmitting_weights(upper, lower, state.world.debris_meets)
    if weights is None:
        return np.zeros(len(ACCOMMODATION) + 1)
    p, q = weights
    # sums without BLAS, whose bits depend on the number of its threads
    velocity = np.sum(state.bodies.velocity * drag, axis=1)
    top, bottom, rim, ground = (float(np.sum(product)) for product in (p * velocity, q * velocity, p * upper_rim, q * lower_rim))
    rates = state.drive[drive.VELOCITY2] if state.sprung else [rate_before(axis, state.time) for axis in (schedule.x, schedule.y)]
    speed = sum(float(rate) * float(e) for rate, e in zip(rates, drag, strict=False))
    return np.array([speed - top - rim, bottom + ground, rim - ground, top - bottom, 1.0])


def parts_of(mean: Array) -> dict[str, float]:
    """Return the parts [m/s] by the names of the series, of a mean (5,) of `accommodation`; NaN where no load ever passed."""
    loaded = float(mean[-1])
    return {name: float(x) / loaded if loaded > 0.0 else np.nan for name, x in zip(ACCOMMODATION, mean, strict=False)}


def _plate_contacts(state: State, drag: Array, contacts: FrameContacts) -> list[tuple[Array, Array]]:
    """Return what the bodies have of each plate, the lower one first; contacts that pull do not count.

    It is the normal force of the plate [N], and what the spin of the body adds to the speed there [m/s], each (n_bodies,).
    """
    n, pushes = state.n_bodies, contacts.normal_force > 0.0
    on = np.flatnonzero(pushes & ((contacts.side == LOWER) | (contacts.side == UPPER)))
    owner, force, point = contacts.owner[on], contacts.normal_force[on], contacts.arm.take(on, axis=0)  # 4 times as fast as [on]
    spin = state.bodies.spin
    # (w x r) . e = r . (e x w); e has no component along z
    crossed = np.column_stack([drag[1] * spin[:, 2], -drag[0] * spin[:, 2], drag[0] * spin[:, 1] - drag[1] * spin[:, 0]])
    added, at = np.einsum("ij,ij->i", point, crossed.take(owner, axis=0)), owner + n * (contacts.side[on] == UPPER)
    totals, sums = np.bincount(at, force, 2 * n), np.bincount(at, force * added, 2 * n)
    means = np.divide(sums, totals, out=np.zeros(2 * n), where=totals > 0.0)
    return [(totals[:n], means[:n]), (totals[n:], means[n:])]


def transmitting_weights(upper: Array, lower: Array, meet: bool) -> tuple[Array, Array] | None:
    """Return the weights p and q of the bodies at the upper and the lower plate; None where no load passes.

    `upper`, `lower` (n_bodies,): normal forces of the plates [N]; `meet`: whether load can pass from body to body.
    """
    alone = np.minimum(upper, lower)
    rests = upper - alone, lower - alone
    sums = [float(rest.sum()) for rest in rests]
    through = min(sums) if meet else 0.0
    load = float(alone.sum()) + through
    if load == 0.0:
        return None
    p, q = ((alone + (through / total) * rest if through else alone) / load for rest, total in zip(rests, sums, strict=True))
    return p, q
