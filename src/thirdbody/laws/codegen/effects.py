"""Composition of body effects and labellers into generated, compiled modules, as `compose` does with contact laws."""

from collections.abc import Callable, Sequence

from thirdbody.kernels.tables import body, body_extra
from thirdbody.laws.codegen.dependencies import plain
from thirdbody.laws.codegen.fragments import HEAD, field_names, imports_of, tuples_for
from thirdbody.laws.codegen.module_cache import load_module
from thirdbody.laws.contract import BodyEffect, Labeller


def compose_effects(effects: Sequence[BodyEffect]) -> Callable:
    """Compile the loop over bodies that applies these effects in order, each with its own parameters.

    Effects that see forces come last. The end of settling [s] follows all parameters if any effect is for settling.
    """
    lines: list[str] = []
    imports: list[str] = []
    counts = [len(field_names(effect.parameters)) for effect in effects]
    first = [k for k, effect in enumerate(effects) if not effect.sees_forces]
    for k, effect in sorted(enumerate(effects), key=lambda entry: entry[1].sees_forces):
        imports += imports_of(k, effect.kernel, effect.parameters)
        values = ", ".join(f"parameters[{sum(counts[:k]) + i}]" for i in range(counts[k]))
        arguments = f"{_late(first)}, {_total(first)}" if effect.sees_forces else "b"
        call = f"kernel_{k}({arguments}, parameters_{k}({values}))"
        until = f" if time < parameters[{sum(counts)}] else Wrench(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)" if effect.settling else ""
        lines.append(f"        e{k} = {call}{until}")
    sums = [f"{' + '.join(f'e{k}[{i}]' for k in range(len(effects)))}" for i in range(6)]
    columns = (
        *range(body_extra.EFFECT_FORCE, body_extra.EFFECT_FORCE + 3),
        *range(body_extra.EFFECT_TORQUE, body_extra.EFFECT_TORQUE + 3),
    )
    lines += [f"        E[i, {column}] = {total or 0.0}" for column, total in zip(columns, sums, strict=True)]
    loop = f"""@njit(EFFECTS, **OPTIONS)
def effects(B, E, first, last, time, dt, parameters):
    for i in range(first, last):
        mean = (E[i, {body_extra.INERTIA}] + E[i, {body_extra.INERTIA + 1}] + E[i, {body_extra.INERTIA + 2}]) / 3.0
        b = Body(B[i, {body.MASS}], B[i, {body.POSITION}], B[i, {body.POSITION + 1}], B[i, {body.POSITION + 2}],
                 B[i, {body.VELOCITY}], B[i, {body.VELOCITY + 1}], B[i, {body.VELOCITY + 2}],
                 B[i, {body.SPIN}], B[i, {body.SPIN + 1}], B[i, {body.SPIN + 2}], mean, time)
""" + "\n".join(lines)
    title = " + ".join(effect.name for effect in effects)
    text = HEAD.format(title=title, tuples=tuples_for(()), imports="\n".join(imports)) + loop + "\n"
    module, _ = load_module("effects", text, [effect.kernel for effect in effects])
    return module.effects


def _sum(effects: Sequence[int], component: int) -> str:
    return "".join(f" + e{k}[{component}]" for k in effects)


def _total(effects: Sequence[int]) -> str:
    """Force and torque of the contacts, which the table contains when effects are evaluated, plus those of these effects."""
    columns = (*range(body.FORCE, body.FORCE + 3), *range(body.TORQUE, body.TORQUE + 3))
    parts = [f"B[i, {column}]{_sum(effects, k)}" for k, column in enumerate(columns)]
    return f"Wrench({', '.join(parts)})"


def _late(effects: Sequence[int]) -> str:
    """Body after the closing half kick of these effects.

    Without it the sign of the velocity has a bias of g dt/2, and a force opposing the motion would make a body tremble instead of
    bringing it to rest.
    """
    half_kicks = [f"b[{4 + k}] + 0.5 * dt / {'mean' if k > 2 else 'b.mass'} * (0.0{_sum(effects, k)})" for k in range(6)]
    return f"Body(b.mass, b.x, b.y, b.z, {', '.join(half_kicks)}, mean, time)"


OWN = """
from types import FunctionType
from numba import njit
from thirdbody.jit.options import OTHERS
from thirdbody.kernels.signatures import LABEL, OBSERVE
from thirdbody.laws.codegen.dependencies import plain


def own(function, name):
    # as one of this module to numba's cache, which goes by file and name
    function = plain(function)
    copy = FunctionType(function.__code__.replace(co_filename=__file__), function.__globals__, name)
    copy.__module__, copy.__qualname__ = __name__, name
    return copy


"""


def compose_labeller(labeller: Labeller, effects: bool = True) -> tuple[Callable, Callable]:
    """Compile `observe` and `label` with the engine's signatures; `effects`: whether effects may act on bodies.

    The generated module copies their code: through wrappers that call them all code would be compiled twice.
    """
    text = "# generated: " + labeller.name + OWN
    chosen = labeller.label if effects else labeller.label_without_effects or labeller.label
    for name, kernel in (("observe", labeller.observe), ("label", chosen)):
        function = plain(kernel)
        text += f"from {function.__module__} import {function.__name__} as {name}_kernel\n"
    for name in ("observe", "label"):
        text += f'{name} = njit({name.upper()}, **OTHERS)(own({name}_kernel, "{name}"))\n'
    module, _ = load_module("labeller", text, [labeller.observe, chosen])
    return module.observe, module.label
