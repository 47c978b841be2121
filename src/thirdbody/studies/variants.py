"""Variants of a scene for a study of accuracy: contact law, springs, time step and integrator, one changed at a time."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from thirdbody.errors import InputError
from thirdbody.laws.contract import LawFamily
from thirdbody.scene.model import Scene
from thirdbody.scene.speed import at_speed
from thirdbody.scene.tables import IMPLICIT_KEYS
from thirdbody.studies.timing import NUDGE

Law = tuple[str, int | None]  # level and its springs
Code = tuple[str, str]  # settings of the contact in words, and the integrator: variants with the same have the same compiled laws
SPRINGS = (8, 16, 32, 64, 128)  # springs of a level that has that option
# Factors on the time step, or on the tolerance of a step: the length of an implicit step goes as its square root.
FACTORS = {"explicit": (4.0, 2.0, 0.5, 0.25), "implicit": (16.0, 4.0, 0.25, 0.0625)}
# The same with the finest law, between its own step and that of the reference: there only the step has an error.
FINE = {"explicit": (2.0, 0.5), "implicit": (4.0, 0.25)}
FINEST = {"explicit": 0.25, "implicit": 1.0 / 64.0}  # the same of the reference
# Factors on the speed of the upper plate of a bed; the slower one tells what the scene's own speed costs in accuracy.
SPEEDS = (9.0, 3.0, 1.0 / 3.0)
# Number of runs of the scene's own variant from displaced starts: with the run itself three pairs tell how far runs part.
NUDGED = 2
UNTIMED = ("reference", "nudged")  # axes of the variants that are only run, for errors
# The same for the integrator that the scene does not use; 1 leaves it to its default.
AROUND = {"explicit": (1.0, 2.0, 0.5), "implicit": (1.0, 4.0, 0.25)}

CURVES = {"nodes": 96}
"""Options of the finest law that resolve slip on curved paths, for the variants with the reference's law.

