"""Processor time that both integrators are expected to take: numbers of steps times measured rates, without a trial.

Measured on 60 to 2000 bodies at speeds from 1 mm/s to 50 m/s, loads from 1 uN to 1 mN and area fractions up to 0.55; for most of
these scenes the times, and their ratio, are right to a factor of 2 (`tests/bench/expected_time.py` prints the table).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from thirdbody.assembly.inertial_number import inertial_number, shortest_stroke
from thirdbody.assembly.physics import CompiledPhysics
from thirdbody.assembly.upper_plate import Upper
from thirdbody.engine.expected_islands import ExpectedIslands
from thirdbody.engine.rayleigh_time import RAYLEIGH_FRACTION, rayleigh_time
from thirdbody.engine.state import State
from thirdbody.engine.upper_plate import Schedule
from thirdbody.kernels.columns import sphere
from thirdbody.laws.contract import Law
from thirdbody.scene.model import Scene

NS = {"sphere": 26.0, "contact": 10.0, "pair": 4.0, "law": 4.0, "mindlin": 7.0, "exact": 60.0, "spring": 8.0, "body": 6.0,
      "labels": 30.0}  # fmt: skip
"""Processor time in an explicit step [ns], partly measured with numba 0.68 on a Zen 5, partly estimated.

Per sphere (motion), per contact (geometry) or checked pair, per contact and law, per spring, per body and effect, per body for
its labels.
"""

TOUCH = 0.02
"""A sphere nearer to a plate than this fraction of its radius will carry load."""

STEP_OVERHEAD = 2.5e-6
"""Processor time of an explicit step besides that of its bodies [s]."""

SHORTER = 0.9
"""Mean explicit time step over the longest one that the smallest body allows: contacts shorten it."""

IMPLICIT_STEP, SAME_WORK = 3e-6, 9.0
"""Processor time of an implicit step of a body [s]: this, and this many times that of an explicit one.

