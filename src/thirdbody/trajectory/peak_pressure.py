"""Peak pressures of contacts, of the elastic indentation alone: the distribution of a dashpot's force is unknown."""

from collections.abc import Mapping, Sequence

import numpy as np

from thirdbody.engine.state import State
from thirdbody.laws.contract import Material
from thirdbody.laws.elasticity import e_star


class HertzPressure:
    """Peak pressures of the contacts of a frame from overlap, contact radius and the two materials."""

    def __init__(self, state: State, materials: Sequence[Material]):
        world = state.world
        self.moduli = np.array([[e_star(a, b) for b in materials] for a in materials])
        self.of_body = state.material[state.given]
        self.of_plate = {-1: world.lower, -2: None if world.upper is None else world.upper.material}

    def materials(self, contacts: Mapping[str, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
        """Return the material codes of each contact's body and of its partner, (n,) and (n,)."""
        partner = contacts["partner"]
        other = self.of_body[np.maximum(partner, 0)]
        for side, material in self.of_plate.items():
            if material is not None:
                other = np.where(partner == side, material, other)
        return self.of_body[contacts["body"]], other

    def peak(self, contacts: Mapping[str, np.ndarray]) -> np.ndarray:
        """Return Hertz' peak pressure p0 = 2 E* d/(pi a) (n,) [Pa]: 3 N/(2 pi a^2) with the elastic force N = (4/3) E* a d.

        Willert, Eq. 5 with a^2 = R d. Zero without overlap.
        """
        overlap, a = np.maximum(contacts["overlap"], 0.0), contacts["contact_radius"]
        strain = np.divide(2.0 * overlap, np.pi * a, out=np.zeros_like(a), where=a > 0.0)
        return self.moduli[self.materials(contacts)] * strain
