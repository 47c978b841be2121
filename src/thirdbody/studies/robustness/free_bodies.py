"""Robustness cases of free bodies, or bodies on one plate: impacts, rotation, time steps; explicit integrator only."""

import math
from typing import Any

import numpy as np

from thirdbody.assembly.simulation import build
from thirdbody.engine.state import angular_momentum
from thirdbody.errors import GuardStop, InputError
from thirdbody.kernels.columns import body, body_extra, record, run_totals
from thirdbody.rotations import rotation_matrices
from thirdbody.scene.model import Contact, Domain, Solver, UpperPlate
from thirdbody.studies.robustness.between_plates import plain_slide
from thirdbody.studies.robustness.case import CaseRun, Trial, rotation_of
from thirdbody.studies.robustness.scenes import LONG, STEEL, TRIPOD, ball, clump, drag, on_plane, particle, pressed, scene, solid

RADIUS = 1e-3

ENERGY = 2e-3
"""Apparent energy change by truncation in one undamped impact at the automatic step (16 to 25 steps), of either sign.

A law that gains energy returns 1e-2 and more.
"""


def oblique_impact(trial: Trial) -> None:
    """Undamped oblique impacts, nu = 0.1: no energy gain for mu = 1 at 36 degrees from the normal and mu = 1e3 at 76.

    Mutations: without reducing the force as its contact shrinks (`mindlin`) -> E'/E - 1 = 0.041 at mu = 1e3. Without the reset of
    the history at opening -> memory of open contacts.
    """
    material = solid(210e9, 0.1, 7850.0)
    for mu, degrees in ((1.0, 36.0), (1e3, 76.0)):
        angle = math.radians(degrees)
        run = trial.start(on_plane(trial, material, RADIUS, (math.sin(angle), 0.0, -math.cos(angle)), mu))
        before = run.kinetic()
        run.leave(1e-6)
        trial.check(f"E'/E - 1 (mu {mu:g})", run.kinetic() / before - 1.0, ENERGY, math.inf)
        trial.check("memory of open spots", run.largest_history(), 0.0)


def mass_ratio(trial: Trial) -> None:
    """Size ratio 10, mass ratio 1e6, head on: the light sphere rebounds as from a wall, momentum holds to rounding.

    Mutations: without the guarded division of the radial return (0/0 without slip) -> non-finite forces. With the bounds of the
    time step by stiffness and by Rayleigh's time both eight times as long -> energy residual 0.10.
    """
    materials = {"heavy": solid(210e9, 0.3, 7850.0 * 1e3), "light": STEEL}
    gap = 1e-14
    bodies = [
        ball(10.0 * RADIUS, (-10.0 * RADIUS - gap, 0.0, 0.0), material="heavy"),
        ball(RADIUS, (RADIUS + gap, 0.0, 0.0), (-1.0, 0.0, 0.0), material="light"),
    ]
    run = trial.start(scene(trial, bodies, materials, 0.3))
    mass, before = run.state.bodies.mass, run.momentum()
    run.leave(1e-6)
    expected = np.array([-2.0 * mass[1], mass[0] - mass[1]]) / mass.sum()
    # half a unit in the last place of the momenta, which are 1 and 2, per step
    trial.check("momentum", np.abs(run.momentum() - before).max() / abs(before[0]), 1e-13)
    speeds = np.array([run.velocity(number)[0] for number in (0, 1)])
    trial.check("speeds after the impact", np.abs(speeds - expected).max(), ENERGY, math.inf)
    trial.check("spin", np.abs(run.state.bodies.spin).max(), 0.0)


def rigid_plane(trial: Trial) -> None:
    """A rigid plane as a stiffness ratio of 1e6, sphere of 0.2 m at 0.2 m/s: no energy gain, restitution 1."""
    run = trial.start(on_plane(trial, solid(70e9, 0.3, 2699.0), 0.1, (0.0, 0.0, -0.2), 0.3))
    run.leave(5e-5)
    trial.check("speed of the rebound - 1", abs(run.velocity()[2] / 0.2 - 1.0), ENERGY, math.inf)
    trial.check("sideways", np.abs(run.velocity()[:2]).max(), 0.0)


