"""Spring and dashpot along the surface at the friction limit: their sum is the nearest point of the circle of radius mu N."""

from __future__ import annotations

import numpy as np
import pytest

from thirdbody.kernels.columns import contact_tangent, law_input, law_output, rolling_input, rolling_output
from thirdbody.kernels.columns.tile import TILE
from thirdbody.laws.codegen.laws import Chain, compose
from thirdbody.laws.contract import Material, Pair
from thirdbody.laws.damping import TANGENTIAL_DAMPING
from thirdbody.laws.hertz import HERTZ
from thirdbody.laws.mindlin import MINDLIN

STEEL = Material("steel", 210e9 / 2.6, 0.3, 7850.0)
OVERLAP, RADIUS, MASS, FRICTION = 5e-9, 3e-6, 4e-12, 0.3
NUMBER = 8


@pytest.fixture(scope="module")
def chain() -> tuple[Chain, np.ndarray]:
    """The compiled laws and their parameters."""
    laws = (HERTZ, MINDLIN, TANGENTIAL_DAMPING)
    pair = Pair(STEEL, STEEL, FRICTION, 0.6)
    built = compose(laws)
    values = [float(x) for law in built.laws for x in law.mix(pair, {option.name: option.default for option in law.options})]
    return built, np.array(values)


def contacts(chain, velocity: np.ndarray, slip: np.ndarray | float = 0.0) -> np.ndarray:
    """Inputs of contacts whose springs are at the limit along x; velocity [m/s] and slip in the step [m] (n, 2)."""
    built, _ = chain
    I = np.zeros((law_input.HISTORY + len(built.history) + rolling_input.WIDTH, TILE))  # noqa: E741
    n = len(velocity)
    I[law_input.OVERLAP], I[law_input.RADIUS], I[law_input.MASS] = OVERLAP, RADIUS, MASS
    e_star = 210e9 / (2.0 * 0.91)
    limit = FRICTION * 4.0 / 3.0 * e_star * np.sqrt(RADIUS) * OVERLAP**1.5
    names = [name.split(".")[-1] for name in built.history]
    I[law_input.HISTORY + names.index("force_x")] = limit
    I[law_input.HISTORY + names.index("energy")] = limit * OVERLAP  # more than T^2/(2 k): the whole force is carried
    I[law_input.VELOCITY_X, :n], I[law_input.VELOCITY_Y, :n] = velocity.T
    I[law_input.SLIP_X, :n], I[law_input.SLIP_Y, :n] = (slip + np.zeros_like(velocity)).T
    return I


def forces(chain, velocity: np.ndarray, slip: np.ndarray | float = 0.0) -> dict[str, np.ndarray]:
    """What such contacts answer, (n, 2) and (n,)."""
    built, values = chain
    n, width = len(velocity), law_output.HISTORY + len(built.history) + rolling_output.WIDTH
    O = np.zeros((width, TILE))  # noqa: E741
    built.law(contacts(chain, velocity, slip).ravel(), O.ravel(), n, values)  # a view: O is contiguous
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


def test_the_tangent_of_the_sum_is_its_derivative(chain):
    """Against central differences where slip changes the velocity by slip/dt: sticking, sliding, and returned by the dashpot."""
    rate, h = 1e7, 1e-14
    angles = np.linspace(0.1, 2.0 * np.pi + 0.1, NUMBER, endpoint=False)
    slip = 2e-11 * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    velocity = rate * slip
    I = contacts(chain, velocity, slip)  # noqa: E741
    I[law_input.HISTORY + len(chain[0].history) + rolling_input.INVERSE_DT] = rate
    K = np.zeros((contact_tangent.SPOTS_WIDTH, TILE))
    chain[0].tangents(I.ravel(), K.ravel(), NUMBER, chain[1])
    answer = forces(chain, velocity, slip)
    returned = np.linalg.norm(answer["force"], axis=1) > (1.0 - 1e-12) * answer["limit"]
    assert returned.any() and not returned.all()
    for column in range(2):
        step = np.zeros(2)
        step[column] = h
        more, less = (forces(chain, velocity + sign * rate * step, slip + sign * step)["force"] for sign in (1.0, -1.0))
        derivative = (more - less) / (2.0 * h)
        found = np.stack([K[contact_tangent.XX + column, :NUMBER], K[contact_tangent.XX + 2 + column, :NUMBER]], axis=1)
        # a difference of forces of 1e-4 N over 2e-14 m is rounded by some 1e-6 of the stiffness, 1e6 N/m with the dashpot
        np.testing.assert_allclose(found, derivative, rtol=0.0, atol=1e-5 * np.abs(derivative).max())
