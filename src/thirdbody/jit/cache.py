"""Compiled code between processes: the folder, one per version of our sources and of numba, and numba's files in it, checked.

numba's cache notices a change only in the file of the compiled function itself, not in the functions that it inlines; a folder
named by a hash of all sources can never serve stale machine code. Its code is executed, so only this user may be able to write
there: a folder of another user is not used. Importing this module imports nothing heavy.

numba assumes that its files are complete: so each of them ends with a digest, and a damaged one is compiled anew. They are
stamped with a hash of their source, not with its time: a copy of the cache, or of the program, compiles nothing. And numba tries
another folder, next to the source, where it cannot write into ours; stale code could be loaded from there.
"""

import atexit
import functools
import gc
import hashlib
import os
import re
import shutil
import stat
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from importlib.metadata import version
from pathlib import Path
from typing import Any

from thirdbody.errors import OutputError

VARIABLE = "THIRDBODY_CACHE"  # the environment variable that names the parent of the cache folders; its content is trusted

MAX_VERSIONS = 4
"""Number of folders of earlier versions to keep, so that switching between two checkouts does not recompile each time."""

TAG = "CACHEDIR.TAG"
"""The file that marks our folders, as specified by bford.info/cachedir: backups skip them, and pruning deletes no others."""

TAG_TEXT = b"Signature: 8a477f597d28d172789f06886806bc55\n# This file is a cache directory tag created by thirdbody.\n"

LAYERS = ("jit", "kernels", "laws", "bodies", "engine", "statics")  # packages whose sources name the folder

SIZE = hashlib.sha256().digest_size
TESTED = ("0.67.", "0.68.")  # prefixes of the versions of numba whose internals are known

note = ""  # message for the user about the folder, shown when code is compiled into it

_frozen: set[str] = set()


@functools.cache
def cache_folder() -> Path:
    """Return the cache folder, created if needed; `THIRDBODY_CACHE` overrides its parent. Raises OutputError if it cannot be
    created, or if another user could have written its content."""
    parent, digest = _parent(), hashlib.sha256(f"{version('numba')} {sys.version}".encode())
    for layer in LAYERS:
        for file in sorted((Path(__file__).parents[1] / layer).rglob("*.py")):
            digest.update(file.read_bytes())
    path = parent / digest.hexdigest()[:16]
    try:
        _make_private(path)
        if not _is_ours(path):
            tag = path / TAG
            if tag.is_dir() and not tag.is_symlink():
                shutil.rmtree(tag)
            tag.unlink(missing_ok=True)
            tag.write_bytes(TAG_TEXT)
        os.utime(path)  # the last one used
        with suppress(PermissionError):  # a folder that may not be listed is not pruned
            _prune(parent)
    except OSError as error:
        raise cannot_write(path, error) from error
    return path


@functools.cache
def folder() -> Path:
    """Return the cache folder, set as numba's, with checked files. Raises OutputError as `cache_folder` does."""
    result = cache_folder()
    with paused("numba"):
        import numba

    numba.config.CACHE_DIR = str(result)  # type: ignore[attr-defined]
    _check_files()
    return result


def cannot_write(path: Path, error: OSError) -> OutputError:
    reason = error.strerror or str(error)
    return OutputError(f"{path}: compiled code cannot be written ({reason}); {VARIABLE} names another folder for it")


@contextmanager
def paused(what: str) -> Iterator[None]:
    """Pause Python's collector of cyclic garbage within the block, and exempt the objects alive at its end from it.

    Imports, the compiler and a scene's bodies are a million objects with few cycles among them, which it would traverse
    repeatedly, and once more when the program ends: a third of a start. The exemption applies only the first time for each
    `what`: a program that makes a thousand simulations gets the memory of each back."""
    if not gc.isenabled():  # nested, or disabled by the user
        yield
        return
    gc.disable()
    try:
        yield
    finally:
        if what not in _frozen:
            _frozen.add(what)
            gc.freeze()
        gc.enable()


# -- the folder --


def _parent() -> Path:
    named = os.environ.get(VARIABLE)
    if named:
        path = Path(named).absolute()
        try:
            path.mkdir(parents=True, exist_ok=True)
            _probe(path)
        except OSError as error:
            raise cannot_write(path, error) from error
        return path
    # a variable that is empty or relative counts as unset
    home = Path(os.path.expanduser("~")) if os.environ.get("HOME", "~") else Path()
    for caches in (Path(os.environ.get("XDG_CACHE_HOME", "")), home / ".cache"):
        if caches.is_absolute():
            return caches / "thirdbody" if _usable(caches / "thirdbody") else _temporary()
    return _temporary()


def _usable(path: Path) -> bool:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.mkdir(mode=0o700, exist_ok=True)
        user, status = _probe(path).st_uid, path.stat()
        if status.st_uid == user and status.st_mode & 0o022:
            path.chmod(status.st_mode & 0o755)
            status = path.stat()
    except OSError:
        return False
    return status.st_uid == user and not _open_to_others(status)


def _temporary() -> Path:
    """Return a private folder among temporary files; if its name is in use, one that is deleted when this process ends."""
    global note
    user = os.geteuid() if hasattr(os, "geteuid") else None
    try:
        path, owner = Path(tempfile.gettempdir()) / f"thirdbody-{'user' if user is None else user}", os.getpid()
        with suppress(FileExistsError):
            path.mkdir(mode=0o700)
            return path
        status = path.lstat()
        if stat.S_ISDIR(status.st_mode) and user in (None, status.st_uid) and (os.name == "nt" or not status.st_mode & 0o077):
            return path
        note = f"{path} is no private folder of this user: compiled code is kept until this process ends"
        path = Path(tempfile.mkdtemp(prefix="thirdbody-"))
    except OSError as error:
        raise cannot_write(Path(error.filename or "temporary files"), error) from error
    os.environ[VARIABLE] = str(path)  # for child processes

    def remove() -> None:
        if os.getpid() == owner:  # not in a fork
            shutil.rmtree(path, ignore_errors=True)

    atexit.register(remove)
    return path


