"""A guard of the implicit integrator: its own line of the energy ledger may take energy, but not make it.

The balance closes with that line in it, so the residual cannot see what the integrator, or a law with a wrong tangent or stored
energy, makes or loses there.
"""

from __future__ import annotations

import numpy as np

from thirdbody.engine.state import Array, State
from thirdbody.kernels import layout as at

MADE_GUARD = 0.1
"""Energy made, over the energy exchanged, at which a run stops, of each body and of the whole. Sound runs stay below 0.05 of a
single body in its first instants, and below 0.005 later."""


def created_fraction(totals: Array, held: Array | float) -> Array:
    """Energy (n,) that the integrator has made (below zero: lost), over the energy exchanged.

    That is the largest of the sum of |plate work increments|, of the work of effects, and of all that was dissipated or is still
    `held` (n,), J, as kinetic and elastic energy. `totals` (n, A_COLS).
    """
    spent = totals[:, at.A_FRICTION] + totals[:, at.A_DAMPING] + held
    scale = np.maximum(np.maximum(totals[:, at.A_PLATE_ABS], np.abs(totals[:, at.A_EFFECTS])), spent)
    return np.divide(-totals[:, at.A_NUMERICAL], scale, out=np.zeros(len(totals)), where=scale > 0.0)


def body_energies(state: State, stored: Array) -> Array:
    """Kinetic energy (n,) of each body, and of its patch where that is free, and the elastic energy `stored` (n,), J."""
    B, E, P = state.B, state.E, state.P[state.patch]
    kinetic = B[:, at.B_MASS] * np.sum(B[:, at.B_V : at.B_V + 3] ** 2, axis=1)
    kinetic += np.sum(E[:, at.E_L : at.E_L + 3] * B[:, at.B_W : at.B_W + 3], axis=1)
    kinetic += P[:, at.P_FREE] * P[:, at.P_MASS] * P[:, at.P_V] ** 2
    return 0.5 * float(state.inertial) * kinetic + stored
