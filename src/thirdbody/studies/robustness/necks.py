"""Robustness cases of tiny particles with necks: `effects.adhesion`."""

import math

import numpy as np

from thirdbody.kernels.columns import body_extra, record
from thirdbody.scene.model import ConstantVelocity, Effects, Motion, UpperPlate
from thirdbody.studies.robustness.case import CaseRun, Trial
from thirdbody.studies.robustness.scenes import BOX, SPEED, STEEL, ball, clump, pressed, scene

WORK = 0.05
"""Work of adhesion [J/m2]."""

RADIUS = 0.2e-6

MODULUS = STEEL.shear() / (1.0 - STEEL.poisson_ratio)
"""E* of two equal materials [Pa]."""

NECK = (math.pi * WORK * RADIUS**2 / (8.0 * MODULUS)) ** (1.0 / 3.0)
"""Contact radius at which a neck breaks [m] (Johnson, Kendall and Roberts 1971)."""

LOST = (6.0 + 9.0 * 4.0 ** (4.0 / 3.0)) * 8.0 / 15.0 * MODULUS * NECK**5 / RADIUS**2
"""Energy that a touch costs [J]: the loop between the way in, no force to touch, and the way out along the neck."""

PULL_OFF = 1.5 * math.pi * WORK * RADIUS

STICKS = Effects(named={"adhesion": {"work_of_adhesion": f"{WORK} J/m2", "model": "jkr"}})


MASS = 4.0 / 3.0 * math.pi * RADIUS**3 * STEEL.density


def thrown(trial: Trial, clearance: float, touches: float, restitution: float, opening: float = 0.0) -> CaseRun:
    """Throw a ball of 0.2 um down between plates with some clearance [m], with the energy that so many touches take.

    `opening`: speed at which the gap grows [m/s].
    """
    gap = 2.0 * RADIUS + clearance
    upper = UpperPlate(material="ball", support="rigid", gap=gap, closing=-opening if opening else None)
    speed = math.sqrt(2.0 * touches * LOST / MASS)
    balls = [ball(RADIUS, (0.5 * BOX, 0.5 * BOX, 0.5 * gap), (0.0, 0.0, -speed))]
    return trial.start(scene(trial, balls, {"ball": STEEL}, 0.3, restitution, BOX, "ball", upper, effects=STICKS, settle=0.0))


def bounces_until_it_sticks(trial: Trial) -> None:
    """A ball bounces between two plates with the energy of 5.5 touches: each takes the same, and the sixth holds it.

    Mutation: without the loss as a neck forms -> energy residual.
    """
    run = thrown(trial, 2e-9, 5.5, 1.0)
    energy: list[float] = []
    run.follow([1e-9 * k for k in range(1, 81)], "time", lambda: energy.append(_lost(run) / LOST))
    trial.check("lost over a touch's, to the next whole number", abs(energy[-1] - round(energy[-1])), 1e-9)
    trial.check_true("every touch took its part", bool(np.all(np.diff(energy) >= -1e-12)))
    if trial.setting.integrator == "explicit":  # implicit steps damp: fewer touches
        trial.check("touches - 6", abs(energy[-1] - 6.0), 1e-9, math.inf)
    trial.check_true("it hangs on a plate", bool(run.loaded().any()))


def both_plates_pull(trial: Trial) -> None:
    """A ball between plates less than the length of a neck wider: both hold it, they part, and it stays on one of them.

    Mutation: jumps that count for the whole step -> energy created by the integrator (implicit, 5 %).
    """
    run = thrown(trial, 4e-11, 2.4, 0.9, 2e-3)
    pull, holding = list[float](), list[int]()

    def at_stop() -> None:
        pull.append(_smallest_force(run) / -PULL_OFF)
        holding.append(int(_joined(run).sum()))

    run.follow([2e-10 * k for k in range(1, 501)], "time", at_stop)
    trial.check("largest pull over the pull-off force - 1", abs(max(pull) - 1.0), 0.05, math.inf)
    trial.check_true("both plates hold it, in the end one does", max(holding) == 2 and holding[-1] == 1)
    lost = _lost(run) / LOST
    trial.check("lost over a touch's, to the next whole number", abs(lost - round(lost)), 1e-9)
    trial.check_true("two touches or more", lost > 1.5)


def tiny_lump_rolls(trial: Trial) -> None:
    """A lump of three uneven spheres of 0.3 um tips over under 20 times its pull-off force: necks come and go.

    Mutation: without the reset of the history at opening -> memory of open contacts.
    """
    lump = clump([(-0.3, 0, 0, 0.3), (0.3, 0.05, 0, 0.3), (0, 0.1, 0.1, 0.325)], gap=1e-7)
    plate = {"load": 20.0 * PULL_OFF}
    motion = Motion(y=(ConstantVelocity(velocity=0.1 * SPEED),))
    run = trial.start(pressed(trial, lump, 0.6, motion, plate=plate, effects=STICKS))
    work, memory, sets = [0.0], list[float](), set()

    def at_stop() -> None:
        work.append(_lost(run))
        memory.append(run.largest_history())
        sets.add(tuple(_joined(run)))

    run.follow([5e-8 * k for k in range(1, 41)], at_stop=at_stop)
    trial.check_true("necks came and went", len(sets) > 1)
    trial.check("memory of open contacts", max(memory), 0.0)
    trial.check_true("each takes energy, none gives", bool(np.all(np.diff(work) >= 0.0)) and work[-1] > work[1])


def _lost(run: CaseRun) -> float:
    """Return what the necks of all bodies have lost since the start [J]."""
    return float(run.state.E[:, body_extra.NORMAL_LOSS].sum())


def _joined(run: CaseRun) -> np.ndarray:
    """Return which candidates have a neck (n,), bool."""
    return run.state.slots.R[:, record.CONTACT_RADIUS] > 0.0


def _smallest_force(run: CaseRun) -> float:
    """Return the least normal force of the contacts [N]."""
    return float(run.state.slots.R[:, record.NORMAL_FORCE].min(initial=0.0))
