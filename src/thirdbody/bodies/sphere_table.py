"""A sheet of spheres: what a table of bodies holds, whatever file it came from, and how its faults are told."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from thirdbody.errors import Fault, InputError

SHOWN = 10
"""Faults that are told one by one; the others are counted, for a wrong unit or a shifted column spoils every row."""

PER_BODY = {"quaternion": 4, "velocity": 3, "angular_velocity": 3}
"""What a body may have besides its spheres, and the numbers that this takes."""


@dataclass(frozen=True, eq=False)
class SphereTable:
    """Spheres of bodies in SI: center (n, 3) m, radius (n,) m, clump (n,) the id of the body that each belongs to.

    ids (m,): the ids in rising order, the order of all that is given per body: quaternion (m, 4) w, x, y, z, velocity
    (m, 3) m/s, angular_velocity (m, 3) rad/s, each None when the file does not give it. lines (n,): where each sphere
    stands in a text file; None for arrays.
    """

    file: str
    center: np.ndarray
    radius: np.ndarray
    clump: np.ndarray
    ids: np.ndarray
    quaternion: np.ndarray | None
    velocity: np.ndarray | None
    angular_velocity: np.ndarray | None
    lines: np.ndarray | None = None

    def members(self) -> list[np.ndarray]:
        """Rows of the spheres of each body, in the order of ids."""
        order = np.argsort(self.clump, kind="stable")
        return np.split(order, np.searchsorted(self.clump[order], self.ids[1:]))

    def body_fault(self, body: int, row: int, message: str) -> Fault:
        """A fault of a body, told at one of its spheres."""
        return Fault(f"clump {self.ids[body]}", message, self.file, None if self.lines is None else int(self.lines[row]))

    def sphere_fault(self, what: str, row: int, message: str) -> Fault:
        """A fault of one sphere: at its line, or with its index."""
        if self.lines is None:
            return Fault(f"{what}[{row}]", message, self.file)
        return Fault(what, message, self.file, int(self.lines[row]))

    def named(self, rows: np.ndarray) -> str:
        """Spheres by their lines or indices, the first few: "lines 4, 9"."""
        numbers = rows if self.lines is None else self.lines[rows]
        word = "sphere" if self.lines is None else "line"
        listed = ", ".join(str(number) for number in numbers[:5]) + (", ..." if len(numbers) > 5 else "")
        return f"{word}{'s' if len(numbers) > 1 else ''} {listed}"


def refuse(faults: Iterable[Fault], total: int | None = None) -> None:
    """Raises InputError with the first faults and the number of the others; nothing happens when there are none.

    `total` is the number of all faults, when `faults` are not all.
    """
    faults = list(faults)
    if not faults:
        return
    more = (len(faults) if total is None else total) - SHOWN
    rest = [Fault("", f"and {more} more fault{'s' if more > 1 else ''}", faults[0].file)] if more > 0 else []
    raise InputError(faults[:SHOWN] + rest)
