"""Robustness cases of bodies between plates: they run in both integrators.

Every case builds its simulations with `Trial.start`, advances them, and checks its invariants. Below each description: mutations
of the code, and the invariant that then failed.
"""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from thirdbody.kernels.columns import run_totals
from thirdbody.scene.load_history import Load
from thirdbody.scene.model import ConstantVelocity, Motion, Pause
from thirdbody.studies.robustness.case import CaseRun, Trial
from thirdbody.studies.robustness.scenes import (
    BOX,
    HEIGHT,
    LOAD,
    MICRON,
    SPAN,
    SPEED,
    STEEL,
    TRIPOD,
    clump,
    drag,
    particle,
    pressed,
    solid,
)

STOPS = tuple(5e-8 * k for k in range(1, 11))
"""Stops of the drag [m]."""

SETTLED = 2e-2
"""Deviation of the friction coefficient where inertia and the dashpot of the patch still carry a small load at 1 m/s."""


def lost_contact(trial: Trial) -> None:
    """Pressed and dragged, without load until every contact is open, then loaded again: an open contact has no history.

    Mutation: without the reset of the history at opening -> memory of open contacts.
    """
    lifted = [Pause(pause=3e-7), Load(load=0.0), Pause(pause=2e-7), Load(load=LOAD)]
    run = trial.start(pressed(trial, clump(TRIPOD), 0.3, plate={"loading": lifted, "damping": 0.0, "mass": 2e-12}))
    opened, memory, sheared = [], [], []

    def at_stop() -> None:
        opened.append(not run.loaded().any())
        memory.append(run.largest_history())
        sheared.append(float(np.abs(run.shear()).max()))

    run.follow([2e-8 * k for k in range(1, 81)], "time", at_stop)
    again = bool(sheared[10] > 0.0 and any(opened) and sheared[-1] > 0.0)
    trial.check_true("the spots were loaded, open, and loaded again", again)
    trial.check("memory of open spots", max(memory), 0.0)


def touch_and_go(trial: Trial) -> None:
    """A lump of three uneven spheres tips over: contacts open and close inside long steps.

    Mutations: without the reset of the history at opening -> memory of open contacts. Without cutting unconverged implicit steps
    -> no step converges (`mdr`).
    """
    lump = clump([(-3, 0, 0, 3), (3, 0.5, 0, 3), (0, 1, 1, 3.25)], gap=1e-6)
    run = trial.start(pressed(trial, lump, 0.6, Motion(y=(ConstantVelocity(velocity=SPEED),))))
    sets, memory = set(), []

    def at_stop() -> None:
        sets.add(tuple(run.loaded()))
        memory.append(run.largest_history())

    run.follow([2.5e-7 * k for k in range(1, 41)], at_stop=at_stop)
    trial.check_true("spots came and went", len(sets) > 2)
    trial.check("memory of open spots", max(memory), 0.0)


def no_friction(trial: Trial) -> None:
    """mu = 0: no shear, no work, no motion; the label is sliding.

    Mutation: without the guarded division of the radial return (0/0 at rest) -> non-finite forces.
    """
    run = trial.start(pressed(trial, clump(TRIPOD), 0.0))
    labels: list[str] = []
    start = run.state.B[0, :2].copy()
    run.follow(STOPS, at_stop=lambda: labels.append(run.label()[0]))
    trial.check("shear force", np.abs(run.shear()).max(), 0.0)
    trial.check("friction work", run.state.A[run_totals.FRICTION_WORK], 0.0)
    # tilting into equilibrium may shift the centre; friction must not
    trial.check("path of the body, m", np.abs(run.state.B[0, :2] - start).max(), 0.0)
    # the first step of the drag opens the window in which slip is counted
    trial.check_true("labelled sliding", set(labels[1:]) == {"sliding"})


def endless_friction(trial: Trial) -> None:
    """mu = 1e9: critical displacements of metres; the body tips, with finite forces.

    Mutations of the implicit integrator: without line search (full Newton steps) -> no step converges (`mdr`). Without the limit
    of a correction -> twice as many cuts (`mindlin`). Without cutting unconverged steps -> no step converges (`mindlin`, `mdr`).

    Known failure: `exact` with the implicit integrator at 0.1 m/s. At a contact that lifts off with T far above N, T vanishes as
    the square root of its overlap, and steps shrink until none converges; the run is stopped with that message.
    """
    speed = 0.1 if trial.setting.integrator == "explicit" else 1e-3
    run = trial.start(pressed(trial, clump(TRIPOD, gap=1e-6), 1e9, drag(speed)))
    labels, forces = list[str](), list[float]()

    def at_stop() -> None:
        labels.append(run.label()[0])
        forces.append(abs(float(run.state.A[run_totals.UPPER_FORCE])) / LOAD)

    run.follow(STOPS, at_stop=at_stop)
    # it pivots about the edge of two contacts, at most span over height = 5/2 times the load
    trial.check("shear over load", max(forces), 2.5)
    trial.check_true("never labelled sliding", "sliding" not in labels)


