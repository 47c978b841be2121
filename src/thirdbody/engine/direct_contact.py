"""Direct contact of the plates (`kernels.plates`): its parameters, and force and energy for the implicit integrator."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from thirdbody.kernels.tables import patch

Array = NDArray[np.float64]


@dataclass(frozen=True)
class DirectContact:
    """Force at zero gap [N], length u_0 over which it falls by a factor e [m], friction coefficient."""

    prefactor: float
    length: float
    friction: float

    def force(self, gap: float) -> float:
        """Return the normal force [N] at a mean gap [m]."""
        return self.prefactor * math.exp(-gap / self.length)

    def gap(self, load: float) -> float:
        """Return the mean gap [m] at which direct contact alone carries a load [N]."""
        return self.length * math.log(self.prefactor / load)

    def columns(self) -> dict[int, float]:
        """Return the values of the plate's row by column (`kernels.tables.patch`)."""
        return {
            patch.DIRECT_PREFACTOR: self.prefactor, patch.DIRECT_LENGTH: self.length, patch.DIRECT_FRICTION: self.friction,
        }  # fmt: skip


def direct_reaction(row: Array, displacement: float) -> tuple[float, float]:
    """Return force [N] and stiffness [N/m] of direct contact of a plate that rises by a displacement [m]; row: of the patch."""
    if row[patch.DIRECT_PREFACTOR] == 0.0:
        return 0.0, 0.0
    force = float(row[patch.DIRECT_PREFACTOR] * np.exp(-(row[patch.HEIGHT] + displacement) / row[patch.DIRECT_LENGTH]))
    return force, force / float(row[patch.DIRECT_LENGTH])


def direct_energy(P: Array) -> float:
    """Return the elastic energy [J] of direct contact: the integral of the force from the present gap of the plate on."""
    return sum(direct_reaction(row, 0.0)[0] * float(row[patch.DIRECT_LENGTH]) for row in P[P[:, patch.DIRECT_PREFACTOR] > 0.0])


def direct_loss(row: Array, displacement: float) -> float:
    """Return the energy [J] that a step which ended at the present height loses, as the force at its end acts all along."""
    before, after = direct_reaction(row, -displacement)[0], direct_reaction(row, 0.0)[0]
    return (before - after) * float(row[patch.DIRECT_LENGTH]) - after * displacement
