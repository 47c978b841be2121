"""Robustness cases of what spots on plates do beside Hertz and Mindlin: `effects.pivoting`, `effects.close_spots`."""

import numpy as np

from thirdbody.kernels.columns import body, run_totals
from thirdbody.scene.load_history import Load
from thirdbody.scene.model import ConstantVelocity, Effects, Motion, Pause
from thirdbody.studies.robustness.case import Trial
from thirdbody.studies.robustness.scenes import BOX, LOAD, MICRON, SPEED, ball, clump, pressed

PIVOTS, INTERACT = Effects(named={"pivoting": {}}), Effects(named={"close_spots": {}})

SPIN = 4e5
"""Spin of a pinched ball about the normal [rad/s]: it stops within 3 us."""


def pinched_spin(trial: Trial) -> None:
    """A ball between plates spins about the normal, is unloaded and pinched again: its spin stops, and becomes friction work."""
    radius = 5.0 * MICRON
    one = ball(radius, (0.5 * BOX, 0.5 * BOX, radius), spin=(0.0, 0.0, SPIN))
    loads = [Pause(pause=1e-6), Load(load=0.3 * LOAD, duration=5e-7), Load(load=LOAD, duration=5e-7)]
    still = Motion(x=(Pause(pause=1.0),))
    run = trial.start(pressed(trial, one, 0.3, still, plate={"loading": loads}, effects=PIVOTS, settle=0.0))
    before, spins, memory = run.kinetic(), [SPIN], list[float]()

    def at_stop() -> None:
        spins.append(float(run.state.B[0, body.SPIN + 2]))
        memory.append(run.largest_history() if not run.loaded().all() else 0.0)

    run.follow([5e-7 * k for k in range(1, 21)], "time", at_stop)
    # what its springs hold at the limit lets it sway by some 5 %
    trial.check("spin that is left", abs(spins[-1]) / SPIN, 0.1)
    trial.check("spin turned round", -min(spins) / SPIN, 0.1)
    trial.check("work of friction - energy of the spin", abs(run.state.A[run_totals.FRICTION_WORK] / before - 1.0), 2e-2)
    trial.check("memory of open spots", max(memory), 0.0)


def crowded_spots(trial: Trial) -> None:
    """A lump of three uneven spheres, spots some contact radii apart, tips over: some are relieved wholly, come and go."""
    lump = clump([(-0.4, -0.25, 0, 2), (0.4, -0.25, 0.001, 2.001), (0.02, 0.45, 0, 2.002)], gap=1e-6)
    motion = Motion(y=(ConstantVelocity(velocity=SPEED),))
    run = trial.start(pressed(trial, lump, 0.6, motion, effects=INTERACT))
    sets, memory = set(), list[float]()

    def at_stop() -> None:
        sets.add(tuple(run.loaded()))
        memory.append(run.largest_history())

    run.follow([2.5e-7 * k for k in range(1, 21)], at_stop=at_stop)
    trial.check_true("spots came and went", len(sets) > 1)
    trial.check("memory of open spots", max(memory), 0.0)
    trial.check_true("it is dragged along", float(np.abs(run.state.bodies.velocity[0, 1])) > 0.1 * SPEED)
