"""Compiler options, chosen once: IEEE arithmetic everywhere, no fastmath that would hide a NaN."""

OPTIONS = {"error_model": "numpy", "cache": True}
"""Kernels that Python calls."""

INNER = {"error_model": "numpy", "no_cpython_wrapper": True, "no_cfunc_wrapper": True}
"""Kernels that only kernels call: without the wrappers the whole engine compiles in half the time."""
