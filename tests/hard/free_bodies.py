"""Hard cases of free bodies, or bodies on one plate: impacts, rotation, time steps; most with the explicit integrator only."""

import math

import closed_forms
import numpy as np
from hard.between_plates import particle
from hard.trial import TRIPOD, CaseRun, Trial, clump, drag, every, on_plane, pressed, scene
from theory.builders import LONG, STEEL, advance, ball, contact, momenta, solid
from theory.builders import scene as plain_scene
from thirdbody.assembly.simulation import build
from thirdbody.engine.state import angular_momentum, orientations
from thirdbody.errors import GuardStop
from thirdbody.kernels.tables import body, body_extra, record, run_totals
from thirdbody.rotations import matrix_from_quaternion
from thirdbody.scene.model import Contact, Domain, Solver, UpperPlate

RADIUS = 1e-3
ENERGY = 2e-3
"""Apparent energy change by truncation in one undamped impact at the automatic step (16 to 25 steps), of either sign; a law that
gains energy returns 1e-2 and more."""


def oblique_impact(trial: Trial) -> None:
    """Undamped oblique impacts, nu = 0.1: no energy gain for mu = 1 at 36 degrees from the normal and mu = 1e3 at 76."""
    material = solid(210e9, 0.1, 7850.0)
    for mu, degrees in ((1.0, 36.0), (1e3, 76.0)):
        angle = math.radians(degrees)
        run = trial.start(on_plane(trial, material, RADIUS, (math.sin(angle), 0.0, -math.cos(angle)), mu))
        before = run.kinetic()
        run.leave(1e-6)
        trial.check(f"E'/E - 1 (mu {mu:g})", run.kinetic() / before - 1.0, ENERGY, math.inf)
        trial.check_memory(run.memory())


def mass_ratio(trial: Trial) -> None:
    """Size ratio 10, mass ratio 1e6, head on: the light sphere rebounds as from a wall, momentum holds to rounding."""
    materials = {"heavy": solid(210e9, 0.3, 7850.0 * 1e3), "light": STEEL}
    gap = 1e-14
    heavy = ball(10.0 * RADIUS, (-10.0 * RADIUS - gap, 0.0, 0.0), material="heavy")
    bodies = [heavy, ball(RADIUS, (RADIUS + gap, 0.0, 0.0), (-1.0, 0.0, 0.0), material="light")]
    run = trial.start(scene(trial, bodies, materials, 0.3))
    mass, before = run.state.bodies.mass, momenta(run.simulation)[0]
    run.leave(1e-6)
    expected = np.array([-2.0 * mass[1], mass[0] - mass[1]]) / mass.sum()
    # half a unit in the last place of the momenta, which are 1 and 2, per step
    trial.check("momentum", np.abs(momenta(run.simulation)[0] - before) / abs(before[0]), 1e-13)
    trial.check("speeds after the impact", np.abs(run.state.bodies.velocity[:, 0] - expected), ENERGY, math.inf)
    trial.check("spin", np.abs(run.state.bodies.spin), 0.0)


def rigid_plane(trial: Trial) -> None:
    """A rigid plane as a stiffness ratio of 1e6, sphere of 0.2 m at 0.2 m/s: no energy gain, restitution 1."""
    run = trial.start(on_plane(trial, solid(70e9, 0.3, 2699.0), 0.1, (0.0, 0.0, -0.2), 0.3))
    run.leave(5e-5)
    trial.check("speed of the rebound - 1", abs(run.velocity()[2] / 0.2 - 1.0), ENERGY, math.inf)
    trial.check("sideways", np.abs(run.velocity()[:2]), 0.0)


def incompressible(trial: Trial) -> None:
    """nu -> 0.5 in a rebound that sticks and slips: every result finite, and no jump towards the limit."""
    result, nus = [], np.array([0.49, 0.4999, 0.5])
    for nu in nus:
        run = trial.start(on_plane(trial, solid(1e9, nu, 1000.0), RADIUS, (0.8, 0.0, -1.0), 0.5))
        run.leave(5e-6)
        result.append([*run.velocity(), RADIUS * run.state.bodies.spin[0, 1]])
    change = np.abs(np.array(result) - result[-1]).max(axis=1)
    # proportional to 0.5 - nu, with a factor of order one; steps of a twentieth of the contact time leave 2e-3
    trial.check("change towards nu = .5 over what is smooth", change / (3.0 * (0.5 - nus) + ENERGY), 1.0, math.inf)


