"""Compiling with numba: options, the cache of compiled code, vector types, packed arguments."""
