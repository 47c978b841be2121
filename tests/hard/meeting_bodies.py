"""Hard cases of bodies between plates that meet each other. All carry one load, so statics gives every force: a ball rolls at
half the speed of the upper plate, a post sticks to the lower one and slips above, a rider sticks to the upper one and slips
below."""

import itertools
import math

import numpy as np
from hard.trial import BOX, LOAD, MICRON, Trial, clump, drag, every, scene
from theory.builders import STEEL, solid
from thirdbody.kernels.tables import DEBRIS, LOWER, UPPER, record
from thirdbody.scene.model import Contact, Motion, PairTable, Stroke, UpperPlate

SPEED, R, GAP, START = 0.2, 5.0, 0.1, 20.0
"""Speed of the upper plate [m/s]; radius of spheres, gap between bodies and place of the first one [um]."""
BALL = ((0.0, 0.0, 0.0, R),)
POST = tuple((x, y, 0.0, R) for x, y in ((-9.0, 0.0), (-4.5, 0.0), (0.0, -4.0), (0.0, 4.0), (4.5, 0.0), (9.0, 0.0)))
RIDGE = tuple((x, y, 0.0, 0.8) for x, y in ((-1.5, 0.0), (0.0, 0.0), (1.5, 0.0), (0.0, -1.5), (0.0, 1.5)))
"""Spheres (x, y, z, radius) [um]."""
TILT = 5e-3  # deviation of forces over the load: normals lean by overlaps, and bounces have not died out to the last
STOPS = every(1e-7, 12)  # stops of the drag [m]
STUCK = 10.0


def at(shape, x, material):
    return clump(shape, x * MICRON, gap=0.0).model_copy(update={"material": material})


BALL_AND_POST = (at(BALL, START, "ball"), at(POST, START + 2.0 * R + 0.02 + 9.0, "post"))
FRICTIONS = {("ball", "lid"): 0.3, ("ball", "base"): 0.5, ("post", "base"): STUCK}


def meeting(trial, bodies, frictions, restitution=0.5, motion=None, materials=None, support="load_per_particle"):
    """A scene of bodies that see each other; pairs that `frictions` does not name have none."""
    names = sorted({str(part.material) for part in bodies})
    known = {name: STEEL for name in (*names, "base", "lid")} | (materials or {})
    pairs = tuple(
        PairTable(between=pair, friction=frictions.get(pair, 0.0), restitution=restitution)
        for pair in itertools.combinations_with_replacement(known, 2)
    )
    upper = UpperPlate(material="lid", support=support, load=LOAD, motion=motion or drag(SPEED))
    contact = Contact(level=trial.setting.level, debris_contact="auto")
    keys = {"size": BOX, "lower": "base", "upper": upper, "contact": contact, "pairs": pairs, "settle": 2.5e-6}
    return scene(trial, bodies, known, 0.0, **keys)


def owners(run, slots):
    return run.state.order[run.state.body[slots]]


def closed(run, number, side):
    slots = run.state.slots
    return run.loaded() & (slots.sides == side) & (owners(run, slots.own) == number)


def force(run, number, side):
    R = run.state.slots.R[closed(run, number, side)]
    return (R[:, [record.NORMAL_FORCE]] * R[:, record.NORMAL3] + R[:, record.TANGENTIAL_FORCE3]).sum(axis=0) / LOAD


def push(run, number, other):
    slots = run.state.slots
    one, two = owners(run, slots.own), owners(run, np.maximum(slots.partner, 0))
    pair = ((one == number) & (two == other)) | ((one == other) & (two == number))
    return float(slots.R[run.loaded() & (slots.sides == DEBRIS) & pair, record.NORMAL_FORCE].sum()) / LOAD


def point(run, side):
    """The point (3,) in which the first body touches a plate or another body, from its centre [m]."""
    return run.state.slots.R[closed(run, 0, side)][0, record.POINT3]


def two_meet_head_on(trial: Trial) -> None:
    """A rider is stopped by a post: it slid below and slides above; the post carries what the plate gives to both."""
    bodies = (at(POST, START, "rider"), at(POST, START + 28.0 + GAP, "post"))
    run = trial.start(meeting(trial, bodies, {("rider", "lid"): 0.3, ("post", "lid"): 0.1, ("post", "base"): STUCK}))
    run.follow(STOPS)
    trial.check("push - 0.3 of the load", abs(push(run, 0, 1) - 0.3), TILT)
    trial.check("force of the lower plate - 0.4", abs(force(run, 1, LOWER)[0] + 0.4), TILT)
    trial.check_true("labelled sliding", run.state_name() == "sliding")
    trial.check("velocity over that of the plate", np.abs(run.state.bodies.velocity) / SPEED, 0.01)


