"""One process at a time writes into a run's folder."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from thirdbody.errors import OutputError


@contextmanager
def lock_folder(folder: Path) -> Iterator[None]:
    """Hold a folder while it is written to; the system frees it however the process ends, `kill -9` included.

    Raises OutputError if another process holds it. Where the system cannot lock a folder nothing is held.
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
