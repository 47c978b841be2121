"""The first start of a version: compile on two cores at once, since numba itself compiles on one.

The main process compiles the step loop, a second one everything else into the same cache. Afterwards all of it is loaded.
"""

from __future__ import annotations

import gc
import subprocess
import sys

from . import cache

MARK = "warm"
PATIENCE = 300.0
"""Seconds to wait for the second process; whatever it has not finished the main process compiles itself."""


def warm_up() -> None:
    """Compile what is not compiled yet. A failure costs time only: numba then compiles where a function is first called."""
    mark = cache.folder() / MARK
    if mark.exists():
        return
    if sys.stderr.isatty():
        print("thirdbody: first start of this version, compiling ...", file=sys.stderr, flush=True)
    command = [sys.executable, "-m", "thirdbody.warm"]
    other = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    gc.disable()  # the compiler makes millions of objects and few cycles: a tenth of its time
    try:
        from .kernels import observe, stability, step  # noqa: F401  (imported to be compiled)

        if other.wait(PATIENCE) == 0:
            mark.touch()
    except subprocess.TimeoutExpired:
        pass
    finally:
        gc.enable()
        if other.poll() is None:
            other.terminate()


def compile_the_rest() -> None:
    """Everything but the step loop, its stability bound and the labels: laws and labellers, bodies, search."""
    from .laws.compose import compose
    from .laws.compose_bodies import compose_effects, compose_labeller
    from .laws.registry import discover

    for family in discover().families.values():
        if family.labeller is not None:
            compose_labeller(family.labeller)
            compose(family.levels[family.default_level])
    compose_effects([])
    _bodies()
    _search()


def _bodies() -> None:
    import numpy as np

    from .bodies.placement import overlaps, place_layer
    from .bodies.poses import settle
    from .bodies.shapes import population

    rng = np.random.default_rng(0)
    bodies = population(0, 0, 2, (4, 4), (1.0, 0.8, 0.6), distribution="constant", value=1.0)
    turns = np.array([settle(body, rng)[0] for body in bodies])
    place_layer(bodies, turns, (20.0, 20.0), True, rng)
    overlaps(np.zeros((1, 3)), np.ones(1), np.zeros(1, np.int64), (20.0, 20.0), True)


def _search() -> None:
    import numpy as np

    from .kernels import layout as at
    from .kernels import search

    S, P, H = np.zeros((1, at.S_COLS)), np.zeros((1, at.P_COLS)), np.zeros((0, 1))
    body, own, count = np.zeros(1, np.int64), np.zeros(0, np.int64), np.ones(3, np.int64)
    periodic = np.array([True, True])
    search.plate_candidates(S, P, body, body, True, True, 0.0, own, own)
    search.pair_candidates(S, body, 1.0, 1.0, 0.0, np.zeros(3), np.ones(3), count, periodic, 0, own, own)
    search.carry_history(0, 0, own, own, H, 0, 0, own, own, H)
    search.incidences(0, own, own, body, 1)


if __name__ == "__main__":
    gc.disable()
    compile_the_rest()
