"""Hard cases of contacts that flow, pivot, press each other's surface down, or have necks."""

import math

import numpy as np
from hard.between_plates import LUMP, tumble
from hard.trial import BOX, LOAD, MICRON, SPEED, TRIPOD, CaseRun, Trial, clump, every, on_plane, pressed, scene
from theory.builders import STEEL, ball
from thirdbody.kernels.tables import body, record
from thirdbody.laws.hertz import FIRST_YIELD, yield_speed
from thirdbody.scene.model import Effects, Material, Motion, Pause, UpperPlate
from thirdbody.scene.motion import Load

FLOWS, PIVOTS, INTERACT = (Effects(named={name: {}}) for name in ("elastic_plastic", "pivoting", "close_spots"))
SOFT = Material(youngs_modulus=210e9, poisson_ratio=0.3, density=7850.0, yield_strength=2e8)
"""Steel that yields under a hundredth of the loads of these cases."""
REBOUND = 1e-2  # deviation of the coefficient of restitution, from 16 steps: the largest overlap lies between two of them


def fast_impact(trial: Trial) -> None:
    """An impact at a hundred times the speed of first yield: Thornton's restitution, and what is missing is plastic work."""
    modulus, y = 2.0 * SOFT.shear() / (1.0 - SOFT.poisson_ratio), 0.01  # of a rigid plane
    speed = 100.0 * yield_speed(modulus, FIRST_YIELD * 2e8, SOFT.density)
    run = trial.start(on_plane(trial, SOFT, 1e-3, (0.0, 0.0, -speed), 0.3, effects=FLOWS))
    before = run.kinetic()
    run.leave(1e-6)
    root = y + 2.0 * math.sqrt(1.2 - 0.2 * y * y)
    expected = math.sqrt(1.2 * math.sqrt(3.0)) * math.sqrt(1.0 - y * y / 6.0) * (y / root) ** 0.25
    trial.check("restitution - Thornton's", abs(run.velocity()[2] / speed - expected), REBOUND, math.inf)
    lost = 1.0 - run.kinetic() / before
    trial.check("plastic work - what was lost, over the energy", abs(run.normal_loss() / before - lost), 2 * REBOUND, math.inf)
    trial.check_memory(run.memory())


def pressed_again(trial: Trial) -> None:
    """A body is pressed, released to a quarter, pressed again and then twice as hard: only new loads flow."""
    cycle = [Pause(pause=1e-6), *(Load(load=part * LOAD, duration=1e-6) for part in (0.25, 0.9, 2.0))]
    plate = {"loading": cycle}
    run = trial.start(pressed(trial, clump(TRIPOD), 0.0, materials={"ball": SOFT}, plate=plate, effects=FLOWS))
    (work,) = run.follow([0.9e-6, 2.0e-6, 2.9e-6, 6e-6], run.normal_loss, kind="time")
    trial.check("plastic work below the old load", abs(work[2] / work[0] - 1.0), 1e-12)
    trial.check("plastic work of the old load over that of twice it", work[0] / work[3], 0.5)
    trial.check("work of friction without friction", abs(run.ledger.lines(run.state)["friction"]) / work[3], 1e-12)


def yields_and_rolls(trial: Trial) -> None:
    """A lump of three uneven spheres tips over under a load far beyond yield: each spot flows as it takes the load."""
    run, work = tumble(trial, LUMP, every(2.5e-7, 40), 2, materials={"ball": SOFT}, effects=FLOWS)
    trial.check_true("plastic work only grows", np.all(np.diff(work) >= 0.0))
    trial.check_true("new spots flow", work[-1] > 1.05 * work[1] > 0.0)
    trial.check_true("friction and plastic work have their parts", 0.0 < work[-1] < run.friction_work())


def pinched_spin(trial: Trial) -> None:
    """A ball between plates spins about the normal, is unloaded and pinched again: its spin stops, and becomes friction work."""
    radius, speed = 5.0 * MICRON, 4e5  # rad/s: it stops within 3 us
    one = ball(radius, (0.5 * BOX, 0.5 * BOX, radius), spin=(0.0, 0.0, speed))
    plate = {"loading": [Pause(pause=1e-6), Load(load=0.3 * LOAD, duration=5e-7), Load(load=LOAD, duration=5e-7)]}
    run = trial.start(pressed(trial, one, 0.3, Motion(x=(Pause(pause=1.0),)), plate=plate, effects=PIVOTS, settle=0.0))
    before = run.kinetic()
    spins, memory = run.follow(every(5e-7, 20), lambda: run.state.B[0, body.SPIN + 2], run.memory, kind="time")
    # what its springs hold at the limit lets it sway by some 5 %
    trial.check("spin that is left", abs(spins[-1]) / speed, 0.1)
    trial.check("spin turned round", -np.array(spins) / speed, 0.1)
    trial.check("work of friction - energy of the spin", abs(run.friction_work() / before - 1.0), 2e-2)
    trial.check_memory(memory)


