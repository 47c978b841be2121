"""Hard cases of the explicit engine beside those of `hard.cases`: impacts, turns, a doubled box; loads that come and go."""

from typing import Any

import closed_forms
import numpy as np
import pytest
import three_spot_theory as theory
from each import each
from hard.free_bodies import turned_pair
from theory import builders as make
from thirdbody.assembly.simulation import build
from thirdbody.engine.guards import Ledger
from thirdbody.errors import InputError
from thirdbody.kernels.tables import body, body_extra, run_totals
from thirdbody.scene.model import ConstantVelocity, Domain, Effects, Motion, Pause
from thirdbody.scene.motion import Load

RADIUS = 1e-3
LIGHT, HEAVY = make.STEEL, make.solid(210e9, 0.3, 7850.0 * 1e3)
PAIRS = {f"nu = {nu}": ({"ball": make.solid(1e9, nu, 1000.0)}, (1.0, 1.0)) for nu in (0.0, 0.49, 0.499999, 0.5, -0.5)} | {
    "soft on stiff": ({"soft": make.solid(210e6, 0.45, 1000.0), "stiff": make.solid(210e9, 0.3, 7850.0)}, (1.0, 1.0)),
    "heavy on light": ({"heavy": HEAVY, "light": LIGHT}, (10.0, 1.0)),
    "light on heavy": ({"light": LIGHT, "heavy": HEAVY}, (1.0, 10.0)),
}  # fmt: skip
"""Materials, and radii in RADIUS, of undamped head-on impacts at 1 m/s; masses of a ratio of a million in the last two."""


@each(PAIRS)
def test_impacts_of_unlike_pairs(name):
    materials, sizes = PAIRS[name]
    names, radii = list(materials), [RADIUS * size for size in sizes]
    a, b = materials[names[0]], materials[names[-1]]
    masses = np.array([make.ball_mass(m, r) for m, r in zip((a, b), radii, strict=True)])
    mass, radius = masses.prod() / masses.sum(), radii[0] * radii[1] / sum(radii)
    e, gap = theory.e_star(a.shear(), a.poisson_ratio, b.shear(), b.poisson_ratio), 1e-15 * max(radii)
    duration = closed_forms.impact_duration(mass, radius, e, 1.0)
    bodies = [make.ball(radii[0], (-radii[0] - gap, 0.0, 0.0), (1.0, 0.0, 0.0), material=names[0]),
              make.ball(radii[1], (radii[1] + gap, 0.0, 0.0), material=names[-1])]  # fmt: skip
    simulation = build(make.scene(bodies, materials, friction=0.3, time_step=duration / 200.0), force=True)
    S, velocity = simulation.state.S, lambda number: make.velocity(simulation, number)[0]
    found = make.impact(simulation, lambda: (S[1, 0] - S[0, 0] - sum(radii), velocity(1) - velocity(0)))
    # second order at 200 steps: 5e-5 of overlap and time (test_impacts)
    assert found.overlap.max() == pytest.approx(closed_forms.impact_overlap(mass, radius, e, 1.0), rel=1e-4)
    assert found.normal.max() == pytest.approx(closed_forms.impact_force(mass, radius, e, 1.0), rel=1e-4)
    assert found.end == pytest.approx(duration, rel=1e-4)
    # 200 steps with half a unit in the last place of the larger momentum each
    assert make.momenta(simulation)[0][0] == pytest.approx(masses[0], rel=1e-13)
    expected = np.array([masses[0] - masses[1], 2.0 * masses[0]]) / masses.sum()
    # the relative speed is exact to 1e-6 (test_impacts)
    assert np.abs([velocity(0), velocity(1)] - expected).max() < 2e-6 * np.abs(expected).max()
    assert np.all(make.spin(simulation) == 0.0)


