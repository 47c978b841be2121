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
from thirdbody.scene.output import Output
from thirdbody.scene.surfaces import SIDES, faults_in_domain
from thirdbody.scene.tables import Domain, Material, Measures, PairTable, Plates, Solver
from thirdbody.schema.fields import show
from thirdbody.schema.parts import Location, Wrong, entry
from thirdbody.units import pretty

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


def raw_faults(raw: dict[str, Any], kinds: Mapping[str, type[DebrisKind]], moving: bool, every_kind: str) -> list[Wrong]:
    """Return faults between unchecked tables. `moving`: the upper plate may slide; `every_kind`: "distance" or another word."""
    faults: list[Wrong] = []
    if isinstance(raw.get("materials", {}), Mapping) and not raw.get("materials"):
        faults.append((("materials",), "at least one [materials.NAME] table is needed"))
    if isinstance(raw.get("debris", []), list | tuple) and not raw.get("debris"):
        faults.append((("debris",), "at least one [[debris]] table is needed"))
    faults += _material_faults(raw) + _pair_faults(raw, kinds)
    solver, output, plates = (raw.get(key) for key in ("solver", "output", "plates"))
    if entry(output, "profiles") is not None and any(entry(plates, side) is None for side in SIDES):
        text = "profiles are taken between two plates: add plates.lower and plates.upper"
        faults.append((("output", "profiles"), text))
    faults += _bed_faults(solver, raw.get("contact"), moving)
    need = "needs an upper plate that moves: add plates.upper.motion, or give"
    if not moving and entry(solver, "distance") is not None:
        faults.append((("solver", "distance"), f"a distance {need} duration instead"))
    if not moving and every_kind == "distance":
        faults.append((("output", "every"), f"a length of sliding {need} a time"))
    return faults


def _material_faults(raw: dict[str, Any]) -> list[Wrong]:
    materials = raw.get("materials")
    if not isinstance(materials, Mapping) or not materials:
        return []
    used: dict[Location, Any] = {("debris", i, "material"): entry(d, "material") for i, d in enumerate(_items(raw.get("debris")))}
    used |= {("plates", side, "material"): entry(entry(raw.get("plates"), side), "material") for side in SIDES}
    for i, pair in enumerate(_items(raw.get("pairs"))):
        used |= {("pairs", i, "between", k): name for k, name in enumerate(_items(entry(pair, "between")))}
    return [
        (location, f"unknown material {show(name)}, {nearest(name, materials)}")
        for location, name in used.items()
        if isinstance(name, str) and name not in materials
    ]


def _pair_faults(raw: dict[str, Any], kinds: Mapping[str, type[DebrisKind]]) -> list[Wrong]:
    materials = raw.get("materials")

    def defined(names: list[Any]) -> bool:
        return isinstance(materials, Mapping) and all(isinstance(name, str) and name in materials for name in names)

    faults: list[Wrong] = []
    known: dict[frozenset[str], int] = {}
    for i, pair in enumerate(_items(raw.get("pairs"))):
        names = [name for name in _items(entry(pair, "between")) if isinstance(name, str)]
        if len(names) != 2 or not defined(names):
            return faults  # reported already; the intended pair is unknown, so none can be called missing
        first = known.setdefault(frozenset(names), i)
        if first != i:
            text = f"'{names[0]}' and '{names[1]}' are given by pairs[{first}] already"
            faults.append((("pairs", i, "between"), text))
    needed: dict[frozenset[str], tuple[str, str, str]] = {}
    for a, b, where in _meetings(raw, kinds):
        if defined([a, b]):
            needed.setdefault(frozenset((a, b)), (a, b, where))
    for key, (a, b, where) in needed.items():
        if key not in known:
            text = f"no pair for '{a}' and '{b}', which can meet ({where}): add a [[pairs]] table with"
            faults.append((("pairs",), f'{text} between = ["{a}", "{b}"]'))
    return faults


def _items(node: Any) -> list[Any]:
    return list(node) if isinstance(node, list | tuple) else []


def _meetings(raw: dict[str, Any], kinds: Mapping[str, type[DebrisKind]]) -> Iterator[tuple[Any, Any, str]]:
    debris = [(f"debris[{i}]", entry(d, "material"), d, _kind(d, kinds)) for i, d in enumerate(_items(raw.get("debris")))]
    for name, material, _, _ in debris:
        for side in SIDES:
            plate = entry(raw.get("plates"), side)
            if plate is not None:
                yield material, entry(plate, "material"), f"{name} and plates.{side}"
    if entry(raw.get("contact"), "debris_contact") == "none":
        return
    debris = [row for row in debris if row[3].meets_debris]
    for name, material, table, kind in debris:
        if kind.body_count(table) > 1:
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


