"""Close spots of a body on one plate, which lower it under each other: loads, balance of energy, closed paths, both integrators.

Against boundary elements (tamaas, behind `full`): a group of equal paraboloids is pressed as one rigid body (Polonsky, Keer, Wear
231, 1999), which tells how much deeper it sinks than its spots alone, and how they share the load; c = 1/(pi E*)."""

import math

import numpy as np
import pytest
import three_spot_theory as theory
from each import each
from scipy.optimize import brentq
from slow import slow
from spot_groups import Loads, closed_path, solved
from steel import SCENES
import thirdbody
from thirdbody.assembly.simulation import build
from thirdbody.engine.guards import Ledger
from thirdbody.errors import InputError
from thirdbody.kernels.tables import record
from thirdbody.scene.model import ConstantVelocity, Effects, Motion, Spheres
from thirdbody.trajectory.names import LOWER_PLATE, UPPER_PLATE

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
        assert relief.min() > 0.02 * rows[:, record.OVERLAP].max() and force.sum() == pytest.approx(3e-4, rel=1e-5)
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
    assert worst < 1e-5 * before and abs(ledger.lines(simulation.state)["residual"]) < 1e-7 * before
    assert make.momenta(simulation)[0][:2] == pytest.approx(momentum[:2], rel=1e-12)  # the forces along the plate cancel
    with pytest.raises(InputError, match="elastic_plastic"):  # they press as Hertz has it
        build(simulation.scene.with_settings({"effects.elastic_plastic": {}}))


SCENE = SCENES / "three_spot.toml"
E_STAR, SPOT, OVERLAP = 1e11, 1e-6, 1e-8
A = math.sqrt(SPOT * OVERLAP)

CELLS, RIM = 12, 2.0  # grid cells over the contact radius, and empty rim in contact radii
GROUPS = (
    ((0, 0), (3, 0)), ((0, 0), (6, 0)), ((0, 0), (10, 0)), ((0, 0), (4, 0), (1, 5)), ((-5, 0), (0, 0), (6, 0)),
    ((0, 0), (4, 0.5), (8, -0.5), (1, 5), (5, 6), (3, 10)),
)  # fmt: skip
"""Places of the spots, in contact radii."""


def changes(place):
    """The relative changes of approach and loads of a group, against spots alone, by the engine's point loads."""
    n, load = len(place), 4.0 / 3.0 * E_STAR * A * OVERLAP

    def forces(approach):
        depth, radius = np.full(n, approach), np.full(n, SPOT)
        return solved(A * np.array(place), depth, radius, 4.0 / 3.0 * E_STAR, 1.0 / (math.pi * E_STAR)).force

    approach = brentq(lambda d: forces(d).sum() - n * load, OVERLAP, 3.0 * OVERLAP, xtol=1e-20)
    return approach / OVERLAP - 1.0, forces(approach) / load - 1.0


def pressed_elements(tm, place):
    """The same by boundary elements; each spot is solved alone too, which takes the error of the grid out. In units of contact
    radius, overlap and E*: a spot alone has the load 4/3, its gap is r^2/2."""
    low, high = np.min(place, axis=0) - RIM, np.max(place, axis=0) + RIM
    x, y = (low[i] + np.arange(math.ceil((high[i] - low[i]) * CELLS)) / CELLS for i in (0, 1))
    gaps = [((x[:, None] - u) ** 2 + (y[None] - v) ** 2) / 2.0 for u, v in place]
    # a lone contact fills only its corner of the grid: the same to 1e-8 and three hundred times as fast
    corners = [np.ix_(np.abs(x - u) < RIM, np.abs(y - v) < RIM) for u, v in place]
    single = np.array([_solved_on_grid(tm, gap[corner], 1)[1] for gap, corner in zip(gaps, corners, strict=True)])
    heights = np.stack([gap + (single.max() - d) for gap, d in zip(gaps, single, strict=True)])
    pressure, approach = _solved_on_grid(tm, heights.min(axis=0), len(place))
    loads = [pressure[heights.argmin(axis=0) == k].sum() / CELLS**2 for k in range(len(place))]
    return approach / single.max() - 1.0, np.array(loads) / (4.0 / 3.0) - 1.0


