"""Compiled loops over floats and arrays, without dictionaries, strings, files or units."""

import thirdbody.jit.options  # noqa: F401  (before a kernel imports numba)