def incompressible(trial: Trial) -> None:
    """nu -> 0.5 in a rebound that sticks and slips: every result finite, and no jump towards the limit."""
    result = []
    nus = (0.49, 0.4999, 0.5)
    for nu in nus:
        run = trial.start(on_plane(trial, solid(1e9, nu, 1000.0), RADIUS, (0.8, 0.0, -1.0), 0.5))
        run.leave(5e-6)
        result.append([*run.velocity(), RADIUS * run.state.bodies.spin[0, 1]])
    change = np.abs(np.array(result) - result[-1]).max(axis=1)
    # proportional to 0.5 - nu, with a factor of order one; steps of a twentieth of the contact time leave 2e-3
    allowed = 3.0 * (0.5 - np.array(nus)) + ENERGY
    trial.check("change towards nu = .5 over what is smooth", float((change / allowed).max()), 1.0, math.inf)


FLAKE, WOBBLE = (1.0, 1.1, 2.09), (4e4, -2e4, 2e5)
"""Moments of a thin sheet, I_3 close to I_1 + I_2, over those of its sphere; its spin [rad/s]: 0.05 rad a step."""


def _flake(trial: Trial) -> CaseRun:
    """Return a run of a single body with the moments of a thin sheet, spinning about its thin axis with a wobble.

    It is a sphere with its centre at rest: a sheet of spheres would need a search in every step.
    """
    alone = ball(RADIUS, (0.0, 0.0, 0.0))
    run = trial.start(scene(trial, [alone], {"ball": STEEL}, 0.0))
    B, E = run.state.B, run.state.E
    E[:, body_extra.INERTIA3] *= FLAKE
    B[:, body.SPHERE_INERTIA] = 0.0
    B[:, body.SPIN3] = WOBBLE
    E[:, body_extra.ANGULAR_MOMENTUM3] = angular_momentum(B, E, run.state.orientations)
    run.ledger.start = run.ledger.peak = run.kinetic()
    return run


def spinning_flake(trial: Trial) -> None:
    """Free rotation: |L| is constant to the last bit, and the wobble has the period of Euler's top.

    Mutation: with one rotation by the present spin instead of the symmetric splitting -> the energy guard stops it.
    """
    run = _flake(trial)
    B, E = run.state.B, run.state.E
    before, energy = E[0, body_extra.ANGULAR_MOMENTUM3].copy(), run.kinetic()
    moments = E[0, body_extra.INERTIA3].copy()
    period = _period(moments, rotation_of(run).T @ B[0, body.SPIN3])
    rows = []
    axis = int(np.argmin(moments))
    while run.state.time < 4.6 * period:
        run.steps()
        rows.append((run.state.time, (rotation_of(run).T @ B[0, body.SPIN3])[axis]))
    run.to(time=4.7 * period)
    time, first = np.array(rows).T
    k = np.flatnonzero((first[:-1] < 0.0) & (first[1:] >= 0.0))
    zeros = time[k] - first[k] * (time[k + 1] - time[k]) / (first[k + 1] - first[k])
    trial.check("change of the angular momentum", np.abs(E[0, body_extra.ANGULAR_MOMENTUM3] - before).max(), 0.0)
    # second order: the square of the rotation in a step, 0.05 radians, times a factor of order one
    trial.check("period over that of Euler's top - 1", np.abs(np.diff(zeros) / period - 1.0).max(), 1e-3)
    trial.check("kinetic energy", abs(run.kinetic() / energy - 1.0), 1e-3)
    run.end()


def _period(moments: np.ndarray, spin: np.ndarray) -> float:
    """Return the period of the body-frame spin of a torque-free top [s]: 4 K(k)/rate (Landau and Lifshitz I, section 37)."""
    from scipy.special import ellipk

    order = np.argsort(moments)
    (i_1, i_2, i_3), w = moments[order], spin[order]
    square, double_energy = float(np.sum((moments[order] * w) ** 2)), float(np.sum(moments[order] * w * w))
    if square < double_energy * i_2:
        i_1, i_3 = i_3, i_1
    fast, slow = (i_3 - i_2) * (square - double_energy * i_1), (i_2 - i_1) * (double_energy * i_3 - square)
    return 4.0 * float(ellipk(slow / fast)) / math.sqrt(fast / (i_1 * i_2 * i_3))


