"""Text fragments of the modules generated from laws: reading a tile, calling a law, its memory."""

from collections.abc import Callable, Sequence
from typing import Any

from thirdbody.kernels.columns import law_input, rolling_input
from thirdbody.kernels.columns.tile import TILE
from thirdbody.laws.codegen.dependencies import plain
from thirdbody.laws.contract import Law

HEAD = """# generated: {title}
import math
import numpy as np
from numba import njit
from thirdbody.jit.options import OPTIONS
from thirdbody.kernels.tile_parameters import broadcast_parameters
from thirdbody.kernels.signatures import EFFECTS, LAW
from thirdbody.laws.contract import Adhesion, Body, Contact, Load, Normal, Turn, Wrench
from thirdbody.laws.codegen.module_cache import as_kernel
{imports}

"""

STILL = "Turn(0.0, 0.0, 0.0, 0.0)"

CONTACT = """        c = Contact(I[q + {OVERLAP}], I[q + {RADIUS}], I[q + {MASS}], I[q + {NORMAL_VELOCITY}],
                    I[q + {SLIP_X}], I[q + {SLIP_Y}], I[q + {VELOCITY_X}], I[q + {VELOCITY_Y}], {roll})
"""

TOUCHING = """        c = Contact(max(far.overlap, 0.0), far.radius, far.mass, far.v_n,
                    far.slip_x, far.slip_y, far.v_x, far.v_y, far.roll_x, far.roll_y)
"""
"""The contact for laws without reach, in a chain that has one."""


def field_names(parameters: Any) -> tuple[str, ...]:
    """Names of a law's parameters, a NamedTuple class."""
    return tuple(parameters._fields)


def width_of(chain: Sequence[Law]) -> int:
    """Number of parameters per material pair; at least one, so that the table is never empty."""
    return max(sum(len(field_names(law.parameters)) for law in chain), 1)


def imports_of(k: int, kernel: Callable, parameters: type) -> list[str]:
    """Lines that import a kernel and its parameters under numbered names."""
    function = plain(kernel)
    return [
        f"from {function.__module__} import {function.__name__} as kernel_{k}",
        f"kernel_{k} = as_kernel(kernel_{k})",
        f"from {parameters.__module__} import {parameters.__name__} as parameters_{k}",
    ]


def head_of(chain: Sequence[Law]) -> str:
    """Imports of a module generated from these laws."""
    imports: list[str] = []
    for k, law in enumerate(chain):
        imports += imports_of(k, law.kernel, law.parameters)
        if law.tangent is not None:
            function = plain(law.tangent)
            imports.append(f"from {function.__module__} import {function.__name__} as tangent_{k}")
            imports.append(f"tangent_{k} = as_kernel(tangent_{k})")
    return HEAD.format(title=" > ".join(law.name for law in chain), imports="\n".join(imports))


def memory_names(chain: Sequence[Law]) -> tuple[str, ...]:
    """Names of all floats stored per contact.

    Those of the laws, fields included, the stored energy where no law has it as history, then the forces of the dashpots.
    """
    laws = tuple(f"{law.name}.{name}" for law in chain for name in law.memory())
    return laws + (("springs.energy",) if energy_column(chain) == len(laws) else ()) + viscous_names(chain)


def energy_column(chain: Sequence[Law]) -> int:
    """Column of the energy stored by tangential and rolling springs in the history; -1: the chain has no such springs.

    It is the law's own `energy` where one law has all the springs, else a column after the histories of all laws.
    """
    springs = [k for k, law in enumerate(chain) if law.stage in ("tangential", "rolling")]
    if not springs:
        return -1
    law = chain[springs[0]]
    if len(springs) == 1 and "energy" in law.history:
        return history_of(chain, springs[0])[0] + law.history.index("energy")
    return sum(len(law.memory()) for law in chain)