def test_history_turns_with_a_rigidly_rotating_pair():
    errors, counts = [], (500, 1000)
    for count in counts:
        before, after, turn, work = turned_pair(np.array([1.0, 2.0, -2.0]) / 3.0, count)
        errors.append(np.linalg.norm(after - turn @ before) / np.linalg.norm(before))
    # chords for arcs and tan x for x: second order in the turn of a step
    assert -np.polyfit(np.log(counts), np.log(errors), 1)[0] == pytest.approx(2.0, abs=0.05)
    # a pair of 2 mm turned by 5e-4 a step slips by D theta^3/6 a step, 2e-13 m in all, of 6e-7 m of shear; work likewise
    assert errors[-1] < 1e-4 * (4000 / counts[-1]) ** 2
    assert work.max() < 2e-4 * (4000 / counts[-1]) ** 2


# a periodic box is the same world as a box of twice the length with everything in it twice

LENGTH, WIDTH, COUNT = 8e-3, 6e-3, 14


def balls(shifts):
    rng = np.random.default_rng(5)
    cells = np.array([(i, j, k) for i in range(3) for j in range(2) for k in range(3)])[:COUNT]
    places = (cells + 0.5) * [LENGTH / 3, WIDTH / 2, 2.7e-3] + rng.uniform(-0.3e-3, 0.3e-3, (COUNT, 3)) + [0.0, 0.0, RADIUS]
    speeds, spins = rng.normal(0.0, 20.0, (COUNT, 3)), rng.normal(0.0, 1e4, (COUNT, 3))
    return [
        make.ball(RADIUS, place + [shift, 0.0, 0.0], speed, spin)
        for shift in shifts
        for place, speed, spin in zip(places, speeds, spins, strict=True)
    ]


EFFECTS = {
    "none": {},
    "pivoting": {"pivoting": {"damping": 0.3}},
    "flow": {"elastic_plastic": {}},
    "necks": {"adhesion": {"work_of_adhesion": "100 J/m2", "model": "jkr"}},  # of 1.5 um, so that a step resolves them
}


def world(length, shifts, effects):
    keys = {"friction": 0.4, "restitution": 0.8, "lower": "ball", "domain": Domain(size=(length, WIDTH), periodic=True)}
    named = Effects(named=effects)
    simulation = build(make.scene(balls(shifts), {"ball": make.STEEL}, time_step=1e-7, effects=named, **keys))
    simulation.integrator.advance_to(time=1.2e-4)
    return simulation


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[pytest.mark.full(kind="slow")] * (name != "none")) for name in EFFECTS]
)
def test_a_doubled_box_moves_alike(name):
    one, two = (world(k * LENGTH, [LENGTH * i for i in range(k)], EFFECTS[name]) for k in (1, 2))
    if name in ("flow", "necks"):
        lost = [run.state.E[:, body_extra.NORMAL_LOSS] for run in (one, two)]
        assert (lost[0] > 0.0).any()
        # round-off of the work done, amplified as below
        assert np.abs(lost[1].reshape(2, -1) - lost[0]).max() < 1e-6 * lost[0].max()
    columns = [*range(body.VELOCITY, body.VELOCITY + 3), *range(body.SPIN, body.SPIN + 3)]
    assert np.any(one.state.bodies.friction_work > 0.0), "balls have rubbed on each other"
    crossed = (one.state.bodies.position[:, 0] < 0.0) | (one.state.bodies.position[:, 0] > LENGTH)
    assert crossed.any(), "some balls are beyond a face"
    scale = np.abs(one.state.B[:, columns]).max(axis=0)
    for copy in (slice(0, COUNT), slice(COUNT, 2 * COUNT)):
        # places differ by rounding (1e-16 of the box over 1e-3 of a radius of overlap), which collisions amplify
        assert np.all(np.abs(two.state.B[copy, columns] - one.state.B[:, columns]) < 1e-8 * scale)


