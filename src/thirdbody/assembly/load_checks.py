"""Checks of the loads: crushing loads are refused, deep contacts and yield give warnings."""

from dataclasses import dataclass

import numpy as np

from thirdbody.assembly.physics import CompiledPhysics
from thirdbody.engine.guards import OVERLAP_GUARD
from thirdbody.errors import InputError
from thirdbody.laws.contract import Material
from thirdbody.laws.hertz import YieldLimit, yield_limit
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
    location = _loading_key(scene)
    on = "each body" if n_sharing == 1 else f"all {n_sharing} bodies together"
    message = (
        f"adhesion alone presses contacts in by more than {OVERLAP_GUARD:g} of the radius, where the overlap guard stops a run, "
        "under any load; lower the work of adhesion, or take stiffer or larger bodies"
        if allowed <= 0.0
        else f"{pretty(load, 'force')} on {on} would press contacts in by more than {OVERLAP_GUARD:g} of the radius, where the "
        f"overlap guard stops a run; allowed: at most {pretty(allowed, 'force')} on {on}, or stiffer or larger bodies"
    )
    raise InputError(scene.fault(location, message))


def _loading_key(scene: Scene) -> tuple[str, ...]:
    """Return the key of the scene that gives the largest load."""
    plate = scene.plates.upper
    assert plate is not None
    key = next(key for key in ("load", "pressure", "gap") if getattr(plate, key) is not None)
    return ("plates", "upper", key)


def pressing_warnings(choice: CompiledPhysics, pressing: Pressing, overlap: np.ndarray) -> list[str]:
    """Return warnings of deep contacts, and of peak pressures above first yield by pair of materials; `overlap` (n,) [m]."""
    result, depth = [], overlap / pressing.radius
    deepest = int(np.argmax(depth))
    if depth[deepest] > MAX_HERTZ_OVERLAP:
        result.append(
            f"expected overlap {depth[deepest]:.2g} of the radius under {pretty(float(pressing.load[deepest]), 'force')}: Hertz' "
            f"theory is for small contacts (below {MAX_HERTZ_OVERLAP:g}), and a run stops at {OVERLAP_GUARD:g}; lower the "
            f"load or use stiffer "
            "bodies"
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
            result.append(_yield_warning(pair.a, pair.b, limit, float(pressure[worst]), float(allowed[0])))
    return result


def _yield_warning(a: Material, b: Material, limit: YieldLimit, pressure: float, allowed: float) -> str:
    ratio = pressure / limit.pressure
    where = limit_words(limit.material, limit.pressure, limit.strength, limit.assumed)
    return (
        f"{a.name}/{b.name}: expected peak pressure {pretty(pressure, 'pressure')}, {times(ratio)} {where}; contacts "
        f"are computed as elastic all the same; below it: at most {pretty(allowed, 'force')} on such a contact; "
        "[effects.elastic_plastic] lets them flow"
    )


def times(ratio: float) -> str:
    """Return the words for a ratio to what follows."""
    return "equal to" if f"{ratio:.2g}" == "1" else f"{ratio:.2g} times"


def limit_words(material: str, pressure: float, strength: float, assumed: bool) -> str:
    """Describe first yield of a material: its peak pressure [Pa], and the yield strength [Pa]."""
    source = f"assumed as E/100: materials.{material}.yield_strength is not given" if assumed else "given"
    shown = pretty(strength, "pressure")
    return f"first yield of {material} at {pretty(pressure, 'pressure')} (yield strength {shown}, {source})"