def many_steps(trial: Trial) -> None:
    """A million steps (a hundred thousand in the short version): quaternions stay unit, the energy does not drift."""
    if trial.setting.integrator == "implicit":
        _rolling_on(trial)
        return
    count = 1_000_000 if trial.setting.full else 100_000
    run = _flake(trial)
    E = run.state.E
    before, energy = E[0, body_extra.ANGULAR_MOMENTUM3].copy(), run.kinetic()
    run.to(time=(count - 0.5) * run.state.dt)
    trial.check_true("so many steps", int(run.state.A[run_totals.STEPS]) == count)
    trial.check("change of the angular momentum", np.abs(E[0, body_extra.ANGULAR_MOMENTUM3] - before).max(), 0.0)
    # no drift: the energy error of the splitting stays (omega dt)^2/12 at any time
    trial.check("kinetic energy", abs(run.kinetic() / energy - 1.0), 3e-4)
    run.end()


def _rolling_on(trial: Trial) -> None:
    """A sphere that rolls between plates, ten thousand steps (two thousand in the short version)."""
    from thirdbody.scene.model import Solver

    steps = 10_000 if trial.setting.full else 2_000
    particle = clump([(0.0, 0.0, 0.0, 2.0)], x=1e-6)
    solver = Solver(duration=LONG, largest_step=1e-8, **trial.solver())
    run = trial.start(pressed(trial, particle, 0.3, solver=solver))
    run.follow([1e-8 * steps])
    trial.check_true("so many steps", run.integrator.summary()["steps"] >= steps)
    trial.check_true("labelled rolling", run.label()[0] == "rolling")
    # rolling without slip between parallel plates: half the distance of the plate
    moved = float(run.state.bodies.position[0, 0]) - 1e-6
    trial.check("path over half of the plate's - 1", abs(moved / (0.5e-8 * steps) - 1.0), 2e-2)


def overlapping_start(trial: Trial) -> None:
    """Bodies that overlap initially are refused, and the message says so.

    Mutation: without the check at the start -> two balls: accepted.
    """
    pair = [ball(RADIUS, (sign * 0.99 * RADIUS, 0.0, 0.0)) for sign in (-1.0, 1.0)]
    cases: list[tuple[str, Any]] = [("two balls", lambda: scene(trial, pair, {"ball": STEEL}, 0.3))]
    thick = {"support": "rigid", "load": None, "gap": 1e-6}
    cases.append(("plates too close", lambda: pressed(trial, particle([0.0], [-1e-6, 1e-6]), 0.3, plate=thick)))
    for what, make in cases if trial.setting.integrator == "explicit" else cases[1:]:
        try:
            build(make())
            message = "accepted"
        except InputError as error:
            message = str(error)
        trial.check_true(f"{what}: refused for its overlap ({message})", "overlap" in message)


PACKED, RELEASED = 27, 1e-3
"""Number of spheres of the compressed packing; largest kinetic energy over what its overlaps would have stored."""