def symmetric_spots(trial: Trial) -> None:
    """x_1 = 0 between spots at -L and L: no motion under pressing; it slides when dragged below its limit.

    Mutation: without the bounds of the time step, steps eight times longer -> the travel guard stops it.
    """
    run = trial.start(pressed(trial, particle([0.0], [-SPAN, SPAN]), 0.3))
    shifts: list[float] = []
    run.to(time=run.simulation.settle)
    shifts.append(abs(float(run.state.bodies.position[0, 0]) - 0.5 * BOX))
    run.follow(STOPS)
    # mirror images add up in opposite order: rounding of coordinates of 1e-4 m
    trial.check("shift by pressing, m", max(shifts), 1e-15)
    trial.check("out of the plane, m", abs(run.state.bodies.position[0, 1] - 0.5 * BOX), 0.0)
    trial.check("friction coefficient - mu", abs(run.friction() / 0.3 - 1.0), SETTLED)
    trial.check_true("labelled sliding", run.label()[0] == "sliding")


def degenerate_spots(trial: Trial) -> None:
    """Two contacts (one sphere), coincident contacts, contacts in a row: rank-deficient; finite, labelled indeterminate."""
    for what, body_number in _degenerate():
        run = trial.start(pressed(trial, body_number, 0.3, Motion(x=(Pause(pause=1e-6), ConstantVelocity(velocity=SPEED)))))
        run.follow([5e-8, 1e-7], "time")
        state, reason = run.label()
        named = (state, reason) == ("sticking", "indeterminate")
        trial.check_true(f"{what}: at rest it sticks, indeterminate (is {state}, {reason})", named)
        trial.check(f"{what}: largest shear over load", np.abs(run.shear()).max() / LOAD, 0.3 * 1.001)


def _degenerate() -> list[tuple[str, Any]]:
    row = [(0.0, y, 0.0, 2.0) for y in (-3.0, 0.0, 3.0)]
    return [
        ("two spots", clump([(0.0, 0.0, 0.0, 2.0)])),
        ("coincident spots", particle([0.0, 0.0], [0.0, 0.0])),
        ("spots in a row", clump(row)),
    ]


def at_the_limit(trial: Trial) -> None:
    """mu = t_max to 1e-6: whether it slides or starts to tip is undetermined, the force is not.

    Mutation: without cutting unconverged implicit steps -> no step converges (`mdr`).

    Checked from 50 nm on: partial slip (`exact`) reaches its limit at some 25 nm, before which it may be labelled sticking.
    """
    for change in (-1e-6, 0.0, 1e-6):
        mu = SPAN / HEIGHT * (1.0 + change)
        run = trial.start(pressed(trial, particle([0.0], [-SPAN, SPAN]), mu, drag(0.1)))
        labels: list[str] = []
        run.follow([5e-8, 7.5e-8], at_stop=lambda labels=labels, run=run: labels.append(run.label()[0]))  # type: ignore[misc]
        trial.check_true(f"mu (1 {change:+.0e}): sliding or rolling", set(labels) <= {"sliding", "rolling"})
        # once it tips, by distance/h = 0.02 at most, the upper spot moves on by that fraction of h, against L = h/2; plus inertia
        trial.check(f"mu (1 {change:+.0e}): friction coefficient - mu", abs(run.friction() / mu - 1.0), 0.04 + SETTLED)


def both_sides(trial: Trial) -> None:
    """Both sides slide with equal mu: the motion of the body is undetermined, the force and the label are not.

    Mutation: without the bounds of the time step, steps eight times longer -> the energy guard stops it.
    """
    run = trial.start(pressed(trial, particle([-SPAN, SPAN], [-SPAN, SPAN]), 0.3))
    labels: list[str] = []
    run.follow(STOPS, at_stop=lambda: labels.append(run.label()[0]))
    moved = float(run.state.bodies.position[0, 0]) - 0.5 * BOX
    trial.check_true("labelled sliding", set(labels[2:]) == {"sliding"})
    trial.check("friction coefficient - mu", abs(run.friction() / 0.3 - 1.0), SETTLED)
    trial.check("outside the path of the plates, m", max(-moved, moved - STOPS[-1]), 2e-8)


