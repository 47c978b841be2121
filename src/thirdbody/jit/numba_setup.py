"""Set numba's cache to our folder. To import before any function is compiled: numba reads the folder when it decorates one."""

from thirdbody.jit import cache_dir

cache_dir.folder()

from thirdbody.jit import cache_files  # noqa: E402

cache_files.install()
