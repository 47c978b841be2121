"""DMT adhesion: a plug-in in one file, and the template for yours.

Use it with `--plugin dmt_adhesion.py` and name it in the scene; a scene that does not name it has no trace of
it:

    [effects.dmt_adhesion]
    work_of_adhesion = "50 mJ/m2"

Judge a copy of yours with `thirdbody laws --check FILE`. A file may bring kinds of debris, too: classes derived
from `PlacedDebris`, named in `DEBRIS_KINDS = (...)`; the README has one.

The model (Derjaguin, Muller and Toporov 1975): attraction acts outside a contact area that stays Hertz', so
it is one constant pull 2 pi w R for as long as the bodies touch, and that is also the force which separates
them. It holds for small, stiff bodies, (R w^2/(E*^2 z_0^3))^(1/3) < 0.1 with z_0 about 0.2 nm (Tabor 1977).
Soft or large ones neck and need the model of Johnson, Kendall and Roberts instead: 3/2 pi w R to separate
them.
"""

from __future__ import annotations

import math
from typing import NamedTuple

# The one door: a plug-in imports nothing else of ours.
from thirdbody.plugin import Adhesion, Law, Option, Options, Pair, Plugin, kernel


class DmtParameters(NamedTuple):
    """Numbers that the kernel needs of a pair of materials: floats only, SI, one field each."""

    work_of_adhesion: float  # J/m2: the energy to part a unit of area of both surfaces, w = g_a + g_b - g_ab


@kernel  # compiled into the contact loop: floats and named tuples, `math`, other kernels; nothing else
def dmt(c, n, p):
    """F = -2 pi w R, U = -2 pi w R d, with the effective radius R of the contact and the overlap d.

    `c` is the contact, `n` what the normal law answered, `p` the parameters; see `thirdbody.plugin` for their
    fields. Negative forces pull. U is what makes the energy ledger close: dU/dd = F, and zero at first touch.
    """
    pull = 2.0 * math.pi * p.work_of_adhesion * c.radius
    # no touch, no force: a select instead of a branch lets the compiler handle several contacts at once
    pull = pull if c.overlap > 0.0 else 0.0
    return Adhesion(-pull, -pull * c.overlap)


@kernel
def dmt_tangent(c, n, p):
    """dF/dd, N/m: zero, the pull is constant. Without a tangent a law would run in the explicit integrator
    only."""
    return 0.0


def mix_dmt(pair: Pair, options: Options) -> DmtParameters:
    """Parameters of one pair of materials: plain Python, run once. `options` holds what the scene says, in
    SI, checked.

    One work of adhesion for all pairs. A law that averages a property of two materials says here by which
    rule.
    """
    return DmtParameters(options["work_of_adhesion"])


DMT = Law(
    name="dmt_adhesion",
    # Adhesion adds to the total force only: the engine leaves the load that friction may use as it is without
    # adhesion.
    stage="adhesion",
    kernel=dmt,
    tangent=dmt_tangent,
    parameters=DmtParameters,
    mix=mix_dmt,
    options=(
        Option(
            "work_of_adhesion",
            "energy_per_area",
            None,  # no default: how sticky the surfaces are is for the scene to say
            low=0.0,
            doc="energy to part a unit of area; twice the surface energy for two equal clean bodies",
        ),
    ),
    # A law that remembers names its floats here, history=("force_x", ...): its kernel then gets them as one
    # more argument and returns (answer, (new values...)).
    source="Derjaguin, Muller and Toporov 1975, J. Colloid Interface Sci. 53, 314",
)

PLUGIN = Plugin(name="dmt_adhesion", effects=(DMT,), source="template plug-in of thirdbody")