def thin_spinner(trial):
    """A sphere with the moments of a thin sheet, I_3 close to I_1 + I_2, and a wobble; a sheet of spheres would need searches."""
    run = trial.start(scene(trial, [ball(RADIUS, (0.0, 0.0, 0.0))], {"ball": STEEL}, 0.0))
    B, E = run.state.B, run.state.E
    E[:, body_extra.INERTIA3] *= (1.0, 1.1, 2.09)
    B[:, body.SPHERE_INERTIA] = 0.0
    B[:, body.SPIN3] = (4e4, -2e4, 2e5)
    E[:, body_extra.ANGULAR_MOMENTUM3] = angular_momentum(B, E, run.state.orientations)
    run.ledger.start = run.ledger.peak = run.kinetic()
    return run, E[0, body_extra.ANGULAR_MOMENTUM3].copy()


def check_momentum(trial, run, before):
    trial.check("change of the angular momentum", np.abs(run.state.E[0, body_extra.ANGULAR_MOMENTUM3] - before), 0.0)


def body_spin(run):
    return matrix_from_quaternion(orientations(run.state)[:1])[0].T @ run.state.B[0, body.SPIN3]


def spinning_flake(trial: Trial) -> None:
    """Free rotation, I_3 >> I_1: |L| is constant to the last bit, and the wobble has the period of Euler's top."""
    run, before = thin_spinner(trial)
    energy, moments = run.kinetic(), run.state.E[0, body_extra.INERTIA3].copy()
    period, axis = closed_forms.top_period(moments, body_spin(run)), int(np.argmin(moments))
    rows = []
    while run.state.time < 4.6 * period:
        run.one_step()
        rows.append((run.state.time, body_spin(run)[axis]))
    run.to(time=4.7 * period)
    time, first = np.array(rows).T
    k = np.flatnonzero((first[:-1] < 0.0) & (first[1:] >= 0.0))
    zeros = time[k] - first[k] * (time[k + 1] - time[k]) / (first[k + 1] - first[k])
    check_momentum(trial, run, before)
    # second order: the square of the rotation in a step, 0.05 radians, times a factor of order one
    trial.check("period over that of Euler's top - 1", np.abs(np.diff(zeros) / period - 1.0), 1e-3)
    trial.check("kinetic energy", abs(run.kinetic() / energy - 1.0), 1e-3)
    run.end()


def many_steps(trial: Trial) -> None:
    """A million steps (fifty thousand in the short version): quaternions stay unit, the energy does not drift."""
    if trial.setting.integrator == "implicit":
        _rolls_on(trial)
        return
    count = 1_000_000 if trial.setting.full else 50_000
    run, before = thin_spinner(trial)
    energy = run.kinetic()
    run.to(time=(count - 0.5) * run.state.dt)
    trial.check_true("so many steps", int(run.state.A[run_totals.STEPS]) == count)
    check_momentum(trial, run, before)
    # no drift: the energy error of the splitting stays (omega dt)^2/12 at any time
    trial.check("kinetic energy", abs(run.kinetic() / energy - 1.0), 3e-4)
    run.end()


def _rolls_on(trial):
    steps, solver = 10_000 if trial.setting.full else 1_000, trial.solver(largest_step=1e-8)
    run = trial.start(pressed(trial, clump([(0.0, 0.0, 0.0, 2.0)], x=1e-6), 0.3, solver=solver))
    run.follow([1e-8 * steps])
    trial.check_true("so many steps", run.integrator.summary()["steps"] >= steps)
    trial.check_true("labelled rolling", run.state_name() == "rolling")
    # rolling without slip between parallel plates: half the distance of the plate
    trial.check("path over half of the plate's - 1", abs((run.position()[0] - 1e-6) / (0.5e-8 * steps) - 1.0), 2e-2)


