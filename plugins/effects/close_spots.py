"""Close spots: the spots of a body on one plate lower the plate under each other. Inactive unless a scene names it.

    [effects]
    close_spots = {}

A normal force N on an elastic half-space lowers its surface at the distance r by g N, g = (1 - nu)/(2 pi G r) (Boussinesq 1885;
Johnson 1985, Eq. 3.22b). So a spot presses only with what is left of its overlap, d_i = (N_i/K_i)^(2/3) + sum_j g_ij N_j, for all
spots of a body on a side at once. What is left out and what it changes: README.md of the plug-ins, "Close spots".
"""

import math

from thirdbody.plugin import Material, Options, Pair, Plugin, SpotInteraction, e_star


def boussinesq(material: Material, options: Options) -> float:
    """Return the displacement of the surface times distance over force, (1 - nu)/(2 pi G) [m2/N]."""
    return (1.0 - material.poisson_ratio) / (2.0 * math.pi * material.shear_modulus)


def hertz_stiffness(pair: Pair, options: Options) -> float:
    """Return 4/3 E* [Pa]: N = 4/3 E* (R d^3)^(1/2)."""
    return 4.0 / 3.0 * e_star(pair.a, pair.b)


CLOSE_SPOTS = SpotInteraction(
    name="close_spots",
    compliance=boussinesq,
    stiffness=hertz_stiffness,
    source="Boussinesq 1885; Johnson 1985, Contact Mechanics, Eq. 3.22b; Greenwood and Tripp 1967 (several spots)",
)

PLUGIN = Plugin(name="close_spots", effects=(CLOSE_SPOTS,), source="Boussinesq 1885")
