"""Adhesion of elastic spheres: with necks (JKR), by a constant force (DMT), or between the two by Tabor's number.

    [effects.adhesion]
    work_of_adhesion = "50 mJ/m2"
    model = "auto"

`jkr` (Johnson, Kendall and Roberts 1971; forms in `jkr`): a neck forms at touch, overlap zero, and lasts until the bodies are
`longest_neck` apart. It stands for soft or large spheres. `dmt` (Derjaguin, Muller and Toporov 1975): Hertz's contact, and
2 pi w R as long as it touches. It stands for stiff or small ones. The number mu = (R w^2/(E*^2 z_0^3))^(1/3) of Tabor (1977, J.
Colloid Interface Sci. 58, 2), with the equilibrium distance z_0 of the surfaces, decides: below 0.1 DMT, above 5 JKR (Johnson
and Greenwood 1997, J. Colloid Interface Sci. 192, 326).

`auto` is right between them, too (Schwarz 2003, J. Colloid Interface Sci. 261, 99): a part s of w acts at short range and makes
a neck, the rest at long range is a constant pull beside it, so the pull-off force is (2 - s/2) pi w R. The s of a contact is that
with which this is the pull-off force of Maugis (1992, J. Colloid Interface Sci. 150, 243; lambda = 1.157 mu), in the form of
Carpick, Ogletree and Salmeron (1999, J. Colloid Interface Sci. 211, 395), s = k/(1 + k): with k = (mu/0.352)^(3/2) within 0.5 %.

The work of adhesion is that of all pairs of materials, or a pair's own: it is a property of both, and there is no mixing rule.

`jkr` and `auto` replace the normal law. Friction feels the load plus twice the pull-off force of the neck (Thornton and Yin 1991,
Powder Technol. 65, 153) and once the constant pull, which is Hertz's force with DMT (Derjaguin 1934); or the load alone.
"""

import math
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from thirdbody.plugin import Adhesion, Law, Normal, Option, Options, Pair, Plugin, e_star, helper, kernel, pretty

from .jkr import (
    force_of,
    force_of_a_jump,
    longest_neck,
    loss_of,
    neck_since,
    peak_pressure_of,
    squared_radius_rate_of,
    stiffness_of,
    stiffness_of_a_jump,
    stored_of,
)

DMT_BELOW, JKR_ABOVE = 0.1, 5.0
"""Tabor's numbers up to which DMT holds, and from which on JKR does."""

TRANSITION = 0.352
"""Tabor's number at which half of the work of adhesion makes the neck: the pull-off force is 7/4 pi w R."""

MIN_WORK = 1e-15
"""Smallest work of adhesion of the forms with necks [J/m2], which are scaled by it: with less they are Hertz's."""

BEYOND = 2.0
"""Reach over the length of a neck that breaks: steps that bring bodies to touch, or break the neck, end within it."""


class JkrParameters(NamedTuple):
    """Parameters of contacts with necks, SI."""

    e_star: float  # Pa
    adhesion: float  # w/E*, m
    grip: float  # load of friction beyond the force, over the radius, N/m
    part_steps: float  # 1 in explicit steps, 2 in implicit ones: jumps count from where they are within the step


class AutoParameters(NamedTuple):
    """Those of contacts with necks and a constant pull, SI."""

    e_star: float
    adhesion: float
    grip: float
    part_steps: float
    pull: float  # 2 pi w, N/m
    necks: float  # k = (mu/TRANSITION)^(3/2) over the root of the radius, 1/m^(1/2)


class DmtParameters(NamedTuple):
    """Pull-off force, and what friction does not feel of it, over the radius, N/m."""

    pull: float
    grip: float


