"""DMT adhesion: a plug-in in one file, and the template for your own laws.

Use it with `--plugin dmt_adhesion.py` and name it in the scene; scenes that do not name it are unaffected:

    [effects.dmt_adhesion]
    work_of_adhesion = "50 mJ/m2"

Test your copy with `thirdbody laws --check FILE`. A file may also define kinds of debris: classes derived from
`PlacedDebris`, listed in `DEBRIS_KINDS = (...)`; example in plugins/README.md.

The model (Derjaguin, Muller and Toporov 1975): attraction acts outside a contact area that remains that of
Hertz, so it is a constant force 2 pi w R as long as the bodies touch, and that is also the force which separates
them. It holds for small, stiff bodies, (R w^2/(E*^2 z_0^3))^(1/3) < 0.1 with z_0 about 0.2 nm (Tabor 1977).
Soft or large bodies form necks and need the model of Johnson, Kendall and Roberts instead: 3/2 pi w R to
separate them.
"""

import math
from typing import NamedTuple

# The public interface: a plug-in imports nothing else of thirdbody.
from thirdbody.plugin import Adhesion, Law, Option, Options, Pair, Plugin, kernel


class DmtParameters(NamedTuple):
    """Parameters of the kernel for a pair of materials: floats only, SI."""

    work_of_adhesion: float  # J/m2: energy to separate a unit area of both surfaces, w = g_a + g_b - g_ab


@kernel  # compiled into the contact loop: floats and named tuples, `math`, other kernels; nothing else
def dmt(c, n, p):
    """F = -2 pi w R, U = -2 pi w R d, with the effective radius R of the contact and the overlap d.

    `c` is the contact, `n` the result of the normal law, `p` the parameters; see `thirdbody.plugin` for their
    fields. Negative forces are attractive. U closes the energy ledger: dU/dd = F, and zero at first touch. The force jumps
    there: the engine applies it for the part of the step in which the bodies touch.
    """
    pull_off = 2.0 * math.pi * p.work_of_adhesion * c.radius
    # no touch, no force: a select instead of a branch lets the compiler vectorise over contacts
    pull_off = pull_off if c.overlap > 0.0 else 0.0
    return Adhesion(-pull_off, -pull_off * c.overlap)


@kernel
def dmt_tangent(c, n, p):
    """dF/dd [N/m]: zero, the force is constant. Laws without a tangent run in the explicit integrator only."""
    return 0.0


def mix_dmt(pair: Pair, options: Options) -> DmtParameters:
    """Return the parameters of one pair of materials: plain Python, run once. `options`: values of the scene, SI, checked.

    The work of adhesion is the pair's own where the scene gives one, see `pair_key`. A law that averages a property of two
    materials does so here.
    """
    return DmtParameters(options["work_of_adhesion"])


DMT = Law(
    name="dmt_adhesion",
    # Adhesion adds to the total force only: the load available to friction is that without adhesion.
    stage="adhesion",
    kernel=dmt,
    tangent=dmt_tangent,
    parameters=DmtParameters,
    mix=mix_dmt,
    options=(
        Option(
            "work_of_adhesion",
            "energy_per_area",
            None,  # no default: a property that the scene must give
            low=0.0,
            pair_key="work_of_adhesion",  # a [[pairs]] table of the scene may give its own
            doc="energy to part a unit of area; twice the surface energy for two equal clean bodies",
        ),
    ),
    # A law with memory names its floats here, history=("force_x", ...): its kernel then receives them as one
    # more argument and returns (result, (new values...)).
    source="Derjaguin, Muller and Toporov 1975, J. Colloid Interface Sci. 53, 314",
)

PLUGIN = Plugin(name="dmt_adhesion", effects=(DMT,), source="template plug-in of thirdbody")
