"""Adhesion of elastic spheres: with necks (JKR), by a constant force (DMT), or between the two by Tabor's number.

    [effects.adhesion]
    work_of_adhesion = "50 mJ/m2"
    model = "auto"

What the models stand for, what friction feels, and what both change: README.md of the plug-ins, "Adhesion". `dmt` (Derjaguin,
Muller and Toporov 1975) adds 2 pi w R while Hertz's contact touches; `jkr` (Johnson, Kendall and Roberts 1971) replaces that
contact. Tabor's number mu = (R w^2/(E*^2 z_0^3))^(1/3) (1977, J. Colloid Interface Sci. 58, 2) decides: below 0.1 DMT, above 5
JKR (Johnson and Greenwood 1997, J. Colloid Interface Sci. 192, 326). `auto` (Schwarz 2003, J. Colloid Interface Sci. 261, 99): a
part s of w makes a neck, the rest is a constant pull beside it, so the pull-off force is (2 - s/2) pi w R. With s = k/(1 + k), k
= (mu/0.352)^(3/2), it is that of Maugis (1992, J. Colloid Interface Sci. 150, 243; lambda = 1.157 mu) within 0.5 %, in the form
of Carpick, Ogletree and Salmeron (1999, J. Colloid Interface Sci. 211, 395). Friction feels the load plus twice the pull-off
force of the neck (Thornton and Yin 1991, Powder Technol. 65, 153) and once the constant pull (Derjaguin 1934); or the load alone.

The neck in closed form (Johnson, Kendall and Roberts 1971, Proc. R. Soc. A 324, 301), with the contact radius a, effective radius
R, modulus E* and work of adhesion w:

    F = 4 E* a^3/(3 R) - sqrt(8 pi w E* a^3)        d = a^2/R - sqrt(2 pi w a/E*)

Let a_s = (pi w R^2/(8 E*))^(1/3), the contact radius at which a neck breaks as the bodies part, and a = a_s y^2. Then

    d = (a_s^2/R) (y^4 - 4 y)     F = (4 E* a_s^3/(3 R)) (y^6 - 6 y^3)     U = (8 E* a_s^5/(15 R^2)) (y^10 - 10 y^7 + 15 y^4 - 6)

where U, the integral of F over d, is zero where the neck breaks: y = 1, d = -3 a_s^2/R. At y^3 = 3 the force is least,
-3/2 pi w R; at y^3 = 4 the overlap is zero. A constant pull P beside the neck, as long as that lasts, adds -P to F and
-P (d + 3 a_s^2/R) to U.
"""

import math
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from thirdbody.plugin import Adhesion, Law, Normal, Option, Options, Pair, Plugin, e_star, helper, kernel, pretty

DMT_BELOW, JKR_ABOVE = 0.1, 5.0  # Tabor's numbers up to which DMT holds, and from which on JKR does
TRANSITION = 0.352  # Tabor's number at which half of the work of adhesion makes the neck: the pull-off force is 7/4 pi w R
MIN_WORK = 1e-15  # smallest work of adhesion of the forms with necks [J/m2], which are scaled by it: with less they are Hertz's
BEYOND = 2.0  # reach over the length of a neck that breaks: steps that bring bodies to touch, or break the neck, end within it
LONGEST = 3.0  # length of a neck that breaks over a_s^2/R

JUMPS = 6.0 + 9.0 * 4.0 ** (4.0 / 3.0)
"""Energy lost as a neck forms at touch and as it breaks, over 8 E* a_s^5/(15 R^2): the negative of U at y^3 = 4. Nine tenths
are lost as the neck forms; all of it is booked there, so that a neck that breaks has no energy left."""

FOLD = 1e-9  # least y^3 - 1 by which slopes are divided: they are infinite where the neck breaks


ONLY_NECKS = 1e300  # k of `jkr`: s = k/(1 + k) is 1 to the last bit


