"""Spring and dashpot along the surface at the friction limit: their sum is the nearest point of the circle of radius mu N."""

from __future__ import annotations

import numpy as np
import pytest

from thirdbody.kernels.columns import law_input, law_output, rolling_input, rolling_output
from thirdbody.kernels.columns.tile import TILE
from thirdbody.laws.codegen.laws import compose
from thirdbody.laws.contract import Material, Pair
from thirdbody.laws.damping import TANGENTIAL_DAMPING
from thirdbody.laws.hertz import HERTZ
from thirdbody.laws.mindlin import MINDLIN

STEEL = Material("steel", 210e9 / 2.6, 0.3, 7850.0)
OVERLAP, RADIUS, MASS, FRICTION = 5e-9, 3e-6, 4e-12, 0.3
NUMBER = 8


@pytest.fixture(scope="module")
def chain():
    laws = (HERTZ, MINDLIN, TANGENTIAL_DAMPING)
    pair = Pair(STEEL, STEEL, FRICTION, 0.6)
    built = compose(laws)
    values = [float(x) for law in built.laws for x in law.mix(pair, {option.name: option.default for option in law.options})]
    return built, np.array(values)


def forces(chain, velocity: np.ndarray) -> dict[str, np.ndarray]:
    """What contacts answer whose springs are at the limit along x, and that move without slip in the step; velocity (n, 2)."""
    built, values = chain
    history = len(built.history)
    I = np.zeros((law_input.HISTORY + history + rolling_input.WIDTH, TILE))  # noqa: E741
    O = np.zeros((law_output.HISTORY + history + rolling_output.WIDTH, TILE))  # noqa: E741
    n = len(velocity)
    I[law_input.OVERLAP], I[law_input.RADIUS], I[law_input.MASS] = OVERLAP, RADIUS, MASS
    e_star = 210e9 / (2.0 * 0.91)
    limit = FRICTION * 4.0 / 3.0 * e_star * np.sqrt(RADIUS) * OVERLAP**1.5
    names = [name.split(".")[-1] for name in built.history]
    I[law_input.HISTORY + names.index("force_x")] = limit
    I[law_input.HISTORY + names.index("energy")] = limit * OVERLAP  # more than T^2/(2 k): the whole force is carried
    I[law_input.VELOCITY_X, :n], I[law_input.VELOCITY_Y, :n] = velocity.T
    built.law(I.ravel(), O.ravel(), n, values)  # a view: O is contiguous
    force = np.stack([O[law_output.TANGENTIAL_X, :n], O[law_output.TANGENTIAL_Y, :n]], axis=1)
    return {"force": force, "limit": O[law_output.FRICTION_LIMIT, :n], "power": O[law_output.DASHPOT_POWER, :n]}


def viscosity(chain) -> float:
    """c of the dashpot [N s/m], from a small velocity along the spring's force, inwards: the sum is then within the limit."""
    v = 1e-6
    answer = forces(chain, np.array([[v, 0.0], [0.0, 0.0]]))
    return float(answer["force"][1, 0] - answer["force"][0, 0]) / v


def test_the_sum_is_the_nearest_point_of_the_circle(chain):
    c, angles = viscosity(chain), np.linspace(0.0, 2.0 * np.pi, NUMBER, endpoint=False)
    velocity = 1e-2 * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    answer = forces(chain, velocity)
    limit = answer["limit"][0]
    free = np.array([limit, 0.0]) - c * velocity
    size = np.linalg.norm(free, axis=1)
    nearest = free * np.minimum(1.0, limit / size)[:, None]
    # c is a difference of forces, known to 1e-9 of mu N here
    np.testing.assert_allclose(answer["force"], nearest, atol=1e-7 * limit)
    # what it dissipates is the work of its own part, at least its square over c (projection onto a convex set)
    part = answer["force"] - np.array([limit, 0.0])
    np.testing.assert_allclose(answer["power"], -np.sum(part * velocity, axis=1), atol=1e-7 * limit * 1e-2)
    assert (answer["power"] >= np.sum(part**2, axis=1) / c - 1e-7 * limit * 1e-2).all()


def test_the_force_changes_no_faster_than_the_dashpot_alone(chain):
    """|F(v) - F(v')| <= c |v - v'|, as for every projection; a dashpot cut back within the limit jumped where v turns from T."""
    c, turn = viscosity(chain), 1e-6
    velocity = 1e-4 * np.array([[turn, 1.0], [-turn, 1.0]])
    force = forces(chain, velocity)["force"]
    assert np.linalg.norm(force[1] - force[0]) <= 1.01 * c * np.linalg.norm(velocity[1] - velocity[0]) + 1e-15 * force[0, 0]