def _probe(path: Path) -> os.stat_result:
    """Write into a folder; return the status of the new file. Some file systems assign all files to one user."""
    with tempfile.TemporaryFile(dir=path) as file:
        return os.fstat(file.fileno())


def _open_to_others(status: os.stat_result) -> bool:
    return os.name != "nt" and bool(status.st_mode & 0o022)


def _make_private(path: Path) -> None:
    """Create a folder into which only this user can write; replace one into which others could write. Raises OutputError or
    OSError."""
    with suppress(FileExistsError):
        path.mkdir(mode=0o700)
        return
    status = path.lstat()
    if status.st_uid != _probe(path.parent).st_uid:
        raise OutputError(f"{path}: belongs to another user; {VARIABLE} names another folder for compiled code")
    if not stat.S_ISDIR(status.st_mode):
        path.unlink()
        path.mkdir(mode=0o700)
        return
    if status.st_mode & 0o777 != 0o700:
        path.chmod(0o700)
    if _open_to_others(status) and not _open_to_others(path.lstat()):  # a file system without modes would leave it open
        shutil.rmtree(path)
        path.mkdir(mode=0o700)


def _is_ours(path: Path) -> bool:
    try:
        return not (path / TAG).is_symlink() and (path / TAG).read_bytes() == TAG_TEXT
    except OSError:
        return False


def _prune(parent: Path) -> None:
    used = {}
    for path in parent.iterdir():
        with suppress(OSError):
            if re.fullmatch("[0-9a-f]{16}", path.name) and not path.is_symlink() and _is_ours(path):
                used[path] = path.stat().st_mtime
    for path in sorted(used, key=lambda path: (used[path], path), reverse=True)[MAX_VERSIONS:]:
        shutil.rmtree(path, ignore_errors=True)


# -- numba's files --


@functools.cache
def _digest_of(path: str) -> bytes:
    return hashlib.sha256(Path(path).read_bytes()).digest()


def _is_whole(path: str) -> bool:
    try:
        content = memoryview(Path(path).read_bytes())
    except OSError:
        return False
    return hashlib.sha256(content[:-SIZE]).digest() == content[-SIZE:]


def _checked_files() -> tuple[Any, Any]:
    """Return numba's classes of a cached function's files and of their folder; the files with a checksum."""
    from numba.core import caching

    class Files(caching.IndexDataCacheFile):  # type: ignore[misc]
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

    class Folder(caching.UserProvidedCacheLocator):  # type: ignore[misc]
        def get_source_stamp(self) -> bytes:
            return _digest_of(self._py_file)

        def ensure_cache_path(self) -> None:  # in place of a file of that name; any number of processes may do so at once
            path = Path(self.get_cache_path())
            try:
                with suppress(FileExistsError):
                    path.mkdir(parents=True, exist_ok=True)
                if not path.is_dir():
                    with suppress(FileNotFoundError, IsADirectoryError):  # another process removed the file, and may have gone on
                        path.unlink()
                    path.mkdir(parents=True, exist_ok=True)
                if not os.access(path, os.R_OK | os.W_OK | os.X_OK):
                    path.chmod(0o700)
            except OSError as error:
                raise cannot_write(path, error) from error

    return Files, Folder


def _check_files() -> None:
    """Make numba use checked files for every function that it caches from now on; OutputError tells of those it cannot write.

    numba imports all of its compiler before it reads the first file, a tenth of a start. Compiled code needs only addresses of
    the runtime for arrays, which are given here; code that hashes text needs one more, so for it the compiler is imported."""
    import numba
    from llvmlite import binding
    from numba.core import caching, dispatcher

    files, folder = _checked_files()
    known = numba.__version__.startswith(TESTED)
    if known:
        from numba.core.runtime import _nrt_python  # type: ignore[attr-defined]

        for name, address in _nrt_python.c_helpers.items():
            binding.add_symbol(name if name.startswith("_") else f"NRT_{name}", address)

    class Implementation(caching.CompileResultCacheImpl):  # type: ignore[misc]
        _locator_classes = [folder, *caching.CacheImpl._locator_classes]

        def rebuild(self, target_context: Any, payload: Any) -> Any:
            if b"_numba_hashsecret" in payload[0][2][0]:  # code that hashes text, as of a plug-in
                target_context.refresh()
            return super().rebuild(target_context, payload)

    class CheckedCache(caching.FunctionCache):  # type: ignore[misc]
        _impl_class = Implementation

        def __init__(self, function: Any) -> None:
            super().__init__(function)
            self._cache_file = files(self.cache_path, self._impl.filename_base, self._impl.locator.get_source_stamp())

        def load_overload(self, sig: Any, target_context: Any) -> Any:
            if not known:
                return super().load_overload(sig, target_context)
            with self._guard_against_spurious_io_errors():
                return self._load_overload(sig, target_context)

        def save_overload(self, sig: Any, data: Any) -> None:
            try:
                super().save_overload(sig, data)
            except OSError as error:
                raise cannot_write(Path(self.cache_path), error) from error

    dispatcher.FunctionCache = CheckedCache  # type: ignore[attr-defined]
