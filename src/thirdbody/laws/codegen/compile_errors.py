"""numba's message about a kernel that is not valid code, in one line."""

import re
from collections.abc import Iterable

from thirdbody.errors import ThirdbodyError
from thirdbody.laws.codegen.dependencies import plain
from thirdbody.laws.contract import BodyEffect, Labeller, Law
from thirdbody.laws.measures import Measure

GENERATED = re.compile(r"thirdbody_[a-z]+_[0-9a-f]{20}\.py")
"""Files of generated code (`module_cache.load_module`)."""


def compile_error(problem: Exception) -> str | None:
    """Return numba's reason, and the line if it names one, without colours and advice; None if numba did not raise it."""
    if isinstance(problem, OSError | MemoryError | ThirdbodyError):
        return None
    if not (isinstance(problem, ImportError) or _raised_by_numba(problem)):
        return None
    text = re.sub(r"\x1b\[[0-9;]*m", "", str(problem))
    lines = [line.strip() for line in text.splitlines() if line.strip()] or [""]
    informative = [line for line in lines if "Error" in line or "Unknown" in line or "Invalid" in line]
    reason = informative[-1] if informative else lines[0]
    if "Error" not in reason and not type(problem).__module__.startswith("numba."):
        reason = f"{type(problem).__name__}: {reason}"
    return f"cannot be compiled: {reason} {_source_location(lines)}".rstrip()


def _raised_by_numba(problem: Exception) -> bool:
    """Return whether numba raised it or was running when it was raised, as for a name that a module does not have."""
    if type(problem).__module__.startswith("numba."):
        return True
    trace = problem.__traceback__
    while trace is not None:
        if trace.tb_frame.f_globals.get("__name__", "").startswith("numba."):
            return True
        trace = trace.tb_next
    return False


def _source_location(lines: list[str]) -> str:
    """Return file and line of the kernel; generated code, into which kernels are inlined, is not informative."""
    result = next((line for line in lines if line.startswith("File ") and not GENERATED.search(line)), "")
    return result.rstrip(":").replace("File ", "in file ", 1)


def foreign(parts: Iterable[Law | BodyEffect | Labeller | Measure]) -> list[str]:
    """Return the names of the laws, effects, measures and labellers of plug-ins: the built-in ones always compile."""
    return [part.name for part in parts if not _module(part).startswith("thirdbody.")]


def _module(part: Law | BodyEffect | Labeller | Measure) -> str:
    return plain(part.label if isinstance(part, Labeller) else part.kernel).__module__