def relaxed_start(trial: Trial) -> None:
    """A packing of spheres whose neighbours overlap by 0.3 of the radius is relaxed, then pressed: nothing flies apart.

    Coincident bodies are refused. Mutation: without the relaxation -> the overlap guard stops it in the first step.
    """
    spacing, rng = 1.7 * RADIUS, np.random.default_rng(1)
    grid = np.stack(np.meshgrid(*[np.arange(3.0)] * 3, indexing="ij"), -1).reshape(PACKED, 3)
    centres = spacing * (grid + 0.5) + 0.02 * RADIUS * rng.standard_normal((PACKED, 3))
    neighbours = 3 * 9 * 2  # of the cubic lattice
    e_star = 210e9 / (2.0 * (1.0 - 0.3**2))  # of steel
    stored = neighbours * 8.0 / 15.0 * e_star * math.sqrt(0.5 * RADIUS) * (0.3 * RADIUS) ** 2.5
    bodies = [ball(RADIUS, where) for where in centres]
    upper = UpperPlate(material="ball", load=10.0, motion=drag())
    pressed_bed = lambda debris: scene(  # noqa: E731
        trial, debris, {"ball": STEEL}, 0.3, 0.6, 5.1 * RADIUS, "ball", upper,
        contact=Contact(level=trial.setting.level), solver=Solver(
            duration=LONG, settle=0.0, initial_overlap="relax", **trial.solver()
        ),
    )  # fmt: skip
    run = trial.start(pressed_bed(bodies))
    start = run.simulation.relaxed
    trial.check("overlap that is left", start.overlap_after if start else math.nan, 0.0)
    trial.check("kinetic energy of the start", run.kinetic(), 0.0)
    largest = 0.0
    for k in range(1, 9):
        run.to(time=25e-6 * k)
        largest = max(largest, run.kinetic())
    trial.check("kinetic energy over that of the overlaps", largest / stored, RELEASED)
    run.end()
    try:
        build(pressed_bed([bodies[0], bodies[0]]))
        message = "accepted"
    except InputError as error:
        message = str(error)
    trial.check_true(f"two bodies in one place: refused ({message})", "same centre" in message)


PERIOD = 0.1


def periodic_face(trial: Trial) -> None:
    """Two spheres in grazing contact as both drift across a face or a corner: the same forces as in the middle.

    Mutation: without the nearest image in the contact pass -> difference of the forces 1.
    """
    inside = _crossing(trial, (0.05, 0.05))
    scale = np.abs(inside).max(axis=0)
    trial.check_true("they touch and part", bool(inside[:, 0].max() > 0.0 and inside[-1, 0] == 0.0))
    # the contact crosses a face, then two at once; the centre of a sphere crosses one
    for corner in ((-1e-6, 0.05), (-1e-6, -1e-6), (0.8 * RADIUS - 1e-6, 0.05)):
        # rounding of the coordinates, 1e-17 m, against overlaps of some 5 um: 1e-11 of the largest force
        difference = np.abs(_crossing(trial, corner) - inside).max(axis=0) / scale
        trial.check(f"difference of the forces across {corner}", float(difference.max()), 1e-9)


def _crossing(trial: Trial, corner: tuple[float, float]) -> np.ndarray:
    normal = np.array([0.8, 0.5, math.sqrt(1.0 - 0.89)])
    drift, gap = np.array([0.6, 0.4, 0.0]), RADIUS * (1.0 + 1e-9)
    bodies = []
    for sign in (-1.0, 1.0):
        where = np.array([*corner, 0.05]) + sign * gap * normal
        where[:2] %= PERIOD
        push = drift - sign * 0.5 * normal + sign * np.array([0.0, 0.0, 0.4])
        bodies.append(ball(RADIUS, tuple(where), tuple(push), (100.0, 200.0, -50.0)))
    domain = Domain(size=(PERIOD, PERIOD), periodic=True)
    run = trial.start(scene(trial, bodies, {"ball": STEEL}, 0.3, 0.8, domain=domain))
    rows = []
    while run.state.time < 2e-5:
        run.steps()
        R = run.state.slots.R[run.loaded()]
        row = R[0] if len(R) else np.zeros(record.WIDTH)
        rows.append([row[record.NORMAL_FORCE], *row[record.TANGENTIAL_FORCE3], *run.state.bodies.torque[0]])
    run.to(time=2.05e-5)
    run.end()
    return np.array(rows)


def hundredfold_step(trial: Trial) -> None:
    """A time step a hundred times too long is refused; forced, it is stopped with the time and the reason.

    Mutations: without the refusal -> accepted. Without the guards of overlap, travel and energy it is stopped later, by
    non-finite positions.
    """
    step = 100.0 * plain_slide(trial).integrator.summary()["time_step_limit"]["smallest"]
    from thirdbody.scene.model import Solver

    solver = Solver(duration=LONG, time_step=step, integrator="explicit")
    try:
        build(pressed(trial, clump(TRIPOD), 0.3, solver=solver))
        message = "accepted"
    except InputError as error:
        message = str(error)
    trial.check_true(f"refused ({message})", "is above the bound" in message)
    forced = build(pressed(trial, clump(TRIPOD), 0.3, solver=solver), force=True)
    run = CaseRun(Trial(trial.setting), forced)
    try:
        run.to(time=2000.0 * step)
        message = "ran on"
    except GuardStop as stop:
        message = str(stop)
    trial.check_true(f"stopped with time, step and reason ({message})", "stopped at t = " in message and "time step" in message)