def _solved_on_grid(tm, gap, spots):
    """Pressure and approach of a rigid surface under the load of so many spots; the half-space is not periodic."""
    tm.set_log_level(tm.LogLevel.error)
    size = [cells / CELLS for cells in gap.shape]
    model = tm.Model(tm.model_type.basic_2d, size, list(gap.shape))
    model.E, model.nu = 1.0, 0.0
    tm.ModelFactory.registerNonPeriodic(model, "free")
    solver = tm.PolonskyKeerRey(model, -gap, 1e-9)
    solver.setIntegralOperator("free")
    solver.max_iter = 3000
    solver.solve(4.0 / 3.0 * spots / (size[0] * size[1]))
    pressure = np.array(model.traction)
    sunk = np.zeros_like(pressure)
    model.operators["free"](pressure, sunk)
    return pressure, float(np.mean((sunk + gap)[pressure > 0.0]))


@pytest.mark.full(kind="bem")
@pytest.mark.parametrize("group", GROUPS)
def test_loads_and_approach_of_close_spots(group):
    """Relief within 1 % of itself, loads within 0.2 %: measured 0.7 % (where it is small, the grid) and 0.09 %."""
    tm = pytest.importorskip("tamaas")
    (approach, loads), (expected, others) = changes(group), pressed_elements(tm, group)
    assert 1.0 + loads == pytest.approx(1.0 + others, rel=2e-3) and approach == pytest.approx(expected, rel=1e-2)


@pytest.mark.full(kind="slow")  # compiles the solver of spots; at 3 and 40 radii two spots are above
def test_neighbours_press_by_four_thirds_of_a_over_pi_r():
    """N/(pi E* r) over d is 4 a/(3 pi r) for each (Boussinesq): equal spots keep their loads, and sink by it together."""
    for place in ([(0, 0), (20, 0)], [(0, 0), (20, 0), (10, 10 * math.sqrt(3))]):
        approach, loads = changes(place)
        assert approach == pytest.approx((len(place) - 1.0) * 4.0 / (3.0 * math.pi * 20.0), rel=1e-9)
        assert loads == pytest.approx(np.zeros(len(place)), abs=1e-12)
    loads = changes([(-20.0, 0.0), (0.0, 0.0), (20.0, 0.0)])[1]
    assert loads[1] < 0.0 < loads[0] == pytest.approx(loads[2], rel=1e-9)


def test_the_lower_spots_of_the_three_spot_particle_are_the_close_ones(tmp_path):
    scene = thirdbody.Scene.load(SCENE).with_settings({"solver.distance": "2 nm"})
    with thirdbody.run(scene, tmp_path / "run", progress=False) as run:
        table = run.contacts(int(np.searchsorted(run.series["distance"], 2e-12)) - 1)  # the last frame before the drag
    lower = table["partner"] == LOWER_PLATE
    assert np.count_nonzero(lower) == 2 and np.count_nonzero(table["partner"] == UPPER_PLATE) == 1
    force, overlap = table["normal_force"][lower], table["overlap"][lower]
    e_star = 3.0 * force / (4.0 * table["contact_radius"][lower] * overlap)  # Hertz
    # G 60 GPa, nu .35 on G 120 GPa, nu .2: 1/E* = .65/120 + .8/240 per GPa; damping at rest adds nothing
    assert e_star == pytest.approx([114.2857142857e9] * 2, rel=1e-6)
    apart = np.linalg.norm(np.diff(table["position"][lower], axis=0))
    # places of the scene, but for the turn of the particle as its spots give way, 3e-4
    assert apart == pytest.approx(3.5e-6, rel=1e-3)
    relief = force[::-1] / (math.pi * e_star * apart)
    # how much deeper the particle sinks under the same load, to first order
    assert np.average(relief, weights=force / overlap) / overlap.max() == pytest.approx(8.4e-3, rel=0.01)


UNIT_RADIUS, DEPTH, STIFFNESS, COMPLIANCE = 1.0, 0.01, 4.0 / 3.0, 0.5
"""Radius and overlap of a spot; 4/3 E* and g times distance, of unlike solids: 1/(pi E*) would be 0.32."""
CONTACT = (UNIT_RADIUS * DEPTH) ** 0.5


def group(random, n, spacing):
    """Places (n, 2) some contact radii apart, overlaps, some of them small, and radii."""
    while True:
        place = spacing * CONTACT * n**0.5 * random.uniform(-1.0, 1.0, (n, 2))
        apart = np.linalg.norm(place[:, None] - place[None], axis=2) + np.eye(n)
        if apart.min() > 2.0 * CONTACT:
            return place, DEPTH * random.uniform(0.02, 1.0, n), UNIT_RADIUS * random.uniform(0.5, 1.5, n)