def rides_onto(trial: Trial) -> None:
    """A ball mounts a ridge, sqrt(r/R) = 0.4 below friction: it leaves the lower plate, and its force goes along the chord."""
    bodies = (at(BALL, START, "ball"), at(RIDGE, START + 2.0 * math.sqrt(0.8 * R) + GAP + 1.5, "post"))
    frictions = {("ball", "lid"): 0.5, ("ball", "base"): 0.5, ("ball", "post"): 0.5, ("post", "base"): STUCK}
    run = trial.start(meeting(trial, bodies, frictions))
    run.follow(STOPS)
    trial.check_true("off the lower plate", not np.any(force(run, 0, LOWER)))
    trial.check_true("higher than it was", run.position()[2] > 1.02 * R * MICRON)
    top, side, given = point(run, UPPER), point(run, DEBRIS), force(run, 0, UPPER)
    # inertia and dashpots at 0.2 m/s are a hundredth of the load
    trial.check("force beside the chord", abs(-given[0] / given[2] - (side[0] - top[0]) / (top[2] - side[2])), 0.02)


def chain_of_ten(trial: Trial) -> None:
    """Ten balls are pushed against a post: each hands on what it gets, and adds twice the friction of its top."""
    row = [at(BALL, START + k * (2.0 * R + 0.02), "ball") for k in range(10)]
    bodies = (*row, at(POST, START + 10.0 * (2.0 * R + 0.02) + 9.0, "post"))
    run = trial.start(meeting(trial, bodies, {("ball", "lid"): 0.05, ("ball", "base"): 0.5, ("post", "base"): STUCK}, 0.1))
    run.follow([1.25 * stop for stop in STOPS])
    pushes = np.array([push(run, k, k + 1) for k in range(10)])
    trial.check("pushes over those of statics - 1", np.abs(pushes / (0.1 * np.arange(1, 11)) - 1.0), 0.01)


def meets_again(trial: Trial) -> None:
    """Strokes bring a ball to a post and take it back, the contact is lost and found at once: no memory, slip in the first."""
    motion = Motion(x=(Stroke(stroke=0.2 * MICRON, frequency=5e5, shape="triangle"),))
    run = trial.start(meeting(trial, BALL_AND_POST, FRICTIONS, motion=motion))
    touching, memory, work = run.follow(
        every(1.25e-7, 64), lambda: np.any(force(run, 0, DEBRIS)), run.memory, lambda: run.state.bodies.friction_work[0],
        kind="time",
    )  # fmt: skip
    changes = int(np.count_nonzero(np.diff(touching)))
    trial.check_true(f"met and parted twice and more ({changes} changes)", changes >= 6)
    trial.check_memory(memory)
    # what the plate drags over the ball before it turns back for the first time, and where it bounces
    trial.check("friction work over that of the first stroke", work[-1] / (0.3 * LOAD * 0.16 * MICRON), 1.5)


def coincident_centres(trial: Trial) -> None:
    """Bodies with one centre have no normal: refused at the start, by their overlap."""
    bodies = (at(BALL, START, "ball"), at(BALL, START, "post"))
    trial.check_refused("one centre", lambda: meeting(trial, bodies, {}), "overlap")


def light_on_heavy(trial: Trial) -> None:
    """A ball is driven against a post a million times its mass: statics knows no masses."""
    materials = {"ball": solid(210e9, 0.3, 7850.0 / 500.0), "post": solid(210e9, 0.3, 7850.0 * 500.0)}
    run = trial.start(meeting(trial, BALL_AND_POST, FRICTIONS, materials=materials))
    ratio = run.state.bodies.mass[1] / run.state.bodies.mass[0]
    trial.check_true(f"mass ratio of a million ({ratio:.3g})", ratio >= 1e6)
    run.follow(STOPS[:6])
    # the post, which the ball cannot stop, still swings on its contacts
    trial.check("push - 0.6 of the load", abs(push(run, 0, 1) - 0.6), 0.05)


def one_plate_for_all(trial: Trial) -> None:
    """A ball and the post that stops it carry one rigid plate: forces follow from that on the top of the ball, whatever it is."""
    run = trial.start(meeting(trial, BALL_AND_POST, FRICTIONS, support="rigid"))
    run.follow(STOPS[:6])
    top, post = force(run, 0, UPPER), force(run, 1, UPPER)
    trial.check("force on the plate over the load - 1", abs(top[2] + post[2] + 1.0), TILT)
    trial.check_true(f"the ball carries some of it ({-top[2]:.3f})", 0.05 < -top[2] < 0.5)
    trial.check("push over the force on its top - 0.6", abs(push(run, 0, 1) / -top[2] - 0.6), TILT)
