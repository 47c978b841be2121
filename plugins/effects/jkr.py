"""Neck of an adhesive Hertz contact in closed form (Johnson, Kendall and Roberts 1971, Proc. R. Soc. A 324, 301).

With the contact radius a, effective radius R, modulus E* and work of adhesion w

    F = 4 E* a^3/(3 R) - sqrt(8 pi w E* a^3)        d = a^2/R - sqrt(2 pi w a/E*)

Let a_s = (pi w R^2/(8 E*))^(1/3), the contact radius at which a neck breaks as the bodies part, and a = a_s y^2. Then

    d = (a_s^2/R) (y^4 - 4 y)     F = (4 E* a_s^3/(3 R)) (y^6 - 6 y^3)     U = (8 E* a_s^5/(15 R^2)) (y^10 - 10 y^7 + 15 y^4 - 6)

where U, the integral of F over d, is zero where the neck breaks: y = 1, d = -3 a_s^2/R. At y^3 = 3 the force is least,
-3/2 pi w R; at y^3 = 4 the overlap is zero. A constant pull P beside the neck, as long as that lasts, adds -P to F and
-P (d + 3 a_s^2/R) to U.
"""

import math
from typing import NamedTuple

from thirdbody.plugin import helper

LONGEST = 3.0
"""Length of a neck that breaks over a_s^2/R."""

JUMPS = 6.0 + 9.0 * 4.0 ** (4.0 / 3.0)
"""Energy lost as a neck forms at touch and as it breaks, over 8 E* a_s^5/(15 R^2): the negative of U at y^3 = 4. Nine tenths
are lost as the neck forms; all of it is booked there, so that a neck that breaks has no energy left."""

FOLD = 1e-9
"""Least y^3 - 1 by which slopes are divided: they are infinite where the neck breaks."""


class Neck(NamedTuple):
    """A neck at some overlap: `scale` a_s [m]; y; `joined`: 1, or 0 where the bodies are apart; constant `pull` beside it [N]."""

    scale: float
    y: float
    joined: float
    pull: float


@helper
def cube_root(x):
    """x^(1/3) for 1e-90 < x < 1e90 to round-off, without `pow`, so that a loop over contacts is vectorised.

    1/3 = 1/4 + 1/16 + 1/64 + ...: square roots give it within a third; each of Halley's steps cubes the error.
    """
    fourth = math.sqrt(math.sqrt(x))
    sixteenth = math.sqrt(math.sqrt(fourth))
    of_64 = math.sqrt(math.sqrt(sixteenth))
    of_256 = math.sqrt(math.sqrt(of_64))
    z = fourth * sixteenth * of_64 * of_256
    for _ in range(4):
        cube = z * z * z
        z = z * (cube + 2.0 * x) / (2.0 * cube + x)
    return z


@helper
def root(excess):
    """y of y^4 - 4 y + 3 = `excess` >= 0, the root that is at least 1, to round-off.

    With y = 1 + t the equation is t^2 (t^2 + 4 t + 6) = `excess`: no cancellation where the neck breaks, t = 0. The start is
    within 12 %, Halley's first step gives 0.12 %, the second 1.5e-9, the third 2e-16 (1e-30 < `excess` < 1e20).
    The closed form of the quartic (Parteli et al. 2014, Sci. Rep. 4, 6227) loses half the digits there.
    """
    r = math.sqrt(excess)
    start = r / (math.sqrt(6.0) + math.sqrt(r))
    t = r / math.sqrt((start + 4.0) * start + 6.0)
    for _ in range(3):
        p = ((t + 4.0) * t + 6.0) * t * t - excess
        slope, bend = 4.0 * t * ((t + 3.0) * t + 3.0), 12.0 * (t * (t + 2.0) + 1.0)
        t = t - 2.0 * p * slope / max(2.0 * slope * slope - p * bend, 1e-300)
    return 1.0 + t


@helper
def neck_since(overlap, before, radius, adhesion, pull, joined):
    """`Neck` at an overlap [m]. `adhesion`: w/E* [m]; `joined`: 1 if there was one before. It forms at touch, breaks at y = 1.

    Where it breaks in this step, y is that of the overlap `before` it [m].
    """
    scale = cube_root(math.pi / 8.0 * adhesion * radius * radius)
    per_overlap = radius / (scale * scale)
    still = joined if LONGEST + overlap * per_overlap > 0.0 else 0.0
    now = 1.0 if overlap > 0.0 else still
    excess = LONGEST + (overlap if now > 0.0 or joined == 0.0 else before) * per_overlap
    return Neck(scale, root(max(excess, 0.0)), now, pull)


