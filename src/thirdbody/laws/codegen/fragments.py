"""Head of generated modules, and the order of parameters and memory of a chain of laws."""

from collections.abc import Callable, Sequence
from typing import Any

from thirdbody.laws.codegen.dependencies import plain
from thirdbody.laws.contract import Law

HEAD = """# generated: {title}
import math
import numpy as np
from numba import njit
from thirdbody.jit.memory import array_part
from thirdbody.jit.options import OPTIONS
from thirdbody.jit.memory import stack_array
from thirdbody.kernels.tile_parameters import broadcast_parameters
from thirdbody.kernels.signatures import EFFECTS, LAW
from thirdbody.laws.kernel_data import {tuples}
from thirdbody.laws.codegen.module_cache import as_kernel
{imports}

"""


def tuples_for(chain: Sequence[Law]) -> str:
    """Names of the tuples that a module imports: `Twist` only where a law receives it."""
    twist = "Twist, " if any(law.stage == "twisting" for law in chain) else ""
    return f"Adhesion, Body, Contact, Load, Normal, Tangential, Turn, {twist}Wrench"


def field_names(parameters: Any) -> tuple[str, ...]:
    """Names of a law's parameters, a NamedTuple class."""
    return tuple(parameters._fields)


def width_of(chain: Sequence[Law]) -> int:
    """Number of parameters per material pair; at least one, so that the table is never empty.

    The last one of a chain that `jumps` is the integrator (`laws.touch`).
    """
    return max(sum(len(field_names(law.parameters)) for law in chain) + (1 if jumps(chain) else 0), 1)


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
        for name, more in (("tangent", law.tangent), ("added", law.added_load)):
            if more is not None:
                function = plain(more)
                imports.append(f"from {function.__module__} import {function.__name__} as {name}_{k}")
                imports.append(f"{name}_{k} = as_kernel({name}_{k})")
    for name in TOUCH if jumps(chain) else ():
        imports += [f"from thirdbody.laws.touch import {name}", f"{name} = as_kernel({name})"]
    return HEAD.format(title=" > ".join(law.name for law in chain), tuples=tuples_for(chain), imports="\n".join(imports))


TOUCH = ("touch_fraction", "touch_growth")


def touching(chain: Sequence[Law]) -> list[int]:
    """Numbers of the adhesion laws that act from touch on: their force jumps there."""
    return [k for k, law in enumerate(chain) if law.stage == "adhesion" and not law.reach]


def jumps(chain: Sequence[Law]) -> bool:
    """Return whether a force jumps as bodies touch or part: then laws see the overlap gained in the step."""
    return bool(touching(chain)) or any(law.in_steps for law in chain)


def memory_names(chain: Sequence[Law]) -> tuple[str, ...]:
    """Names of all floats stored per contact.

    Those of the laws, fields included, the stored energy where no law has it as history, then the forces of the dashpots.
    """
    laws = tuple(f"{law.name}.{name}" for law in chain for name in law.memory())
    return laws + (("springs.energy",) if energy_column(chain) == len(laws) else ()) + viscous_names(chain)


def energy_column(chain: Sequence[Law]) -> int:
    """Column of the energy stored by all springs but the normal one in the history; -1: the chain has no such springs.

    It is the law's own `energy` where one law has all the springs, else a column after the histories of all laws.
    """
    springs = [k for k, law in enumerate(chain) if law.stage in ("tangential", "rolling", "twisting")]
    if not springs:
        return -1
    law = chain[springs[0]]
    if len(springs) == 1 and "energy" in law.history:
        return history_of(chain, springs[0])[0] + law.history.index("energy")
    return sum(len(law.memory()) for law in chain)


def viscous_names(chain: Sequence[Law]) -> tuple[str, ...]:
    """Names of the dashpot forces stored for their dissipation.

    Normal and tangential force packed into one number (`kernels.packed_triple`), and their moments in another if there is a law
    of the rolling or of the twisting stage.
    """
    stages = {law.stage for law in chain}
    if stages & {"rolling", "twisting"}:
        return ("viscous.force", "viscous.moment")
    return ("viscous.force",) if stages & {"damping", "tangential_damping"} else ()


def field_of(chain: Sequence[Law]) -> tuple[int, int]:
    """First column of the field in the memory of a chain, and the number of its floats; the end and 0 without a field."""
    for k, law in enumerate(chain):
        if law.field:
            first, count = history_of(chain, k)
            return first + count, len(law.memory()) - count
    return len(memory_names(chain)), 0


def history_of(chain: Sequence[Law], k: int) -> tuple[int, int]:
    """First column of the memory of law k, and the number of its floats without its field."""
    return sum(len(law.memory()) for law in chain[:k]), len(chain[k].history)
