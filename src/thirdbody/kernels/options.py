"""Compiler options, chosen once: IEEE arithmetic everywhere, no fastmath that would hide a NaN."""

from typing import Any

OPTIONS: dict[str, Any] = {"error_model": "numpy", "cache": True}
"""Kernels that Python calls."""

CHUNK: dict[str, Any] = {"error_model": "numpy", "no_cpython_wrapper": True, "no_cfunc_wrapper": True}
"""Kernels called once per chunk, by kernels only: without the wrappers the engine compiles in half the time."""

INNER: dict[str, Any] = CHUNK | {"forceinline": True}
"""Kernels called per body or contact: not inlined, passing their arrays costs more than their work (190 -> 55 us a step)."""
