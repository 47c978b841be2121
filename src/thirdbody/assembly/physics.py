"""Compiled physics of a scene: laws and effects by name, parameters and their sources."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from thirdbody.assembly.option_values import Effect, effect_values, option_values, pair_value_faults
from thirdbody.assembly.schedule import chosen_memory
from thirdbody.engine.state import CompiledMeasures, Physics
from thirdbody.errors import PLUGIN_FILE, Fault, InputError, UsageError, nearest, short
from thirdbody.laws.compose import Chain, compose, compose_effects, compose_labeller
from thirdbody.laws.contract import BodyEffect, Labeller, Law, LawFamily, Material, Pair, SpotInteraction
from thirdbody.laws.data import EXPLICIT, FULL, IMPLICIT
from thirdbody.laws.effects import NO_LABELS
from thirdbody.laws.generated import compile_error, plain
from thirdbody.laws.measures import Measure, compose_measures, layout_of
from thirdbody.laws.memory import MEMORY
from thirdbody.laws.registry import Registry
from thirdbody.scene.model import Scene

MAX_CELLS = 4_000_000
"""Largest number of cells of a map: it is written with every frame, 8 bytes each."""

Values = Mapping[str, Mapping[str, Any]]
"""Options in SI by the name of a law, an effect or a measure."""


@dataclass(frozen=True)
class CompiledPhysics:
    """Physics of a scene, in words and as compiled code. `off`: laws of the level that no pair requires."""

    physics: Physics
    family: LawFamily
    level: str
    labeller: Labeller | None
    effects: tuple[BodyEffect, ...]
    interactions: tuple[SpotInteraction, ...]
    materials: tuple[Material, ...]
    pairs: tuple[Pair, ...]
    off: tuple[str, ...]
    options: dict[str, dict[str, Any]]
    measures: tuple[Measure, ...] = ()

    @property
    def chain(self) -> Chain:
        """Contact laws."""
        return self.physics

    @property
    def other_effects(self) -> tuple[BodyEffect | SpotInteraction, ...]:
        """Effects that are no contact laws."""
        return (*self.effects, *self.interactions)

    @property
    def memory(self) -> str | None:
        """Return the memory of the tangential springs (`laws.memory.MEMORY`); None for a law without that option."""
        return next((self.options[law.name][MEMORY.name] for law in self.chain.laws if MEMORY in law.options), None)

    @cached_property
    def rows(self) -> list[list[Any]]:
        """Mixed parameters of each pair, law by law."""
        return [self._row(pair) for pair in self.pairs]

    def _row(self, pair: Pair) -> list[Any]:
        return [_mixed(law, pair, law.options_of(pair, self.options[law.name])) for law in self.chain.laws]

    def reach(self, radius: float) -> float:
        """Return the distance from touch [m] at which bodies of at most this effective radius [m] begin to act on each other."""
        reaching = [(law, law.reach) for law in self.chain.laws if law.reach]
        distances = [f(p, law.options_of(p, self.options[law.name]), radius) for law, f in reaching for p in self.pairs]
        if not all(0.0 <= distance < math.inf for distance in distances):
            raise UsageError(f"the reach of {', '.join(law.name for law, _ in reaching)} must be a finite length, at least 0")
        return max(distances, default=0.0)

    def set_parameters(self, integrator: str = "", largest: float = math.inf) -> None:
        """Write the parameters of all pairs, of "explicit" or "implicit" steps or of none, with friction of at most `largest`."""
        flat = list[float]()
        for pair, row in zip(self.pairs, self.rows, strict=True):
            limited = self._row(replace(pair, friction=largest)) if pair.friction > largest else row
            for law, p in zip(self.chain.laws, limited, strict=True):
                flat += law.in_steps(p, integrator) if integrator and law.in_steps else p
            flat += [{"": FULL, "explicit": EXPLICIT, "implicit": IMPLICIT}[integrator]] * self.chain.jumps
        self.physics.pairs[: len(flat)] = flat  # a scene without pairs has a table of zeros


def compile_physics(scene: Scene, registry: Registry) -> CompiledPhysics:
    """Select, check and compile. Raises InputError with all faults of names and options."""
    faults: list[Fault] = []
    family, level, laws, law_values = _laws(scene, registry, faults)
    named, values = _effects(scene, registry, faults)
    measures, measure_values = _measures(scene, registry, faults)
    if family is None or faults:
        raise InputError(faults)
    materials, pairs = _materials(scene)
    values = {name: chosen_memory(scene, given) for name, given in law_values.items()} | values
    contact_effects = [effect for effect in named if isinstance(effect, Law)]
    effects = tuple(effect for effect in named if isinstance(effect, BodyEffect))
    interactions = tuple(effect for effect in named if isinstance(effect, SpotInteraction))
    replaced = {law.sized(values[law.name]).replaces for law in contact_effects}
    laws = tuple(law for law in laws if law.name not in replaced)
    chosen = tuple(law for law in (*laws, *contact_effects) if law.wanted(pairs))
    try:
        chain = compose(law.sized(values.get(law.name, {})) for law in chosen)
    except ValueError as problem:
        raise InputError(scene.fault(("contact", "law"), str(problem))) from None
    except Exception as problem:
        raise _not_compiled(chosen, problem) from problem
    labeller = _labeller(scene, family, registry)
    written = _for_output(scene, labeller)
    given = written or NO_LABELS
    effect_row = [x for effect in effects for x in _mixed(effect, values[effect.name])]
    if any(effect.settling for effect in effects):
        effect_row.append(math.inf)  # end of settling: set by `assembly.simulation`
    try:
        compiled_effects = compose_effects(effects)
        observe, label = compose_labeller(given, bool(effects))
    except Exception as problem:
        raise _not_compiled([*effects, *([labeller] if labeller else [])], problem) from problem
    physics = Physics(
        chain.laws,
        pairs=np.zeros(max(len(pairs), 1) * chain.width),
        interaction=_interaction_table(scene, interactions, chain, materials, pairs, values),
        kinds=_kinds(materials, pairs),
        effects=compiled_effects,
        effect_parameters=np.array(effect_row or [0.0]),
        has_effects=bool(effects),
        observe=observe,
        label=label,
        memory=len(given.memory),
        contact_memory=len(given.contact_memory),
        stride=written.stride if written else 1,
        labels=written is not None,
        outputs=2 + len(given.margins) + len(given.extras),
        measures=_compiled_measures(scene, measures, measure_values, pairs) if measures else None,
        pull_off=_pull_off_forces(chain.laws, pairs, values),
    )
    vars(physics).update(vars(chain))  # what is compiled already
    off = tuple(law.name for law in laws if not law.wanted(pairs))
    options = {law.name: values.get(law.name, {}) for law in chain.laws}
    compiled = CompiledPhysics(physics, family, level, labeller, effects, interactions, materials, pairs, off, options, measures)
    compiled.set_parameters()
    return compiled


def _kinds(materials: Sequence[Material], pairs: Sequence[Pair]) -> np.ndarray:
    index = {material.name: k for k, material in enumerate(materials)}
    kinds = np.full((len(index), len(index)), -1, np.int64)
    for k, pair in enumerate(pairs):
        a, b = index[pair.a.name], index[pair.b.name]
        kinds[a, b] = kinds[b, a] = k
    return kinds


def law_faults(scene: Scene, registry: Registry) -> list[Fault]:
    """Return the faults in the names and options of laws and effects, without compiling anything."""
    faults: list[Fault] = []
    _laws(scene, registry, faults)
    _effects(scene, registry, faults)
    _measures(scene, registry, faults)
    return faults


def states_of(scene: Scene, registry: Registry) -> tuple[str, ...]:
    """Return the names of the states that a run of this scene has; none without a labeller."""
    family = registry.families.get(scene.contact.law)
    labeller = _labeller(scene, family, registry)
    return tuple(labeller.states) if labeller else ()


def _labeller(scene: Scene, family: LawFamily | None, registry: Registry) -> Labeller | None:
    """Return the labeller of a law family; for one without, any: labels need forces and motion only, whatever the law.

    Where the pressure has an edge, it has one more state and reason, which the engine assigns.
    """
    any_other = next((one.labeller for one in registry.families.values() if one.labeller), None)
    labeller = (family.labeller if family else None) or any_other
    if labeller is None or scene.plates.upper is None or scene.plates.upper.profile is None:
        return labeller
    words = dict(labeller.words or {}) | {"out": "left the contact of the first bodies", "left_contact": "outside for out_after"}
    return replace(labeller, states=(*labeller.states, "out"), reasons=(*labeller.reasons, "left_contact"), words=words)


def _mixed(law: Law | BodyEffect | Measure, *arguments: Any) -> Any:
    """Return the mixed parameters of a law. Raises UsageError for any exception of its mixing rule."""
    try:
        row = law.mix(*arguments)
    except Exception as problem:
        raise UsageError(f"the mixing rule of '{law.name}' failed: {type(problem).__name__}: {problem}") from problem
    wrong = [name for name, value in zip(type(row)._fields, row, strict=True) if math.isnan(value)]
    if wrong:
        raise UsageError(f"the mixing rule of '{law.name}' gives no number for {', '.join(wrong)}")
    return row


def _not_compiled(parts: Sequence[Law | BodyEffect | Labeller | Measure], problem: Exception) -> Exception:
    """Return a UsageError for laws of which one is no valid kernel; return other problems unchanged."""
    reason = compile_error(problem)
    codes = {part.name: plain(part.label if isinstance(part, Labeller) else part.kernel).__module__ for part in parts}
    names = [name for name, module in codes.items() if not module.startswith("thirdbody.")]  # the built-in ones always compile
    return UsageError(f"{', '.join(names)}: {reason}") if reason and names else problem


def _laws(
    scene: Scene, registry: Registry, faults: list[Fault]
) -> tuple[LawFamily | None, str, tuple[Law, ...], dict[str, dict[str, Any]]]:  # fmt: skip
    """Return the family, the level, its laws and the option values of each; no family where none has the name."""
    families, name = registry.families, scene.contact.law
    if name not in families:
        hint = nearest(name, families)
        broken = "".join(f"; plug-in {plugin} did not load: {why}" for plugin, why in registry.failures.items())
        faults.append(scene.fault(("contact", "law"), f"no law '{name}' is installed, {hint}; {PLUGIN_FILE}{broken}"))
        return None, "", (), {}
    family = families[name]
    level = scene.contact.level or family.default_level
    laws = family.levels.get(level, ())
    if level not in family.levels:
        message = f"'{level}' is not a level of '{name}', {nearest(level, family.levels)}"
        faults.append(scene.fault(("contact", "level"), message))
    known = {option.name for law in laws for option in law.options}
    for key in scene.contact.options:
        if key in known:
            continue
        owners = [level for level, laws in family.levels.items() if any(o.name == key for law in laws for o in law.options)]
        if owners:
            message = "belongs to level = " + " or ".join(f'"{owner}"' for owner in owners)
        else:
            message = f"unknown key for this law and level, {nearest(key, known | {'law', 'level', 'debris_contact'})}"
        faults.append(scene.fault(("contact", key), message))
    values = {law.name: option_values(scene, law.options, scene.contact.options, ("contact",), faults) for law in laws}
    return family, level, laws, values


def _materials(scene: Scene) -> tuple[tuple[Material, ...], tuple[Pair, ...]]:
    by_name = {
        name: Material(name, m.shear(), m.poisson_ratio, m.density, m.yield_strength, m.thermal_conductivity, m.heat_capacity)
        for name, m in scene.materials.items()
    }
    pairs = tuple(
        Pair(by_name[p.between[0]], by_name[p.between[1]], p.friction, p.restitution, p.rolling_friction, p.work_of_adhesion)
        for p in scene.pairs
    )
    return tuple(by_name.values()), pairs


def _named(scene: Scene, table: str, known: Mapping[str, Any], faults: list[Fault]) -> tuple[list[Any], dict[str, Any]]:
    chosen, values = list[Any](), dict[str, Any]()
    for name, given in sorted(getattr(scene, table).named.items()):
        location = (table, name)
        if name not in known:
            message = f"no {table[:-1]} '{short(name)}' is installed, {nearest(name, known)}; {PLUGIN_FILE}"
            faults.append(scene.fault(location, message))
            continue
        chosen.append(known[name])
        values[name] = effect_values(scene, known[name], given, location, faults)
        for key in getattr(known[name], "materials", ()):
            lacking = [material for material, properties in scene.materials.items() if getattr(properties, key) is None]
            message = f"required key '{key}' is missing: {table}.{name} needs it"
            faults += [scene.fault(("materials", material), message) for material in lacking]
    return chosen, values


def _effects(scene: Scene, registry: Registry, faults: list[Fault]) -> tuple[list[Effect], dict[str, dict[str, Any]]]:
    """Return the effects that the scene names, gravity first, then by name, and the values of their options."""
    chosen, values = _named(scene, "effects", registry.effects, faults)
    if scene.effects.gravity is not None:
        chosen = [*(effect for name, effect in registry.effects.items() if name == "gravity"), *chosen]
        values["gravity"] = {"acceleration": scene.effects.gravity}
    faults += pair_value_faults(scene, registry.effects)
    return chosen, values


def _measures(scene: Scene, registry: Registry, faults: list[Fault]) -> tuple[tuple[Measure, ...], dict[str, dict[str, Any]]]:
    chosen, values = _named(scene, "measures", registry.measures, faults)
    if scene.measures.cell is not None and not any(amount.map for measure in chosen for amount in measure.amounts):
        faults.append(
            scene.fault(
                ("measures", "cell"),
                "no measure of this scene has a map: remove the key, or add a measure that has one, such as wear",
            )
        )
    elif math.prod(_cells(scene)) > MAX_CELLS:
        faults.append(scene.fault(("measures", "cell"), f"makes {math.prod(_cells(scene)):.3g} cells, at most {MAX_CELLS:.3g}"))
    return tuple(chosen), values


def _cells(scene: Scene) -> tuple[int, int]:
    cell, (l_x, l_y) = scene.measures.cell, scene.domain.size
    return (0, 0) if cell is None else (max(1, round(l_x / cell)), max(1, round(l_y / cell)))


def _compiled_measures(scene: Scene, measures: Sequence[Measure], values: Values, pairs: Sequence[Pair]) -> CompiledMeasures:
    try:
        layout = layout_of(measures)
    except ValueError as problem:
        raise InputError(scene.fault(("measures",), str(problem))) from None
    try:
        function = compose_measures(measures)
    except Exception as problem:
        raise _not_compiled(measures, problem) from problem
    rows = [[x for measure in measures for x in _mixed(measure, pair, values[measure.name])] for pair in pairs]
    return CompiledMeasures(function, np.array(rows, float).ravel(), layout, _cells(scene))


def _interaction_table(
    scene: Scene, interactions: Sequence[SpotInteraction], chain: Chain, materials: Sequence[Material], pairs: Sequence[Pair],
    values: Values,
) -> np.ndarray:  # fmt: skip
    """Return the compliances of the lower and the upper plate [m2/N], then the stiffness of each pair [Pa]; empty without any
    interaction of spots (`kernels.close_spots`). Raises InputError for two, rough plates, side walls, another normal law than
    Hertz' and adhesion."""
    if not interactions:
        return np.zeros(0)
    effect, options, reason = interactions[0], values[interactions[0].name], ""
    plates = [scene.plates.lower, scene.plates.upper]
    other = [law.name for law in chain.laws if law.stage == "adhesion" or (law.stage == "normal" and law.name != "hertz")]
    if len(interactions) > 1:
        reason = f"two interactions of spots: {', '.join(effect.name for effect in interactions)}"
    elif scene.plates.wear or any(plate is not None and plate.surface is not None for plate in plates):
        reason = "the interaction of spots on rough plates is not built: the plates must be flat"
    elif scene.domain.walls:
        reason = "the interaction of spots does not tell side walls (domain.walls) from the lower plate"
    elif other:
        reason = f"the interaction of spots is that of Hertz' contacts, not of {', '.join(other)}"
    if reason:
        raise InputError(scene.fault(("effects", effect.name), reason))
    by_name = {material.name: material for material in materials}
    compliances = [0.0 if plate is None else effect.compliance(by_name[plate.material], options) for plate in plates]
    return np.array([*compliances, *(effect.stiffness(pair, options) for pair in pairs)], float)


def _pull_off_forces(laws: Sequence[Law], pairs: Sequence[Pair], values: Values) -> Callable[..., Any] | None:
    """Return the pull-off forces [N] of contacts by their pairs and effective radii [m], or None without adhesion."""
    law = next((law for law in laws if law.pull_off), None)
    if law is None or law.pull_off is None:
        return None
    rule, options = law.pull_off, values[law.name]

    def forces(kinds: np.ndarray, radius: np.ndarray) -> np.ndarray:
        result = np.zeros(len(radius))
        for k, pair in enumerate(pairs):
            result[kinds == k] = rule(pair, law.options_of(pair, options), radius[kinds == k])
        return result

    return forces


def _for_output(scene: Scene, labeller: Labeller | None) -> Labeller | None:
    """Return the labeller, without its forecasts where the scene has none of them written."""
    arrays = scene.output.arrays
    if labeller is None or labeller.label_without_forecasts is None or arrays is None or {*arrays} & {*labeller.forecasts}:
        return labeller
    return replace(labeller, label=labeller.label_without_forecasts, label_without_effects=None)