FIRST, LAST, MU = 1e-5, 1e-1, 0.3
LOADING = [Pause(pause=3e-7), Load(load=0.0), Pause(pause=2e-7), Load(load=FIRST), Pause(pause=5e-7), Load(load=LAST)]
"""Dragged at 1 m/s; without load for 2e-7 s, then the first load again, at 1e-6 s ten thousand times as much."""
END = 3e-6
SUPPORTS: dict[str, dict[str, Any]] = {
    "load_per_particle": {}, "rigid": {"support": "rigid"}, "foundation": {"support": "foundation", "stiffness": 1e5},
}  # fmt: skip


def start(support, integrator, **keys):
    balls = [(-1.9, -1.1, 0.0, 2.0), (1.9, -1.1, 0.0, 2.0), (0.0, 2.2, 0.0, 2.0)]
    shape = [{"center": (1e-6 * x, 1e-6 * y, 1e-6 * z), "radius": 1e-6 * r} for x, y, z, r in balls]
    bodies = [make.clump(shape, x, 1e-4, gap=1e-8) for x in (0.4e-4, 1e-4, 1.6e-4)]
    load = {"loading": LOADING, "damping": 1e-4} | SUPPORTS[support]
    drag = Motion(x=[ConstantVelocity(velocity=1.0)])
    return make.under_patches(
        bodies, {"ball": make.STEEL}, FIRST, drag, patch=load, friction=MU, restitution=0.5, size=2e-4, settle=2e-6, duration=END,
        integrator=integrator, **keys,
    )  # fmt: skip


@pytest.mark.parametrize("support", SUPPORTS)
@pytest.mark.parametrize("integrator", ["explicit", "implicit"])
def test_a_load_that_vanishes_comes_back_and_jumps(integrator, support):
    simulation = start(support, integrator)
    ledger, state = Ledger(simulation.state), simulation.state
    pushes = []
    for t in (2.5e-7, 4.8e-7, 9.8e-7, END):
        simulation.integrator.advance_to(time=simulation.settle + t, watch=lambda: ledger.watch(state))
        pushes.append(float(state.A[run_totals.UPPER_FORCE + 2]))
        for table in (state.S, state.B, state.P, state.A, state.slots.H):
            assert np.all(np.isfinite(table))
    # a rigid plate and a foundation share what load_per_particle gives to each
    total = 3.0 if support == "load_per_particle" else 1.0
    # the bodies rise at 1 m/s or less: the dashpot of the patches, 1e-4 kg/s, carries no more than the first load for long
    assert pushes[1] < 1.0 * total * FIRST
    # settled after the jump but for what the bodies' sinking leaves: inertia and dashpot are below 1 % by then
    assert pushes[3] == pytest.approx(total * LAST, rel=0.02)
    assert set(make.label(simulation, body) for body in range(3)) == {"sliding"}
    lines = ledger.lines(state)
    # explicit steps leave their truncation: when the load jumps, half the work of a step; the implicit ones rounding of Newton
    assert ledger.relative_residual(state, lines["residual"]) < (5e-3 if integrator == "explicit" else 1e-6)
    assert make.numerical_share(simulation) > -1e-3


def test_the_same_load_as_a_schedule_and_none_without_inertia():
    found = []
    for loading in (None, [Load(load=FIRST)], [Pause(pause=1e-7), Load(load=FIRST, duration=1e-7)]):
        simulation = make.under_patches(
            [make.clump(make.LUMP)], {"ball": make.STEEL}, FIRST, Motion(x=[ConstantVelocity(velocity=1.0)]),
            patch={"loading": loading}, friction=MU, settle=1e-6, duration=1e-6, integrator="explicit",
        )  # fmt: skip
        simulation.integrator.advance_to(time=1.5e-6)
        found.append(simulation.state.B.copy())
    assert np.array_equal(found[0], found[1]) and np.array_equal(found[0], found[2])
    with pytest.raises(InputError, match="inertia: false needs a load at all times"):
        start("load_per_particle", "implicit", inertia=False)