RESTS = "changes the speed of the upper plate, and here it rests"
NO_BED = "is for a bed, whose bodies meet each other"
ALONE = "the implicit integrator takes slow motion as it is, and needs no other speed"
"""Why `solver.inertial_number` is refused, and what to do without it where bodies do not meet."""


def _bed_faults(solver: Any, contact: Any, moving: bool) -> list[Wrong]:
    location: Location = ("solver", "inertial_number")
    faults: list[Wrong] = []
    if entry(solver, "inertial_number") is None:
        return []
    if not moving:
        faults.append((location, f"{RESTS}: add plates.upper.motion"))
    if entry(contact, "debris_contact") == "none":
        faults.append((location, f'{NO_BED}, and contact.debris_contact = "none" declares that they do not; {ALONE}'))
    elif entry(solver, "integrator") == "implicit":
        faults.append((location, f"{NO_BED}, which needs the explicit integrator; {ALONE}"))
    return faults


def too_long(every: float, whole: float) -> bool:
    """Return whether an interval exceeds the run, with a tolerance for rounding."""
    return every > whole * (1.0 + 1e-9)


def too_long_message(every: float, whole: float, kind: str) -> str:
    """Return the message about such an interval."""
    longest = units.pretty(whole, kind)
    return f"{units.pretty(every, kind)} is longer than the whole run; allowed: at most {longest}"


def faults_of_walls(plates: Plates, solver: Solver, measures: Measures) -> list[Wrong]:
    """Return faults of what side walls need, and do not have."""
    faults: list[Wrong] = []
    if plates.lower is None:
        faults.append((("domain", "walls"), "have the material of the lower plate: add [plates.lower]"))
    for side in SIDES:
        if getattr(getattr(plates, side), "surface", None) is not None:
            faults.append((("plates", side, "surface"), "not with domain.walls: side walls stand between flat plates"))
    if solver.integrator == "implicit":
        faults.append((("solver", "integrator"), 'not with domain.walls: side walls need the "explicit" one'))
    if solver.initial_overlap == "relax":
        faults.append((("solver", "initial_overlap"), "'relax' pushes bodies apart without side walls (domain.walls)"))
    if measures.cell is not None:
        faults.append((("measures", "cell"), "not with domain.walls: maps are of the plates, and side walls would add to them"))
    return faults


def faults_between(plates: Plates, domain: Domain, solver: Solver, output: Output, measures: Measures) -> list[Wrong]:
    """Return faults between tables that are valid on their own."""
    faults = faults_of_walls(plates, solver, measures) if domain.walls else []
    rough = {side: surface for side in SIDES if (surface := getattr(getattr(plates, side), "surface", None)) is not None}
    for side, surface in rough.items():
        location = ("plates", side, "surface")
        if not domain.periodic:
            faults.append((location, "a surface repeats with the domain: domain.periodic must be true"))
        faults += [((*location, *where), text) for where, text in faults_in_domain(surface, domain.size)]
    if plates.wear is not None:
        if "wear" not in measures.named or measures.cell is None:
            faults.append((("plates", "wear"), "takes what measures.wear has mapped: add it, and measures.cell"))
        if not domain.periodic:
            faults.append((("plates", "wear"), "worn surfaces repeat with the domain: domain.periodic must be true"))
        if not plates.moving():
            faults.append((("plates", "wear"), "needs an upper plate that moves: add plates.upper.motion"))
    if (rough or plates.wear) and solver.initial_overlap == "relax":
        text = f"'relax' pushes bodies apart between flat plates only, and plates.{next(iter(rough), 'wear')} has heights; "
        faults.append((("solver", "initial_overlap"), text + 'give positions without overlap, or placement = "layer"'))
    # runs for a duration have no length before they are assembled
    if output.every_kind == "distance" and solver.distance is not None and too_long(output.every, solver.distance):
        faults.append((("output", "every"), too_long_message(output.every, solver.distance, "length")))
    return faults


SOFT, STIFF = 5e8, 1.3e12
"""Range of Young's modulus [Pa]: elastomers, foams and the softest polymers are below; diamond has 1.2e12."""

LIGHT, HEAVY = 100.0, 2.3e4
"""Range of density [kg/m3]: only foams are below; osmium, the densest element, has 22590."""

ROUGH = 2.0
"""Friction coefficient that clean solids in air rarely exceed."""


def unusual_values(materials: Mapping[str, Material], pairs: Sequence[PairTable]) -> Iterator[str]:
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