@helper
def with_neck(c, p, adhesion, pull, h):
    """Force, area and energy of the neck (`jkr.neck`); what the jumps lose is booked as the neck forms.

    adhesion: w/E* of the neck [m]; pull: constant one beside it [N]; h: whether there was a neck; what it lost [J].
    """
    n = neck_since(c.overlap, c.overlap - c.moved, c.radius, adhesion, pull, h[0])
    forms = n.joined * (1.0 - h[0])
    lost = forms * loss_of(n, c.radius, p.e_star)
    jumps = p.part_steps > 0.0 and c.moved != 0.0 and n.joined != h[0]
    of_jump = force_of_a_jump(n, c.moved, forms, 1.0 if p.part_steps == 1.0 else 0.0, c.radius, p.e_star)
    answer = Normal(
        of_jump if jumps else force_of(n, c.radius, p.e_star), n.joined * n.scale * n.y * n.y,
        stored_of(n, c.radius, p.e_star), lost, peak_pressure_of(n, c.radius, p.e_star), squared_radius_rate_of(n, c.radius),
    )  # fmt: skip
    return answer, (n.joined, h[1] + lost)


@helper
def stiffness_with_neck(c, p, adhesion, pull, h):
    """dF/dd of `with_neck` [N/m]."""
    n = neck_since(c.overlap, c.overlap - c.moved, c.radius, adhesion, pull, h[0])
    jumps = p.part_steps > 0.0 and c.moved != 0.0 and n.joined != h[0]
    of_jump = stiffness_of_a_jump(n, c.moved, n.joined, c.radius, p.e_star)
    return of_jump if jumps else stiffness_of(n, p.e_star)


@kernel
def jkr(c, p, h):
    """F, a and U of Johnson, Kendall and Roberts (`with_neck`)."""
    return with_neck(c, p, p.adhesion, 0.0, h)


@kernel
def jkr_tangent(c, p, h):
    """dF/dd [N/m]"""
    return stiffness_with_neck(c, p, p.adhesion, 0.0, h)


@kernel
def jkr_grip(c, n, p):
    """2 (3/2) pi w R while there is a neck [N]; none of the force of the step in which it breaks."""
    return p.grip * c.radius if n.contact_radius > 0.0 else -n.force


@helper
def neck_fraction(k):
    """Part s of the work of adhesion that makes the neck."""
    return k / (1.0 + k)


@kernel
def auto(c, p, h):
    """`with_neck` of the part of the work of adhesion that is Schwarz's short range, and the pull of the rest."""
    fraction = neck_fraction(p.necks * math.sqrt(c.radius))
    return with_neck(c, p, fraction * p.adhesion, (1.0 - fraction) * p.pull * c.radius, h)


@kernel
def auto_tangent(c, p, h):
    """dF/dd [N/m]"""
    fraction = neck_fraction(p.necks * math.sqrt(c.radius))
    return stiffness_with_neck(c, p, fraction * p.adhesion, (1.0 - fraction) * p.pull * c.radius, h)


@kernel
def auto_grip(c, n, p):
    """3 pi s w R of the neck, as `jkr_grip`, and the pull 2 pi (1 - s) w R [N]."""
    fraction = neck_fraction(p.necks * math.sqrt(c.radius))
    return p.grip * (2.0 + fraction) * c.radius if n.contact_radius > 0.0 else -n.force


@kernel
def dmt(c, n, p):
    """F = -2 pi w R and U = F d while the bodies touch."""
    pull = p.pull * c.radius if c.overlap > 0.0 else 0.0
    return Adhesion(-pull, -pull * c.overlap)


@kernel
def dmt_tangent(c, n, p):
    """dF/dd [N/m]"""
    return 0.0


@kernel
def dmt_grip(c, n, p):
    """Minus the attraction where friction feels the external load only [N]."""
    return p.grip * c.radius if c.overlap > 0.0 else 0.0


def tabor_number(work_of_adhesion: float, modulus: float, radius: float, distance: float) -> float:
    """Return (R w^2/(E*^2 z_0^3))^(1/3) [-]."""
    return math.cbrt(radius * work_of_adhesion**2 / (modulus**2 * distance**3))


def with_pull_off(options: Options) -> bool:
    """Return whether friction feels the load and the pull-off force."""
    return options["friction_load"] == "with_pull_off"


def mix_jkr(pair: Pair, options: Options) -> JkrParameters:
    """Return E*, w/E* and the load of friction of a pair."""
    w, modulus = max(options["work_of_adhesion"], MIN_WORK), e_star(pair.a, pair.b)
    return JkrParameters(modulus, w / modulus, 3.0 * math.pi * w if with_pull_off(options) else 0.0, 0.0)


