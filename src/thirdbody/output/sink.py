"""The file under HDF5: after a fault of the system nothing more reaches it."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any


class Sink(io.FileIO):
    """A file that keeps the first fault of the system to itself until `check` is asked, and writes nothing after it.

    Told of a full disk, HDF5 goes on to write a header that promises what is not there (the file opens no more), or dies by a
    segmentation fault when it cannot close. This way the file stays as a kill at that moment would leave it.
    """

    def __init__(self, path: str | Path, mode: str):
        super().__init__(path, mode)
        self._fault: OSError | None = None

    def write(self, data: Any) -> int:
        """Write all of it, or nothing more after a fault."""
        view = memoryview(data).cast("B")
        done = 0
        while done < len(view) and self._fault is None:
            try:
                done += super().write(view[done:]) or 0  # the system may take a part only
            except OSError as error:
                self._fault = error
        return len(view)

    def truncate(self, size: int | None = None) -> int:
        """Set the size, which may be refused as a write may."""
        try:
            return size or 0 if self._fault else super().truncate(size)
        except OSError as error:
            self._fault = error
            return size or 0

    def reserve(self, nbytes: int) -> None:
        """Make the file longer by a hole, which takes no room; HDF5 cuts off what it did not use when it flushes.

        HDF5 writes the length that it is about to have into its header first: a file that is shorter opens no more.
        """
        self.truncate(self.seek(0, io.SEEK_END) + nbytes)

    def check(self) -> None:
        """Raise the fault (OSError) that came while writing."""
        if self._fault is not None:
            raise self._fault
