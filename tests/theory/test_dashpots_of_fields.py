"""Tangent of spring plus dashpot for a law with a field, whose spring the tangents take from what the law has answered."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from thirdbody_three_spot.mdr import MDR

from thirdbody.kernels.columns import contact_tangent, law_input, law_output, rolling_input, rolling_output
from thirdbody.kernels.columns.tile import TILE
from thirdbody.kernels.implicit.jacobian import give_springs
from thirdbody.laws.codegen.laws import compose
from thirdbody.laws.contract import Material, Pair
from thirdbody.laws.damping import TANGENTIAL_DAMPING
from thirdbody.laws.hertz import HERTZ

STEEL = Material("steel", 210e9 / 2.6, 0.3, 7850.0)
OVERLAP, RADIUS, MASS, NUMBER, RATE = 5e-9, 3e-6, 4e-12, 8, 1e7


class Bench:
    """The compiled laws on contacts after a slip along x that brings all springs to their limits."""

    def __init__(self) -> None:
        pair, given = Pair(STEEL, STEEL, 0.3, 0.6), {"springs": 16.0, "renewal": 0.0}
        options = {
            law.name: {o.name: given.get(o.name, o.default) for o in law.options} for law in (HERTZ, MDR, TANGENTIAL_DAMPING)
        }
        self.chain = compose(law.sized(options[law.name]) for law in (HERTZ, MDR, TANGENTIAL_DAMPING))
        self.values = np.array([float(x) for law in self.chain.laws for x in law.mix(pair, options[law.name])])
        self.history = len(self.chain.history)
        self.memory = np.zeros((self.history, TILE))
        for slip in ((0.0, 0.0), (OVERLAP, 0.0)):
            self.memory = self.outputs(np.tile(slip, (NUMBER, 1)), 0.0)[law_output.HISTORY : law_output.HISTORY + self.history]

    def inputs(self, slip: np.ndarray, rate: float) -> np.ndarray:
        """Inputs of a step by `slip` (n, 2) [m] in the time 1/rate."""
        I = np.zeros((law_input.HISTORY + self.history + rolling_input.WIDTH, TILE))  # noqa: E741
        I[law_input.OVERLAP], I[law_input.RADIUS], I[law_input.MASS] = OVERLAP, RADIUS, MASS
        I[law_input.HISTORY : law_input.HISTORY + self.history] = self.memory
        I[law_input.SLIP_X, :NUMBER], I[law_input.SLIP_Y, :NUMBER] = slip.T
        I[law_input.VELOCITY_X, :NUMBER], I[law_input.VELOCITY_Y, :NUMBER] = rate * slip.T
        I[law_input.HISTORY + self.history + rolling_input.INVERSE_DT] = rate
        return I

    def outputs(self, slip: np.ndarray, rate: float) -> np.ndarray:
        """What the laws answer."""
        O = np.zeros((law_output.HISTORY + self.history + rolling_output.WIDTH, TILE))  # noqa: E741
        self.chain.law(self.inputs(slip, rate).ravel(), O.ravel(), NUMBER, self.values)  # a view: O is contiguous
        return O

    def forces(self, slip: np.ndarray) -> np.ndarray:
        """Tangential forces (n, 2) [N]."""
        return self.outputs(slip, RATE)[law_output.TANGENTIAL_X : law_output.TANGENTIAL_X + 2, :NUMBER].T

    def tangents(self, slip: np.ndarray) -> np.ndarray:
        """Their derivatives by the slip (n, 2, 2) [N/m], with the springs that the engine gives."""
        O, K = self.outputs(slip, RATE), np.zeros((contact_tangent.SPOTS_WIDTH, TILE))  # noqa: E741
        give_springs.py_func(
            NUMBER, SimpleNamespace(dashpots=0, n_history=self.history), SimpleNamespace(outputs=O.ravel(), tangents=K.ravel())
        )
        self.chain.tangents(self.inputs(slip, RATE).ravel(), K.ravel(), NUMBER, self.values)
        return K[contact_tangent.XX : contact_tangent.XX + 4, :NUMBER].T.reshape(-1, 2, 2)


@pytest.fixture(scope="module")
def bench() -> Bench:
    return Bench()


def test_the_tangent_of_the_sum_is_its_derivative(bench):
    """Against central differences: sticking, sliding, and returned to the limit by the dashpot."""
    h = 1e-14
    angles = np.linspace(0.1, 2.0 * np.pi + 0.1, NUMBER, endpoint=False)
    slip = 2e-11 * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    limit = bench.outputs(slip, RATE)[law_output.FRICTION_LIMIT, :NUMBER]
    # the springs together reach 1 - 1.5 (spacing/2a)^2 of the limit (`mdr`): only the dashpot goes beyond
    returned = np.linalg.norm(bench.forces(slip), axis=1) > (1.0 - 1e-9) * limit
    assert returned.any() and not returned.all()
    found = bench.tangents(slip)
    for column in range(2):
        step = np.zeros(2)
        step[column] = h
        derivative = (bench.forces(slip + step) - bench.forces(slip - step)) / (2.0 * h)
        # a difference of forces of 1e-4 N over 2e-14 m is rounded by some 1e-6 of the stiffness, 1e6 N/m with the dashpot
        np.testing.assert_allclose(found[:, :, column], derivative, rtol=0.0, atol=1e-5 * np.abs(derivative).max())
