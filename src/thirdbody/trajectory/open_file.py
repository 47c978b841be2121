"""File of a run, open for reading while its run may still be writing: failed reads are repeated."""

import io
import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

import h5py

from thirdbody.errors import InputError
from thirdbody.trajectory.validate import ClosedRun, damage_as_fault, refuse_loaded_code

FILE_NAME = "run.vtkhdf"
TRIES, PAUSE = 10, 0.05
"""Number of tries to read a file that keeps changing, and the pause between two [s]: a frame is written within some ms."""

_SIGNATURE = b"\x89HDF\r\n\x1a\n"

Result = TypeVar("Result")


class OpenFile:
    """Run file; `connect` (re)opens its HDF5 `file`. Raises InputError when there is none."""

    file: h5py.File

    def __init__(self, path: Path):
        if not os.path.isfile(path):  # False also for a name that the system refuses
            raise InputError(f"{path}: no such run; give the folder of a run or its {FILE_NAME}")
        self.path = path
        # Opened through a separate file object: for one path HDF5 gives all readers in a process the data cached by the first of
        # them, however much was written since. It locks no file either, so a run can be read while it is written.
        try:
            self._stream = io.FileIO(path)
        except OSError as error:
            raise InputError(f"{path}: the file cannot be opened ({error})") from error

    def connect(self) -> None:
        """Open the file, or reopen it. Raises InputError when it is not HDF5 or needs foreign code."""
        self._disconnect()
        self._stream.seek(0)
        if self._stream.read(len(_SIGNATURE)) != _SIGNATURE:
            raise InputError(f"{self.path}: not a run of thirdbody (not an HDF5 file)")
        try:
            self.file = h5py.File(self._stream, "r")
        except OSError as error:
            what = "is cut short" if "truncated" in str(error) else "cannot be opened"
            raise InputError(f"{self.path}: the file {what} ({error})") from error
        with damage_as_fault(self.path):
            refuse_loaded_code(self.file)

    def steady(self, read: Callable[[], Result], again: Callable[[], None] | None = None) -> Result:
        """Return the result of `read`, retried if it fails; `again` is called before each retry.

        Raises the errors of `read` for a file that does not change; InputError with the advice to try again for one that is being
        written.
        """
        for number in range(TRIES):
            if self._stream.closed:
                raise ClosedRun(f"{self.path}: this run was closed; open it again")
            before = self._stamp()
            try:
                if number and again is not None:
                    again()
                return read()
            except InputError:
                time.sleep(PAUSE)
                # at least one retry: a half-written file may have been completed within one tick of the file clock
                if number and self._stamp() == before:
                    raise
        raise InputError(f"{self.path}: is being written, and changed whenever it was read; try again in a moment")

    def _stamp(self) -> tuple[int, int]:
        state = os.fstat(self._stream.fileno())
        return state.st_mtime_ns, state.st_size

    def _disconnect(self) -> None:
        if hasattr(self, "file"):
            self.file.close()

    def close(self) -> None:
        """Close the file; may be called twice."""
        self._disconnect()
        self._stream.close()
