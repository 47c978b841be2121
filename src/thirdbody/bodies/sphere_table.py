"""Table of spheres: the content of a file of bodies in any format, and its faults."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from thirdbody.errors import Fault, InputError

SHOWN = 10
"""Faults that are listed individually; the others are counted, since a wrong unit or a shifted column spoils every row."""

PER_BODY = {"quaternion": 4, "velocity": 3, "angular_velocity": 3}
"""Optional quantities of a body, and their numbers of components."""


@dataclass(frozen=True, eq=False)
class SphereTable:
    """Spheres of bodies in SI: center (n, 3) [m], radius (n,) [m], clump (n,) the id of the body of each.

    ids (m,): the ids in ascending order, the order of all quantities per body: quaternion (m, 4) w, x, y, z, velocity (m, 3)
    [m/s], angular_velocity (m, 3) [rad/s], each None when the file does not give it. lines (n,): the line of each sphere in a
    text file; None for arrays.
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
        """Return the rows of the spheres of each body, in the order of ids."""
        order = np.argsort(self.clump, kind="stable")
        return np.split(order, np.searchsorted(self.clump[order], self.ids[1:]))

    def body_fault(self, body: int, row: int, message: str) -> Fault:
        """Return a fault of a body, reported at one of its spheres."""
        return Fault(f"clump {self.ids[body]}", message, self.file, None if self.lines is None else int(self.lines[row]))

    def sphere_fault(self, what: str, row: int, message: str) -> Fault:
        """Return a fault of one sphere, with its line or index."""
        if self.lines is None:
            return Fault(f"{what}[{row}]", message, self.file)
        return Fault(what, message, self.file, int(self.lines[row]))

    def named(self, rows: np.ndarray) -> str:
        """Name spheres by their lines or indices, the first few: "lines 4, 9"."""
        numbers = rows if self.lines is None else self.lines[rows]
        word = "sphere" if self.lines is None else "line"
        listed = ", ".join(str(number) for number in numbers[:5]) + (", ..." if len(numbers) > 5 else "")
        return f"{word}{'s' if len(numbers) > 1 else ''} {listed}"


def refuse(faults: Iterable[Fault], total: int | None = None) -> None:
    """Raise InputError with the first faults and the number of the others, if there are any.

    `total` is the number of all faults, when `faults` are not all.
    """
    faults = list(faults)
    if not faults:
        return
    more = (len(faults) if total is None else total) - SHOWN
    summary = [Fault("", f"and {more} more fault{'s' if more > 1 else ''}", faults[0].file)] if more > 0 else []
    raise InputError(faults[:SHOWN] + summary)
