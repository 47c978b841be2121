"""File under HDF5 that keeps committed data readable after a kill between any two writes, or a system error."""

import io
import os
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import groupby
from pathlib import Path
from typing import Any

PAGE = 4096
"""Page size in bytes: a kill never tears a write within a page; a longer write may end between two pages."""

NODE = b"TREE"
"""First bytes of the nodes of a chunk index; their sixth byte is the level, 0 for the leaves (HDF5 file format 3.0, III.A.1)."""


def _open_no_link(path: str, flags: int) -> int:
    """Open a file, but not the target of a link of that name."""
    return os.open(path, flags | getattr(os, "O_NOFOLLOW", 0), 0o666)


class Sink(io.FileIO):
    """File that withholds the first system error until `check` is called, and writes nothing after it.

    After a full disk HDF5 goes on to write a header that refers to missing data (the file opens no more), or ends in a
    segmentation fault when it cannot close. With this class the file stays as a kill at that moment would leave it.
    """

    def __init__(self, path: str | Path, mode: str):
        super().__init__(path, mode, opener=_open_no_link)
        self._fault: OSError | None = None
        self._queue: list[tuple[int, bytes]] | None = None
        self._old = self.seek(0, io.SEEK_END)
        self._written: set[int] = set()

    def write(self, data: Any) -> int:
        """Write all data, or nothing after an error; within `in_order` buffer it."""
        if self._queue is not None:
            self._queue.append((self.tell(), bytes(data)))
        else:
            self.put(self.tell(), memoryview(data).cast("B"))
        return len(data)

    def put(self, offset: int, data: bytes | memoryview) -> None:
        """Write to the file itself."""
        done = 0
        while done < len(data) and self._fault is None:
            try:
                self.seek(offset + done)
                done += super().write(data[done:]) or 0  # the system may write only a part
            except OSError as error:
                self._fault = error

    @contextmanager
    def in_order(self) -> Iterator[None]:
        """Order the writes of one flush of HDF5 such that a kill may end them at any point; nothing is written after an error.

        HDF5 writes by address and the length of the file last. A reader then may find an index whose nodes are missing, or lie
        beyond the length. Here pointers are written after their targets: the length, new data, the indices from their roots down
        (a split node keeps its second half until its parent refers to the new neighbour), all else by address, one write per
        page. HDF5 reads nothing back while it flushes.
        """
        self._queue = []
        try:
            yield
            queued, self._queue = sorted(self._queue, key=self._rank), None
            for rank, parts in groupby(queued, self._rank):
                self._put_parts(list(parts), together=rank[0] == 3)
            self._written |= {offset for offset, _ in queued}
        finally:
            self._queue = None

    def _rank(self, part: tuple[int, bytes]) -> tuple[int, int]:
        offset, data = part
        if offset == 0:
            return 0, 0
        if offset >= self._old and offset not in self._written:
            return 1, offset
        return (2, -data[5]) if data[:4] == NODE else (3, offset // PAGE)

    def _put_parts(self, parts: list[tuple[int, bytes]], together: bool) -> None:
        if together:
            start, end = min(offset for offset, _ in parts), max(offset + len(data) for offset, data in parts)
            self.seek(start)
            whole = bytearray(self.read(end - start) or b"")  # bytes between the parts stay unchanged
            for offset, data in parts:
                whole[offset - start : offset - start + len(data)] = data
            parts = [(start, bytes(whole))]
        for offset, data in parts:
            self.put(offset, data)

    def truncate(self, size: int | None = None) -> int:
        """Set the size; may fail as a write may."""
        try:
            return size or 0 if self._fault else super().truncate(size)
        except OSError as error:
            self._fault = error
            return size or 0

    def reserve(self, nbytes: int) -> None:
        """Extend the file by a hole, which uses no disk space; HDF5 cuts off the unused part when it flushes.

        HDF5 writes the coming length into its header first: a shorter file opens no more.
        """
        self.truncate(self.seek(0, io.SEEK_END) + nbytes)

    def check(self) -> None:
        """Raise the error (OSError) that occurred while writing."""
        if self._fault is not None:
            raise self._fault
