"""Faults between the tables of a scene: names of materials, missing pairs, sliding without a moving plate.

Works on the raw tables, as far as they can be read, so that these faults are reported together with all others.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import combinations
from typing import Any

from thirdbody import units
from thirdbody.debris.contract import DebrisKind
from thirdbody.errors import nearest
from thirdbody.scene.surfaces import SIDES, faults_in_domain
from thirdbody.scene.tables import Domain, Material, Pair, Plates, Solver
from thirdbody.schema.fields import show
from thirdbody.schema.parts import Location, Wrong, entry
from thirdbody.units import pretty


def _items(node: Any) -> list[Any]:
    return list(node) if isinstance(node, list | tuple) else []


MAX_MATERIALS = MAX_POPULATIONS = 1000
"""Largest number of materials and of debris tables in a scene: tables of pairs of materials take 8 MB then."""


def number_faults(raw: dict[str, Any]) -> list[Wrong]:
    """Return faults of scenes with more materials or debris tables than are read."""
    faults: list[Wrong] = []
    for key, maximum, what in (("materials", MAX_MATERIALS, "materials"), ("debris", MAX_POPULATIONS, "debris tables")):
        count = len(raw[key]) if isinstance(raw.get(key), Mapping | list | tuple) else 0
        if count > maximum:
            faults.append(((key,), f"{count} {what}, at most {maximum} are read"))
    return faults


def material_faults(raw: dict[str, Any]) -> list[Wrong]:
    """Return faults of material names that are used but not defined."""
    materials = raw.get("materials")
    if not isinstance(materials, Mapping) or not materials:
        return []
    return [
        (location, f"unknown material {show(name)}, {nearest(name, materials)}")
        for location, name in _used(raw)
        if isinstance(name, str) and name not in materials
    ]


def _used(raw: dict[str, Any]) -> Iterator[tuple[Location, Any]]:
    for i, debris in enumerate(_items(raw.get("debris"))):
        yield ("debris", i, "material"), entry(debris, "material")
    for side in ("lower", "upper"):
        yield ("plates", side, "material"), entry(entry(raw.get("plates"), side), "material")
    for i, pair in enumerate(_items(raw.get("pairs"))):
        for k, name in enumerate(_items(entry(pair, "between"))):
            yield ("pairs", i, "between", k), name


def pair_faults(raw: dict[str, Any], kinds: Mapping[str, type[DebrisKind]]) -> list[Wrong]:
    """Return faults of pairs given twice, and of pairs of materials that can meet but are not given."""
    faults: list[Wrong] = []
    known: dict[frozenset[str], int] = {}
    for i, pair in enumerate(_items(raw.get("pairs"))):
        names = [name for name in _items(entry(pair, "between")) if isinstance(name, str)]
        if len(names) != 2 or not _defined(raw, names):
            return faults  # reported already; the intended pair is unknown, so none can be called missing
        if frozenset(names) in known:
            first = known[frozenset(names)]
            faults.append((("pairs", i, "between"), f"{_both(names)} are given by pairs[{first}] already"))
        known.setdefault(frozenset(names), i)
    needed: dict[frozenset[str], tuple[list[str], str]] = {}
    for first, second, where in _meetings(raw, kinds):
        if _defined(raw, [first, second]):
            needed.setdefault(frozenset((first, second)), ([first, second], where))
    for key, (names, where) in needed.items():
        if key not in known:
            text = f"no pair for {_both(names)}, which can meet ({where}): add a [[pairs]] table with"
            faults.append((("pairs",), f'{text} between = ["{names[0]}", "{names[1]}"]'))
    return faults


def _both(names: list[str]) -> str:
    return f"'{names[0]}' and '{names[1]}'"


def _defined(raw: dict[str, Any], names: list[Any]) -> bool:
    materials = raw.get("materials")
    return isinstance(materials, Mapping) and all(isinstance(n, str) and n in materials for n in names)


def _meetings(raw: dict[str, Any], kinds: Mapping[str, type[DebrisKind]]) -> Iterator[tuple[Any, Any, str]]:
    """Yield the materials that can touch, and the tables that they belong to."""
    debris = [
        (f"debris[{i}]", entry(d, "material"), kind.body_count(d), kind.meets_debris)
        for i, d in enumerate(_items(raw.get("debris")))
        for kind in [_kind(d, kinds)]
    ]
    for name, material, _, _ in debris:
        for side in ("lower", "upper"):
            plate = entry(raw.get("plates"), side)
            if plate is not None:
                yield material, entry(plate, "material"), f"{name} and plates.{side}"
    if entry(raw.get("contact"), "debris_contact") == "none":
        return
    debris = [row for row in debris if row[3]]
    for name, material, bodies, _ in debris:
        if bodies > 1:
            yield material, material, f"the bodies of {name}"
    for (name, material, _, _), (other, other_material, _, _) in combinations(debris, 2):
        yield material, other_material, f"{name} and {other}"


def _kind(debris: Any, kinds: Mapping[str, type[DebrisKind]]) -> type[DebrisKind]:
    """Return the class of an unchecked debris table; the base of all kinds where it cannot be read."""
    if isinstance(debris, DebrisKind):
        return type(debris)
    name = entry(debris, "kind")
    try:
        return kinds[name] if isinstance(name, str) else DebrisKind
    except (KeyError, ValueError):
        return DebrisKind


def sliding_faults(raw: dict[str, Any], moving: bool, every_kind: str) -> list[Wrong]:
    """Return faults of lengths of sliding without a plate that slides."""
    faults: list[Wrong] = []
    if moving:
        return faults
    if entry(raw.get("solver"), "distance") is not None:
        hint = "add plates.upper.motion, or give duration instead"
        faults.append((("solver", "distance"), f"a distance needs an upper plate that moves: {hint}"))
    if every_kind == "distance":
        hint = "add plates.upper.motion, or give a time"
        faults.append((("output", "every"), f"a length of sliding needs an upper plate that moves: {hint}"))
    return faults


RESTS = "changes the speed of the upper plate, and here it rests"
NO_BED = "is for a bed, whose bodies meet each other"
ALONE = "the implicit integrator takes slow motion as it is, and needs no other speed"
"""Why `solver.inertial_number` is refused, and what to do without it where bodies do not meet."""


def bed_faults(raw: dict[str, Any], moving: bool) -> list[Wrong]:
    """Return faults of a wanted inertial number where no bed is sheared."""
    location: Location = ("solver", "inertial_number")
    solver, faults = raw.get("solver"), []
    if entry(solver, "inertial_number") is None:
        return []
    if not moving:
        faults.append((location, f"{RESTS}: add plates.upper.motion"))
    if entry(raw.get("contact"), "debris_contact") == "none":
        faults.append((location, f'{NO_BED}, and contact.debris_contact = "none" declares that they do not; {ALONE}'))
    elif entry(solver, "integrator") == "implicit":
        faults.append((location, f"{NO_BED}, which needs the explicit integrator; {ALONE}"))
    return faults


def profile_faults(raw: dict[str, Any]) -> list[Wrong]:
    """Return the fault of profiles without two plates."""
    named, plates = entry(raw.get("output"), "profiles") is not None, raw.get("plates")
    if not named or all(entry(plates, side) is not None for side in ("lower", "upper")):
        return []
    return [(("output", "profiles"), "profiles are taken between two plates: add plates.lower and plates.upper")]


def interval_faults(solver: Any, output: Any) -> list[Wrong]:
    """Return the fault of an output interval longer than the distance; other runs have no length before they are assembled."""
    if output.every_kind != "distance" or solver.distance is None or not too_long(output.every, solver.distance):
        return []
    return [(("output", "every"), too_long_message(output.every, solver.distance, "length"))]


def too_long(every: float, whole: float) -> bool:
    """Return whether an interval exceeds the run, with a tolerance for rounding."""
    return every > whole * (1.0 + 1e-9)


def too_long_message(every: float, whole: float, kind: str) -> str:
    """Return the message about such an interval."""
    longest = units.pretty(whole, kind)
    return f"{units.pretty(every, kind)} is longer than the whole run; allowed: at most {longest}"


def surface_faults(plates: Plates, domain: Domain) -> list[Wrong]:
    """Return the faults of the surfaces of both plates."""
    faults: list[Wrong] = []
    for side in SIDES:
        surface = getattr(getattr(plates, side), "surface", None)
        if surface is None:
            continue
        location = ("plates", side, "surface")
        if not domain.periodic:
            faults.append((location, "a surface repeats with the domain: domain.periodic must be true"))
        faults += [((*location, *where), text) for where, text in faults_in_domain(surface, domain.size)]
    return faults


def relax_faults(plates: Plates, solver: Solver) -> list[Wrong]:
    """Return the fault of bodies to be pushed apart between rough plates, which that does not know."""
    rough = [side for side in SIDES if getattr(getattr(plates, side), "surface", None) is not None]
    if solver.initial_overlap != "relax" or not rough:
        return []
    text = f"'relax' pushes bodies apart between flat plates only, and plates.{rough[0]}.surface is rough; "
    return [(("solver", "initial_overlap"), text + 'give positions without overlap, or placement = "layer"')]


SOFT, STIFF = 5e8, 1.3e12
"""Range of Young's modulus [Pa]: elastomers, foams and the softest polymers are below; diamond has 1.2e12."""

