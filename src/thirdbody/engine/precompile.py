"""Parallel compilation at the first start of a version, since numba compiles on one core only.

Child processes start first and compile what every scene needs. The main process reads its scene, compiles its laws, places its
bodies, and then joins in: each process takes the next unit from a common queue, and all write to the same cache, from which the
compiled code is loaded.
"""

import atexit
import gc
import os
import subprocess
import sys
import time
from collections.abc import Callable
from typing import Any

from thirdbody.jit import cache_dir
from thirdbody.jit.gc_pause import paused
from thirdbody.system.child_process import python_command, python_environment
from thirdbody.system.cpu_count import cores

MARK = "warm"
"""File in the cache folder that marks a complete compilation."""

PATIENCE = 300.0
"""Time [s] to wait for the child processes; the main process compiles what they have not finished."""

PROCESSES = 4
"""Maximum number of processes: the passes of a step alone take longer to compile than a quarter of the rest."""

COLD = 1
"""LLVM's optimisation level for all but the passes of a step: 0.8 of the compile time, bit-identical results."""

_begun: tuple[int, list[subprocess.Popen[bytes]]] | None = None
_usual: Any = None
"""numba's default level while `COLD` is set."""


def start_compiling() -> None:
    """Start child processes that fill the cache while this process reads its scene."""
    global _begun
    if _begun is not None or (cache_dir.cache_folder() / MARK).exists():
        return
    queue, end = os.pipe()  # one byte per unit, removed by the process that reads it
    os.write(end, bytes(range(len(UNITS))))
    os.close(end)
    _begun = queue, [_helper(queue) for _ in range(min(cores(), PROCESSES) - 1)]
    atexit.register(_end)
    _quickly()


def report_compilation() -> None:
    """Report why this start compiles: on a terminal, or always if every start will."""
    if _begun is not None and cache_dir.note:
        print(f"warning: {cache_dir.note}", file=sys.stderr, flush=True)
        return
    if _begun is not None and sys.stderr.isatty():
        print("thirdbody: first start of this version, compiling ...", file=sys.stderr, flush=True)


def warm_up() -> None:
    """Fill the cache; after a failure numba compiles each function at its first call."""
    start_compiling()
    if _begun is None:
        return
    queue, others = _begun
    try:
        with paused("compiler"):
            work_off(queue)
        if _all_done(others):
            (cache_dir.folder() / MARK).touch()
    finally:
        _end()


def work_off(queue: int) -> None:
    """Compile the units left in the queue."""
    _quickly()
    while token := os.read(queue, 1):
        unit = UNITS[token[0]]
        if unit is _work:
            _thoroughly()
        unit()
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
    queue, others = _begun
    _begun = None
    os.close(queue)
    for other in others:
        if other.poll() is None:
            other.terminate()


def _helper(queue: int) -> subprocess.Popen[bytes]:
    return subprocess.Popen(
        python_command("thirdbody.engine.precompile"), env=python_environment(),
        stdin=queue, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    )  # fmt: skip


def _all_done(others: list[subprocess.Popen[bytes]]) -> bool:
    """Return whether all child processes succeeded within `PATIENCE`."""
    last = time.monotonic() + PATIENCE
    try:
        return all([other.wait(max(last - time.monotonic(), 0.0)) == 0 for other in others])
    except subprocess.TimeoutExpired:
        return False


def _work() -> None:
    from thirdbody.kernels import label_bodies  # noqa: F401  (imported to be compiled; they have functions in common)
    from thirdbody.kernels.explicit import passes  # noqa: F401  (imported to be compiled; they have functions in common)


def _step() -> None:
    from thirdbody.kernels.explicit import step_loop  # noqa: F401  (imported to be compiled)


def _stability() -> None:
    from thirdbody.kernels.explicit import critical_time_step  # noqa: F401  (imported to be compiled)


def _search() -> None:
    import numpy as np

    from thirdbody.kernels import neighbour_search
    from thirdbody.kernels.columns import body, body_extra, orientation, patch, sphere
    from thirdbody.kernels.neighbour_search import CandidateRows, Grid, Spheres
    from thirdbody.kernels.rigid_body import place_all

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


UNITS: tuple[Callable[[], None], ...] = (_work, _step, _stability, _search)
"""Units of compilation, the longest first."""

if __name__ == "__main__":
    gc.disable()
    work_off(sys.stdin.fileno())
    os._exit(0)  # everything is written; deallocating millions of objects would take a second