def overlapping_start(trial: Trial) -> None:
    """Bodies that overlap initially, whose stored energy would explode, are refused, and the message says so."""
    pair = [ball(RADIUS, (sign * 0.99 * RADIUS, 0.0, 0.0)) for sign in (-1.0, 1.0)]
    thick = {"support": "rigid", "load": None, "gap": 1e-6}
    if trial.setting.integrator == "explicit":
        trial.check_refused("two balls", lambda: scene(trial, pair, {"ball": STEEL}, 0.3), "overlap")
    three = particle([0.0], [-1e-6, 1e-6])
    trial.check_refused("plates too close", lambda: pressed(trial, three, 0.3, plate=thick), "overlap")


def relaxed_start(trial: Trial) -> None:
    """Packed spheres that overlap by 0.3 of the radius are relaxed, then pressed: nothing flies apart; coincident: refused."""
    rng = np.random.default_rng(1)
    grid = np.stack(np.meshgrid(*[np.arange(3.0)] * 3, indexing="ij"), -1).reshape(27, 3)
    centres = 1.7 * RADIUS * (grid + 0.5) + 0.02 * RADIUS * rng.standard_normal((27, 3))
    neighbours = 3 * 9 * 2  # of the cubic lattice
    e_star = 210e9 / (2.0 * (1.0 - 0.3**2))  # of steel
    stored = neighbours * 8.0 / 15.0 * e_star * math.sqrt(0.5 * RADIUS) * (0.3 * RADIUS) ** 2.5
    bodies = [ball(RADIUS, where) for where in centres]
    keys = {"size": 5.1 * RADIUS, "lower": "ball", "upper": UpperPlate(material="ball", load=10.0, motion=drag())}
    keys |= {"contact": Contact(level=trial.setting.level), "solver": trial.solver(settle=0.0, initial_overlap="relax")}
    run = trial.start(scene(trial, bodies, {"ball": STEEL}, 0.3, restitution=0.6, **keys))
    start = run.simulation.relaxed
    trial.check("overlap that is left", start.overlap_after if start else math.nan, 0.0)
    trial.check("kinetic energy of the start", run.kinetic(), 0.0)
    energies = []
    for time in every(25e-6, 8):
        run.to(time=time)
        energies.append(run.kinetic())
    trial.check("kinetic energy over that of the overlaps", np.array(energies) / stored, 1e-3)
    run.end()
    twice = (trial, [bodies[0], bodies[0]], {"ball": STEEL}, 0.3)
    trial.check_refused("two bodies in one place", lambda: scene(*twice, restitution=0.6, **keys), "same centre")


PERIOD = 0.1


def periodic_face(trial: Trial) -> None:
    """Two spheres in grazing contact as both drift across a face or a corner: the same forces as in the middle."""
    inside = _crossing(trial, (0.05, 0.05))
    scale = np.abs(inside).max(axis=0)
    trial.check_true("they touch and part", inside[:, 0].max() > 0.0 and inside[-1, 0] == 0.0)
    # the contact crosses a face, then two at once; the centre of a sphere crosses one
    for corner in ((-1e-6, 0.05), (0.05, -1e-6), (-1e-6, -1e-6), (0.8 * RADIUS - 1e-6, 0.05)):
        # rounding of the coordinates, 1e-17 m, against overlaps of some 5 um: 1e-11 of the largest force
        difference = np.abs(_crossing(trial, corner) - inside).max(axis=0) / scale
        trial.check(f"difference of the forces across {corner}", difference, 1e-9)


def _crossing(trial, corner):
    normal = np.array([0.8, 0.5, math.sqrt(1.0 - 0.89)])
    drift, gap = np.array([0.6, 0.4, 0.0]), RADIUS * (1.0 + 1e-9)
    bodies = []
    for sign in (-1.0, 1.0):
        where = np.array([*corner, 0.05]) + sign * gap * normal
        where[:2] %= PERIOD
        push = drift - sign * 0.5 * normal + sign * np.array([0.0, 0.0, 0.4])
        bodies.append(ball(RADIUS, where, push, (100.0, 200.0, -50.0)))
    domain = Domain(size=(PERIOD, PERIOD), periodic=True)
    run = trial.start(scene(trial, bodies, {"ball": STEEL}, 0.3, restitution=0.8, domain=domain))
    rows = []
    while run.state.time < 2e-5:
        run.one_step()
        row = contact(run.simulation)
        rows.append([row[record.NORMAL_FORCE], *row[record.TANGENTIAL_FORCE3], *run.state.bodies.torque[0]])
    run.to(time=2.05e-5)
    run.end()
    return np.array(rows)


