"""Composition of contact laws into one generated, compiled module per scene.

The module name contains a hash of its text and of every source file it depends on, because numba's own cache watches only the
file of the compiled function: an edited law gives another module, never a stale result. The module is called through a function
pointer: as fast as laws inlined by hand, while the engine is compiled once for all laws.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from thirdbody.kernels.rolling_kinematics import MOMENTS, TWIST
from thirdbody.laws.codegen.contact_module import module_text
from thirdbody.laws.codegen.fragments import energy_column, field_of, history_of, jumps, memory_names, viscous_names, width_of
from thirdbody.laws.codegen.module_cache import load_module
from thirdbody.laws.contract import STAGES, STIFF, Law
from thirdbody.laws.touch import touch_fraction, touch_growth

SPRINGS = (("tangential", ("force_x", "force_y")), ("rolling", ("moment_x", "moment_y")), ("twisting", ("moment",)))
"""Stages with springs, and the names of the forces or moments that their laws remember."""

LOSSES = {"plastic_work": "plastic", "adhesion_work": "adhesion"}
"""What a normal law that dissipates names this energy in its history, and its line of the ledger."""


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
        """Tangents with history, dashpots included (`tangents`); None if a law has no tangent.

        Compiled on first use: the explicit integrator never needs them.
        """
        if self.stiffness is None or self.without_tangent:
            return None
        return load_module("tangents", module_text(self.laws, tangents=True), _functions(self.laws))[0].tangents

    @property
    def without_tangent(self) -> tuple[str, ...]:
        """Names of the laws without the tangent that they require: they run in the explicit integrator only."""
        return tuple(law.name for law in self.laws if law.tangent is None and (law.stage in STIFF or law.reach))

    @property
    def reaching(self) -> tuple[str, ...]:
        """Names of the laws that act before the bodies touch, or on after it."""
        return tuple(law.name for law in self.laws if law.reach)

    @property
    def jumps(self) -> bool:
        """Whether a force jumps as bodies touch or part.

        Then laws see the overlap gained in the step, and the integrator is the last parameter of each pair (`laws.touch`).
        """
        return jumps(self.laws)

    @property
    def force_columns(self) -> tuple[int, int, int]:
        """Columns of the tangential force, of the rolling moment and of the moment about the normal in the history.

        Moment -1: no law of that stage. Force -1: a law of these stages does not name its stored force `force_x, force_y`
        (rolling: `moment_x, moment_y`; twisting: `moment`).
        """
        stages = {law.stage: k for k, law in enumerate(self.laws)}
        columns = []
        for stage, names in SPRINGS:
            if stage not in stages:
                columns.append(-1)
                continue
            law = self.laws[stages[stage]]
            result = [i for i in range(len(law.history)) if law.history[i : i + len(names)] == names]
            if not result:
                return -1, -1, -1
            columns.append(history_of(self.laws, stages[stage])[0] + result[0])
        return columns[0], columns[1], columns[2]

    @property
    def field(self) -> tuple[int, int]:
        """First column of the field in the history, and the number of its floats; without a field the end and 0."""
        return field_of(self.laws)

    @property
    def stored(self) -> int:
        """Column of the energy stored by all springs but the normal one in the history; -1 if there is none."""
        return energy_column(self.laws)

    @property
    def dashpots(self) -> int:
        """First column of the dashpot forces in the history; -1 if there are none."""
        count = len(viscous_names(self.laws))
        return len(self.history) - count if count else -1

    @property
    def loss_column(self) -> int:
        """Column of the history with the energy that the normal law has dissipated since the contact closed; -1: it does not."""
        history = self.laws[0].history
        return next((history_of(self.laws, 0)[0] + history.index(name) for name in LOSSES if name in history), -1)

    @property
    def loss(self) -> str:
        """Name of that energy in the ledger."""
        return LOSSES[self.laws[0].history[self.loss_column - history_of(self.laws, 0)[0]]] if self.loss_column >= 0 else ""

    @property
    def rolling(self) -> int:
        """Relative rotation required by the laws.

        `kernels.rolling_kinematics.MOMENTS`, 1 for the travel of the contact area only, or 0; plus `TWIST`.
        """
        stages = {law.stage for law in self.laws}
        turn = MOMENTS if "rolling" in stages else int(any(law.rolls for law in self.laws))
        return turn + (TWIST if "twisting" in stages else 0)


def ordered(laws: Iterable[Law]) -> tuple[Law, ...]:
    """Return the laws in the order of their stages; one law per stage, any number for adhesion.

    Raises ValueError when the normal stage is empty, a stage has two laws, a law that is not tangential has a field, or a law
    assumes another normal law.
    """
    chain = tuple(sorted(laws, key=lambda law: STAGES.index(law.stage)))
    for stage in STAGES:
        names = [law.name for law in chain if law.stage == stage]
        if len(names) > 1 and stage != "adhesion":
            raise ValueError(f"two laws for the {stage} stage: {', '.join(names)}")
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
    chain = ordered(laws)
    module, path = load_module("law", module_text(chain), _functions(chain))
    return Chain(chain, module.law, getattr(module, "stiffness", None), memory_names(chain), width_of(chain), path)


def _functions(chain: Sequence[Law]) -> list[Callable]:
    """Return all functions on which a module generated from these laws depends."""
    others = [more for law in chain for more in (law.tangent, law.added_load) if more]
    others += [touch_fraction, touch_growth] if jumps(chain) else []
    return [law.kernel for law in chain] + others
