"""Compiled loops over floats and arrays: no dictionary, string, file, unit or class in here."""

import thirdbody.jit.numba_setup  # noqa: F401  (before numba is imported by a kernel)
