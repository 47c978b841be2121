"""Compiler options, chosen once: IEEE arithmetic everywhere, no fastmath that would hide a NaN. And `entry`, which declares.

numba reads the folder of its cache when it decorates a function, so ours is set here first.

A kernel must never index with a variable that can be negative (`numba_lowering`): it is not counted from the end, but reads what
is before the array. Branch first, as `plates.is_sphere(partner)` does.
"""

import functools
import threading
from collections.abc import Callable
from typing import Any

from thirdbody.jit import cache

cache.folder()

from numba import njit  # noqa: E402

from thirdbody.jit.numba_pipeline import Inner, KernelOnly, Own, Whole, pipeline_options  # noqa: E402

OPTIONS: dict[str, Any] = {"error_model": "numpy", "cache": True} | pipeline_options(Own)
"""Kernels that Python calls and that may be passed as pointers."""

OTHERS: dict[str, Any] = {"error_model": "numpy", "cache": True} | pipeline_options(Whole)
"""Functions of laws and plug-ins that Python calls."""

DIRECT: dict[str, Any] = OPTIONS | {"no_cfunc_wrapper": True}  # kernels that only Python calls

POINTED: dict[str, Any] = OPTIONS | {"no_cpython_wrapper": True}
"""Kernels that are only passed as pointers: they need no wrapper for Python."""

HELPER: dict[str, Any] = {"error_model": "numpy", "no_cpython_wrapper": True, "no_cfunc_wrapper": True} | pipeline_options(
    KernelOnly
)
"""Functions of laws and plug-ins that only kernels call."""

CHUNK: dict[str, Any] = HELPER | pipeline_options(Inner)
"""Kernels called once per chunk, by kernels only: without the wrappers the engine compiles in half the time."""

INNER: dict[str, Any] = CHUNK | {"forceinline": True}
"""Kernels called per body or contact: without inlining, passing their arrays costs more than their work (190 -> 55 us per
step)."""

NO_COUNTS: dict[str, Any] = {"_nrt": False}
"""For kernels that allocate no arrays: numba otherwise counts references to every table in every branch of a loop, which costs
more than the work of most bodies and contacts (a sphere is placed in 10 ns, not 50)."""

BARE_CHUNK: dict[str, Any] = CHUNK | NO_COUNTS
BARE: dict[str, Any] = INNER | NO_COUNTS


class Entry:
    """A kernel that Python calls, or passes as an address: compiled, or loaded from the cache, when it is first needed.
    `engine.units` compiles entries beforehand, several at once."""

    def __init__(self, function: Callable, signature: Any, options: dict[str, Any]) -> None:
        functools.update_wrapper(self, function)
        self.py_func, self._signature, self._options = function, signature, options
        self._compiled: Any = None
        self._lock = threading.Lock()

    def compiled(self) -> Any:
        """Return numba's function, for one signature. Thread-safe."""
        with self._lock:
            if self._compiled is None:
                self._compiled = njit(self._signature, **self._options)(self.py_func)
            return self._compiled

    def __call__(self, *arguments: Any) -> Any:
        return (self._compiled or self.compiled())(*arguments)

    def get_compile_result(self, signature: Any) -> Any:
        return self.compiled().get_compile_result(signature)


def entry(signature: Any, **options: Any) -> Callable[[Callable], Entry]:
    return lambda function: Entry(function, signature, options)