@helper
def force_of_a_jump(n, moved, forms, explicit, radius, e_star):
    """Force [N] at the end of a step in which a neck forms or breaks, with which the work of the step is that of the neck.

    That work W [J] is from touch to here, or from the last overlap with a neck to where it breaks; `moved` is the overlap that
    came in the step [m]; `forms`: 1, or 0 where it breaks. An implicit step books its last force: F = W/`moved`. One of velocity
    Verlet (`explicit` 1, else 0) books the mean of its forces at both ends, (F_0 + F)/2, and the next one F/2 more, so F that is
    off by f changes the work by f times `moved`: F = W/`moved` + F_1/2 - F_0/2.
    """
    whole = Neck(n.scale, n.y, 1.0, n.pull)
    half, stored = 0.5 * explicit * force_of(whole, radius, e_star), stored_of(whole, radius, e_star)
    gained = stored + loss_of(n, radius, e_star)
    return half + gained / max(moved, 1e-300) if forms > 0.0 else -stored / min(moved, -1e-300) - half


@helper
def stiffness_of_a_jump(n, moved, forms, radius, e_star):
    """dF/dd [N/m] of `force_of_a_jump` in an implicit step."""
    force = force_of_a_jump(n, moved, forms, 0.0, radius, e_star)
    return (force_of(n, radius, e_star) - force) / max(moved, 1e-300) if forms > 0.0 else -force / min(moved, -1e-300)


@helper
def force_of(n, radius, e_star):
    """Force [N], negative: attractive."""
    cube = n.y * n.y * n.y
    return n.joined * (4.0 / 3.0 * e_star / radius * n.scale * n.scale * n.scale * cube * (cube - 6.0) - n.pull)


@helper
def energy_unit(n, radius, e_star):
    """8 E* a_s^5/(15 R^2) [J]"""
    square = n.scale * n.scale / radius
    return 8.0 / 15.0 * e_star * n.scale * square * square


@helper
def stored_of(n, radius, e_star):
    """Energy [J] to break the neck is minus this: zero where it breaks."""
    fourth = n.y * n.y * n.y * n.y
    cube = n.y * n.y * n.y
    stretch = (n.y - 1.0) * (n.y - 1.0) * (n.y * (n.y + 2.0) + 3.0) * n.scale * n.scale / radius  # overlap + 3 a_s^2/R
    elastic = energy_unit(n, radius, e_star) * (fourth * (cube * (cube - 10.0) + 15.0) - 6.0)
    return n.joined * (elastic - n.pull * stretch)


@helper
def loss_of(n, radius, e_star):
    """Energy [J] lost as a neck forms at touch and as it breaks: the negative of U at y^3 = 4."""
    return JUMPS * energy_unit(n, radius, e_star) + n.pull * LONGEST * n.scale * n.scale / radius


@helper
def stiffness_of(n, e_star):
    """dF/dd = 2 E* a (y^3 - 3)/(y^3 - 1) [N/m]: negative beyond the largest pull."""
    cube = n.y * n.y * n.y
    return n.joined * (2.0 * e_star * n.scale * n.y * n.y * (cube - 3.0) / max(cube - 1.0, FOLD))


@helper
def squared_radius_rate_of(n, radius):
    """d(a^2)/dd = R y^3/(y^3 - 1) [m]"""
    cube = n.y * n.y * n.y
    return n.joined * (radius * cube / max(cube - 1.0, FOLD))


@helper
def peak_pressure_of(n, radius, e_star):
    """Pressure in the middle of the contact, 2 E* a/(pi R) - sqrt(2 w E*/(pi a)) [Pa]; 0 where it pulls there, too."""
    return n.joined * max(2.0 * e_star * n.scale / (math.pi * radius) * (n.y * n.y - 2.0 / n.y), 0.0)


def pull_off(work_of_adhesion: float, radius: float) -> float:
    """Return the largest pull 3/2 pi w R [N]."""
    return 1.5 * math.pi * work_of_adhesion * radius


def longest_neck(work_of_adhesion: float, e_star: float, radius: float) -> float:
    """Return the length of a neck that breaks, 3 a_s^2/R [m]."""
    scale = math.cbrt(math.pi * work_of_adhesion * radius * radius / (8.0 * e_star))
    return LONGEST * scale * scale / radius
