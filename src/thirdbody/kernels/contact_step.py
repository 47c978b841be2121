"""What measures receive (`laws.measures`)."""

from typing import NamedTuple


class ContactStep(NamedTuple):
    """What a contact did in a step, input of measures.

    Attributes
    ----------
    load : float
        Load that friction feels, at the end of the step [N]; 0 in the step in which the contact opens.
    force, limit : float
        Size of the tangential force, and its limit by friction [N].
    slip, speed : float
        Irreversible slip in the step [m], and that over the length of the step [m/s].
    friction_work : float
        Dissipated by friction in the step, as booked in the energy ledger [J].
    contact_radius : float
        Radius of the contact area [m].
    peak_pressure : float
        Largest pressure in the contact area [Pa].
    overlap : float
        Overlap [m].
    dt : float
        Length of the step [s]; 0 in the step in which the contact opens.
    plate : float
        1 where the partner is a plate, 0 where it is another body.
    """

    load: float
    force: float
    limit: float
    slip: float
    speed: float
    friction_work: float
    contact_radius: float
    peak_pressure: float
    overlap: float
    dt: float
    plate: float
