"""Guard against energy created by the implicit integrator; numerical dissipation is allowed.

The energy balance closes including the numerical line of the ledger, so the residual does not show energy created or lost there
by the integrator, or by a law with a wrong tangent or stored energy.
"""

import numpy as np

from thirdbody.engine.state import Array, State
from thirdbody.kernels.columns import body, body_extra, patch, run_totals

CREATED_ENERGY_GUARD = 0.1
"""Largest created energy over the exchanged energy, for each body and for all. Valid runs stay below 0.05 for a single body at
the very start, and below 0.005 later."""


def created_fraction(totals: Array, stored: Array | float) -> Array:
    """Return the energy (n,) created by the integrator (negative: lost) over the exchanged energy.

    The exchanged energy is the largest of: sum of |plate work increments|; |work of effects|; dissipated plus `stored` (n,) [J]
    kinetic and elastic energy. `totals`: (n, run_totals.WIDTH).
    """
    spent = totals[:, run_totals.FRICTION_WORK] + totals[:, run_totals.DAMPING_WORK] + stored
    scale = np.maximum(np.maximum(totals[:, run_totals.PLATE_WORK_SIZE], np.abs(totals[:, run_totals.EFFECT_WORK])), spent)
    return np.divide(-totals[:, run_totals.NUMERICAL_LOSS], scale, out=np.zeros(len(totals)), where=scale > 0.0)


def body_energies(state: State, stored: Array) -> Array:
    """Return kinetic energy of each body and its free patch plus elastic energy `stored`, all (n,) [J]."""
    B, E, P = state.B, state.E, state.P[state.patch]
    kinetic = B[:, body.MASS] * np.sum(B[:, body.VELOCITY3] ** 2, axis=1)
    kinetic += np.sum(E[:, body_extra.ANGULAR_MOMENTUM3] * B[:, body.SPIN3], axis=1)
    kinetic += P[:, patch.FREE] * P[:, patch.MASS] * P[:, patch.VELOCITY] ** 2
    return 0.5 * float(state.inertial) * kinetic + stored
