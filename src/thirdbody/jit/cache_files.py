"""numba's files of compiled code, each ending with a digest: a damaged one is recompiled, never loaded.

They are stamped with a hash of their source, not with its time: a copy of the cache, or of the program, compiles nothing.

numba assumes that its files are complete: a truncated index ends in a traceback, and altered machine code is executed. It also
tries another folder, next to the source, where it cannot write into ours; stale code could be loaded from there.
"""

import hashlib
import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path
from typing import Any

from numba.core import caching, dispatcher

from thirdbody.jit.cache_dir import cannot_write

SIZE = hashlib.sha256().digest_size


class _Files(caching.IndexDataCacheFile):  # type: ignore[misc]
    """The index and the code files of one function."""

    def _load_index(self) -> Any:
        return super()._load_index() if _is_whole(self._index_path) else {}

    def _load_data(self, name: str) -> Any:
        path = self._data_path(name)
        if not _is_whole(path):
            raise OSError(f"{path}: damaged")  # numba treats this as a missing file
        return super()._load_data(name)

    @contextmanager
    def _open_for_write(self, filepath: str) -> Iterator[Any]:
        if os.path.isdir(filepath):
            shutil.rmtree(filepath, ignore_errors=True)  # another process may have been first
        with super()._open_for_write(filepath) as file:
            yield file
            file.flush()
            file.write(hashlib.sha256(Path(file.name).read_bytes()).digest())


def _is_whole(path: str) -> bool:
    """Return whether a file can be read and ends with the digest of all bytes before it."""
    try:
        content = memoryview(Path(path).read_bytes())
    except OSError:
        return False
    return hashlib.sha256(content[:-SIZE]).digest() == content[-SIZE:]


def _create_folder(path: Path) -> None:
    """Create a folder, in place of a file of that name; any number of processes may do so at once."""
    try:
        path.mkdir(parents=True, exist_ok=True)
    except FileExistsError:
        with suppress(FileNotFoundError, IsADirectoryError):  # another process removed the file, and may have gone on
            path.unlink()
        path.mkdir(parents=True, exist_ok=True)


@cache
def _digest_of(path: str) -> bytes:
    """Return the SHA-256 of a source file."""
    return hashlib.sha256(Path(path).read_bytes()).digest()


class _Folder(caching.UserProvidedCacheLocator):  # type: ignore[misc]
    """The folder for the functions of a file, within ours."""

    def get_source_stamp(self) -> bytes:
        """Return what changes with the source."""
        return _digest_of(self._py_file)

    def ensure_cache_path(self) -> None:
        """Create the folder, in place of anything else of that name. Raises OutputError if it cannot be created."""
        path = Path(self.get_cache_path())
        try:
            _create_folder(path)
            if not os.access(path, os.R_OK | os.W_OK | os.X_OK):
                path.chmod(0o700)
        except OSError as error:
            raise cannot_write(path, error) from error


class _Implementation(caching.CompileResultCacheImpl):  # type: ignore[misc]
    _locator_classes = [_Folder, *caching.CacheImpl._locator_classes]


class CheckedCache(caching.FunctionCache):  # type: ignore[misc]
    """numba's cache of one function, with checked files."""

    _impl_class = _Implementation

    def __init__(self, function: Any) -> None:
        super().__init__(function)
        self._cache_file = _Files(self.cache_path, self._impl.filename_base, self._impl.locator.get_source_stamp())

    def save_overload(self, sig: Any, data: Any) -> None:
        """Write compiled code. Raises OutputError if it cannot be written."""
        try:
            super().save_overload(sig, data)
        except OSError as error:
            raise cannot_write(Path(self.cache_path), error) from error


def install() -> None:
    """Make numba use this cache for every function that it caches from now on."""
    dispatcher.FunctionCache = CheckedCache  # type: ignore[attr-defined]
