"""Starts that differ by a billionth: how far runs from them part is how far any two runs of a scene can agree."""

import numpy as np

from thirdbody.engine.state import State, refresh_spheres
from thirdbody.kernels.tables import body

NUDGE = 1e-9
"""Standard deviation of the displacements, in parts of a body's size, and of the rotations [rad]."""


def nudge(state: State, number: int, size: float = NUDGE) -> None:
    """Displace all bodies along the plates and rotate them, at random; each `number` gives other displacements."""
    rng = np.random.default_rng(number)
    shift = size * state.rayleigh_radius[:, None] * rng.standard_normal((state.n_bodies, 2))
    state.B[:, body.POSITION : body.POSITION + 2] += shift
    q = state.bodies.quaternion
    q += size * rng.standard_normal(q.shape)
    q /= np.linalg.norm(q, axis=1)[:, None]
    refresh_spheres(state)
