"""Parallel compilation at the first start of a version, since numba compiles on one core only.

What kernels a scene needs is known once its bodies are made and its integrator is chosen. Until then child processes compile
what it probably needs, while the main process compiles its laws. Then this one joins in: each process takes the next unit from a
common queue, and all write to the same cache, from which the compiled code is loaded.
"""

import atexit
import gc
import os
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from thirdbody.jit import cache_dir
from thirdbody.jit.gc_pause import paused
from thirdbody.system.child_process import python_command, python_environment
from thirdbody.system.cpu_count import cores

MARK = "compiled-"
"""Beginning of the names of files in the cache folder that mark a unit whose compiled code is complete."""

PATIENCE = 300.0
"""Time [s] to wait for the child processes; the main process compiles what they have not finished."""

PROCESSES = 4
"""Maximum number of processes: the longest unit takes longer to compile than a quarter of the rest."""

COLD = 1
"""LLVM's optimisation level for laws and `COLD_UNITS`: 0.8 of the compile time, bit-identical results."""

_begun: tuple[tuple[str, ...], int, list[subprocess.Popen[bytes]]] | None = None
"""Units that are being compiled, their queue, the child processes."""

_reported = False

_usual: Any = None
"""numba's default level while `COLD` is set."""


def start_compiling(units: Sequence[str]) -> None:
    """Start child processes that compile the units that are probably needed, at the first start of all.

    `warm_up` gets those that are. Later starts wait for it: what is expected in vain would be compiled, and dropped, every time.
    """
    if _begun is None and len(_missing(tuple(UNITS))) == len(UNITS):
        _begin(tuple(units), min(cores(), PROCESSES) - 1)


def report_compilation() -> None:
    """Report once why this start compiles, on standard error, and about how long."""
    global _reported
    if _begun is None or _reported:
        return
    _reported = True
    if cache_dir.note:
        print(f"warning: {cache_dir.note}", file=sys.stderr, flush=True)
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
        if _all_done(others):
            for unit in names:
                _mark_of(unit).touch()
    finally:
        _end()


def work_off(names: Sequence[str], queue: int) -> None:
    """Compile the units left in the queue, which has their places in `names`."""
    _quickly()
    while token := os.read(queue, 1):
        if names[token[0]] not in COLD_UNITS:
            _thoroughly()
        UNITS[names[token[0]]]()
        _quickly()


def _mark_of(unit: str) -> Path:
    return cache_dir.cache_folder() / f"{MARK}{unit}"


def _missing(units: Sequence[str]) -> tuple[str, ...]:
    """Return those of the units that have not been compiled."""
    return tuple(unit for unit in units if not _mark_of(unit).exists())


def _begin(names: tuple[str, ...], processes: int) -> None:
    """Queue these units, and start so many child processes that compile them."""
    global _begun
    queue, end = os.pipe()  # one byte per unit, removed by the process that reads it
    os.write(end, bytes(range(len(names))))
    os.close(end)
    _begun = names, queue, [_helper(names, queue) for _ in range(processes)]
    atexit.register(_end)
    _quickly()


def _quickly() -> None:
    """Set numba's optimisation level to `COLD`."""
    global _usual
    cache_dir.folder()
    import numba
    from numba.core.registry import cpu_target

    if _usual is None:
        cpu_target.target_context.codegen()  # created now, it keeps the default level for machine code
        _usual = numba.config.OPT  # type: ignore[attr-defined]
        numba.config.OPT = type(_usual)(min(COLD, _usual))  # type: ignore[attr-defined]


def _thoroughly() -> None:
    """Restore numba's default optimisation level."""
    global _usual
    if _usual is not None:
        import numba

        numba.config.OPT, _usual = _usual, None  # type: ignore[attr-defined]


def _end() -> None:
    """Terminate the child processes; what they have compiled remains in the cache."""
    global _begun
    if _begun is None:
        return
    _thoroughly()
    _, queue, others = _begun
    _begun = None
    os.close(queue)
    for other in others:
        if other.poll() is None:
            other.terminate()