class NeckParameters(NamedTuple):
    """Parameters of contacts with necks and a constant pull, SI."""

    e_star: float  # Pa
    adhesion: float  # w/E*, m
    grip: float  # a third of the load of friction beyond the force if all is neck, over the radius, N/m
    part_steps: float  # 1 in explicit steps, 2 in implicit ones: jumps count from where they are within the step
    pull: float  # 2 pi w, N/m
    necks: float  # k = (mu/TRANSITION)^(3/2) over the root of the radius, 1/m^(1/2)


class DmtParameters(NamedTuple):
    """Pull-off force, and what friction does not feel of it, over the radius, N/m."""

    pull: float
    grip: float


class Neck(NamedTuple):
    """A neck at some overlap: `scale` a_s [m]; y; `joined`: 1, or 0 where the bodies are apart; constant `pull` beside it [N]."""

    scale: float
    y: float
    joined: float
    pull: float


@helper
def cube_root(x):
    """x^(1/3) for 1e-90 < x < 1e90 to round-off, without `pow`, so that a loop over contacts is vectorised. 1/3 = 1/4 + 1/16 +
    1/64 + ...: square roots give it within a third; each of Halley's steps cubes the error."""
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
    """y of y^4 - 4 y + 3 = `excess` >= 0, the root that is at least 1, to round-off. With y = 1 + t the equation is t^2 (t^2 + 4
    t + 6) = `excess`: no cancellation where the neck breaks, t = 0. The start is within 12 %, Halley's first step gives 0.12 %,
    the second 1.5e-9, the third 2e-16 (1e-30 < `excess` < 1e20). The closed form of the quartic (Parteli et al. 2014, Sci. Rep.
    4, 6227) loses half the digits there."""
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
    Where it breaks in this step, y is that of the overlap `before` it [m]."""
    scale = cube_root(math.pi / 8.0 * adhesion * radius * radius)
    per_overlap = radius / (scale * scale)
    still = joined if LONGEST + overlap * per_overlap > 0.0 else 0.0
    now = 1.0 if overlap > 0.0 else still
    excess = LONGEST + (overlap if now > 0.0 or joined == 0.0 else before) * per_overlap
    return Neck(scale, root(max(excess, 0.0)), now, pull)


@helper
def force_of_a_jump(n, moved, forms, explicit, radius, e_star):
    """Force [N] at the end of a step in which a neck forms or breaks, with which the work of the step is that of the neck. That
    work W [J] is from touch to here, or from the last overlap with a neck to where it breaks; `moved` is the overlap that came in
    the step [m]; `forms`: 1, or 0 where it breaks. An implicit step books its last force: F = W/`moved`. One of velocity Verlet
    (`explicit` 1, else 0) books the mean of its forces at both ends, (F_0 + F)/2, and the next one F/2 more, so F that is off by
    f changes the work by f times `moved`: F = W/`moved` + F_1/2 - F_0/2."""
    whole = Neck(n.scale, n.y, 1.0, n.pull)
    half, stored = 0.5 * explicit * force_of(whole, radius, e_star), stored_of(whole, radius, e_star)
    gained = stored + loss_of(n, radius, e_star)
    return half + gained / max(moved, 1e-300) if forms > 0.0 else -stored / min(moved, -1e-300) - half


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
def neck_fraction(k):
    """Part s of the work of adhesion that makes the neck."""
    return k / (1.0 + k)


@helper
def neck_of(c, p, joined):
    """`Neck` of a contact, of the part of the work of adhesion that is Schwarz's short range, and the pull of the rest."""
    fraction = neck_fraction(p.necks * math.sqrt(c.radius))
    pull = (1.0 - fraction) * p.pull * c.radius
    return neck_since(c.overlap, c.overlap - c.moved, c.radius, fraction * p.adhesion, pull, joined)


