"""Text of the modules generated from the contact laws of a scene, from the template `contact_laws.template`."""

from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path
from typing import Any

from thirdbody.kernels.tile import TILE, contact_tangent, law_input, law_output, rolling_input, rolling_output
from thirdbody.laws.codegen import fragments
from thirdbody.laws.contract import STAGES, STIFF, Law

STILL = "Turn(0.0, 0.0, 0.0, 0.0)"


def module_text(chain: Sequence[Law], tangents: bool = False) -> str:
    """Return the module with `law`, and `stiffness` if all laws that need one have a tangent, or the one with `tangents`."""
    names = fragments.memory_names(chain)
    own = sum(len(law.memory()) for law in chain)
    stages: dict[str, Any] = dict.fromkeys(STAGES) | {law.stage: k for k, law in enumerate(chain)}
    columns = {"law_input": law_input, "law_output": law_output, "rolling_input": rolling_input}
    columns |= {"rolling_output": rolling_output, "contact_tangent": contact_tangent}
    rotation = (rolling_input.ROTATION_X, rolling_input.ROTATION_Y, rolling_input.RATE_X, rolling_input.RATE_Y)
    twist = (rolling_input.TWIST, rolling_input.TWIST_RATE)
    text = _Text(chain, law_input.HISTORY + len(names), law_output.HISTORY + len(names))
    space = {name: getattr(text, name) for name in dir(text) if not name.startswith("_")}
    space |= columns | stages | {"tangents": tangents, "laws": chain, "TILE": TILE, "STILL": STILL, "at": _at}
    integrator, rate = f"U[{_at(fragments.width_of(chain) - 1)}]", text.behind(rolling_input.INVERSE_DT)
    return _template()(space | {
        "head": fragments.head_of(chain), "width": fragments.width_of(chain), "history": len(names), "own": own,
        "field": fragments.field_of(chain)[1],
        "adhesion": [k for k, law in enumerate(chain) if law.stage == "adhesion"],
        "adders": [k for k, law in enumerate(chain) if law.added_load],
        "rotation": f"Turn({', '.join(map(text.behind, rotation))})",
        "twist": f"Twist({', '.join(map(text.behind, twist))})", "STILL_TWIST": "Twist(0.0, 0.0)",
        "dashpots": len(fragments.viscous_names(chain)), "energy_is_added": fragments.energy_column(chain) == own,
        "fraction": f"touch_fraction(c.overlap, c.moved, -c.moved - 2.0 * c.v_n / max({rate}, 1e-300), {integrator})",
        "landing_fraction": f"touch_fraction(c.overlap, c.moved, 0.0, {integrator})",
        "growth": f"touch_growth(c.overlap, c.moved, {integrator})",
        "rolls": any(law.rolls for law in chain), "touching": fragments.touching(chain),
        "jumps": fragments.jumps(chain), "reach": any(law.reach for law in chain),
        "pulls": chain[0].reach is not None,  # the normal force may be negative
        "stiff": all(law.tangent is not None for law in chain if law.stage in STIFF),
    })  # fmt: skip


def _at(column: int) -> str:
    """Index of a column of the contact q in a tile."""
    return f"q + {column * TILE}" if column else "q"


class _Text:
    """Pieces of text that the template asks for, by number of the law; pieces of several lines are indented by the template."""

    def __init__(self, chain: Sequence[Law], behind: int, after: int) -> None:
        self._chain, self._behind, self._after = chain, behind, after

    def behind(self, column: int) -> str:
        """Input behind the history."""
        return f"I[{_at(self._behind + column)}]"

    def after(self, column: int) -> str:
        """Index of an output after the history."""
        return _at(self._after + column)

    def contact_for(self, k: int) -> str:
        """Contact that law k sees."""
        return "far" if self._chain[k].reach else "c"

    def parameters(self, k: int) -> str:
        """Line that sets the parameters."""
        offset = sum(len(fragments.field_names(law.parameters)) for law in self._chain[:k])
        values = ", ".join(f"U[{_at(offset + i)}]" for i in range(len(fragments.field_names(self._chain[k].parameters))))
        return f"p{k} = parameters_{k}({values})"

    def has_history(self, k: int) -> bool:
        """Whether the law has a memory: then its kernel returns its result and the new history."""
        return bool(self._chain[k].history)

    def first(self, k: int) -> str:
        """Index of the result in what the kernel returns."""
        return "[0]" if self.has_history(k) else ""

    def new_field(self, k: int) -> str:
        """Argument for the new field."""
        return ", w_new" if self._chain[k].field else ""

    def read(self, k: int) -> str:
        """Line that sets the field: a part of the tile (`kernels.contact_fields`)."""
        return self._part("w", "I", law_input.HISTORY, k)

    def _part(self, name: str, table: str, history: int, k: int) -> str:
        begin, size = fragments.field_of(self._chain)
        return f"{name} = array_part({size}, {table}, {(history + begin) * TILE} + q * {size})" if self._chain[k].field else ""

    def memory(self, k: int) -> str:
        """Arguments for the memory."""
        start, count = fragments.history_of(self._chain, k)
        values = "".join(f"I[{_at(law_input.HISTORY + start + i)}], " for i in range(count))
        return f", ({values}){', w' if self._chain[k].field else ''}" if count else ""

    def virgin(self, k: int) -> str:
        """Arguments for the memory of a virgin contact."""
        count = len(self._chain[k].history)
        return f", ({'0.0, ' * count}){', w' if self._chain[k].field else ''}" if count else ""

    def call(self, answer: str, k: int, arguments: str) -> str:
        """Lines that call the law with its memory, and write the new one."""
        new = f"{answer}, h{k}" if self.has_history(k) else answer
        call = f"{new} = kernel_{k}({arguments}, p{k}{self.memory(k)}{self.new_field(k)})"
        start, count = fragments.history_of(self._chain, k)
        written = [f"O[{_at(law_output.HISTORY + start + i)}] = h{k}[{i}]" for i in range(count)]
        fields = [self.read(k), self._part("w_new", "O", law_output.HISTORY, k)]
        return "\n".join([self.parameters(k), *filter(None, fields), call, *written])

    def call_virgin(self, answer: str, k: int, arguments: str) -> str:
        """Lines that call the law without any memory."""
        return f"{self.parameters(k)}\n{answer} = kernel_{k}({arguments}, p{k}{self.virgin(k)}){self.first(k)}"


@cache
def _template() -> Callable[[dict[str, Any]], str]:
    """Return the function that fills the template with the names that it asks for."""
    code, depth, file = [], 0, Path(__file__).with_name("contact_laws.template")
    for line in file.read_text(encoding="utf-8").splitlines():
        statement = line.strip().removeprefix("%").strip()
        if line.startswith("##") or line.strip() == "%":
            continue
        if not line.strip().startswith("%"):
            code.append(f"{' ' * depth}emit(f{line!r})")
        elif statement == "end":
            depth -= 1
        else:
            code.append(" " * (depth - (statement == "else:")) + statement)
            depth += statement.endswith(":") and statement != "else:"
    program = compile("\n".join(code), str(file), "exec")

    def fill(space: dict[str, Any]) -> str:
        lines: list[str] = []

        def emit(text: str) -> None:
            """Add a line; all lines of a hole get the indentation of its line, and one that is empty is left out."""
            indent = text[: len(text) - len(text.lstrip())]
            lines.extend([indent + part for part in text.strip().splitlines()] if text else [""])

        exec(program, space | {"emit": emit})
        return "\n".join(lines) + "\n"

    return fill