def _helper(names: Sequence[str], queue: int) -> subprocess.Popen[bytes]:
    return subprocess.Popen(
        [*python_command("thirdbody.engine.precompile"), *names], env=python_environment(),
        stdin=queue, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    )  # fmt: skip


def _all_done(others: list[subprocess.Popen[bytes]]) -> bool:
    """Return whether all child processes succeeded within `PATIENCE`."""
    last = time.monotonic() + PATIENCE
    try:
        return all([other.wait(max(last - time.monotonic(), 0.0)) == 0 for other in others])
    except subprocess.TimeoutExpired:
        return False


# -- units: what is imported is compiled --


def _passes() -> None:
    # together, as they have functions in common
    from thirdbody.kernels import label_bodies  # noqa: F401
    from thirdbody.kernels.explicit import passes  # noqa: F401


def _step() -> None:
    from thirdbody.kernels.explicit import step_loop  # noqa: F401


def _stability() -> None:
    from thirdbody.kernels.explicit import critical_time_step  # noqa: F401


def _labels() -> None:
    from thirdbody.kernels import label_bodies  # noqa: F401


def _driver() -> None:
    from thirdbody.kernels.implicit import driver  # noqa: F401


def _ensemble() -> None:
    from thirdbody.kernels.implicit import ensemble  # noqa: F401


def _common_plate() -> None:
    from thirdbody.kernels.implicit import common_plate  # noqa: F401


def _pairs() -> None:
    from thirdbody.kernels.implicit import pairs  # noqa: F401


def _rough() -> None:
    from thirdbody.kernels.implicit import rough  # noqa: F401


def _spots() -> None:
    from thirdbody.kernels.implicit import spots_part  # noqa: F401


def _search() -> None:
    import numpy as np

    from thirdbody.kernels import neighbour_search
    from thirdbody.kernels.neighbour_search import CandidateRows, Grid, Spheres
    from thirdbody.kernels.rigid_body import place_all
    from thirdbody.kernels.tables import body, body_extra, orientation, patch, sphere

    S, P, H = np.zeros((1, sphere.WIDTH)), np.zeros((1, patch.WIDTH)), np.zeros((0, 1))
    body_of, own, count = np.zeros(1, np.int64), np.zeros(0, np.int32), np.ones(3, np.int64)
    periodic, spheres = np.array([True, True]), Spheres(body_of, np.zeros(1, np.int8))
    grid, none = Grid(np.zeros(3), np.ones(3), count, periodic, 1.0, 1.0), CandidateRows(0, 0, own, own, H)
    neighbour_search.plate_candidates(S, P, spheres, body_of, ((1, 0.0), (1, 0.0)), own, own)
    neighbour_search.pair_candidates(S, spheres, 0.0, grid, 0, own, own)
    neighbour_search.carry_history(none, none)
    neighbour_search.incidences(0, own, own, 1)
    rows = (np.zeros((0, width)) for width in (body.WIDTH, body_extra.WIDTH, orientation.WIDTH))
    place_all(np.zeros(1, np.int64), np.zeros((0, 3)), S[:0], *rows)


UNITS: dict[str, Callable[[], None]] = {
    "common_plate": _common_plate, "ensemble": _ensemble, "driver": _driver, "pairs": _pairs, "rough": _rough, "spots": _spots,
    "passes": _passes, "step": _step, "stability": _stability, "search": _search, "labels": _labels,
}  # fmt: skip
"""Units of compilation by name, the longest first."""

SECONDS, FEWER = {"common_plate": 55, "driver": 45}, 20
"""Processor time of a Zen 3 core [s] for the long units, with their laws, and for each other one."""

EXPLICIT = ("passes", "step", "stability", "search")
"""Units of the explicit integrator, the longest first."""

COLD_UNITS = ("common_plate", "ensemble", "driver", "pairs", "rough", "spots", "step", "stability", "search", "labels")
"""Units that are optimised at the level `COLD`."""

if __name__ == "__main__":
    gc.disable()
    work_off(sys.argv[1:], sys.stdin.fileno())
    os._exit(0)  # everything is written; deallocating millions of objects would take a second
