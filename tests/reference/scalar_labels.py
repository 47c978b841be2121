"""What a labeller sees of every body in a sampled step, in Python floats; the labeller itself is the compiled one."""

from __future__ import annotations

from typing import Any

import numpy as np
from scalar_bodies import EFFECT_FORCE, EFFECT_TORQUE, quaternion, rotated, three

from thirdbody.kernels.columns import body, contact_state, loaded_contact, observed_body, record, run_totals
from thirdbody.kernels.columns.sides import DEBRIS, LOWER, UPPER
from thirdbody.kernels.predicates import BASINS

FAR = 67108864.0
"""2^26: spheres that a name of a contact can tell apart."""


def update_labels(reference: Any, v: tuple[float, float]) -> None:
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


def contact_row(pair: tuple[int, int], sign: float, H: list[float], R: list[float]) -> np.ndarray:
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
    for to, column in (
        (loaded_contact.CONTACT_RADIUS, record.CONTACT_RADIUS),
        (loaded_contact.OVERLAP, record.OVERLAP),
        (loaded_contact.NORMAL_FORCE, record.NORMAL_FORCE),
        (loaded_contact.LOAD, record.LOAD),
        (loaded_contact.FRICTION_LIMIT, record.FRICTION_LIMIT),
        (loaded_contact.CRITICAL_SLIP, record.CRITICAL_SLIP),
    ):
        C[to] = R[column]
    here, there = (i, max(j, -1 - BASINS)) if owner else (j, i)
    C[loaded_contact.IDENTITY] = here * FAR + there + 1.0 + 2.0 * BASINS
    return np.array(C)


def body_row(B: list[float], A: list[float], drag: tuple[float, float], speed: float) -> np.ndarray:
    """The motion of a body and of the plates."""
    O = [0.0] * observed_body.WIDTH  # noqa: E741
    O[observed_body.MASS] = B[body.MASS]
    for to, column in (
        (observed_body.POSITION, body.POSITION),
        (observed_body.VELOCITY, body.VELOCITY),
        (observed_body.SPIN, body.SPIN),
        (observed_body.FORCE, body.FORCE),
        (observed_body.TORQUE, body.TORQUE),
        (observed_body.EFFECT_FORCE, EFFECT_FORCE),
        (observed_body.EFFECT_TORQUE, EFFECT_TORQUE),
    ):
        O[to : to + 3] = B[column : column + 3] if column < len(B) else (0.0, 0.0, 0.0)
    ball = B[body.SPHERE_INERTIA] != 0.0
    O[observed_body.QUATERNION4] = rotated(quaternion(B), three(B, body.SPIN), A[run_totals.BEHIND] if ball else 0.0)
    O[observed_body.ELAPSED] = A[run_totals.ELAPSED]
    O[observed_body.PLATE_SHIFT] = A[run_totals.SHIFT_X]
    O[observed_body.PLATE_SHIFT + 1] = A[run_totals.SHIFT_Y]
    heading = A[run_totals.HEADING], A[run_totals.HEADING + 1]
    O[observed_body.DRAG2] = drag if heading == (0.0, 0.0) else heading
    O[observed_body.PLATE_SPEED] = speed
    return np.array(O)