def hundredfold_step(trial: Trial) -> None:
    """A time step a hundred times too long is refused; forced, it is stopped with the time and the reason."""
    trial.start(pressed(trial, clump(TRIPOD), 0.3)).follow(every(5e-8, 2))
    step = 100.0 * trial.steps[0]
    sliding = pressed(trial, clump(TRIPOD), 0.3, solver=trial.solver(time_step=step))
    trial.check_refused("too long", lambda: sliding, "is above the bound")
    run = CaseRun(Trial(trial.setting), build(sliding, force=True))
    try:
        run.to(time=2000.0 * step)
        message = "ran on"
    except GuardStop as stop:
        message = str(stop)
    trial.check_true(f"stopped with time, step and reason ({message})", "stopped at t = " in message and "time step" in message)


def turning_pair(trial: Trial) -> None:
    """A loaded, sheared pair rotated rigidly by two radians, including twist about the normal: T rotates with it, no work."""
    for axis in ((1.0, 0.0, 0.0), (1.0, 2.0, -2.0)):
        before, after, rotation, work = turned_pair(np.array(axis) / np.linalg.norm(axis), 2000, trial.setting.level)
        # chords for arcs: second order in the rotation of a step, 1e-3 radians
        missed = np.linalg.norm(after - rotation @ before) / np.linalg.norm(before)
        trial.check(f"T that did not turn, axis {axis}", missed, 4e-4)
        trial.check(f"work of the turn over stored energy, axis {axis}", work.sum(), 8e-4)


def turned_pair(axis, count, level="mindlin"):
    """Tangential force before and after, turn matrix, friction work and stored energy gained over the stored energy, of two balls
    pressed together and sheared, then turned rigidly by 2 radians. Bodies too heavy for forces to move them go chord by chord."""
    step, solver = 1e-7, Solver(duration=LONG, time_step=1e-7, integrator="explicit")
    pair = [ball(RADIUS, (sign * RADIUS * (1.0 + 1e-12), 0.0, 0.0)) for sign in (-1.0, 1.0)]
    given = plain_scene(pair, {"ball": STEEL}, friction=0.5, solver=solver, contact=Contact(level=level))
    simulation = build(given, force=True)
    B, E = simulation.state.B, simulation.state.E
    B[:, body.MASS] = B[:, body.SPHERE_INERTIA] = 1e30
    E[:, body_extra.INERTIA3] = 1e30

    def drive(target, spin=(0.0, 0.0, 0.0)):
        B[:, body.VELOCITY3] = (target - B[:, body.POSITION3]) / step
        B[:, body.SPIN3] = spin
        E[:, body_extra.ANGULAR_MOMENTUM3] = angular_momentum(B, E, simulation.state.orientations)
        advance(simulation)
        return contact(simulation)

    offset = np.array([[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    for k in range(1, 21):
        drive(offset * (RADIUS - 5e-6 * k / 20))
    for k in range(1, 21):
        before = drive(offset * (RADIUS - 5e-6) + offset[:, [1, 2, 0]] * 3e-7 * k / 20)
    centres, work = B[:, body.POSITION3].copy(), simulation.state.A[run_totals.FRICTION_WORK]
    for k in range(1, count + 1):
        half = 0.5 * (2.0 * k / count)
        turn = matrix_from_quaternion(np.array([[math.cos(half), *(math.sin(half) * axis)]]))[0]
        after = drive(centres @ turn.T, axis * 2.0 / count / step)
    stored = before[record.STORED_TANGENTIAL]
    gained = simulation.state.A[run_totals.FRICTION_WORK] - work, after[record.STORED_TANGENTIAL] - stored
    return before[record.TANGENTIAL_FORCE3], after[record.TANGENTIAL_FORCE3], turn, np.abs(gained) / stored
