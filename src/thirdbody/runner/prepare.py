"""A scene made ready to run: built, compiled, and the number of threads."""

from __future__ import annotations

import threading
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

from thirdbody.errors import UsageError
from thirdbody.jit.gc_pause import paused
from thirdbody.scene.model import Scene

if TYPE_CHECKING:
    from thirdbody.assembly.simulation import Simulation

_preparing = threading.Lock()
"""Lock: one thread at a time compiles, since settings of compilation are process-wide (`precompile`)."""


def prepare(scene: Scene, plugins: Iterable[str | Path] = (), force: bool = False, before: str = "") -> Simulation:
    """Return the simulation of a scene, compiled and at time zero. Raises UsageError and InputError.

    `before`: the integrator with which a run began, which goes on with it.
    """
    from thirdbody.engine.precompile import report_compilation, start_compiling, warm_up
    from thirdbody.laws.registry import discover

    with _preparing, paused("simulation"):
        start_compiling()
        report_compilation()
        registry = discover(tuple(plugins))
        from thirdbody.assembly.rate_test import examine_rate_test
        from thirdbody.assembly.simulation import build

        simulation = build(scene, registry, force, warm_up, before)
        examine_rate_test(simulation)
        return simulation


def check_threads(threads: int | None) -> list[str]:
    """Return a warning if `threads` exceeds the number of cores. Raises UsageError for a number below 1."""
    from thirdbody.jit.threads import most_threads

    maximum = most_threads()
    if threads is not None and threads < 1:
        raise UsageError(f"threads = {threads}: must be at least 1")
    if threads is not None and threads > maximum:
        return [f"{threads} threads were requested; {maximum} are used, as many as there are cores"]
    return []


def set_threads(threads: int | None) -> None:
    """Set the number of threads of the compiled loops: all cores if None, and never more than there are."""
    from thirdbody.jit.threads import allow_threads, most_threads

    maximum = most_threads()
    allow_threads(maximum if threads is None else min(threads, maximum))
