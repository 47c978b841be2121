"""Composition of contact laws into one generated, compiled module per scene.

The module name contains a hash of its text and of every source file it depends on, because numba's own cache watches only the
file of the compiled function: an edited law gives another module, never a stale result. The module is called through a function
pointer: as fast as laws inlined by hand, while the engine is compiled once for all laws.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from thirdbody.kernels.columns import law_input, law_output, rolling_input, rolling_output
from thirdbody.kernels.columns.tile import TILE
from thirdbody.kernels.rolling_kinematics import MOMENTS
from thirdbody.laws.codegen.fragments import (
    STILL,
    call_without_history,
    contact_of,
    empty_history,
    energy_column,
    field_of,
    head_of,
    history_arguments,
    history_of,
    memory_names,
    parameters_of,
    seen_by,
    tile_function,
    viscous_names,
    width_of,
)
from thirdbody.laws.codegen.module_cache import load_module
from thirdbody.laws.contract import STAGES, STIFF, Law


@dataclass(frozen=True)
class Chain:
    """Compiled laws of one scene.

    `law`, `stiffness` and `tangents` work on tiles; `width` is the number of parameters per pair; `history` names all floats
    stored per contact, fields included.
    """

    laws: tuple[Law, ...]
    law: Callable
    stiffness: Callable | None
    history: tuple[str, ...]
    width: int
    path: Path

    @cached_property
    def tangents(self) -> Callable | None:
        """Tangents with history, dashpots included (`tangents`); None if a law has no tangent, or acts before the bodies touch.

        Compiled on first use: the explicit integrator never needs them.
        """
        if self.stiffness is None or self.reaching:
            return None
        from thirdbody.laws.codegen.tangents import tangent_module

        return load_module("tangents", tangent_module(self.laws), _functions(self.laws))[0].tangents

    @property
    def without_tangent(self) -> tuple[str, ...]:
        """Names of the laws without the tangent that their stage requires: they run in the explicit integrator only."""
        return tuple(law.name for law in self.laws if law.tangent is None and law.stage in STIFF)

    @property
    def reaching(self) -> tuple[str, ...]:
        """Names of the laws that act before the bodies touch: they run in the explicit integrator only."""
        return tuple(law.name for law in self.laws if law.reach)

    @property
    def remembered_forces(self) -> tuple[int, int]:
        """Columns of the tangential force and of the rolling moment in the history.

        Moment -1: no law of that stage. Force -1: a law of these stages does not name its stored force `force_x, force_y` (moment
        `moment_x, moment_y`).
        """
        stages = {law.stage: k for k, law in enumerate(self.laws)}
        places = []
        for stage, names in (("tangential", ("force_x", "force_y")), ("rolling", ("moment_x", "moment_y"))):
            if stage not in stages:
                places.append(-1)
                continue
            law = self.laws[stages[stage]]
            result = [i for i in range(len(law.history)) if law.history[i : i + 2] == names]
            if not result:
                return -1, -1
            places.append(history_of(self.laws, stages[stage])[0] + result[0])
        return places[0], places[1]

    @property
    def stored(self) -> int:
        """Column of the energy stored by tangential and rolling springs in the history; -1 if there is none."""
        return energy_column(self.laws)

    @property
    def dashpots(self) -> int:
        """First column of the dashpot forces in the history; -1 if there are none."""
        count = len(viscous_names(self.laws))
        return len(self.history) - count if count else -1

    @property
    def rolling(self) -> int:
        """Relative rotation required by the laws.

        `kernels.rolling_kinematics.MOMENTS`, 1 for the travel of the contact area only, or 0.
        """
        if any(law.stage == "rolling" for law in self.laws):
            return MOMENTS
        return int(any(law.rolls for law in self.laws))


def ordered(laws: Iterable[Law]) -> tuple[Law, ...]:
    """Return the laws in the order of their stages; one law per stage, any number for adhesion.

    Raises ValueError when the normal stage is empty, a stage has two laws, or a law assumes another normal law.
    """
    chain = tuple(sorted(laws, key=lambda law: STAGES.index(law.stage)))
    for stage in STAGES:
        names = [law.name for law in chain if law.stage == stage]
        if len(names) > 1 and stage != "adhesion":
            raise ValueError(f"two laws for the {stage} stage: {', '.join(names)}")
        if stage == "normal" and not names:
            raise ValueError("no law for the normal stage")
    for law in chain:
        if law.assumes not in ("", chain[0].name):
            raise ValueError(f"the law '{law.name}' assumes the normal law '{law.assumes}', not '{chain[0].name}'")
    return chain


def compose(laws: Iterable[Law]) -> Chain:
    """Compile the chain of contact laws; raises ValueError as `ordered` does."""
    chain = ordered(laws)
    text = _contact_module(chain)
    module, path = load_module("law", text, _functions(chain))
    return Chain(chain, module.law, getattr(module, "stiffness", None), memory_names(chain), width_of(chain), path)


def _functions(chain: Sequence[Law]) -> list[Callable]:
    """Return all functions on which a module generated from these laws depends."""
    return [law.kernel for law in chain] + [law.tangent for law in chain if law.tangent]


def _contact_module(chain: Sequence[Law]) -> str:
    text = head_of(chain) + _law_function(chain)
    if all(law.tangent is not None for law in chain if law.stage in STIFF):
        text += "\n\n" + _stiffness_function(chain)
    return text


def _call(chain: Sequence[Law], k: int, arguments: str, answer: str) -> list[str]:
    """Lines that call law k and, if it has a memory, read and write it."""
    start, count = history_of(chain, k)
    lines = [f"        p{k} = {parameters_of(chain, k)}"]
    if not count:
        return lines + [f"        {answer} = kernel_{k}({arguments}, p{k})"]
    before, memory = history_arguments(chain, k)
    size = len(chain[k].memory()) - count
    lines += [*before, f"        {answer}, h{k} = kernel_{k}({arguments}, p{k}{memory}{', w_new' if size else ''})"]
    lines += [f"        O[{field_of(law_output.HISTORY + start + i)}] = h{k}[{i}]" for i in range(count)]
    if size:
        to = f"q + (f + {law_output.HISTORY + start + count}) * {TILE}"
        lines += [f"        for f in range({size}):", f"            O[{to}] = w_new[f]"]
    return lines


def _law_function(chain: Sequence[Law]) -> str:
    stages = {law.stage: k for k, law in enumerate(chain)}
    pulls = chain[0].reach is not None  # the normal force may be negative
    lines = _call(chain, stages["normal"], seen_by(chain[0]), "n")
    lines.append("        elastic, stored, work, lost = n.force, n.stored, n.dissipated, 0.0")
    if "damping" in stages:
        lines += _call(chain, stages["damping"], "c, n", "viscous")
        # clipped: a dashpot may unload the contact but never pull
        lowest = "min(elastic, 0.0)" if pulls else "0.0"
        lines += [f"        force = max(elastic + viscous, {lowest})", "        power = -(force - elastic) * c.v_n"]
    else:
        lines += ["        force = elastic", "        power = 0.0"]
    lines += ["        viscous_n, tv_x, tv_y, mv_x, mv_y = force - elastic, 0.0, 0.0, 0.0, 0.0"]
    lines.append(f"        load = Load({'max(force, 0.0)' if pulls else 'force'}, elastic, n.contact_radius, 0.0, 0.0)")
    for k, law in enumerate(chain):
        if law.stage == "adhesion":
            lines += _call(chain, k, f"{seen_by(law)}, n", f"a{k}")
            lines += [f"        force += a{k}.force", f"        stored += a{k}.stored"]
    lines += _tangential_lines(chain, stages)
    if "rolling" in stages:
        lines += _rolling_lines(chain, stages["rolling"])
    outputs = {
        law_output.NORMAL_FORCE: "force",
        law_output.TANGENTIAL_X: "t_x",
        law_output.TANGENTIAL_Y: "t_y",
        law_output.LOAD: "load.force",
        law_output.FRICTION_LIMIT: "limit",
        law_output.CRITICAL_SLIP: "critical",
        law_output.SLIP: "slip",
        law_output.CONTACT_RADIUS: "n.contact_radius",
        law_output.PEAK_PRESSURE: "n.peak_pressure",
        law_output.STORED_NORMAL: "stored",
        law_output.STORED_TANGENTIAL: "stored_t",
        law_output.DISSIPATED: "work",
        law_output.FRICTION_LOSS: "lost",
        law_output.DASHPOT_POWER: "power",
    }
    lines += [f"        O[{field_of(i)}] = {value}" for i, value in outputs.items()]
    own = sum(len(law.memory()) for law in chain)
    if energy_column(chain) == own:
        lines.append(f"        O[{field_of(law_output.HISTORY + own)}] = stored_t")
    return tile_function("law", chain, contact_of(chain), lines + _viscous_lines(chain))


def _viscous_lines(chain: Sequence[Law]) -> list[str]:
    """Lines that write forces and moment of the dashpots after the history.

    Their stored columns are set to zero here and filled by the caller.
    """
    history, saved = len(memory_names(chain)), len(viscous_names(chain))
    outputs = (
        {rolling_output.VISCOUS_NORMAL: "viscous_n", rolling_output.VISCOUS_X: "tv_x", rolling_output.VISCOUS_Y: "tv_y"}
        if saved
        else {}
    )
    outputs |= {rolling_output.VISCOUS_MOMENT_X: "mv_x", rolling_output.VISCOUS_MOMENT_Y: "mv_y"} if saved > 1 else {}
    lines = [f"        O[{field_of(law_output.HISTORY + history - saved + i)}] = 0.0" for i in range(saved)]
    return lines + [f"        O[{field_of(law_output.HISTORY + history + i)}] = {value}" for i, value in outputs.items()]


def _tangential_lines(chain: Sequence[Law], stages: dict[str, int]) -> list[str]:
    if "tangential" not in stages:
        return [
            "        t_x, t_y, limit, critical, stored_t = 0.0, 0.0, 0.0, 0.0, 0.0",
            "        slip = math.sqrt(c.slip_x * c.slip_x + c.slip_y * c.slip_y)",
        ]
    lines = _call(chain, stages["tangential"], "c, load", "t")
    lines.append("        t_x, t_y, limit, critical, slip, stored_t = t.x, t.y, t.limit, t.critical, t.slip, t.stored")
    lines.append("        work, lost = work + t.dissipated, t.dissipated")
    if "tangential_damping" in stages:
        k = stages["tangential_damping"]
        lines += _call(chain, k, "c, load", "viscosity")
        lines += _fitted("t_x", "t_y", "viscosity", "c.v", "limit", "t")
    return lines


def _rolling_lines(chain: Sequence[Law], k: int) -> list[str]:
    """Lines for the moment, whose columns follow the history.

    The energy of its spring and its losses are added to those of friction.
    """
    history = len(memory_names(chain))
    rotation = ", ".join(
        f"I[{field_of(law_input.HISTORY + history + i)}]"
        for i in (rolling_input.TURN_X, rolling_input.TURN_Y, rolling_input.RATE_X, rolling_input.RATE_Y)
    )
    lines = [f"        turn = Turn({rotation})", *_call(chain, k, "c, turn, load", "r")]
    lines += _fitted("r.x", "r.y", "r.viscosity", "turn.w", "r.limit", "m")
    lines += ["        stored_t += r.stored", "        work, lost = work + r.dissipated, lost + r.dissipated"]
    outputs = {rolling_output.MOMENT_X: "m_x", rolling_output.MOMENT_Y: "m_y", rolling_output.MOMENT_LIMIT: "r.limit"}
    return lines + [f"        O[{field_of(law_output.HISTORY + history + i)}] = {value}" for i, value in outputs.items()]


def _fitted(x: str, y: str, viscosity: str, rate: str, limit: str, name: str) -> list[str]:
    """Lines for `name`_x, `name`_y: (x, y) plus the viscous part d, limited.

    The largest fraction s in [0, 1] of d is added for which |t + s d| is within the limit.
    """
    return [
        f"        {name}_x, {name}_y = {x}, {y}",
        f"        d_x, d_y = -{viscosity} * {rate}_x, -{viscosity} * {rate}_y",
        f"        dd, td = d_x * d_x + d_y * d_y, {name}_x * d_x + {name}_y * d_y",
        f"        room = max({limit} * {limit} - {name}_x * {name}_x - {name}_y * {name}_y, 0.0)",
        "        share = min(max((math.sqrt(td * td + dd * room) - td) / max(dd, 1e-300), 0.0), 1.0)",
        f"        {name}v_x, {name}v_y = share * d_x, share * d_y",
        f"        {name}_x += {name}v_x",
        f"        {name}_y += {name}v_y",
        f"        power -= {name}v_x * {rate}_x + {name}v_y * {rate}_y",
    ]


def _stiffness_function(chain: Sequence[Law]) -> str:
    """Function for the bounds of the time step: stiffness and dashpots of a tile.

    Normal, virgin tangential and rolling stiffness, then the coefficients of the dashpots: the tile holds an approach at 1 m/s,
    so the viscous force is the coefficient.
    """
    stages = {law.stage: k for k, law in enumerate(chain)}
    k = stages["normal"]
    zeros = "(" + "0.0, " * history_of(chain, k)[1] + ")" if history_of(chain, k)[1] else ""
    lines = [f"        p{k} = {parameters_of(chain, k)}"]
    arguments = f"{seen_by(chain[k])}, p{k}" + (f", {zeros}" if zeros else "")
    lines.append(f"        k_n = tangent_{k}({arguments})")
    lines.append(f"        n = kernel_{k}({arguments})" + ("[0]" if zeros else ""))
    if chain[k].reach:
        lines.append("        k_n = abs(k_n)")
    for a, law in enumerate(chain):
        if law.reach and law.stage == "adhesion" and law.tangent is not None:
            lines += [f"        p{a} = {parameters_of(chain, a)}"]
            lines += [f"        k_n += abs(tangent_{a}({seen_by(law)}, n, p{a}{empty_history(chain, a)}))"]
    lines.append("        c_n, c_t, c_r = 0.0, 0.0, 0.0")
    lines.append("        load = Load(n.force, n.force, n.contact_radius, k_n, n.squared_radius_rate)")
    if "damping" in stages:
        lines += call_without_history(chain, stages["damping"], "c, n", "c_n")
    if "tangential_damping" in stages:
        lines += call_without_history(chain, stages["tangential_damping"], "c, load", "c_t")
    if "rolling" in stages:
        lines += call_without_history(chain, stages["rolling"], f"c, {STILL}, load", "r") + ["        c_r = r.viscosity"]
    for stage, name, moved in (("tangential", "k_t", "c"), ("rolling", "k_r", f"c, {STILL}")):
        if stage not in stages:
            lines.append(f"        {name} = 0.0")
            continue
        k = stages[stage]
        lines += [*_pressed(chain, k, moved), f"        t = tangent_{k}({moved}, load, p{k}{_settled(chain, k)})"]
        lines.append(f"        {name} = max(-t[0], -t[3])")
    names = ("k_n", "k_t", "k_r", "c_n", "c_t", "c_r")
    lines += [f"        O[{field_of(i)}] = {name}" for i, name in enumerate(names)]
    return tile_function("stiffness", chain, contact_of(chain, still=True), lines)


def _pressed(chain: Sequence[Law], k: int, moved: str) -> list[str]:
    """Lines that close a contact without slip, so that its stiffness is that of the whole contact area.

    A contact that closes in the step itself receives a part of the slip only.
    """
    lines = [f"        p{k} = {parameters_of(chain, k)}"]
    if not history_of(chain, k)[1]:
        return lines
    field = ", w_new" if len(chain[k].memory()) > len(chain[k].history) else ""
    return [*lines, f"        pressed, h{k} = kernel_{k}({moved}, load, p{k}{empty_history(chain, k)}{field})"]


def _settled(chain: Sequence[Law], k: int) -> str:
    """Arguments for the memory after `_pressed`."""
    if not history_of(chain, k)[1]:
        return ""
    return f", h{k}" + (", w_new" if len(chain[k].memory()) > len(chain[k].history) else "")