The error of `exact` falls with the square of its nodes, from 2e-4 of mu N for 48 to 5e-5, which 128 springs have too; more would
be too costly.
"""


@dataclass(frozen=True)
class Base:
    """Settings of the scene itself.

    `kind`: its integrator; `level`, `springs` (None without that option); `step`: the time step of the explicit integrator [s],
    the smallest automatic one (NaN where only the implicit one is compiled); `tolerance` of the implicit one; `meets`: bodies
    have contact with each other; `sheared_bed`: the same in the explicit integrator, under a plate that moves.
    """

    kind: str
    level: str
    springs: int | None
    step: float
    tolerance: float
    sheared_bed: bool = False
    meets: bool = False


@dataclass(frozen=True)
class Variant:
    """Variant of the scene. `changes`: keys of the scene and their new values, None to remove the key.

    `factor`: on the step or the tolerance; `speed`: on the speed of the upper plate; `nudge`: number of the displacement of its
    bodies at the start (`nudge`), 0 for none.
    """

    name: str
    axis: str
    level: str
    springs: int | None
    integrator: str
    factor: float = 1.0
    default: bool = False
    reference: bool = False
    changes: Mapping[str, Any] = field(default_factory=dict)
    speed: float = 1.0
    nudge: int = 0

    @property
    def law(self) -> Law:
        """Level and springs."""
        return self.level, self.springs

    @property
    def code(self) -> Code:
        """What decides on its compiled laws."""
        return code_of(self.changes, self.integrator)

    def step(self, base: Base) -> float:
        """Return its time step [s], or its tolerance."""
        return self.factor * (base.step if self.integrator == "explicit" else base.tolerance)


def code_of(changes: Mapping[str, Any], integrator: str) -> Code:
    """Return what decides on the compiled laws of a scene with these changes."""
    contact = {key: value for key, value in changes.items() if key.startswith("contact.") and key != "contact.debris_contact"}
    return repr(sorted(contact.items())), integrator


@dataclass
class Costs:
    """Measured seconds of one core of runs of a copy with its own step; `other`: expected with the other integrator.

    `laws`: by law and integrator.
    """

    base: Base
    own: float
    finest: Law
    other: float
    laws: dict[tuple[Law, str], float]

    def key(self, variant: Variant) -> tuple[Law, str]:
        """Return what decides on the time of a step."""
        return variant.law, variant.integrator

    def of(self, variant: Variant) -> float:
        """Return the expected seconds of a variant: proportional to the number of steps, measured for its law or estimated."""
        seconds = self.other
        if variant.integrator == self.base.kind:
            seconds = self.own * self._usual(variant.law) / self._usual((self.base.level, self.base.springs))
        seconds = self.laws.get(self.key(variant), seconds)
        seconds /= min(variant.speed, 1.0)  # a faster plate saves nothing while the debris settles
        return seconds / (variant.factor if variant.integrator == "explicit" else variant.factor**0.5)

    def _usual(self, law: Law) -> float:
        """Return the usual time of a law over that of one without springs."""
        return 1.0 + law[1] / 8.0 if law[1] is not None else 15.0 if law == self.finest else 1.0

    def learn(self, variant: Variant, seconds: float) -> None:
        """Use the measured seconds of a variant."""
        if variant.factor == variant.speed == 1.0 and variant.axis in ("law", "integrator"):
            self.laws[self.key(variant)] = seconds


def variants_of(scene: Scene, family: LawFamily, base: Base) -> list[Variant]:
    """Return some 18 variants of a scene; the last one is the reference: the finest law and the finest steps.

    Beds are sheared at other speeds too, over the same distances and with the scene's own law and step. Where bodies meet, the
    scene is also run with its own settings from displaced starts (axis `nudged`), and without contact between bodies.

    The levels of a family go from the coarsest to the finest, in its own order. Explicit variants have a fixed time step, since
    an automatic one depends on the contacts: laws would differ by their steps too, and a body that rocks into position while it
    settles would confound that with the law's error.
    """
    own, other = (base.level, base.springs), "implicit" if base.kind == "explicit" else "explicit"
    laws = laws_of(scene, family, own)
    finest = list(laws)[-1]

    def variant(axis: str, law: Law, kind: str, factor: float = 1.0) -> Variant:
        level, springs = law
        words = [level if springs is None else f"{level} {springs}"] + ([kind] if kind != base.kind else [])
        if factor != 1.0:
            what = "step" if kind == "explicit" else "tolerance"
            words.append(f"{what} x{factor:g}" if factor > 1.0 else f"{what} /{1.0 / factor:g}")
        default = axis == "law" and law == own
        changes = laws[law] | (_curves(scene, family, level) if axis == "reference" else {}) | _step_changes(base, kind, factor)
        return Variant(", ".join(words), axis, *law, kind, factor, default, axis == "reference", changes)

    variants = [variant("law", law, base.kind) for law in laws]
    variants += [variant("step", own, base.kind, factor) for factor in FACTORS[base.kind]]
    factors = (1.0,) if other == "explicit" and math.isnan(base.step) else AROUND[other]
    variants += [variant("integrator", own, other, factor) for factor in factors]
    variants += _speeds(variant("speed", own, base.kind), scene) if base.sheared_bed else []
    if base.meets:
        same = variant("nudged", own, base.kind)
        starts = [(f"{same.name}, start {NUDGE:g} apart ({number})", number) for number in range(1, NUDGED + 1)]
        variants += [replace(same, name=name, nudge=number) for name, number in starts]
        alone = {**same.changes, "contact.debris_contact": "none"}
        variants.append(replace(same, axis="meeting", name=f"{same.name}, bodies do not meet", changes=alone))
    if own != finest:
        variants += [variant("fine", finest, base.kind, factor) for factor in FINE[base.kind]]
    return [*variants, variant("reference", finest, base.kind, FINEST[base.kind])]


def _speeds(own: Variant, scene: Scene) -> list[Variant]:
    """Return a variant at other speeds of the upper plate, but for those that the scene cannot have."""

    def keys(entry: Scene) -> dict[str, Any]:
        document = entry.document()
        tables = {"plates.upper": document["plates"]["upper"], "solver": document["solver"], "output": document["output"]}
        return {f"{table}.{key}": value for table, values in tables.items() for key, value in values.items()}

    variants, before = [], keys(scene)
    for speed in SPEEDS:
        after = keys(at_speed(scene, speed))
        changes = {**own.changes, **{key: value for key, value in after.items() if before.get(key) != value}}
        try:
            scene.with_settings(changes)
        except InputError:  # a wanted inertial number beyond its range
            continue
        name = f"{own.name}, speed {f'x{speed:g}' if speed > 1.0 else f'/{1.0 / speed:g}'}"
        variants.append(replace(own, name=name, speed=speed, changes=changes))
    return variants


def springs_option(family: LawFamily, level: str) -> int | None:
    """Return the default number of springs of a level; None where it has no such option."""
    result = [option.default for law in family.levels[level] for option in law.options if option.name == "springs"]
    return int(result[0]) if result else None  # type: ignore[arg-type]


def laws_of(scene: Scene, family: LawFamily, own: Law) -> dict[Law, dict[str, Any]]:
    """Return all laws from the coarsest to the finest, with the changes of the scene that they need.

    Options of the scene that a level does not know are removed; a finest law that is not the scene's own resolves curves.
    """
    laws: dict[Law, dict[str, Any]] = {}
    for level in family.levels:
        known, given = _options_of(family, level), {own[1]} if level == own[0] and own[1] else set()
        changes = {f"contact.{key}": None for key in scene.contact.options if key not in known} | {"contact.level": level}
        if springs_option(family, level) is None:
            laws[level, None] = changes
        else:
            laws |= {(level, n): changes | {"contact.springs": n} for n in sorted({*SPRINGS, *given})}
    finest = list(laws)[-1]
    if finest != own:
        laws[finest] |= _curves(scene, family, finest[0])
    return laws


def _curves(scene: Scene, family: LawFamily, level: str) -> dict[str, Any]:
    known = _options_of(family, level) & set(CURVES)
    return {f"contact.{key}": max(CURVES[key], scene.contact.options.get(key, CURVES[key])) for key in known}


def _options_of(family: LawFamily, level: str) -> set[str]:
    return {option.name for law in family.levels[level] for option in law.options}


def _step_changes(base: Base, kind: str, factor: float) -> dict[str, Any]:
    """Return the integrator with its step or tolerance times a factor; keys of the other one are removed."""
    if kind == "implicit":
        finer = {} if factor == 1.0 else {"solver.tolerance": factor * base.tolerance}
        return {"solver.integrator": kind, "solver.time_step": "auto", **finer}
    step = "auto" if math.isnan(base.step) else f"{factor * base.step!r} s"
    return {"solver.integrator": kind, "solver.time_step": step, **{f"solver.{key}": None for key in IMPLICIT_KEYS}}
