"""The file under HDF5: a kill between any two writes, or a fault of the system, leaves what was committed before readable."""

from __future__ import annotations

import io
import os
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import groupby
from pathlib import Path
from typing import Any

PAGE = 4096
"""Bytes, at their multiples, that a kill never tears apart: a longer write may end between two pages of the system."""

NODE = b"TREE"
"""How the nodes of an index of chunks begin; their sixth byte is the level, 0 for the leaves (HDF5 file format 3.0, III.A.1)."""


def _open_no_link(path: str, flags: int) -> int:
    """Open a file, but not what a link of that name points to."""
    return os.open(path, flags | getattr(os, "O_NOFOLLOW", 0), 0o666)


class Sink(io.FileIO):
    """A file that keeps the first fault of the system to itself until `check` is asked, and writes nothing after it.

    Told of a full disk, HDF5 goes on to write a header that promises what is not there (the file opens no more), or dies by a
    segmentation fault when it cannot close. This way the file stays as a kill at that moment would leave it.
    """

    def __init__(self, path: str | Path, mode: str):
        super().__init__(path, mode, opener=_open_no_link)
        self._fault: OSError | None = None
        self._held: list[tuple[int, bytes]] | None = None
        self._old = self.seek(0, io.SEEK_END)
        self._told: set[int] = set()

    def write(self, data: Any) -> int:
        """Write all of it, or nothing more after a fault; within `in_order` keep it."""
        if self._held is not None:
            self._held.append((self.tell(), bytes(data)))
        else:
            self.put(self.tell(), memoryview(data).cast("B"))
        return len(data)

    def put(self, place: int, data: bytes | memoryview) -> None:
        """Write to the file itself."""
        done = 0
        while done < len(data) and self._fault is None:
            try:
                self.seek(place + done)
                done += super().write(data[done:]) or 0  # the system may take a part only
            except OSError as error:
                self._fault = error

    @contextmanager
    def in_order(self) -> Iterator[None]:
        """A flush of HDF5, whose writes reach the file when it ends, in an order that a kill may break off; none after an error.

        HDF5 writes by address and the length of the file last. A reader then meets an index whose nodes are not there yet, or
        lie beyond the length. Here what points to something comes after it: the length, what is new, the indices from their
        roots down (a node that was split keeps its second half until the one above names its new neighbour), all else by
        address, one write for each page. HDF5 reads nothing back while it flushes.
        """
        self._held = []
        try:
            yield
            held, self._held = sorted(self._held, key=self._rank), None
            for rank, parts in groupby(held, self._rank):
                self._put_parts(list(parts), together=rank[0] == 3)
            self._told |= {place for place, _ in held}
        finally:
            self._held = None

    def _rank(self, part: tuple[int, bytes]) -> tuple[int, int]:
        place, data = part
        if place == 0:
            return 0, 0
        if place >= self._old and place not in self._told:
            return 1, place
        return (2, -data[5]) if data[:4] == NODE else (3, place // PAGE)

    def _put_parts(self, parts: list[tuple[int, bytes]], together: bool) -> None:
        if together:
            start, end = min(place for place, _ in parts), max(place + len(data) for place, data in parts)
            self.seek(start)
            whole = bytearray(self.read(end - start) or b"")  # what lies between the parts stays as it is
            for place, data in parts:
                whole[place - start : place - start + len(data)] = data
            parts = [(start, bytes(whole))]
        for place, data in parts:
            self.put(place, data)

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
