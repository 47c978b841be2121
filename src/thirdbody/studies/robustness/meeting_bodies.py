"""Robustness cases of bodies between plates that meet each other.

All carry one load, so statics gives every force: a ball rolls at half the speed of the upper plate, a post sticks to the lower
plate and slips at the upper one, a rider sticks to the upper one and slips below.
"""

import itertools
import math
from collections.abc import Sequence
from typing import Literal

import numpy as np

from thirdbody.assembly.simulation import build
from thirdbody.errors import InputError
from thirdbody.kernels.columns import record
from thirdbody.kernels.columns.sides import DEBRIS, LOWER, UPPER
from thirdbody.scene.model import Contact, Material, Motion, Pair, Scene, Spheres, Stroke, UpperPlate
from thirdbody.studies.robustness.case import CaseRun, Trial
from thirdbody.studies.robustness.scenes import BOX, LOAD, MICRON, STEEL, clump, drag, scene, solid

SPEED, R, GAP, START = 0.2, 5.0, 0.1, 20.0
"""Speed of the upper plate [m/s]; radius of spheres, gap between bodies and place of the first one [um]."""

BALL = ((0.0, 0.0, 0.0, R),)
POST = tuple((x, y, 0.0, R) for x, y in ((-9.0, 0.0), (-4.5, 0.0), (0.0, -4.0), (0.0, 4.0), (4.5, 0.0), (9.0, 0.0)))
RIDGE = tuple((x, y, 0.0, 0.8) for x, y in ((-1.5, 0.0), (0.0, 0.0), (1.5, 0.0), (0.0, -1.5), (0.0, 1.5)))
"""Spheres (x, y, z, radius) [um]."""

TILT = 5e-3
"""Deviation of forces over the load: normals lean by overlaps, and bounces have not died out to the last."""

STOPS = tuple(1e-7 * k for k in range(1, 13))
"""Stops of the drag [m]."""

STUCK = 10.0

Frictions = dict[tuple[str, str], float]


def two_meet_head_on(trial: Trial) -> None:
    """A rider is stopped by a post: it slid below and slides above; the post carries what the plate gives to both."""
    bodies = (_at(POST, START, "rider"), _at(POST, START + 28.0 + GAP, "post"))
    run = trial.start(_meeting(trial, bodies, {("rider", "lid"): 0.3, ("post", "lid"): 0.1, ("post", "base"): STUCK}))
    run.follow(STOPS)
    trial.check("push - 0.3 of the load", abs(_push(run, 0, 1) - 0.3), TILT)
    trial.check("force of the lower plate - 0.4", abs(_force(run, 1, LOWER)[0] + 0.4), TILT)
    trial.check_true("labelled sliding", run.label(0)[0] == "sliding")
    trial.check("velocity over that of the plate", np.abs(run.state.bodies.velocity).max() / SPEED, 0.01)


def rides_onto(trial: Trial) -> None:
    """A ball mounts a ridge, sqrt(r/R) = 0.4 below friction: it leaves the lower plate, and its force goes along the chord."""
    bodies = (_at(BALL, START, "ball"), _at(RIDGE, START + 2.0 * math.sqrt(0.8 * R) + GAP + 1.5, "post"))
    frictions = {("ball", "lid"): 0.5, ("ball", "base"): 0.5, ("ball", "post"): 0.5, ("post", "base"): STUCK}
    run = trial.start(_meeting(trial, bodies, frictions))
    run.follow(STOPS)
    trial.check_true("off the lower plate", not np.any(_force(run, 0, LOWER)))
    trial.check_true("higher than it was", run.state.bodies.position[0, 2] > 1.02 * R * MICRON)
    top, side = _point(run, UPPER), _point(run, DEBRIS)
    force = _force(run, 0, UPPER)
    # inertia and dashpots at 0.2 m/s are a hundredth of the load
    trial.check("force beside the chord", abs(-force[0] / force[2] - (side[0] - top[0]) / (top[2] - side[2])), 0.02)


def chain_of_ten(trial: Trial) -> None:
    """Ten balls are pushed against a post: each hands on what it gets, and adds twice the friction of its top."""
    row = [_at(BALL, START + k * (2.0 * R + 0.02), "ball") for k in range(10)]
    bodies = (*row, _at(POST, START + 10.0 * (2.0 * R + 0.02) + 9.0, "post"))
    run = trial.start(_meeting(trial, bodies, {("ball", "lid"): 0.05, ("ball", "base"): 0.5, ("post", "base"): STUCK}, 0.1))
    run.follow([1.25 * stop for stop in STOPS])
    pushes = np.array([_push(run, k, k + 1) for k in range(10)])
    trial.check("pushes over those of statics - 1", np.abs(pushes / (0.1 * np.arange(1, 11)) - 1.0).max(), 0.01)


def meets_again(trial: Trial) -> None:
    """Strokes bring a ball to a post and take it back, the contact is lost and found at once: no memory, slip in the first."""
    bodies = (_at(BALL, START, "ball"), _at(POST, START + 2.0 * R + 0.02 + 9.0, "post"))
    motion = Motion(x=(Stroke(stroke=0.2 * MICRON, frequency=5e5, shape="triangle"),))
    frictions = {("ball", "lid"): 0.3, ("ball", "base"): 0.5, ("post", "base"): STUCK}
    run = trial.start(_meeting(trial, bodies, frictions, motion=motion))
    closed, memory, work = list[bool](), list[float](), list[float]()

    def at_stop() -> None:
        closed.append(bool(np.any(_force(run, 0, DEBRIS))))
        memory.append(run.largest_history())
        work.append(float(run.state.bodies.friction_work[0]))

    run.follow([1.25e-7 * k for k in range(1, 65)], "time", at_stop)
    changes = int(np.count_nonzero(np.diff(closed)))
    trial.check_true(f"met and parted twice and more ({changes} changes)", changes >= 6)
    trial.check("memory of open contacts", max(memory), 0.0)
    # what the plate drags over the ball before it turns back for the first time, and where it bounces
    trial.check("friction work over that of the first stroke", work[-1] / (0.3 * LOAD * 0.16 * MICRON), 1.5)


