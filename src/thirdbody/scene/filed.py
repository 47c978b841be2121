"""Debris of the kind `file`: a table of spheres as bodies of the scene."""

from __future__ import annotations

import numpy as np

from ..bodies.clump import Clump
from ..bodies.table import Bodies, load_bodies
from ..errors import InputError
from . import units
from .debris import File
from .model import Scene
from .types import REST


def read_tables(scene: Scene, warnings: list[str]) -> dict[int, Bodies]:
    """The bodies of every table that the scene names, by population. Raises InputError with the faults of all of them.

    Warns of orientations and velocities that a placement has no use for.
    """
    tables: dict[int, Bodies] = {}
    faults = []
    for index, debris in enumerate(scene.debris):
        if not isinstance(debris, File):
            continue
        try:
            tables[index] = load_bodies(scene.beside(debris.file), units.parse)
        except InputError as error:
            faults += [scene.fault(("debris", index, "file"), str(fault)) for fault in error.faults]
            continue
        unused = _unused(tables[index])
        if debris.placement is not None and unused:
            what = " and ".join(unused)
            warnings.append(f'{debris.file}: its {what} are not used: placement = "{debris.placement}" takes the shapes only')
        if debris.placement is None:
            faults += [
                scene.fault(("debris", index, key), f"give only one: {debris.file} has the {key.replace('_', ' ')} of each body")
                for key in ("velocity", "angular_velocity")
                if getattr(debris, key) is not None and getattr(tables[index], key) is not None
            ]
    if faults:
        raise InputError(faults)
    return tables


def _unused(bodies: Bodies) -> list[str]:
    given = {"quaternions": bodies.turned, "velocities": bodies.velocity is not None}
    given["angular velocities"] = bodies.angular_velocity is not None
    return [name for name, there in given.items() if there]


def drawn(debris: File, bodies: Bodies) -> list[Clump]:
    """The shapes of the population, from the first again after the last."""
    count = debris.count or len(bodies.clumps)
    return [bodies.clumps[k % len(bodies.clumps)] for k in range(count)]


def motion(debris: File, bodies: Bodies) -> tuple[np.ndarray, np.ndarray]:
    """Velocity, m/s, and angular velocity, rad/s, of the population: (m, 3) of a file without placement, or (3,) for all."""
    own = debris.placement is None
    v = bodies.velocity if own and bodies.velocity is not None else np.array(debris.velocity or REST)
    w = bodies.angular_velocity if own and bodies.angular_velocity is not None else np.array(debris.angular_velocity or REST)
    return v, w