@kernel
def necks(c, p, h):
    """Force, area and energy of the neck; what the jumps lose is booked as the neck forms. h: whether there was a neck; what it
    lost [J]."""
    n = neck_of(c, p, h[0])
    forms = n.joined * (1.0 - h[0])
    lost = forms * loss_of(n, c.radius, p.e_star)
    jumps = p.part_steps > 0.0 and c.moved != 0.0 and n.joined != h[0]
    of_jump = force_of_a_jump(n, c.moved, forms, 1.0 if p.part_steps == 1.0 else 0.0, c.radius, p.e_star)
    # in the middle of the contact, 2 E* a/(pi R) - sqrt(2 w E*/(pi a)): 0 where it pulls there, too; d(a^2)/dd = R y^3/(y^3 - 1)
    pressure, cube = 2.0 * p.e_star * n.scale / (math.pi * c.radius) * (n.y * n.y - 2.0 / n.y), n.y * n.y * n.y
    answer = Normal(
        of_jump if jumps else force_of(n, c.radius, p.e_star), n.joined * n.scale * n.y * n.y, stored_of(n, c.radius, p.e_star),
        lost, n.joined * max(pressure, 0.0), n.joined * (c.radius * cube / max(cube - 1.0, FOLD)), )  # fmt: skip
    return answer, (n.joined, h[1] + lost)


@kernel
def necks_tangent(c, p, h):
    """dF/dd [N/m]: 2 E* a (y^3 - 3)/(y^3 - 1), negative beyond the largest pull; of a jump in an implicit step."""
    n = neck_of(c, p, h[0])
    force = force_of_a_jump(n, c.moved, n.joined, 0.0, c.radius, p.e_star)
    forms, breaks = (force_of(n, c.radius, p.e_star) - force) / max(c.moved, 1e-300), -force / min(c.moved, -1e-300)
    jumps, cube = p.part_steps > 0.0 and c.moved != 0.0 and n.joined != h[0], n.y * n.y * n.y
    smooth = n.joined * (2.0 * p.e_star * n.scale * n.y * n.y * (cube - 3.0) / max(cube - 1.0, FOLD))
    return (forms if n.joined > 0.0 else breaks) if jumps else smooth


@kernel
def necks_grip(c, n, p):
    """Twice the pull-off force 3/2 pi s w R of the neck, and the pull 2 pi (1 - s) w R [N]; none of the force of the step in
    which the neck breaks."""
    fraction = neck_fraction(p.necks * math.sqrt(c.radius))
    return p.grip * (2.0 + fraction) * c.radius if n.contact_radius > 0.0 else -n.force


@kernel
def dmt(c, n, p):
    """F = -2 pi w R and U = F d while the bodies touch."""
    pull = p.pull * c.radius if c.overlap > 0.0 else 0.0
    return Adhesion(-pull, -pull * c.overlap)


@kernel
def dmt_tangent(c, n, p):
    return 0.0


@kernel
def dmt_grip(c, n, p):
    """Minus the attraction where friction feels the external load only [N]."""
    return p.grip * c.radius if c.overlap > 0.0 else 0.0


def tabor_number(work_of_adhesion: float, modulus: float, radius: float, distance: float) -> float:
    """Return (R w^2/(E*^2 z_0^3))^(1/3) [-]."""
    return math.cbrt(radius * work_of_adhesion**2 / (modulus**2 * distance**3))


def mix_necks(pair: Pair, options: Options) -> NeckParameters:
    """Return the parameters of a pair: those of JKR, the pull of DMT, and how both are mixed."""
    w, modulus = max(options["work_of_adhesion"], MIN_WORK), e_star(pair.a, pair.b)
    grip = 3.0 * math.pi * w if options["friction_load"] == "with_pull_off" else 0.0
    k = (tabor_number(w, modulus, 1.0, options["equilibrium_distance"]) / TRANSITION) ** 1.5
    k = ONLY_NECKS if options["model"] == "jkr" else k
    return NeckParameters(modulus, w / modulus, grip / 3.0, 0.0, 2.0 * math.pi * options["work_of_adhesion"], k)


def mix_dmt(pair: Pair, options: Options) -> DmtParameters:
    """Return the pull-off force over the radius, and what of it friction does not feel."""
    pull = 2.0 * math.pi * options["work_of_adhesion"]
    return DmtParameters(pull, 0.0 if options["friction_load"] == "with_pull_off" else -pull)


def neck_length(pair: Pair, options: Options, radius: float) -> float:
    """Return how far bodies of at most this effective radius [m] may be apart before their neck breaks [m], times `BEYOND`."""
    scale = math.cbrt(math.pi * max(options["work_of_adhesion"], MIN_WORK) * radius * radius / (8.0 * e_star(pair.a, pair.b)))
    return BEYOND * (LONGEST * scale * scale / radius)


