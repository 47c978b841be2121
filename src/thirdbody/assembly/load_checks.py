"""Checks of the loads: crushing loads are refused, deep contacts and yield give warnings.

Reminders of effects that a scene does not name but would need, and of what its restitution means for clumps.
"""

import math
from dataclasses import dataclass

import numpy as np

from thirdbody.assembly.physics import CompiledPhysics
from thirdbody.engine.guards import OVERLAP_GUARD
from thirdbody.engine.state import State
from thirdbody.errors import InputError
from thirdbody.kernels.tables import body
from thirdbody.laws.damping import HERTZ_DAMPING, damping_number, restitution_of
from thirdbody.laws.hertz import yield_limit
from thirdbody.scene.model import Scene
from thirdbody.statics.contacts import load_at, overlap_at, response
from thirdbody.units import pretty

MAX_HERTZ_OVERLAP = 0.1
"""Overlap over sphere radius above which Hertz' theory is only approximate: the contact radius is 0.3 of the radius."""


@dataclass(frozen=True)
class Pressing:
    """Contacts under the largest load of a run, (n,): load [N], sphere radius [m], row of the pair."""

    load: np.ndarray
    radius: np.ndarray
    kind: np.ndarray

    def overlap(self, choice: CompiledPhysics) -> np.ndarray:
        """Return the overlap (n,) [m], at most the radius."""
        return overlap_at(choice.physics, self.load, self.radius, self.kind)

    def max_load(self, choice: CompiledPhysics) -> np.ndarray:
        """Return the load (n,) [N] at which the overlap reaches its limit."""
        return response(choice.physics, OVERLAP_GUARD * self.radius, self.radius, self.kind).force


def refuse_crushing(scene: Scene, choice: CompiledPhysics, pressing: Pressing, load: float, n_sharing: int = 1) -> None:
    """Raise InputError if even the strongest of these contacts would exceed the guard's overlap.

    `load` [N] is the value in the scene; `n_sharing` bodies carry it together at best.
    """
    allowed = float(pressing.max_load(choice).min()) if n_sharing == 1 else float(pressing.max_load(choice).mean()) * n_sharing
    if load <= allowed:
        return
    plate = scene.plates.upper
    assert plate is not None
    key = next(key for key in ("load", "pressure", "gap") if getattr(plate, key) is not None)  # that gives the largest load
    on = "each body" if n_sharing == 1 else f"all {n_sharing} bodies together"
    message = (
        f"adhesion alone presses contacts in by more than {OVERLAP_GUARD:g} of the radius, where the overlap guard stops a run, "
        "under any load; lower the work of adhesion, or take stiffer or larger bodies"
        if allowed <= 0.0
        else f"{pretty(load, 'force')} on {on} would press contacts in by more than {OVERLAP_GUARD:g} of the radius, where the "
        f"overlap guard stops a run; allowed: at most {pretty(allowed, 'force')} on {on}, or stiffer or larger bodies"
    )
    raise InputError(scene.fault(("plates", "upper", key), message))


def pressing_warnings(choice: CompiledPhysics, pressing: Pressing, overlap: np.ndarray) -> list[str]:
    """Return warnings of deep contacts, and of peak pressures above first yield by pair of materials; `overlap` (n,) [m]."""
    result, depth = [], overlap / pressing.radius
    deepest = int(np.argmax(depth))
    if depth[deepest] > MAX_HERTZ_OVERLAP:
        result.append(
            f"expected overlap {depth[deepest]:.2g} of the radius under {pretty(float(pressing.load[deepest]), 'force')}: Hertz' "
            f"theory is for small contacts (below {MAX_HERTZ_OVERLAP:g}), and a run stops at {OVERLAP_GUARD:g}; lower the load "
            "or use stiffer bodies"
        )
    if choice.physics.loss == "plastic":
        return result
    pressure = response(choice.physics, overlap, pressing.radius, pressing.kind).pressure
    for k, pair in enumerate(choice.pairs):
        here = np.flatnonzero(pressing.kind == k)
        if not len(here):
            continue
        worst = here[np.argmax(pressure[here])]
        limit = yield_limit(pair.a, pair.b)
        if pressure[worst] > limit.pressure:
            one = np.array([worst])
            allowed = load_at(choice.physics, np.array([limit.pressure]), pressing.radius[one], pressing.kind[one])
            where = limit_words(limit.material, limit.pressure, limit.strength, limit.assumed)
            result.append(
                f"{pair.a.name}/{pair.b.name}: expected peak pressure {pretty(float(pressure[worst]), 'pressure')}, "
                f"{times(float(pressure[worst]) / limit.pressure)} {where}; contacts are computed as elastic all the same; below "
                f"it: at most {pretty(float(allowed[0]), 'force')} on such a contact; [effects.elastic_plastic] lets them flow"
            )
    return result


def times(ratio: float) -> str:
    """Return the words for a ratio to what follows."""
    return "equal to" if f"{ratio:.2g}" == "1" else f"{ratio:.2g} times"


def limit_words(material: str, pressure: float, strength: float, assumed: bool) -> str:
    """Describe first yield of a material: its peak pressure [Pa], and the yield strength [Pa]."""
    source = f"assumed as E/100: materials.{material}.yield_strength is not given" if assumed else "given"
    shown = pretty(strength, "pressure")
    return f"first yield of {material} at {pretty(pressure, 'pressure')} (yield strength {shown}, {source})"


def spinning_balls(scene: Scene, choice: CompiledPhysics, state: State) -> list[str]:
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


def clumps_that_fly(scene: Scene, choice: CompiledPhysics, state: State) -> list[str]:
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