def coincident_centres(trial: Trial) -> None:
    """Bodies with one centre have no normal: refused at the start, by their overlap."""
    bodies = (_at(BALL, START, "ball"), _at(BALL, START, "post"))
    try:
        build(_meeting(trial, bodies, {}))
        message = "accepted"
    except InputError as error:
        message = str(error)
    trial.check_true(f"refused for its overlap ({message})", "overlap" in message)


def light_against_heavy(trial: Trial) -> None:
    """A ball is driven against a post a million times its mass: statics knows no masses."""
    materials = {"ball": solid(210e9, 0.3, 7850.0 / 500.0), "post": solid(210e9, 0.3, 7850.0 * 500.0)}
    bodies = (_at(BALL, START, "ball"), _at(POST, START + 2.0 * R + 0.02 + 9.0, "post"))
    frictions = {("ball", "lid"): 0.3, ("ball", "base"): 0.5, ("post", "base"): STUCK}
    run = trial.start(_meeting(trial, bodies, frictions, materials=materials))
    ratio = run.state.bodies.mass[1] / run.state.bodies.mass[0]
    trial.check_true(f"mass ratio of a million ({ratio:.3g})", ratio >= 1e6)
    run.follow(STOPS[:6])
    # the post, which the ball cannot stop, still swings on its contacts
    trial.check("push - 0.6 of the load", abs(_push(run, 0, 1) - 0.6), 0.05)


def under_one_plate(trial: Trial) -> None:
    """A ball and the post that stops it carry one rigid plate: forces follow from that on the top of the ball, whatever it is."""
    bodies = (_at(BALL, START, "ball"), _at(POST, START + 2.0 * R + 0.02 + 9.0, "post"))
    frictions = {("ball", "lid"): 0.3, ("ball", "base"): 0.5, ("post", "base"): STUCK}
    run = trial.start(_meeting(trial, bodies, frictions, support="rigid"))
    run.follow(STOPS[:6])
    top, post = _force(run, 0, UPPER), _force(run, 1, UPPER)
    trial.check("force on the plate over the load - 1", abs(top[2] + post[2] + 1.0), TILT)
    trial.check_true(f"the ball carries some of it ({-top[2]:.3f})", 0.05 < -top[2] < 0.5)
    trial.check("push over the force on its top - 0.6", abs(_push(run, 0, 1) / -top[2] - 0.6), TILT)


def _at(shape: Sequence[Sequence[float]], x: float, material: str) -> Spheres:
    """Return a clump of spheres [um] at x [um] that stands on the lower plate without overlap."""
    return clump(shape, x * MICRON, gap=0.0).model_copy(update={"material": material})


def _meeting(
    trial: Trial, bodies: Sequence[Spheres], frictions: Frictions, restitution: float = 0.5, motion: Motion | None = None,
    materials: dict[str, Material] | None = None, support: Literal["rigid", "load_per_particle"] = "load_per_particle",
) -> Scene:  # fmt: skip
    """Return a scene of bodies that see each other; pairs that `frictions` does not name have none."""
    names = {str(part.material) for part in bodies}
    known = {name: STEEL for name in (*sorted(names), "base", "lid")} | (materials or {})
    pairs = tuple(
        Pair(between=pair, friction=frictions.get(pair, 0.0), restitution=restitution)
        for pair in itertools.combinations_with_replacement(known, 2)
    )
    upper = UpperPlate(material="lid", support=support, load=LOAD, motion=motion or drag(SPEED))
    contact = Contact(level=trial.setting.level, debris_contact="auto")
    return scene(trial, bodies, known, 0.0, size=BOX, lower="base", upper=upper, contact=contact, pairs=pairs, settle=2.5e-6)


def _force(run: CaseRun, number: int, side: int) -> np.ndarray:
    """Return the force (3,) on a body from a plate or from other bodies, over the load."""
    R = run.state.slots.R[_closed(run, number, side)]
    return (R[:, [record.NORMAL_FORCE]] * R[:, record.NORMAL3] + R[:, record.TANGENTIAL_FORCE3]).sum(axis=0) / LOAD


def _push(run: CaseRun, number: int, other: int) -> float:
    """Return the normal force between two bodies over the load."""
    slots, state = run.state.slots, run.state
    owner, partner = state.order[state.body[slots.own]], state.order[state.body[np.maximum(slots.partner, 0)]]
    pair = ((owner == number) & (partner == other)) | ((owner == other) & (partner == number))
    chosen = run.loaded() & (slots.sides == DEBRIS) & pair
    return float(slots.R[chosen, record.NORMAL_FORCE].sum()) / LOAD


def _point(run: CaseRun, side: int) -> np.ndarray:
    """Return the point (3,) in which the first body touches a plate or another body, from its centre [m]."""
    return run.state.slots.R[_closed(run, 0, side)][0, record.POINT3]


def _closed(run: CaseRun, number: int, side: int) -> np.ndarray:
    slots, state = run.state.slots, run.state
    return run.loaded() & (slots.sides == side) & (state.order[state.body[slots.own]] == number)
