"""Contact of the first bodies as a whole: half width, peak pressure, loads of bodies by place, and where the theory holds."""

import math
from dataclasses import dataclass

import numpy as np

from thirdbody.assembly.schedule import schedule
from thirdbody.engine.upper_plate import Zone
from thirdbody.kernels import contact_zone as kernel
from thirdbody.kernels.tables import zone
from thirdbody.scene.model import Scene
from thirdbody.scene.pressure import Hertz, Punch
from thirdbody.units import pretty

Array = np.ndarray

THIN, SMALL = 0.2, 0.1
"""Largest height of the debris over the approach scale a^2/R of the first bodies, and diameter over half width, for which debris
does not change the pressure of the contact (K. L. Johnson, Contact Mechanics, 1985, chapter 4: half-spaces)."""


WHOLE = 1.0 - 1e-4
"""Path of a cycle over its length from which it counts as whole: steps sum it up to 1e-6, and frames are at its end."""


@dataclass(frozen=True)
class Macroscopic:
    """Contact without debris: half width [m], largest pressure [Pa], radius of the upper body [m], 0 where it is flat."""

    half_width: float
    peak: float
    radius: float


def macroscopic(scene: Scene, modulus: float) -> Macroscopic:
    """Return the contact of the first bodies, of effective modulus E* [Pa]. K. L. Johnson, Contact Mechanics, 3.42, 4.43."""
    given, (l_x, l_y) = scene.plates.upper.pressure, scene.domain.size  # type: ignore[union-attr]
    if not isinstance(given, Hertz):
        x, y = given.width if isinstance(given, Punch) else (l_x, l_y)  # type: ignore[union-attr]
        return Macroscopic(0.5 * x, given.load / (x * y), 0.0)  # type: ignore[union-attr]
    if given.body == "ball":
        a = (0.75 * given.load * given.radius / modulus) ** (1.0 / 3.0)
        return Macroscopic(a, 1.5 * given.load / (math.pi * a * a), given.radius)
    line = given.load / l_y
    a = math.sqrt(4.0 * line * given.radius / (math.pi * modulus))
    return Macroscopic(a, 2.0 * line / (math.pi * a), given.radius)


def contact_zone(scene: Scene, modulus: float, positions: Array, friction: float, out: tuple[int, int]) -> tuple[Zone, Array]:
    """Return the contact, and the load of each body [N].

    A load is the pressure at the place of the body (n, 2) [m] times its share of the domain, scaled by one factor so that all
    bodies carry the whole load.
    """
    given, size = scene.plates.upper.pressure, np.array(scene.domain.size)  # type: ignore[union-attr]
    contact, row = macroscopic(scene, modulus), np.zeros(zone.WIDTH)
    row[zone.KIND] = kernel.UNIFORM
    row[zone.HALF_WIDTH], row[zone.RADIUS] = contact.half_width, contact.radius
    row[zone.CENTRE2], row[zone.PERIOD2] = 0.5 * size, size if scene.domain.periodic else 0.0
    if isinstance(given, Punch):
        widths = np.array(given.width)
        row[zone.KIND], row[zone.EDGE] = kernel.PUNCH, given.edge
        row[zone.HALF_WIDTH2] = np.where(widths < size, 0.5 * widths, 0.0)
    elif isinstance(given, Hertz):
        row[zone.KIND] = kernel.BALL if given.body == "ball" else kernel.CYLINDER
    at = positions - 0.5 * size
    parts, gaps = (np.array([function.py_func(x, y, row) for x, y in at]) for function in (kernel.pressure, kernel.gap))
    path, total = schedule(scene, 0.0), float(parts.sum())
    cycles = [path.path(begin, begin + period) for begin, _, period in path.closed_paths()]
    leave = getattr(given, "out_after", None) or (WHOLE * cycles[0] if cycles else 2.0 * contact.half_width)
    nominal = given.load / total if total > 0.0 else 0.0  # type: ignore[union-attr]
    return Zone(row, given.load, nominal, friction, contact.peak, gaps, leave, out), nominal * parts  # type: ignore[union-attr]


def cautions(scene: Scene, contact: Macroscopic, loads: Array, height: float, diameter: float) -> list[str]:
    """Return warnings where debris of this height and diameter [m] is not thin and small in the contact, or few bodies are."""
    words, inside = [], int(np.count_nonzero(loads))
    thickness = height * contact.radius / contact.half_width**2
    if thickness > THIN:
        words.append(
            f"debris {pretty(height, 'length')} high is {thickness:.2g} of a^2/R, the scale of the approach of the first bodies: "
            f"their pressure holds below {THIN:g}; take a softer pair, a larger radius or load"
        )
    if diameter > SMALL * contact.half_width:
        words.append(
            f"debris of {pretty(diameter, 'length')} is {diameter / contact.half_width:.2g} of the half width of the contact, "
            f"{pretty(contact.half_width, 'length')}: the pressure by place holds for less than {SMALL:g}"
        )
    if 3 * inside < len(loads):
        words.append(f"{inside} of {len(loads)} bodies are in the contact at the start: fewer than a third")
    return words
