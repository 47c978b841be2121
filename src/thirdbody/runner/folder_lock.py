"""Lock of a run's folder: one process at a time writes there."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from thirdbody.errors import OutputError


@contextmanager
def lock_folder(folder: Path) -> Iterator[None]:
    """Lock a folder while it is written to; the system releases it however the process ends, `kill -9` included.

    Raises OutputError if another process holds the lock. Where the system cannot lock a folder nothing is locked.
    """
    try:
        import fcntl

        handle = os.open(folder, os.O_RDONLY)
    except (ImportError, OSError):
        yield
        return
    try:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise OutputError(f"{folder}: another process is writing this run") from None
        except OSError:  # a file system without locks
            pass
        yield
    finally:
        os.close(handle)
