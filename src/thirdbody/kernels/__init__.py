"""Compiled loops over floats and arrays, without dictionaries, strings, files or units."""

import thirdbody.jit.numba_setup  # noqa: F401  (before numba is imported by a kernel)
