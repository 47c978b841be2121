"""The rungs of a ladder of accuracy: contact law, springs, time step and integrator, one of them changed at a time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from thirdbody.laws.contract import LawFamily
from thirdbody.scene.model import Scene
from thirdbody.scene.tables import IMPLICIT_KEYS

SPRINGS = (8, 16, 32, 64, 128)
"""Springs of a level that has that option."""

FACTORS = {"explicit": (4.0, 2.0, 0.5, 0.25), "implicit": (16.0, 4.0, 0.25, 0.0625)}
"""Times the time step, or the tolerance of a step: the length of an implicit step goes as the root of that."""

AROUND = {"explicit": (1.0, 2.0, 0.5), "implicit": (1.0, 4.0, 0.25)}
"""The same for the integrator that the scene does not use; 1 leaves it to its default."""


@dataclass(frozen=True)
class Base:
    """What the scene itself says. `kind`: its integrator; `level`, `springs` (None without that option); `step`: the time step
    (s) of the explicit integrator at the start; `tolerance` of the implicit one."""

    kind: str
    level: str
    springs: int | None
    step: float
    tolerance: float


@dataclass(frozen=True)
class Rung:
    """One way to compute the scene. `changes`: keys of the scene and their new values, None to take the key out."""

    name: str
    axis: str
    level: str
    springs: int | None
    integrator: str
    factor: float = 1.0
    default: bool = False
    reference: bool = False
    changes: Mapping[str, Any] = field(default_factory=dict)


def ladder(scene: Scene, family: LawFamily, base: Base, verify: bool = False) -> list[Rung]:
    """About 16 rungs around a scene; the last one is the reference: the finest law, and steps as fine as the ladder has.

    The levels of a family go from the coarsest to the finest, as it lists them. `verify` adds all numbers of springs with these
    fine steps (axis `verify`): only there is what the springs neglect not hidden by the steps.
    """
    laws = [(level, springs) for level in family.levels for springs in _springs_of(family, level, base)]
    rungs = [
        Rung(_law_name(level, springs), "law", level, springs, base.kind, default=(level, springs) == (base.level, base.springs),
             changes=_law_changes(scene, level, springs))
        for level, springs in laws
    ]  # fmt: skip
    own = _law_name(base.level, base.springs)
    for factor in FACTORS[base.kind]:
        rungs.append(Rung(f"{own}, {_factor_name(base.kind, factor)}", "step", base.level, base.springs, base.kind, factor,
                          changes=_step_changes(base, base.kind, factor)))  # fmt: skip
    other = "implicit" if base.kind == "explicit" else "explicit"
    for factor in AROUND[other]:
        name = f"{own}, {other}" + ("" if factor == 1.0 else f", {_factor_name(other, factor)}")
        rungs.append(Rung(name, "integrator", base.level, base.springs, other, factor,
                          changes=_step_changes(base, other, factor)))  # fmt: skip
    level, springs = laws[-1]
    finest = min(FACTORS[base.kind])
    name = f"{_law_name(level, springs)}, {_factor_name(base.kind, finest)}"
    fine = _step_changes(base, base.kind, finest)
    if verify:
        rungs += [Rung(f"{_law_name(*law)}, {_factor_name(base.kind, finest)}", "verify", *law, base.kind, finest,
                       changes={**_law_changes(scene, *law), **fine}) for law in laws[:-1] if law[1] is not None]  # fmt: skip
    changes = {**_law_changes(scene, level, springs), **fine}
    return [*rungs, Rung(name, "reference", level, springs, base.kind, finest, reference=True, changes=changes)]


def springs_option(family: LawFamily, level: str) -> int | None:
    """The springs of a level when the scene does not tell them; None where it has no such option."""
    found = [option.default for law in family.levels[level] for option in law.options if option.name == "springs"]
    return int(found[0]) if found else None  # type: ignore[arg-type]


def _springs_of(family: LawFamily, level: str, base: Base) -> Sequence[int | None]:
    if springs_option(family, level) is None:
        return (None,)
    own = {base.springs} if level == base.level and base.springs else set()
    return sorted({*SPRINGS, *own})  # type: ignore[type-var]


def _law_name(level: str, springs: int | None) -> str:
    return level if springs is None else f"{level} {springs}"


def _factor_name(kind: str, factor: float) -> str:
    what = "step" if kind == "explicit" else "tolerance"
    return f"{what} x{factor:g}" if factor > 1.0 else f"{what} /{1.0 / factor:g}"


def _law_changes(scene: Scene, level: str, springs: int | None) -> dict[str, Any]:
    changes: dict[str, Any] = {"contact.level": level}
    if springs is not None:
        changes["contact.springs"] = springs
    elif "springs" in scene.contact.options:
        changes["contact.springs"] = None
    return changes


def _step_changes(base: Base, kind: str, factor: float) -> dict[str, Any]:
    """The integrator, with its step or tolerance times a factor; keys of the other one are taken out."""
    if kind == "implicit":
        finer = {} if factor == 1.0 else {"solver.tolerance": factor * base.tolerance}
        return {"solver.integrator": kind, "solver.time_step": "auto", **finer}
    step = "auto" if factor == 1.0 else f"{factor * base.step!r} s"
    return {"solver.integrator": kind, "solver.time_step": step, **{f"solver.{key}": None for key in IMPLICIT_KEYS}}
