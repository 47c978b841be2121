"""Guard against energy created by the implicit integrator; numerical dissipation is allowed.

The energy balance closes including the numerical line of the ledger, so the residual does not show energy created or lost there
by the integrator, or by a law with a wrong tangent or stored energy.
"""

import numpy as np

from thirdbody.engine.state import Array, State
from thirdbody.kernels.tables import body, body_extra, patch, run_totals

CREATED_ENERGY_GUARD = 0.1
"""Largest created energy over the exchanged energy, for each body and for all. Valid runs stay below 0.05 for a single body at
the very start, and below 0.005 later."""


NEGLIGIBLE = 0.01
"""Exchanged energy below which that of a body is no scale, as a fraction of the mean of all bodies. The tolerance of a step is a
length, which does not resolve the weak impacts of bodies that carry no load between rough plates: they may create a tenth of what
they exchange, a millionth of what a loaded body exchanges."""


def created_fractions(totals: Array, stored: Array, whole: Array) -> tuple[Array, float]:
    """Return the energy created by the integrator (negative: lost) over the exchanged energy: of each body (n,), and of all.

    `totals`: (n, run_totals.WIDTH); `stored`: kinetic and elastic energy (n,) [J]; `whole`: totals of the run, with those of a
    common plate. The exchanged energy of a body is at least NEGLIGIBLE times the mean.
    """
    scales, all_scale = exchanged_energy(totals, stored), float(exchanged_energy(whole[None], stored.sum())[0])
    if not all_scale > 0.0:
        return np.zeros(len(totals)), 0.0
    scales = np.maximum(scales, NEGLIGIBLE * all_scale / len(totals))
    return -totals[:, run_totals.NUMERICAL_LOSS] / scales, -float(whole[run_totals.NUMERICAL_LOSS]) / all_scale


def exchanged_energy(totals: Array, stored: Array) -> Array:
    """Return the largest (n,) [J] of: sum of |plate work increments|; |work of effects|; dissipated plus `stored` energy."""
    spent = totals[:, run_totals.FRICTION_WORK] + totals[:, run_totals.DAMPING_WORK] + stored
    return np.maximum(np.maximum(totals[:, run_totals.PLATE_WORK_SIZE], np.abs(totals[:, run_totals.EFFECT_WORK])), spent)


def body_energies(state: State, stored: Array) -> Array:
    """Return kinetic energy of each body and its free patch plus elastic energy `stored`, all (n,) [J]."""
    B, E, P = state.B, state.E, state.P[state.patch]
    kinetic = B[:, body.MASS] * np.sum(B[:, body.VELOCITY3] ** 2, axis=1)
    kinetic += np.sum(E[:, body_extra.ANGULAR_MOMENTUM3] * B[:, body.SPIN3], axis=1)
    kinetic += P[:, patch.FREE] * P[:, patch.MASS] * P[:, patch.VELOCITY] ** 2
    return 0.5 * float(state.inertial) * kinetic + stored
