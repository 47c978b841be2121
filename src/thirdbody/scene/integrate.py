"""Which integrator a scene gets, and why."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..engine.explicit import Explicit
from ..engine.implicit import Accuracy, Implicit
from ..engine.state import State
from ..errors import InputError
from ..kernels import layout as at
from .choose import Choice
from .model import Scene
from .upper import Upper

Integrator = Explicit | Implicit


@dataclass(frozen=True)
class Plan:
    """The integrator of a scene, `explicit` or `implicit`, and the reason in words."""

    kind: str
    reason: str


def plan(scene: Scene, choice: Choice, state: State) -> Plan:
    """The integrator that the scene asks for, or, if it leaves the choice, the one that serves it. Raises InputError."""
    wanted = scene.solver.integrator
    if wanted == "explicit":
        return Plan("explicit", "the scene asks for it")
    obstacle = _obstacle(scene, choice, state)
    if wanted == "implicit":
        if obstacle:
            raise InputError(scene.fault(("solver", "integrator"), f"'implicit' cannot run this scene: {obstacle}"))
        return Plan("implicit", "the scene asks for it")
    if not obstacle and state.world.debris_meets:
        obstacle = "bodies may meet each other; contact.debris_contact = \"none\" would declare that they do not"
    if not obstacle and scene.solver.time_step != "auto":
        obstacle = "the scene gives a time step"
    return Plan("explicit", obstacle) if obstacle else Plan("implicit", "bodies meet only the plates")


def _obstacle(scene: Scene, choice: Choice, state: State) -> str:
    """Why the implicit integrator cannot run a scene, or nothing."""
    bare = [law.name for law in choice.chain.laws if law.tangent is None and law.stage in ("normal", "tangential", "rolling")]
    late = [effect.name for effect in choice.effects if effect.sees_forces]
    upper = state.world.upper
    if upper is None:
        return "no upper plate holds the bodies"
    if bare:
        return f"{', '.join(bare)} has no tangent"
    if late:
        return f"{', '.join(late)} acts on unbalanced forces, which an implicit step does not have"
    return ""


def implicit(scene: Scene, choice: Choice, state: State, upper: Upper) -> Implicit:
    """The implicit integrator of a scene, started."""
    tangents = choice.chain.tangents
    assert tangents is not None  # `plan`
    solver, chosen = scene.solver, Accuracy()
    if solver.tolerance is not None:
        chosen = replace(chosen, tolerance=solver.tolerance)
    if solver.largest_step is not None:
        chosen = replace(chosen, largest_step=solver.largest_step)
    if solver.inertia is not None:
        chosen = replace(chosen, inertia=solver.inertia)
    chosen = replace(chosen, go_on=solver.on_failure == "continue")
    smallest = float(np.min(state.S[:, at.S_R]))
    made = Implicit(state, list(choice.materials), tangents, upper.overlap * smallest, chosen)
    made.start()
    return made
