"""Choice of the integrator of a scene, with the reason; whether inertia is negligible."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from thirdbody import units
from thirdbody.assembly.physics import CompiledPhysics
from thirdbody.assembly.schedule import smallest_load
from thirdbody.assembly.upper_plate import Upper
from thirdbody.engine.accuracy import Accuracy
from thirdbody.engine.islands import LARGEST, ExpectedIslands, expected_islands
from thirdbody.engine.state import RAYLEIGH_FRACTION, STABILITY_FRACTION, State, rayleigh_times
from thirdbody.engine.units import EXPLICIT
from thirdbody.engine.upper_plate import PatchedPlate, Schedule
from thirdbody.errors import InputError
from thirdbody.kernels import schedule as motion
from thirdbody.scene.model import Scene
from thirdbody.scene.tables import IMPLICIT_KEYS
from thirdbody.statics.contacts import overlap_at, response

if TYPE_CHECKING:
    from thirdbody.engine.implicit import Implicit

SLOW, FAST = 0.03, 0.3
"""Inertial number above which a quasi-static run gets a warning, and above which it is refused. Inertial forces are of the order
of its square times the load: 1e-3 and 0.1 of the load."""


LARGEST_FRICTION = 1e4
"""Largest friction coefficient in the implicit integrator; larger ones are reduced to it.

Newton's method solves for forces to 1e-9 of the forces that act, and the friction limit of a contact that its dashpot is about to
open is the normal force times this coefficient: above 1e6 the error of the load makes that limit jump by the whole tangential
force, and steps shrink without end. A contact that slips because of this bound carries less than 1e-4 of its tangential force as
load."""

STEP = 20.0
"""Processor time of an implicit step of a body over that of an explicit one, the only rate that the choice rests on.

With clumps of the main scene: 19 by the rates of an idle Zen 5 core, 12 measured on a loaded EPYC."""

FASTER = 2.0
"""Factor by which the implicit integrator is expected to be faster where debris meets, for `auto` to take it.

