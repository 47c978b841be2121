"""The folder of compiled code between processes: one per version of all our sources and of numba.

numba's cache notices a change only in the file of the compiled function itself, not in the functions that it inlines; a folder
named by a hash of all sources can never serve stale machine code. Must be set before any compiled module is imported.

The code in the folder is executed, so only this user may be able to write there: a folder of another user is not used.
"""

import atexit
import hashlib
import os
import re
import shutil
import stat
import sys
import tempfile
from contextlib import suppress
from importlib.metadata import version
from pathlib import Path

from thirdbody.errors import OutputError
from thirdbody.jit.gc_pause import paused

VARIABLE = "THIRDBODY_CACHE"
"""The environment variable that names the parent of the cache folders; its content is trusted."""

MAX_VERSIONS = 4
"""Number of folders of earlier versions to keep, so that switching between two checkouts does not recompile each time."""

TAG = "CACHEDIR.TAG"
"""The file that marks our folders, as specified by bford.info/cachedir: backups skip them, and pruning deletes no others."""

TAG_TEXT = b"Signature: 8a477f597d28d172789f06886806bc55\n# This file is a cache directory tag created by thirdbody.\n"

note = ""
"""Message for the user about the folder, shown when code is compiled into it."""

_cached_folder: Path | None = None
_folder: Path | None = None


def cache_folder() -> Path:
    """Return the cache folder, created if needed; `THIRDBODY_CACHE` overrides its parent. Imports nothing heavy.

    Raises OutputError if it cannot be created, or if another user could have written its content.
    """
    global _cached_folder
    if _cached_folder is None:
        parent = _parent()
        path = parent / _fingerprint(version("numba"))
        try:
            _make_private(path)
            _mark(path)
            with suppress(PermissionError):  # a folder that may not be listed is not pruned
                _prune(parent)
        except OSError as error:
            raise cannot_write(path, error) from error
        _cached_folder = path
    return _cached_folder


def folder() -> Path:
    """Return the cache folder, set as numba's. Raises OutputError as `cache_folder` does."""
    global _folder
    if _folder is None:
        result = cache_folder()
        with paused("numba"):
            import numba

        numba.config.CACHE_DIR = str(result)  # type: ignore[attr-defined]
        _folder = result  # last: another thread that reads it relies on numba's setting
    return _folder


def cannot_write(path: Path, error: OSError) -> OutputError:
    """Return the error for compiled code that cannot be stored."""
    reason = error.strerror or str(error)
    return OutputError(f"{path}: compiled code cannot be written ({reason}); {VARIABLE} names another folder for it")


def _parent() -> Path:
    """Return the parent of all cache folders: named by the variable, the user's, or a temporary one."""
    named = os.environ.get(VARIABLE)
    if named:
        path = Path(named).absolute()
        try:
            path.mkdir(parents=True, exist_ok=True)
            _probe(path)
        except OSError as error:
            raise cannot_write(path, error) from error
        return path
    home = _user_cache()
    return home / "thirdbody" if home is not None and _usable(home / "thirdbody") else _temporary()


def _user_cache() -> Path | None:
    """Return the cache folder of this user; None without a home. A variable that is empty or relative counts as unset."""
    named = Path(os.environ.get("XDG_CACHE_HOME", ""))
    if named.is_absolute():
        return named
    home = Path(os.path.expanduser("~")) if os.environ.get("HOME", "~") else Path()
    return home / ".cache" if home.is_absolute() else None


def _usable(path: Path) -> bool:
    """Return whether the folder is this user's, can be created and written, and closed to all others."""
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
    """Return a private folder among temporary files; if its name is in use, one deleted when this process ends."""
    try:
        path = Path(tempfile.gettempdir()) / f"thirdbody-{os.geteuid() if hasattr(os, 'geteuid') else 'user'}"
        try:
            path.mkdir(mode=0o700)
        except FileExistsError:
            status = path.lstat()
            if not stat.S_ISDIR(status.st_mode) or _foreign(status) or (os.name != "nt" and status.st_mode & 0o077):
                return _private_folder(path)
        return path
    except OSError as error:
        raise cannot_write(Path(error.filename or "temporary files"), error) from error


def _private_folder(refused: Path) -> Path:
    """Return a new private folder; child processes share it, and it is deleted when this process ends."""
    global note
    path, owner = tempfile.mkdtemp(prefix="thirdbody-"), os.getpid()
    os.environ[VARIABLE] = path
    note = f"{refused} is no private folder of this user: compiled code is kept until this process ends"

    def remove() -> None:
        if os.getpid() == owner:  # not in a fork
            shutil.rmtree(path, ignore_errors=True)

    atexit.register(remove)
    return Path(path)


def _probe(path: Path) -> os.stat_result:
    """Write into a folder; return the status of the new file. Some file systems assign all files to one user."""
    with tempfile.TemporaryFile(dir=path) as file:
        return os.fstat(file.fileno())


def _foreign(status: os.stat_result) -> bool:
    return hasattr(os, "geteuid") and status.st_uid != os.geteuid()


def _open_to_others(status: os.stat_result) -> bool:
    return os.name != "nt" and bool(status.st_mode & 0o022)


def _make_private(path: Path) -> None:
    """Create a folder into which only this user can write; replace one into which others could write.

    Raises OutputError for one that belongs to another user, OSError if it cannot be created.
    """
    try:
        path.mkdir(mode=0o700)
        return
    except FileExistsError:
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


def _mark(path: Path) -> None:
    """Mark a folder as ours and as the last one used."""
    tag = path / TAG
    if not _is_ours(path):
        if tag.is_dir() and not tag.is_symlink():
            shutil.rmtree(tag)
        tag.unlink(missing_ok=True)
        tag.write_bytes(TAG_TEXT)
    os.utime(path)


def _is_ours(path: Path) -> bool:
    """Return whether a folder has our mark."""
    tag = path / TAG
    try:
        return not tag.is_symlink() and tag.read_bytes() == TAG_TEXT
    except OSError:
        return False


def _fingerprint(numba_version: str) -> str:
    digest = hashlib.sha256(f"{numba_version} {sys.version}".encode())
    root = Path(__file__).parents[1]
    for layer in ("jit", "kernels", "laws", "bodies", "engine", "statics"):
        for file in sorted((root / layer).rglob("*.py")):
            digest.update(file.read_bytes())
    return digest.hexdigest()[:16]


def _prune(parent: Path) -> None:
    """Delete all folders with our mark but those used last. One deleted meanwhile by another process is no error."""
    named = [path for path in parent.iterdir() if re.fullmatch("[0-9a-f]{16}", path.name)]
    ours = [(_last_used(path), path) for path in named if not path.is_symlink() and _is_ours(path)]
    for _, path in sorted(ours, reverse=True)[MAX_VERSIONS:]:
        shutil.rmtree(path, ignore_errors=True)


def _last_used(path: Path) -> float:
    try:
        return path.stat().st_mtime
    except OSError:
        return 0.0