def solve(place, depth, radius, **keys) -> Loads:
    return solved(place, depth, radius, STIFFNESS, COMPLIANCE, **keys)


def miss(place, depth, radius, loads):
    """Largest violation of N = K (d - g N)^(3/2) over the largest force, and of relief = g N over the largest overlap."""
    apart = np.linalg.norm(place[:, None] - place[None], axis=2)
    np.fill_diagonal(apart, np.inf)
    relief = (COMPLIANCE / apart) @ loads.force
    force = STIFFNESS * np.sqrt(radius) * np.maximum(depth - relief, 0.0) ** 1.5
    return np.abs(force - loads.force).max() / force.max(), np.abs(relief - loads.relief).max() / depth.max()


@each([1, 2, 3, 7])
def test_spots_solve_their_equations(n):
    """To rounding; one in some groups is relieved wholly. The sweeps agree, with and without scratch for g."""
    random, idle = np.random.default_rng(n), 0
    for k in range(0, 100, 10):
        place, depth, radius = group(random, n, 1.0 + 0.09 * k)
        found = solve(place, depth, radius)
        assert max(miss(place, depth, radius, found)) < 1e-13
        idle += int((found.force == 0.0).any())
        swept = solve(place, depth, radius, swept=True)
        assert found.force == pytest.approx(swept.force, rel=1e-11, abs=1e-13 * swept.force.max())
        assert np.array_equal(swept.force, solve(place, depth, radius, swept=True, scratch=0).force)
    assert n == 1 or idle > 0


@pytest.mark.parametrize(("n", "paths"), [(3, 20), *(slow(n, 700) for n in (2, 3, 5))])
def test_no_closed_path_makes_energy(n, paths):
    """Work along thousands of random closed paths of overlaps and places, spots coming and going, by the trapezoid rule. Smooth
    periodic integrands converge fast, the corner N ~ d^(3/2) of a spot that opens as the 5/2 power of the step."""
    random, idle, phase = np.random.default_rng(10 + n), 0, 2.0 * np.pi * np.arange(2048) / 2048
    waves = np.array([[np.sin(phase), np.cos(phase)], [0.5 * np.sin(2.0 * phase), 0.5 * np.cos(2.0 * phase)]])
    rates = 2.0 * np.pi * np.array([[np.cos(phase), -np.sin(phase)], [np.cos(2.0 * phase), -np.sin(2.0 * phase)]])
    worst = {2048: 0.0, 256: 0.0}
    for _ in range(paths):
        place, depth, radius = group(random, n, 6.0)
        sizes = random.normal(size=(n, 3, 2, 2)) * np.array([CONTACT / 6, CONTACT / 6, DEPTH / 4])[None, :, None, None]
        path, speed = np.einsum("nchp,hpt->tnc", sizes, waves), np.einsum("nchp,hpt->tnc", sizes, rates)
        path[:, :, :2] += place
        for points in worst:
            k = 2048 // points
            work, energy, none = closed_path(path[::k].copy(), speed[::k].copy(), depth, radius, STIFFNESS, COMPLIANCE)
            worst[points], idle = max(worst[points], abs(work) / energy), idle + none
    assert idle > 0.4 * paths and worst[2048] < 2e-6 and worst[2048] < worst[256] / 50.0


def test_the_order_of_spots_does_not_matter_and_forces_along_the_plate_cancel():
    random = np.random.default_rng(5)
    for n in (2, 3, 6):
        for _ in range(60):
            place, depth, radius = group(random, n, 3.0)
            order = random.permutation(n)
            one, other = solve(place, depth, radius), solve(place[order], depth[order], radius[order])
            assert one.force[order] == pytest.approx(other.force, rel=1e-11, abs=1e-13 * one.force.max())
            assert one.pull[order] == pytest.approx(other.pull, rel=1e-9, abs=1e-12 * np.abs(one.pull).max())
    # They act along the line between two spots, so their sum and their moment about the normal vanish.
    random = np.random.default_rng(6)
    for _ in range(60):
        place, depth, radius = group(random, 3, 3.0)
        pull = solve(place, depth, radius).pull
        size = np.abs(pull).max()
        assert np.abs(pull.sum(axis=0)).max() <= 1e-13 * size
        assert abs((place[:, 0] * pull[:, 1] - place[:, 1] * pull[:, 0]).sum()) <= 1e-13 * size * np.abs(place).max()
