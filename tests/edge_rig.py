"""Steel balls under an upper body with an edge: what tests of this contact share."""

import numpy as np
from thirdbody.kernels.tables import zone
from thirdbody.scene import model

MODULUS = 210e9 / (2.0 * (1.0 - 0.3**2))  # E* of steel on steel
MICRO, SIZE = 1e-6, 4e-4
PLACES = np.array([(0.0, 0.0), (2e-5, 0.0), (-3e-5, 1e-5), (0.0, 4.5e-5), (8e-5, 0.0)])


def zone_row(kind, half, radius=0.0, edge=0.0):
    row = np.zeros(zone.WIDTH)
    row[zone.KIND], row[zone.HALF_WIDTH], row[zone.RADIUS], row[zone.EDGE] = kind, half, radius, edge
    return row


def rig(make, places, profile, motion=None, friction=0.3, plates=0.1, shift=0.0, gravity=None, **keys):
    """Balls at places (n, 2) from the middle of the contact [m]; `gravity` downwards [m/s2]."""
    middle = 0.5 * SIZE + shift
    debris = [make.ball(MICRO, (middle + x, middle + y, MICRO)) for x, y in places]
    upper = model.UpperPlate(material="ball", support="load_per_particle", pressure=profile, motion=motion or model.Motion())
    tables = {
        "plates": model.Plates(lower=model.LowerPlate(material="ball"), upper=upper, contact={"friction": plates}),
        "contact": model.Contact(level="mindlin", debris_contact="none"),
        "solver": model.Solver(**({"duration": 1.0} | keys)),
        "domain": model.Domain(size=(2.0 * middle, 2.0 * middle), periodic=False),
        "effects": model.Effects(gravity=gravity and (0.0, 0.0, -gravity)),
    }
    return make.build(make.scene(debris, {"ball": make.STEEL}, friction=friction, restitution=0.5, **tables))
