"""Contact of the first bodies as a whole: half width, peak pressure, loads of bodies by position, and where the theory holds."""

import math

import numpy as np

from thirdbody.assembly.pressure_map import load_of, read_map
from thirdbody.assembly.schedule import schedule
from thirdbody.engine.upper_plate import Zone
from thirdbody.kernels import contact_zone as kernel
from thirdbody.kernels.tables import zone
from thirdbody.scene.model import Scene
from thirdbody.scene.pressure import Hertz, PressureMap, Profile, Punch
from thirdbody.units import pretty

Array = np.ndarray

THIN, SMALL = 0.2, 0.1
"""Largest height of the debris over the approach scale a^2/R of the first bodies, and diameter over half width, for which debris
does not change the pressure of the contact (K. L. Johnson, Contact Mechanics, 1985, chapter 4: half-spaces)."""

BORDER = 0.05
"""Largest pressure at the border of a map over its peak, where loads jump: Hertz' a thousandth of a half width from the edge."""

WHOLE = 1.0 - 1e-4
"""Path of a cycle over its length from which it counts as whole: steps sum it up to 1e-6, and frames are at its end."""


def hertz_contact(given: Hertz, load: float, width: float, modulus: float) -> tuple[float, float]:
    """Return half width [m] and largest pressure [Pa] under a load [N] without debris, for an effective modulus E* [Pa]; `width`:
    of the domain along a cylinder. K. L. Johnson, Contact Mechanics, 1985: ball 4.22, 4.24; cylinder 4.43, 4.45."""
    if given.body == "ball":
        a = (0.75 * load * given.radius / modulus) ** (1.0 / 3.0)
        return a, 1.5 * load / (math.pi * a * a)
    line = load / width
    a = math.sqrt(4.0 * line * given.radius / (math.pi * modulus))
    return a, 2.0 * line / (math.pi * a)


def values(x: float, y: float, row: Array) -> tuple[float, float]:
    """Return the pressure over the reference pressure, and the gap [m], at a position in a contact of the table `row`."""
    if row[zone.KIND] == kernel.MAP:
        return kernel.map_values.py_func(x, y, row)
    return kernel.pressure.py_func(x, y, row), kernel.gap.py_func(x, y, row)


def contact_zone(scene: Scene, given: Profile, modulus: float, positions: Array) -> tuple[Zone, Array]:
    """Return the contact for an effective modulus E* [Pa], and the load of each body [N].

    A load is the pressure at the position of the body (n, 2) [m] times its share of the domain, scaled by one factor so that all
    bodies carry the whole load.
    """
    size, row, load = np.array(scene.domain.size), np.zeros(zone.WIDTH), load_of(scene, given)
    border = 0.0
    row[zone.KIND], row[zone.CENTRE2] = kernel.UNIFORM, 0.5 * size
    if isinstance(given, Hertz):
        half, peak = hertz_contact(given, load, float(size[1]), modulus)
        row[zone.KIND], row[zone.RADIUS] = kernel.BALL if given.body == "ball" else kernel.CYLINDER, given.radius
        row[zone.HALF_WIDTH] = half
    elif isinstance(given, PressureMap):
        mapped = read_map(scene, given)
        top, half = float(mapped.pressure.max()), mapped.half_width
        peak, border = top * load / mapped.integral, mapped.border_pressure(scene.domain.size) / top
        row[zone.KIND], row[zone.FIRST2], row[zone.RATE2] = kernel.MAP, mapped.first, 1.0 / mapped.spacing
        row[zone.COUNT2] = mapped.pressure.shape[::-1]
        row = np.concatenate([row, (mapped.pressure / top).ravel(), mapped.gap.ravel()])
    else:
        widths = np.array(given.width) if isinstance(given, Punch) else size
        half, peak = 0.5 * float(widths[0]), load / float(widths[0] * widths[1])
        if isinstance(given, Punch):
            row[zone.KIND], row[zone.EDGE] = kernel.PUNCH, given.edge
            row[zone.HALF_WIDTH2] = np.where(widths < size, 0.5 * widths, 0.0)
    at = positions - 0.5 * size
    parts, gaps = np.array([values(x, y, row) for x, y in at]).T
    path, total = schedule(scene, 0.0), float(parts.sum())
    cycles = [path.path(begin, begin + period) for begin, _, period in path.closed_paths()]
    leave = getattr(given, "out_after", None) or (WHOLE * cycles[0] if cycles else 2.0 * half)
    nominal = getattr(given, "debris_fraction", 1.0) * load / total if total > 0.0 else 0.0
    return Zone(row, load, half, peak, nominal, gaps, leave, border), nominal * parts


def cautions(contact: Zone, loads: Array, height: float, diameter: float) -> list[str]:
    """Return warnings where debris of this height and diameter [m] is not thin and small in the contact, or few bodies are."""
    words, inside = [], int(np.count_nonzero(loads))
    if height > THIN * contact.approach_scale:
        words.append(
            f"debris {pretty(height, 'length')} high is {height / contact.approach_scale:.2g} of a^2/R, the scale of the "
            f"approach of the first bodies: their pressure holds below {THIN:g}; take a softer pair, a larger radius or load"
        )
    if diameter > SMALL * contact.half_width:
        words.append(
            f"debris of {pretty(diameter, 'length')} is {diameter / contact.half_width:.2g} of the half width of the contact, "
            f"{pretty(contact.half_width, 'length')}: the pressure profile holds below {SMALL:g}"
        )
    if contact.border > BORDER:
        words.append(
            f"the pressure map ends in the domain at up to {contact.border:.2g} of its largest pressure: there a body loses its "
            "load at once; let the pressure fall to zero within the map, or let the map cover the domain"
        )
    if 3 * inside < len(loads):
        words.append(f"{inside} of {len(loads)} bodies are in the contact at the start: fewer than a third")
    return words
