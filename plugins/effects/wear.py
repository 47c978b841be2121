"""Wear by sliding, a measure: volume lost by the debris and by both plates, and where on the plates.

Archard's law: a contact that slips by ds under the load N removes dV = k N ds. The energy law takes the energy that friction
dissipates instead: dV = alpha dE. Where a contact slips throughout, dE = mu N ds, and k = alpha mu. In partial slip the energy
law counts what the rim of the contact dissipates, Archard's the irreversible slip that the friction law tells.

A measure changes the shape of nothing: a depth from a short run, times cycles, is an extrapolation by rate. `plates.wear` of a
scene takes the depth from the surfaces of the plates (`engine.wear`).
"""

from typing import NamedTuple

from thirdbody.plugin import Amount, Measure, Option, Options, Pair, Plugin, kernel


class WearParameters(NamedTuple):
    """Coefficients of the plates and of the debris [m3/J], which is [1/Pa]; 1 for the energy law, 0 for Archard's."""

    plates: float
    bodies: float
    by_energy: float


@kernel
def wear(s, p):
    """Return the volume that the body loses, that which the plate loses [m3], and the friction work [J]. Archard 1953, J. Appl.
    Phys. 24, 981, Eq. 4 with k = K/H; Fouvry, Kapsa and Vincent 1996, Wear 200, 186: volume by dissipated energy."""
    done = s.friction_work if p.by_energy != 0.0 else s.load * s.slip
    return p.bodies * done, p.plates * done, s.friction_work


def mix_wear(_pair: Pair, options: Options) -> WearParameters:
    """Return the coefficients of the scene: the same for all pairs of materials."""
    return WearParameters(options["plates"], options["bodies"], float(options["law"] == "energy"))


WEAR = Measure(
    name="wear",
    kernel=wear,
    parameters=WearParameters,
    mix=mix_wear,
    amounts=(
        Amount("worn_volume", "m3", "Volume lost by the body since the start."),
        Amount(
            "plate_wear", "m3", "Volume lost by the plate at contacts with the body since the start", of_plate=True,
            map=("wear_depth", "m"),
        ),
        Amount(
            "sliding_work", "J", "Dissipated by slip at contacts with the plate since the start", of_plate=True,
            map=("friction_work_density", "J/m2"),
        ),
    ),
    options=(
        Option("law", "dimensionless", "archard", words=("archard", "energy"), doc="load times slip, or dissipated energy"),
        Option(
            "plates", "wear_coefficient", None, low=0.0,
            doc='volume lost by a plate per load times slip, or per energy (1 m3/J = 1/Pa), such as "1e-15 m3/J"',
        ),
        Option("bodies", "wear_coefficient", 0.0, low=0.0, doc='the same for a body, such as "1e-15 m3/J"'),
    ),
    source="Archard 1953, J. Appl. Phys. 24, 981; Fouvry, Kapsa and Vincent 1996, Wear 200, 186",
)  # fmt: skip

PLUGIN = Plugin(name="wear", measures=(WEAR,), source="wear by sliding")