The expected ratio is right to a factor of about 2, so less could be no gain; and where both take about as long, a small change of
a scene does not change its integrator.
"""

FEW = 2e7
"""Explicit steps of single bodies below which `auto` takes the explicit integrator where debris meets: some seconds, by which the
implicit one takes longer to compile at the first start."""

EXPLICIT_STEP = 0.9 * RAYLEIGH_FRACTION
"""Mean explicit time step over the shortest Rayleigh time of a body: contacts shorten it."""

PRESSED = 27.0
"""Bound of the largest eigenvalue of a body that its load presses between the plates, times its mass, over the stiffness of one
contact. Where contacts limit the step, not Rayleigh waves, its bound gives 21 to 37 for balls and clumps."""

PRESSING, PER_DIAMETER, PER_REVERSAL, BALL = 250.0, 200.0, 30.0, 0.25
"""Implicit steps of a clump: while it settles and first slides, per diameter of drag, per reversal of a stroke. Fraction of them
that a single sphere takes: it does not tip."""

INERTIAL_STEPS, INERTIAL = 4.5, 5.0
"""Implicit steps in a Rayleigh time of the mean body where inertia rules, as in impacts; the inertial number of a body above
which it does. Below, the number of such steps falls with its power 3/2."""

USUAL_TOLERANCE = 5e-4
"""Tolerance of a step for which the numbers of steps hold; they grow with the inverse of its cube root."""

DENSE = 0.6
"""Fraction of the area, covered by the bodies as balls of their volumes, above which `auto` takes the explicit integrator: steps
of both were not compared there."""

IMPACTS = 0.2
"""Inertial number of a body (`inertial_number`) above which `auto` takes the explicit integrator: there impacts tell
when a body rolls or slides. At 0.1 both integrators give the same label for 98.5 % of 2000 bodies that meet, at 0.3 to 1 for 95
to 97 % of 150, with shares of the labels that agree to 0.5 %, friction to 0.02 % and places to 0.1 % of the drag."""


class Inertial(NamedTuple):
    """Largest inertial number, index of its body in the tables, largest sliding speed [m/s]."""

    number: float
    body: int
    speed: float


def inertial_number(state: State) -> Inertial | None:
    """Compute I = v sqrt((m + M)/(W L)), the largest of all bodies.

    It is the time in which the load moves a body by its size, over the time in which the drag covers that distance. v: largest
    speed of the drag; m, M: masses of body and patch; W: smallest load on the body; L: its diameter, or the stroke if that is
    shorter. None where no load is prescribed. Source: inertial number of GDR MiDi, Eur. Phys. J. E 14, 2004, 341, with the shear
    rate v/L and the pressure W/L^2.
    """
    upper = state.world.upper
    if upper is None:
        return None
    # mass moving with each body [kg], and the smallest load on it [N]: of its patch, or an equal part of the plate's
    n, smallest, mass, founded = state.n_bodies, smallest_load(upper.schedule), state.bodies.mass, upper.foundation
    if founded is not None:
        mass, load = mass + upper.mass + founded.mass / n, np.full(n, smallest * founded.load / n)
    elif len(upper.heights) == n:
        mass, load = mass + upper.mass[upper.patch], smallest * upper.load[upper.patch]
        if upper.zone is not None:  # the mean of those inside: the load of a body near the edge is as small as one likes
            load = np.full(n, load[load > 0.0].mean())
    else:
        mass, load = mass + float(upper.mass.sum()) / n, np.full(n, smallest * float(upper.load.sum()) / n)
    if not (load > 0.0).all():
        return None
    # of each body: twice the distance of its farthest surface point from its centre of mass
    centre = np.repeat(state.bodies.position, np.diff(state.start), axis=0)
    distance = np.linalg.norm(state.spheres.position - centre, axis=1) + state.spheres.radius
    length = np.minimum(2.0 * np.maximum.reduceat(distance, state.start[:-1]), shortest_stroke(upper.schedule))
    speed = upper.schedule.top_speed()
    numbers = speed * np.sqrt(mass / (load * length))
    body = int(np.argmax(numbers))
    return Inertial(float(numbers[body]), body, speed)


def examine_inertia(scene: Scene, state: State) -> list[str]:
    """Return warnings of a quasi-static scene that is too fast. Raises InputError where inertia is as large as the load."""
    result = inertial_number(state) if scene.solver.inertia is False else None
    if result is None or result.number <= SLOW:
        return []
    number = f"the inertial number v sqrt((m + M)/(W L)) of body {state.order[result.body]} is {result.number:.2g}"
    allowed = lambda limit: units.pretty(result.speed * limit / result.number, "velocity")  # noqa: E731
    if result.number > FAST:
        message = (
            f"false is for slow motion, and {number} (at most {FAST:g}: {allowed(FAST)} here): inertial forces are not small "
            "compared with the load; leave solver.inertia out, or lower the speed"
        )
        raise InputError(scene.fault(("solver", "inertia"), message))
    return [
        f"solver.inertia = false: {number} (quasi-static: below {SLOW:g}, {allowed(SLOW)} here): friction and labels may differ "
        "from those with inertia; leave solver.inertia out, or lower the speed"
    ]


def shortest_stroke(schedule: Schedule) -> float:
    """Return the shortest stroke, peak to peak [m]; infinite without strokes."""
    return min((abs(s.b) for s in (*schedule.x, *schedule.y) if s.kind != motion.POLYNOMIAL), default=np.inf)


class Steps(NamedTuple):
    """Expected steps of a run with both integrators, those of all bodies added up."""

    explicit: float
    implicit: float

    @property
    def gain(self) -> float:
        """Time of the explicit integrator over that of the implicit one."""
        return self.explicit / (STEP * self.implicit)


@dataclass(frozen=True)
class Plan:
    """Integrator of a scene, `explicit` or `implicit`, and the reason in words.

    `islands`: expected of a layer whose bodies have loads of their own or carry one plate together; `steps`: of the former only.
    `estimated`: whether the steps decided.
    """

    kind: str
    reason: str
    islands: ExpectedIslands | None = None
    steps: Steps | None = None
    estimated: bool = False

    @property
    def matters(self) -> bool:
        """Whether the steps decided, and are so many that a user notices."""
        return self.estimated and self.steps is not None and self.steps.explicit >= FEW


def plan(scene: Scene, choice: CompiledPhysics, state: State, upper: Upper, before: str = "") -> Plan:
    """Return the integrator that the scene asks for or, by default, the one that suits it. Raises InputError.

    `before`: the integrator with which a run began, which goes on with it.
    """
    wanted, obstacle = scene.solver.integrator, _obstacle(scene, choice, state)
    if wanted != "explicit" and scene.solver.on_failure == "continue" and (carried_together(state) or state.sprung):
        does = "pull" if state.sprung else "carry"
        message = f"'continue' leaves a body behind, but here all bodies {does} one plate together"
        raise InputError(scene.fault(("solver", "on_failure"), message))
    if wanted != "explicit" and scene.solver.inertia is False and smallest_load(state.world.schedule) <= 0.0:
        message = "false needs a load at all times: without load and inertia the position of a body is undetermined"
        raise InputError(scene.fault(("solver", "inertia"), message))
    if wanted == "implicit" and obstacle:
        raise InputError(scene.fault(("solver", "integrator"), f"'implicit' cannot run this scene: {obstacle}"))
    together, plate = carried_together(state), state.world.upper
    own = plate is not None and plate.foundation is None and plate.free and len(plate.heights) == state.n_bodies
    if obstacle or not (together or own):  # a layer of bodies with loads and patches of their own moves as in slow sliding
        chosen = Plan("explicit", obstacle)
    else:
        islands = expected_islands(state)
        chosen = Plan("implicit", "", islands, None if together else expected_steps(scene, choice, state, upper, islands))
    if wanted != "auto":
        return replace(chosen, kind=wanted, reason="required by the scene")
    chosen = _automatic(scene, state, chosen, obstacle)
    if before and before != chosen.kind and not (obstacle and before == "implicit"):
        chosen = replace(chosen, kind=before, reason="the run began with it", estimated=False)
    given = [key for key in IMPLICIT_KEYS if getattr(scene.solver, key) is not None]
    if chosen.kind == "explicit" and given:
        message = f"is for the implicit integrator, and this scene needs the explicit one: {chosen.reason}"
        raise InputError([scene.fault(("solver", key), message) for key in given])
    return chosen


def _automatic(scene: Scene, state: State, expected: Plan, obstacle: str) -> Plan:
    if not obstacle and scene.solver.time_step != "auto":
        obstacle = "the scene gives a time step"
    if not obstacle and not state.world.debris_meets:
        return replace(expected, kind="implicit", reason="bodies meet only the plates")
    obstacle = obstacle or _obstacle_of_meeting(scene, state, expected)
    if obstacle:
        return replace(expected, kind="explicit", reason=obstacle)
    if given := [f"solver.{key}" for key in IMPLICIT_KEYS if getattr(scene.solver, key) is not None]:
        return replace(expected, kind="implicit", reason=f"the scene gives {', '.join(given)}")
    steps = expected.steps
    assert steps is not None  # every body has a load of its own
    if steps.gain >= FASTER and steps.explicit < FEW:
        text = f"bodies may meet each other, and its steps are few: {steps.explicit:.1g}, those of all bodies added up"
        return replace(expected, kind="explicit", reason=text, estimated=True)
    if steps.gain >= FASTER:
        text = f"few bodies meet at a time, and it is expected to be {_number(steps.gain)} times as fast as the explicit one"
        return replace(expected, kind="implicit", reason=text, estimated=True)
    longer = f"{_number(1.0 / steps.gain)} times as long" if steps.gain < 1.0 / FASTER else "about as long"
    text = f"bodies may meet each other, and the implicit one is expected to take {longer}"
    return replace(expected, kind="explicit", reason=text, estimated=True)


def expected_steps(scene: Scene, choice: CompiledPhysics, state: State, upper: Upper, islands: ExpectedIslands) -> Steps:
    """Return the expected steps of a layer whose bodies have loads and patches of their own.

    A body of an island takes the steps of the most restless one and has its equations besides, so an implicit step counts as many
    times as its island has bodies; an output, or a search for islands, counts as a step.
    """
    assert upper.plate is not None  # of the patches
    schedule, solver, diameter = upper.plate.schedule, scene.solver, 2.0 * float(state.rayleigh_radius.mean())
    if solver.duration is not None:
        sliding, path = solver.duration, schedule.path(upper.settle, upper.settle + solver.duration)
    else:
        path = solver.distance or 0.0
        sliding = schedule.time_of(path, upper.settle) - upper.settle
    rayleigh = rayleigh_times(state, list(choice.materials))
    explicit = (upper.settle + sliding) / min(EXPLICIT_STEP * float(rayleigh.min()), _pressed_step(choice, state, upper.plate))
    implicit = PRESSING + path * (PER_DIAMETER / diameter + PER_REVERSAL / shortest_stroke(schedule))
    implicit *= BALL + (1.0 - BALL) * float(np.mean(np.diff(state.start) > 1))
    if solver.largest_step is not None:
        implicit = max(implicit, path / solver.largest_step)
    inertial = None if solver.inertia is False else inertial_number(state)
    if inertial is not None and np.isfinite(sliding):
        implicit += min(1.0, (inertial.number / INERTIAL) ** 1.5) * INERTIAL_STEPS * sliding / float(rayleigh.mean())
    implicit *= (USUAL_TOLERANCE / (solver.tolerance or USUAL_TOLERANCE)) ** (1.0 / 3.0)
    implicit += (sliding if scene.output.every_kind == "time" else path) / scene.output.every + path / islands.stride
    return Steps(state.n_bodies * explicit, state.n_bodies * islands.mean * implicit)


def _pressed_step(choice: CompiledPhysics, state: State, plate: PatchedPlate) -> float:
    """Return the longest explicit step [s] of the bodies with the stiffest contacts for their mass, one of each material."""
    radius, mass = np.minimum.reduceat(state.spheres.radius, state.start[:-1]), state.bodies.mass
    members = [np.flatnonzero(state.material == material) for material in np.unique(state.material)]
    # Hertz: the stiffness goes with the third root of radius and load
    who = np.array([rows[np.argmin((mass / np.cbrt(radius))[rows])] for rows in members])
    kind, load = choice.physics.kinds[state.material[who], plate.material], plate.load[plate.patch[who]]
    load = load if plate.zone is None else np.full(len(who), plate.load.max())
    overlap = overlap_at(choice.physics, load, radius[who], kind)
    stiffness = response(choice.physics, overlap, radius[who], kind).stiffness
    return float(np.min(2.0 * STABILITY_FRACTION * np.sqrt(mass[who] / np.maximum(PRESSED * stiffness, 1e-300))))


def _number(value: float) -> str:
    return f"{float(f'{value:.2g}'):.0f}" if value >= 10.0 else f"{value:.1g}"


def _obstacle_of_meeting(scene: Scene, state: State, expected: Plan) -> str:
    """Return why `auto` does not take the implicit integrator for bodies that may meet, or an empty text."""
    if scene.solver.inertial_number is not None:
        return "solver.inertial_number is for beds"
    if any(plate is not None and plate.surface is not None for plate in (scene.plates.lower, scene.plates.upper)):
        return "bodies may meet each other, and the steps of the implicit one are estimated for flat plates only"
    declare = 'contact.debris_contact = "none" would declare that they do not'
    if carried_together(state):
        return (
            f"bodies that carry one plate together may meet each other; {declare}, "
            'solver.integrator = "implicit" solves those that meet together, which suits slow sliding'
        )
    islands = expected.islands
    if islands is None:
        return f"bodies without loads of their own may meet each other; {declare}"
    if islands.area_fraction > DENSE or islands.largest > LARGEST:
        return (
            f"bodies cover {islands.area_fraction:.2f} of the area, and about {islands.largest} of them could meet at once: more "
            f"than {DENSE:g} and {LARGEST} do not pay with the implicit one"
        )
    inertial = inertial_number(state)
    if inertial is None or inertial.number > IMPACTS:
        number = "the load falls to zero" if inertial is None else f"their inertial number is up to {inertial.number:.2g}"
        return f"bodies may meet each other, and {number}: it resolves impacts (above {IMPACTS:g})"
    return ""


def _obstacle(scene: Scene, choice: CompiledPhysics, state: State) -> str:
    late = [effect.name for effect in choice.effects if effect.sees_forces]
    if state.world.upper is None:
        return "no upper plate holds the bodies"
    if state.world.walls:
        return "it has no side walls"
    if choice.chain.reaching and (state.lower_surface.size or state.upper_surface.size):
        return f"{', '.join(choice.chain.reaching)} acts beyond touch, which an implicit step on rough plates does not have"
    if bare := choice.chain.without_tangent:
        return f"{', '.join(bare)} has no tangent"
    return f"{', '.join(late)} acts on unbalanced forces, which an implicit step does not have" if late else ""


def implicit(scene: Scene, choice: CompiledPhysics, state: State, upper: Upper, warnings: list[str]) -> Implicit:
    """Return the implicit integrator of a scene, started; appends to `warnings`."""
    tangents = choice.chain.tangents
    assert tangents is not None  # checked by `plan`
    choice.set_parameters("implicit", LARGEST_FRICTION)
    if any(pair.friction > LARGEST_FRICTION for pair in choice.pairs):
        maximum = f"{LARGEST_FRICTION:g}"
        warnings.append(f"friction coefficients above {maximum} count as {maximum} in the implicit integrator")
    keys = [key for key in ("tolerance", "largest_step", "inertia") if getattr(scene.solver, key) is not None]
    options: dict[str, Any] = {key: getattr(scene.solver, key) for key in keys}
    chosen = Accuracy(**options, skip_unsolved=scene.solver.on_failure == "continue")
    smallest = float(np.min(state.spheres.radius))
    from thirdbody.engine.implicit import Implicit
    from thirdbody.engine.implicit_ensemble import ImplicitEnsemble, is_ensemble

    together = carried_together(state)
    kind = ImplicitEnsemble if is_ensemble(state) and not (together or state.sprung) else Implicit
    built = kind(state, list(choice.materials), tangents, upper.overlap * smallest, chosen, together=together)
    built.start()
    return built


def units_of(chosen: Plan, state: State) -> tuple[str, ...]:
    """Return the names of the units of compiled code that a run needs (`engine.units`), the longest first."""
    if chosen.kind == "explicit":
        return EXPLICIT
    from thirdbody.engine.implicit_ensemble import is_ensemble

    together = carried_together(state) or state.sprung
    parts = {
        "ensemble": is_ensemble(state) and not together, "pairs": state.world.debris_meets,
        "rough": state.world.rough, "spots": len(state.physics.interaction) > 0,
    }  # fmt: skip
    own = "common_plate" if together else "driver"
    return own, *(name for name, needed in parts.items() if needed), "search", "books", "labels"


def carried_together(state: State) -> bool:
    """Return whether all bodies carry one free plate: a rigid one under a load, or that of a foundation."""
    upper = state.world.upper
    if upper is None:
        return False
    if upper.foundation is not None:
        return upper.foundation.free
    return upper.free and len(upper.heights) == 1 and (state.n_bodies > 1 or upper.direct is not None)
