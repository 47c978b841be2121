"""Composition of contact laws, body effects and labellers into one generated, compiled module each per scene.

The module of the contact laws is `tile_law.py` with another head: a constant for each thing that the chain has or has not, and a
function for each law that takes its parameters and its memory from the tile. It is called through a function pointer: as fast as
laws inlined by hand, while the engine is compiled once for all laws.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from types import ModuleType
from typing import Any

from thirdbody.kernels.arguments import LAW
from thirdbody.kernels.rolling_kinematics import MOMENTS, TWIST
from thirdbody.kernels.tables import body, body_extra
from thirdbody.kernels.tile import TILE, contact_tangent, law_input, law_output, rolling_input, rolling_output
from thirdbody.laws.contract import STAGES, STIFF, BodyEffect, Labeller, Law
from thirdbody.laws.generated import folded, load_module, plain

SPRINGS = {"tangential": ("force_x", "force_y"), "rolling": ("moment_x", "moment_y"), "twisting": ("moment",)}
"""Stages with springs, and the names of the forces or moments that their laws remember."""

LOSSES = {"plastic_work": "plastic", "adhesion_work": "adhesion"}
"""What a normal law that dissipates names this energy in its history, and its line of the ledger."""

ARGUMENTS = {
    "normal": "c", "damping": "c, n", "tangential": "c, load", "tangential_damping": "c, load", "rolling": "c, turn, load",
    "twisting": "c, twist, load",
}  # fmt: skip
"""What the law of a stage receives before its parameters; there may be several laws of adhesion."""

COLUMNS = {
    "TILE": TILE, "law_input": law_input, "law_output": law_output, "rolling_input": rolling_input,
    "rolling_output": rolling_output, "contact_tangent": contact_tangent,
}  # fmt: skip


@dataclass(frozen=True)
class Chain:
    """Laws of one scene; `law`, `stiffness` and `tangents` work on tiles, and are compiled when they are first used."""

    laws: tuple[Law, ...]

    def __deepcopy__(self, memo: dict[int, Any]) -> "Chain":
        return self  # nothing of it changes in a run

    @cached_property
    def module(self) -> ModuleType:
        functions = [part for law in self.laws for part in (law.kernel, law.tangent, law.added_load) if part]
        return load_module("law", law_text(self), functions)[0]

    def _compiled(self, name: str) -> Callable:
        """Compile for the signature of laws; numba searches its cache first."""
        function = getattr(self.module, name)
        if not getattr(function, "signatures", True):  # else compiled already, or the compiler is off
            function.compile(LAW)
            function.disable_compile()
        return function

    @cached_property
    def law(self) -> Callable:
        return self._compiled("law")

    @cached_property
    def stiffness(self) -> Callable | None:
        """What bounds a time step; None if a law has no tangent."""
        return self._compiled("stiffness") if all(law.tangent for law in self.laws if law.stage in STIFF) else None

    @cached_property
    def tangents(self) -> Callable | None:
        """Tangents with history, dashpots included, for the implicit integrator only; None if a law has no tangent."""
        return None if self.without_tangent else self._compiled("tangents")

    @cached_property
    def history(self) -> tuple[str, ...]:
        """Names of all floats stored per contact: of the laws, the stored energy where no law has it, the forces of the dashpots
        packed into one number (`kernels.books`), and their moments in another if there is a law of the rolling or of the twisting
        stage."""
        names = tuple(f"{law.name}.{name}" for law in self.laws for name in law.memory())
        names += ("springs.energy",) if self.stored == len(names) else ()
        stages = {law.stage for law in self.laws}
        if stages & {"rolling", "twisting"}:
            return (*names, "viscous.force", "viscous.moment")
        return (*names, "viscous.force") if stages & {"damping", "tangential_damping"} else names

    @property
    def width(self) -> int:
        """Number of parameters per material pair, at least one; the last one of a chain that `jumps` is the integrator."""
        return max(sum(len(fields_of(law)) for law in self.laws) + self.jumps, 1)

    @property
    def without_tangent(self) -> tuple[str, ...]:
        """Names of the laws without the tangent that they require: they run in the explicit integrator only."""
        return tuple(law.name for law in self.laws if law.tangent is None and (law.stage in STIFF or law.reach))

    @property
    def reaching(self) -> tuple[str, ...]:
        return tuple(law.name for law in self.laws if law.reach)

    @property
    def jumps(self) -> bool:
        """Whether a force jumps as bodies touch or part: then laws see the overlap gained in the step."""
        return any(law.in_steps or (law.stage == "adhesion" and not law.reach) for law in self.laws)

    def first_of(self, law: Law) -> int:
        """Column of the history where the memory of a law begins."""
        return sum(len(other.memory()) for other in self.laws[: self.laws.index(law)])

    @property
    def force_columns(self) -> tuple[int, int, int]:
        """Columns of the tangential force, of the rolling moment and of the moment about the normal in the history. Moment -1: no
        law of that stage. Force -1: a law of these stages does not name its stored force as in `SPRINGS`."""
        columns = dict.fromkeys(SPRINGS, -1)
        for law in self.laws:
            if names := SPRINGS.get(law.stage):
                starts = [i for i in range(len(law.history)) if law.history[i : i + len(names)] == names]
                if not starts:
                    return -1, -1, -1
                columns[law.stage] = self.first_of(law) + starts[0]
        return columns["tangential"], columns["rolling"], columns["twisting"]

    @cached_property
    def field(self) -> tuple[int, int]:
        """First column of the field in the history, and the number of its floats; without a field the end and 0."""
        for law in self.laws:
            if law.field:
                return self.first_of(law) + len(law.history), len(law.memory()) - len(law.history)
        return len(self.history), 0

    @cached_property
    def stored(self) -> int:
        """Column of the history with the energy of all springs but the normal one: the law's own `energy` where one law has them
        all, else one after the histories of all laws; -1: the chain has no such springs."""
        springs = [law for law in self.laws if law.stage in SPRINGS]
        if len(springs) == 1 and "energy" in springs[0].history:
            return self.first_of(springs[0]) + springs[0].history.index("energy")
        return sum(len(law.memory()) for law in self.laws) if springs else -1

    @property
    def dashpots(self) -> int:
        """First column of the dashpot forces in the history; -1 if there are none."""
        return self.history.index("viscous.force") if "viscous.force" in self.history else -1

    @property
    def loss_column(self) -> int:
        """Column of the history with the energy that the normal law has dissipated since the contact closed; -1: it does not."""
        return next((k for k, name in enumerate(self.laws[0].history) if name in LOSSES), -1)

    @property
    def loss(self) -> str:
        return LOSSES[self.laws[0].history[self.loss_column]] if self.loss_column >= 0 else ""

    @property
    def rolling(self) -> int:
        """Relative rotation required by the laws: `MOMENTS`, 1 for the travel of the contact area only, or 0; plus `TWIST`."""
        stages = {law.stage for law in self.laws}
        turn = MOMENTS if "rolling" in stages else int(any(law.rolls for law in self.laws))
        return turn + (TWIST if "twisting" in stages else 0)


def ordered(laws: Iterable[Law]) -> tuple[Law, ...]:
    """Return the laws in the order of their stages; any number for adhesion. Raises ValueError when the normal stage is empty,
    another has two laws, a law that is not tangential has a field, or a law assumes another normal law."""
    chain = tuple(sorted(laws, key=lambda law: STAGES.index(law.stage)))
    for stage in STAGES:
        names = [law.name for law in chain if law.stage == stage]
        if len(names) > 1 and stage != "adhesion":
            instead = "; a law declared with `replaces` takes the place of another" if stage in ("normal", "tangential") else ""
            raise ValueError(f"two laws for the {stage} stage: {', '.join(names)}{instead}")
        if stage == "normal" and not names:
            raise ValueError("no law for the normal stage")
    for law in chain:
        if law.field and law.stage != "tangential":
            raise ValueError(f"the law '{law.name}' of the {law.stage} stage has a field: only a tangential law may")
        if law.assumes not in ("", chain[0].name):
            which = f"'{law.assumes}', not '{chain[0].name}'; take another level, or leave '{chain[0].name}' out"
            raise ValueError(f"the law '{law.name}' assumes the normal law {which}")
    return chain


def compose(laws: Iterable[Law]) -> Chain:
    """Compile the chain of contact laws; raises ValueError as `ordered` does."""
    chain = Chain(ordered(laws))
    _ = chain.law, chain.stiffness  # compiled now, so that a fault in a law is raised here
    return chain


def fields_of(part: Any) -> tuple[str, ...]:
    return tuple(part.parameters._fields)


# -- contact laws


def law_text(chain: Chain) -> str:
    imports, _, rest = Path(__file__).with_name("tile_law.py").read_text(encoding="utf-8").partition("# -- head\n")
    laws, (first, size) = chain.laws, chain.field
    counts = {law.stage: len(law.history) for law in laws}
    # what the chain has and has not, as in the head of `tile_law.py`
    constants: dict[str, Any] = {f"HAS_{stage.upper()}": stage in counts for stage in STAGES[1:]} | {
        "WIDTH": chain.width, "MEMORY": len(chain.history), "FIELD": size, "FIELD_FIRST": first,
        "HAS_ADDED_LOAD": any(law.added_load is not None for law in laws), "HAS_REACH": bool(chain.reaching),
        "ATTRACTS": laws[0].reach is not None, "JUMPS": chain.jumps, "ROLLS": any(law.rolls for law in laws),
        "REMEMBERS": bool(laws[0].history), "ADDS_ENERGY": "springs.energy" in chain.history,
        "VIRGIN": tuple((0.0,) * counts.get(stage, 0) for stage in ("normal", *SPRINGS)),
    }  # fmt: skip
    lines = [*import_lines(laws), *(f"{name} = {value}" for name, value in constants.items()), *_adapters(chain), "", ""]
    body_text = folded(rest.partition("# -- body\n")[2], constants | COLUMNS)
    return f"# generated: {' > '.join(law.name for law in laws)}\n{imports}" + "\n".join(lines) + body_text


def import_lines(parts: Sequence[Any]) -> Iterator[str]:
    for k, part in enumerate(parts):
        for name in ("kernel", "tangent", "added_load"):
            if source := plain(getattr(part, name, None)):
                yield f"from {source.__module__} import {source.__name__} as {name}_{k}"
                yield f"{name}_{k} = as_kernel({name}_{k})"
        yield f"from {part.parameters.__module__} import {part.parameters.__name__} as parameters_{k}"


def _adapters(chain: Chain) -> Iterator[str]:
    memory, store = list[str](), list[str]()
    for stage in ("normal", *SPRINGS):
        law = next((law for law in chain.laws if law.stage == stage and law.history), None)
        memory.append(f"({_memory(chain, law)})" if law else "()")
        store += _stored(chain, law, stage) if law else []
    yield from _function("memory", "I, q", [f"return {', '.join(memory)}"])
    yield from _function("store", "O, q, normal, tangential, rolling, twisting", store or ["pass"])
    for k, law in enumerate(chain.laws):
        if law.stage == "adhesion":
            continue
        given, p = ARGUMENTS[law.stage], _parameters(chain, k)
        if law.stage not in ("normal", *SPRINGS):
            yield from _function(law.stage, f"{given}, U, q", [f"return kernel_{k}({given}, {p})"])
            continue
        field, new = ("w, ", "w_new, ") if law.stage == "tangential" else ("", "")
        h, w, w_new = (", h" if law.history else ""), (", w" if law.field else ""), (", w_new" if law.field else "")
        call = f"kernel_{k}({given}, {p}{h}{w}{w_new})"
        yield from _function(law.stage, f"{given}, h, {field}{new}U, q", [f"return {call if h else f'{call}, h'}"])
        if law.tangent:
            yield from _function(f"{law.stage}_tangent", f"{given}, h, {field}U, q", [f"return tangent_{k}({given}, {p}{h}{w})"])
    yield from _adhesion(chain)


def _adhesion(chain: Chain) -> Iterator[str]:
    """Yield the functions that sum over all laws of adhesion, and over the loads that only friction feels."""
    forces, tangents, bounds, loads = ["force, stored = sums"], list[str](), list[str](), list[str]()
    for k, law in enumerate(chain.laws):
        p, contact, h = _parameters(chain, k), "far" if law.reach else "c", _memory(chain, law)
        if law.added_load:
            loads.append(f"load += added_load_{k}({contact}, n, {p})")
        if law.stage != "adhesion":
            continue
        given = f"{contact}, n, {p}" + (f", ({h})" if h else "")
        virgin = f"{contact}, n, {p}" + (f", ({'0.0, ' * len(law.history)})" if h else "")
        forces.append(f"a{', h' if h else ''} = kernel_{k}({given})")
        forces += _stored(chain, law, "h")
        forces += [f"force += a.force{'' if law.reach else ' * step_fraction(c, I, U, q)'}", "stored += a.stored"]
        if law.tangent and not law.reach:
            tangents.append(f"k_n += tangent_{k}({given}) * step_fraction(c, I, U, q)")
            tangents.append(f"k_n += kernel_{k}({given}){'[0]' if h else ''}.force * touch_growth(c, U, q)")
        elif law.tangent:
            tangents.append(f"k_n += tangent_{k}({given})")
            bounds.append(f"k_n += abs(tangent_{k}({virgin}))")
    if len(forces) > 1:
        yield from _function("adhesion", "c, far, n, sums, I, O, U, q", [*forces, "return force, stored"])
        yield from _function("adhesion_tangent", "c, far, n, k_n, I, U, q", [*tangents, "return k_n"])
        yield from _function("adhesion_stiffness", "far, n, k_n, U, q", [*bounds, "return k_n"])
    if loads:
        yield from _function("added_load", "load, c, far, n, U, q", [*loads, "return load"])


def _function(name: str, arguments: str, lines: Sequence[str]) -> list[str]:
    return ["", "", "@njit(**INNER)", f"def {name}({arguments}):", *(f"    {line}" for line in lines)]


def _parameters(chain: Chain, k: int) -> str:
    begin, count = (sum(len(fields_of(law)) for law in laws) for laws in (chain.laws[:k], chain.laws[k : k + 1]))
    return f"parameters_{k}({', '.join(f'U[q + {column * TILE}]' for column in range(begin, begin + count))})"


def _memory(chain: Chain, law: Law) -> str:
    first = law_input.HISTORY + chain.first_of(law)
    return "".join(f"I[q + {column * TILE}], " for column in range(first, first + len(law.history)))


def _stored(chain: Chain, law: Law, new: str) -> list[str]:
    return [f"O[q + {(law_output.HISTORY + chain.first_of(law) + i) * TILE}] = {new}[{i}]" for i in range(len(law.history))]


# -- body effects and labellers

HEAD = """# generated: {}
from numba import njit
from thirdbody.jit.options import OPTIONS, OTHERS
from thirdbody.kernels.arguments import EFFECTS, LABEL, MEASURE, OBSERVE
from thirdbody.laws.data import Body, Wrench
from thirdbody.laws.generated import as_kernel, as_own
"""

LOOP = f"""

