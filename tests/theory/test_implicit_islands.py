"""Contact between bodies in the implicit integrator: balances in closed form, impacts, and what must not change the result."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components, reverse_cuthill_mckee
from scipy.spatial import cKDTree
from slow import slow
from thirdbody.engine.accuracy import MEETING_RADII
from thirdbody.engine.guards import Ledger
from thirdbody.engine.islands import STRIDE, _connected
from thirdbody.engine.snapshot import restore, snapshot
from thirdbody.kernels.arguments import Motion
from thirdbody.kernels.implicit import common_plate
from thirdbody.kernels.step_tables import body_solution, step_memory, step_settings
from thirdbody.kernels.tables import body, patch, record, run_totals
from thirdbody.runner.simulate import set_threads
from thirdbody.scene import model

R, LOAD, MU = 5e-6, 1e-4, 0.3
RIGID = {"support": "rigid", "load": 8.0 * LOAD}
FOUNDATION = {"support": "foundation", "load": 8.0 * LOAD, "stiffness": 1e5, "preload": 0.1 * LOAD}
common_plates = pytest.mark.parametrize("plate", [RIGID, FOUNDATION], ids=["rigid", "foundation"])
SIZE, MIDDLE, GAP = 2e-4, 1e-4, 2e-8  # side of the domain, place of the obstacle, and gaps between bodies, m
CLOSED = 1e-6  # largest residual of the ledger: Newton's method leaves 1e-9 of the forces unbalanced in a step
STIFF = 2e-3
"""Deviation of a force from its value for rigid bodies: overlaps tilt the forces by an overlap of 30 nm over the radius."""
BLOCK = tuple(
    {"center": (4e-6 * x, 4e-6 * y, 0.0), "radius": R}
    for x, y in [(0.0, 0.0)] + [(math.cos(k * math.pi / 3.0), math.sin(k * math.pi / 3.0)) for k in range(6)]
)  # seven balls as high as one: it cannot tip


def test_islands_and_the_order_of_their_bodies_are_those_of_scipy():
    random = np.random.default_rng(7)
    for n, side in ((1, 1.0), (3, 1.0), (60, 4.0), (60, 7.0), (900, 28.0), (900, 45.0)):  # one island of all to most alone
        a, b = cKDTree(random.uniform(0.0, side, (n, 2))).query_pairs(1.0, output_type="ndarray").T.astype(np.int64)
        graph = coo_matrix((np.ones(2 * len(a)), (np.append(a, b), np.append(b, a))), (n, n)).tocsr()
        number, order = _connected(a, b, n)
        np.testing.assert_array_equal(number, connected_components(graph, directed=False)[1])
        np.testing.assert_array_equal(order, reverse_cuthill_mckee(graph, symmetric_mode=True))


def dragged(make, debris, pairs=None, speed=1e-3, plate=None, friction=MU, settle=2e-5, contact="auto", **solver):
    """Bodies that meet, each under its own patch unless `plate`, keys of it, says otherwise; `pairs`: other frictions."""
    names = ("ball", "block", "floor")
    frictions = {pair: friction for pair in ((a, b) for a in names for b in names if a <= b)} | (pairs or {})
    held = {"support": "load_per_particle", "load": LOAD} | (plate or {})
    upper = model.UpperPlate(material="ball", motion=model.Motion(x=[model.ConstantVelocity(velocity=speed)]), **held)
    scene = make.scene(
        debris, dict.fromkeys(names, make.STEEL),
        plates=model.Plates(lower=model.LowerPlate(material="floor"), upper=upper),
        contact=model.Contact(level="mindlin", debris_contact=contact), domain=model.Domain(size=(SIZE, SIZE), periodic=True),
        solver=model.Solver(**({"duration": make.LONG, "settle": settle, "integrator": "implicit"} | solver)),
    )  # fmt: skip
    pairs = tuple(model.PairTable(between=names, friction=mu, restitution=0.6) for names, mu in frictions.items())
    return make.build(scene.model_copy(update={"pairs": pairs}))


def row(make, balls, x=MIDDLE):
    first = x - 4e-6 - 2.0 * R - GAP
    places = [((first - k * (2.0 * R + GAP)) % SIZE, MIDDLE, R) for k in range(balls)]
    block = model.Spheres(material="block", shape=BLOCK, positions=((x, MIDDLE, R),))
    return [block, *(make.ball(R, place) for place in places)]


def between_bodies(simulation):
    slots = simulation.state.slots
    return slots.R[(slots.histories.slip > 0.0) & (slots.partner >= 0)]


def ledger_after(simulation, distance):
    ledger, state = Ledger(simulation.state), simulation.state
    simulation.integrator.advance_to(time=simulation.settle)
    for stop in np.linspace(0.25, 1.0, 4) * distance:
        simulation.integrator.advance_to(distance=float(stop))
        ledger.watch(state)
    lines = ledger.lines(state)
    return lines, ledger.relative_residual(state, lines["residual"])


@pytest.mark.parametrize(("mu_pair", "balls"), [(0.0, 1), (MU, 3), slow(0.0, 3), slow(MU, 2)])
def test_a_row_of_balls_against_a_body_that_sticks_to_the_lower_plate(make, balls, mu_pair):
    """Their tops slip, the plate feels mu W from each; between two balls the friction is MU, and mu_pair at the block. A ball
    at rest whose top slips feels mu W there and T below; its neighbours press by N_1 from behind and N_2 from ahead, and rub by
    mu_1 and mu_2 of it. Balance of forces: N_2 - N_1 = mu W + T; of moments: mu W = T + mu_1 N_1 + mu_2 N_2."""
    simulation = dragged(make, row(make, balls), {("block", "floor"): 5.0, ("ball", "block"): mu_pair})
    lines, residual = ledger_after(simulation, 4e-6)
    forces, expected = sorted(between_bodies(simulation)[:, record.NORMAL_FORCE] / LOAD), [0.0]
    for ahead in [MU] * (balls - 1) + [mu_pair]:
        expected.append((2.0 * MU + (1.0 - MU) * expected[-1]) / (1.0 + ahead))
    assert forces == pytest.approx(sorted(expected[1:]), rel=STIFF)
    upper = simulation.state.A[run_totals.UPPER_FORCE3]
    # the upper plate is of the material of the balls
    assert -upper[0] / LOAD == pytest.approx(balls * MU + mu_pair, rel=1e-6)
    assert [make.label(simulation, body) for body in range(balls + 1)] == ["sliding"] * (balls + 1)
    # of what two bodies lose each has a half
    assert simulation.state.B[:, body.FRICTION_WORK].sum() == pytest.approx(lines["friction"], rel=1e-12)
    assert residual < CLOSED and abs(lines["numerical"]) < 1e-3 * lines["plate_work"]


@common_plates
def test_a_ball_and_the_body_that_stops_it_share_the_load_of_one_plate(make, plate):
    """The ball presses by 2 mu N/(1 + mu) of the force N on its top, and rubs down; all tops slip; Hertz gives the height."""
    simulation = dragged(make, row(make, 1), {("block", "floor"): 5.0}, plate=plate)
    assert simulation.integrator.meets and simulation.integrator.together
    lines, residual = ledger_after(simulation, 4e-6)
    state, slots, total = simulation.state, simulation.state.slots, 8.0 + 2.0 * plate.get("preload", 0.0) / LOAD
    is_ball = state.order[state.body[slots.own]] == 1
    on = slots.R[:, record.NORMAL_FORCE] / LOAD
    top, bottom = (float(on[is_ball & side].sum()) for side in (slots.partner < -1, slots.partner == -1))
    push = float(on[slots.partner >= 0].sum())
    assert push == pytest.approx(2.0 * MU * top / (1.0 + MU), rel=STIFF)
    assert top - bottom == pytest.approx(MU * push, abs=STIFF * push)
    # momentum: what the plates feel is all that they give to each other
    upper, lower = state.A[run_totals.UPPER_FORCE3] / LOAD, state.A[run_totals.LOWER_FORCE3] / LOAD
    np.testing.assert_allclose(upper, [-MU * total, 0.0, total], atol=1e-6 * total)
    np.testing.assert_allclose(lower, -upper, atol=1e-6 * total)
    own = state.P[state.patch[int(np.flatnonzero(state.order == 1)[0])]]
    modulus = make.STEEL.youngs_modulus / (2.0 * (1.0 - make.STEEL.poisson_ratio**2))
    squeezed = sum((0.75 * part * LOAD / (modulus * math.sqrt(R))) ** (2.0 / 3.0) for part in (top, bottom))
    assert 2.0 * R - own[patch.HEIGHT] == pytest.approx(squeezed, rel=1e-6)
    if plate is FOUNDATION:
        spring = plate["stiffness"] * (own[patch.HEIGHT] - state.P[-1, patch.HEIGHT])
        assert top * LOAD == pytest.approx(plate["preload"] + spring, rel=1e-6)
    assert [make.label(simulation, body) for body in (0, 1)] == ["sliding", "sliding"]
    assert residual < CLOSED and abs(lines["numerical"]) < 1e-3 * lines["plate_work"]


@common_plates
def test_slopes_of_an_island_are_difference_quotients(make, plate):
    """Change of the force of each body on the plate as it rises, the whole island in balance."""
    # the ball slips above and sticks below: nowhere is friction just at its limit
    frictions = {("block", "floor"): 5.0, ("ball", "floor"): 1.0, ("ball", "block"): 0.0}
    simulation = dragged(make, row(make, 1), frictions, plate=plate)
    ledger_after(simulation, 2e-6)
    one = simulation.integrator
    one.meeting.search()
    dt, h, solutions = one.plate.memory[step_memory.NEXT_DT], 1e-12, []
    for rise in (-h, 0.0, h):
        one.plate.each_island(common_plate.solve_at, True, rise, Motion(dt, 1e-3, 0.0))
        solutions.append(one.solutions.copy())
        one.plate.each_island(common_plate.restore_islands)
    assert len(between_bodies(simulation)) == 1 and all(found[:, body_solution.SOLVED].all() for found in solutions)
    quotient = (solutions[2][:, body_solution.PUSH] - solutions[0][:, body_solution.PUSH]) / (2.0 * h)
    # curved: a fourth of h^2 over the square of an overlap of some nm, and rounding of 1e-9 of the load over h
    np.testing.assert_allclose(solutions[1][:, body_solution.SLOPE], quotient, rtol=1e-4)
    assert np.all(quotient < 0.0)


def test_bodies_that_are_far_apart_are_solved_as_without_contact_between_them(make):
    """The same bits, with the same longest drag of a step."""
    debris, runs = [make.ball(R, (3e-5 + 5e-5 * k, MIDDLE, R)) for k in range(3)], []
    for contact in ("auto", "none"):
        simulation, stop = dragged(make, debris, plate=RIGID, contact=contact), 0.0
        simulation.integrator.settings[step_settings.RADII] = MEETING_RADII
        simulation.integrator.advance_to(time=simulation.settle)
        for _ in range(8):
            stop += STRIDE * R
            simulation.integrator.advance_to(distance=stop)
        runs.append(simulation)
    assert runs[0].integrator.meets and runs[0].integrator.islands.in_islands == 0
    np.testing.assert_array_equal(runs[0].state.B, runs[1].state.B)
    np.testing.assert_array_equal(runs[0].integrator.totals, runs[1].integrator.totals)


def test_a_layer_under_a_rigid_plate_is_that_of_the_explicit_integrator(make):
    """Blocks that ride with the upper plate push balls, at 1 m/s."""
    rng, debris, runs = np.random.default_rng(1), [], {}
    for y in (4e-5, 8e-5, 1.2e-4):
        debris.append(model.Spheres(material="block", shape=BLOCK, positions=((3e-5, y, R),)))
        for k, gap in enumerate(2e-7 * (1.0 + rng.random(2))):
            radius = R * (1.0 - 1e-4 * rng.random())
            debris.append(make.ball(radius, (3.9e-5 + R + k * (2.0 * R + 3e-7) + gap, y + 5e-7 * rng.random(), radius)))
    for kind in ("explicit", "implicit"):
        plate = RIGID | {"load": 30.0 * LOAD}
        simulation = dragged(make, debris, {("block", "floor"): 0.1}, 1.0, plate, settle=5e-6, integrator=kind)
        start = simulation.state.B[:, :2].copy()
        simulation.integrator.advance_to(time=simulation.settle)
        simulation.integrator.advance_to(distance=3e-6)
        force = make.mean_force(simulation, 1e-6) / LOAD
        moved = (simulation.state.B[:, :2] - start)[np.argsort(simulation.state.order)]
        runs[kind] = force, moved, [make.label(simulation, body) for body in range(len(debris))], len(between_bodies(simulation))
    (force, moved, labels, met), (other, there, named, also) = runs["explicit"], runs["implicit"]
    assert met == also > 5 and labels == named and {"sliding", "rolling"} <= set(labels)
    # 5e-4 of a contact radius of .2 um in each of some hundred steps, on ways of 4 um
    assert np.abs(moved - there).max() < 1e-8
    np.testing.assert_allclose(other, force, atol=1e-3 * abs(force[0]))


APPROACH = np.array([[0.2, 0.0], [-0.1, 0.0]])  # velocities before an impact, m/s


def impact(make, tolerance):
    """Two balls after they met off centre without friction; and the error of their velocities. In closed form these change along
    the line of centres alone, by half of 1 + e times the approach."""
    starts = zip((-6e-6, 6e-6), (0.0, 3e-6), APPROACH, strict=True)
    balls = [make.ball(R, (MIDDLE + x, MIDDLE + y, R), (*v, 0.0)) for x, y, v in starts]
    none = dict.fromkeys([("ball", "ball"), ("ball", "floor")], 0.0)
    simulation = dragged(make, balls, none, plate={"load": 1e-6}, settle=0.0, tolerance=tolerance)
    before = make.momenta(simulation)[0]
    simulation.integrator.advance_to(time=3e-5)
    assert make.momenta(simulation)[0][:2] == pytest.approx(before[:2], rel=1e-9, abs=1e-9 * abs(before[0]))
    normal = np.array([-math.sqrt(4.0 * R**2 - 3e-6**2), -3e-6]) / (2.0 * R)
    change = 0.5 * 1.6 * normal * ((APPROACH[0] - APPROACH[1]) @ normal)
    found = np.array([make.velocity(simulation, body)[:2] for body in (0, 1)])
    return simulation, float(np.abs(found - APPROACH - np.array([-change, change])).max())


def test_an_impact_off_centre_keeps_the_momentum_and_converges_with_the_second_order(make):
    """They fly farther in a stride than candidates are looked for: the stride is repeated as an island."""
    (few, coarse), (many, fine) = impact(make, 1e-6), impact(make, 1e-8)
    assert many.integrator.summary()["islands"]["repeated"] > 0
    ratio = many.integrator.summary()["steps"] / few.integrator.summary()["steps"]
    # 1e-4 of the approach: the patches, whose dashpots the impact moves
    assert ratio > 3.0 and fine < 1.5 * coarse / ratio**2 + 1e-4 * 0.3
    assert fine < 2e-4 * 0.3


def chain(make, plate=None, **solver):
    """A row of balls of different sizes with gaps between them, driven against a block."""
    debris = row(make, 0)
    x = MIDDLE - 4e-6 - R
    for k in range(6):
        radius = R * (1.0 - (0.03 if plate is None else 1e-4) * k)  # one rigid plate touches all of them
        x -= radius + GAP * (k + 1)
        debris.append(make.ball(radius, (x, MIDDLE + 2e-7 * (-1) ** k, radius)))
        x -= radius
    return dragged(make, debris, {("block", "floor"): 5.0}, plate=plate, **solver)


def tables(simulation):
    state, on = simulation.state, simulation.state.slots.histories.slip > 0.0
    return state.B, state.S[:, :3], state.slots.H[on], state.slots.partner[on], simulation.integrator.totals


def copy_of(simulation):
    kept = snapshot(simulation.state, simulation.integrator, Ledger(simulation.state))
    return replace(kept, arrays={name: array.copy() for name, array in kept.arrays.items()})


def resumed(simulation, kept):
    restore(kept, simulation.state, simulation.integrator, Ledger(simulation.state))
    return simulation


@pytest.mark.parametrize("plate", [None, slow(RIGID), FOUNDATION], ids=["patches", "rigid", "foundation"])
def test_the_number_of_threads_and_a_resume_do_not_change_a_bit(make, plate):
    """Snapshots are taken at a stop and between two stops, as a run that is interrupted there takes them."""
    runs, between = [], []
    keep = lambda: between.append(copy_of(simulation))  # noqa: E731
    for threads in (1, 2):
        set_threads(threads)
        simulation = chain(make, plate)
        for stop in ({"time": 0.5 * simulation.settle}, {"time": simulation.settle}, {"distance": 1e-6}):
            simulation.integrator.advance_to(**stop, between=keep)
            if threads == 2:
                simulation = resumed(chain(make, plate), copy_of(simulation))
        simulation.integrator.advance_to(distance=2e-6, between=keep)
        runs.append(simulation)
    assert len(between_bodies(runs[0])) > 2
    if plate is not None:  # bodies with steps of their own offer themselves once a second
        for kept in between[len(between) // 10 :: len(between) // 3]:
            runs.append(resumed(chain(make, plate), kept))
            settle = runs[-1].settle
            for stop in (0.5 * settle, settle):
                runs[-1].integrator.advance_to(time=stop)
            for stop in (1e-6, 2e-6):
                runs[-1].integrator.advance_to(distance=stop)
    for other in runs[1:]:
        for one, same in zip(*map(tables, (runs[0], other)), strict=True):
            np.testing.assert_array_equal(one, same)
