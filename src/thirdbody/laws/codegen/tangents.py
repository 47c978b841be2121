"""Tangents of a chain of laws as generated text, for implicit solvers."""

from collections.abc import Sequence

from thirdbody.kernels.columns import contact_tangent, law_input, rolling_input
from thirdbody.laws.codegen.fragments import (
    STILL,
    call_without_history,
    contact_of,
    field_of,
    head_of,
    history_arguments,
    memory_names,
    parameters_of,
    tile_function,
)
from thirdbody.laws.contract import Law


def tangent_module(chain: Sequence[Law]) -> str:
    """Return the text of the module with the function `tangents`."""
    return head_of(chain) + _tangent_function(chain)


def _tangent_function(chain: Sequence[Law]) -> str:
    """Tangents with history: of the normal force with adhesion, of the tangential law, of the rolling one (`contact_tangent`).

    Dashpots contribute with 1/dt, which the tile holds after the history: a step that closes a contact by dd changes its speed by
    dd/dt. A viscous tangential force that is reduced by the limit contributes nothing.
    """
    stages = {law.stage: k for k, law in enumerate(chain)}
    k = stages["normal"]
    before, memory = history_arguments(chain, k)
    lines = [*before, f"        p{k} = {parameters_of(chain, k)}", f"        k_n = tangent_{k}(c, p{k}{memory})"]
    lines.append(f"        n = kernel_{k}(c, p{k}{memory})" + ("[0]" if memory else ""))
    behind = law_input.HISTORY + len(memory_names(chain))
    lines.append(f"        rate = I[{field_of(behind + rolling_input.INVERSE_DT)}]")
    lines += _damped_lines(chain, stages)
    for k, law in enumerate(chain):
        if law.stage == "adhesion" and law.tangent is not None:
            before, memory = history_arguments(chain, k)
            lines += [*before, f"        p{k} = {parameters_of(chain, k)}", f"        k_n += tangent_{k}(c, n, p{k}{memory})"]
    lines.append("        t, back = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0), 0.0")
    if "tangential" in stages:
        lines += _remembering(chain, stages["tangential"], "t", "c, load")
    if "tangential_damping" in stages and "tangential" in stages:
        lines += _dragged_lines(chain, stages)
    lines.append(f"        O[{field_of(contact_tangent.NORMAL)}] = k_n")
    lines += [f"        O[{field_of(contact_tangent.XX + i)}] = t[{i}]{' - back' if i in (0, 3) else ''}" for i in range(6)]
    if "rolling" in stages:
        k = stages["rolling"]
        rotation = ", ".join(
            f"I[{field_of(behind + i)}]"
            for i in (rolling_input.TURN_X, rolling_input.TURN_Y, rolling_input.RATE_X, rolling_input.RATE_Y)
        )
        lines += [f"        turn = Turn({rotation})", *_remembering(chain, k, "m", "c, turn, load")]
        lines += call_without_history(chain, k, f"c, {STILL}, load", "r")
        viscous = " - r.viscosity * rate"
        lines += [
            f"        O[{field_of(contact_tangent.ROLLING + i)}] = m[{i}]{viscous if i in (0, 3) else ''}" for i in range(6)
        ]
    return tile_function("tangents", chain, contact_of(chain), lines)


def _remembering(chain: Sequence[Law], k: int, name: str, arguments: str) -> list[str]:
    """Lines that call the tangent of law k with its memory."""
    before, memory = history_arguments(chain, k)
    return [*before, f"        p{k} = {parameters_of(chain, k)}", f"        {name} = tangent_{k}({arguments}, p{k}{memory})"]


def _damped_lines(chain: Sequence[Law], stages: dict[str, int]) -> list[str]:
    """Lines for the load and its stiffness, with the dashpot: its coefficient is the viscous force of an approach at 1 m/s."""
    if "damping" not in stages:
        return ["        load = Load(n.force, n.force, n.contact_radius, k_n, n.squared_radius_rate)"]
    k = stages["damping"]
    closing = "Contact(c.overlap, c.radius, c.mass, -1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)"
    lines = call_without_history(chain, k, "c, n", "viscous") + call_without_history(chain, k, f"{closing}, n", "c_n")
    # where the dashpot would pull, the whole force is clipped to zero
    lines.append("        force = max(n.force + viscous, 0.0)")
    lines.append("        k_n = k_n + c_n * rate if force > 0.0 else 0.0")
    return [*lines, "        load = Load(force, n.force, n.contact_radius, k_n, n.squared_radius_rate)"]


def _dragged_lines(chain: Sequence[Law], stages: dict[str, int]) -> list[str]:
    """Lines for the tangential dashpot where all of it acts: where spring and dashpot together stay within the limit."""
    k, d = stages["tangential"], stages["tangential_damping"]
    field = ", w_new" if len(chain[k].memory()) > len(chain[k].history) else ""
    memory = history_arguments(chain, k)[1]
    first = "[0]" if memory else ""
    lines = [f"        s = kernel_{k}(c, load, p{k}{memory}{field}){first}"]
    lines += call_without_history(chain, d, "c, load", "viscosity")
    lines.append("        x, y = s.x - viscosity * c.v_x, s.y - viscosity * c.v_y")
    return [*lines, "        back = viscosity * rate if x * x + y * y < s.limit * s.limit else 0.0"]
