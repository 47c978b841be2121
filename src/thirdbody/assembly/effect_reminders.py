"""Reminders of effects that a scene does not name but would need, and of what its restitution means for clumps."""

import math

import numpy as np

from thirdbody.assembly.physics import CompiledPhysics
from thirdbody.engine.state import State
from thirdbody.kernels.tables import body
from thirdbody.laws.damping import HERTZ_DAMPING, damping_number, restitution_of
from thirdbody.scene.model import Scene


def effect_reminders(scene: Scene, choice: CompiledPhysics, state: State) -> list[str]:
    """Return warnings: balls that spin and nothing can stop, clumps in free flight whose pairs have a restitution below 1."""
    return [*_spinning_balls(scene, choice, state), *_clumps_that_fly(scene, choice, state)]


def _spinning_balls(scene: Scene, choice: CompiledPhysics, state: State) -> list[str]:
    """Return a warning where balls between two plates spin about the normal and nothing can stop them."""
    if scene.plates.lower is None or scene.plates.upper is None or any(law.stage == "twisting" for law in choice.chain.laws):
        return []
    single = np.diff(state.start) == 1
    spinning = int(np.count_nonzero(state.B[single, body.SPIN + 2]))
    if not spinning or not any(pair.friction > 0.0 for pair in choice.pairs):
        return []
    return [
        f"{spinning} {'ball spins' if spinning == 1 else 'balls spin'} about the normal of the plates: at a single spot on each "
        "plate only pivoting friction brakes that, and it is off; effects.pivoting = {} switches it on"
    ]


def _clumps_that_fly(scene: Scene, choice: CompiledPhysics, state: State) -> list[str]:
    """Return a warning where clumps may land on several spheres at once, each with a dashpot of the pair's restitution.

    n equal contacts are one with n times the stiffness and the viscosity: sqrt(n) times the damping number.
    """
    largest, upper = int(np.diff(state.start).max()), scene.plates.upper
    free = upper is None or (upper.gap is not None and any(getattr(d, "placement", None) == "dilute" for d in scene.debris))
    restitution = min((pair.restitution for pair in choice.pairs), default=1.0)
    if not free or largest == 1 or restitution == 1.0 or HERTZ_DAMPING not in choice.chain.laws:
        return []
    alpha = damping_number(restitution)
    values = ", ".join(f"{restitution_of(math.sqrt(n) * alpha):.2g} on {n}" for n in sorted({2, min(largest, 3), largest}))
    return [
        f"restitution {restitution:g} is that of one contact: a clump in free flight that lands on several spheres at once "
        f"leaves with less, {values} (its largest number); pairs.restitution = {restitution_of(alpha / math.sqrt(2.0)):.2g} "
        f"gives {restitution:g} on 2"
    ]
