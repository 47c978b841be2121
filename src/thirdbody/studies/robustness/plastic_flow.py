"""Robustness cases of contacts that flow: `effects.elastic_plastic`."""

import math

import numpy as np

from thirdbody.kernels.columns import body_extra, run_totals
from thirdbody.laws.first_yield import FIRST_YIELD, yield_speed
from thirdbody.scene.load_history import Load
from thirdbody.scene.model import ConstantVelocity, Effects, Material, Motion, Pause
from thirdbody.studies.robustness.case import CaseRun, Trial
from thirdbody.studies.robustness.scenes import LOAD, SPEED, TRIPOD, clump, on_plane, pressed

FLOWS = Effects(named={"elastic_plastic": {}})

SOFT = Material(youngs_modulus=210e9, poisson_ratio=0.3, density=7850.0, yield_strength=2e8)
"""Steel that yields under a hundredth of the loads of these cases."""

RADIUS = 1e-3

FAST = 100.0
"""Speed of the impact over that of first yield."""

REBOUND = 1e-2
"""Deviation of the coefficient of restitution, from 16 steps: the largest overlap lies between two of them."""


def fast_impact(trial: Trial) -> None:
    """An impact at a hundred times the speed of first yield: Thornton's restitution, and what is missing is plastic work.

    Mutation: without the dent that stays (unloading as Hertz's sphere) -> energy residual.
    """
    modulus, y = 2.0 * SOFT.shear() / (1.0 - SOFT.poisson_ratio), 1.0 / FAST  # of a rigid plane
    speed = FAST * yield_speed(modulus, FIRST_YIELD * 2e8, SOFT.density)
    run = trial.start(on_plane(trial, SOFT, RADIUS, (0.0, 0.0, -speed), 0.3, effects=FLOWS))
    before = run.kinetic()
    run.leave(1e-6)
    root = y + 2.0 * math.sqrt(1.2 - 0.2 * y * y)
    expected = math.sqrt(1.2 * math.sqrt(3.0)) * math.sqrt(1.0 - y * y / 6.0) * (y / root) ** 0.25
    trial.check("restitution - Thornton's", abs(run.velocity()[2] / speed - expected), REBOUND, math.inf)
    lost = 1.0 - run.kinetic() / before
    trial.check("plastic work - what was lost, over the energy", abs(_plastic(run) / before - lost), 2.0 * REBOUND, math.inf)
    trial.check("memory of open spots", run.largest_history(), 0.0)


def pressed_again(trial: Trial) -> None:
    """A body is pressed, released to a quarter, pressed again and then twice as hard: only new loads flow.

    Mutation: without the largest overlap in the history -> energy of the integrator.
    """
    cycle = [Pause(pause=1e-6), *(Load(load=part * LOAD, duration=1e-6) for part in (0.25, 0.9, 2.0))]
    plate = {"loading": cycle}
    run = trial.start(pressed(trial, clump(TRIPOD), 0.0, materials={"ball": SOFT}, plate=plate, effects=FLOWS))
    work: list[float] = []
    run.follow([0.9e-6, 2.0e-6, 2.9e-6, 6e-6], "time", lambda: work.append(_plastic(run)))
    trial.check("plastic work below the old load", abs(work[2] / work[0] - 1.0), 1e-12)
    trial.check("plastic work of the old load over that of twice it", work[0] / work[3], 0.5)
    trial.check("work of friction without friction", abs(run.ledger.lines(run.state)["friction"]) / work[3], 1e-12)


def yields_and_rolls(trial: Trial) -> None:
    """A lump of three uneven spheres tips over under a load far beyond yield: each spot flows as it takes the load.

    Mutation: without the reset of the history at opening -> memory of open contacts.
    """
    lump = clump([(-3, 0, 0, 3), (3, 0.5, 0, 3), (0, 1, 1, 3.25)], gap=1e-6)
    motion = Motion(y=(ConstantVelocity(velocity=SPEED),))
    run = trial.start(pressed(trial, lump, 0.6, motion, materials={"ball": SOFT}, effects=FLOWS))
    work, memory, sets = [0.0], list[float](), set()

    def at_stop() -> None:
        work.append(_plastic(run))
        memory.append(run.largest_history())
        sets.add(tuple(run.loaded()))

    run.follow([2.5e-7 * k for k in range(1, 41)], at_stop=at_stop)
    trial.check_true("spots came and went", len(sets) > 2)
    trial.check("memory of open spots", max(memory), 0.0)
    trial.check_true("plastic work only grows", bool(np.all(np.diff(work) >= 0.0)))
    trial.check_true("new spots flow", work[-1] > 1.05 * work[1] > 0.0)
    total = float(run.state.A[run_totals.FRICTION_WORK])
    trial.check_true("friction and plastic work have their parts", 0.0 < work[-1] < total)


def _plastic(run: CaseRun) -> float:
    """Return the plastic work of all bodies since the start [J]."""
    return float(run.state.E[:, body_extra.NORMAL_LOSS].sum())
