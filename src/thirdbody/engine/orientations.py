"""Orientations of the bodies at a stop."""

import numpy as np

from thirdbody.engine.state import Array, State
from thirdbody.kernels.tables import body, run_totals


def orientations(state: State) -> Array:
    """Return the quaternions of all bodies now (n, 4), a copy; a state may be behind (`kernels.bodies`)."""
    q, behind = state.bodies.quaternion.copy(), state.A[run_totals.BEHIND]
    balls = np.flatnonzero(state.B[:, body.SPHERE_INERTIA]) if behind != 0.0 else np.zeros(0, np.int64)
    half = 0.5 * behind * state.bodies.spin[balls]
    half *= 1.0 + np.sum(half * half, axis=1, keepdims=True) / 3.0  # the tangent
    w, v = q[balls, :1], q[balls, 1:]
    q_new = np.hstack((w - np.sum(half * v, axis=1, keepdims=True), v + w * half + np.cross(half, v)))
    q[balls] = q_new / np.linalg.norm(q_new, axis=1, keepdims=True)
    return q
