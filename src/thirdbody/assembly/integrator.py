"""Choice of the integrator of a scene, with the reason."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from thirdbody.assembly.physics import CompiledPhysics
from thirdbody.assembly.upper_plate import Upper
from thirdbody.engine.state import State
from thirdbody.engine.upper_plate import ends_of
from thirdbody.errors import InputError
from thirdbody.scene.model import Scene
from thirdbody.scene.tables import IMPLICIT_KEYS

if TYPE_CHECKING:
    from thirdbody.engine.implicit import Implicit

LARGEST_FRICTION = 1e4
"""Largest friction coefficient in the implicit integrator; larger ones are reduced to it.

Newton's method solves for forces to 1e-9 of the forces that act, and the friction limit of a contact that its dashpot is about to
open is the normal force times this coefficient: above 1e6 the error of the load makes that limit jump by the whole tangential
force, and steps shrink without end. A contact that slips because of this bound carries less than 1e-4 of its tangential force as
load."""


@dataclass(frozen=True)
class Plan:
    """Integrator of a scene, `explicit` or `implicit`, and the reason in words."""

    kind: str
    reason: str


def plan(scene: Scene, choice: CompiledPhysics, state: State) -> Plan:
    """Return the integrator that the scene asks for or, by default, the one that suits it. Raises InputError."""
    wanted = scene.solver.integrator
    if wanted == "explicit":
        return Plan("explicit", "required by the scene")
    _refuse_leaving_behind(scene, state)
    _refuse_unloading(scene, state)
    obstacle = _obstacle(scene, choice, state)
    if wanted == "implicit":
        if obstacle:
            raise InputError(scene.fault(("solver", "integrator"), f"'implicit' cannot run this scene: {obstacle}"))
        return Plan("implicit", "required by the scene")
    if not obstacle and state.world.debris_meets:
        obstacle = (
            'bodies may meet each other; contact.debris_contact = "none" would declare that they do not, '
            'solver.integrator = "implicit" solves those that meet together, which suits slow sliding'
        )
    if not obstacle and scene.solver.time_step != "auto":
        obstacle = "the scene gives a time step"
    if not obstacle:
        return Plan("implicit", "bodies meet only the plates")
    given = [key for key in IMPLICIT_KEYS if getattr(scene.solver, key) is not None]
    if given:
        message = f"is for the implicit integrator, and this scene needs the explicit one: {obstacle}"
        raise InputError([scene.fault(("solver", key), message) for key in given])
    return Plan("explicit", obstacle)


def _refuse_leaving_behind(scene: Scene, state: State) -> None:
    """Raise InputError for `on_failure = "continue"` where all bodies carry one plate together."""
    if scene.solver.on_failure == "continue" and carried_together(state):
        message = "'continue' leaves a body behind, but here all bodies carry one plate together"
        raise InputError(scene.fault(("solver", "on_failure"), message))


def _refuse_unloading(scene: Scene, state: State) -> None:
    """Raise InputError where nothing would hold the bodies: no load and no inertia."""
    upper = state.world.upper
    loads = () if upper is None else upper.schedule.load
    minimum = min((min(piece.value(piece.start), piece.value(end)) for piece, end in ends_of(loads)), default=1.0)
    if scene.solver.inertia is False and minimum <= 0.0:
        message = "false needs a load at all times: without load and inertia the position of a body is undetermined"
        raise InputError(scene.fault(("solver", "inertia"), message))


def _obstacle(scene: Scene, choice: CompiledPhysics, state: State) -> str:
    """Return why the implicit integrator cannot run a scene, or an empty text."""
    bare = choice.chain.without_tangent
    late = [effect.name for effect in choice.effects if effect.sees_forces]
    upper = state.world.upper
    if upper is None:
        return "no upper plate holds the bodies"
    if choice.chain.reaching:
        return f"{', '.join(choice.chain.reaching)} acts before bodies touch, which an implicit step does not have"
    if bare:
        return f"{', '.join(bare)} has no tangent"
    if late:
        return f"{', '.join(late)} acts on unbalanced forces, which an implicit step does not have"
    return ""


def implicit(scene: Scene, choice: CompiledPhysics, state: State, upper: Upper, warnings: list[str]) -> Implicit:
    """Return the implicit integrator of a scene, started; appends to `warnings`."""
    tangents = choice.chain.tangents
    assert tangents is not None  # checked by `plan`
    # imported here: an explicit run then compiles none of it
    from thirdbody.engine.implicit import Accuracy

    if any(pair.friction > LARGEST_FRICTION for pair in choice.pairs):
        choice.limit_friction(LARGEST_FRICTION)
        maximum = f"{LARGEST_FRICTION:g}"
        warnings.append(f"friction coefficients above {maximum} count as {maximum} in the implicit integrator")
    solver = scene.solver
    given = {"tolerance": solver.tolerance, "largest_step": solver.largest_step, "inertia": solver.inertia}
    options: dict[str, Any] = {key: value for key, value in given.items() if value is not None}
    chosen = Accuracy(**options, skip_unsolved=solver.on_failure == "continue")
    smallest = float(np.min(state.spheres.radius))
    built = _kind(state)(state, list(choice.materials), tangents, upper.overlap * smallest, chosen)
    built.start()
    return built


def _kind(state: State) -> type[Implicit]:
    if state.world.debris_meets:
        if carried_together(state):
            from thirdbody.engine.implicit_common_plate_islands import ImplicitCommonPlateIslands

            return ImplicitCommonPlateIslands
        from thirdbody.engine.implicit_islands import ImplicitIslands

        return ImplicitIslands
    if carried_together(state):
        from thirdbody.engine.implicit_common_plate import ImplicitCommonPlate

        return ImplicitCommonPlate
    from thirdbody.engine.implicit import Implicit

    return Implicit


def carried_together(state: State) -> bool:
    """Return whether all bodies carry one free plate: a rigid one under a load, or that of a foundation."""
    upper = state.world.upper
    if upper is None:
        return False
    if upper.foundation is not None:
        return upper.foundation.free
    return upper.free and len(upper.heights) == 1 and (state.n_bodies > 1 or upper.direct is not None)