def crowded_spots(trial: Trial) -> None:
    """A lump of three uneven spheres, spots some contact radii apart, tips over: some are relieved wholly, come and go."""
    lump = [(-0.4, -0.25, 0, 2), (0.4, -0.25, 0.001, 2.001), (0.02, 0.45, 0, 2.002)]
    run, _ = tumble(trial, lump, every(2.5e-7, 20), 1, effects=INTERACT)
    trial.check_true("it is dragged along", abs(run.velocity()[1]) > 0.1 * SPEED)


WORK, RADIUS = 0.05, 0.2e-6  # work of adhesion [J/m2]; radius of the ball [m]
STICKS = Effects(named={"adhesion": {"work_of_adhesion": f"{WORK} J/m2", "model": "jkr"}})
MODULUS = STEEL.shear() / (1.0 - STEEL.poisson_ratio)  # E* of two equal materials [Pa]
NECK = (math.pi * WORK * RADIUS**2 / (8.0 * MODULUS)) ** (1.0 / 3.0)
"""Contact radius at which a neck breaks [m] (Johnson, Kendall and Roberts 1971)."""
LOST = (6.0 + 9.0 * 4.0 ** (4.0 / 3.0)) * 8.0 / 15.0 * MODULUS * NECK**5 / RADIUS**2
"""Energy that a touch costs [J]: the loop between the way in, no force to touch, and the way out along the neck."""
PULL_OFF = 1.5 * math.pi * WORK * RADIUS


def joined(run: CaseRun) -> np.ndarray:
    return run.state.slots.R[:, record.CONTACT_RADIUS] > 0.0


def thrown(trial, clearance, touches, restitution, opening=None):
    """A ball thrown down between plates with the energy of so many touches; the gap grows by `opening` [m/s]."""
    gap = 2.0 * RADIUS + clearance
    upper = UpperPlate(material="ball", support="rigid", gap=gap, closing=-opening if opening else None)
    speed = math.sqrt(2.0 * touches * LOST / (4.0 / 3.0 * math.pi * RADIUS**3 * STEEL.density))
    balls = [ball(RADIUS, (0.5 * BOX, 0.5 * BOX, 0.5 * gap), (0.0, 0.0, -speed))]
    keys = {"restitution": restitution, "size": BOX, "lower": "ball", "upper": upper, "settle": 0.0}
    return trial.start(scene(trial, balls, {"ball": STEEL}, 0.3, effects=STICKS, **keys))


def check_whole(trial, run):
    lost = run.normal_loss() / LOST
    trial.check("lost over a touch's, to the next whole number", abs(lost - round(lost)), 1e-9)
    return lost


def bounces_until_it_sticks(trial: Trial) -> None:
    """A ball bounces between two plates with the energy of 5.5 touches: each takes the same, and the sixth holds it."""
    run = thrown(trial, 2e-9, 5.5, 1.0)
    (energy,) = run.follow(every(1e-9, 80), lambda: run.normal_loss() / LOST, kind="time")
    lost = check_whole(trial, run)
    trial.check_true("every touch took its part", np.all(np.diff(energy) >= -1e-12))
    if trial.setting.integrator == "explicit":  # implicit steps damp: fewer touches
        trial.check("touches - 6", abs(lost - 6.0), 1e-9, math.inf)
    trial.check_true("it hangs on a plate", run.loaded().any())


def both_plates_pull(trial: Trial) -> None:
    """A ball between plates less than the length of a neck wider: both hold it, they part, and it stays on one of them."""
    run = thrown(trial, 4e-11, 2.4, 0.9, 2e-3)
    pull, joints = run.follow(
        every(2e-10, 500), lambda: -run.state.slots.R[:, record.NORMAL_FORCE].min(initial=0.0), lambda: joined(run).sum(),
        kind="time",
    )  # fmt: skip
    trial.check("largest pull over the pull-off force - 1", abs(max(pull) / PULL_OFF - 1.0), 0.05, math.inf)
    trial.check_true("both plates hold it, in the end one does", max(joints) == 2 and joints[-1] == 1)
    trial.check_true("two touches or more", check_whole(trial, run) > 1.5)


def tiny_lump_rolls(trial: Trial) -> None:
    """A lump of three uneven spheres of 0.3 um tips over under 20 times its pull-off force: necks come and go."""
    lump, load = [(-0.3, 0, 0, 0.3), (0.3, 0.05, 0, 0.3), (0, 0.1, 0.1, 0.325)], 20.0 * PULL_OFF
    keys = {"gap": 1e-7, "speed": 0.1 * SPEED, "closed": joined, "plate": {"load": load}, "effects": STICKS}
    _, work = tumble(trial, lump, every(5e-8, 40), 1, **keys)
    trial.check_true("each takes energy, none gives", np.all(np.diff(work) >= 0.0) and work[-1] > work[1])
