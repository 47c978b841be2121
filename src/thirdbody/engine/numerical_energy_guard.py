"""A guard of the implicit integrator: its own line of the energy ledger may take energy, but not make it.

The balance closes with that line in it, so the residual cannot see what the integrator, or a law with a wrong tangent or stored
energy, makes or loses there.
"""

from __future__ import annotations

import numpy as np

from thirdbody.engine.state import Array, State
from thirdbody.kernels.columns import body, body_extra, patch, run_totals

MADE_GUARD = 0.1
"""Energy made, over the energy exchanged, at which a run stops, of each body and of the whole. Sound runs stay below 0.05 of a
single body in its first instants, and below 0.005 later."""


def created_fraction(totals: Array, held: Array | float) -> Array:
    """Energy (n,) that the integrator has made (below zero: lost), over the energy exchanged.

    That is the largest of the sum of |plate work increments|, of the work of effects, and of all that was dissipated or is still
    `held` (n,), J, as kinetic and elastic energy. `totals` (n, run_totals.WIDTH).
    """
    spent = totals[:, run_totals.FRICTION_WORK] + totals[:, run_totals.DAMPING_WORK] + held
    scale = np.maximum(np.maximum(totals[:, run_totals.PLATE_WORK_SIZE], np.abs(totals[:, run_totals.EFFECT_WORK])), spent)
    return np.divide(-totals[:, run_totals.NUMERICAL_LOSS], scale, out=np.zeros(len(totals)), where=scale > 0.0)


def body_energies(state: State, stored: Array) -> Array:
    """Kinetic energy (n,) of each body, and of its patch where that is free, and the elastic energy `stored` (n,), J."""
    B, E, P = state.B, state.E, state.P[state.patch]
    kinetic = B[:, body.MASS] * np.sum(B[:, body.VELOCITY3] ** 2, axis=1)
    kinetic += np.sum(E[:, body_extra.ANGULAR_MOMENTUM3] * B[:, body.SPIN3], axis=1)
    kinetic += P[:, patch.FREE] * P[:, patch.MASS] * P[:, patch.VELOCITY] ** 2
    return 0.5 * float(state.inertial) * kinetic + stored
