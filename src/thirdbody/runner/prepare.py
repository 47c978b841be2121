"""A scene made ready to run: built, compiled, and the number of threads."""

from __future__ import annotations

import os
import threading
from collections.abc import Collection, Iterable
from numbers import Integral
from pathlib import Path
from typing import TYPE_CHECKING, cast

from thirdbody.errors import UsageError
from thirdbody.jit.cache import paused
from thirdbody.scene.model import Scene

if TYPE_CHECKING:
    from thirdbody.assembly.simulation import Simulation

MANY = 512
"""Bodies above which a run is most likely an ensemble (`engine.implicit_ensemble`)."""

_preparing = threading.Lock()
"""Lock: one thread at a time compiles, since settings of compilation are process-wide (`engine.units`)."""


def prepare(scene: Scene, plugins: Iterable[str | Path] = (), force: bool = False, before: str = "") -> Simulation:
    """Return the simulation of a scene, compiled and at time zero. Raises UsageError and InputError.

    `before`: the integrator with which a run began, which goes on with it.
    """
    from thirdbody.engine.units import report_compilation, start_compiling, warm_up
    from thirdbody.laws.registry import discover

    if os.environ.get("NUMBA_DISABLE_JIT", "0") not in ("", "0"):
        raise UsageError("NUMBA_DISABLE_JIT is set: the engine runs compiled only; unset it")
    with _preparing, paused("simulation"):
        start_compiling(likely_units(scene))
        report_compilation()
        registry = discover(tuple(plugins))
        from thirdbody.assembly.simulation import build

        return build(scene, registry, force, warm_up, before)


def likely_units(scene: Scene) -> tuple[str, ...]:
    """Return the units of compiled code (`engine.units`) that a scene needs most likely, before its bodies are made.

    `assembly.integrator.units_of` tells which ones it needs.
    """
    from thirdbody.engine.units import EXPLICIT

    upper, solver = scene.plates.upper, scene.solver
    if upper is None or upper.support != "load_per_particle" or solver.integrator == "explicit" or solver.time_step != "auto":
        return EXPLICIT
    if scene.contact.debris_contact == "auto" and any(hasattr(debris, "placement") for debris in scene.debris):
        return "driver", "pairs", "search", "books", "labels"
    many = sum(getattr(debris, "count", None) or 1 for debris in scene.debris) > MANY
    return ("driver", "ensemble", "search", "books", "labels") if many else ("driver", "search", "books", "labels")


def check_call(plugins: object = (), progress: object = True, **flags: object) -> None:
    """Raise UsageError for wrong types among the arguments of `run`, `check`, `resume` and `sweep`."""
    wrong = [f"{name} = {flag!r}: must be True or False" for name, flag in flags.items() if not isinstance(flag, bool)]
    if not isinstance(progress, bool) and not callable(progress):
        wrong.append(f"progress = {progress!r}: must be True, False or a function")
    several = isinstance(plugins, Collection) and not isinstance(plugins, str | bytes)
    if not several or not all(isinstance(path, str | os.PathLike) for path in cast("Collection[object]", plugins)):
        wrong.append(f"plugins = {plugins!r}: must be a tuple of paths, such as ('law.py',)")
    if wrong:
        raise UsageError("; ".join(wrong))


def check_threads(threads: int | None) -> list[str]:
    """Return a warning if `threads` exceeds the number of cores. Raises UsageError for what is no number of at least 1."""
    if threads is None:
        return []
    if not isinstance(threads, Integral) or isinstance(threads, bool) or threads < 1:
        raise UsageError(f"threads = {threads!r}: must be a whole number of at least 1")
    from thirdbody.jit.threads import max_threads

    maximum = max_threads()
    return [f"{threads} threads were requested; {maximum} are used, as many as there are cores"] if threads > maximum else []


def set_threads(threads: int | None) -> None:
    """Set the number of threads of the compiled loops: all cores if None, and never more than there are."""
    from thirdbody.jit.threads import allow_threads, max_threads

    maximum = max_threads()
    allow_threads(maximum if threads is None else min(threads, maximum))
