"""Adhesion of elastic spheres: with necks (JKR) or by a constant force (DMT), chosen by Tabor's number.

    [effects.adhesion]
    work_of_adhesion = "50 mJ/m2"
    model = "auto"

`jkr` (Johnson, Kendall and Roberts 1971; forms in `jkr`): a neck forms at touch, overlap zero, and lasts until the bodies are
`longest_neck` apart. It stands for soft or large spheres. `dmt` (Derjaguin, Muller and Toporov 1975): Hertz's contact, and
2 pi w R as long as it touches. It stands for stiff or small ones. The number mu = (R w^2/(E*^2 z_0^3))^(1/3) of Tabor (1977, J.
Colloid Interface Sci. 58, 2), with the equilibrium distance z_0 of the surfaces, decides: below 0.1 DMT, above 5 JKR (Johnson
and Greenwood 1997, J. Colloid Interface Sci. 192, 326). `auto` takes DMT where a contact's own mu is below 0.1, JKR above;
between 0.1 and 5 the force that separates lies between the two (Maugis 1992), at most a third above that of JKR: `thirdbody
check` gives it.

The work of adhesion is that of all pairs of materials, or a pair's own: it is a property of both, and there is no mixing rule.

`jkr` and `auto` replace the normal law. Friction feels the load plus twice the pull-off force (Thornton and Yin 1991, Powder
Technol. 65, 153), with DMT plus the pull-off force, which is Hertz's force (Derjaguin 1934); or the load alone.
"""

import math
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from thirdbody.plugin import Adhesion, Law, Normal, Option, Options, Pair, Plugin, e_star, helper, kernel, pretty

from .jkr import (
    JUMPS,
    energy_unit,
    force_of,
    force_of_a_jump,
    longest_neck,
    neck_since,
    peak_pressure_of,
    squared_radius_rate_of,
    stiffness_of,
    stiffness_of_a_jump,
    stored_of,
)

DMT_BELOW, JKR_ABOVE = 0.1, 5.0
"""Tabor's numbers up to which DMT holds, and from which on JKR does."""

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
    """Those of contacts with necks from an effective radius on, and with a constant force below it, SI."""

    e_star: float
    adhesion: float
    grip: float
    part_steps: float
    dmt_pull: float  # N/m: over the radius
    dmt_grip: float  # N/m
    neck_from: float  # m


class DmtParameters(NamedTuple):
    """Pull-off force, and what friction does not feel of it, over the radius, N/m."""

    pull: float
    grip: float


@helper
def with_neck(c, p, h):
    """Force, area and energy of the neck (`jkr.neck`); what the jumps lose is booked as the neck forms.

    h: whether there was a neck; what it lost [J].
    """
    n = neck_since(c.overlap, c.overlap - c.moved, c.radius, p.adhesion, h[0])
    forms = n.joined * (1.0 - h[0])
    lost = forms * JUMPS * energy_unit(n, c.radius, p.e_star)
    jumps = p.part_steps > 0.0 and c.moved != 0.0 and n.joined != h[0]
    of_jump = force_of_a_jump(n, c.moved, forms, 1.0 if p.part_steps == 1.0 else 0.0, c.radius, p.e_star)
    answer = Normal(
        of_jump if jumps else force_of(n, c.radius, p.e_star), n.joined * n.scale * n.y * n.y,
        stored_of(n, c.radius, p.e_star), lost, peak_pressure_of(n, c.radius, p.e_star), squared_radius_rate_of(n, c.radius),
    )  # fmt: skip
    return answer, (n.joined, h[1] + lost)


@helper
def stiffness_with_neck(c, p, h):
    """dF/dd of `with_neck` [N/m]."""
    n = neck_since(c.overlap, c.overlap - c.moved, c.radius, p.adhesion, h[0])
    jumps = p.part_steps > 0.0 and c.moved != 0.0 and n.joined != h[0]
    of_jump = stiffness_of_a_jump(n, c.moved, n.joined, c.radius, p.e_star)
    return of_jump if jumps else stiffness_of(n, p.e_star)


@kernel
def jkr(c, p, h):
    """F, a and U of Johnson, Kendall and Roberts (`with_neck`)."""
    return with_neck(c, p, h)


@kernel
def jkr_tangent(c, p, h):
    """dF/dd [N/m]"""
    return stiffness_with_neck(c, p, h)


@kernel
def jkr_grip(c, n, p):
    """2 (3/2) pi w R while there is a neck [N]; none of the force of the step in which it breaks."""
    return p.grip * c.radius if n.contact_radius > 0.0 else -n.force


@kernel
def auto(c, p, h):
    """`with_neck` from the radius p.neck_from on, below it Hertz with the constant attraction of DMT."""
    necked, memory = with_neck(c, p, h)
    overlap = max(c.overlap, 0.0)
    a, pull = math.sqrt(c.radius * overlap), p.dmt_pull * c.radius
    hertz = 4.0 / 3.0 * p.e_star * a * overlap
    has_neck, touches = c.radius >= p.neck_from, 1.0 if c.overlap > 0.0 else 0.0
    answer = Normal(
        necked.force if has_neck else hertz - touches * pull,
        necked.contact_radius if has_neck else a,
        necked.stored if has_neck else (0.4 * hertz - pull) * overlap,
        necked.dissipated if has_neck else 0.0,
        necked.peak_pressure if has_neck else p.e_star * (2.0 * overlap / (math.pi * max(a, 1e-300))),
        necked.squared_radius_rate if has_neck else touches * c.radius,
    )
    return answer, (memory[0] if has_neck else touches, memory[1] if has_neck else 0.0)