def pull_off_forces(pair: Pair, options: Options, radius: Any) -> Any:
    """Return the forces that part contacts of these effective radii (n,) [N]."""
    fraction = 0.0 if options["model"] == "dmt" else neck_fraction(mix_necks(pair, options).necks * np.sqrt(radius))
    return (2.0 - 0.5 * fraction) * math.pi * options["work_of_adhesion"] * radius


def tabor_remark(pair: Pair, options: Options, low: float, high: float) -> tuple[str, bool]:
    """Return what the model is between two effective radii, and whether it hardly fits: w, Tabor's numbers, pull-off forces."""
    w, model = options["work_of_adhesion"], options["model"]
    numbers = [tabor_number(w, e_star(pair.a, pair.b), r, options["equilibrium_distance"]) for r in (low, high)]
    ends = np.array([low, high])
    forces = pull_off_forces(pair, options, ends)
    first, last = (f"{x:.3g} pi w R" for x in forces / np.maximum(math.pi * w * ends, 1e-300))
    text = (
        f"w = {pretty(w, 'energy_per_area')}, {model}; Tabor's number {numbers[0]:.2g} to {numbers[1]:.2g}, pull-off "
        f"{pretty(float(forces[0]), 'force')} ({first}) to {pretty(float(forces[1]), 'force')} ({last})"
    )
    off = forces / pull_off_forces(pair, {**options, "model": "auto"}, ends) - 1.0 if w > 0.0 else 0.0 * ends
    if model == "dmt" and numbers[1] > DMT_BELOW:
        return f"{text}; dmt holds below {DMT_BELOW:g}: it pulls up to {100.0 * off[1]:.0f} % too strongly, auto does not", True
    if model == "jkr" and numbers[0] < JKR_ABOVE:
        return f"{text}; jkr holds above {JKR_ABOVE:g}: it pulls up to {-100.0 * off[0]:.0f} % too weakly, auto does not", True
    return text, False


ADHESION = Law(
    name="adhesion",
    stage="normal",
    kernel=necks,
    tangent=necks_tangent,
    parameters=NeckParameters,
    mix=mix_necks,
    in_steps=lambda p, integrator: p._replace(part_steps={"explicit": 1.0, "implicit": 2.0}[integrator]),
    history=("joined", "adhesion_work"),
    replaces="hertz",
    reach=neck_length,
    added_load=necks_grip,
    pull_off=pull_off_forces,
    remark=tabor_remark,
    variant=lambda options: DMT if options["model"] == "dmt" else None,
    options=(
        Option(
            "work_of_adhesion", "energy_per_area", None, low=0.0, pair_key="work_of_adhesion",
            doc='energy per area to part both surfaces, unless a pair has its own, such as "50 mJ/m2"',
        ),
        Option(
            "model", "dimensionless", "auto", words=("auto", "jkr", "dmt"),
            doc="'jkr': necks; 'dmt': a constant force; 'auto': between them by Tabor's number",
        ),
        Option(
            "friction_load", "dimensionless", "with_pull_off", words=("with_pull_off", "external"),
            doc="load in the friction limit: external load plus pull-off force (JKR: plus twice that), or external load alone",
        ),
        Option("equilibrium_distance", "length", 2e-10, low=1e-11, doc="distance of the surfaces at rest, for Tabor's number"),
    ),
    source="Johnson, Kendall and Roberts 1971; Derjaguin, Muller and Toporov 1975; between: Schwarz 2003, Maugis 1992",
)  # fmt: skip

DMT: Law = replace(
    ADHESION, stage="adhesion", kernel=dmt, tangent=dmt_tangent, parameters=DmtParameters, mix=mix_dmt, history=(), replaces="",
    reach=None, added_load=dmt_grip, variant=None, in_steps=None,
)  # fmt: skip

PLUGIN = Plugin(
    name="adhesion", effects=(ADHESION,), source="Johnson, Kendall and Roberts 1971; Derjaguin, Muller and Toporov 1975"
)