It has some three iterations, each with laws, tangents and a solution of 7 equations.
"""

STOP, STOP_OF_BODY = 2e-3, 2e-6
"""Processor time at a stop of the implicit integrator, which are its outputs and searches: per stop, per stop and body [s]."""

SETTLING, FIRST_SLIP, PER_DIAMETER, PER_REVERSAL, BALL = 150.0, 100.0, 200.0, 30.0, 0.25
"""Implicit steps of a clump: while it settles, in its first sliding, per diameter of drag, per reversal of a stroke. Fraction of
them that a single sphere takes: it does not tip."""

TOGETHER, BALANCE, REPEATED = 0.4, 1.5, 2.0
"""Of bodies that carry one plate together: number of common steps over that of a body with a patch, as this power of the number
of bodies, since each step is as short as the most restless body needs; work of a step over that of a body with a patch: each is
solved again for every trial rise of the plate; and factor where bodies may meet, since a missed contact returns all of them."""

INERTIAL_STEPS, INERTIAL = 4.5, 5.0
"""Implicit steps in a Rayleigh time of the mean body where inertia rules, as in impacts, in terms of the usual ones, which take
longer; the inertial number of a body (`assembly.inertial_number`) above which it does. Below, the number of such steps falls with
its power 3/2."""

USUAL_TOLERANCE = 5e-4
"""Tolerance of a step for which the numbers of steps hold; they grow with the inverse of its cube root."""


class ExpectedTimes(NamedTuple):
    """Expected processor time of all steps [s]."""

    explicit: float
    implicit: float


class Extent(NamedTuple):
    """What a run computes: its settling and sliding time [s], its path [m], its number of outputs, its motion."""

    settle: float
    sliding: float
    path: float
    outputs: float
    schedule: Schedule


def extent_of(scene: Scene, upper: Upper) -> Extent:
    """Return what a run of a scene computes; its sliding time is infinite where its distance is never reached."""
    schedule, solver = Schedule() if upper.plate is None else upper.plate.schedule, scene.solver
    if solver.duration is not None:
        sliding, path = solver.duration, schedule.path(upper.settle, upper.settle + solver.duration)
    else:
        path = solver.distance or 0.0
        sliding = schedule.time_of(path, upper.settle) - upper.settle
    by_time = scene.output.every_kind == "time"
    return Extent(upper.settle, sliding, path, (sliding if by_time else path) / scene.output.every, schedule)


def expected_times(
    scene: Scene, choice: CompiledPhysics, state: State, upper: Upper, islands: ExpectedIslands, together: bool = False
) -> ExpectedTimes:
    """Return the expected processor times of a scene whose bodies have loads and patches of their own.

    `together`: they carry one plate instead; then they share its steps, whether they meet or not.
    """
    extent, radius = extent_of(scene, upper), state.rayleigh_radius
    times = np.array([rayleigh_time(1.0, m) for m in choice.materials])[state.material] * radius
    work = _explicit_step_of_bodies(choice, state)
    shortest = SHORTER * RAYLEIGH_FRACTION * float(times.min())
    explicit = (extent.settle + extent.sliding) / shortest * (STEP_OVERHEAD + work)
    n, steps = state.n_bodies, _implicit_steps(scene, state, extent, float(times.mean()))
    shared = BALANCE * n**TOGETHER * (REPEATED if islands.stride < math.inf else 1.0) if together else islands.mean
    each = steps * shared * (IMPLICIT_STEP + SAME_WORK * work / n)
    return ExpectedTimes(explicit, n * each + time_of_stops(extent, islands, n))


def time_of_stops(extent: Extent, islands: ExpectedIslands, bodies: int) -> float:
    """Return the expected processor time of the implicit integrator at its outputs and searches for islands [s]."""
    searches = extent.path / islands.stride if islands.stride < math.inf else 0.0
    return (extent.outputs + searches) * (STOP + bodies * STOP_OF_BODY)


def law_cost(law: Law) -> float:
    """Return the processor time of a law in an explicit step of a contact [ns]."""
    numbers = len(law.history)  # a row of springs stores two numbers for each
    row_of_springs = numbers > 16 and law.name not in NS
    return NS["spring"] * numbers / 2.0 if row_of_springs else NS.get(law.name, NS["law"])


def _explicit_step_of_bodies(choice: CompiledPhysics, state: State) -> float:
    """Return the processor time of all bodies in an explicit step [s]."""
    contact = NS["contact"] + sum(law_cost(law) for law in choice.chain.laws)
    each = NS["body"] * len(choice.effects) + NS["labels"] * (choice.labeller is not None) / max(1, state.physics.stride)
    return 1e-9 * (NS["sphere"] * state.n_spheres + contact * _contacts(state) + each * state.n_bodies)


def _contacts(state: State) -> int:
    """Return the number of contacts with plates at the start, at least two of each body."""
    upper, S = state.world.upper, state.S
    radius, height = S[:, sphere.RADIUS], S[:, sphere.Z]
    touching = height - radius < TOUCH * radius
    number = np.count_nonzero(touching)
    if upper is not None:
        number += np.count_nonzero(upper.heights[upper.patch[state.body]] - height - radius < TOUCH * radius)
    return max(int(number), 2 * state.n_bodies)


def _implicit_steps(scene: Scene, state: State, extent: Extent, rayleigh: float) -> float:
    """Return the expected number of implicit steps of a body. `rayleigh`: Rayleigh time of the mean body [s]."""
    diameter = 2.0 * float(state.rayleigh_radius.mean())
    finer = (USUAL_TOLERANCE / (scene.solver.tolerance or USUAL_TOLERANCE)) ** (1.0 / 3.0)
    stroke = shortest_stroke(extent.schedule)
    clumps = float(np.mean(np.diff(state.start) > 1))
    steps = SETTLING + FIRST_SLIP + PER_DIAMETER * extent.path / diameter + PER_REVERSAL * extent.path / stroke
    steps *= clumps + BALL * (1.0 - clumps)
    if (longest := scene.solver.largest_step) is not None:
        steps = max(steps, extent.path / longest)
    return finer * (steps + _inertial_steps(scene, state, extent, rayleigh)) + extent.outputs


def _inertial_steps(scene: Scene, state: State, extent: Extent, rayleigh: float) -> float:
    """Return the expected number of steps in which inertia rules."""
    inertial = None if scene.solver.inertia is False else inertial_number(state)
    if inertial is None:
        return 0.0
    fraction = min(1.0, (inertial.number / INERTIAL) ** 1.5)
    return fraction * INERTIAL_STEPS * extent.sliding / rayleigh if math.isfinite(extent.sliding) else 0.0