def viscous_names(chain: Sequence[Law]) -> tuple[str, ...]:
    """Names of the dashpot forces stored for their dissipation.

    Normal and tangential force packed into one number (`kernels.packed_triple`), and their moment in another if there is a law of
    the rolling stage.
    """
    stages = {law.stage for law in chain}
    if "rolling" in stages:
        return ("viscous.force", "viscous.moment")
    return ("viscous.force",) if stages & {"damping", "tangential_damping"} else ()


def field_of(offset: int) -> str:
    return f"q + {offset * TILE}" if offset else "q"


def contact_of(chain: Sequence[Law], still: bool = False) -> str:
    names = ("OVERLAP", "RADIUS", "MASS", "NORMAL_VELOCITY", "SLIP_X", "SLIP_Y", "VELOCITY_X", "VELOCITY_Y")
    behind = law_input.HISTORY + len(memory_names(chain))
    report = not still and any(law.rolls for law in chain)
    places = (behind + rolling_input.TRAVEL_X, behind + rolling_input.TRAVEL_Y)
    roll = ", ".join(f"I[{field_of(place)}]" if report else "0.0" for place in places)
    text = CONTACT.format(roll=roll, **{name: getattr(law_input, name) * TILE for name in names})
    return text.replace(" c = ", " far = ", 1) + TOUCHING if any(law.reach for law in chain) else text


def seen_by(law: Law) -> str:
    """Name of the contact in the generated text: `far` has overlaps down to minus the reach, `c` none below zero."""
    return "far" if law.reach else "c"


def parameters_of(chain: Sequence[Law], k: int) -> str:
    offset = sum(len(field_names(law.parameters)) for law in chain[:k])
    values = ", ".join(f"U[{field_of(offset + i)}]" for i in range(len(field_names(chain[k].parameters))))
    return f"parameters_{k}({values})"


def history_of(chain: Sequence[Law], k: int) -> tuple[int, int]:
    return sum(len(law.memory()) for law in chain[:k]), len(chain[k].history)


def history_arguments(chain: Sequence[Law], k: int) -> tuple[list[str], str]:
    """Lines that read the field of law k, and the arguments for its memory."""
    start, count = history_of(chain, k)
    if not count:
        return [], ""
    read = ", ".join(f"I[{field_of(law_input.HISTORY + start + i)}]" for i in range(count))
    size = len(chain[k].memory()) - count
    if not size:
        return [], f", ({read},)"
    lines = [f"        for f in range({size}):", f"            w[f] = I[q + (f + {law_input.HISTORY + start + count}) * {TILE}]"]
    return lines, f", ({read},), w"


def scratch_of(chain: Sequence[Law]) -> str:
    """Arrays for the field of the law that has one."""
    size = max((len(law.memory()) - len(law.history) for law in chain), default=0)
    return f"    w, w_new = np.zeros({size}), np.zeros({size})\n" if size else ""


def tile_function(name: str, chain: Sequence[Law], contact: str, lines: Sequence[str]) -> str:
    width = width_of(chain)
    head = f"@njit(LAW, **OPTIONS)\ndef {name}(I, O, n_contacts, P):\n"
    head += f"    U = np.empty({width * TILE})\n    broadcast_parameters(I, n_contacts, P, {width}, U)\n"
    return head + scratch_of(chain) + "    for q in range(n_contacts):\n" + contact + "\n".join(lines) + "\n"


def empty_history(chain: Sequence[Law], k: int) -> str:
    """Arguments for the memory of law k in a virgin contact."""
    count = history_of(chain, k)[1]
    field = ", w" if len(chain[k].memory()) > count else ""
    return ", (" + "0.0, " * count + ")" + field if count else ""


def call_without_history(chain: Sequence[Law], k: int, arguments: str, answer: str) -> list[str]:
    """Lines that call law k without any history."""
    first = "[0]" if history_of(chain, k)[1] else ""
    call = f"kernel_{k}({arguments}, p{k}{empty_history(chain, k)}){first}"
    return [f"        p{k} = {parameters_of(chain, k)}", f"        {answer} = {call}"]
