"""Spots of a body on one plate that lower the plate under each other: loads, balance of energy, both integrators."""

import math

import numpy as np
import pytest
from thirdbody_three_spot import theory

from thirdbody.assembly.simulation import build
from thirdbody.engine.energy import Ledger
from thirdbody.errors import InputError
from thirdbody.kernels.columns import record
from thirdbody.scene.model import ConstantVelocity, Effects, Motion, Spheres

RADIUS, MIDDLE = 5e-6, 1e-4


def pressed(make, centres, load, integrator, stiff=True):
    """A clump of equal balls with these centres (m), settled between two plates under a load (N)."""
    shape = tuple({"center": tuple(map(float, centre)), "radius": RADIUS} for centre in centres)
    body = Spheres(material="debris", shape=shape, positions=((MIDDLE, MIDDLE, RADIUS),))
    materials = {"ball": make.STEEL, "debris": make.stiffened(make.STEEL) if stiff else make.STEEL}
    settings = {"friction": 0.3, "restitution": 0.3, "size": 2.0 * MIDDLE, "settle": 0.0, "duration": 1.0}
    still = Motion(x=[ConstantVelocity(velocity=0.0)])
    settings |= {"integrator": integrator, "effects": Effects(named={"close_spots": {}}), "patch": {"damping": 7e-5}}
    simulation = make.under_patches([body], materials, load, still, **settings)
    simulation.integrator.advance_to(time=6e-6)
    return simulation


def spots(simulation, side=1.0):
    """Records of the closed contacts whose normals point up (`side` 1) or down."""
    slots = simulation.state.slots
    rows = slots.R[slots.histories.slip > 0.0]
    return rows[rows[:, record.NORMAL + 2] * side > 0.0]


@pytest.mark.parametrize(("radii", "expected"), [(3.0, 0.829), (40.0, 0.984)])
def test_two_equal_spots_of_a_rigid_body_carry_less_than_alone(make, radii, expected):
    """At 3 and 40 contact radii of a lone spot, at the same approach: g N/d = 4/(3 pi) over that distance."""
    g, nu = make.STEEL.shear(), make.STEEL.poisson_ratio
    e, contact = 2.0 * theory.e_star(g, nu, g, nu), 1.2e-7
    approach = contact**2 / RADIUS
    lone, share = 4.0 / 3.0 * e * math.sqrt(RADIUS * approach**3), 1.0
    for _ in range(100):  # load of each over that of a lone one
        share = (1.0 - 4.0 / (3.0 * math.pi * radii) * share) ** 1.5
    assert share == pytest.approx(expected, abs=6e-4)  # digits of the table
    apart = 0.5 * radii * contact
    simulation = pressed(make, [(-apart, 0.0, 0.0), (apart, 0.0, 0.0)], 2.0 * share * lone, "implicit")
    for side in (1.0, -1.0):
        rows = spots(simulation, side)
        # what is left of the swing on landing; the body is 1e-6 softer than rigid
        assert rows[:, record.NORMAL_FORCE] == pytest.approx([share * lone] * 2, rel=2e-6)
        assert rows[:, record.OVERLAP] == pytest.approx([approach] * 2, rel=2e-6)


def test_spots_solve_their_equations_in_both_integrators(make):
    """d_i = (N_i/K)^(2/3) + sum_j g_ij N_j for a triangle of three unlike distances; of equal moduli, half as much."""
    triangle, results = [(-4e-7, 0.0, 0.0), (6e-7, 0.0, 0.0), (0.0, 9e-7, 0.0)], []
    g, nu = make.STEEL.shear(), make.STEEL.poisson_ratio
    stiffness = 4.0 / 3.0 * theory.e_star(g, nu, g, nu) * math.sqrt(RADIUS)
    for integrator in ("explicit", "implicit"):
        rows = spots(pressed(make, triangle, 3e-4, integrator, stiff=False))
        force, places = rows[:, record.NORMAL_FORCE], rows[:, record.POINT3][:, :2]
        distances = np.linalg.norm(places[:, None] - places[None], axis=2)
        np.fill_diagonal(distances, np.inf)
        relief = ((1.0 - nu) / (2.0 * math.pi * g) / distances) @ force
        # the dashpot's force in what is left of the swing on landing
        assert rows[:, record.OVERLAP] == pytest.approx((force / stiffness) ** (2.0 / 3.0) + relief, rel=1e-5)
        assert relief.min() > 0.02 * rows[:, record.OVERLAP].max()
        assert force.sum() == pytest.approx(3e-4, rel=1e-5)
        results.append(np.sort(force))
    assert results[0] == pytest.approx(results[1], rel=1e-4)


def test_no_energy_is_made_as_a_clump_bounces_and_turns(make):
    """An irregular clump of unlike balls on a plane, without friction or damping: energy, and momentum along the plane."""
    balls = [(-1.5e-6, 0.0, 0.0, 4e-6), (1.2e-6, 3e-7, 1e-9, 3.8e-6), (1e-7, 1.4e-6, -1e-9, 4.1e-6)]
    shape = tuple({"center": (x, y, r + z), "radius": r} for x, y, z, r in balls)
    moves = {"velocity": (0.3, 0.1, -1.0), "angular_velocity": (1e3, -2e3, 1e4)}
    body = Spheres(material="ball", shape=shape, positions=((MIDDLE, MIDDLE, 4.1e-6),), **moves)
    keys = {"lower": "ball", "effects": Effects(named={"close_spots": {}}), "time_step": 5e-11}
    simulation = build(make.scene([body], {"ball": make.STEEL}, **keys))
    ledger, before, momentum = Ledger(simulation.state), make.kinetic(simulation), make.momenta(simulation)[0]
    worst, together = 0.0, 0
    for _ in range(40):
        simulation.integrator.advance_to(time=simulation.state.time + 1e-8)
        worst = max(worst, abs(ledger.lines(simulation.state)["residual"]))
        together = max(together, int(make.touching(simulation).sum()))
    assert together == 3 and not make.touching(simulation).any()
    # velocity Verlet swings by a fraction of second order in the step while they touch (3e-5 at twice the step), and comes back
    assert worst < 1e-5 * before
    assert abs(ledger.lines(simulation.state)["residual"]) < 1e-7 * before
    assert make.momenta(simulation)[0][:2] == pytest.approx(momentum[:2], rel=1e-12)  # the forces along the plate cancel
    with pytest.raises(InputError, match="elastic_plastic"):  # they press as Hertz has it
        build(simulation.scene.with_settings({"effects.elastic_plastic": {}}))