def in_steps(p: Any, integrator: str) -> Any:
    """Return the parameters in the steps of an integrator."""
    return p._replace(part_steps={"explicit": 1.0, "implicit": 2.0}[integrator])


def mix_auto(pair: Pair, options: Options) -> AutoParameters:
    """Return the parameters of a pair: those of JKR, the pull of DMT, and how both are mixed."""
    p, w = mix_jkr(pair, options), options["work_of_adhesion"]
    necks = (tabor_number(max(w, MIN_WORK), p.e_star, 1.0, options["equilibrium_distance"]) / TRANSITION) ** 1.5
    return AutoParameters(p.e_star, p.adhesion, p.grip / 3.0, p.part_steps, 2.0 * math.pi * w, necks)


def mix_dmt(pair: Pair, options: Options) -> DmtParameters:
    """Return the pull-off force over the radius, and what of it friction does not feel."""
    pull = 2.0 * math.pi * options["work_of_adhesion"]
    return DmtParameters(pull, 0.0 if with_pull_off(options) else -pull)


def neck_length(pair: Pair, options: Options, radius: float) -> float:
    """Return how far bodies of at most this effective radius [m] may be apart before their neck breaks [m]."""
    return BEYOND * longest_neck(max(options["work_of_adhesion"], MIN_WORK), e_star(pair.a, pair.b), radius)


def pull_off_forces(pair: Pair, options: Options, radius: Any) -> Any:
    """Return the forces that part contacts of these effective radii (n,) [N]."""
    by_number = neck_fraction(mix_auto(pair, options).necks * np.sqrt(radius))
    fraction = {"jkr": 1.0, "dmt": 0.0, "auto": by_number}[options["model"]]
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


def of_model(options: Options) -> Law | None:
    """Return the law of one model where the scene chooses it, or None: by Tabor's number."""
    return {"jkr": JKR, "dmt": DMT, "auto": None}[options["model"]]


ADHESION = Law(
    name="adhesion",
    stage="normal",
    kernel=auto,
    tangent=auto_tangent,
    parameters=AutoParameters,
    mix=mix_auto,
    in_steps=in_steps,
    history=("joined", "adhesion_work"),
    replaces="hertz",
    reach=neck_length,
    added_load=auto_grip,
    pull_off=pull_off_forces,
    remark=tabor_remark,
    variant=of_model,
    options=(
        Option(
            "work_of_adhesion", "energy_per_area", None, low=0.0, pair_key="work_of_adhesion",
            doc='energy to part a unit of area of both surfaces; a pair\'s own work_of_adhesion replaces it, such as "50 mJ/m2"',
        ),
        Option(
            "model", "dimensionless", "auto", words=("auto", "jkr", "dmt"),
            doc="necks (jkr), a constant force (dmt), or the fraction of each by Tabor's number (auto)",
        ),
        Option(
            "friction_load", "dimensionless", "with_pull_off", words=("with_pull_off", "external"),
            doc="load of friction: with the force that separates (JKR: twice), or the external one",
        ),
        Option("equilibrium_distance", "length", 2e-10, low=1e-11, doc="distance of the surfaces at rest, for Tabor's number"),
    ),
    source="Johnson, Kendall and Roberts 1971; Derjaguin, Muller and Toporov 1975; between: Schwarz 2003, Maugis 1992",
)  # fmt: skip

JKR = replace(
    ADHESION, kernel=jkr, tangent=jkr_tangent, parameters=JkrParameters, mix=mix_jkr, added_load=jkr_grip, variant=None
)  # fmt: skip

DMT = replace(
    ADHESION, stage="adhesion", kernel=dmt, tangent=dmt_tangent, parameters=DmtParameters, mix=mix_dmt, history=(), replaces="",
    reach=None, added_load=dmt_grip, variant=None, in_steps=None,
)  # fmt: skip

PLUGIN = Plugin(
    name="adhesion", effects=(ADHESION,), source="Johnson, Kendall and Roberts 1971; Derjaguin, Muller and Toporov 1975"
)
