"""Reminders of effects that a scene does not name but would need."""

import numpy as np

from thirdbody.assembly.physics import CompiledPhysics
from thirdbody.engine.state import State
from thirdbody.kernels.columns import body
from thirdbody.scene.model import Scene


def effect_reminders(scene: Scene, choice: CompiledPhysics, state: State) -> list[str]:
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
