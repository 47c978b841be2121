"""Compiled loops over floats and arrays: no dictionary, string, file, unit or class in here."""

from .. import cache

# numba reads the place of its cache when a function is decorated, so it is set before any kernel module is imported
cache.folder()

from . import cache_files  # noqa: E402

cache_files.install()