LIGHT, HEAVY = 100.0, 2.3e4
"""Range of density [kg/m3]: only foams are below; osmium, the densest element, has 22590."""

ROUGH = 2.0
"""Friction coefficient that clean solids in air rarely exceed."""


def unusual_values(materials: Mapping[str, Material], pairs: Sequence[Pair]) -> Iterator[str]:
    """Yield a warning for each unusual modulus, density and friction coefficient, with the unit probably intended."""
    for name, material in materials.items():
        key = "youngs_modulus" if material.youngs_modulus is not None else "shear_modulus"
        young = material.young()
        shown = pretty(young, "pressure")
        if not SOFT <= young <= STIFF:
            where = f"materials.{name}.{key}: a Young's modulus of {shown}"
            yield (f"{where} is that of an elastomer or a foam (other solids: above {pretty(SOFT, 'pressure')}); was GPa meant?"
                   if young < SOFT else f"{where} is above that of diamond, 1.2 TPa; is the unit right?")  # fmt: skip
        if not LIGHT <= material.density <= HEAVY:
            where = f"materials.{name}.density: {material.density:g} kg/m3"
            meant = 1e3 * material.density
            yield (f"{where} is that of a foam; was g/cm3 meant, which is {meant:g} kg/m3?" if material.density < LIGHT else
                   f"{where} is above that of every element (osmium: 22590 kg/m3); was it kg/m3?")  # fmt: skip
    for k, pair in enumerate(pairs):
        if pair.friction > ROUGH:
            yield (
                f"pairs[{k}].friction: {pair.friction:g} is far above the 0.05 to {ROUGH:g} of solids; it is a coefficient, "
                "not per cent and not an angle"
            )