@kernel
def auto_tangent(c, p, h):
    """dF/dd [N/m]"""
    hertz = 2.0 * p.e_star * math.sqrt(c.radius * max(c.overlap, 0.0))
    necked = stiffness_with_neck(c, p, h)
    return necked if c.radius >= p.neck_from else hertz


@kernel
def auto_grip(c, n, p):
    """As `jkr_grip`, or the pull-off force of DMT [N]."""
    grip = (p.grip if c.radius >= p.neck_from else p.dmt_grip) * c.radius
    return grip if n.contact_radius > 0.0 else -n.force


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


def radius_of_tabor_number(number: float, work_of_adhesion: float, modulus: float, distance: float) -> float:
    """Return the effective radius [m] of a Tabor number."""
    return (number * distance) ** 3 * (modulus / max(work_of_adhesion, MIN_WORK)) ** 2


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


def neck_from(pair: Pair, options: Options) -> float:
    """Return the effective radius [m] from which on contacts have necks."""
    if options["model"] != "auto":
        return 0.0 if options["model"] == "jkr" else 1e300
    return radius_of_tabor_number(
        DMT_BELOW, options["work_of_adhesion"], e_star(pair.a, pair.b), options["equilibrium_distance"]
    )  # fmt: skip


def mix_auto(pair: Pair, options: Options) -> AutoParameters:
    """Return the parameters of a pair: those of JKR and DMT, and the radius that divides them."""
    p, pull = mix_jkr(pair, options), 2.0 * math.pi * options["work_of_adhesion"]
    return AutoParameters(*p, pull, pull if with_pull_off(options) else 0.0, min(neck_from(pair, options), 1e300))


def mix_dmt(pair: Pair, options: Options) -> DmtParameters:
    """Return the pull-off force over the radius, and what of it friction does not feel."""
    pull = 2.0 * math.pi * options["work_of_adhesion"]
    return DmtParameters(pull, 0.0 if with_pull_off(options) else -pull)


def neck_length(pair: Pair, options: Options, radius: float) -> float:
    """Return how far bodies of at most this effective radius [m] may be apart before their neck breaks [m]."""
    return BEYOND * longest_neck(max(options["work_of_adhesion"], MIN_WORK), e_star(pair.a, pair.b), radius)


def neck_length_where_necks(pair: Pair, options: Options, radius: float) -> float:
    """As `neck_length`; 0 for bodies too small to have necks."""
    return 0.0 if radius < neck_from(pair, options) else neck_length(pair, options, radius)


def pull_off_forces(pair: Pair, options: Options, radius: Any) -> Any:
    """Return the forces that part contacts of these effective radii (n,) [N]."""
    factor = np.where(radius >= neck_from(pair, options), 1.5, 2.0)
    return factor * math.pi * options["work_of_adhesion"] * radius


def tabor_remark(pair: Pair, options: Options, low: float, high: float) -> tuple[str, bool]:
    """Return what the model is between two effective radii, and whether it hardly fits: w, Tabor's numbers, pull-off forces."""
    w, modulus = options["work_of_adhesion"], e_star(pair.a, pair.b)
    numbers = [tabor_number(w, modulus, radius, options["equilibrium_distance"]) for radius in (low, high)]
    border = neck_from(pair, options)
    model = "jkr" if low >= border else "dmt" if high < border else f"dmt below R = {pretty(border, 'length')}, jkr above"
    forces = [pretty(float(pull_off_forces(pair, options, radius)), "force") for radius in (low, high)]
    tabor = f"Tabor's number {numbers[0]:.2g} to {numbers[1]:.2g}"
    text = f"w = {pretty(w, 'energy_per_area')}, {model}; {tabor}, pull-off {forces[0]} to {forces[1]}"
    largest, smallest = max(numbers), min(numbers)
    if largest > DMT_BELOW and high < border:
        return f"{text}; dmt holds below {DMT_BELOW:g}: it pulls up to a third too strongly", True
    if smallest < JKR_ABOVE and high >= border:
        return f"{text}; jkr holds above {JKR_ABOVE:g}: it pulls up to a quarter too weakly", True
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
    reach=neck_length_where_necks,
    added_load=auto_grip,
    pull_off=pull_off_forces,
    remark=tabor_remark,
    variant=of_model,
    options=(
        Option(
            "work_of_adhesion", "energy_per_area", None, low=0.0, pair_key="work_of_adhesion",
            doc='energy to part a unit of area of both surfaces; a pair\'s own work_of_adhesion replaces it, such as "50 mJ/m2"',
        ),
        Option("model", "dimensionless", "auto", words=("auto", "jkr", "dmt"), doc="necks, a constant force, by Tabor's number"),
        Option(
            "friction_load", "dimensionless", "with_pull_off", words=("with_pull_off", "external"),
            doc="load of friction: with the force that separates (JKR: twice), or the external one",
        ),
        Option("equilibrium_distance", "length", 2e-10, low=1e-11, doc="distance of the surfaces at rest, for Tabor's number"),
    ),
    source="Johnson, Kendall and Roberts 1971; Derjaguin, Muller and Toporov 1975; choice: Tabor 1977",
)  # fmt: skip

JKR = replace(
    ADHESION, kernel=jkr, tangent=jkr_tangent, parameters=JkrParameters, mix=mix_jkr, reach=neck_length, added_load=jkr_grip,
    variant=None,
)  # fmt: skip

DMT = replace(
    ADHESION, stage="adhesion", kernel=dmt, tangent=dmt_tangent, parameters=DmtParameters, mix=mix_dmt, history=(), replaces="",
    reach=None, added_load=dmt_grip, variant=None, in_steps=None,
)  # fmt: skip

PLUGIN = Plugin(
    name="adhesion", effects=(ADHESION,), source="Johnson, Kendall and Roberts 1971; Derjaguin, Muller and Toporov 1975"
)