@njit(EFFECTS, **OPTIONS)
def effects(B, E, first, last, time, dt, parameters):
    for i in range(first, last):
        mean = (E[i, {body_extra.INERTIA}] + E[i, {body_extra.INERTIA + 1}] + E[i, {body_extra.INERTIA + 2}]) / 3.0
        b = Body(B[i, {body.MASS}], B[i, {body.POSITION}], B[i, {body.POSITION + 1}], B[i, {body.POSITION + 2}],
                 B[i, {body.VELOCITY}], B[i, {body.VELOCITY + 1}], B[i, {body.VELOCITY + 2}],
                 B[i, {body.SPIN}], B[i, {body.SPIN + 1}], B[i, {body.SPIN + 2}], mean, time)
"""


def compose_effects(effects: Sequence[BodyEffect]) -> Callable:
    """Compile the loop over bodies that applies these effects in order, each with its own parameters. Effects that see forces
    come last, with the force of the contacts and the others, and the body after the closing half kick of these: else a force
    opposing the motion would make a body tremble instead of bringing it to rest. The end of settling [s] follows all parameters
    if any effect is for settling."""
    counts = [len(fields_of(effect)) for effect in effects]

    def total(k: int, chosen: Iterable[int]) -> str:
        return "".join(f" + e{i}[{k}]" for i in chosen)

    early = [k for k, effect in enumerate(effects) if not effect.sees_forces]
    forces = [*range(body.FORCE, body.FORCE + 3), *range(body.TORQUE, body.TORQUE + 3)]
    wrench = ", ".join(f"B[i, {column}]{total(k, early)}" for k, column in enumerate(forces))
    moved = ", ".join(f"b[{4 + k}] + 0.5 * dt / {'mean' if k > 2 else 'b.mass'} * (0.0{total(k, early)})" for k in range(6))
    lines = []
    for k, effect in sorted(enumerate(effects), key=lambda entry: entry[1].sees_forces):
        values = ", ".join(f"parameters[{sum(counts[:k]) + i}]" for i in range(counts[k]))
        state = f"Body(b.mass, b.x, b.y, b.z, {moved}, mean, time), Wrench({wrench})" if effect.sees_forces else "b"
        until = f" if time < parameters[{sum(counts)}] else Wrench(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)" if effect.settling else ""
        lines.append(f"        e{k} = kernel_{k}({state}, parameters_{k}({values})){until}")
    results = [body_extra.EFFECT_FORCE + d for d in range(3)] + [body_extra.EFFECT_TORQUE + d for d in range(3)]
    lines += [f"        E[i, {column}] = {total(k, range(len(effects)))[3:] or 0.0}" for k, column in enumerate(results)]
    head = HEAD.format(" + ".join(effect.name for effect in effects)) + "\n".join(import_lines(effects))
    return load_module("effects", head + LOOP + "\n".join(lines) + "\n", [effect.kernel for effect in effects])[0].effects


def compose_labeller(labeller: Labeller, effects: bool = True) -> tuple[Callable, Callable]:
    """Compile `observe` and `label` with the engine's signatures; `effects`: whether effects may act on bodies. The generated
    module copies their code: wrappers would compile all twice."""
    text = HEAD.format(labeller.name)
    chosen = labeller.label if effects else labeller.label_without_effects or labeller.label
    for name, kernel in (("observe", labeller.observe), ("label", chosen)):
        function = plain(kernel)
        text += f"from {function.__module__} import {function.__name__} as {name}_kernel\n"
        text += f'{name} = njit({name.upper()}, **OTHERS)(as_own({name}_kernel, "{name}", globals()))\n'
    module = load_module("labeller", text, [labeller.observe, chosen])[0]
    return module.observe, module.label
