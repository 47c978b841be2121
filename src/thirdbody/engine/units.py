"""Units of compilation, compiled in parallel at the first start of a version, since numba compiles on one core only.

What kernels a scene needs is known once its bodies are made and its integrator is chosen. Until then child processes compile
what it probably needs, while the main process compiles its laws. Then this one joins in: each process takes the next unit from a
common queue, and all write to the same cache, from which the compiled code is loaded.

What a scene needs is expected by `runner.simulate.likely_units` and then known to `assembly.integrator.units_of`; both must agree
with what `engine.implicit.part_addresses` and `engine.explicit` pass on. `minima.update`, which only explicit steps between rough
plates need, is compiled at its first call.
"""

import atexit
import gc
import os
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from importlib import import_module
from typing import Any

from thirdbody.jit import cache
from thirdbody.jit.cache import paused
from thirdbody.system.processes import cores, python_command, python_environment

UNITS: dict[str, tuple[str, ...]] = {
    "common_plate": ("implicit.common_plate",),
    "driver": ("implicit.driver:advance_islands",),
    "pairs": ("implicit.pairs",),
    "ensemble": ("implicit.driver:advance_batch",),
    "rough": ("implicit.rough",),
    "spots": ("implicit.spots_part",),
    "passes": ("explicit.passes",),
    "step": ("explicit.step_loop",),
    "stability": ("explicit.critical_time_step",),
    "search": ("neighbour_search", "bodies:place_all"),
    "books": ("implicit.books",),
    "labels": ("labels",),
}
"""Units of compilation, the longest first: modules of `kernels` with all their entries, or single ones. Named, not imported: a
process imports what it compiles."""

EXPLICIT = ("passes", "step", "stability", "search", "labels")  # units of the explicit integrator, the longest first

COLD_UNITS, COLD = tuple(name for name in UNITS if name != "passes"), 1
"""Units that are compiled, like laws, at this optimisation level of LLVM: 0.7 to 0.8 of the compile time, same bits."""

SECONDS, FEWER = {"common_plate": 24, "driver": 20, "passes": 18, "step": 10}, 6
"""Processor time [s] of one core of 2.5 GHz, roughly, for the long units, with their laws, and at most for each other one."""

BATCH = 512
"""Bodies of implicit steps per call, or per part of one: one step of so many is enough between two looks at the clock. More, on
flat plates, are an ensemble (`engine.implicit_ensemble`)."""

MARK = "compiled-"  # beginning of the names of files in the cache folder that mark a unit whose compiled code is complete
TIMEOUT = 300.0  # time [s] to wait for the child processes; the main process compiles what they have not finished
PROCESSES = 4  # maximum number of processes: the longest unit takes longer to compile than a quarter of the rest

_begun: tuple[tuple[str, ...], int, list[subprocess.Popen[bytes]]] | None = None
"""Units that are being compiled, their queue, the child processes."""

_reported = False

_usual: Any = None  # numba's default level while `COLD` is set


def entries(unit: str) -> Iterator[Any]:
    """Yield the entries (`jit.options.Entry`) of a unit, from modules that are imported now."""
    from thirdbody.jit.options import Entry

    for name in UNITS[unit]:
        module, _, one = name.partition(":")
        names = vars(import_module(f"thirdbody.kernels.{module}"))
        own = (value for value in names.values() if isinstance(value, Entry) and value.__module__ == names["__name__"])
        yield from [names[one]] if one else own


def start_compiling(units: Sequence[str]) -> None:
    """Start child processes that compile the units that are probably needed, at the first start of all. Later starts wait for
    `warm_up`: what is expected in vain would be compiled, and dropped, every time."""
    if _begun is None and len(_missing(tuple(UNITS))) == len(UNITS):
        _begin(tuple(units), min(cores(), PROCESSES) - 1)


def report_compilation() -> None:
    global _reported
    if _begun is None or _reported:
        return
    _reported = True
    if cache.note:
        print(f"warning: {cache.note}", file=sys.stderr, flush=True)
    each = [SECONDS.get(name, FEWER) for name in _begun[0]]
    seconds = max(*each, sum(each) / min(cores(), PROCESSES))
    print(f"thirdbody: first start of this version, compiling: about {seconds:.0f} s", file=sys.stderr, flush=True)


def warm_up(units: Sequence[str]) -> None:
    """Compile these units, keys of `UNITS`; after a failure numba compiles each function at its first call."""
    missing = _missing(units)
    if _begun is not None and set(missing) != set(_begun[0]):
        _end()  # something else was expected
    if missing and _begun is None:
        _begin(missing, min(cores(), PROCESSES, len(missing)) - 1)
        report_compilation()
    if _begun is None:
        return
    names, queue, others = _begun
    try:
        with paused("compiler"):
            work_off(names, queue)
        last = time.monotonic() + TIMEOUT
        if all([other.wait(max(last - time.monotonic(), 0.0)) == 0 for other in others]):
            for unit in names:
                (cache.cache_folder() / f"{MARK}{unit}").touch()
    except subprocess.TimeoutExpired:
        pass  # no mark: the next start compiles what is missing
    finally:
        _end()


def work_off(names: Sequence[str], queue: int) -> None:
    while token := os.read(queue, 1):
        unit = names[token[0]]
        _optimise(cold=unit in COLD_UNITS)
        for entry in entries(unit):
            entry.compiled()


def _missing(units: Sequence[str]) -> tuple[str, ...]:
    return tuple(unit for unit in units if not (cache.cache_folder() / f"{MARK}{unit}").exists())


def _begin(names: tuple[str, ...], processes: int) -> None:
    global _begun
    queue, end = os.pipe()  # one byte per unit, removed by the process that reads it
    os.write(end, bytes(range(len(names))))
    os.close(end)
    _begun = names, queue, [_helper(names, queue) for _ in range(processes)]
    atexit.register(_end)
    _optimise(cold=True)


def _end() -> None:
    global _begun
    if _begun is None:
        return
    _optimise(cold=False)
    _, queue, others = _begun
    _begun = None
    os.close(queue)
    for other in others:
        if other.poll() is None:
            other.terminate()


def _helper(names: Sequence[str], queue: int) -> subprocess.Popen[bytes]:
    return subprocess.Popen(
        [*python_command("thirdbody.engine.units"), *names], env=python_environment(),
        stdin=queue, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    )  # fmt: skip


def _optimise(cold: bool) -> None:
    """Set numba's optimisation level to `COLD`, or back to its default."""
    global _usual
    if cold == (_usual is not None):
        return
    cache.folder()
    import numba
    from numba.core.registry import cpu_target

    config: Any = numba.config
    if cold:
        cpu_target.target_context.codegen()  # created now, it keeps the default level for machine code
        _usual = config.OPT
        config.OPT = type(_usual)(min(COLD, _usual))
    else:
        config.OPT, _usual = _usual, None


if __name__ == "__main__":
    gc.disable()
    work_off(sys.argv[1:], sys.stdin.fileno())
    os._exit(0)  # everything is written; deallocating millions of objects would take a second