def stiff_ratio(trial: Trial) -> None:
    """A body a thousand times softer than its plates and incompressible, and vice versa.

    Mutation: without the bounds of the time step, steps eight times longer -> the energy guard stops it.
    """
    soft, stiff = solid(210e6, 0.5, 1000.0), solid(210e9, 0.3, 7850.0)
    for what, materials, load in (("soft body", (soft, stiff), 1e-6), ("soft plates", (stiff, soft), 1e-6)):
        known = dict(zip(("ball", "plate"), materials, strict=True))
        run = trial.start(pressed(trial, clump(TRIPOD), 0.3, drag(0.05), materials=known, plate={"load": load}))
        run.follow([1e-7 * k for k in range(1, 11)])
        trial.check(f"{what}: friction coefficient - mu", abs(run.friction() / 0.3 - 1.0), 0.05)
        trial.check_true(f"{what}: sliding", run.label()[0] == "sliding")


def across_a_face(trial: Trial) -> None:
    """Dragged across a periodic face, and in the middle of the domain: the same forces.

    Mutation: without the bounds of the time step, steps eight times longer -> the overlap guard stops it.
    """
    histories = [_forces(trial, x) for x in (0.5 * BOX, BOX - 1.5 * MICRON)]
    scale = np.abs(histories[0]).max(axis=0)
    # coordinates of 1e-4 m have a rounding of 1e-20 m over overlaps of 1e-8 m; an unsteady motion amplifies it
    trial.check("difference of the forces", (np.abs(histories[1] - histories[0]).max(axis=0) / scale).max(), 1e-6)


def _forces(trial: Trial, x: float) -> np.ndarray:
    run = trial.start(pressed(trial, clump(TRIPOD, x=x), 0.3))
    rows: list[Sequence[float]] = []
    run.follow(STOPS, at_stop=lambda: rows.append(tuple(run.state.A[[run_totals.UPPER_FORCE, run_totals.UPPER_FORCE + 2]])))
    return np.array(rows)


def constant_gap(trial: Trial) -> None:
    """mu > t_max at constant gap: the particle wedges. Warned of when the scene is built; until then its forces are finite.

    Mutations: without the warning -> warned of wedging. Without the bounds of the time step -> the energy guard stops it.
    """
    gap = {"support": "rigid", "load": None, "gap": HEIGHT, "closing": 2e-3}
    run = trial.start(pressed(trial, particle([0.0], [-SPAN, SPAN]), 0.7, drag(0.01), plate=gap, settle=1e-6))
    forces: list[float] = []
    run.follow([2e-9 * k for k in range(1, 11)], at_stop=lambda: forces.append(float(run.state.A[run_totals.UPPER_FORCE + 2])))
    trial.check_true("warned of wedging", any("wedges" in warning for warning in run.simulation.warnings))
    trial.check_true("the normal force grows", bool(forces[-1] > forces[0] > 0.0))


def many_dashpots(trial: Trial) -> None:
    """A sheet of seven spheres, fourteen contacts, each with the dashpot of a restitution of 0.1: they add up on one body.

    Mutation: without the bound of the time step by damping -> the energy guard stops it (residual 0.74).
    """
    ring = [(3.0 * math.cos(k * math.pi / 3.0), 3.0 * math.sin(k * math.pi / 3.0), 0.0, 2.0) for k in range(6)]
    flake = clump([(0.0, 0.0, 0.0, 2.0), *ring])
    run = trial.start(pressed(trial, flake, 0.2, drag(0.1), restitution=0.1, plate={"load": 2.0 * LOAD}))
    run.follow([1e-8 * k for k in range(1, 6)])
    trial.check("friction coefficient - mu", abs(run.friction() / 0.2 - 1.0), SETTLED)
    trial.check(
        "lost in dashpots over the work of the plate",
        run.state.A[run_totals.DAMPING_WORK] / run.state.A[run_totals.PLATE_WORK_SIZE],
        1.0,
    )


def plain_slide(trial: Trial) -> CaseRun:
    """A tripod that slides, settled: the run of cases about the time step."""
    run = trial.start(pressed(trial, clump(TRIPOD), 0.3, materials={"ball": STEEL}))
    run.follow(STOPS[:2])
    return run