def rotating_pair(trial: Trial) -> None:
    """A loaded, sheared pair rotated rigidly by two radians, including twist about the normal: T rotates with it, no work.

    The spheres are so heavy that forces cannot move them: their motion is prescribed, chord by chord.

    Mutations: without rotating the contact frame with the twist -> relative error of T 0.65 to 1.7. Without transporting the
    frame with the normal -> the same. Without slip at mid-step -> 0.001 to 1, and spurious work.
    """
    for axis in ((1.0, 0.0, 0.0), (1.0, 2.0, -2.0)):
        before, after, rotation, built = _rotated_contact(trial, np.array(axis) / np.linalg.norm(axis), 2000)
        # chords for arcs: second order in the rotation of a step, 1e-3 radians
        missed = float(np.linalg.norm(after - rotation @ before) / np.linalg.norm(before))
        trial.check(f"T that did not turn, axis {axis}", missed, 4e-4)
        trial.check(f"work of the turn over stored energy, axis {axis}", built, 8e-4)


def _rotated_contact(trial: Trial, axis: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
    """Return the tangential force before and after (3,) [N], the rotation (3, 3), and the relative energy error.

    The error is |work| + |change of stored energy| over the stored energy.
    """
    from thirdbody.scene.model import Solver

    step, offset = 1e-7, np.array([[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    pair = [ball(RADIUS, (sign * RADIUS * (1.0 + 1e-12), 0.0, 0.0)) for sign in (-1.0, 1.0)]
    solver = Solver(duration=LONG, time_step=step, integrator="explicit")
    simulation = build(scene(trial, pair, {"ball": STEEL}, 0.5, solver=solver), force=True)
    B, E = simulation.state.B, simulation.state.E
    B[:, body.MASS] = E[:, body_extra.INERTIA] = E[:, body_extra.INERTIA + 1] = E[:, body_extra.INERTIA + 2] = B[
        :, body.SPHERE_INERTIA
    ] = 1e30

    def drive(target: np.ndarray, spin: np.ndarray) -> np.ndarray:
        B[:, body.VELOCITY3] = (target - B[:, body.POSITION3]) / step
        B[:, body.SPIN3] = spin
        E[:, body_extra.ANGULAR_MOMENTUM3] = angular_momentum(B, E, simulation.state.orientations)
        simulation.integrator.advance_to(time=simulation.state.time + 0.5 * step)
        slots = simulation.state.slots
        return slots.R[slots.histories.slip > 0.0][0].copy()

    still = np.zeros(3)
    for k in range(1, 21):
        drive(offset * (RADIUS - 5e-6 * k / 20), still)
    for k in range(1, 21):
        before = drive(offset * (RADIUS - 5e-6) + offset[:, [1, 2, 0]] * 3e-7 * k / 20, still)
    centres, work = B[:, body.POSITION3].copy(), float(simulation.state.A[run_totals.FRICTION_WORK])
    for k in range(1, count + 1):
        rotation = _rotation(axis, 2.0 * k / count)
        after = drive(centres @ rotation.T, axis * 2.0 / count / step)
    stored = float(before[record.STORED_TANGENTIAL])
    built = abs(simulation.state.A[run_totals.FRICTION_WORK] - work) + abs(after[record.STORED_TANGENTIAL] - stored)
    shear = slice(record.TANGENTIAL_FORCE, record.TANGENTIAL_FORCE + 3)
    return before[shear], after[shear], rotation, float(built) / stored


def _rotation(axis: np.ndarray, angle: float) -> np.ndarray:
    half = 0.5 * angle
    return rotation_matrices(np.array([[math.cos(half), *(math.sin(half) * axis)]]))[0]
