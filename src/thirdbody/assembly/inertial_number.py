"""Inertial number of a scene with `solver.inertia = false`: whether inertia is negligible."""

from typing import NamedTuple

import numpy as np

from thirdbody import units
from thirdbody.engine.state import State
from thirdbody.engine.upper_plate import Schedule, ends_of
from thirdbody.errors import InputError
from thirdbody.kernels import schedule as motion
from thirdbody.scene.model import Scene

SLOW, FAST = 0.03, 0.3
"""Inertial number above which a quasi-static run gets a warning, and above which it is refused. Inertial forces are of the order
of its square times the load: 1e-3 and 0.1 of the load."""


class Inertial(NamedTuple):
    """Largest inertial number, index of its body in the tables, largest sliding speed [m/s]."""

    number: float
    body: int
    speed: float


def inertial_number(state: State) -> Inertial | None:
    """Compute I = v sqrt((m + M)/(W L)), the largest of all bodies.

    It is the time in which the load moves a body by its size, over the time in which the drag covers that distance. v: largest
    speed of the drag; m, M: masses of body and patch; W: smallest load on the body; L: its diameter, or the stroke if that is
    shorter. None where no load is prescribed. Source: inertial number of GDR MiDi, Eur. Phys. J. E 14, 2004, 341, with the shear
    rate v/L and the pressure W/L^2.
    """
    upper = state.world.upper
    if upper is None:
        return None
    mass, load = _per_body(state)
    if not (load > 0.0).all():
        return None
    # of each body: twice the distance of its farthest surface point from its centre of mass
    centre = np.repeat(state.bodies.position, np.diff(state.start), axis=0)
    distance = np.linalg.norm(state.spheres.position - centre, axis=1) + state.spheres.radius
    length = np.minimum(2.0 * np.maximum.reduceat(distance, state.start[:-1]), shortest_stroke(upper.schedule))
    speed = upper.schedule.top_speed()
    numbers = speed * np.sqrt(mass / (load * length))
    body = int(np.argmax(numbers))
    return Inertial(float(numbers[body]), body, speed)


def examine_inertia(scene: Scene, state: State) -> list[str]:
    """Return warnings of a quasi-static scene that is too fast. Raises InputError where inertia is as large as the load."""
    result = inertial_number(state) if scene.solver.inertia is False else None
    if result is None or result.number <= SLOW:
        return []
    number = f"the inertial number v sqrt((m + M)/(W L)) of body {state.order[result.body]} is {result.number:.2g}"
    allowed = lambda limit: units.pretty(result.speed * limit / result.number, "velocity")  # noqa: E731
    if result.number > FAST:
        message = (
            f"false is for slow motion, and {number} (at most {FAST:g}: {allowed(FAST)} here): inertial forces are not small "
            "compared with the load; leave solver.inertia out, or lower the speed"
        )
        raise InputError(scene.fault(("solver", "inertia"), message))
    return [
        f"solver.inertia = false: {number} (quasi-static: below {SLOW:g}, {allowed(SLOW)} here): friction and labels may differ "
        "from those with inertia; leave solver.inertia out, or lower the speed"
    ]


def _per_body(state: State) -> tuple[np.ndarray, np.ndarray]:
    """Return mass moving with each body [kg] and smallest load [N], (n,): of its patch, or an equal part of the plate's."""
    upper, n = state.world.upper, state.n_bodies
    assert upper is not None
    pieces = [min(piece.value(piece.start), piece.value(end)) for piece, end in ends_of(upper.schedule.load)]
    minimum, B, f = min(pieces, default=1.0), state.bodies.mass, upper.foundation
    if f is not None:
        return B + upper.mass + f.mass / n, np.full(n, minimum * f.load / n)
    if len(upper.heights) == n:
        return B + upper.mass[upper.patch], minimum * upper.load[upper.patch]
    return B + float(upper.mass.sum()) / n, np.full(n, minimum * float(upper.load.sum()) / n)


def shortest_stroke(schedule: Schedule) -> float:
    """Return the shortest stroke, peak to peak [m]; infinite without strokes."""
    return min((abs(s.b) for s in (*schedule.x, *schedule.y) if s.kind != motion.POLYNOMIAL), default=np.inf)
